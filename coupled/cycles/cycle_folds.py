"""Curves of folds of cycles in the plane of power and detuning: bounds of pulsing where a fixed point is also stable.

Cycles with two free parameters q form a surface. A fold is a point where the projection of its tangent plane, spanned
by the rows of W, onto the plane of q is singular:

    g = det (dq/dW) = 0,    W: directions in which the linearised cycle equations hold, V W = 1 for two fixed rows V

One row of V is tangent to the curve of folds, the other normal to it within the tangent plane. Each step is a predictor
along the first row; the Newton steps of the corrector also go along the second, by the secant method on g.

Source: Kuznetsov, Elements of Applied Bifurcation Theory (2004), Section 10.3 (curves of codimension one).
"""

from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from thermofem.arrays import Array, ArrayLike, runs_of
from thermofem.checks import InputError
from thermofem.models import ThermalModel

from ..equilibria.bifurcation_curves import hopf_curves
from ..equilibria.zeros import distances
from ..heaters import warmed
from ..inputs import check_axis
from ..resonator import RingResonator
from ..thermal import Heaters, as_read, trusted, without_origin
from .branch import born, described, follow, laser_of
from .cycle_problem import CycleProblem
from .multiple_shooting import Family, Place, corrected
from .return_map import Orbit

AROUND = 0.3  # of the window, within which Hopf points are looked for beyond it
POINTS = 300  # of a curve, each way


def cycle_fold_curves(
    ring: RingResonator,
    model: ThermalModel,
    powers: ArrayLike,
    detunings: ArrayLike,
    *,
    heaters: Heaters = None,
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
    P = check_axis("powers", powers)
    nu = check_axis("detunings", detunings)
    warm = warmed(ring, model, heaters, heated, read)
    low, high = np.transpose([np.log(P[[0, -1]]), nu[[0, -1]]])
    window = _Window(low, high)
    watts, offsets = window.wider(AROUND).T
    compared = as_read(ring, warm.model)
    small = without_origin(warm.model)
    curves: list[xr.Dataset] = []
    for hopf in hopf_curves(compared, small, watts, offsets + warm.turned(ring)):
        for seed in _seeds(hopf):
            p = CycleProblem(ring, warm.model, *laser_of(seed, warm.turned(ring)), warm.rise)
            for family, fold, across in _folds_from(p, seed, window):
                if not any(window.on_curve(fold, curve) for curve in curves):
                    curves += _curve(family, fold, across, window)
    for curve in curves:
        trusted(model, curve["highest_rise"].values - warm.rise)
    return [curve.assign_attrs(warm.attributes) for curve in curves]


class _Window(NamedTuple):
    """The rectangle in which curves of folds are computed, by its corners (logarithm of the power in W, Hz)."""

    low: Array
    high: Array

    @property
    def size(self) -> Array:
        """Its width in both coordinates, shape (2,), but at least a tenth of an e-folding and 1 GHz."""
        return np.maximum(self.high - self.low, [0.1, 1e9])

    def wider(self, share: float) -> Array:
        """Corners (W, Hz) of the window extended by a share of its size on every side, to 1 W at most; shape (2, 2)."""
        corners = np.array([self.low - share * self.size, self.high + share * self.size])
        corners[:, 0] = np.exp(np.minimum(corners[:, 0], 0.0))
        return corners

    def at(self, power: Any, detuning: Any) -> Array:
        """Coordinates of points (W, Hz), shape (points, 2), 0 to 1 in the window."""
        return (np.transpose([np.log(power), detuning]) - self.low) / self.size

    def holds(self, curve: xr.Dataset) -> bool:
        """Whether a point of a curve lies in the window."""
        at = self.at(curve.power, curve.detuning)
        inside = np.all((at >= 0) & (at <= 1), axis=1)
        return bool(np.any(inside))

    def on_curve(self, fold: Place, curve: xr.Dataset) -> bool:
        """Whether a fold at a power and detuning lies on a curve."""
        power, detuning = fold.values[:, None]
        distance = distances(self.at(power, detuning), self.at(curve.power, curve.detuning))[0]
        # folds nearer than this share of the window are the same
        return bool(distance < 0.02)


def _seeds(hopf: xr.Dataset) -> list[xr.Dataset]:
    """The midpoint of every sub- or supercritical part of a Hopf curve that bounds a region of stable fixed points."""
    leading = hopf["leading"].values
    hard = hopf["lyapunov"].values > 0
    parts = [*runs_of(leading & hard), *runs_of(leading & ~hard)]
    middles = sorted((first + end) // 2 for first, end in parts)
    return [hopf.isel(point=k) for k in middles]


def _folds_from(p: CycleProblem, seed: xr.Dataset, window: _Window) -> list[tuple[Family, Place, Array]]:
    """Folds on the branch of cycles in detuning from a Hopf point: family, cycle, and tangent of that branch there."""
    ranges = window.size * [np.exp((window.low[0] + window.high[0]) / 2), 1.0]
    one = Family(p, ("detuning",), ranges[1:])
    both = Family(p, ("power", "detuning"), ranges)
    try:
        start, tangent = born(one, seed)
    except InputError:
        return []
    # 100 cycles reach beyond the folds near a Hopf point
    cycles, _ = follow(one, start, tangent, window.wider(AROUND)[:, 1], 100, ("fold",))
    out = []
    for fold in (cycle.place for cycle in cycles if cycle.kind == "fold"):
        across = np.insert(fold.frame(tangent)[0], -1, 0.0)
        power = np.eye(across.size)[-2]
        rows = np.stack([across, power])
        nodes = fold.nodes._replace(values=np.array([p.power, fold.values[0]]))
        place = corrected(both, nodes, rows, np.insert(fold.unit, -1, 1 / ranges[0]))
        if place is not None:
            out.append((both, place, across))
    return out


def _curve(family: Family, fold: Place, across: Array, window: _Window) -> list[xr.Dataset]:
    """A list with the Dataset of the curve of folds through ``fold``; empty if it has no point in the window."""
    along = fold.frame(across)[1]
    # a curve leaves the window by this share of it
    corners = window.wider(0.02)
    back, begins = follow(family, fold, -along, corners, POINTS, ())
    ahead, ends = follow(family, fold, along, corners, POINTS, ())
    places = [cycle.place for cycle in [*back[::-1], *ahead[1:]]]
    curve = xr.Dataset(described(family, places))
    if len(places) < 3 or not window.holds(curve):
        return []
    about = {"units": "1", "long_name": "one of the two cycles is stable"}
    curve["leading"] = ("point", [_one_is_stable(place.orbit) for place in places], about)
    return [curve.assign_attrs(kind="fold-of-cycles curve", ring=family.base.ring.name, reason=f"{begins}; {ends}")]


def _one_is_stable(orbit: Orbit) -> bool:
    """Whether all multipliers of a cycle at a fold lie in the unit circle but the trivial one and that of the fold."""
    mu = orbit.others
    at_one = np.argmin(np.abs(mu - 1))
    return bool(np.all(np.abs(np.delete(mu, at_one)) < 1))
