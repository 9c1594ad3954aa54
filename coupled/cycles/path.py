"""Cycles with free parameters: where a tangent plane of them leads, corrected by Newton's method.

With x = (y_0, T, q) in units of the largest values, of the period and of the ranges of the parameters, and rows V:

    cycle equations (x) = 0,   V (x - x_p) = c;       directions W: the equations stay solved along them, V W = 1

V has as many rows as there are parameters. A branch has one, its tangent; a curve of folds has two.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from thermofem.arrays import Array

from .orbit import CLOSE_ENOUGH, POLYNOMIAL, SLACK, CycleProblem, Orbit, remeshed
from .parameters import changed, slope, value_of
from .scheme import scheme

MOST_STEPS = 7  # of Newton's method
FARTHEST = 0.5  # of the largest values, the first of them


class FreeParameters(NamedTuple):
    """A ring whose named numbers are free, and the ranges in whose units they are measured."""

    base: CycleProblem
    names: tuple[str, ...]
    ranges: Array  # in SI

    def at(self, values: Array) -> CycleProblem:
        """The ring with other values, in SI."""
        p = self.base
        for name, value in zip(self.names, values, strict=True):
            p = changed(p, name, float(value))
        return p


class Place(NamedTuple):
    """A cycle of a family and the directions in which cycles lie beside it."""

    orbit: Orbit
    values: Array  # of the parameters, shape (q,), in SI
    directions: Array  # shape (q, m + 1 + q)
    stages: Array  # changes of the stages along them, shape (q, N, s, m)
    steps: int  # of Newton's method that led here


def weights(family: FreeParameters, orbit: Orbit) -> Array:
    """The factors that make the unknowns (y_0, T, q) comparable."""
    from ..kernels import orbit_mesh

    size = orbit_mesh.sizes(orbit.Y, family.base.at.thermal)
    m = orbit.start.size
    own = size[np.clip(np.arange(m) - 1, 0, 2)]
    return np.concatenate([1 / own, [1 / orbit.T], 1 / family.ranges])


def predicted(family: FreeParameters, place: Place, along: Array, rows: Array) -> tuple[Place, Array] | None:
    """Correct the prediction ``along`` (coefficients of the directions, shape (q,)) on the plane of ``rows``."""
    unit = weights(family, place.orbit)
    move = along @ place.directions
    m = place.orbit.start.size
    orbit = place.orbit._replace(
        start=place.orbit.start + move[:m],
        T=place.orbit.T + float(move[m]),
        Y=place.orbit.Y + np.tensordot(along, place.stages, axes=1),
    )
    return corrected(family, orbit, place.values + move[m + 1 :], rows, unit)


def corrected(
    family: FreeParameters, orbit: Orbit, values: Array, rows: Array, unit: Array, tolerance: float = CLOSE_ENOUGH
) -> tuple[Place, Array] | None:
    """Close a trial orbit with rows . (x - trial) = 0; return it, its return map with columns, or None."""
    x = np.concatenate([orbit.start, [orbit.T], values])
    begin, m = x, orbit.start.size
    Y, best = orbit.Y, np.inf
    for k in range(MOST_STEPS):
        found = one_step(family, Orbit(x[:m], Y, orbit.tau, float(x[m]), orbit.M, 0.0), x[m + 1 :], rows, unit,
                         -(rows * unit) @ (x - begin))  # fmt: skip
        if found is None:
            return None
        change, stages, directions, sides, M, move = found
        if not move < min(FARTHEST, 2 * best):
            return None
        x, Y, best = x + change, Y + stages, move
        if not x[m] > 0:
            return None
        if move <= tolerance:
            near = Orbit(x[:m], Y, orbit.tau, float(x[m]), np.ascontiguousarray(M[:, :m]), move)
            return Place(near, x[m + 1 :], directions, sides, k + 1), M
    return None


def one_step(family: FreeParameters, orbit: Orbit, values: Array, rows: Array, unit: Array, target: Array):  # type: ignore[no-untyped-def]
    """One step of Newton's method to V dx = ``target``, and the directions W; None where there is no step."""
    from ..kernels import orbit_mesh, orbits

    q, m = values.size, orbit.start.size
    try:
        p = family.at(values)
    except ValueError:  # out of the range of the parameter
        return None
    states = orbit.Y.reshape(-1, m)
    forcing = np.stack([slope(p, name, states) for name in family.names], axis=-1).reshape(*orbit.Y.shape, q)
    phase = orbits.phase(orbit.start, p.at, orbit_mesh.sizes(orbit.Y, p.at.thermal), m + 1 + q)
    right = np.zeros((1 + q, 1 + q))
    right[1:, 0], right[1:, 1:] = target, np.eye(q)
    Y = orbit.Y.copy()  # heat between the ends is computed there
    changes, stages, M, move = orbits.advance(
        orbit.start, Y, orbit.tau, orbit.T, p.at, scheme(), forcing, np.concatenate([phase, rows * unit]), right
    )
    if not move < np.inf:
        return None
    return changes[0], Y - orbit.Y + stages[0], changes[1:], stages[1:], M, move


def on_a_good_mesh(family: FreeParameters, place: Place, rows: Array) -> Place | None:
    """The cycle on a mesh that is fine enough, and not much finer."""
    unit = POLYNOMIAL ** (1 / (scheme().c.size + 1))
    for _ in range(4):
        finer, worst, wanted = remeshed(place.orbit, family.base.at.thermal, POLYNOMIAL)
        own = place.orbit.tau.size - 1
        if worst <= SLACK ** (1 / (scheme().c.size + 1)) * unit and own <= 1.5 * wanted:
            return place
        found = corrected(family, finer, place.values, rows, weights(family, place.orbit))
        if found is None:
            return None
        place = found[0]
    return place


def first_place(family: FreeParameters, orbit: Orbit) -> Place | None:
    """A closed orbit as a place of the family, with its parameters held."""
    m, q = orbit.start.size, len(family.names)
    values = np.array([value_of(family.base, name) for name in family.names])
    found = corrected(family, orbit, values, np.eye(m + 1 + q)[m + 1 :], weights(family, orbit))
    return found[0] if found else None
