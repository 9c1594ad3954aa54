"""Drop traces to which a model is fitted, and the Fourier coefficients of their mean cycle, which are compared.

    drop(t) = Re sum_k c_k exp(2 pi i k (t - t_0)/T),      k = 0 .. 32

Two pulse trains of slightly different periods dephase within a few cycles, so a misfit of the time traces has a very
narrow minimum. Period and shape are therefore compared separately: by ln(T_model/T), and by the coefficients c_k after
the shift of phase t_0 that aligns the two cycles best. Truncated at k = 32, the cycle is what a detector of bandwidth
32/T shows, and a smooth function of every parameter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from thermofem import InputError, checks
from thermofem.arrays import Array, Complex, Mask, noise_of
from thermofem.data.variables import in_si

from ..inputs import check_detuning, check_power, datasets, noises
from ..thermal import Compact
from .forced_filters import Forced

if TYPE_CHECKING:
    import xarray as xr

HARMONICS = 32
LEVEL = 0.05  # of the mean: a smaller swing counts as that
FEWEST_SAMPLES = 64  # samples of a trace
ROUNDS = 3  # corrections of the period
BETWEEN, MANY = 8, 5_000  # points of the autocorrelation for each sample; in halves of more than `MANY` samples 1
PARTS, MOVES = 32, 0.05  # a trace rests if the means of so many pieces differ by less than this share of the whole mean
NEAR = 0.1  # relative distance of a ratio of periods from a whole number, below which it counts as that number
MOST_TRACE_SAMPLES = 50_000  # samples of a simulated trace


@dataclass(frozen=True, eq=False)
class Cycle:
    """Mean cycle of a periodic drop trace, as a Fourier series.

    period [s]: nan where the trace does not pulse.
    harmonics [shape (33,), W]: c_k, with the phase of an arbitrary t_0; only the mean where the trace does not pulse.
    """

    period: float
    harmonics: Complex

    def curve(self, phase: Array, *, smooth: bool = False) -> Array:
        """Drop power at the phases ``phase``, given as fractions of the period; of their shape.

        ``smooth`` multiplies the harmonics by Lanczos factors sin(x)/x, x = pi k/33: an average over 1/33 of the period
        that suppresses the Gibbs oscillations at steep edges.
        """
        k = np.arange(self.harmonics.size)
        waves = np.exp(2j * np.pi * np.outer(phase, k))
        harmonics = self.harmonics * np.sinc(k / k.size) if smooth else self.harmonics
        return (waves @ harmonics).real

    @cached_property
    def swing(self) -> float:
        """Largest minus smallest drop power in the cycle."""
        phase = np.linspace(0, 1, 256, endpoint=False)
        return float(np.ptp(self.curve(phase)))

    @property
    def scale(self) -> float:
        """Unit of shape errors: the swing, but at least `LEVEL` times the mean."""
        return max(self.swing, LEVEL * float(abs(self.harmonics[0])))

    def shifted(self, by: float) -> Cycle:
        """The same cycle, advanced in time by the fraction ``by`` of its period."""
        k = np.arange(self.harmonics.size)
        return Cycle(self.period, self.harmonics * np.exp(2j * np.pi * by * k))


def still(mean: float) -> Cycle:
    """The cycle of a trace that does not pulse: period nan, and only the mean c_0."""
    return Cycle(float("nan"), np.append(mean, np.zeros(HARMONICS)).astype(complex))


def lag(model: Complex, measured: Complex) -> float:
    """Time shift s of the model's cycle m, in periods, that maximises its correlation with the measured one d.

        C(s) = Re sum_k m_k d_k* exp(2 pi i k s)

    The best of evenly spaced shifts is improved by Newton's method on C'.
    """
    k = np.arange(1, model.size)
    products = model[1:] * measured[1:].conj()
    shifts = 16 * model.size
    correlation = np.fft.irfft(np.append(0, products), shifts)
    shift = float(np.argmax(correlation)) / shifts
    for _ in range(4):
        shifted = products * np.exp(2j * np.pi * k * shift)
        slope = float(np.sum(-k * shifted.imag))
        curvature = float(np.sum(-(k**2) * shifted.real))
        if curvature >= 0:  # no maximum is near
            break
        shift -= slope / curvature / (2 * np.pi)
    return shift


class FourierFit(NamedTuple):
    """Fourier series of a given period T, by least squares on samples.

        drop = A c + residual,      residual = [A, d drop/d ln T] (dc, d ln T)

    harmonics [shape (K + 1,)]: c_0 to c_K.
    residual [shape (n,)]; design [shape (n, 2 K + 2)]: the matrix of the second equation.
    """

    harmonics: Complex
    residual: Array
    design: Array

    def period_step(self) -> float:
        """Correction d ln T of the period."""
        return float(np.linalg.lstsq(self.design, self.residual, rcond=None)[0][-1])

    def scatter(self) -> float:
        """Standard deviation of a sample."""
        samples, unknowns = self.design.shape
        return float(np.sqrt(self.residual @ self.residual / max(samples - unknowns, 1)))


def fourier_fit(t: Array, drop: Array, T: float, K: int) -> FourierFit:
    """Fit a mean and K harmonics of the period T to samples."""
    k = np.arange(1, K + 1)
    waves = np.exp(2j * np.pi * np.outer(t / T, k))
    A = np.hstack([np.ones((t.size, 1)), waves.real, -waves.imag])
    c = np.linalg.lstsq(A, drop, rcond=None)[0]
    z = c[1 : 1 + K] + 1j * c[1 + K :]
    period_slope = (1j * (waves * k) @ z).real * (-2 * np.pi * t / T)  # d drop/d ln T
    return FourierFit(np.append(c[0], z), drop - A @ c, np.column_stack([A, period_slope]))


class Seen(NamedTuple):
    """Mean cycle of a measured trace with the standard deviations that its noise causes.

    period_deviation: standard deviation of ln(period); nan where the trace does not pulse.
    deviations [shape (33,), unit of the trace]: standard deviation of the real part of each harmonic c_k, and of the
        imaginary part; inf for harmonics that the sampling does not resolve.
    """

    cycle: Cycle
    period_deviation: float
    deviations: Array


def _second_half(t: Array, drop: Array) -> tuple[Array, Array]:
    """Times and drop power of the second half of a trace, interpolated to equal time steps where needed."""
    # the first half is the cold start
    begin = t[-1] - 0.5 * (t[-1] - t[0])
    late = t >= begin
    steps = np.diff(t[late])
    if late.sum() >= FEWEST_SAMPLES and np.ptp(steps) <= 1e-3 * steps.mean():
        return t[late], drop[late]
    # an unevenly sampled trace is interpolated
    grid = np.linspace(begin, t[-1], 32_768)
    return grid, np.interp(grid, t, drop)


def cycles_in(t: Array, drop: Array) -> tuple[float, Complex]:
    """Period (s) and Fourier coefficients, shape (cycles, 33), of the cycles in the second half of a trace.

    All cycles have a common phase; the drift of their phases corrects the period. Without pulses: nan, and the mean.
    """
    t, drop = _second_half(t, drop)
    period = _repetition(t, drop)
    k = np.arange(HARMONICS + 1)
    if not np.isfinite(period):
        return period, drop.mean() * (k == 0)[None].astype(complex)
    for _ in range(ROUNDS):
        numbers, waves = _folded(t, drop, period)
        angles = np.unwrap(np.angle(waves[:, 1]))
        slope = float(np.polyfit(numbers, angles, 1)[0])
        period /= 1 + slope / (2 * np.pi)
    waves[:, 0] /= 2
    return period, waves * np.exp(-1j * slope * np.outer(numbers, k))


def _folded(t: Array, drop: Array, period: float) -> tuple[Array, Complex]:
    """Numbers of the cycles, and 2 c_0, c_1, .. of each, shape (cycles, 33), where all have the period ``period``."""
    k = np.arange(HARMONICS + 1)
    samples = max(4 * HARMONICS, int(np.ceil(period / (t[1] - t[0]))))
    numbers = np.arange(max((t[-1] - t[0]) // period, 2))
    phases = (np.arange(samples) + 0.5) / samples
    times = t[0] + period * (numbers[:, None] + phases)
    waves = np.fft.rfft(np.interp(times, t, drop), axis=1)[:, k]
    return numbers, waves * (2 / samples) * np.exp(-1j * np.pi * k / samples)


def cycle_of(t: Array, drop: Array) -> Cycle:
    """Mean cycle in the second half of a simulated trace; a decaying oscillation counts as constant."""
    period, pieces = cycles_in(t, drop)
    if np.isfinite(period) and _changed_swing(pieces) is None:
        return Cycle(period, pieces.mean(axis=0))
    return still(float(pieces[:, 0].real.mean()))


def period_of(name: str, t: Array, drop: Array) -> float:
    """Period (s) in the second half of a measured trace; nan if it is constant or decays to a small swing.

    Raises InputError, with the ``name`` of the trace: it is neither constant nor periodic, or its swing still changes.
    """
    period, pieces = cycles_in(t, drop)
    if not np.isfinite(period):
        _check_rest(name, _second_half(t, drop)[1])
        return period
    swings = _changed_swing(pieces)
    if swings is None:
        return period
    if max(swings) > LEVEL:
        raise InputError(
            f"{name} has not settled in its second half, which is compared: its swing goes from {swings[0]:.1%} to "
            f"{swings[1]:.1%} of the mean drop power",
            "take a longer trace",
        )
    return float("nan")


def _changed_swing(pieces: Complex) -> tuple[float, float] | None:
    """Mean swings of the first and second half of the cycles, over the mean power; None if they do not differ."""
    squares = np.sum(np.abs(pieces[:, 1:]) ** 2, axis=1)
    swings = np.sqrt(2 * squares) * 2  # of a sine, from its mean square
    first, second = np.array_split(swings, 2)
    early = float(first.mean())
    late = float(second.mean())
    scatter = np.sqrt(first.var() / first.size + second.var() / second.size)
    # swings in the two halves of what is compared that differ by less than 30 % count as steady
    steady = min(early, late) > 0.7 * max(early, late)
    if len(pieces) < 4 or steady or abs(early - late) < 3 * scatter:
        return None
    level = float(abs(pieces[:, 0].mean()))
    return early / level, late / level


def _check_rest(name: str, drop: Array) -> None:
    """Raise InputError if a trace without a period varies by more than its noise: it has too few cycles."""
    parts = np.array_split(drop, PARTS)
    means = np.array([part.mean() for part in parts])
    noise = np.std(np.diff(drop)) / np.sqrt(2 * len(parts[0]))  # of such a mean, where it is white
    movement = np.ptp(means) / abs(drop.mean())
    if movement > MOVES and np.std(means) > 5 * noise:
        raise InputError(
            f"{name} neither rests nor repeats in its second half, which is compared: its drop power moves by "
            f"{movement:.0%} of the mean",
            "take a trace of eight pulses or more, or one that has come to rest",
        )


def _repetition(t: Array, x: Array) -> float:
    """Period (s) of an evenly sampled signal, from the first high peak of its autocorrelation; nan if it has none.

    The autocorrelation is interpolated between samples: at 8.5 samples a period, sharp pulses coincide after 17
    samples but not after 8 or 9.
    """
    x = x - x.mean()
    if np.std(x) < 1e-12 * np.max(np.abs(x), initial=1e-300):
        return float("nan")
    n = x.size
    fine = BETWEEN if n <= MANY else 1
    correlation = _autocorrelation(x, fine)
    first = int(np.argmax(correlation < 0))
    if first == 0 or correlation[first:].max() < 0.5:
        return float("nan")
    middle = correlation[first + 1 : -1]
    rises = middle >= correlation[first:-2]
    falls = middle > correlation[first + 2 :]
    peaks = first + 1 + np.flatnonzero(rises & falls)
    if peaks.size == 0:
        return float("nan")
    heights = correlation[peaks]
    best = peaks[heights > 0.9 * heights.max()][0]
    return float(best / fine * (t[-1] - t[0]) / (n - 1))


def _autocorrelation(x: Array, fine: int) -> Array:
    """Autocorrelation of n samples, 1 at lag 0, at lags of 1/``fine`` of a sample up to n/2 samples."""
    n = x.size
    power = np.abs(np.fft.rfft(x, 2 * n)) ** 2
    lags = fine * (n // 2)
    products = np.arange(n * fine, n * fine - lags, -1)
    correlation = np.fft.irfft(power, 2 * n * fine)[:lags] / products
    return correlation / correlation[0]


@dataclass(frozen=True, eq=False)
class Target:
    """A drop trace to which the model is fitted, with the drive under which it was measured.

    period [s]: of its pulses, nan where it is constant.
    unit: of the drop power; any but W is arbitrary and needs a scale factor.
    power [W]; detuning [Hz].
    times, drop [shape (n,)]: samples, in s from when the light was switched on, and in the unit of the trace.
    settled: the state at its start is unknown, so it is compared with the limit cycle of the model.
    noise: standard deviation of a sample in the unit of the trace, None where it is estimated.
    """

    period: float
    unit: str
    power: float
    detuning: float
    times: Array
    drop: Array
    settled: bool = False
    noise: float | None = None

    @property
    def absolute(self) -> bool:
        """Whether the drop power is in W."""
        return self.unit == "W"

    @property
    def sampling_step(self) -> float:
        """Median time between samples, s."""
        return float(np.median(np.diff(self.times)))

    @property
    def cold(self) -> bool:
        """Whether the first sample is taken when the light is switched on, to two sampling steps."""
        return not self.settled and self.times[0] <= 2 * self.sampling_step

    def window(self, model: Compact) -> tuple[float, float]:
        """First and last time (s) of the part of a model's run that is compared, in its second half.

        For a settled trace, and for one longer than the model's transient, the run has the length of that transient.
        """
        # eight time constants of the slowest pole leave e^-8, 3e-4
        enough = max(40e-6, 8.0 / model.slowest_rate)
        if self.settled or self.times[-1] > enough:
            return 0.0, enough
        return float(self.times[0]), float(self.times[-1])

    @cached_property
    def forced(self) -> Forced:
        """The trace resampled at equal time steps, for `forced_filters`."""
        length = float(self.times[-1] - self.times[0])
        n = min(MOST_TRACE_SAMPLES, 1 + round(length / self.sampling_step))
        times = np.linspace(self.times[0], self.times[-1], n)
        drop = np.interp(times, self.times, self.drop)
        return Forced(length / (n - 1), drop, self.power, self.detuning, self.cold, self.absolute)

    @cached_property
    def seen(self) -> Seen:
        """Period and harmonics of the second half by least squares on its samples, without interpolation.

        drop = Re sum_k c_k exp(2 pi i k (t - t_0)/T), with more harmonics in each step of Gauss-Newton for ln T.
        """
        t, drop = self._late_samples()
        if not np.isfinite(self.period):
            mean = float(np.trapezoid(drop, t) / t[-1])
            scatter = self._known_scatter() or max(float(drop.std()), noise_of(self.drop))
            return Seen(still(mean), np.nan, np.full(HARMONICS + 1, scatter * np.sqrt(2 / drop.size)))
        T = self.period
        sampled = int(0.5 * T * (t.size - 1) / t[-1])
        resolved = min(HARMONICS, max(1, t.size // 4 - 1), max(1, sampled))
        for K in (4, 12, HARMONICS, HARMONICS, HARMONICS):
            fit = fourier_fit(t, drop, T, min(K, resolved))
            T *= float(np.exp(np.clip(fit.period_step(), -0.02, 0.02)))
        scatter = self._known_scatter() or fit.scatter()
        harmonics = np.zeros(HARMONICS + 1, dtype=complex)
        harmonics[: fit.harmonics.size] = fit.harmonics
        deviations = np.full(HARMONICS + 1, np.inf)
        deviations[: fit.harmonics.size] = scatter * np.sqrt(2 / t.size)
        covariance = np.linalg.pinv(fit.design.T @ fit.design)
        return Seen(Cycle(T, harmonics), float(scatter * np.sqrt(covariance[-1, -1])), deviations)

    def _known_scatter(self) -> float | None:
        """Standard deviation of a mean of `_late_samples` by the noise that is known, None without one."""
        return None if self.noise is None else self.noise / float(np.sqrt(self._averaged))

    @property
    def _averaged(self) -> int:
        """How many samples of the second half make one of those that are compared."""
        return -(-int(self._late.sum()) // MOST_TRACE_SAMPLES)

    @property
    def _late(self) -> Mask:
        """Which samples are in the second half."""
        late: Mask = self.times >= (self.times[0] + self.times[-1]) / 2
        return late

    def _late_samples(self) -> tuple[Array, Array]:
        """Times (s) from the first one on and drop power of the second half; samples of long traces are averaged."""
        late = self._late
        every = self._averaged
        kept = late.sum() // every * every
        t = self.times[late][:kept].reshape(-1, every).mean(axis=1)
        drop = self.drop[late][:kept].reshape(-1, every).mean(axis=1)
        return t - t[0], drop


def targets_of(traces: xr.Dataset | Sequence[xr.Dataset], noise: float | Sequence[float] | None = None) -> list[Target]:
    """Check the traces and determine their periods: one `Target` for each.

    traces: each with drop (W, or in an arbitrary unit where its attribute "units" says another) over time (s).
    noise: standard deviation of a sample in the unit of its trace, one for all or one for each, None to estimate it.
    """
    given = datasets("traces", traces)
    sizes = noises(noise, len(given))
    return [_target(f"traces[{k}]", trace, sizes[k]) for k, trace in enumerate(given)]


def _target(name: str, trace: xr.Dataset, noise: float | None) -> Target:
    for variable in ("time", "drop"):
        if variable not in trace.variables:
            raise InputError(f"{name} has no variable {variable!r}; it needs drop (W) over time (s)")
    light = trace.attrs
    if light.get("lasers", 1) != 1:
        raise InputError(f"{name} is of a ring with a second laser; one laser alone can be fitted")
    if "heater_power" in trace:
        raise InputError(f"{name} is of a ring with heaters; one laser alone can be fitted")
    times = in_si(name, trace[["time"]])["time"]
    t = checks.array(f"{name}.time", times.values, increasing=True)
    drop = checks.array(f"{name}.drop", trace["drop"].values)
    checks.shape("drop", drop, t.shape)
    checks.enough(f"{name}.drop", int(np.count_nonzero(drop)), FEWEST_SAMPLES, "samples with light")
    period = period_of(name, t, drop)
    power = check_power(light.get("input_power", light.get("power")), f"{name}.attrs['power']")
    detuning = check_detuning(light.get("detuning"), f"{name}.attrs['detuning']")
    mark = light.get("settled", 0)  # a file keeps True as 1
    mark = int(mark) if isinstance(mark, bool | np.bool_) else mark
    settled = "initial" in light or bool(checks.integer(f"{name}.attrs['settled']", mark, 0, 1))
    unit = str(trace["drop"].attrs.get("units", "W"))
    return Target(period, unit, power, detuning, t - min(t[0], 0.0), drop, settled, noise)
