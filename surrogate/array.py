"""Several rings of one kind on one chip: one certified thermal model with an input and an output for each ring.

On a laterally uniform stack every ring heats the same axisymmetric field, centred at its own axis. Ring i, at the
distance d_ij from ring j, reads that field off the axis. With one reduced field (rates lambda_k, input b_k)

    dx_jk/dt = -lambda_k x_jk + b_k P_j,         dT_i = sum_j sum_k c_k(d_ij) x_jk
    H_ij     = sum_k b_k c_k(d_ij)/(s + lambda_k) = H_ji

The static field of the heated ring is in the basis: the static gain of every pair is that of the FEM. How the error of
a pair is bounded stands in `surrogate.array_certificate`.

Passive: with t_k = 1/(1 + (w/lambda_k)^2), which rises with lambda_k, and R_k = b_k c_k/lambda_k, a matrix over pairs,

    Re H(i w) = sum_k t_k R_k = sum_m (t_m - t_(m-1)) S_m,    S_m = sum_(k >= m) R_k,    rates in increasing order,

so that no powers of any rings draw heat from nothing if no S_m has a negative eigenvalue, which is checked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thermofem import Foster, HeatProblem, InputError, Probe, StateSpace, assemble, checks
from thermofem.display import shown
from thermofem.geometry.neighbours import check_distance, check_uniform, footprint

from .array_certificate import Pairs, reduce_pairs

Array = NDArray[np.float64]

MOST = 1000  # rings
SAME = 1e-12  # m, distances that differ by less are one
_SHARES = np.geomspace(1e-9, 10, 400)  # s, where step responses are looked at


@shown
@dataclass(frozen=True, eq=False)
class ArrayReduction:
    """A thermal model of several rings, and the proof of its accuracy.

    Attributes
    ----------
    model : StateSpace
        inputs "ring 1" to "ring N", then "heater 1" to "heater N" for each kind of heater; outputs the rings.
    positions : array, shape (N, 2), m
    error_bound : float
        the largest of ``channel_bounds``.
    channel_bounds : array, shape (N, inputs)
        |H - H_r|/(H(0) + `array_certificate.FLOOR` R_th) of each channel, at any frequency; R_th is that of one ring.
    passive : bool
        whether no powers in the rings draw heat from nothing (checked by sums of residues, see the module).
    tolerance : float
    poles : array of int, shape (N, inputs)
        how many poles each channel has; far pairs have fewer.
    """

    model: StateSpace
    positions: Array
    error_bound: float
    channel_bounds: Array = field(repr=False)
    passive: bool
    tolerance: float
    poles: NDArray[np.int64] = field(repr=False)

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
            if not 0 <= ring < self.rings:
                raise InputError(f"{name} = {ring!r} is no ring; they are counted from 0 to {self.rings - 1}")
        rate = -np.asarray(self.model.A).diagonal()
        residue = self.model.C[read] * self.model.B[:, heated]
        used = residue != 0
        return Foster(R=residue[used] / rate[used], tau=1 / rate[used])

    @cached_property
    def half_times(self) -> Array:
        """Time in s after which a step of heat in one ring has half of its effect on another, shape (N, N)."""
        found: dict[int, float] = {}
        times = np.empty((self.rings, self.rings))
        for i in range(self.rings):
            for j in range(self.rings):
                key = round(float(np.linalg.norm(self.positions[i] - self.positions[j])) / SAME)
                if key not in found:
                    channel = self.channel(j, i)
                    rise = channel.step_response(_SHARES) / channel.thermal_resistance
                    k = int(np.argmax(rise >= 0.5))
                    ends = rise[k - 1 : k + 1], np.log(_SHARES[k - 1 : k + 1])
                    found[key] = float(np.exp(np.interp(0.5, *ends)))
                times[i, j] = found[key]
        return times

    @property
    def provenance(self) -> dict[str, Any]:
        """Provenance that `surrogate.save_model` writes with the model."""
        bound, places = self.error_bound, self.positions.tolist()
        return {"method": "array reduction", "tolerance": self.tolerance, "error_bound": bound, "positions": places}


def reduce_array(
    heat: HeatProblem,
    positions: ArrayLike,
    tolerance: float = 1e-4,
    *,
    heated: str | None = None,
    heaters: Sequence[str] = (),
) -> ArrayReduction:
    """Reduce N rings of one geometry at given places to one thermal model with N inputs and N outputs.

    Parameters
    ----------
    heat : HeatProblem
        of one ring. Its mesh is made again where the neighbours need it finer.
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
    >>> pair = reduce_array(assemble(strip_ring(outer_radius=120e-6)), [(0, 0), (20e-6, 0)])
    >>> (pair.crosstalk / 1e3).round(2).tolist()  # K/mW
    [[7.86, 0.21], [0.21, 7.86]]
    """
    checks.has(
        "heat", heat, "discretization", "geometry", hint="th.assemble(geometry) makes the HeatProblem of one ring"
    )
    checks.between("tolerance", tolerance, 1e-7, 0.1, hint="it is relative to the static gain")
    part = heat.heated[0] if heated is None else checks.choice("heated", heated, heat.heated)
    kinds = (part, *_heaters(heat, heaters, part))
    places = _places(positions)
    distance, which = _distances(heat, part, places)
    solved = _with_copies(heat, part, distance)
    copies = (
        tuple(probe.name for probe in solved.geometry.probes if probe.distance is not None) if distance.size else ()
    )
    pairs = [reduce_pairs(solved, kind, (part, *copies), tolerance) for kind in kinds]
    model, poles = _assembled(pairs, kinds, which)
    scale = np.hstack([pair.bound[which] for pair in pairs])
    return ArrayReduction(
        model=model,
        positions=places,
        error_bound=float(scale.max()),
        channel_bounds=scale,
        passive=_is_passive(pairs[0], which),
        tolerance=tolerance,
        poles=poles,
    )


def _heaters(heat: HeatProblem, heaters: Sequence[str], part: str) -> tuple[str, ...]:
    """Names of the parts that are inputs beside the core."""
    names = (heaters,) if isinstance(heaters, str) else tuple(heaters)
    for name in names:
        checks.choice("heaters", name, [other for other in heat.heated if other != part])
    if len(set(names)) < len(names):
        raise InputError(f"heaters = {names} holds a name twice; give each once")
    return names


def _places(positions: ArrayLike) -> Array:
    places = checks.numbers("positions", positions, hint="one row (x, y) in m for each ring")
    if places.ndim != 2 or places.shape[1] != 2 or not 1 <= len(places) <= MOST:
        raise InputError(f"positions has shape {places.shape}; (N, 2) is needed, x and y in m of 1 to {MOST} rings")
    return places


def _distances(heat: HeatProblem, part: str, places: Array) -> tuple[Array, NDArray[np.intp]]:
    """Different distances in m, and for each pair of rings 0 (the same ring) or one more than the place of its own."""
    between = np.linalg.norm(places[:, None] - places, axis=-1)
    if len(places) == 1:
        return np.empty(0), np.zeros((1, 1), dtype=np.intp)
    geometry, shape = heat.geometry, next(p for p in heat.geometry.parts if p.name == part)
    check_uniform(geometry, "positions")
    apart = between + np.where(np.eye(len(places)), np.inf, 0)
    i, j = np.unravel_index(np.argmin(apart), apart.shape)
    if apart[i, j] < 2 * footprint(geometry):
        raise InputError(
            f"positions[{i}] and positions[{j}] are {apart[i, j]:g} m apart, and rings that reach "
            f"{footprint(geometry):g} m overlap below {2 * footprint(geometry):g} m; positions are in m"
        )
    i, j = np.unravel_index(np.argmax(between), between.shape)
    check_distance(geometry, shape, float(between[i, j]), f"positions[{i}] and positions[{j}]")
    off = between[~np.eye(len(places), dtype=bool)]
    rounded, which = np.unique(np.rint(off / SAME), return_inverse=True)
    index = np.zeros(between.shape, dtype=np.intp)
    index[~np.eye(len(places), dtype=bool)] = which + 1
    return rounded * SAME, index


def _with_copies(heat: HeatProblem, part: str, distance: Array) -> HeatProblem:
    """The heat problem with a copy of the part at every distance, on a mesh that resolves them."""
    copies = tuple(Probe(name=f"copy {k + 1}", part=part, distance=float(d)) for k, d in enumerate(distance))
    return assemble(replace(heat.geometry, probes=copies), heat.accuracy) if copies else heat


def _assembled(
    pairs: Sequence[Pairs], kinds: Sequence[str], which: NDArray[np.intp]
) -> tuple[StateSpace, NDArray[np.int64]]:
    """N copies of every kind of source, read by all rings; and the number of poles of each channel."""
    n = len(which)
    rates, inputs, outputs, names = [], [], [], []
    for kind, pair in zip(kinds, pairs, strict=True):
        for j in range(n):
            rates.append(pair.rate)
            inputs.append(pair.source)
            outputs.append(pair.read[which[:, j]])
            names.append(f"{'ring' if kind == kinds[0] else kind} {j + 1}")
    rate = np.concatenate(rates)
    B = np.zeros((rate.size, len(names)))
    start = np.cumsum([0, *(len(b) for b in inputs)])
    for column, b in enumerate(inputs):
        B[start[column] : start[column + 1], column] = b
    C = np.hstack(outputs)
    poles = np.hstack([np.count_nonzero(pair.read, axis=1)[which] for pair in pairs])
    rings = tuple(f"ring {i + 1}" for i in range(n))
    return StateSpace(np.eye(rate.size), -np.diag(rate), B, C, inputs=tuple(names), outputs=rings), poles


def _is_passive(pair: Pairs, which: NDArray[np.intp]) -> bool:
    """Whether no sum of the static shares of the fastest poles has a negative eigenvalue, see the module."""
    total = np.zeros(which.shape)
    least = np.inf
    for k in np.argsort(-pair.rate):
        total = total + (pair.read[:, k] * pair.source[k] / pair.rate[k])[which]
        least = min(least, float(np.linalg.eigvalsh(total)[0] / total[0, 0]))
    return least >= 0
