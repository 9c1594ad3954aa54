"""The form of a linear model that circuits, co-simulation and tables share: independent poles.

dx_k/dt = -rate_k x_k + sum_i B_ki P_i,    dT_j = sum_k C_jk x_k
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from thermofem import Foster, OutputMap, StateSpace, checks
from thermofem.arrays import Array
from thermofem.models.state_space import eigenmodes

MOST = 500  # poles in a file for a simulator


@dataclass(frozen=True, eq=False)
class Modes:
    """Poles with their share in every input and output.

    rate [shape (n,), 1/s]
    B [shape (n, inputs), K/J]
    C [shape (outputs, n)]: the largest entry of each column is 1 in size, so that x_k is a temperature in K.
    coefficient [1/K]: 0 for a linear model.
    """

    rate: Array
    B: Array
    C: Array
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    coefficient: float = 0.0


def modes(model: Any) -> Modes:
    """The poles of a linear model or an output map, slowest last; poles that no input reaches are left out.

    Raises InputError: another kind of model, too many states, or a pole that does not decay.
    """
    if isinstance(model, StateSpace):  # of any number of inputs and outputs
        return _of_state_space(model)
    small = model.dynamics
    if isinstance(small, OutputMap):
        return replace(modes(small.linear), coefficient=small.coefficient)
    if not isinstance(small, Foster):
        raise checks.InputError(
            f"a {type(model).__name__} is not a set of independent poles: the format mat takes it; the others take "
            "Foster, StateSpace, Network, Cauer and OutputMap"
        )
    R, tau = np.asarray(small.R), np.asarray(small.tau)
    kept = R != 0
    share = np.ones((1, int(kept.sum())))
    return Modes(1 / tau[kept], (R / tau)[kept, None], share, model.inputs, model.outputs)


def _of_state_space(model: StateSpace) -> Modes:
    """The poles of a linear system, each scaled to a temperature."""
    if model.order > MOST:
        raise checks.InputError(
            f"a StateSpace of {model.order} states is too large for this format, which takes {MOST}",
            "reduce finite elements (surrogate.reduce); of an array take fewer rings, a larger tolerance, or to='mat'",
        )
    rate, vectors = eigenmodes(model)
    B, C = vectors.T @ np.asarray(model.B), np.asarray(model.C) @ vectors
    scale = np.abs(C).max(axis=0)
    kept = (scale > 0) & np.any(B != 0, axis=1)
    rate, B, C, scale = rate[kept], B[kept], C[:, kept], scale[kept]
    order = np.argsort(-rate)
    return Modes(rate[order], (B * scale[:, None])[order], (C / scale)[:, order], model.inputs, model.outputs)
