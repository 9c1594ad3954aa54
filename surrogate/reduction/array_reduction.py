"""Several rings on one chip: one certified thermal model with an input and an output for each ring.

On a laterally uniform stack every ring heats the same axisymmetric field, centred at its own axis. Ring i, at the
distance d_ij from ring j, reads that field off the axis. With one reduced field (rates lambda_k, input b_k)

    dx_jk/dt = -lambda_k x_jk + b_k P_j,         dT_i = sum_j sum_k c_k(d_ij) x_jk
    H_ij     = sum_k b_k c_k(d_ij)/(s + lambda_k) = H_ji

The static field of the heated ring is in the basis: the static gain of every pair is that of the FEM. How the error of
a pair is bounded stands in `surrogate.reduction.ring_pairs`.

Rings of different geometry: ring i has its own cross-section, over which it reads the field of ring j. What ring j
reads of ring i is the same but for the silicon of the reading ring and the two meshes; the model has the mean of both.

Passive: with t_k = 1/(1 + (w/lambda_k)^2), which rises with lambda_k, and R_k = b_k c_k/lambda_k, a matrix over pairs,

    Re H(i w) = sum_k t_k R_k = sum_m (t_m - t_(m-1)) S_m,    S_m = sum_(k >= m) R_k,    rates in increasing order,

so that no powers of any rings draw heat from nothing if no S_m has a negative eigenvalue, which is checked.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.sparse import diags

from thermofem import Foster, StateSpace, checks
from thermofem.algebra.krylov import symmetric_part
from thermofem.arrays import Array, ArrayLike, NDArray
from thermofem.fem import HeatProblem
from thermofem.geometry.resistor import known_resistor, recorded
from thermofem.models import HasModel
from thermofem.models.state_space import MOST_STATES

from .ring_pairs import (
    SAME_DISTANCE,
    Pairs,
    RingKinds,
    check_positions,
    reduce_pairs,
    ring_positions,
    rings_of,
    with_copies,
)


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
    asymmetry : float
        largest difference of the static gains of two rings of different geometry, each as the source, relative to their
        mean; 0 for rings of one geometry.
    domain_error : float
        relative change of the crosstalk of the farthest pair, or of R_th, if the chip went on beyond the domain. It is
        no part of ``error_bound``; above 1 % the log warns.
    outlines : list
        of a layout (`reduce_layout`): the rings of points (x, y) in m around each shape, the outer one first.
    """

    model: StateSpace
    positions: Array
    error_bound: float
    channel_bounds: Array = field(repr=False)
    passive: bool
    tolerance: float
    poles: NDArray[np.int64] = field(repr=False)
    asymmetry: float = 0.0
    domain_error: float = 0.0
    outlines: list[Any] = field(default_factory=list, repr=False)

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
        residue = self.model.C[read] * self.model.B[:, heated]
        used = residue != 0
        rate = -self.model.A.diagonal()[used]
        return Foster(R=residue[used] / rate, tau=1 / rate)

    @cached_property
    def half_times(self) -> Array:
        """Time in s after which a step of heat in one ring has half of its effect on another, shape (N, N).

        nan where that takes more than 10 s.
        """
        times = np.empty((self.rings, self.rings))
        for i, j in np.ndindex(times.shape):
            times[i, j] = _half_time(self.channel(j, i))
        return times

    @property
    def provenance(self) -> dict[str, Any]:
        """Provenance that `surrogate.save_model` writes with the model."""
        provenance = {
            **(self.model.origin or {}),
            "method": "array reduction",
            "tolerance": self.tolerance,
            "error_bound": self.error_bound,
            "positions": self.positions.tolist(),
            "ports": list(self.model.inputs),
        }
        if self.outlines:
            times = self.half_times.astype(object)
            times[np.isnan(self.half_times)] = None
            provenance |= {"outlines": self.outlines, "half_times": times.tolist()}
        return provenance


def reduce_array(
    heat: HeatProblem | Sequence[HeatProblem],
    positions: ArrayLike,
    tolerance: float = 1e-4,
    *,
    heated: str | None = None,
    heaters: Sequence[str] = (),
) -> ArrayReduction:
    """Reduce N rings at given centres to one thermal model with N inputs and N outputs.

    Parameters
    ----------
    heat : HeatProblem, or a sequence of N of them
        of one ring for all, or of each ring, on the same layers. Meshes are made again where the neighbours need them
        finer.
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
        (voids), rings on different layers, names that are not heated, or a tolerance out of reach.

    >>> from thermofem import assemble, strip_ring
    >>> pair = reduce_array(assemble(strip_ring(outer_radius=120e-6).opened()), [(0, 0), (20e-6, 0)])
    >>> (pair.crosstalk / 1e3).round(2).tolist()  # K/mW
    [[7.89, 0.24], [0.24, 7.89]]
    """
    tolerance = checks.between("tolerance", tolerance, 1e-7, 0.1, hint="it is relative to the static gain")
    centres = ring_positions(positions)
    names = (heaters,) if isinstance(heaters, str) else tuple(heaters)
    rings = rings_of(heat, len(centres), heated, names)
    apart = check_positions(rings, centres)
    sources = [_sources(rings, g, apart, names, tolerance) for g in range(len(rings.kinds))]
    domain_error = max(source.domain for source in sources)
    model, bounds, poles = _assembled(sources, rings, names)
    return ArrayReduction(
        model=replace(model, origin=_origin(rings, names)),
        positions=centres,
        error_bound=float(bounds.max()),
        channel_bounds=bounds,
        passive=is_passive(model),
        tolerance=tolerance,
        poles=poles,
        asymmetry=_asymmetry(sources, rings),
        domain_error=domain_error,
    ).recorded()


def _origin(rings: RingKinds, heaters: Sequence[str]) -> dict[str, Any]:
    """Geometry of the rings, one after the other where they differ, accuracy of their meshes, resistances."""
    geometries = [kind.heat.geometry for kind in rings.kinds]
    toml = [geometry.to_toml() for geometry in geometries]
    resistors = {}
    for part in heaters:
        for k, g in enumerate(rings.of.tolist(), 1):
            resistors[f"{part} {k}"] = known_resistor(geometries[g], part)
    accuracy = max(kind.heat.accuracy for kind in rings.kinds)
    return {"geometry": "\n".join(toml), "mesh_accuracy": accuracy, "resistors": recorded(resistors)}


@dataclass(frozen=True, eq=False)
class Sources:
    """Reduced fields of the heated parts of one kind of ring, and the read-out row that serves each pair of rings.

    pairs: the reduced field of the core, then of each kind of heater.
    row [shape (N, N)]: index of the read-out row of `Pairs` by which ring i reads the field of a ring of this kind at
        the centre of ring j.
    domain: largest relative error by the finite domain, of R_th and of the crosstalk to the farthest ring.
    """

    pairs: list[Pairs]
    row: NDArray[np.intp]
    domain: float


def _sources(rings: RingKinds, g: int, apart: Array, heaters: Sequence[str], tolerance: float) -> Sources:
    """Reduce the heat fields of rings of kind ``g``, as every ring reads them at its distance ``apart`` [(N, N), m]."""
    row = np.zeros(apart.shape, dtype=np.intp)
    kind = rings.of.tolist()
    readers: dict[tuple[int, int], int] = {}  # row of each kind and distance, in units of `SAME_DISTANCE`
    for i, j in itertools.permutations(range(len(kind)), 2):
        if g not in (kind[i], kind[j]):
            continue
        other = kind[i] if kind[j] == g else kind[j]
        reader = (other, round(float(apart[i, j]) / SAME_DISTANCE))
        row[i, j] = readers.setdefault(reader, len(readers) + 1)
    distances = [(other, steps * SAME_DISTANCE) for other, steps in readers]
    heat, copies = with_copies(rings, g, distances)
    core = rings.kinds[g].part
    read = (core, *copies)
    domain = heat.domain_error(core, core)
    if readers:
        far = max(range(len(distances)), key=lambda k: distances[k][1])
        what = f"the crosstalk over {distances[far][1] * 1e6:.3g} um"
        domain = max(domain, heat.domain_error(core, copies[far], what=what))
    pairs = [reduce_pairs(heat, part, read, tolerance) for part in (core, *heaters)]
    return Sources(pairs, row, domain)


def _assembled(sources: Sequence[Sources], rings: RingKinds, heaters: Sequence[str]) -> tuple[StateSpace, Array, Any]:
    """The model in which all rings read all sources; bound and number of poles of each channel, shape (N, inputs)."""
    n = len(rings.of)
    kinds = ("ring", *heaters)
    names = tuple(f"{kind} {j}" for kind in kinds for j in range(1, n + 1))
    columns = np.eye(len(names))
    bounds = np.zeros((n, len(names)))
    poles = np.zeros((n, len(names)), dtype=np.int64)
    rates = []
    inputs = []
    outputs = []
    for column, (m, j) in enumerate(np.ndindex(len(kinds), n)):
        for g, source in enumerate(sources):
            # between rings of two kinds half of each source; heater and core are no pair that could be exchanged
            same = rings.of == g
            if rings.of[j] == g:
                share = np.where(same | (m > 0), 1.0, 0.5)
            else:
                share = np.where(same & (m == 0), 0.5, 0.0)
            used = share > 0
            if not used.any():
                continue
            pairs = source.pairs[m]
            rows = source.row[:, j]
            read = pairs.read[rows]
            rates.append(pairs.rate)
            inputs.append(np.outer(pairs.source, columns[column]))
            outputs.append(share[:, None] * read)
            bounds[:, column] = np.maximum(bounds[:, column], used * pairs.bound[rows])
            poles[:, column] += used * np.count_nonzero(read, axis=1)
    B = np.vstack(inputs)
    model = diagonal_system(np.concatenate(rates), B, np.hstack(outputs), names, names[:n])
    return model, bounds, poles


def diagonal_system(rate: Array, B: Array, C: Array, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> StateSpace:
    """The system dx/dt = -rate x + B P, dT = C x; its matrices are sparse from 500 states on."""
    full = np.diag if rate.size <= MOST_STATES else partial(diags, format="csc")
    return StateSpace(full(np.ones(rate.size)), full(-rate), B, C, inputs=inputs, outputs=outputs)


def _asymmetry(sources: Sequence[Sources], rings: RingKinds) -> float:
    """Largest relative difference between the static gains i to j and j to i of two rings of different kind."""
    worst = 0.0
    for i, j in np.argwhere(rings.of[:, None] < rings.of):
        there = _static_gain(sources[rings.of[i]], i, j)
        back = _static_gain(sources[rings.of[j]], i, j)
        mean = abs(there + back) / 2
        worst = max(worst, abs(there - back) / mean)
    return worst


def _static_gain(source: Sources, i: int, j: int) -> float:
    """Static gain in K/W between the rings i and j, by the heat of one kind of source."""
    pairs = source.pairs[0]
    read = pairs.read[source.row[i, j]]
    return float(np.sum(read * pairs.source / pairs.rate))


def is_passive(model: StateSpace) -> bool:
    """Whether summed static gains of the fastest poles, however many, have no negative eigenvalue; see the module."""
    n = len(model.outputs)
    rate = -model.A.diagonal()
    total = np.zeros((n, n))
    round_off = 1e-14 * float(model.gain.max())  # of the largest R_th: an eigenvalue that is 0
    for value in np.unique(rate)[::-1]:
        modes = rate == value
        total += model.C[:, modes] @ model.B[modes, :n] / value
        smallest, *_ = np.linalg.eigvalsh(symmetric_part(total))
        if smallest < -round_off:
            return False
    return True


def _half_time(channel: Foster) -> float:
    """Time in s after which a step response has half of its final value; nan where that takes more than 10 s."""
    times = np.geomspace(1e-13, 10, 560)
    rise = channel.step_response(times) / channel.thermal_resistance
    if not rise[-1] >= 0.5:
        return float("nan")
    k = max(int(np.argmax(rise >= 0.5)), 1)
    around = slice(k - 1, k + 1)
    log_time = np.interp(0.5, rise[around], np.log(times[around]))
    return float(np.exp(log_time))
