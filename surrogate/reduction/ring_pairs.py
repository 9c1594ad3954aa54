"""Rings on one chip, their kinds and positions, and how one heated ring is read at the places of the others.

One heated ring read at many distances takes few poles for all, and a bound of the error of each distance.

The basis holds real rational Krylov fields of the heated ring, which serve the ring itself, and the real and imaginary
parts of its field at some frequencies w,

    (K + i w M)^-1 c,

which serve the distances: there H_r,d(i w) = H_d(i w) whatever d is. A distance is then bounded against a second
reduction, which has the copy among its ports and is itself certified at every frequency (`reduction.certified_space`):

    |H_d - H_r,d| <= |H_d - H_2,d| + max_w |H_2,d - H_r,d|

Both terms of the maximum are known sums of real poles. As functions of ln w they have features no narrower than a
decade: `SAMPLES_PER_DECADE` samples miss the maximum by less than 1e-3 of it, and `BETWEEN` allows for more.

Errors are relative to H_d(0) + `FLOOR` R_th, R_th being that of the heated ring. The rise of a ring is the sum over all
rings, and a pair whose heat hardly arrives need not be known to many digits. Far pairs do without the fast poles.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import csc_matrix
from scipy.sparse.linalg import splu

from thermofem import CrossSection, InputError, Part, Probe, StateSpace, assemble, checks
from thermofem.algebra.krylov import orthonormal, symmetric_part
from thermofem.arrays import Array, ArrayLike, NDArray
from thermofem.fem import HeatProblem
from thermofem.fem.probe_means import off_axis_points, sampled
from thermofem.geometry.cross_section import check_distance, check_uniform, footprint, reach

from .reduce import project

SAME_DISTANCE = 1e-12  # m, distances that differ by less are one


@dataclass(frozen=True, eq=False)
class Kind:
    """Rings of one geometry: their heat problem, and the part that light heats."""

    heat: HeatProblem
    part: str

    @property
    def core(self) -> Part:
        """The part that is heated and read."""
        return self.heat.geometry.part(self.part)


@dataclass(frozen=True, eq=False)
class RingKinds:
    """The kinds of rings on a chip; ``of`` [shape (N,)]: index of the kind of each ring."""

    kinds: list[Kind]
    of: NDArray[np.intp]


def rings_of(heat: Any, count: int, heated: str | None, heaters: Sequence[str]) -> RingKinds:
    """The kinds of ``count`` rings from one heat problem for all, or one for each.

    Raises InputError: no heat problems or another number of them, names that are not heated, or rings on different
        layers.
    """
    every = list(heat) if isinstance(heat, list | tuple) else [heat] * count
    checks.integer("len(heat)", len(every), count, count, hint="give one heat problem for each ring, or one for all")
    kinds: list[Kind] = []
    of = []
    for i, problem in enumerate(every):
        equal = [k for k, kind in enumerate(kinds) if _equal(kind.heat, problem)]
        if not equal:
            part = checks.choice("heated", heated, problem.heated, default=problem.heated[0])
            _check_heaters(problem, heaters, part)
            check_stack(every[0].geometry, problem.geometry, f"heat[{i}] and heat[0]")
            equal = [len(kinds)]
            kinds.append(Kind(problem, part))
        of.append(equal[0])
    return RingKinds(kinds, np.array(of))


def _equal(one: HeatProblem, other: HeatProblem) -> bool:
    return one is other or (one.geometry == other.geometry and one.accuracy == other.accuracy)


def _check_heaters(heat: HeatProblem, heaters: Sequence[str], part: str) -> None:
    names = checks.instances("heaters", (heaters,) if isinstance(heaters, str) else heaters, str)
    for name in names:
        checks.choice("heaters", name, [other for other in heat.heated if other != part])
    checks.unique("heaters", names)


def check_stack(one: CrossSection, two: CrossSection, who: str) -> None:
    """Raise InputError unless two sections have the same layers and sides; ``who`` names both."""
    differ = [w for w in ("layers", "bottom", "top", "outer", "ambient") if getattr(one, w) != getattr(two, w)]
    if not differ:
        names = [layer.name for layer in one.layers]
        differ = [f"layer {name!r}" for name in names if one.material_of(name) != two.material_of(name)]
    if differ:
        raise InputError(f"{who} differ in {differ[0]}; what lies on one chip shares its layers and sides")


def ring_positions(positions: ArrayLike) -> Array:
    """Check the centres of rings, rows (x, y) in m."""
    centres = checks.numbers("positions", positions, hint="one row (x, y) in m for each ring")
    checks.shape("positions", centres, (max(len(np.atleast_1d(centres)), 1), 2))
    return centres


def check_positions(rings: RingKinds, centres: Array) -> Array:
    """Distances of all pairs in m, shape (N, N).

    Raises InputError: rings that overlap, voids, or a domain that ends before the most distant pair.
    """
    between = np.asarray(np.linalg.norm(centres[:, None] - centres, axis=-1))
    if len(centres) == 1:
        return between
    for kind in rings.kinds:
        check_uniform(kind.heat.geometry, "positions")
    kinds = [rings.kinds[g] for g in rings.of]
    radius = np.array([footprint(kind.heat.geometry) for kind in kinds])
    touching = radius[:, None] + radius
    gap = between - touching
    np.fill_diagonal(gap, np.inf)
    i, j = np.unravel_index(gap.argmin(), gap.shape)
    if gap[i, j] < 0:
        raise InputError(
            f"positions[{i}] and positions[{j}] are {between[i, j]:g} m apart, and rings that reach "
            f"{radius[i]:g} and {radius[j]:g} m overlap below {touching[i, j]:g} m; positions are in m"
        )
    for k in np.argsort(-between, axis=None):  # the most distant pair first
        i, j = np.unravel_index(k, between.shape)
        if i != j:
            who = f"positions[{i}] and positions[{j}]"
            check_distance(kinds[i].heat.geometry, kinds[j].core, float(between[i, j]), who)
    return between


def with_copies(rings: RingKinds, g: int, readers: Sequence[tuple[int, float]]) -> tuple[HeatProblem, tuple[str, ...]]:
    """Heat problem of kind ``g`` with a probe at each reader (kind, distance in m), and the names of the probes.

    The mesh is refined around the readers. A reader of another kind counts there as a copy of kind ``g``, far enough
    out not to overlap the source, and is read over its own cross-section.
    """
    source = rings.kinds[g]
    if not readers:
        return source.heat, ()
    geometry = source.heat.geometry
    names = tuple(f"copy {k}" for k in range(1, len(readers) + 1))
    clear = (footprint(geometry) + reach(source.core)) * (1 + 1e-9)
    copies = []
    for name, (kind, distance) in zip(names, readers, strict=True):
        away = distance if kind == g else max(distance, clear)
        copies.append(Probe(name, source.part, distance=float(away)))
    heat = assemble(replace(geometry, probes=tuple(copies)), source.heat.accuracy)
    d = heat.discretization
    foreign = {}
    for name, (kind, distance) in zip(names, readers, strict=True):
        if kind != g:  # the same mesh, read over the cross-section of the other kind
            reader = rings.kinds[kind]
            probe = Probe(name, reader.part, distance=float(distance))
            points = off_axis_points(reader.heat.geometry, probe)
            total = sampled(d.basis, *points)
            foreign[name] = total / total.sum()
    if foreign:
        heat = replace(heat, discretization=replace(d, means={**d.means, **foreign}))
    return heat, names


FLOOR = 1e-2  # of R_th, added to the static gain of a pair
CHUNK = 4  # distances bounded at once: the second reduction has as many ports more
SAMPLES_PER_DECADE, BETWEEN = 60, 1.01
SHARE_OF_POLES = 0.25  # of the tolerance, for the second reduction and for the poles that are left out, each
FREQUENCIES, TIGHTEN = (3, 4, 5, 6, 8, 10, 14), 6  # tried in turn; from TIGHTEN on with more Krylov fields


@dataclass(frozen=True, eq=False)
class Pairs:
    """The reduced field of one heated part, read by its own ring and at some distances.

    rate [shape (k,), 1/s]: increasing.
    source [shape (k,)]: drive of each mode per watt.
    read [shape (1 + distances, k)]: read-out of the own ring, then at each distance; zero for fast poles left out.
    bound [shape (1 + distances,)]: of the error, relative to the static gain plus `FLOOR` of the own one.
    """

    rate: Array
    source: Array
    read: Array
    bound: Array


def reduce_pairs(heat: HeatProblem, heated: str, read: Sequence[str], tolerance: float) -> Pairs:
    """Reduce the response to one heated ring: its own temperature ``read[0]`` and those of its copies, ``read[1:]``.

    Raises InputError: the tolerance is out of reach.
    """
    system = heat.channels(heated, tuple(read))
    own = system.channel(heated, read[0])
    scale, references = _references(system, own, read, tolerance)
    for count in FREQUENCIES if len(read) > 1 else (0,):
        tighter = 0.1 if count > TIGHTEN else 1.0
        krylov = project(own, SHARE_OF_POLES * tolerance * tighter)
        V = krylov.basis
        if count:
            more = _fields_at_frequencies(system, krylov.projection.rate[0], count)
            new, *_ = orthonormal(more, system.E, V, system.E @ V, smallest=1e-16)
            V = np.column_stack([V, new])
        pairs = _projected(system, V)
        errors = []
        for reference, row in zip(references, pairs.read, strict=True):
            errors.append(reference.error + _difference(pairs.rate, pairs.source * row, reference))
        bound = np.array(errors) / scale
        if np.all(bound <= (1 - SHARE_OF_POLES) * tolerance):
            return _without_fast_poles(replace(pairs, bound=bound), scale, tolerance)
    worst = read[int(bound.argmax())]
    raise InputError(f"tolerance = {tolerance:g} is out of reach: {bound.max():.1e} is left for {worst!r}; loosen it")


def _fields_at_frequencies(system: StateSpace, slowest: float, count: int) -> Array:
    """Real and imaginary parts of the field of the heated ring at ``count`` frequencies, columns of length 1."""
    E = csc_matrix(system.E)
    A = csc_matrix(system.A)
    b = np.asarray(system.B[:, 0]) + 0j
    parts = []
    for omega in slowest * np.geomspace(0.3, 100.0, count):
        factor = splu(1j * omega * E - A, permc_spec="MMD_AT_PLUS_A")
        field = factor.solve(b)
        parts += [field.real, field.imag]
    columns = np.column_stack(parts)
    return columns / np.linalg.norm(columns, axis=0)


def _projected(system: StateSpace, V: Array) -> Pairs:
    """Project a system on an orthonormal basis, in modes; the bounds are left empty."""
    stiffness = symmetric_part(-V.T @ (system.A @ V))
    rate, Z = np.linalg.eigh(stiffness)
    modes = V @ Z
    source = modes.T @ np.asarray(system.B[:, 0])
    read = np.asarray(system.C @ modes)
    return Pairs(rate, source, read, bound=np.empty(0))


@dataclass(frozen=True, eq=False)
class ChannelReference:
    """A reduction that has the copy among its ports: poles, their residues, and the bound of its own error in K/W."""

    rate: Array
    residue: Array
    error: float


def _references(
    system: StateSpace, own: StateSpace, read: Sequence[str], tolerance: float
) -> tuple[Array, list[ChannelReference]]:
    """Reference of the relative error of each channel in K/W, and a certified second reduction of the channel."""
    references: list[ChannelReference] = []
    scales: list[float] = []
    # the own row, added in part, makes the relative errors of `project` those that are wanted here
    mixed = system.C + FLOOR * own.C
    mixed[0] = own.C[0]
    for start in range(0, len(read), CHUNK):
        rows = slice(start, start + CHUNK)
        chunk = StateSpace(system.E, system.A, system.B, mixed[rows], inputs=system.inputs, outputs=tuple(read[rows]))
        fine = project(chunk, SHARE_OF_POLES * tolerance)
        rate = fine.projection.rate
        b = fine.basis.T @ np.asarray(system.B[:, 0])
        residues = b * (system.C[rows] @ fine.basis)
        gains = b * (mixed[rows] @ fine.basis) / rate
        scales += np.abs(gains.sum(axis=1)).tolist()
        for residue, top in zip(residues, fine.certificate.top, strict=True):
            references.append(ChannelReference(rate, residue, float(top)))
    first, *others = references
    return np.array(scales), [first, *(replace(r, error=r.error + FLOOR * first.error) for r in others)]


def _difference(rate: Array, residue: Array, other: ChannelReference) -> float:
    """Largest difference, over frequency, of a sum of poles from a reference in K/W, with a margin between samples."""
    low = min(rate[0], other.rate[0]) / 1e3
    high = max(rate[-1], other.rate[-1]) * 1e3
    decades = np.log10(high / low)
    omega = np.geomspace(low, high, int(decades * SAMPLES_PER_DECADE))
    s = 1j * omega[:, None]
    response = np.sum(residue / (rate + s), axis=1)
    reference = np.sum(other.residue / (other.rate + s), axis=1)
    return BETWEEN * float(np.abs(response - reference).max())


def _without_fast_poles(pairs: Pairs, scale: Array, tolerance: float) -> Pairs:
    """Leave out the fast poles of every pair of rings that the tolerance does not need; static gains stay."""
    read = pairs.read.copy()
    bound = pairs.bound.copy()
    for k in range(1, len(read)):
        residue = pairs.source * pairs.read[k]
        whole = ChannelReference(pairs.rate, residue, 0.0)
        most = min(SHARE_OF_POLES * tolerance, tolerance - bound[k])
        for count in range(1, pairs.rate.size):
            slow = pairs.rate[:count]
            fewer = residue[:count].copy()
            static = np.sum(residue[count:] / pairs.rate[count:])  # gain of the fast poles
            fewer[-1] += slow[-1] * static
            error = _difference(slow, fewer, whole) / scale[k]
            if error <= most:
                read[k] = 0.0
                read[k, :count] = fewer / pairs.source[:count]
                bound[k] += error
                break
    return replace(pairs, read=read, bound=bound)
