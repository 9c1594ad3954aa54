"""What `coupled` takes as a thermal model: anything linear and small, as a Foster network."""

from __future__ import annotations

import numpy as np

from thermofem import checks
from thermofem.model import Foster, StateSpace, ThermalModel, foster

LARGEST = 500  # poles; a certified reduction needs 10 to 40, and the time of a step grows with their number


def network(model: ThermalModel) -> Foster:
    """Return ``model`` as the Foster network that the integration runs.

        dx_i/dt = (R_i P_abs - x_i)/tau_i,    dT = sum_i x_i

    Parameters
    ----------
    model : Foster or StateSpace
        a StateSpace with at most 500 states and one channel; it is diagonalised, which changes nothing but the form.

    Raises
    ------
    InputError
        a large StateSpace (the FEM itself), a model that is not linear, or one that is not passive.
    """
    if isinstance(model, StateSpace):
        if model.order > LARGEST:
            raise checks.InputError(
                f"model is a system of {model.order} states, at most {LARGEST} can be integrated with the optics; "
                "reduce it first (surrogate.reduce), or keep the FEM in the loop (coupled.cosimulate)"
            )
        model = foster(model)
    if not isinstance(model, Foster):
        raise checks.InputError(
            f"model is a {type(model).__name__}; a linear thermal model is needed (thermofem.Foster or StateSpace), "
            "such as surrogate.second_order(...) or the .model of a fit"
        )
    if not model.passive or model.thermal_resistance <= 0:
        raise checks.InputError(
            f"model has R = {np.min(model.R):g} K/W; a passive network has none below 0, and R_th = "
            f"{model.thermal_resistance:g} K/W must be positive; refit it with fewer poles"
        )
    return model
