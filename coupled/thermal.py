"""What `coupled` takes as a thermal model: small ones, linear or not."""

from __future__ import annotations

from typing import Any

import numpy as np

from thermofem import checks
from thermofem.models import Foster, StateSpace, ThermalModel, foster

LARGEST_QUADRATIC = 60  # states
SETTLING = 10  # times what a step of heat takes to its last 5 %
LARGEST = 500  # poles; a certified reduction needs 10 to 40, and the time of a step grows with their number


def network(model: ThermalModel) -> Foster:
    """Return ``model`` as the Foster network that the integration runs.

        dx_i/dt = (R_i P_abs - x_i)/tau_i,    dT = sum_i x_i

    Parameters
    ----------
    model : Foster or StateSpace
        at most 500 states; a StateSpace has one channel and is diagonalised, which changes nothing but the form.

    Raises
    ------
    InputError
        a large model (the FEM itself), a model that is not linear, or one that is not passive.
    """
    if isinstance(model, StateSpace | Foster) and model.order > LARGEST:
        raise checks.InputError(
            f"model is a system of {model.order} states, at most {LARGEST} can be integrated with the optics; "
            "reduce it first (surrogate.reduce), or keep the FEM in the loop (coupled.cosimulate)"
        )
    if isinstance(model, StateSpace):
        model = foster(model)
    if not isinstance(model, Foster):
        raise checks.InputError(
            f"model is a {type(model).__name__}; a compact thermal model is needed (thermofem.Foster, StateSpace, "
            "OutputMap or Quadratic), such as surrogate.second_order(...), the .model of a fit, or for k(T) "
            "surrogate.reduce_quadratic(...).model; coupled.cosimulate takes the FEM itself"
        )
    if not model.passive or model.thermal_resistance <= 0:
        raise checks.InputError(
            f"model has R = {np.min(model.R):g} K/W; a passive network has none below 0, and R_th = "
            f"{model.thermal_resistance:g} K/W must be positive; refit it with fewer poles"
        )
    return model


def compact(model: Any) -> Any:
    """Return ``model`` in the form that the integration runs: a Foster network, an output map over one, or quadratic.

    Raises
    ------
    InputError
        as `network`, and a nonlinear model with more than 60 states, or with numbers that are not finite.
    """
    if hasattr(model, "H") and hasattr(model, "G"):
        n = np.shape(model.A)[0]
        if n > LARGEST_QUADRATIC:
            raise checks.InputError(
                f"model is quadratic with {n} states, at most {LARGEST_QUADRATIC} can be integrated with the optics: "
                "a step costs n^3"
            )
        if not all(np.all(np.isfinite(getattr(model, name))) for name in "AHGBC"):
            raise checks.InputError("model has matrices that are not finite")
        if np.linalg.eigvals(np.asarray(model.A, dtype=float)).real.max() >= 0:
            raise checks.InputError("model has a mode that does not decay; every eigenvalue of A must be negative")
        return model
    if hasattr(model, "coefficient") and hasattr(model, "linear"):
        checks.finite("model.coefficient", model.coefficient, unit="1/K")
        if isinstance(model.linear, Foster):
            network(model.linear)
            return model
        return type(model)(network(model.linear), model.coefficient)
    return network(model)


def states_of(model: Any) -> int:
    """Number of states of a compact model."""
    return int(np.shape(model.A if hasattr(model, "A") else getattr(model, "linear", model).R)[0])


def long_enough(model: ThermalModel) -> float:
    """How long a run from cold should be, s, so that it says whether a ring with this heat pulses.

    Ten times what a step of heating takes to 95 % of its rise, in two digits. Measured on 54 points, 3 to 10 dBm or a
    fifth of it, of the rings of 2021 and 2012 with the second-order equation, ten and a hundred times as slow, and
    reductions of the reference strip, ten times as slow, and of one over a cavity: no point was a slow transient then;
    up to two were after half of that, 30 of the cavity's after 20 us.
    """
    small, times = compact(model), np.geomspace(1e-10, 1.0, 10_001)
    left = np.flatnonzero(small.step_response(times) < 0.95 * small.thermal_resistance)
    return min(float(f"{SETTLING * times[left[-1]]:.1e}"), 1.0) if left.size else 1e-9
