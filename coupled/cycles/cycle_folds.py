"""Curves of folds of cycles in the plane of power and detuning: bounds of pulsing where a fixed point is also stable.

Cycles with two free parameters q form a surface. A fold is a point where the projection of its tangent plane, spanned
by the rows of W, onto the plane of q is singular:

    g = det (dq/dW) = 0,    W: directions in which the linearised cycle equations hold, V W = 1 for two fixed rows V

One row of V is tangent to the curve of folds, the other normal to it within the tangent plane. Each step is a predictor
along the first row; the secant method on g then corrects along the second.

Source: Kuznetsov, Elements of Applied Bifurcation Theory (2004), Section 10.3 (curves of codimension one).
"""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from thermofem.arrays import Array, ArrayLike
from thermofem.checks import InputError
from thermofem.models import ThermalModel

from ..arguments import check_axis, check_ring
from ..equilibria.bifurcation_curves import hopf_curves
from ..equilibria.zeros import distances
from ..heaters import constant
from ..resonator import RingResonator
from ..thermal import trusted
from .branch import SLOWEST, born, described, follow, laser_of
from .cycle_problem import CycleProblem
from .multiple_shooting import Family, Place, corrected, on_good_nodes, position, predicted

AROUND = 0.3  # of the window, within which Hopf points are looked for beyond it
MARGIN = 0.02  # of the window, by which a curve leaves it
NEAR = 0.02  # of the window, where two folds are the same
SEEDS = 100  # cycles of a branch from a Hopf point
POINTS = 300  # of a curve, each way
FIRST, LONGEST, SHORTEST = 0.01, 0.06, 1e-5  # steps, in units of `multiple_shooting.weights`
TURN = 0.8  # of the largest values, what the nodes may change in a step
EASY, HARD, MOST_STEPS = 6, 9, 12  # of Newton's method, to a fold
SMALLEST = 0.03  # relative range of a cycle, where a curve ends on a Hopf curve
SECANT = 1e-7  # smallest distance of two points of the secant method; between nearer ones g differs by round-off
ON_IT = 1e-6  # distance from the fold in these units: the parameters are off by its square


def cycle_fold_curves(
    ring: RingResonator,
    model: ThermalModel,
    powers: ArrayLike,
    detunings: ArrayLike,
    *,
    heaters: Mapping[str, float] | None = None,
    heated: str | None = None,
    read: str | None = None,
) -> list[xr.Dataset]:
    """Return the curves on which two cycles merge and vanish (folds of cycles): the ends of hysteresis.

    Between such a curve and a subcritical Hopf curve a stable fixed point and a stable cycle coexist. A branch of
    cycles is continued from a Hopf point to a fold, and the curve of folds from there in both directions.

    Parameters
    ----------
    ring : RingResonator
    model : ThermalModel
        as for `limit_cycle`.
    powers, detunings : array, W and Hz
        of a map; the curves end at their first point outside.
    heaters : mapping of name to float, W, optional
        constant power in further inputs of a linear model, as for `simulate`; so are ``heated`` and ``read``.

    Returns
    -------
    list of xarray.Dataset
        one for each curve, over point: power (W), detuning (Hz), the measures of the cycle as in `continue_cycle`, and
        leading (True if all other multipliers lie in the unit circle, so that one of the two cycles is stable).
        attrs["reason"] says why the curve ends, at both ends. A curve is found only if a branch of cycles from a Hopf
        point in or near the window has a fold on it.

    Raises
    ------
    InputError
        as `hopf_curves`.

    Warns OutsideTrainingWarning where the cycles are hotter than the training of the model.

    >>> import coupled, surrogate
    >>> ring, newton = coupled.borghi2021().with_lumped_fcd(), surrogate.newton(tau_th=275e-9)
    >>> (curve,) = coupled.cycles.cycle_folds.cycle_fold_curves(ring, newton, [4e-3, 6e-3], [-10e9, 10e9])
    >>> print(f"{curve.power.min().item() * 1e3:.1f} to {curve.power.max().item() * 1e3:.1f} mW")
    4.0 to 6.1 mW
    """
    check_ring(ring)
    P, nu = check_axis("powers", powers), check_axis("detunings", detunings)
    warm = constant(model, heaters, heated, read)
    window = _Window(P[0], P[-1], nu[0], nu[-1])
    watts, offsets = window.wider()
    found: list[xr.Dataset] = []
    for hopf in hopf_curves(ring, warm.model, watts, offsets + warm.turned(ring)):
        for seed in _seeds(hopf):
            p = CycleProblem(ring, warm.model, *laser_of(seed, warm.turned(ring)), warm.rise)
            for family, fold, across in _folds_from(p, seed, window):
                if not any(window.on(curve, fold.values) for curve in found):
                    found += _curve(family, fold, across, window)
    for curve in found:
        trusted(model, curve["highest_rise"].values - warm.rise)
    return [curve.assign_attrs(warm.attributes) for curve in found]


class _Window:
    """The rectangle of power and detuning in which curves of folds are computed."""

    def __init__(self, low: float, high: float, first: float, last: float) -> None:
        """Store the lowest and highest power (W) and the first and last detuning (Hz) of the window."""
        self.low, self.high, self.first, self.last = float(low), float(high), float(first), float(last)
        self.decades = max(float(np.log(high / low)), 0.1)
        self.width = max(float(last - first), 1e9)
        self.ranges = np.array([np.sqrt(low * high) * self.decades, self.width])  # units of power and detuning

    def wider(self) -> tuple[Array, Array]:
        """Ranges of power (W) and detuning (Hz), two ends each, of the window extended by `AROUND` on every side."""
        factor, more = np.exp(AROUND * self.decades), AROUND * self.width
        powers = np.array([self.low / factor, min(self.high * factor, 1.0)])
        return powers, np.array([self.first - more, self.last + more])

    def at(self, values: Array) -> Array:
        """Coordinates of powers (W) and detunings (Hz), shape (2, ...): 0 to 1 in the window, power logarithmic."""
        P, nu = values
        return np.array([np.log(np.maximum(P, 1e-12) / self.low) / self.decades, (nu - self.first) / self.width])

    def holds(self, values: Array, margin: float = 0.0) -> bool:
        """Whether (power, detuning) lies in the window, widened on each side by ``margin`` times its size."""
        at = self.at(values)
        return bool(np.all((at >= -margin) & (at <= 1 + margin)))

    def on(self, curve: xr.Dataset, values: Array) -> bool:
        """Whether (power, detuning) lies on a curve, within `NEAR` of the window's size."""
        own = self.at(np.stack([curve["power"].values, curve["detuning"].values])).T
        return bool(distances(self.at(values)[None], own)[0] < NEAR)


def _seeds(hopf: xr.Dataset) -> list[xr.Dataset]:
    """The midpoint of every sub- or supercritical part of a Hopf curve that bounds a region of stable fixed points."""
    leading, hard = hopf["leading"].values, hopf["lyapunov"].values > 0
    kind = np.where(leading, np.where(hard, 2, 1), 0)
    edges = np.flatnonzero(np.diff(kind)) + 1
    parts = np.split(np.arange(kind.size), edges)
    return [hopf.isel(point=int(part[part.size // 2])) for part in parts if kind[part[0]] > 0]


def _folds_from(p: CycleProblem, seed: xr.Dataset, window: _Window) -> list[tuple[Family, Place, Array]]:
    """Folds on the branch of cycles in detuning from a Hopf point: family, cycle, and tangent of that branch there."""
    one, both = Family(p, ("detuning",), window.ranges[1:]), Family(p, ("power", "detuning"), window.ranges)
    try:
        start, tangent = born(one, seed)
    except InputError:
        return []
    low, high = window.wider()[1]
    found, _ = follow(one, start, tangent, float(low), float(high), SEEDS, ("fold",))
    out = []
    for fold in (f.place for f in found if f.kind == "fold"):
        across = fold.directions[0] * fold.unit
        across = np.insert(across / np.linalg.norm(across), -1, 0.0)
        rows = np.stack([across, np.eye(across.size)[-2]])
        nodes = fold.nodes._replace(values=np.array([p.power, fold.values[0]]))
        place = corrected(both, nodes, rows, np.insert(fold.unit, -1, 1 / window.ranges[0]))
        if place is not None:
            out.append((both, place, across))
    return out


def _curve(family: Family, fold: Place, across: Array, window: _Window) -> list[xr.Dataset]:
    """A list with the Dataset of the curve of folds through ``fold``; empty if it has no point in the window."""
    across, along = _frame(fold, across)
    (back, begins), (ahead, ends) = (_followed(family, fold, sign * along, window) for sign in (-1, 1))
    places = [*back[::-1], *ahead[1:]]
    if len(places) < 3 or not any(window.holds(place.values) for place in places):
        return []
    curve = xr.Dataset(described(family, places))
    others = [np.delete(mu, np.argmin(np.abs(mu - 1))) for mu in (place.orbit.others for place in places)]
    about = {"units": "1", "long_name": "one of the two cycles is stable"}
    curve["leading"] = ("point", [bool(np.all(np.abs(mu) < 1)) for mu in others], about)
    return [curve.assign_attrs(kind="fold-of-cycles curve", ring=family.base.ring.name, reason=f"{begins}; {ends}")]


def _followed(family: Family, place: Place, along: Array, window: _Window) -> tuple[list[Place], str]:
    """The folds of cycles from ``place`` on, continued in the direction ``along``, and why the curve ends."""
    out, step, slope, shortest = [place], FIRST, 0.0, place.orbit.T
    while len(out) < POINTS:
        rows = np.stack(_frame(place, along))
        step = min(step, LONGEST, TURN / max(place.moved(_coefficients(place, rows[0])), 1e-12))
        found = _next(family, place, rows, step, slope)
        if found is None:
            step /= 3
            if step < SHORTEST:
                return out, "Newton's method finds no next fold"
            continue
        after, slope, steps = found
        chord = (position(after.nodes) - position(place.nodes)) * after.unit
        good = on_good_nodes(family, after, np.stack(_frame(after, chord)))
        if good is None:
            return out, "its nodes cannot be placed"
        place, (along, across) = good
        slope /= float(np.linalg.norm(along) * np.linalg.norm(across) ** 2)  # units of the distances from another node
        out.append(after)
        shortest = min(shortest, after.orbit.T)
        if not window.holds(after.values, MARGIN):
            return out, "the end of the range"
        if after.extent < SMALLEST:
            return out, "a Hopf curve"
        if SLOWEST * shortest < after.orbit.T:
            return out, "the period grows without bound"
        step *= 1.4 if steps <= EASY else 0.7 if steps >= HARD else 1.0
    return out, "the number of points"


def _frame(place: Place, along: Array) -> tuple[Array, Array]:
    """Orthonormal basis of the tangent plane at a cycle: the projection of ``along``, and the vector normal to it."""
    q, _ = np.linalg.qr((place.directions * place.unit).T)
    t = along @ q / np.linalg.norm(along @ q)
    return q @ t, q @ np.array([-t[1], t[0]])


def _coefficients(place: Place, direction: Array) -> Array:
    """Coefficients of a vector of the tangent plane in the basis ``place.directions``, shape (2,)."""
    return np.asarray(np.linalg.lstsq((place.directions * place.unit).T, direction, rcond=None)[0])


def _next(family: Family, place: Place, rows: Array, step: float, slope: float) -> tuple[Place, float, int] | None:
    """The fold at arclength ``step``, dg/d(distance along the second row), and the number of Newton steps; or None.

    rows: orthonormal, tangent to the curve of folds and normal to it.
    slope: dg/d(distance along the second row) at the last fold, 0 where it is not known.
    """
    unit, now, by, last, across, steps = place.unit, place, step * _coefficients(place, rows[0]), None, 0.0, 0
    while steps < MOST_STEPS:
        found = predicted(family, now, by, rows)
        if found is None:
            return None
        g = float(np.linalg.det(found.directions[:, -2:] * unit[-2:]))
        if last is not None and abs(across - last[0]) > SECANT:
            slope = (g - last[1]) / (across - last[0])
        off, last, steps = -g / slope if slope else 0.1 * step, (across, g), steps + found.steps
        if abs(off) <= ON_IT:
            return found, slope, steps
        if not abs(off) < 3 * step:
            return None
        now, by, across = found, np.array([0.0, off]), across + off
    return None
