"""Curves of folds of cycles in the plane of power and detuning: the borders of pulsing beside a stable point."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from thermofem.arrays import Array, ArrayLike
from thermofem.checks import InputError
from thermofem.models import ThermalModel

from ..arguments import check_axis, check_ring
from ..equilibria.bifurcation_curves import plane_of, unwatched
from ..heaters import constant
from ..resonator import RingResonator
from ..thermal import Compact, trusted
from . import branch
from .cycle_problem import CycleProblem
from .fold_path import follow_folds
from .hopf_points import born, laser_of
from .multiple_shooting import Family, Place, corrected
from .orbit_measures import measure

if TYPE_CHECKING:
    import xarray as xr

AROUND = 0.3  # of the window, within which Hopf points are looked for beyond it
MARGIN = 0.02  # of the window, by which a curve leaves it
NEAR = 0.02  # of the window, where two folds are the same
SEEDS = 100  # cycles of a branch from a Hopf point
POINTS = 300  # of a curve, each way


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
    """Return the curves on which a stable and an unstable cycle meet and vanish: the ends of hysteresis.

    Between such a curve and a subcritical Hopf curve the ring may rest or pulse. Branches of cycles lead from Hopf
    points to a fold, from which the curve is followed both ways, without integration.

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
        one for each curve, over point: power (W), detuning (Hz), period (s), swing and highest_rise (K), and leading,
        whether no other multiplier lies outside the unit circle, so that one of the two cycles is stable.
        attrs["reason"] says why the curve ends at either end. Curves that no branch from a Hopf point in or near the
        window leads to are not found.

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
    small, turn = warm.model, warm.turned(ring)
    window = _Window(P[0], P[-1], nu[0] + turn, nu[-1] + turn)
    found: list[xr.Dataset] = []
    for hopf in unwatched(plane_of(ring, small, *window.wider())):
        for seed in _seeds(hopf):
            for fold, family in _folds_from(ring, small, seed, window):
                if any(window.holds(curve, fold.values) for curve in found):
                    continue
                found += _curve(ring, small, fold, family, window)
    for curve in found:
        trusted(model, curve["highest_rise"].values)
        curve["detuning"] = curve["detuning"].copy(data=curve["detuning"].values - turn)
        curve["highest_rise"] = curve["highest_rise"].copy(data=curve["highest_rise"].values + warm.rise)
    return [curve.assign_attrs(warm.attributes) for curve in found]


class _Window:
    """The range of power and detuning that is asked for."""

    def __init__(self, low: float, high: float, first: float, last: float) -> None:
        """Take the ends in W and Hz."""
        self.low, self.high, self.first, self.last = float(low), float(high), float(first), float(last)
        self.decades = max(float(np.log(high / low)), 0.1)
        self.width = max(float(last - first), 1e9)

    def wider(self) -> tuple[Array, Array]:
        """The ends with `AROUND` on either side."""
        factor, more = np.exp(AROUND * self.decades), AROUND * self.width
        return np.array([self.low / factor, min(self.high * factor, 1.0)]), np.array(
            [self.first - more, self.last + more]
        )

    def ranges(self, values: Array) -> Array:
        """Units of power and detuning at their ``values``."""
        return np.array([values[0] * self.decades, self.width])

    def at(self, P: Any, nu: Any) -> Array:
        """Power and detuning as fractions of the window."""
        return np.array([np.log(np.maximum(P, 1e-12) / self.low) / self.decades, (nu - self.first) / self.width])

    def inside(self, values: Array) -> bool:
        """Whether a point lies in the window or next to it."""
        at = self.at(values[0], values[1])
        return bool(np.all((at > -MARGIN) & (at < 1 + MARGIN)))

    def contains(self, values: Array) -> bool:
        """Whether a point lies in the window itself."""
        at = self.at(values[0], values[1])
        return bool(np.all((at >= 0) & (at <= 1)))

    def holds(self, curve: xr.Dataset, values: Array) -> bool:
        """Whether a curve passes through a point."""
        own = self.at(curve["power"].values, curve["detuning"].values).T
        start, stop, point = own[:-1], own[1:], self.at(values[0], values[1])
        side = stop - start
        share = np.clip(((point - start) * side).sum(axis=1) / np.maximum((side**2).sum(axis=1), 1e-30), 0, 1)
        return bool(np.min(np.linalg.norm(start + share[:, None] * side - point, axis=1), initial=np.inf) < NEAR)


def _seeds(hopf: xr.Dataset) -> list[xr.Dataset]:
    """The middle of every stretch of a Hopf curve that bounds a stable region, each of one kind."""
    leading, hard = hopf["leading"].values, hopf["lyapunov"].values > 0
    kind = np.where(leading, np.where(hard, 2, 1), 0)
    edges = np.flatnonzero(np.diff(kind)) + 1
    parts = np.split(np.arange(kind.size), edges)
    return [hopf.isel(point=int(part[part.size // 2])) for part in parts if kind[part[0]] > 0]


def _folds_from(ring: RingResonator, model: Compact, seed: xr.Dataset, window: _Window) -> list[tuple[Place, Array]]:
    """Folds on the branch of cycles from a Hopf point in detuning: power, detuning and the direction across each."""
    p = CycleProblem(ring, model, *laser_of(seed))
    here = window.ranges(np.array([p.power, p.detuning]))
    one = Family(p, ("detuning",), here[1:])
    try:
        start, tangent = born(one, seed)
    except InputError:
        return []
    low, high = window.wider()[1]
    found, _ = branch.follow_along(one, start, tangent, float(low), float(high), SEEDS, ("fold",))
    out = []
    for fold in (f.place for f in found if f.kind == "fold"):
        across = fold.directions[0] * fold.unit
        across = np.insert(across / np.linalg.norm(across), -1, 0.0)
        both = Family(p, ("power", "detuning"), here)
        rows = np.stack([across, np.eye(across.size)[-2]])
        nodes = fold.nodes._replace(values=np.array([p.power, fold.values[0]]))
        place = corrected(both, nodes, rows, np.insert(fold.unit, -1, 1 / here[0]))
        if place is not None:
            out.append((place, across))
    return out


def _curve(ring: RingResonator, model: Compact, fold: Place, across: Array, window: _Window) -> list[xr.Dataset]:
    """The curve through a fold, cut to the window."""
    base = CycleProblem(ring, model, float(fold.values[0]), float(fold.values[1]))

    def family(values: Array) -> Family:
        return Family(base, ("power", "detuning"), window.ranges(values))

    ways = [follow_folds(family, fold, across, sign, window.inside, POINTS) for sign in (-1.0, 1.0)]
    places = [*ways[0][0][::-1], *ways[1][0][1:]]
    if len(places) < 3 or not any(window.contains(place.values) for place in places):
        return []
    return [_dataset(base, places, (ways[0][1], ways[1][1]))]


def _dataset(base: Any, places: list[Place], reasons: tuple[str, str]) -> xr.Dataset:
    """One curve in SI."""
    import xarray as xr

    from thermofem.data import dataset

    power, detuning = np.array([place.values for place in places]).T
    others = [np.delete(mu, np.argmin(np.abs(mu - 1))) for mu in (place.orbit.others for place in places)]
    leading = np.array([bool(np.all(np.abs(mu) < 1)) for mu in others])
    seen = [measure(place.orbit) for place in places]
    values = {
        "power": (power, dataset.describe("input_power")),
        "detuning": (detuning, dataset.describe("detuning")),
        "period": (np.array([place.orbit.T for place in places]) * 1e-9, dataset.describe("period")),
        "swing": (np.array([m.swing for m in seen]), dataset.describe("swing")),
        "highest_rise": (np.array([m.hottest for m in seen]), {"units": "K", "long_name": "highest temperature rise"}),
        "leading": (leading, {"units": "1", "long_name": "one of the two cycles is stable"}),
    }
    return xr.Dataset(
        {name: ("point", v, about) for name, (v, about) in values.items()},
        attrs={"kind": "fold-of-cycles curve", "ring": base.ring.name, "reason": "; ".join(reasons)},
    )
