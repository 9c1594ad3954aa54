"""Derivatives of the poles of a certified reduction with respect to the parameters of the geometry."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from thermofem import Foster, checks
from thermofem.fem import HeatProblem
from thermofem.fem.derivatives import project, tangents_of
from thermofem.fem.modal_derivatives import ModalDerivative

from .reduce import Reduction

if TYPE_CHECKING:
    import xarray as xr

OWN = 1e-6  # largest element of V^T K V, over its poles, minus 1: round-off leaves 1e-10
SIMPLE = 1e-6  # relative distance of neighbouring rates below which a pole is not simple


def pole_derivatives(heat: HeatProblem, reduction: Reduction, parameters: str | Sequence[str]) -> xr.Dataset:
    """Derivatives of every R_i and tau_i of a reduction, exact for its basis.

    Parameters
    ----------
    heat : HeatProblem
        that was reduced.
    reduction : Reduction
        of ``heat.system``, or of one of its channels.
    parameters : str or sequence of str
        paths, as of `thermofem.derivatives`.

    Returns
    -------
    xarray.Dataset
        over "parameter" and "pole" (tau increasing): R (K/W per unit) and tau (s per unit), nan where a pole is not
        simple; over "parameter": thermal_resistance.

    Raises
    ------
    InputError
        a reduction with several channels, one of another problem, or a path without a derivative.
    """
    import xarray as xr

    checks.has("heat", heat, "unknowns", "discretization", hint="th.assemble(geometry) makes the HeatProblem")
    checks.has("reduction", reduction, "model", "basis", hint="surrogate.reduce gives one")
    model = reduction.model
    if not isinstance(model, Foster):
        raise checks.InputError("pole_derivatives needs one input and one output; reduce heat.channels(heated, read)")
    heated, read = model.inputs[0], model.outputs[0]
    d = heat.discretization
    b, c = (d.means[name][d.free] for name in (heated, read))
    V = reduction.basis / np.sqrt(np.einsum("nk,nk->k", reduction.basis, d.E @ reduction.basis))
    rate = 1 / np.asarray(model.tau)
    own = V.T @ (-heat.channels(heated, read).A @ V) / np.sqrt(np.outer(rate, rate))
    if np.abs(own - np.eye(rate.size)).max() > OWN:
        raise checks.InputError("the reduction is of another heat problem: its poles are not those of heat's matrices")
    changes, _, tangents = tangents_of(heat, parameters, (heated, read))
    modal = ModalDerivative(rate, V.T @ b, V.T @ c, *project(tangents, (heated, read), d.free, V))
    of_R, of_tau = modal.poles()
    apart = np.abs(rate[:, None] / rate - 1) + np.eye(rate.size)
    double = apart.min(axis=1) < SIMPLE
    of_R[:, double], of_tau[:, double] = np.nan, np.nan
    return xr.Dataset(
        {
            "R": (("parameter", "pole"), of_R, {"units": "K/W per unit of the parameter"}),
            "tau": (("parameter", "pole"), of_tau, {"units": "s per unit of the parameter"}),
            "thermal_resistance": ("parameter", modal.resistance(), {"units": "K/W per unit of the parameter"}),
        },
        coords={"parameter": [one.name for one in changes], "unit": ("parameter", [one.unit for one in changes])},
    )
