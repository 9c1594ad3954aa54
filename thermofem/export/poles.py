"""Independent poles: the form of a linear thermal model that circuits, co-simulation units and tables share.

dx_k/dt = -rate_k x_k + sum_i B_ki P_i,    z_j = sum_k C_jk x_k,    dT_j = z_j + coefficient z_j^2
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from thermofem import checks
from thermofem.arrays import Array
from thermofem.models import Quadratic, StateSpace, two_kinds
from thermofem.models.state_space import eigenmodes

from .export_header import identifiers

LARGEST_ORDER = 500  # poles; a file of more is read slowly by every simulator, a certified reduction needs 10 to 40


@dataclass(frozen=True, eq=False)
class Poles:
    """Independent poles with their input and output coefficients.

    rate [shape (n,), 1/s]
    B [shape (n, inputs), K/J]
    C [shape (outputs, n)]: the largest entry of each column is 1 in size, so that x_k is a temperature in K.
    coefficient [1/K]: of the output map; 0 for a linear model.
    """

    rate: Array
    B: Array
    C: Array
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    coefficient: float = 0.0


def poles_of(model: Any) -> Poles:
    """The poles of a linear model or an output map, slowest last; poles that no input reaches are left out.

    Raises InputError: another kind of model, too many states, or a pole that does not decay.
    """
    if isinstance(model, StateSpace):  # of any number of inputs and outputs
        return _of_state_space(model)
    small = two_kinds(model)
    if isinstance(small, Quadratic):
        raise checks.InputError(
            f"a {type(model).__name__} is not a set of independent poles: the format mat takes it; the others take "
            "Foster, StateSpace, Network, Cauer and OutputMap"
        )
    reached = small.linear.R != 0
    rate = 1 / small.linear.tau[reached]
    gain = small.linear.gain[reached, None]
    share = np.ones((1, rate.size))
    return Poles(rate, gain, share, model.inputs, model.outputs, small.coefficient)


def _of_state_space(model: StateSpace) -> Poles:
    """`Poles` of a linear system, each state scaled to a temperature in K; its ambient is a node of the simulator."""
    model = model.without_ambient
    if model.order > LARGEST_ORDER:
        raise checks.InputError(
            f"model is a StateSpace of {model.order} states, too large for this format, which takes {LARGEST_ORDER}",
            "reduce finite elements (surrogate.reduce); of an array take fewer rings, a larger tolerance, or to='mat'",
        )
    rate, vectors = eigenmodes(model)
    B = vectors.T @ model.B
    C = model.C @ vectors
    scale = np.abs(C).max(axis=0)
    used = (scale > 0) & B.any(axis=1)
    order = np.argsort(np.where(used, -rate, np.inf))[: used.sum()]  # fastest first, unused ones left out
    scale = scale[order]
    B = B[order] * scale[:, None]
    C = C[:, order] / scale
    return Poles(rate[order], B, C, model.inputs, model.outputs)


@dataclass(frozen=True, eq=False)
class RCNetwork:
    """R parallel to C for each pole, and the coupling of pins and poles, as SPICE and Verilog-A write it.

    R, C [shape (n,), K/W and J/K]
    shares [shape (n, inputs)]: heat into each pole per watt into each heated pin, at most 1 in size; None: one pin, all
        poles in series (Foster).
    reads [shape (outputs, n)]: coefficient of each pole's temperature in that of each pin that is read.
    parts, pins: every part once, heated ones first, and the pins named after them.
    heated, read: pins of the columns of ``shares`` and of the rows of ``reads``.
    coefficient [1/K]: of the output map dT = z + coefficient z^2, or 0.
    """

    R: Array
    C: Array
    shares: Array | None
    reads: Array
    parts: list[str]
    pins: list[str]
    heated: list[int]
    read: list[int]
    coefficient: float

    def read_by(self, pin: int) -> Array | None:
        """Coefficients of the poles' temperatures in that of a pin, shape (n,); None for a pin that is heated only."""
        return self.reads[self.read.index(pin)] if pin in self.read else None


def rc_network(model: Any, *, taken: Iterable[str]) -> RCNetwork:
    """RC network of a model of independent poles; pins are named after the parts, without the names in ``taken``."""
    poles = poles_of(model)
    parts = list(dict.fromkeys([*poles.inputs, *poles.outputs]))
    pins = identifiers(parts, taken=taken)
    heated = [parts.index(p) for p in poles.inputs]
    read = [parts.index(p) for p in poles.outputs]
    if len(parts) == 1 and not poles.coefficient:  # one pin and a linear model
        size = poles.B[:, 0] * poles.C[0]
        shares = None
    else:
        size = np.abs(poles.B).max(axis=1)
        shares = poles.B / size[:, None]
    return RCNetwork(size / poles.rate, 1 / size, shares, poles.C, parts, pins, heated, read, poles.coefficient)
