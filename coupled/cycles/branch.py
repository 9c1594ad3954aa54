"""A branch of cycles, followed by its length: around its folds, with what changes its stability located on it.

    fold of cycles: d(parameter)/d(length) = 0,     period doubling: prod (1 + mu_i) = 0,
    torus: prod_(i<j) (1 - mu_i mu_j) = 0 with a pair of complex mu,     mu: the multipliers but the trivial one

Source: Kuznetsov, Elements of Applied Bifurcation Theory (2004), Sections 10.2 and 10.3.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq

from thermofem.arrays import Array
from thermofem.checks import InputError

from ..heaters import turned_by
from .cycle_problem import CycleProblem
from .hopf_points import FAINT, born, hopf_near, laser_of, relative_range
from .multiple_shooting import COARSE, Family, Place, first_place, on_good_nodes, position, predicted
from .orbit_measures import time_weights
from .parameters import LASER
from .return_map import FINE, Orbit

FIRST, LONGEST, SHORTEST = 0.01, 0.1, 1e-7  # steps, in the units of `multiple_shooting.weights`
TURN = 0.3  # of the largest values, what the nodes may change in a step
EASY, HARD = 3, 5  # steps of Newton's method
SMALL = 0.05  # relative range of the carriers where a branch that shrinks ends in a Hopf point
SLOWEST = 30.0  # times the shortest period of the branch, where it runs into a saddle
AT = 1e-3  # largest distance of the multiplier of a bifurcation from -1 or from the unit circle
REPELLED = 1e10  # multiplier at which the parameter of a canard stays while the cycle changes
VERTICAL = 1e-5  # of the range, or of the parameter: folds so near each other are those of an error
MOST = 400  # cycles of the branch from a Hopf point to a laser
HOPF = "Hopf"
KINDS = ("fold", "period doubling", "torus")


class Found(NamedTuple):
    """A cycle of a branch and its kind of bifurcation: one of `KINDS`, `HOPF`, or "" for none."""

    place: Place
    kind: str


def follow(
    family: Family, start: Place, direction: float, low: float, high: float, most: int
) -> tuple[list[Found], str]:
    """Return the cycles from ``start`` on, the parameter going in ``direction`` at first, and why the branch ends."""
    tangent = _unit(start, start.directions[0] * np.sign(direction * start.directions[0, -1]))
    return follow_along(family, start, tangent, low, high, most)


def follow_along(
    family: Family,
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
        step = min(step, _longest(place))
        ahead = _ahead(family, place, tangent, step)
        if ahead is None:
            step /= 2
            if step < SHORTEST:
                return out, "Newton's method finds no next cycle"
            continue
        after = _unit(ahead, ahead.directions[0])
        if after @ tangent < 0.8 and step > 1e-4:
            step /= 2
            continue
        if _mirrored(family, place, ahead):
            end = hopf_near(family, min(place, ahead, key=partial(relative_range, family)))
            if end is not None:
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
        good = on_good_nodes(family, ahead, after[None])
        if good is None:
            return out, "its nodes cannot be placed"
        finer = good[0]
        shrinks = relative_range(family, finer) < relative_range(family, place)
        place, tangent = finer, _unit(finer, finer.directions[0])
        out.append(Found(place, ""))
        shortest = min(shortest, place.orbit.T)
        if shrinks and relative_range(family, place) < SMALL and (end := hopf_near(family, place)):
            return [*out, Found(end, HOPF)], "a Hopf point"
        if place.orbit.size > REPELLED:
            return out, f"the branch turns vertical: a deviation grows by {place.orbit.size:.1g} in a period"
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


def _mirrored(family: Family, place: Place, ahead: Place) -> bool:
    """Whether a step led through a Hopf point, behind which the same cycles begin half a period later."""
    small = max(relative_range(family, place), relative_range(family, ahead)) < 0.5
    return small and float(_off_centre(place) @ _off_centre(ahead)) < 0


def _off_centre(place: Place) -> Array:
    """How far the start is from the mean of field, carriers and temperature, of their largest values."""
    rows = place.orbit.trace.rows[:, 1:]
    return np.asarray((rows[0] - time_weights(place.orbit) @ rows / place.orbit.T) / np.abs(rows).max(axis=0))


def _beyond(border: float, place: Place) -> float:
    """Signed distance of the parameter beyond a border."""
    return float(place.values[0]) - border


def doubling(place: Place) -> float:
    """Zero where a multiplier is -1."""
    return float(np.prod(1 + place.orbit.others).real)


def torus(place: Place) -> float:
    """Zero where the product of two multipliers is 1."""
    mu = place.orbit.others
    i, j = np.triu_indices(mu.size, 1)
    return float(np.prod(1 - mu[i] * mu[j]).real)


def _unit(place: Place, direction: Array) -> Array:
    """A direction in the units of `weights`, of length 1."""
    scaled = direction * place.unit
    return np.asarray(scaled / np.linalg.norm(scaled))


def _longest(place: Place) -> float:
    """The step in which no node changes by more than `TURN`."""
    length = float(np.linalg.norm(place.directions[0] * place.unit))
    return min(LONGEST, TURN / max(place.moved(np.array([1 / length])), 1e-12))


def _ahead(family: Family, place: Place, tangent: Array, step: float, rtol: float = COARSE) -> Place | None:
    """The cycle a ``step`` along the tangent."""
    per_length = place.directions[0] * place.unit @ tangent
    return predicted(family, place, np.array([step / per_length]), tangent[None], rtol)


def _between(
    family: Family, place: Place, ahead: Place, tangent: Array, step: float, kinds: Collection[str]
) -> list[Found]:
    """Bifurcations between two cycles, in order."""

    def fold(q: Place) -> float:
        unit = q.unit
        return float(_unit(q, q.directions[0])[-1] * np.sign((q.directions[0] * unit) @ tangent))

    out = []
    for kind, test in zip(KINDS, (fold, doubling, torus), strict=True):
        if kind in kinds and test(place) * test(ahead) < 0:
            found = _located(family, place, tangent, step, test)
            if found is not None and _is_there(kind, found):
                out.append(Found(found, kind))
    return sorted(out, key=lambda f: _distance(place, f.place, tangent))


def _located(family: Family, place: Place, tangent: Array, step: float, test: Callable[[Place], float]) -> Place | None:
    """The cycle within a step where ``test`` vanishes; lengths to 1e-9, by Brent's method, with precise derivatives."""
    seen: dict[float, Place] = {}

    def at(s: float) -> float:
        if s not in seen:
            found = _ahead(family, place, tangent, s, FINE)
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
    mu = place.orbit.others
    if kind == "period doubling":
        return bool(np.abs(1 + mu).min() < AT)
    if kind == "torus":  # a complex pair whose product is 1
        return bool(np.any((np.abs(np.abs(mu) - 1) < AT) & (np.abs(mu.imag) > AT)))
    return True


def _distance(place: Place, other: Place, tangent: Array) -> float:
    """How far a cycle is along the tangent of another."""
    return float(((position(other.nodes) - position(place.nodes)) * place.unit) @ tangent)


def near_hopf(p: CycleProblem, guess: Any) -> Orbit:
    """The cycle of a problem, by continuation from a Hopf point at another power or detuning."""
    own = dict(zip(LASER, laser_of(guess, turned_by(p.rise, p.ring)), strict=True))
    wanted = {"power": p.power, "detuning": p.detuning}
    far = {"power": abs(p.power / own["power"] - 1), "detuning": abs(p.detuning - own["detuning"]) / p.ring.linear_rate}
    names = sorted((name for name in LASER if far[name] > 0), key=lambda name: -far[name])  # the cycle grows at first
    if not names:
        raise InputError("the Hopf point given as guess is at this power and detuning: its cycle has no size there")
    base, place = replace(p, power=own["power"], detuning=own["detuning"]), None
    for name in names:
        ends = sorted((own[name], wanted[name]))
        span = ends[1] - ends[0]
        family = Family(base, (name,), np.array([span]))
        low, high = (ends[0], ends[1] + span) if wanted[name] < own[name] else (ends[0] - span, ends[1])
        if place is None:
            start, tangent = born(family, guess)
            if (float(start.values[0]) - wanted[name]) * (wanted[name] - own[name]) > 0:  # beyond it already
                start, tangent = born(family, guess, FAINT)
            found, why = follow_along(family, start, tangent, low, high, MOST)
        else:
            start = first_place(family, place.orbit) or place
            found, why = follow(family, start, wanted[name] - own[name], low, high, MOST)
        place = found[-1].place
        if abs(float(place.values[0]) - wanted[name]) > 1e-6 * span:
            raise InputError(
                f"no cycle at {name} = {wanted[name]:g} on the branch from the Hopf point given as guess: the branch "
                f"ends with {why}; continue_cycle shows where it goes"
            )
        own[name] = wanted[name]
        base = replace(base, power=own["power"], detuning=own["detuning"])
    return place.orbit  # type: ignore[union-attr]
