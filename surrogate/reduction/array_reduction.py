"""Several rings on one chip: one certified thermal model with an input and an output for each ring.

On a laterally uniform stack every ring heats the same axisymmetric field, centred at its own axis. Ring i, at the
distance d_ij from ring j, reads that field off the axis. With one reduced field (rates lambda_k, input b_k)

    dx_jk/dt = -lambda_k x_jk + b_k P_j,         dT_i = sum_j sum_k c_k(d_ij) x_jk
    H_ij     = sum_k b_k c_k(d_ij)/(s + lambda_k) = H_ji

The static field of the heated ring is in the basis: the static gain of every pair is that of the FEM. How the error of
a pair is bounded stands in `surrogate.reduction.ring_pairs`.

Passive: with t_k = 1/(1 + (w/lambda_k)^2), which rises with lambda_k, and R_k = b_k c_k/lambda_k, a matrix over pairs,

    Re H(i w) = sum_k t_k R_k = sum_m (t_m - t_(m-1)) S_m,    S_m = sum_(k >= m) R_k,    rates in increasing order,

so that no powers of any rings draw heat from nothing if no S_m has a negative eigenvalue, which is checked.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.linalg import block_diag
from scipy.sparse import diags

from thermofem import Foster, StateSpace, checks
from thermofem.arrays import Array, ArrayLike, NDArray
from thermofem.fem import HeatProblem
from thermofem.models import HasModel
from thermofem.models.state_space import LARGEST

from .ring_pairs import Pairs, check_positions, reduce_pairs, with_copies

_TIMES = np.geomspace(1e-13, 10, 560)  # s, where step responses are looked at


@dataclass(frozen=True, eq=False)
class ArrayReduction(HasModel):
    """A thermal model of several rings, and the proof of its accuracy.

    Attributes
    ----------
    model : StateSpace
        inputs "ring 1" to "ring N", then "heater 1" to "heater N" for each kind of heater; outputs the rings.
    positions : array, shape (N, 2), m
    error_bound : float
        the largest of ``channel_bounds``.
    channel_bounds : array, shape (N, inputs)
        |H - H_r|/(H(0) + `certificate.FLOOR` R_th) of each channel, at any frequency; R_th is that of one ring.
    passive : bool
        whether no powers in the rings draw heat from nothing (checked by sums of residues, see the module).
    tolerance : float
    poles : array of int, shape (N, inputs)
        how many poles each channel has; far pairs have fewer.
    domain_error : float
        relative change of the crosstalk of the farthest pair, or of R_th, if the chip went on beyond the domain. It is
        no part of ``error_bound``; above 1 % the log warns.
    """

    model: StateSpace
    positions: Array
    error_bound: float
    channel_bounds: Array = field(repr=False)
    passive: bool
    tolerance: float
    poles: NDArray[np.int64] = field(repr=False)
    domain_error: float = 0.0

    @property
    def rings(self) -> int:
        """Number of rings."""
        return len(self.positions)

    @property
    def order(self) -> int:
        """Number of states."""
        return self.model.order

    @cached_property
    def crosstalk(self) -> Array:
        """Steady rise of every output per watt in every input, in K/W, shape (N, inputs)."""
        return self.model.gain

    def channel(self, heated: int, read: int) -> Foster:
        """One channel between two rings, counted from 0, as a Foster network; its R_i may be of either sign."""
        for name, ring in (("heated", heated), ("read", read)):
            checks.integer(name, ring, 0, self.rings - 1, hint="rings are counted from 0")
        rate = -self.model.A.diagonal()
        residue = self.model.C[read] * self.model.B[:, heated]
        used = residue != 0
        return Foster(R=residue[used] / rate[used], tau=1 / rate[used])

    @cached_property
    def half_times(self) -> Array:
        """Time in s after which a step of heat in one ring has half of its effect on another, shape (N, N).

        nan where that takes more than 10 s.
        """
        rings = range(self.rings)
        return np.array([[_half_time(self.channel(j, i)) for j in rings] for i in rings])

    @property
    def provenance(self) -> dict[str, Any]:
        """Provenance that `surrogate.save_model` writes with the model."""
        bound, centres = self.error_bound, self.positions.tolist()
        made = {"method": "array reduction", "tolerance": self.tolerance, "error_bound": bound, "positions": centres}
        return {**(self.model.origin or {}), **made, "ports": list(self.model.inputs)}


def reduce_array(
    heat: HeatProblem,
    positions: ArrayLike,
    tolerance: float = 1e-4,
    *,
    heated: str | None = None,
    heaters: Sequence[str] = (),
) -> ArrayReduction:
    """Reduce N rings at given centres to one thermal model with N inputs and N outputs.

    Parameters
    ----------
    heat : HeatProblem
        of one ring; its mesh is made again where the neighbours need it finer.
    positions : array, shape (N, 2), m
        the rings' centres.
    tolerance : float
        of every channel at every frequency, relative to its static gain plus a hundredth of R_th.
    heated : str
        the part that light heats, and whose mean temperature is read; default the first heated part.
    heaters : sequence of str
        further heated parts of each ring, which become inputs: a bank of tuned filters.

    Returns
    -------
    ArrayReduction

    Raises
    ------
    InputError
        rings that overlap, a domain that ends before the most distant pair, a stack that is not laterally uniform
        (voids), names that are not heated, or a tolerance out of reach.

    >>> from thermofem import assemble, strip_ring
    >>> pair = reduce_array(assemble(strip_ring(outer_radius=120e-6).opened()), [(0, 0), (20e-6, 0)])
    >>> (pair.crosstalk / 1e3).round(2).tolist()  # K/mW
    [[7.89, 0.24], [0.24, 7.89]]
    """
    tolerance = checks.between("tolerance", tolerance, 1e-7, 0.1, hint="it is relative to the static gain")
    core = checks.choice("heated", heated, heat.heated, default=heat.heated[0])
    for name in heaters:
        checks.choice("heaters", name, [other for other in heat.heated if other != core])
    checks.unique("heaters", heaters)
    centres, apart = check_positions(heat, core, positions)
    # the places where a ring is read, its own first; distances that differ by less than 1e-12 m are one
    distances, place = np.unique(np.round(apart / 1e-12), return_inverse=True)
    solved, copies = with_copies(heat, core, 1e-12 * distances[1:])
    domain = solved.domain_error(core, core)
    if copies:
        what = f"the crosstalk over {1e6 * apart.max():.3g} um"
        domain = max(domain, solved.domain_error(core, copies[-1], what=what))
    pairs = [reduce_pairs(solved, part, (core, *copies), tolerance) for part in (core, *heaters)]
    model, bounds, poles = _assembled(pairs, place.reshape(apart.shape), ("ring", *heaters))
    origin = {"geometry": heat.geometry.to_toml(), "mesh_accuracy": heat.accuracy}
    return ArrayReduction(
        model=replace(model, origin=origin),
        positions=centres,
        error_bound=float(bounds.max()),
        channel_bounds=bounds,
        passive=_is_passive(model),
        tolerance=tolerance,
        poles=poles,
        domain_error=domain,
    ).recorded()


def _assembled(
    pairs: Sequence[Pairs], place: NDArray[np.intp], kinds: Sequence[str]
) -> tuple[StateSpace, Array, NDArray[np.int64]]:
    """All sources, read by all rings; the bounds of the channels, and how many poles each has.

    pairs: the field of the core, then of each heater.
    place [shape (N, N)]: the row of a `Pairs` by which one ring reads another.
    kinds: of inputs, in the order of ``pairs``.
    """
    n = len(place)
    names = tuple(f"{kind} {j + 1}" for kind in kinds for j in range(n))
    each = [(pair, place[:, j]) for pair in pairs for j in range(n)]  # of every input
    rate = np.concatenate([pair.rate for pair, _ in each])
    B = block_diag(*(pair.source[:, None] for pair, _ in each))
    C = np.hstack([pair.read[rows] for pair, rows in each])
    bounds = np.column_stack([pair.bound[rows] for pair, rows in each])
    poles = np.column_stack([np.count_nonzero(pair.read, axis=1)[rows] for pair, rows in each])
    full = np.diag if rate.size <= LARGEST else partial(diags, format="csc")
    model = StateSpace(full(np.ones(rate.size)), full(-rate), B, C, inputs=names, outputs=names[:n])
    return model, bounds, poles


def _is_passive(model: StateSpace) -> bool:
    """Whether no sum of the static shares of the fastest poles has a negative eigenvalue, see the module."""
    n = len(model.outputs)
    rate = -model.A.diagonal()
    values, which = np.unique(rate, return_inverse=True)
    total, least = np.zeros((n, n)), np.inf
    for k in range(values.size - 1, -1, -1):
        here = which == k
        total = total + model.C[:, here] @ model.B[here, :n] / values[k]
        least = min(least, float(np.linalg.eigvalsh((total + total.T) / 2)[0]))
    return least >= -1e-14 * float(model.gain.max())  # 1e-14 of the largest R_th: an eigenvalue that is 0


def _half_time(channel: Foster) -> float:
    """Time in s after which a step response has half of its final value; nan where that takes more than 10 s."""
    rise = channel.step_response(_TIMES) / channel.thermal_resistance
    if not rise[-1] >= 0.5:
        return float("nan")
    k = max(int(np.argmax(rise >= 0.5)), 1)
    return float(np.exp(np.interp(0.5, rise[k - 1 : k + 1], np.log(_TIMES[k - 1 : k + 1]))))
