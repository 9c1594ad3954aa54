"""The least-squares problem of `fit_transmission`: unknowns, curves of fixed points, residuals, and the search.

At fixed power all fixed points lie on one smooth curve (detuning, output), the tilted resonance, which includes its two
folds; at fixed detuning likewise. A slow sweep follows this curve and jumps at a fold. The residual of a sample (x, y)
is its signed distance from the nearest point (x(s), y(s)) of the curve,

    r = +-min_s hypot((x - x(s))/s_x, (y - y(s) - sum_k a_k B_k(s))/s_y),

with s_x half a step of the sweep, s_y the noise, and B_k the terms of the baseline (`slow_sweeps`). No branch has to be
assigned to a sample, the direction of the sweep does not matter, and the residuals at a jump depend continuously on
where the fold lies. The coefficients a_k are linear unknowns of each sweep, with a deviation of 1 assumed:

    a = argmin_a  sum_i w_i r_i(a)^2 + |a|^2,       dr_i/da_k = -n_y B_k/s_y

by Gauss and Newton, n_y the component of the curve's normal along y: variable projection, after Golub and Pereyra, SIAM
J. Numer. Anal. 10, 413 (1973).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
import shapely
import xarray as xr
from scipy.constants import pi

from thermofem import Foster, InputError, checks
from thermofem.arrays import Array

from ..equilibria.transmission import port_curve, transmission
from ..identification.box_search import End
from ..resonator import RingResonator
from ..thermal import as_read
from ..unknowns import SPAN, check_apart, fitted_names, number_of, span_of, varied
from .slow_sweeps import DBM_OF_WATT, Sweep

T = TypeVar("T")
RESISTANCE, POWER, FREQUENCY = "thermal_resistance", "power", "frequency"
SIDE = 3.0  # linewidths by which a curve extends beyond its sweep
SCALES = 30.0  # factor by which the scale of an arbitrary unit may differ from its start
DECIBEL = 10 / np.log(10)  # decibels of a factor e
# of an unknown, for slopes in the search and at its end: far above what the 600 points of a curve leave
STEP, WIDE = 2e-3, 5e-3
IMPOSSIBLE = 1e3  # a residual where the parameters make no ring


class Nearest(NamedTuple):
    """Nearest points of a curve for the samples of a sweep.

    distance [shape (n,)]: signed, in units of s_x and s_y.
    slope [shape (terms, n)]: derivative of the distance with respect to the coefficients of the baseline.
    """

    distance: Array
    slope: Array


def nearest_points(sweep: Sweep, x: Array, y: Array, terms: Array) -> Nearest:
    """Nearest points of the polyline (x, y), whose points have the ``terms`` of a baseline, for all samples."""
    curve = np.column_stack([x / sweep.step, y / sweep.noise])
    samples = np.column_stack([sweep.x / sweep.step, sweep.y / sweep.noise])
    segments = shapely.linestrings(np.stack([curve[:-1], curve[1:]], axis=1))
    sample, nearest = shapely.STRtree(segments).query_nearest(shapely.points(samples))
    segment = np.full(len(samples), len(segments))
    np.minimum.at(segment, sample, nearest)  # the first one at a point that two segments share
    along_x, along_y = np.diff(curve, axis=0)[segment].T
    to_x, to_y = (samples - curve[segment]).T
    length = np.sqrt(np.maximum(along_x**2 + along_y**2, 1e-300))
    share = np.clip((to_x * along_x + to_y * along_y) / length**2, 0, 1)
    off_x = to_x - share * along_x
    off_y = to_y - share * along_y
    left = along_x * off_y >= along_y * off_x
    distance = np.hypot(off_x, off_y) * np.where(left, 1.0, -1.0)
    normal = along_x / length
    values = terms[:, segment] * (1 - share) + terms[:, segment + 1] * share
    return Nearest(distance, -normal * values / sweep.noise)


def sweep_residuals(sweep: Sweep, x: Array, output: Array, *, robust: bool = False) -> tuple[Array, Array]:
    """Residuals of a sweep from the curve (x, output), shape (samples,), and the coefficients of its baseline.

    robust: weights 1/sqrt(1 + r^2), those of the soft L1 loss, as samples beyond a fold are far away at first.
    """
    terms = sweep.baseline_terms(x, output)
    a = np.zeros(len(terms))
    near = nearest_points(sweep, x, output, terms)
    for _ in range(8 if a.size else 0):
        weight = 1 / np.sqrt(1 + near.distance**2) if robust else np.ones(sweep.x.size)
        weighted = near.slope * weight
        normal_matrix = weighted @ near.slope.T + np.eye(a.size)
        change = np.linalg.solve(normal_matrix, -weighted @ near.distance - a)
        a = a + change
        near = nearest_points(sweep, x, output + a @ terms, terms)
        # in the assumed deviations of the coefficients
        if np.abs(change).max() < 1e-4:
            break
    return near.distance, a


@dataclass(frozen=True, eq=False)
class Search:
    """Unknowns x of a fit, their start and bounds, and what is held.

    x has logarithms of the parameters, but for "frequency" its shift from ``reference`` in ``linewidth``; then the
    logarithms of the common scales of arbitrary units.

    ring: the numbers that are held. resistance [K/W], factor: R_th and the factor on all powers where they are held.
    reference [Hz]: cold resonance from which the sweeps count; linewidth [Hz]: of the initial ring.
    scales: port and unit of each common scale.
    """

    ring: RingResonator
    resistance: float
    factor: float
    data: list[Sweep]
    names: tuple[str, ...]
    start: Array
    low: Array
    high: Array
    scales: tuple[tuple[str, str], ...]
    reference: float
    linewidth: float

    def values(self, x: Array) -> dict[str, float]:
        """The free parameters at the unknowns ``x``: a dict from name to value in SI."""
        found = {}
        for name, unknown in zip(self.names, x, strict=False):
            shifted = self.reference + float(unknown) * self.linewidth
            found[name] = shifted if name == FREQUENCY else float(np.exp(unknown))
        return found

    def build(self, x: Array) -> tuple[RingResonator, Foster, float]:
        """Ring, thermal model and factor on all powers at the unknowns ``x``, shape (unknowns,)."""
        values = self.values(x)
        resistance = values.pop(RESISTANCE, self.resistance)
        factor = values.pop(POWER, self.factor)
        return varied(self.ring, values), Foster(R=[resistance], tau=[1e-6]), factor

    def with_held(self, name: str, value: float) -> Search:
        """The same problem with another value (SI) of a number that is held."""
        if name == RESISTANCE:
            return replace(self, resistance=value)
        if name == POWER:
            return replace(self, factor=value)
        return replace(self, ring=varied(self.ring, {name: value}))

    def _by_drive(self, curve: Callable[..., T], x: Array) -> list[T]:
        """A curve of all fixed points for each sweep at the unknowns ``x``, computed once for each laser."""
        ring, heat, factor = self.build(x)
        shift = ring.frequency - self.reference
        drives = [(sweep.power, sweep.detuning) for sweep in self.data]
        found = {}
        for drive in dict.fromkeys(drives):
            power, detuning = self._span(factor, shift, *drive)
            found[drive] = curve(as_read(ring, heat), heat, power=power, detuning=detuning)
        return [found[drive] for drive in drives]

    def _span(self, factor: float, shift: float, power: float | None, detuning: float | None) -> tuple[Any, Any]:
        """Power (W) and detuning (Hz) of a curve, the swept one as the range of all sweeps of its kind and more."""
        swept = np.concatenate([sweep.x for sweep in self.data if (sweep.power is None) is (power is None)])
        low = swept.min()
        high = swept.max()
        if power is not None:
            side = SIDE * self.linewidth
            return power * factor, (low - shift - side, high - shift + side)
        assert detuning is not None
        return tuple(np.exp([low - 0.5, high + 0.5]) * factor), detuning - shift

    def curves(self, x: Array) -> list[xr.Dataset]:
        """The curve of all fixed points for each sweep at the unknowns ``x``, as `transmission` returns it."""
        return self._by_drive(transmission, x)

    def lines(self, x: Array) -> list[Line]:
        """The curve of each sweep in the coordinates of its samples, but for the baseline."""
        ring, _, factor = self.build(x)
        shift = ring.frequency - self.reference
        found = []
        for sweep, curve in zip(self.data, self._by_drive(port_curve, x), strict=True):
            place = np.log(curve.power / factor) if sweep.power is None else curve.detuning + shift
            found.append(Line(place, self._scaled(sweep, sweep.output(curve), x)))
        return found

    def _scaled(self, sweep: Sweep, output: Array, x: Array) -> Array:
        """The output of a curve times the common scale of the sweep's unit, or plus it in decibels."""
        if sweep.scale is None:
            return output
        logarithm = float(x[len(self.names) + self.scales.index(sweep.scale)])
        return output + DECIBEL * logarithm if sweep.decibels else output * np.exp(logarithm)

    def residuals(self, x: Array, *, robust: bool = False) -> Array:
        """Distances of all samples from their curves at the unknowns ``x``, with the best baselines; (samples,)."""
        try:
            lines = self.lines(x)
        except (InputError, RuntimeError):
            return np.full(sum(sweep.x.size for sweep in self.data), IMPOSSIBLE)
        rows = []
        for sweep, line in zip(self.data, lines, strict=True):
            rows.append(sweep_residuals(sweep, line.x, line.output, robust=robust)[0])
        return np.concatenate(rows)


class Line(NamedTuple):
    """A curve of fixed points in the coordinates of a sweep, shape (points,)."""

    x: Array
    output: Array


def make_search(
    ring: RingResonator, resistance: float, data: list[Sweep], free: Sequence[str],
    bounds: Mapping[str, tuple[float, float]] | None,
) -> Search:  # fmt: skip
    """Set up the fit: resolve the names of the free parameters, with their starts and bounds."""
    checks.check_names("free", free)
    given = checks.mapping("bounds", bounds, hint='such as {"loss_rate": (1e9, 1e10)}')
    for name in given:
        checks.choice("a name in bounds", name, free)
    others = {RESISTANCE: resistance, POWER: 1.0}
    for name in free:
        checks.choice("a name in free", name, fitted_names(ring) | {*others})
    check_apart(free)
    width = ring.linear_rate / pi
    rows = []
    for name in free:
        value = others[name] if name in others else number_of(ring, name)
        if name == FREQUENCY:
            nu = np.concatenate([sweep.x if sweep.power is not None else [sweep.detuning] for sweep in data])
            ends = (value + nu.min() - SIDE * width, value + nu.max() + SIDE * width)
            low, high = (np.array(span_of(name, given, ends)) - value) / width
            start = 0.0
        else:
            value = checks.positive(name, value, hint="a free parameter must start above 0")
            low, high = np.log(span_of(name, given, (value / SPAN, value * SPAN)))
            start = np.log(value)
        rows.append((np.clip(start, low, high), low, high))
    scales = tuple(dict.fromkeys(sweep.scale for sweep in data if sweep.scale is not None))
    for scale in scales:
        top = max(_log_output(sweep) for sweep in data if sweep.scale == scale)
        rows.append((top, top - np.log(SCALES), top + np.log(SCALES)))
    starts, lows, highs = np.array(rows).T
    return Search(
        ring, resistance, 1.0, data, tuple(free), starts, lows, highs, scales, ring.frequency, width
    )  # fmt: skip


def _log_output(sweep: Sweep) -> float:
    """ln of the highest sample over the bus power: the highest sample stands for a resonance that passes all power."""
    power = float(np.exp(sweep.x.max())) if sweep.power is None else sweep.power
    top = float(sweep.y.max())
    if sweep.unit == "dB":
        return top / DECIBEL
    if sweep.unit == "dBm":
        return (top - DBM_OF_WATT) / DECIBEL - float(np.log(power))
    return float(np.log(top / power))


def searched(search: Search, start: Array) -> End:
    """Minimise the residuals from a start: returns unknowns x, residuals, their Jacobian, and the sum of their squares.

    A first search uses a robust loss (soft L1), as samples beyond a fold have large residuals at first.

    Raises InputError: no ring within the bounds at the start.
    """
    from scipy.optimize import least_squares

    def descended(x: Array, loss: str, jac: str, step: float) -> Any:
        robust = loss != "linear"
        return least_squares(
            lambda at: search.residuals(at, robust=robust), x, jac=jac, loss=loss,
            bounds=(search.low - 1e-12, search.high + 1e-12), max_nfev=60, xtol=1e-8, ftol=1e-8,
            diff_step=step / np.maximum(np.abs(x), 1e-2), x_scale=1.0,
        )  # fmt: skip

    first = descended(np.clip(start, search.low, search.high), "soft_l1", "2-point", STEP)
    best = descended(first.x, "linear", "3-point", WIDE)
    if best.fun[0] == IMPOSSIBLE:
        raise InputError("no ring in the bounds has a steady transmission at these powers")
    return End(best.x, best.fun, best.jac, 2 * float(best.cost))
