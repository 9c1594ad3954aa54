"""Rings on one chip: their kinds and positions, checked, and the fields of each kind read where the others are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from thermofem import InputError, Part, Probe, assemble, checks
from thermofem.arrays import Array, ArrayLike, NDArray
from thermofem.fem import HeatProblem
from thermofem.fem.probe_means import off_axis_integral
from thermofem.geometry.off_axis_copies import check_distance, check_uniform, footprint, reach

MOST = 1000  # rings
SAME = 1e-12  # m, distances that differ by less are one


@dataclass(frozen=True, eq=False)
class Kind:
    """Rings of one geometry: their heat problem, and the part that light heats."""

    heat: HeatProblem
    part: str

    @property
    def core(self) -> Part:
        """The part that is heated and read."""
        return next(part for part in self.heat.geometry.parts if part.name == self.part)


@dataclass(frozen=True, eq=False)
class RingKinds:
    """Kinds of rings, and which one each ring is of, shape (N,)."""

    kinds: list[Kind]
    of: NDArray[np.intp]


def rings_of(heat: Any, count: int, heated: str | None, heaters: Sequence[str]) -> RingKinds:
    """The kinds of ``count`` rings from one heat problem for all, or one for each.

    Raises InputError: no heat problems or another number of them, names that are not heated, or rings on different
        layers.
    """
    every = list(heat) if isinstance(heat, list | tuple) else [heat] * count
    if len(every) != count:
        raise InputError(
            f"heat holds {len(every)} heat problems and positions {count} rings; give one for each, or one"
        )
    kinds: list[Kind] = []
    of = np.empty(count, dtype=np.intp)
    for i, one in enumerate(every):
        checks.has(
            "heat", one, "discretization", "geometry", hint="th.assemble(geometry) makes the HeatProblem of one ring"
        )
        known = next((k for k, kind in enumerate(kinds) if _equal(kind.heat, one)), None)
        if known is None:
            part = one.heated[0] if heated is None else checks.choice("heated", heated, one.heated)
            _check_heaters(one, heaters, part)
            kinds.append(Kind(one, part))
            _check_stack(kinds[0].heat, one, i)
            known = len(kinds) - 1
        of[i] = known
    return RingKinds(kinds, of)


def _equal(one: HeatProblem, other: HeatProblem) -> bool:
    return one is other or (one.geometry == other.geometry and one.accuracy == other.accuracy)


def _check_heaters(heat: HeatProblem, heaters: Sequence[str], part: str) -> None:
    names = checks.instances("heaters", (heaters,) if isinstance(heaters, str) else heaters, str)
    for name in names:
        checks.choice("heaters", name, [other for other in heat.heated if other != part])
    checks.unique("heaters", names)


def _check_stack(first: HeatProblem, other: HeatProblem, i: int) -> None:
    """Raise InputError unless two rings lie on the same layers."""
    one, two = first.geometry, other.geometry
    differ = [w for w in ("layers", "bottom", "top", "outer", "ambient") if getattr(one, w) != getattr(two, w)]
    same = () if differ else one.layers
    differ += [f"layer {at.name!r}" for at in same if one.material_of(at.name) != two.material_of(at.name)]
    if differ:
        raise InputError(f"heat[{i}] and heat[0] differ in {differ[0]}; rings on one chip share its layers and sides")


def ring_positions(positions: ArrayLike) -> Array:
    """Check the centres of rings, rows (x, y) in m."""
    centres = checks.numbers("positions", positions, hint="one row (x, y) in m for each ring")
    if centres.ndim != 2 or centres.shape[1] != 2 or not 1 <= len(centres) <= MOST:
        raise InputError(f"positions has shape {centres.shape}; (N, 2) is needed, x and y in m of 1 to {MOST} rings")
    return centres


def check_positions(rings: RingKinds, centres: Array) -> Array:
    """Distances of all pairs in m, shape (N, N).

    Raises InputError: rings that overlap, voids, or a domain that ends before the most distant pair.
    """
    between = np.linalg.norm(centres[:, None] - centres, axis=-1)
    if len(centres) == 1:
        return between
    for kind in rings.kinds:
        check_uniform(kind.heat.geometry, "positions")
    radius = np.array([footprint(rings.kinds[g].heat.geometry) for g in rings.of])
    gap = between - radius[:, None] - radius + np.where(np.eye(len(centres)), np.inf, 0)
    i, j = np.unravel_index(np.argmin(gap), gap.shape)
    if gap[i, j] < 0:
        raise InputError(
            f"positions[{i}] and positions[{j}] are {between[i, j]:g} m apart, and rings that reach "
            f"{radius[i]:g} and {radius[j]:g} m overlap below {radius[i] + radius[j]:g} m; positions are in m"
        )
    for g, kind in enumerate(rings.kinds):
        for other, reader in enumerate(rings.kinds):
            pairs = np.where(np.outer(rings.of == g, rings.of == other) & ~np.eye(len(centres), dtype=bool), between, 0)
            i, j = np.unravel_index(np.argmax(pairs), pairs.shape)
            if pairs[i, j] > 0:
                who = f"positions[{i}] and positions[{j}]"
                check_distance(kind.heat.geometry, reader.core, float(pairs[i, j]), who)
    return np.asarray(between)


def with_copies(rings: RingKinds, g: int, readers: Sequence[tuple[int, float]]) -> tuple[HeatProblem, tuple[str, ...]]:
    """The heat problem of one kind with copies of readers, (kind, distance in m), on a mesh that resolves them.

    Of a reader of another kind a copy of the own part refines the mesh: one that is larger stands where it would just
    be clear of the source, and covers the place of the reader.
    """
    own = rings.kinds[g]
    if not readers:
        return own.heat, ()
    names = tuple(f"copy {k + 1}" for k in range(len(readers)))
    clear = (footprint(own.heat.geometry) + reach(own.core)) * (1 + 1e-9)
    distances = [d if kind == g else max(d, clear) for kind, d in readers]
    copies = [Probe(name, own.part, distance=float(d)) for name, d in zip(names, distances, strict=True)]
    solved = assemble(replace(own.heat.geometry, probes=tuple(copies)), own.heat.accuracy)
    d, foreign = solved.discretization, {}
    for name, (kind, distance) in zip(names, readers, strict=True):
        if kind != g:  # the same mesh, read over the cross-section of the other kind
            reader = rings.kinds[kind]
            probe = Probe(name, reader.part, distance=float(distance))
            total = off_axis_integral(reader.heat.geometry, d.basis, probe)
            foreign[name] = total / total.sum()
    if foreign:
        solved = replace(solved, discretization=replace(d, means={**d.means, **foreign}))
    return solved, names
