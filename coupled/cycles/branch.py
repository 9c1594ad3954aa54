"""A branch of cycles, followed by its length: around its folds, with what changes its stability located on it.

    fold of cycles: d(parameter)/d(length) = 0,     period doubling: prod (1 + mu_i) = 0,
    torus: prod_(i<j) (1 - mu_i mu_j) = 0 with a pair of complex mu,     mu: the multipliers but the trivial one

Source: Kuznetsov, Elements of Applied Bifurcation Theory (2004), Sections 10.2 and 10.3.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from thermofem.arrays import Array

from .closing import nontrivial
from .hopf_end import hopf_near
from .path import FreeParameters, Place, on_a_good_mesh, predicted, weights

FIRST, LONGEST, SHORTEST = 0.01, 0.1, 1e-7  # steps, in the units of `path.weights`
TURN = 0.3  # of the largest values, what the stages may change in a step
EASY, HARD = 3, 5  # steps of Newton's method
SMALL = 0.05  # relative range of the carriers where a branch that shrinks ends in a Hopf point
SLOWEST = 30.0  # times the shortest period of the branch, where it runs into a saddle
AT = 1e-3  # largest distance of the multiplier of a bifurcation from -1 or from the unit circle
VERTICAL = 1e-5  # of the range, or of the parameter: folds so near each other are those of an error
HOPF = "Hopf"
KINDS = ("fold", "period doubling", "torus")


class Found(NamedTuple):
    """A cycle of a branch and its kind of bifurcation: one of `KINDS`, `HOPF`, or "" for none."""

    place: Place
    kind: str


def follow(
    family: FreeParameters, start: Place, direction: float, low: float, high: float, most: int
) -> tuple[list[Found], str]:
    """Return the cycles from ``start`` on, the parameter going in ``direction`` at first, and why the branch ends."""
    tangent = _unit(family, start, start.directions[0] * np.sign(direction * start.directions[0, -1]))
    return follow_along(family, start, tangent, low, high, most)


def follow_along(
    family: FreeParameters,
    start: Place,
    tangent: Array,
    low: float,
    high: float,
    most: int,
    kinds: Collection[str] = KINDS,
) -> tuple[list[Found], str]:
    """`follow` with the tangent given, in the units of `weights`, and the ``kinds`` of special cycles to locate."""
    place, step = start, FIRST
    out, shortest = [Found(start, "")], start.orbit.T
    while len(out) < most:
        step = min(step, _longest(family, place))
        ahead = _ahead(family, place, tangent, step)
        if ahead is None:
            step /= 3
            if step < SHORTEST:
                return out, "Newton's method finds no next cycle"
            continue
        after = _unit(family, ahead, ahead.directions[0])
        if after @ _unit(family, place, _raw(family, place, tangent)) < 0.8 and step > 1e-4:
            step /= 2
            continue
        if _mirrored(family, place, ahead) and (end := hopf_near(family, min(place, ahead, key=relative_range))):
            return [*out, Found(end, HOPF)], "a Hopf point"
        special = _between(family, place, ahead, tangent, step, kinds)
        if (last := _fold_beside(out, special, high - low)) is not None:
            return out[:last], "the branch turns vertical: its folds are as near each other as its error"
        out += special
        value = float(ahead.values[0])
        if not low <= value <= high:
            border = low if value < low else high
            ends = _located(family, place, tangent, step, partial(_beyond, border))
            return [*out, *([Found(ends, "")] if ends else [])], "the end of the range"
        finer = on_a_good_mesh(family, ahead, after[None])
        if finer is None:
            return out, "the mesh cannot be refined"
        shrinks = relative_range(finer) < relative_range(place)
        place, tangent = finer, _unit(family, finer, finer.directions[0])
        out.append(Found(place, ""))
        shortest = min(shortest, place.orbit.T)
        if shrinks and relative_range(place) < SMALL and (end := hopf_near(family, place)):
            return [*out, Found(end, HOPF)], "a Hopf point"
        if SLOWEST * shortest < place.orbit.T:
            return out, "the period grows without bound"
        step *= 1.6 if ahead.steps <= EASY else 0.6 if ahead.steps >= HARD else 1.0
    return out, "the number of points"


def _fold_beside(out: list[Found], special: list[Found], span: float) -> int | None:
    """Index of the last fold in ``out`` if the next one is within `VERTICAL` of it; None if there is none or it is not.

    At the end of a canard explosion the period grows while the parameter stays, and the error of the cycles decides
    where the branch seems to turn.
    """
    folds = [k for k, found in enumerate(out) if found.kind == "fold"]
    following = [float(found.place.values[0]) for found in special if found.kind == "fold"]
    if not folds or not following:
        return None
    before = float(out[folds[-1]].place.values[0])
    return folds[-1] if abs(following[0] - before) < VERTICAL * max(span, abs(before)) else None


def outwards(family: FreeParameters, place: Place, direction: Array) -> Array:
    """The tangent at a place, in the units of `weights`, that goes with a ``direction``."""
    unit = weights(family, place.orbit)
    tangent = _unit(family, place, place.directions[0])
    return np.asarray(tangent * np.sign(tangent @ (direction * unit)))


def relative_range(place: Place) -> float:
    """Largest less smallest of the carriers, over the largest."""
    N = place.orbit.Y[:, :, 2]
    return float(np.ptp(N) / N.max())


def _mirrored(family: FreeParameters, place: Place, ahead: Place) -> bool:
    """Whether a step led through a Hopf point, behind which the same cycles begin half a period later."""
    unit = weights(family, place.orbit)[: place.orbit.start.size]
    one, other = (unit * (q.orbit.start - _mean(q)) for q in (place, ahead))
    return bool(max(relative_range(place), relative_range(ahead)) < 0.5 and one @ other < 0)


def _mean(place: Place) -> Array:
    """The mean state at the ends of the intervals."""
    return np.asarray((np.diff(place.orbit.tau)[:, None] * place.orbit.Y[:, -1]).sum(axis=0))


def _beyond(border: float, place: Place) -> float:
    """Signed distance of the parameter beyond a border."""
    return float(place.values[0]) - border


def doubling(place: Place) -> float:
    """Zero where a multiplier is -1."""
    return float(np.prod(1 + nontrivial(place.orbit)).real)


def torus(place: Place) -> float:
    """Zero where the product of two multipliers is 1."""
    mu = nontrivial(place.orbit)
    i, j = np.triu_indices(mu.size, 1)
    return float(np.prod(1 - mu[i] * mu[j]).real)


def _unit(family: FreeParameters, place: Place, direction: Array) -> Array:
    """A direction in the units of `weights`, of length 1."""
    scaled = direction * weights(family, place.orbit)
    return np.asarray(scaled / np.linalg.norm(scaled))


def _raw(family: FreeParameters, place: Place, tangent: Array) -> Array:
    return np.asarray(tangent / weights(family, place.orbit))


def _longest(family: FreeParameters, place: Place) -> float:
    """The step in which no stage changes by more than `TURN`."""
    from ..kernels import orbit_mesh, orbits

    length = float(np.linalg.norm(place.directions[0] * weights(family, place.orbit)))
    moved = orbits.moved(place.stages[0], orbit_mesh.sizes(place.orbit.Y, family.base.at.thermal)) / length
    return min(LONGEST, TURN / max(moved, 1e-12))


def _ahead(family: FreeParameters, place: Place, tangent: Array, step: float) -> Place | None:
    """The cycle a ``step`` along the tangent."""
    per_length = place.directions[0] * weights(family, place.orbit) @ tangent
    found = predicted(family, place, np.array([step / per_length]), tangent[None])
    return found[0] if found else None


def _between(
    family: FreeParameters, place: Place, ahead: Place, tangent: Array, step: float, kinds: Collection[str]
) -> list[Found]:
    """Bifurcations between two cycles, in order."""

    def fold(q: Place) -> float:
        unit = weights(family, q.orbit)
        return float(_unit(family, q, q.directions[0])[-1] * np.sign((q.directions[0] * unit) @ tangent))

    out = []
    for kind, test in zip(KINDS, (fold, doubling, torus), strict=True):
        if kind in kinds and test(place) * test(ahead) < 0:
            found = _located(family, place, tangent, step, test)
            if found is not None and _is_there(kind, found):
                out.append(Found(found, kind))
    return sorted(out, key=lambda f: _distance(family, place, f.place, tangent))


def _located(
    family: FreeParameters, place: Place, tangent: Array, step: float, test: Callable[[Place], float]
) -> Place | None:
    """The cycle within a step where ``test`` vanishes; lengths to 1e-9, by Brent's method."""
    seen: dict[float, Place] = {0.0: place}

    def at(s: float) -> float:
        if s not in seen:
            found = _ahead(family, place, tangent, s)
            if found is None:
                raise ArithmeticError
            seen[s] = found
        return test(seen[s])

    try:
        return seen[float(brentq(at, 0.0, step, xtol=1e-10, rtol=1e-12))]
    except (ArithmeticError, ValueError):
        return None


def _is_there(kind: str, place: Place) -> bool:
    """Whether a multiplier is where a change of sign says that it is.

    Near a saddle a multiplier can pass through infinity; the sign changes then, too.
    """
    mu = nontrivial(place.orbit)
    if kind == "period doubling":
        return bool(np.abs(1 + mu).min() < AT)
    if kind == "torus":  # a complex pair whose product is 1
        return bool(np.any((np.abs(np.abs(mu) - 1) < AT) & (np.abs(mu.imag) > AT)))
    return True


def _distance(family: FreeParameters, place: Place, other: Place, tangent: Array) -> float:
    change = np.concatenate([other.orbit.start - place.orbit.start, [other.orbit.T - place.orbit.T],
                             other.values - place.values])  # fmt: skip
    return float((change * weights(family, place.orbit)) @ tangent)
