"""A curve of folds of cycles in two parameters.

Cycles with two free parameters form a surface. It folds over the plane of the parameters q where its tangent plane W
does not cover it:

    g = det (dq/dW) = 0,    W: directions in which the cycle equations stay solved, V W = 1 for two fixed rows V

One row of V points along the curve, the other across. Each step of Newton's method on the cycle equations also takes a
step of the secant method on g across the curve.

Source: Kuznetsov, Elements of Applied Bifurcation Theory (2004), Section 10.3 (curves of codimension one).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from thermofem.arrays import Array

from .hopf_points import relative_range
from .multiple_shooting import (
    CLOSE_ENOUGH,
    Family,
    Place,
    linearised,
    moved_along,
    newton,
    on_good_nodes,
    place_of,
    position,
)

FIRST, LONGEST, SHORTEST = 0.01, 0.06, 1e-5  # steps, in units of `multiple_shooting.weights`
TURN = 0.8  # of the largest values, what the nodes may change in a step
MOST_STEPS = 12  # of Newton's method
SMALLEST = 0.03  # relative range of the carriers, where a curve ends on a Hopf curve
SLOWEST = 30.0  # times the shortest period
CLOSED = 1e-3  # a step of Newton's method from which on g counts
SECANT = 1e-7  # smallest distance of two points of the secant method; between nearer ones g differs by round-off
ON_IT = 1e-6  # distance from the fold in these units: the parameters are off by its square


class _Frame(NamedTuple):
    """A fold: the cycle, unit vectors along the curve and across it, and dg by the distance across."""

    place: Place
    along: Array
    across: Array
    slope: float


def follow_folds(
    family: Callable[[Array], Family], start: Place, across: Array, sign: float,
    inside: Callable[[Array], bool], most: int,
) -> tuple[list[Place], str]:  # fmt: skip
    """Return folds from ``start`` on, and why the curve ends.

    ``family`` gives the units of the parameters at their values; ``start`` is a fold whose cycles lie to both sides
    ``across``, in the units of `weights`; ``inside`` says whether values are still wanted.
    """
    here = family(start.values)
    frame = _framed(start, None, across)
    frame = frame._replace(along=sign * frame.along)
    out, step, shortest = [start], FIRST, start.orbit.T
    while len(out) < most:
        step = min(step, _longest(frame))
        found = _next(here, frame, step)
        if found is None:
            step /= 3
            if step < SHORTEST:
                return out, "Newton's method finds no next fold"
            continue
        place, slope, steps = found
        after = family(place.values)
        chord = (position(place.nodes) - position(frame.place.nodes)) * place.unit
        new = _framed(place, chord, frame.across)
        good = on_good_nodes(after, place, np.stack([new.along, new.across]))
        if good is None:
            return out, "its nodes cannot be placed"
        along, across = np.linalg.norm(good[1], axis=1)  # units of the distances from another node
        here, frame = after, _framed(good[0], *good[1])._replace(slope=slope / (along * across**2))
        out.append(place)
        shortest = min(shortest, place.orbit.T)
        if not inside(place.values):
            return out, "the end of the range"
        if relative_range(here, place) < SMALLEST:
            return out, "a Hopf curve"
        if SLOWEST * shortest < place.orbit.T:
            return out, "the period grows without bound"
        step *= 1.4 if steps <= 6 else 0.7 if steps >= 9 else 1.0
    return out, "the number of points"


def _framed(place: Place, along: Array | None, across: Array) -> _Frame:
    """Orthonormal directions in the tangent plane: across the curve, and along it."""
    plane = place.directions * place.unit
    q, _ = np.linalg.qr(plane.T)
    if along is None:
        n = q @ (q.T @ across)
        n /= np.linalg.norm(n)
        t = q[:, 0] - n * (n @ q[:, 0])
        t = t if np.linalg.norm(t) > 0.1 else q[:, 1] - n * (n @ q[:, 1])
        return _Frame(place, t / np.linalg.norm(t), n, 0.0)
    t = q @ (q.T @ along)
    t /= np.linalg.norm(t)
    n = q @ (q.T @ across)
    n -= t * (t @ n)
    return _Frame(place, t, n / np.linalg.norm(n), 0.0)


def _longest(frame: _Frame) -> float:
    """The step in which no node changes by more than `TURN`."""
    moved = frame.place.moved(_coefficients(frame.place, frame.along))
    return min(LONGEST, TURN / max(moved, 1e-12))


def _coefficients(place: Place, direction: Array) -> Array:
    """A direction in the tangent plane by the directions of a place."""
    return np.asarray(np.linalg.lstsq((place.directions * place.unit).T, direction, rcond=None)[0])


def _next(family: Family, frame: _Frame, step: float) -> tuple[Place, float, int] | None:
    """The fold a ``step`` along the curve, dg by the distance across, and how many steps it took."""
    place, unit, n = frame.place, frame.place.unit, frame.place.orbit.start.size
    rows = np.stack([frame.along, frame.across])
    by, slope = step * _coefficients(place, frame.along), frame.slope
    nodes = moved_along(place.nodes, by, place.directions, place.moves)
    begin = position(nodes)
    last: tuple[float, float] | None = None
    for k in range(MOST_STEPS):
        ahead, b = rows @ (unit * (position(nodes) - begin))
        known = linearised(family, nodes)
        found = known and newton(nodes, known, rows, np.array([-ahead, 0.0]), unit)
        if not known or not found or not found.size < 0.5:
            return None
        off = 0.0
        if found.size < CLOSED:
            g = float(np.linalg.det(found.directions[:, n + 1 :] * unit[n + 1 :]))
            if last is not None and abs(b - last[0]) > SECANT:
                slope = (g - last[1]) / (b - last[0])
            last = (float(b), g)
            off = -g / slope if slope != 0.0 else 0.1 * step
        if not abs(off) < 3 * step:
            return None
        off = off if abs(off) > ON_IT else 0.0
        if k > 0 and found.size <= CLOSE_ENOUGH and off == 0:
            return place_of(family, nodes, known, found, k + 1), slope, k + 1
        nodes = moved_along(found.nodes, np.array([0.0, off]), found.directions, found.moves)
        if not nodes.h.min() > 0:
            return None
    return None
