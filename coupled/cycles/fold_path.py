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

from .branch import relative_range
from .orbit import CLOSE_ENOUGH, Orbit
from .path import FreeParameters, Place, on_a_good_mesh, one_step, weights

FIRST, LONGEST, SHORTEST = 0.01, 0.06, 1e-5  # steps, in units of `path.weights`
TURN = 0.8  # of the largest values, what the stages may change in a step
MOST_STEPS = 10  # of Newton's method
SMALLEST = 0.03  # relative range of the carriers, where a curve ends on a Hopf curve
SLOWEST = 30.0  # times the shortest period
SECANT = 1e-5  # smallest distance of two points of the secant method; between nearer ones g differs by round-off
ON_IT = 1e-6  # distance from the fold in the units of `path.weights`: its square is what the parameters are off


class _Frame(NamedTuple):
    """A fold: the cycle, unit vectors along the curve and across it, and dg by the distance across."""

    place: Place
    along: Array
    across: Array
    slope: float


def follow_folds(
    family: Callable[[Array], FreeParameters], start: Place, across: Array, sign: float,
    inside: Callable[[Array], bool], most: int,
) -> tuple[list[Place], str]:  # fmt: skip
    """Return folds from ``start`` on, and why the curve ends.

    ``family`` gives the units of the parameters at their values; ``start`` is a fold whose cycles lie to both sides
    ``across``, in the units of `weights`; ``inside`` says whether values are still wanted.
    """
    here = family(start.values)
    frame = _framed(here, start, None, across)
    frame = frame._replace(along=sign * frame.along)
    out, step, shortest = [start], FIRST, start.orbit.T
    while len(out) < most:
        step = min(step, _longest(here, frame))
        found = _next(here, frame, step)
        if found is None:
            step /= 3
            if step < SHORTEST:
                return out, "Newton's method finds no next fold"
            continue
        place, slope, steps = found
        after = family(place.values)
        new = _framed(after, place, frame.along, frame.across)._replace(slope=slope)
        finer = on_a_good_mesh(after, place, np.stack([new.along, new.across]))
        if finer is None:
            return out, "the mesh cannot be refined"
        here, frame = after, new._replace(place=finer)
        out.append(place)
        shortest = min(shortest, place.orbit.T)
        if not inside(place.values):
            return out, "the end of the range"
        if relative_range(place) < SMALLEST:
            return out, "a Hopf curve"
        if SLOWEST * shortest < place.orbit.T:
            return out, "the period grows without bound"
        step *= 1.4 if steps <= 6 else 0.7 if steps >= 8 else 1.0
    return out, "the number of points"


def _framed(family: FreeParameters, place: Place, along: Array | None, across: Array) -> _Frame:
    """Orthonormal directions in the tangent plane: across the curve, and along it."""
    plane = place.directions * weights(family, place.orbit)
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


def _longest(family: FreeParameters, frame: _Frame) -> float:
    """The step in which no stage changes by more than `TURN`."""
    from ..kernels import orbit_mesh, orbits

    change = np.tensordot(_coefficients(family, frame.place, frame.along), frame.place.stages, axes=1)
    size = orbit_mesh.sizes(frame.place.orbit.Y, family.base.at.thermal)
    return float(min(LONGEST, TURN / max(orbits.moved(change, size), 1e-12)))


def _coefficients(family: FreeParameters, place: Place, direction: Array) -> Array:
    """A direction in the tangent plane by the directions of a place."""
    plane = place.directions * weights(family, place.orbit)
    return np.asarray(np.linalg.lstsq(plane.T, direction, rcond=None)[0])


def _next(family: FreeParameters, frame: _Frame, step: float) -> tuple[Place, float, int] | None:
    """The fold a ``step`` along the curve, dg by the distance across, and how many steps it took."""
    place, unit, m = frame.place, weights(family, frame.place.orbit), frame.place.orbit.start.size
    rows = np.stack([frame.along, frame.across])
    by = step * _coefficients(family, place, frame.along)
    move = by @ place.directions
    begin = np.concatenate([place.orbit.start, [place.orbit.T], place.values]) + move
    x, Y, slope = begin, place.orbit.Y + np.tensordot(by, place.stages, axes=1), frame.slope
    last: tuple[float, float] | None = None
    for k in range(MOST_STEPS):
        orbit = Orbit(x[:m], Y, place.orbit.tau, float(x[m]), place.orbit.M, 0.0)
        ahead, b = rows @ (unit * (x - begin))
        found = one_step(family, orbit, x[m + 1 :], rows, unit, np.array([-ahead, 0.0]))
        if found is None:
            return None
        change, stages, directions, sides, M, shift = found
        g = float(np.linalg.det(directions[:, m + 1 :] * unit[m + 1 :]))
        if last is not None and abs(b - last[0]) > SECANT:
            slope = (g - last[1]) / (b - last[0])
        last = (float(b), g)
        off = -g / slope if slope != 0.0 else 0.1 * step
        if not shift < 0.5 or not abs(off) < 3 * step:
            return None
        x, Y = x + change + off * directions[1], Y + stages + off * sides[1]
        if not x[m] > 0:
            return None
        if k > 0 and shift <= CLOSE_ENOUGH and abs(off) <= ON_IT:
            near = Orbit(x[:m], Y, place.orbit.tau, float(x[m]), np.ascontiguousarray(M[:, :m]), shift)
            return Place(near, x[m + 1 :], directions, sides, k + 1), slope, k + 1
    return None
