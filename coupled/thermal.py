"""Conversion of thermal models to the forms integrated with the optics; comparison of their geometry with a ring."""

import functools
import logging
import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from scipy.constants import c

from thermofem import CrossSection, Foster, InputError, OutputMap, Quadratic, checks
from thermofem.arrays import Array, ArrayLike, Mask
from thermofem.fem import HeatProblem
from thermofem.geometry.section_parts import LIGHT
from thermofem.models import ThermalModel, two_kinds
from thermofem.models.contract import OutsideTrainingWarning, bare, warn_beyond
from thermofem.ring_temperature import CORE, GuidedMode, check_read

from .resonator import PUBLISHED, RingResonator, origin
from .ring_toml import SILICON

log = logging.getLogger("thermofem")

Compact = OutputMap | Quadratic
Heaters: TypeAlias = Mapping[str, Any] | None  # of further inputs: power (W), `Volts` or `Amperes` by name

LARGEST_QUADRATIC = 60  # states
NEEDED = (
    "a thermal model is needed: thermofem.Foster, StateSpace, OutputMap or Quadratic, a Network or Cauer ladder, a fit "
    "or a reduction; coupled.cosimulate takes the FEM itself"
)
HIGHEST = 1e9  # K/W; rings have 1e3 to 1e7. Beyond, the resonance moves faster than integration steps can follow
MOST_POLES = 500  # poles; a certified reduction needs 10 to 40, and the time of a step grows with their number
TAKEN = (0.67, 1.5)  # volume of two-photon absorption over that of the core, where it is that of a published ring
GIVEN = (0.3, 4.0)  # the same, where it was given: that of a slot or a rib differs much from its core


def compact(model: ThermalModel) -> Compact:
    """Return the dynamics of a thermal model: poles with an output map, its coefficient 0 if linear, or quadratic.

    model: of any kind that has ``dynamics``, or a fit or reduction that holds one.
    Raises InputError: a model without that form (the FEM itself), one with too many states, one that is not passive, or
        numbers that are not finite or beyond `HIGHEST`.
    """
    checks.has("model", model, "dynamics", hint=NEEDED)
    small: Compact = two_kinds(model)
    if isinstance(small, Quadratic):
        check_order(small.order, LARGEST_QUADRATIC)
        # absolute values: the states may cancel in the sum
        check_resistance(float(np.abs(small.C) @ np.abs(np.linalg.solve(small.A, small.B))))
        return small
    checks.instance("model.dynamics", small, OutputMap, hint=NEEDED)
    poles = small.linear
    check_order(poles.order, MOST_POLES)
    own = poles.inputs == poles.outputs  # what another part reads, or the light, may have poles of either sign
    if (own and not poles.passive) or poles.thermal_resistance <= 0:
        raise InputError(
            f"model has R = {np.min(poles.R):g} K/W; a passive network has none below 0, and R_th = "
            f"{poles.thermal_resistance:g} K/W must be positive; refit it with fewer poles"
        )
    check_resistance(float(np.abs(poles.R).sum()))
    return small


def plain(model: Compact) -> Foster | Compact:
    """The Foster network of poles without a bend; any other model unchanged."""
    return model if isinstance(model, Quadratic) or model.bent else model.linear


def linear(model: ThermalModel, purpose: str) -> Foster:
    """Return the Foster network of a linear thermal model (`compact`).

    purpose: a verb phrase for the error, "to PURPOSE, a linear one is needed".
    Raises InputError: a model that is not linear, such as an output map or a quadratic model.
    """
    small = plain(compact(model))
    hint = f"to {purpose}, a linear one is needed: Foster, StateSpace, Network or Cauer, or a fit or reduction"
    checks.instance("model.dynamics", small, Foster, hint=hint)
    assert isinstance(small, Foster)
    return small


def poles(model: Compact, purpose: str) -> OutputMap:
    """``model``, or InputError where it is quadratic; purpose: a verb phrase, "to PURPOSE, poles are needed"."""
    hint = f"to {purpose}, poles are needed: Foster, StateSpace, Network, Cauer or OutputMap, or a fit or reduction"
    checks.instance("model.dynamics", model, OutputMap, hint=hint)
    assert isinstance(model, OutputMap)
    return model


def check_order(order: int, most: int) -> None:
    """Raise InputError if the number of thermal states exceeds ``most``; a step costs O(n) or O(n^3)."""
    hint = "reduce it first (surrogate.reduce), or keep the FEM in the loop (coupled.cosimulate)"
    checks.integer("the number of states of the model", order, 1, most, hint=hint)


def check_resistance(value: float) -> None:
    """Raise InputError for a thermal resistance (K/W) above `HIGHEST`, for which steps would become too small."""
    hint = "resistances are in K/W (2 K/mW is 2e3)"
    checks.between("R_th of the model", value, -HIGHEST, HIGHEST, unit="K/W", hint=hint)


def trusted(model: Any, rise: ArrayLike, linear: ArrayLike = 0.0) -> None:
    """Check that temperature rises in a run or at fixed points lie within the range of validity of a thermal model.

    rise [K]: all temperature rises by the light.
    linear [K]: rises before an output map, as many as are known.
    Warns OutsideTrainingWarning: rises far above those of the training, or near the maximum of an output map.
    Raises InputError: linear rises beyond the maximum of an output map, where more heat would lower the temperature.
    """
    inner = bare(model)
    highest = np.max(rise, initial=0.0)
    top = top_of(inner)
    if top < np.inf:
        inner.of(linear)
        # no physical model comes to 99 % of the highest rise of an output map
        if highest > 0.99 * top:
            warn_at_top(top, "the ring reaches it")
    warn_beyond(np.asarray(highest), getattr(inner, "largest_rise", None))


def top_of(model: Any) -> float:
    """Highest rise in K that an output map gives; inf for any other model."""
    return float(getattr(bare(model), "top", np.inf))


def dense_times(model: Any, times: Array, duration: float) -> tuple[Array, Mask]:
    """Times (s) at which a run is computed, shape (n,), and a mask of those that are the requested ``times``.

    4001 times are added for a model whose temperature rise is checked (`trusted`), so that no short peak is missed.
    """
    compared = top_of(model) < np.inf or getattr(bare(model), "largest_rise", None) is not None
    if not times.size or not compared:
        return times, np.ones(times.size, dtype=bool)
    # 4001 times at which the rise is compared with what the model describes
    every = np.concatenate([times, np.linspace(0.0, duration, 4001)])
    order = np.argsort(every, kind="stable")
    return every[order], order < times.size


def warn_at_top(top: float, said: str) -> None:
    """Warn (OutsideTrainingWarning) that a rise may exceed the maximum of an output map; ``said`` is the reason."""
    text = f"the output map ends at {top:.4g} K, where more heat would mean less temperature"
    warnings.warn(f"{text}; {said}: take less power, or a Quadratic model", OutsideTrainingWarning, stacklevel=3)


def attributes(model: Compact) -> dict[str, Any]:
    """Attributes of a Dataset for a thermal model: R and tau of its poles, and the coefficient of its output map."""
    if isinstance(model, Quadratic):
        return {}
    poles = {"model_R": np.asarray(model.linear.R), "model_tau": np.asarray(model.linear.tau)}
    return poles | {"model_coefficient": float(model.coefficient)} if model.bent else poles


def provenance(kind: str, ring: RingResonator, model: Compact) -> dict[str, Any]:
    """Attributes of a Dataset: its kind, the ring and the poles of the thermal model."""
    return origin(kind, ring) | attributes(model)


def long_enough(model: ThermalModel) -> float:
    """Duration in s of a run from cold after which one can decide whether the ring pulses.

    Ten times the time in which the step response reaches 95 % of its static value, rounded to two digits. Measured on
    54 settings (powers of 3 to 10 dBm and a fifth of them; the rings of 2021 and 2012 with the second-order equation,
    also ten and a hundred times slower, and reductions of two geometries): with this duration no setting was still in
    a slow transient, with half of it up to two were. For the ring over a cavity, 30 were after 20 us.
    """
    small = compact(model)
    times = np.geomspace(1e-10, 1.0, 10_001)
    left = np.flatnonzero(small.step_response(times) < 0.95 * small.thermal_resistance)
    return min(float(f"{10 * times[left[-1]]:.1e}"), 1.0) if left.size else 1e-9


def check_model(ring: RingResonator, model: Any, small: ThermalModel, read: str | None = None) -> dict[str, Any]:
    """`check_geometry`, the temperature that a ring reads (`ring_temperature.check_read`), and tables left by k(T).

    model: as `check_geometry` takes it.
    small: its channel that drives the ring.
    read: the output that the caller has chosen, if any.
    Returns the attributes of all for a result, their warnings joined.
    """
    return check_ports(ring, model, small.inputs[0], small.outputs[0], chosen=read is not None)


def check_ports(
    ring: RingResonator, model: Any, heated: str, read: str, *, chosen: bool = False
) -> dict[str, Any]:  # fmt: skip
    """`check_model` for the input ``heated`` and the output ``read``, which the caller may have ``chosen``."""
    doubts = [
        check_geometry(ring, model),
        check_read(ring, geometry_of(model), heated, read, mode=mode_of(model), chosen=chosen),
        _told(_beyond(model)),
    ]
    warnings = [each["warning"] for each in doubts if "warning" in each]
    return doubts[1] | _warning("; ".join(warnings))


def _told(text: str) -> dict[str, str]:
    """Log a warning; return it as an attribute."""
    if text:
        log.warning("%s", text)
    return _warning(text)


def _warning(text: str) -> dict[str, str]:
    return {"warning": text} if text else {}


def _origins(model: Any) -> list[dict[str, Any]]:
    """What a model, and the one that it holds, say about what they were made from."""
    return [getattr(one, "origin", None) or {} for one in (model, bare(model))]


def _beyond(model: Any) -> str:
    """A sentence on tables k(T) and c_p(T) that a model leaves, or an empty string."""
    text = geometry_of(model)
    return _beyond_laws(text) if text else _stated(model, "warning")


def _stated(model: Any, key: str) -> str:
    """What the origin of a model says under a key; empty where it does not."""
    return next((str(origin[key]) for origin in _origins(model) if origin.get(key)), "")


@functools.lru_cache(64)
def _beyond_laws(text: str) -> str:
    return CrossSection.from_toml_text(text).beyond_laws()


def notes_of(doubts: dict[str, Any]) -> tuple[str, ...]:
    """The warning among the attributes of `check_model`, for the notes of a fit."""
    return (doubts["warning"],) if "warning" in doubts else ()


def as_read(ring: RingResonator, small: ThermalModel) -> RingResonator:
    """The ring as it reads a channel that `check_model` has compared before, so that it is not compared again."""
    return replace(ring, read=LIGHT if small.outputs[0] == LIGHT else CORE)


def check_geometry(ring: RingResonator, model: Any) -> dict[str, str]:
    """Compare volume and material of a ring with the geometry of a thermal model; log a warning if they disagree.

    model: a thermal model with the text of its geometry in ``origin``, a HeatProblem, or a family.

    Returns {"warning": text} for the attributes of a result, or an empty dict.
    Raises InputError: parameters of a silicon ring for a core of another material.
    """
    text = geometry_of(model)
    return _told(_contradiction(ring, text) if text else "")


def geometry_of(model: Any) -> str:
    """Text of the geometry of a model; empty where it is not known."""
    section = getattr(model, "geometry", None) or _base_of(model)
    return section.to_toml() if isinstance(section, CrossSection) else _stated(model, "geometry")


def _base_of(model: Any) -> Any:
    """The geometry file of a family, or of the one that a model is of; None of others."""
    family = getattr(model, "family", model)
    return getattr(getattr(family, "box", None), "base", None)


def mode_of(model: Any) -> GuidedMode | None:
    """The mode whose temperature the output "light" of a model, family or heat problem is; None if it is not known."""
    if isinstance(model, HeatProblem):
        mode = model.light
        return None if mode is None else GuidedMode(mode.name, mode.wavelength)
    section = _base_of(model)
    if isinstance(section, CrossSection):
        own = section.light
        reads = LIGHT in getattr(model, "family", model).outputs
        return GuidedMode(own.mode, own.wavelength) if own is not None and reads else None
    return next(filter(None, map(GuidedMode.of_origin, _origins(model))), None)


def without_origin(model: Any) -> Any:
    """Copy of the model without its geometry, for the many runs of a search."""
    return replace(model, origin=None) if getattr(model, "origin", None) else model


@functools.lru_cache(256)
def _contradiction(ring: RingResonator, text: str) -> str:
    """A sentence stating that the volume of the ring differs from that of the geometry, or an empty string."""
    section = CrossSection.from_toml_text(text)
    core = "core" if "core" in section.heated else section.heated[0]
    material = section.material_of(core)
    low, high = SILICON
    index = None if material.index is None else material.index.index(c / ring.frequency)
    other_material = index is not None and not low < index < high
    of_silicon = low < ring.refractive_index < high and ring.tpa_coefficient
    if other_material and of_silicon:
        raise InputError(
            f"ring {ring.name!r} has the numbers of silicon, and {core!r} of {section.name!r} is {material.name}",
            "`thermofem ring`, coupled.ring_from in Python, makes the ring of a geometry",
        )
    if section.kind != "ring":
        return ""
    of = next((name for name, make in PUBLISHED.items() if make().tpa_volume == ring.tpa_volume), "")
    ratio = ring.tpa_volume / section.volumes()[core]
    least, most = TAKEN if of else GIVEN
    if least < ratio < most:
        return ""
    return (
        f"ring {ring.name!r}: tpa_volume is {ring.tpa_volume * 1e18:.3g} um^3{of and f', that of {of}'}, {ratio:.3g} "
        f"times the volume of {core!r} in the geometry of the model: thresholds of self-pulsing move; give perimeter "
        "and mode_area, or make the ring with `thermofem ring`"
    )
