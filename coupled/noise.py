"""Noise as waveforms, with a seed so that runs repeat: intensity and frequency of a laser, heat of a ring.

    P(t) = P_0 [1 + e(t)],       one-sided density of e:  S_e(f) = 10^(RIN/10) /Hz        below the bandwidth, else 0
    nu(t) = nu_0 + n(t),         one-sided density of n:  S_n(f) = linewidth/pi Hz^2/Hz   below the bandwidth, else 0

White frequency noise of that density makes a Lorentzian line with ``linewidth`` between its half-maxima. The samples
are the Fourier series of a record of length L, a little longer than the run, with independent normal amplitudes:

    x(t) = sqrt(S/2L) z_0 + sqrt(S/L) sum_k=1^K (z_k cos 2 pi k t/L + z'_k sin 2 pi k t/L),      K <= L bandwidth

The constant term represents noise slower than the run. With it the phase diffuses by <(phi(t) - phi(0))^2> =
2 pi linewidth t up to the end, and the mean power of runs has the variance S P_0^2/2T. The last term K is scaled so
that the total variance is S bandwidth. The amplitudes are the same for all runs of one seed, bandwidth and duration.

Thermo-refractive noise is the sum of one Ornstein-Uhlenbeck process for each pole of the heat (`thermorefractive`).

Sources: Petermann, Laser Diode Modulation and Noise (1988) (RIN); Di Domenico, Schilt and Thomann, Appl.
Opt. 49, 4801 (2010) (linewidth of white frequency noise: pi times its density).
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.constants import Boltzmann
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from thermofem import checks
from thermofem.arrays import Array
from thermofem.fluctuations import TAKEN, port_of, real_impedance
from thermofem.geometry.section_parts import LIGHT
from thermofem.models import ThermalModel
from thermofem.models.contract import bare
from thermofem.ring_temperature import detuning_output
from thermofem.waveforms import PiecewiseCubic

from .inputs import bounds, check_ring, pieces
from .resonator import RingResonator

WIDER = 5.0  # bandwidth over linewidth, where the line is 10 % narrower (measured)
OVERSAMPLED = 8  # samples in the shortest period: cubics between them err by 1e-3
MOST_NOISE_SAMPLES = 2_000_000  # samples
INTENSITY, FREQUENCY, HEAT = 0, 1, 2  # sources of noise, independent for one seed


def intensity_noise(power: float, rin: float, *, bandwidth: float, duration: float, seed: int = 0) -> PiecewiseCubic:
    """Return a laser power with white relative intensity noise.

    Parameters
    ----------
    power : float, W
        the mean over many seeds; that of one run differs by sqrt(S/2T) of it, T the duration.
    rin : float, dB/Hz
        one-sided density of the relative power: -130 for a common diode laser.
    bandwidth : float, Hz
        cutoff of the noise; the field in a ring follows up to the linewidth of the resonance.
    duration : float, s
    seed : int
        two lasers need two; intensity and frequency of one laser are independent for one seed.

    Raises
    ------
    InputError
        a number out of range, or noise that would make the power negative.

    >>> wave = intensity_noise(1e-3, -130, bandwidth=1e9, duration=1e-6, seed=1)
    >>> bool(abs(wave(0.5e-6) / 1e-3 - 1) < 0.1)
    True
    """
    power = checks.positive("power", power, unit="W", at_most=1, hint="8 dBm is 6.31e-3")
    rin = checks.between("rin", rin, -250, 0, unit="dB/Hz", hint="-130 is a common diode laser")
    times, e = _white(10 ** (rin / 10), bandwidth, duration, seed, INTENSITY)
    wave = _wave(times, power * (1 + e))
    if bounds(pieces("power", wave, 0.0, duration))[0] <= 0:
        raise checks.InputError(
            f"rin = {rin:g} dB/Hz over {bandwidth:g} Hz has a standard deviation of {e.std():.2g} of the power, which "
            "would become negative; take a smaller bandwidth"
        )
    return wave


def frequency_noise(linewidth: float, *, bandwidth: float, duration: float, seed: int = 0) -> PiecewiseCubic:
    """Return the frequency noise (Hz) of a laser of given linewidth. It adds to a detuning.

    A list adds inputs: ``detuning=[2e9, frequency_noise(...)]``.

    Parameters
    ----------
    linewidth : float, Hz
        between the half-maxima of the Lorentzian line.
    bandwidth, duration, seed
        as for `intensity_noise`; the bandwidth must be five times the linewidth or more. The line is 10 % narrower
        then, 5 % at ten times and 2 % at thirty times, between the quarters of its power.

    Raises
    ------
    InputError
        a number out of range.

    >>> wave = frequency_noise(1e5, bandwidth=1e9, duration=1e-6, seed=1)
    >>> bool(abs(wave(0.5e-6)) < 1e8)
    True
    """
    linewidth = checks.positive("linewidth", linewidth, unit="Hz", at_most=1e12, hint="1e5 is 100 kHz")
    hint = f"below {WIDER:g} times the linewidth the line would be narrower than that"
    checks.between("bandwidth", bandwidth, WIDER * linewidth, 1e13, unit="Hz", hint=hint)
    return _wave(*_white(linewidth / np.pi, bandwidth, duration, seed, FREQUENCY))


def thermorefractive(
    model: ThermalModel,
    ring: RingResonator,
    *,
    bandwidth: float,
    duration: float,
    seed: int = 0,
    temperature: float = 300.0,
) -> PiecewiseCubic:
    """Return the thermo-refractive noise of a ring as a detuning (Hz): ``detuning=[2e9, thermorefractive(...)]``.

        nu(t) = (thermal_shift/2 pi) sum_k x_k(t),     dx_k = -x_k dt/tau_k + noise,     <x_k^2> = k_B T^2 R_k/tau_k
        x_k(t + h) = exp(-h/tau_k) x_k(t) + sqrt(<x_k^2> (1 - exp(-2 h/tau_k))) z

    exact at every sample, at eight times the bandwidth. A pole that decays within four samples would fold its noise
    from beyond the samples into the band: those poles have the density 4 k_B T^2 R_k/(1 + (2 pi f tau_k)^2) below the
    bandwidth, and none above. Folding of the others adds 3 % to the density at the bandwidth, 0.7 % at half of it. In
    `simulate` this detuning gives the noise of `thermofem.thermal_noise` of the linear ring, light's feedback included.

    Parameters
    ----------
    model : ThermalModel
        linear: a Foster network of one part, or a StateSpace that reads the temperature that the ring reads.
    ring : RingResonator
        its shift per kelvin.
    bandwidth : float, Hz
    duration : float, s
    seed : int
        that of the noise of a laser is independent.
    temperature : float, K
        absolute.

    Returns
    -------
    PiecewiseCubic
        Hz.

    Raises
    ------
    InputError
        a number out of range, a model that is not linear, or one from a part to another.

    >>> import coupled, thermofem as th
    >>> heat = th.Foster(R=[2000.0, 5000.0], tau=[60e-9, 1e-6])
    >>> wave = thermorefractive(heat, coupled.borghi2021(), bandwidth=50e6, duration=10e-6, seed=1)
    >>> bool(abs(wave(5e-6)) < 10e6)
    True
    """
    check_ring(ring)
    system = bare(model)
    checks.has("model", system, "inputs", "outputs", hint=TAKEN)
    several = len(system.outputs) > 1
    own = detuning_output(ring.read, system.inputs[0], tuple(system.outputs))
    poles = port_of("model", system, own if several else LIGHT)
    temperature = checks.between("temperature", temperature, 1e-3, 5000, unit="K", hint="it is absolute")
    R = np.asarray(poles.R)
    tau = np.asarray(poles.tau)
    unit = Boltzmann * temperature**2

    length = 1 / (OVERSAMPLED * bandwidth) if bandwidth else np.inf
    # with four samples in a time constant, folding adds (1/4)^2/12 to the static density of a pole, 0.5 %
    slow = tau > 4.0 * length

    def fast(f: Array) -> Array:
        return 4 * unit * real_impedance(R[~slow], tau[~slow], f)

    times, rise = _coloured(fast, bandwidth, duration, seed, HEAT)
    rng = np.random.default_rng([checks.seed(seed), HEAT, 1])
    for variance, lifetime in zip(unit * R[slow] / tau[slow], tau[slow], strict=True):
        rise = rise + np.sqrt(variance) * _ornstein_uhlenbeck(rng, times, lifetime)
    return PiecewiseCubic.of_spline(CubicSpline(times, ring.thermal_shift / (2 * np.pi) * rise))


def _ornstein_uhlenbeck(rng: np.random.Generator, times: Array, lifetime: float) -> Array:
    """Stationary samples of unit variance at evenly spaced times, with the correlation exp(-t/lifetime)."""
    kept = np.exp(-(times[1] - times[0]) / lifetime)
    kicks = rng.normal(size=times.size) * np.sqrt(1 - kept**2)
    kicks[0] = rng.normal()
    return lfilter([1.0], [1.0, -kept], kicks)


def _white(density: float, bandwidth: float, duration: float, seed: int, source: int) -> tuple[Array, Array]:
    """Times (s) and samples, both (n + 1,), of white noise below ``bandwidth``; ``source`` gives independent noise."""
    return _coloured(lambda f: np.full(f.size, density), bandwidth, duration, seed, source)


def _coloured(
    density: Callable[[Array], Array], bandwidth: float, duration: float, seed: int, source: int
) -> tuple[Array, Array]:
    """Times (s) and samples of periodic noise of a one-sided density, a function of frequency, below ``bandwidth``."""
    duration = checks.positive("duration", duration, unit="s", at_most=1, hint="did you mean 20e-6 for 20 us?")
    seed = checks.seed(seed)
    # the record is longer than the run, so that its end does not resemble its start
    length = 1.05 * duration
    most = MOST_NOISE_SAMPLES / (OVERSAMPLED * length)
    hint = f"{duration:g} s hold one period at least and {MOST_NOISE_SAMPLES} samples at most"
    bandwidth = checks.between("bandwidth", bandwidth, 1 / length, min(most, 1e13), unit="Hz", hint=hint)
    n = max(int(np.ceil(length * OVERSAMPLED * bandwidth)), 2 * OVERSAMPLED)
    lines = max(int(bandwidth * length), 1)
    rng = np.random.default_rng([seed, source])
    draw = rng.normal(size=(lines, 2)) @ [1, 1j]
    draw[-1] *= np.sqrt(bandwidth * length - lines + 0.5)
    spectrum = np.zeros(n // 2 + 1, dtype=complex)
    S = density(np.arange(lines + 1) / length)
    spectrum[1 : lines + 1] = draw * np.sqrt(S[1:] / length) * n / 2
    spectrum[0] = rng.normal() * np.sqrt(S[0] / (2 * length)) * n
    values = np.asarray(np.fft.irfft(spectrum, n), dtype=float)
    times = np.asarray(np.arange(n + 1) * (length / n), dtype=float)
    return times, np.append(values, values[0])


def _wave(times: Array, values: Array) -> Any:
    """Periodic cubic spline through samples as a waveform."""
    return PiecewiseCubic.of_spline(CubicSpline(times, values, bc_type="periodic"))
