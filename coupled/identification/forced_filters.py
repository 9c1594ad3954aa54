"""Forced filters: misfit of a model whose carriers and temperature are driven by the measured light.

    U = drop/(2 gamma_d),     dN/dt = -N/tau(N) + g U^2,     dx_i/dt = gain_i P_abs(N, U) - rate_i x_i,   dT = sum_i x_i
    U_model = 2 gamma_e P/(gamma(N, U)^2 + D(N, dT, U)^2)

The photon lifetime is some 10 ps, so the light follows carriers and temperature instantaneously. There is no feedback
and no oscillation: the misfit of U_model is smooth over factors of two in every parameter, while that of a simulation
is rugged 1 % from the true values. Its minimum is biased by some percent, through interpolation and noise in U.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg.lapack import dtbtrs
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from thermofem.arrays import Array, noise_of
from thermofem.errors import InputError

from ..kernel import units
from ..kernel.problem_parts import PoleHeat
from ..kernel.rates import absorbed_power, field_loss, recombination
from ..kernel.units import FJ, NS, Rates
from .box_search import End, Prior, Residuals, cost, least_squares

if TYPE_CHECKING:
    from ..resonator import RingResonator
    from ..thermal import Compact
    from ..unknowns import Unknowns

SCREENED, REFINED = 1024, 8  # points of the box, least squares from the best of them
COARSE, FINE = 10, 2  # one sample of so many is compared, in the search of the box and in the refinement
NEWTON_PASSES = 3  # of Newton's method for carriers whose lifetime depends on their density: 1e-4 is left
SCALE = (0.15, 1.1)  # the largest drop over that of the cold ring on resonance: pulses reach .15 to 1.1 (measured)
BIAS, INFLATED = 0.03, 15.0  # of logarithms, and of its own deviations: how far off a forced fit may be (measured)
OPEN = 1e-4  # 1/variance of a logarithm that nothing determines


@dataclass(frozen=True, eq=False)
class Forced:
    """A drop trace at equal time steps, with its drive.

    step [s]; drop [shape (n,), unit of the trace]; power [W]; detuning [Hz].
    cold: the light was switched on at the first sample; else carriers and heat start at their means.
    absolute: drop is in W.
    """

    step: float
    drop: Array
    power: float
    detuning: float
    cold: bool
    absolute: bool

    @cached_property
    def noise(self) -> float:
        """Standard deviation of the white noise in a sample, in the unit of the trace."""
        return noise_of(self.drop)

    @cached_property
    def deviations(self) -> Array:
        """Standard deviation of each sample, (n,): noise, and the uncertainty of an edge by two samples."""
        span = maximum_filter1d(self.drop, 5) - minimum_filter1d(self.drop, 5) - 5 * self.noise
        return np.hypot(self.noise, np.maximum(span, 0))

    def predicted(self, ring: RingResonator, model: Compact, scale: float = 1.0, every: int = 1) -> Array:
        """Drop power that the model predicts at every ``every``-th sample, unit of the trace.

        scale [W per unit of the trace]: 1 for a trace in W.
        """
        rates, fcd = units.internal_rates(ring)
        unit = scale / (2 * ring.drop_bus_rate * FJ)
        step = self.step / NS  # fJ per unit of the trace; ns
        U = self.drop * unit
        square = U**2 - (self.noise * unit) ** 2  # the noise adds its variance to U^2
        N = _carriers(rates.g * square, step, rates, self.cold)
        heat = absorbed_power(U, N, rates) + 2.0 * rates.tpa * (square - U**2)
        gain, rate, bend = _poles(model)
        dT = np.zeros(U.size)
        for g, r in zip(gain, rate, strict=True):
            start = 0.0 if self.cold else heat.mean() * g / r
            dT += _filtered(heat, step, g, r, start).real
        U = np.maximum(U[::every], 0)
        N = N[::every]
        dT = dT[::every]
        dT = dT + bend * dT**2
        shift = sum((c * N**p for c, p in fcd), np.zeros(N.size))
        D = -rates.thermal_shift * dT - shift - rates.kerr * U - units.internal_detuning(self.detuning)
        gamma = field_loss(U, N, rates)
        pump = units.internal_pump(ring, self.power)
        return pump**2 / (gamma**2 + D**2) / unit


def _poles(model: Compact) -> tuple[Array, Array, float]:
    """Gain (K/(uW ns)) and rate (1/ns) of the poles, and curvature (1/K); a quadratic model is linearised at dT = 0."""
    heat, bend = units.internal_heat(model)
    if isinstance(heat, PoleHeat):
        return heat.gain[0], heat.rate[0], bend
    values, vectors = np.linalg.eig(heat.A)
    gain = (heat.C @ vectors) * np.linalg.solve(vectors, heat.B)
    return gain, -values, bend


def _filtered(source: Array, step: float, gain: complex, rate: complex, start: complex) -> Array:
    """Solution x of dx/dt = gain s - rate x at the samples, exact for s linear between them; same shape as s."""
    from scipy.signal import lfilter  # it takes a fifth of the time of `import coupled`

    z = rate * step
    keep = np.exp(-z)
    right = gain / rate * (1.0 + np.expm1(-z) / z)
    left = -gain / rate * np.expm1(-z) - right
    begin = start - right * source[0]
    return lfilter([right, left], [1.0, -keep], source, zi=[begin])[0]


def _carriers(source: Array, step: float, rates: Rates, cold: bool) -> Array:
    """Solution N of dN/dt = s - f(N), f the recombination, by Newton's method for all samples at once.

    A pass solves dN/dt = s - f(N_old) - f'(N_old) (N - N_old).
    """
    _, slowest = recombination(0.0, rates)
    start = 0.0 if cold else max(float(source.mean() / slowest), 0.0)
    N = np.maximum(_filtered(source, step, 1.0, float(slowest), start), 0.0)
    band = np.ones((2, N.size))
    for _ in range(NEWTON_PASSES):
        lost, slope = recombination(N, rates)
        if np.ptp(slope) == 0:  # linear: solved
            break
        s = source + slope * N - lost
        k = (slope[1:] + slope[:-1]) / 2
        gone = -np.expm1(-k * step)
        right = (1 - gone / (k * step)) / k
        band[1, :-1] = gone - 1
        first = 0.0 if cold else float(N.mean())
        made = (gone / k - right) * s[:-1] + right * s[1:]
        N = dtbtrs(band, np.append(first, made), uplo="L")[0]
        N = np.maximum(N, 0.0)
    return N


def forced_starts(what: Unknowns, traces: list[Forced], seed: int) -> list[Prior]:
    """Minima of the misfit of the forced filters within the bounds, as priors of the parameters, the best first.

    1024 Sobol points, least squares from the best 8 on ln((U_model + 3 sigma)/(U + 3 sigma)), then on the differences
    over the samples' standard deviations. Each trace in an arbitrary unit adds its scale to the unknowns.
    """
    n = what.start.size
    low, high = _bounds(what, traces)
    logarithms = _residuals(what, traces, COARSE, _logarithms)
    differences = _residuals(what, traces, FINE, _differences)
    points = _screened(logarithms, what.start, low, high, seed)
    coarse = [least_squares(logarithms, x, low, high, steps=40) for x in points]
    centres = _distinct(coarse, n)
    fine = [least_squares(differences, x, low, high, steps=20) for x in centres]
    fine.sort(key=lambda end: end.cost)
    return [_prior(end, n, len(traces)) for end in fine]


def _bounds(what: Unknowns, traces: list[Forced]) -> tuple[Array, Array]:
    """Bounds of the unknowns, and after them of the logarithms of the scales of traces in arbitrary units."""
    loose = [trace for trace in traces if not trace.absolute]
    cold = 4 * what.ring.drop_bus_rate * what.ring.bus_rate / what.ring.linear_rate**2
    top = np.array([np.log(cold * trace.power / np.quantile(trace.drop, 0.999)) for trace in loose])
    low = np.append(what.low, top + np.log(SCALE[0]))
    high = np.append(what.high, top + np.log(SCALE[1]))
    return low, high


def _residuals(what: Unknowns, traces: list[Forced], every: int, row: Callable[[Array, Forced], Array]) -> Residuals:
    """Residuals of all traces; ``row`` compares predicted drop power at every ``every``-th sample with a trace."""
    n = what.start.size
    loose = [k for k, trace in enumerate(traces) if not trace.absolute]

    def of(x: Array) -> Array | None:
        try:
            ring, model = what.build(x[:n])
        except (InputError, RuntimeError):
            return None
        scales = np.ones(len(traces))
        scales[loose] = np.exp(x[n:])
        rows = []
        for trace, scale in zip(traces, scales, strict=True):
            errors = row(trace.predicted(ring, model, scale, every), trace)
            rows.append(errors / np.sqrt(errors.size))
        return np.concatenate(rows)

    return of


def _logarithms(predicted: Array, trace: Forced) -> Array:
    offset = 3 * trace.noise
    drop = np.maximum(trace.drop[::COARSE], 0)
    return np.log((predicted + offset) / (drop + offset))


def _differences(predicted: Array, trace: Forced) -> Array:
    return (predicted - trace.drop[::FINE]) / trace.deviations[::FINE]


def _screened(f: Residuals, start: Array, low: Array, high: Array, seed: int) -> list[Array]:
    """The best points of a Sobol sequence in the box and of the start. InputError: no point is physical."""
    from scipy.stats import qmc

    n = start.size
    count = SCREENED * (2 if low.size > n else 1)
    sequence = qmc.Sobol(low.size, rng=seed).random(count)
    first = np.append(start, (low[n:] + high[n:]) / 2)
    points = np.vstack([first, qmc.scale(sequence, low, high)])
    costs = [cost(f, x) for x in points]
    if not np.isfinite(costs).any():
        raise InputError("no thermal model in the bounds is physical; check bounds")
    return [points[k] for k in np.argsort(costs)[:REFINED] if np.isfinite(costs[k])]


def _distinct(ends: list[End], n: int) -> list[Array]:
    """The results of a search, the best first, that differ in the n unknowns and fit about as well as the best."""
    ordered = sorted(ends, key=lambda end: end.cost)
    centres: list[Array] = []
    for end in ordered:
        # results that differ by less than 5 % are one
        again = any(np.abs(end.x[:n] - x[:n]).max() < 0.05 for x in centres)
        if end.cost < 4 * ordered[0].cost + 0.01 and not again:
            centres.append(end.x)
    return centres


def _prior(end: End, n: int, traces: int) -> Prior:
    """Prior of the n unknowns from a forced fit, whose covariance is enlarged by its bias."""
    precision = end.J.T @ end.J * end.r.size / traces  # each residual was divided by sqrt(samples)
    C = np.linalg.inv(precision + OPEN * np.eye(end.x.size))[:n, :n]
    wide = INFLATED**2 * C + BIAS**2 * np.eye(n)
    return Prior(end.x[:n], np.asarray(np.linalg.inv(wide), dtype=float))
