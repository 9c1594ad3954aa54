"""Does a trace pulse, and how: regime, period, duty cycle and swing."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from thermofem import checks

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

DUTY_LEVEL = 0.45  # of the drop power between its minimum and its maximum; the paper's definition, caption of Fig. 6
QUIET = 1e-4  # relative range of the carriers that is no oscillation (at least ten times rtol)
SETTLED = 0.02  # relative change of an amplitude, or of the carriers at the end, that counts as none
GONE, LEFT = 0.2, 0.8  # shares of the last amplitude: heading for less, it dies away; for more, it goes on
FINE = 12  # samples that a cycle needs at least
THINNED = 40  # steps of the integration to one sample: fewer samples may show a slow beat instead of the pulses
LONGEST_PATTERN = 4  # unequal pulses that repeat together


class Regime(StrEnum):
    """What a trace does at its end."""

    SELF_PULSING = "self-pulsing"
    STABLE = "stable"
    SLOW_TRANSIENT = "slow transient"


@dataclass(frozen=True)
class Pulsing:
    """What `pulsing` found.

    Attributes
    ----------
    regime : Regime
        equal to "self-pulsing", "stable" or "slow transient".
    reason : str
        why, in words.
    period : float, s
        of the last cycle, or of the last pattern where unequal pulses alternate; nan unless it pulses.
    duty : float
        fraction of the last cycle with the drop power above min + 0.45 (max - min); nan unless it pulses.
    swing : float, K
        largest minus smallest temperature rise in the last cycle; in the last half of the trace unless it pulses.
    cycles : int
        complete cycles in the trace.
    extinction : float, dB
        largest to smallest drop power of the last cycle; nan unless it pulses.
    pattern : int
        pulses in a period: 1, or more where large and small ones alternate.
    """

    regime: Regime
    reason: str
    period: float
    duty: float
    swing: float
    cycles: int
    extinction: float = float("nan")
    pattern: int = 1


def pulsing(run: xr.Dataset) -> Pulsing:
    """Classify a trace of `simulate` by its carriers and measure its last cycle.

    Cycles are counted where the carriers rise through the middle of their range, since the drop power has two maxima a
    cycle. The trace pulses if it has two complete cycles, goes on to its end, and its amplitude does not head for zero;
    it is a slow transient if it is still under way, for instance within a period longer than the trace.

    Parameters
    ----------
    run : xarray.Dataset
        time (s), carriers (1/m^3), drop (W) and delta_T (K), at 8 times or more. A ring without a drop port is judged
        by its energy instead.

    Returns
    -------
    Pulsing

    Raises
    ------
    InputError
        a variable is missing, the trace is too short, or its samples are too far apart to show its cycles.

    Measured on accepted steps at rtol = 1e-6 against 1e-10, six rings: period to 2e-7, duty to 5e-5, swing to 6e-5.

    Source of the duty cycle: Borghi et al., Opt. Express 29, 4363 (2021), caption of Fig. 6.
    """
    t, N, drop, dT = (_values(run, name) for name in ("time", "carriers", "drop", "delta_T"))
    if not drop.any() and "energy" in run.variables:
        drop = _values(run, "energy")
    steps = int(run.attrs.get("steps", 0))
    if steps > THINNED * t.size:
        raise checks.InputError(
            f"run has {t.size} samples of {steps} steps; the sampling is too coarse to tell pulses from their beat: "
            f"ask for {steps // THINNED} times or more, or for none, which keeps every step"
        )
    rtol = float(run.attrs.get("rtol", 0))
    return classify(t, N, drop, dT, rtol=rtol, every_step=steps == t.size - 1)


def classify(t: Array, N: Array, drop: Array, dT: Array, *, rtol: float = 0.0, every_step: bool = False) -> Pulsing:
    """The same for arrays: time (s), carriers, drop power and temperature rise (K).

    ``rtol`` is the tolerance behind them; ``every_step`` says that they are the accepted steps of an integration, which
    are as dense as the trace needs.
    """
    swing = float(np.ptp(dT[t >= (t[0] + t[-1]) / 2]))
    noise = min(max(QUIET, 10 * rtol), SETTLED)
    for share in (1 / 2, 1 / 4):  # a slow drift may hide a small oscillation
        late = N[t >= t[-1] - share * (t[-1] - t[0])]
        if np.ptp(late) <= noise * late.max():
            return _quiet(Regime.STABLE, f"the carriers are constant over the last {share:.0%}", swing)
        up = crossings(t, N, (late.min() + late.max()) / 2)
        waits = np.diff(up, append=t[-1])  # the last one is still running
        if up.size >= 3 and waits[-2] <= 1.5 * waits[-6:-2].max() and waits[-1] <= 1.5 * waits[-6:-1].max():
            break
    else:
        return _under_way(t, N, swing, max(up.size - 1, 0))
    edges = np.searchsorted(t, up)
    samples = float(np.median(np.diff(edges)))
    if samples < FINE and not every_step:
        raise checks.InputError(f"a cycle has {samples:.0f} samples; the sampling is too coarse, {FINE} are needed")
    heights = np.array([np.ptp(N[i:j]) for i, j in pairwise(edges)])
    together = pattern(heights, waits[:-1])
    tops = heights[heights.size % together :].reshape(-1, together).max(axis=1)
    limit, seen = amplitude_limit(tops), f"{heights.size} cycles of "
    if limit < GONE * tops[-1]:
        return _quiet(Regime.STABLE, seen + "an oscillation that dies away", swing, heights.size)
    if not limit >= LEFT * tops[-1]:
        words = seen + "an oscillation still falling, to where is not clear: simulate longer"
        return _quiet(Regime.SLOW_TRANSIENT, words, swing, heights.size)
    change = limit / tops[tops.size // 3] - 1
    begin, end = float(up[-1 - together]), float(up[-1])
    last = (t >= begin) & (t <= end)
    low, high = drop[last].min(), drop[last].max()
    return Pulsing(
        Regime.SELF_PULSING,
        seen
        + ("steady" if abs(change) < SETTLED else "growing" if change > 0 else "still falling")
        + " amplitude"
        + (f", in a pattern of {together}" if together > 1 else "")
        + (", whose period still changes" if abs(waits[-2] / waits[-2 - together] - 1) > SETTLED else ""),
        period=end - begin,
        duty=_duty(t, drop, begin, end),
        swing=float(np.ptp(dT[last])),
        cycles=heights.size,
        extinction=float(10 * np.log10(high / low)) if low > 0 else float("inf"),
        pattern=together,
    )


def pattern(heights: Array, waits: Array) -> int:
    """How many cycles repeat together: the smallest number after which heights and lengths return, or 1 if none does.

    Three repetitions are needed, so that a drift is no pattern.
    """
    for together in range(1, LONGEST_PATTERN + 1):
        if heights.size < 3 * together:
            return 1
        if all(
            np.all(np.abs(x[-2 * together :] - x[-3 * together : -together]) <= SETTLED * x[-3 * together :].max())
            for x in (heights, waits)
        ):
            return together
    return 1


def crossings(t: Array, x: Array, level: float) -> Array:
    """Times at which ``x`` rises through ``level``, on the cubic through the four samples around each.

    Parameters
    ----------
    t, x : array, shape (n,), n >= 4
        times, increasing, and values.
    level : float
    """
    from .kernels.levels import rises

    return np.asarray(rises(np.ascontiguousarray(t), np.ascontiguousarray(x), float(level), 1.0))


def amplitude_limit(heights: Array) -> float:
    """Where a sequence of amplitudes is heading: C for ``C + A r^k``, from the means of three blocks of equal length.

    The blocks cover the last two thirds, so the cold start does not count. The last amplitude where nothing is lost, or
    so little that it says nothing about the end; nan where the fall does not slow down as one towards rest does, which
    is so past an unstable cycle, and may end at rest or in a smaller cycle.
    """
    length = max(2 * heights.size // 9, 1)
    if heights.size < 3:
        return float(heights[-1]) if heights[-1] > (1 - SETTLED) * heights[0] else 0.0
    first, middle, last = heights[-3 * length :].reshape(3, length).mean(axis=1)
    if last > (1 - SETTLED) * first:
        return float(heights[-1])
    curvature = (last - middle) - (middle - first)
    limit = float(last - (last - middle) ** 2 / curvature) if curvature > 0 else -np.inf
    if limit > -last:
        return max(limit, 0.0)
    return float(heights[-1]) if last > 0.9 * first else float("nan")


def _duty(t: Array, drop: Array, begin: float, end: float) -> float:
    """Fraction of [begin, end] with the drop power above min + 0.45 (max - min)."""
    first, last = np.searchsorted(t, [begin, end])
    level = drop[first:last].min() + DUTY_LEVEL * np.ptp(drop[first:last])
    near = slice(max(first - 3, 0), last + 3)
    t, drop = t[near], drop[near]
    edges = np.concatenate([crossings(t, drop, level), crossings(t, -drop, -level)])
    edges = np.sort(np.concatenate([[begin, end], edges[(edges > begin) & (edges < end)]]))
    above = np.interp((edges[1:] + edges[:-1]) / 2, t, drop) > level
    return float(np.sum(np.diff(edges)[above]) / (end - begin))


def _under_way(t: Array, N: Array, swing: float, cycles: int) -> Pulsing:
    """A trace with fewer than two cycles, or whose cycles have ended: at rest, or still moving."""
    tail = N[t >= t[-1] - (t[-1] - t[0]) / 4]
    before, after = np.diff(np.interp(t[-1] - (t[-1] - t[0]) * np.array([1 / 4, 1 / 8, 0]), t, N))
    ratio = np.clip(after / before, 0, 0.95) if before else 0.0
    change = float((np.ptp(tail) + abs(after) * ratio / (1 - ratio)) / tail.max())  # with what an exponential has left
    if change <= SETTLED:
        words = f"settled: from the last quarter on the carriers move by {100 * change:.1g} %"
        return _quiet(Regime.STABLE, words, swing, cycles)
    seen = f"{cycles} complete cycle{'s' if cycles != 1 else ''} and no more" if cycles else "no complete cycle"
    return _quiet(Regime.SLOW_TRANSIENT, f"{seen}, yet still moving: simulate longer", swing, cycles)


def _quiet(regime: Regime, reason: str, swing: float, cycles: int = 0) -> Pulsing:
    return Pulsing(regime, reason, float("nan"), float("nan"), swing, cycles)


def _values(run: xr.Dataset, name: str) -> Array:
    """One variable as an array."""
    if name not in getattr(run, "variables", {}):
        raise checks.InputError(f"run has no variable {name!r}; give a Dataset from coupled.simulate")
    values = checks.array(f"run.{name}", run[name].values, increasing=name == "time")
    if values.size < 8:
        raise checks.InputError(f"run.{name} has {values.size} samples; at least 8 are needed to tell a cycle")
    return values
