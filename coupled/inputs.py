"""Laser powers and detunings as functions of time: piecewise cubics, at whose breakpoints an integration step ends.

An input of a ring is a number, a waveform (`th.Function` for any function of time), a piecewise polynomial, or a
list of these, which add: a bias with a pulse on it is ``[2e-3, th.Pulse(power=1e-3, width=10e-9, start=5e-6)]``.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import xarray as xr
from scipy.interpolate import PPoly

from thermofem import InputError, checks
from thermofem.arrays import Array, ArrayLike, Complex
from thermofem.piecewise import Pieces as Pieces, bounds
from thermofem.waveforms import Samples, Waveform, covering

from .kernel.problem_parts import Drive, Polynomials
from .kernel.units import NS, UW
from .resonator import RingResonator

Input: TypeAlias = "float | Waveform | Pieces | Sequence[Any]"
DEGREE = 3
SAME_TIME = 1e-13  # of a run: nearer breakpoints are one; sums of hundreds of delays differ by less
LONGEST = 1.0  # s, of a run
MOST_POINTS = 1_000_000  # of a map, a spectrum or a sweep: a point takes some 50 us, one of a circuit ten times that
WATT = "powers are in W: 8 dBm is 6.31e-3, 6.31 mW is 6.31e-3"


@dataclass(frozen=True, eq=False)
class Sweep(Samples, stored=False):
    """A detuning (or another signed quantity) interpolated linearly between samples, such as a swept laser.

    Two samples at one time make a jump.

    Parameters
    ----------
    times : array, s
        increasing; a time may occur twice.
    values : array, same length
        Hz for a detuning, W for a power.

    >>> Sweep([0, 10e-6], [5e9, -5e9])(2e-6)
    array(3.e+09)
    """

    times: ArrayLike
    values: ArrayLike

    def __post_init__(self) -> None:
        values = checks.array("values", self.values)
        self._check(values)
        object.__setattr__(self, "values", values)


def pieces(name: str, value: Any, start: float, stop: float) -> Pieces:
    """Convert an input to a piecewise cubic over [start, stop] in s.

    name: name of the input in error messages.
    value [float, Waveform, Pieces, scipy.interpolate.PPoly of degree 3 or less, or a list of these, which add]
    Raises InputError: another type, or a function that does not cover the whole window.
    """
    if isinstance(value, list | tuple):
        return add([pieces(f"{name}[{k}]", item, start, stop) for k, item in enumerate(value)])
    if isinstance(value, Pieces):
        return covering(name, value, start, stop).window(start, stop)
    if hasattr(value, "c") and hasattr(value, "x"):
        # coefficients of a BPoly are those of Bernstein polynomials
        if not isinstance(value, PPoly) or np.ndim(value.c) != 2 or len(value.c) > DEGREE + 1:
            hint = "PPoly.from_bernstein_basis makes a PPoly of a BPoly, PPoly.from_spline of a BSpline"
            raise InputError(f"{name} is a {type(value).__name__}; a PPoly is needed, at most cubic", hint)
        c = checks.numbers(f"{name}: coefficients", value.c)
        padded = np.pad(c, ((DEGREE + 1 - len(c), 0), (0, 0)))
        edges = np.asarray(value.x, dtype=float)
        return covering(name, Pieces.construct_fast(padded, edges), start, stop).window(start, stop)
    if isinstance(value, Waveform):
        return value.pieces(start, stop)
    return Pieces.constant(start, stop, checks.finite(name, value))


def add(parts: list[Pieces]) -> Pieces:
    """Sum of piecewise cubics over the same window."""
    several = [part for part in parts if part.c.any()] or parts[:1]
    if len(several) == 1:
        return several[0]
    edges = joint(*several)
    c = np.sum([part.on(edges).c for part in several], axis=0)
    return Pieces.construct_fast(c, edges)


def joint(*parts: Pieces) -> Array:
    """Union of the breakpoints of piecewise cubics, shape (n,), increasing; those equal up to round-off are merged."""
    if all(np.array_equal(part.edges, parts[0].edges) for part in parts[1:]):
        return parts[0].edges
    edges = np.concatenate([part.edges for part in parts])
    window = np.array([edges.min(), edges.max()])
    return apart_in_time(edges, window, 4e-16)


class Lights(NamedTuple):
    """L lasers over one time window.

    powers [W]
    frequencies [Hz]: relative to a reference frequency common to the lasers of a frame.
    frame: for each laser, the index of the laser in whose rotating frame its field is written.
    turning [shape (L,), rad/ns]: angular frequency of each laser in its frame where its modulus is largest.
    drive: the same in the kernel's units.
    """

    powers: list[Pieces]
    frequencies: list[Pieces]
    frame: list[int]
    turning: Array
    drive: Drive

    @property
    def driven_until(self) -> float:
        """Time in s of the last change of a laser, or of the last beat between lasers of one frame."""
        times = [last_change(function) for function in (*self.powers, *self.frequencies)]
        for frame in {*self.frame}:
            lasers = np.flatnonzero(np.equal(self.frame, frame))
            powers = [self.powers[k] for k in lasers]
            frequencies = [self.frequencies[k] for k in lasers]
            times.append(last_beat(powers, frequencies))
        return max(times)

    def amplitudes(self, times: Array) -> Complex:
        """Complex amplitudes of the lasers in their frames, sqrt(W), at n times in s; shape (L, n)."""
        sizes = np.sqrt([np.maximum(power(times), 0) for power in self.powers])
        phases = values(self.drive.phase, times)
        return sizes * np.exp(1j * phases)

    def incoming(self, times: Array) -> Complex:
        """Sum of the amplitudes of the lasers of each frame, sqrt(W), at n times in s; shape (frames, n)."""
        waves = self.amplitudes(times)
        frames = dict.fromkeys(self.frame)
        return np.array([waves[np.equal(self.frame, k)].sum(axis=0) for k in frames])


def lights(
    powers: list[Pieces], frequencies: list[Pieces], frame: list[int], *, detunings: list[Pieces], entry: Complex,
    phases: Sequence[float] = (), echoes: Callable[[Array], Array] = np.asarray,
) -> Lights:  # fmt: skip
    """Collect lasers with their coupling to the fields of the rings, and convert them to the kernel's units.

    frame: as of `Lights`. phases [rad]: of the lasers at the start; 0 by default.
    detunings [rad/s]: of every field, angular frequency of its frame minus that of its resonance.
    entry [(fields, L), 1/sqrt(s)]: coupling of each laser amplitude to each field.
    echoes: maps times of discontinuities to all times (s) at which they arrive, delays included; by default they
        arrive at once.
    """
    beats = [_difference(frequency, frequencies[k]) for frequency, k in zip(frequencies, frame, strict=True)]
    phase = integral(table(beats, 2 * np.pi * NS))
    if phases:
        phase.coefficients[:, :, 0] += phases
    turning = table(detunings, NS)
    arrivals = echoes(joint(*powers))
    jumps = np.concatenate([arrivals, NS * turning.edges, NS * phase.edges])
    window = powers[0].edges[[0, -1]]
    edges = apart_in_time(jumps, window)
    watts = [largest(power) for power in powers]
    brightest = np.array(watts) / UW
    drive = Drive(edges / NS, table(powers, 1 / UW), phase, turning, entry * NS**0.5, brightest)
    extremes = [max(bounds(beat), key=abs) for beat in beats]
    fastest = 2 * np.pi * NS * np.array(extremes)
    return Lights(powers, frequencies, frame, fastest, drive)


def _difference(frequency: Pieces, reference: Pieces) -> Pieces:
    """Difference of two piecewise cubics, without breakpoints where it vanishes."""
    difference = add([frequency, reference.times(-1.0)])
    if difference.c.any():
        return difference
    return Pieces.constant(difference.edges[0], difference.edges[-1], 0.0)


def apart_in_time(times: Array, window: Array, share: float = SAME_TIME) -> Array:
    """Sorted times in a window, with both its ends; those within a ``share`` of it of the previous one are removed."""
    ordered = np.sort(times)
    gaps = np.diff(ordered, prepend=-np.inf)
    edges = ordered[gaps > share * np.abs(window).max()]
    edges[[0, -1]] = window
    return edges


def values(functions: Polynomials, times: Array) -> Array:
    """Values of piecewise polynomials in the kernel's format at m times in s, shape (functions, m)."""
    return np.asarray(Pieces(*functions)(times / NS).T)


def integral(rates: Polynomials) -> Polynomials:
    """Antiderivatives of piecewise polynomials, zero at the first edge."""
    sums = Pieces(*rates).antiderivative()
    return Polynomials(rates.edges, np.moveaxis(sums.c[::-1], 0, -1))


def largest(power: Pieces) -> float:
    """Largest modulus of a power at its breakpoints in W, at least 1e-300."""
    first = float(np.abs(power.c[-1]).max())
    last = abs(float(power(power.edges[-1])))
    return max(first, last, 1e-300)


def table(functions: Sequence[Pieces], factor: float) -> Polynomials:
    """Convert piecewise cubics of time in s, times ``factor``, to kernel polynomials of time in ns on common edges."""
    edges = joint(*functions)
    coefficients = np.stack([each.on(edges).coefficients for each in functions], axis=1)
    return Polynomials(edges / NS, coefficients * factor * NS ** np.arange(coefficients.shape[2]))


def last_change(function: Pieces) -> float:
    """Time in s after which a piecewise cubic is constant; 0 for a constant."""
    if function.steady:
        return 0.0
    powers = np.diff(function.edges) ** np.arange(DEGREE, -1, -1)[:, None]
    sizes = np.abs(function.c) * powers
    # what a fit of cubics to a constant leaves
    tolerance = 1e-9 * sizes[-1].max()
    changed = np.any(sizes[:-1] > tolerance, axis=0)
    jumps = function.c[-1, 1:] - function.ends[:-1]
    changed[:-1] |= np.abs(jumps) > tolerance
    return float(np.max(function.edges[1:] * changed))


def last_beat(powers: Sequence[Pieces], frequencies: Sequence[Pieces]) -> float:
    """Time in s up to which two lasers are on and beat; 0 where all have the same frequency."""
    beats = [_difference(frequency, frequencies[0]) for frequency in frequencies[1:]]
    if not any(np.any(beat.c) for beat in beats):
        return 0.0
    last_lit = []
    for power in powers:
        end = power.edges[-1]
        last_lit.append(end if power(end) > 0 else last_change(power))
    return sorted(last_lit)[-2]


def check_ring(ring: RingResonator) -> None:
    """Raise InputError unless the argument is a RingResonator."""
    checks.instance("ring", ring, RingResonator, hint="it must be a RingResonator, such as borghi2021()")


def check_power(power: Any, name: str = "power") -> float:
    """Return a bus power in W as a float, or raise InputError if it is not in (0, 1] W; ``name`` is for the message."""
    return checks.positive(name, power, unit="W", at_most=1, hint=WATT)


def check_detuning(detuning: Any, name: str = "detuning") -> float:
    """Return a detuning in Hz as a float, or raise InputError if it is out of range; ``name`` is for the message."""
    nu = checks.finite(name, detuning, unit="Hz")
    if 1 <= abs(nu) <= 1e3:
        raise InputError(f"{name} = {nu:g} Hz is below any linewidth; {name} is in Hz (did you mean {nu:g}e9?)")
    return checks.between(name, nu, -5e12, 5e12, unit="Hz", hint="laser minus cold resonance, e.g. -10e9")


def check_axis(name: str, values: ArrayLike) -> Array:
    """Return powers (W) or detunings (Hz) of a map, shape (n,); InputError unless valid and strictly increasing."""
    axis = checks.array(name, values)
    for k in range(axis.size):
        (check_power if name == "powers" else check_detuning)(axis[k], f"{name}[{k}]")
        if k and axis[k] <= axis[k - 1]:
            raise InputError(f"{name}[{k}] = {axis[k]:g} is not above {name}[{k - 1}] = {axis[k - 1]:g}; sort it")
    return axis


def power_in_time(power: Any, duration: float, name: str = "power", most: float = 1.0, hint: str = WATT) -> Any:
    """Return a constant power (W) as a float, a function of time as `Pieces`; InputError outside 0 to ``most`` W."""
    if _is_number(power):
        return checks.between(name, power, 0, most, unit="W", hint=hint)
    found = pieces(name, power, 0.0, float(duration))
    low, high = bounds(found)
    # a cubic fit of a function may undershoot zero by this share of the largest power
    least = low if low < -1e-7 * high else 0.0
    for value in (least, high):
        checks.between(name, value, 0, most, unit="W", hint=hint)
    return found


def detuning_in_time(detuning: Any, duration: float) -> Any:
    """Return a constant detuning (Hz) as a float, a function of time as `Pieces`; InputError if out of range."""
    if _is_number(detuning):
        return check_detuning(detuning)
    found = pieces("detuning", detuning, 0.0, float(duration))
    check_detuning(max(bounds(found), key=abs))
    return found


def _is_number(value: Any) -> bool:
    """Whether an input is to be treated as a constant: it is no function of time and no list of inputs."""
    return not (callable(value) or isinstance(value, list | tuple) or hasattr(value, "breakpoints"))


def check_run(duration: float, rtol: float) -> tuple[float, float]:
    """Return duration (s) and relative tolerance of a run as floats, or raise InputError if one is out of range."""
    hint = "1e-6 gives traces and periods to better than 1e-5"
    return check_duration(duration), checks.between("rtol", rtol, 1e-13, 1e-1, hint=hint)


def check_times(times: ArrayLike, duration: float, name: str = "times") -> Array:
    """Return the output times in s, shape (n,); InputError unless they increase and lie in [0, duration]."""
    wanted = checks.array(name, times, increasing=True, hint="times are in s")
    for k in (0, -1):
        hint = f"they must lie between 0 and the duration of {duration:g} s"
        checks.between(f"{name}[{k}]", wanted[k], 0, duration * (1 + 1e-12), unit="s", hint=hint)
    return wanted


def datasets(name: str, given: Any) -> tuple[xr.Dataset, ...]:
    """Return one Dataset or several as a tuple; InputError, with ``name``, for an empty list or another type."""
    found = checks.instances(name, [given] if isinstance(given, xr.Dataset) else given, xr.Dataset)
    if not found:
        raise InputError(f"{name} is empty; give one Dataset, or a list of them")
    return found


def noises(noise: float | Sequence[float] | None, count: int) -> list[float | None]:
    """Standard deviation of a sample of each of several records, None where it is to be estimated.

    Raises InputError: numbers that are not positive, or not one or ``count`` of them.
    """
    if noise is None:
        return [None] * count
    sizes = np.atleast_1d(checks.numbers("noise", noise))
    if sizes.size not in (1, count):
        raise InputError(f"noise holds {sizes.size} numbers for {count} records", "give one, or one for each")
    for size in sizes:
        checks.positive("noise", float(size), hint="a standard deviation in the unit of the record")
    return [float(size) for size in np.broadcast_to(sizes, count)]


def check_duration(duration: float) -> float:
    """Return a duration in s, or raise InputError unless it lies between an optical period (1e-15 s) and a second."""
    # 1e-15 s; the equations hold for the envelope of the field, so not within an optical cycle
    return checks.between(
        "duration", duration, 1e-15, LONGEST, unit="s", hint="times are in s (did you mean 20e-6 for 20 us?)"
    )


@contextmanager
def bar(name: str, total: int, show_bar: bool) -> Iterator[Callable[[], None]]:
    """Context manager of a progress bar on standard error: gives the function to call after each of ``total`` steps."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), disable=not checks.flag("show_bar", show_bar)) as drawn:
        task = drawn.add_task(name, total=total)
        yield lambda: drawn.advance(task)
