"""Thermal models in the form that is integrated with the optics."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from thermofem import Foster, OutputMap, Quadratic, checks
from thermofem.arrays import Array, ArrayLike, NDArray
from thermofem.models import ThermalModel
from thermofem.models.contract import OutsideTrainingWarning, bare, warn_beyond

from .resonator import RingResonator, origin

Compact = Foster | OutputMap | Quadratic

LARGEST_QUADRATIC = 60  # states
NEEDED = (
    "a thermal model is needed: thermofem.Foster, StateSpace, OutputMap or Quadratic, a Network or Cauer ladder, a fit "
    "or a reduction; coupled.cosimulate takes the FEM itself"
)
HIGHEST = 1e9  # K/W; rings have 1e3 to 1e7. Of a hotter one the light turns faster than any step follows
LARGEST = 500  # poles; a certified reduction needs 10 to 40, and the time of a step grows with their number


def compact(model: ThermalModel) -> Compact:
    """Return ``model.dynamics``, checked: a Foster network, an output map over one, or a quadratic system.

    model: of any kind that has such a form, or a fit or reduction that holds one.
    Raises InputError: a model without that form (the FEM itself), one with too many states, one that is not passive, or
        numbers that are not finite or beyond `HIGHEST`.
    """
    checks.has("model", model, "dynamics", hint=NEEDED)
    small = model.dynamics
    if isinstance(small, Quadratic):
        return _checked_quadratic(small)
    if isinstance(small, OutputMap):
        checks.finite("model.coefficient", small.coefficient, unit="1/K")
        _checked_poles(small.linear)
        return small
    checks.instance("model.dynamics", small, Foster, hint=NEEDED)
    return _checked_poles(small)


def linear(model: ThermalModel, purpose: str) -> Foster:
    """Return `compact` of a linear model; InputError for another kind, which cannot be used to ``purpose``."""
    small = compact(model)
    if not isinstance(small, Foster):
        raise checks.InputError(
            f"model is a {type(model).__name__}, which is not linear; to {purpose}, give a linear model: Foster, "
            "StateSpace, Network or Cauer, or a fit or reduction"
        )
    return small


def _checked_poles(poles: Foster) -> Foster:
    if poles.order > LARGEST:
        raise checks.InputError(
            f"model is a system of {poles.order} states, at most {LARGEST} can be integrated with the optics; "
            "reduce it first (surrogate.reduce), or keep the FEM in the loop (coupled.cosimulate)"
        )
    own = poles.inputs == poles.outputs  # what another part reads, or the light, may have poles of either sign
    if (own and not poles.passive) or poles.thermal_resistance <= 0:
        raise checks.InputError(
            f"model has R = {np.min(poles.R):g} K/W; a passive network has none below 0, and R_th = "
            f"{poles.thermal_resistance:g} K/W must be positive; refit it with fewer poles"
        )
    return moderate(poles)


def _checked_quadratic(model: Quadratic) -> Quadratic:
    if model.order > LARGEST_QUADRATIC:
        raise checks.InputError(
            f"model is quadratic with {model.order} states, at most {LARGEST_QUADRATIC} can be integrated with the "
            "optics: a step costs n^3"
        )
    check_resistance(float(np.abs(model.C) @ np.abs(np.linalg.solve(model.A, model.B))))  # of states that cancel, too
    return model


def moderate(poles: Foster) -> Foster:
    """The network itself; InputError where its resistances, whatever their sign, are beyond `HIGHEST`."""
    check_resistance(float(np.abs(poles.R).sum()))
    return poles


def check_resistance(value: float) -> None:
    """Raise InputError for a resistance that no ring has; a run would take steps without end."""
    hint = "resistances are in K/W (2 K/mW is 2e3)"
    checks.between("R_th of the model", value, -HIGHEST, HIGHEST, unit="K/W", hint=hint)


def trusted(model: Any, rise: ArrayLike, linear: ArrayLike = 0.0) -> None:
    """Compare what a run or a fixed point of a ring asked of a thermal model with what the model describes.

    rise [K]: all temperature rises by the light.
    linear [K]: rises before an output map, as many as are known.
    Warns OutsideTrainingWarning: rises far above those of the training, or at the top of an output map.
    Raises InputError: linear rises beyond the top of an output map, where more heat would mean less temperature.
    """
    inner = bare(model)
    if isinstance(inner, OutputMap):
        inner.of(linear)
        # no physical model comes to 99 % of the highest rise of an output map
        if inner.coefficient < 0 and np.max(rise, initial=0.0) > 0.99 * -0.25 / inner.coefficient:
            warn_at_top(inner, "the ring reaches it")
    warn_beyond(np.asarray(np.max(rise, initial=0.0)), getattr(inner, "largest_rise", None))


def dense_times(model: Any, times: Array, duration: float) -> tuple[Array, NDArray[np.bool_]]:
    """Times at which a run is computed, and which of them are the wanted ``times``, s.

    Those of a model whose rise is watched are dense enough that its heat does not pass between them.
    """
    inner = bare(model)
    falls = isinstance(inner, OutputMap) and inner.coefficient < 0
    # 4001 times at which the rise is compared with what the model describes
    extra = np.linspace(0.0, duration, 4001)
    if not times.size or not (falls or getattr(inner, "largest_rise", None) is not None):
        extra = extra[:0]
    every = np.concatenate([times, extra])
    order = np.argsort(every, kind="stable")
    return every[order], order < times.size


def warn_at_top(model: OutputMap, said: str) -> None:
    """OutsideTrainingWarning that heat may go beyond the top of an output map."""
    text = f"the output map ends at {-0.25 / model.coefficient:.4g} K, where more heat would mean less temperature"
    warnings.warn(f"{text}; {said}: take less power, or a Quadratic model", OutsideTrainingWarning, stacklevel=3)


def attributes(model: Compact) -> dict[str, Any]:
    """The poles of a compact model, and its output map, as attributes of a Dataset."""
    if isinstance(model, Quadratic):
        return {}
    if isinstance(model, OutputMap):
        return attributes(model.linear) | {"model_coefficient": float(model.coefficient)}
    return {"model_R": np.asarray(model.R), "model_tau": np.asarray(model.tau)}


def provenance(kind: str, ring: RingResonator, model: Compact) -> dict[str, Any]:
    """Attributes of a Dataset: its kind, the ring and the thermal network."""
    return origin(kind, ring) | attributes(model)


def long_enough(model: ThermalModel) -> float:
    """Duration in s of a run from cold that is long enough to tell whether the ring pulses.

    Ten times the time in which the step response reaches 95 % of its static value, rounded to two digits. Measured on
    54 points (powers of 3 to 10 dBm and a fifth of them; the rings of 2021 and 2012 with the second-order equation,
    also ten and a hundred times slower, and reductions of two geometries): with this duration no point was a slow
    transient, with half of it up to two were. For the ring over a cavity 30 points were after 20 us.
    """
    small, times = compact(model), np.geomspace(1e-10, 1.0, 10_001)
    left = np.flatnonzero(small.step_response(times) < 0.95 * small.thermal_resistance)
    return min(float(f"{10 * times[left[-1]]:.1e}"), 1.0) if left.size else 1e-9
