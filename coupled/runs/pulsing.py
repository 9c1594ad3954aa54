"""Classify a trace, and measure period, duty cycle and swing of its pulses."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from thermofem import checks
from thermofem.arrays import Array
from thermofem.checks import Words
from thermofem.data import quantity
from thermofem.data.variables import contents

from ..arguments import LONGEST
from .repetition import FAR, LONGEST_PATTERN, SETTLED, alternate, amplitude_limit, blur, doubled, miss, top_of
from .resting import Rest, rest_of_run

if TYPE_CHECKING:
    import xarray as xr

DUTY_LEVEL = 0.45  # of the drop power between its minimum and its maximum; the paper's definition, caption of Fig. 6
QUIET = 1e-4  # relative range of the carriers that is no oscillation (at least ten times rtol)
EIGHTHS = np.linspace([1 / 4, 1 / 8], [1 / 8, 0], 64, axis=1)  # of a trace, before its end: the last but one, the last
GROWS = 1e-3  # relative movement of the carriers in the last eighth that counts where it was smaller before: 10 QUIET
STEADY_PERIOD = 1e-5  # relative change of the period from cycle to cycle that counts as none
GONE = 0.2  # share of the last amplitude: an oscillation whose limit is smaller decays to rest
FEWEST = 8  # samples of a trace
FINE = 12  # samples that a cycle needs at least
CLEAR = 320  # samples of a cycle that show the duty to 0.01: it errs by up to 3.2 over their number (measured)
THINNED = 40  # steps of the integration to one sample: fewer samples may show a slow beat instead of the pulses
LEAVES = 20  # e-foldings in which what is left of a transient, some 1e-9, becomes as large as the ring allows
LONGER = 10  # times as long, where a trace does not tell how much of it is missing


class Regime(Words):
    """The behaviour of a trace at its end."""

    SELF_PULSING = "self-pulsing"
    STABLE = "stable"
    SLOW_TRANSIENT = "slow transient"
    DRIVEN = "driven"
    """Power, detuning or a heater varies in the second half of the trace, which is the response to it."""


@dataclass(frozen=True)
class Pulsing:
    """Result of `pulsing`.

    Attributes
    ----------
    regime : Regime
        equal to "self-pulsing", "stable", "slow transient" or "driven".
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
        pulses in a period: 1, or more where large and small ones alternate. Two that differ by 0.1 to 2 % count as a
        pattern where the difference has not decayed over five cycles; below 0.1 % only the multipliers of
        `limit_cycle` can show it.
    drift : float
        relative change of the period in the last cycle, T_n/T_(n-1) - 1; nan unless it pulses. `limit_cycle` computes
        the settled period.
    suggested_duration : float, s
        length of a run that should show how a slow transient ends; nan for others.
    """

    regime: Regime
    reason: str
    period: float = float("nan")
    duty: float = float("nan")
    swing: float = float("nan")
    cycles: int = 0
    extinction: float = float("nan")
    pattern: int = 1
    drift: float = float("nan")
    suggested_duration: float = float("nan")


def pulsing(run: xr.Dataset) -> Pulsing:
    """Classify a trace of `simulate` by its carriers and measure its last cycle.

    A cycle begins where the carriers rise through the middle of their range, because the drop power has two maxima per
    cycle. The trace is self-pulsing if it has two complete cycles, oscillates until its end, and its amplitude does not
    fall. It is a slow transient if the oscillation still decays, if the last change of the carriers grows, if the
    period changes by more than a tenth from cycle to cycle (by more than 2 % where this change grows per cycle),
    or if the trace is shorter than two periods.
    It is stable if it rests, or its oscillation dies away, within 2 % of a stable fixed point of the ring, the heat and
    the light that its attributes name; farther away, or next to an unstable one, it is a slow transient. Traces without
    these attributes (measured ones, co-simulations, several lasers, quadratic models) do not show whether slow heat
    starts pulses later: the reason says so; use `steady_states` or a longer run.
    A run whose light or heaters vary in its second half is driven. The period is that of the last cycle of a transient;
    ``drift`` is its change, and the reason says where the mean rise is more than 2 % from its final value.
    Samples chosen with ``times`` may miss the tops of the pulses: with fewer than 320 a cycle the reason states the
    errors that they may cause, and pulses that differ by no more than these count as equal.

    Parameters
    ----------
    run : xarray.Dataset
        time (s), carriers (1/m^3), drop (W) and delta_T (K), at 8 times or more. A ring without a drop port is judged
        by its energy instead, and so is one ring of a circuit, ``run.sel(ring="ring 1")``. A ring without carriers, as
        without two-photon absorption, is judged by its light alone.

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
    checks.has("run", run, "coords", hint="a Dataset from coupled.simulate is needed")
    of_circuit = "ring" in run.coords  # the drop power of a ring is its energy times a constant
    needed = ("time", "carriers", "energy" if of_circuit else "drop", "delta_T")
    run = contents("run", run, needed, what="a Dataset from coupled.simulate")
    if run.sizes.get("ring"):
        names = run["ring"].values
        raise checks.InputError(f"run holds {names.size} rings; pick one of them, run.sel(ring={str(names[0])!r})")
    t, N, drop, dT = (_values(run, name) for name in needed)
    if not drop.any() and "energy" in run.variables:
        drop = _values(run, "energy")
    steps = checks.integer("run.attrs['steps']", run.attrs.get("steps", 0), 0, 1e18)
    if steps > THINNED * t.size:
        raise checks.InputError(
            f"run has {t.size} samples of {steps} steps; the sampling is too coarse to tell pulses from their beat: "
            f"ask for {steps // THINNED} times or more, or for none, which keeps every step"
        )
    rtol = checks.between("run.attrs['rtol']", run.attrs.get("rtol", 0), 0, 1)
    found = classify(t, N, drop, dT, rtol=rtol, every_step=t.size - 1 == steps)
    until = checks.between("run.attrs['driven_until']", run.attrs.get("driven_until", 0), 0, np.inf, unit="s")
    if until > (t[0] + t[-1]) / 2:
        answer = f"{found.cycles} cycles in the answer" if found.regime == Regime.SELF_PULSING else found.reason
        answer = answer.removesuffix(_advice(found.suggested_duration))  # a longer run has a longer drive
        reason = f"light or heaters vary up to {quantity.rounded(until, 's', 3)}: {answer}"
        return replace(found, regime=Regime.DRIVEN, reason=reason, suggested_duration=float("nan"))
    if found.regime == Regime.SELF_PULSING:
        return warming(found, run, t, dT)
    if found.regime != Regime.STABLE:
        return found
    energy = _values(run, "energy") if "energy" in run.variables else drop
    return lasting(found, t, energy, dT, rest_of_run(run))


def lasting(found: Pulsing, t: Array, energy: Array, dT: Array, rest: Rest | None) -> Pulsing:
    """Return the stable trace ``found``; a slow transient if its fixed point is unstable or not yet reached."""
    if rest is None:
        return replace(found, reason=f"{found.reason}, as far as the trace alone tells: slow heat may start pulses yet")
    passed = float(t[-1] - t[0])
    last = np.linspace(t[-1] - passed / 8, t[-1], 64)
    here = [float(np.interp(last, t, values).mean()) for values in (energy, dT)]
    k, off = rest.nearest(*here)
    growth = float(rest.growth[k])
    if growth < 0:
        wanted = passed + max(passed, np.log(max(off, SETTLED) / (0.1 * SETTLED)) / -growth)
        words = f"{found.reason}, but slow heat still moves the ring: {here[1]:.3g} K of {rest.delta_T[k]:.3g} K"
        return found if off <= SETTLED else _slow(words, wanted, found.swing, found.cycles)
    which = "the fixed point there is not" if np.any(rest.growth < 0) else "no fixed point is"
    wanted = max(LONGER * passed, passed + LEAVES / max(growth, 1e-300))
    return _slow(f"{found.reason}, but {which} stable", wanted, found.swing, found.cycles)


def warming(found: Pulsing, run: xr.Dataset, t: Array, dT: Array) -> Pulsing:
    """Return a self-pulsing result, with a note where the mean rise of the last cycle has not reached its final value.

    The final value for a linear model is <dT> = R_th <P> over a cycle, whatever its time constants; tolerance 2 %.
    """
    several = {"model_coefficient", "heater_rise", "lasers"} & {*run.attrs}
    if several or "model_R" not in run.attrs or "absorbed" not in run.variables:
        return found
    last = np.append(t[-1] - found.period, t[t > t[-1] - found.period])
    absorbed = np.trapezoid(np.interp(last, t, _values(run, "absorbed")), last)
    rise = np.trapezoid(np.interp(last, t, dT), last)
    final = float(checks.array("run.attrs['model_R']", np.ravel(run.attrs["model_R"])).sum()) * absorbed
    if not abs(rise - final) > SETTLED * final:
        return found
    note = f"the mean rise is {rise / final:.0%} of what the absorbed power leads to, so slow heat will move the period"
    return replace(found, reason=f"{found.reason}; {note}: limit_cycle has the settled one")


def classify(t: Array, N: Array, drop: Array, dT: Array, *, rtol: float = 0.0, every_step: bool = False) -> Pulsing:
    """Classify a trace given as arrays of time (s), carriers, drop power and temperature rise (K), as `pulsing` does.

    A ring without carriers is judged by its drop power. ``rtol``: tolerance with which the arrays were computed;
    ``every_step``: whether they are the accepted steps of an integration, which are as dense as the trace needs.
    """
    N, what = (N, "carriers") if N.any() else (drop, "photons")
    swing = float(np.ptp(dT[t >= (t[0] + t[-1]) / 2]))
    noise = min(max(QUIET, 10 * rtol), SETTLED)
    for share in (1 / 2, 1 / 4):  # a slow drift may hide a small oscillation
        late = N[t >= t[-1] - share * (t[-1] - t[0])]
        if np.ptp(late) <= noise * late.max():
            return Pulsing(Regime.STABLE, f"the {what} are constant over the last {share:.0%}", swing=swing)
        up = crossings(t, N, (late.min() + late.max()) / 2)
        waits = np.diff(up, append=t[-1])  # the last one is still running
        if up.size >= 3 and waits[-2] <= 1.5 * waits[-6:-2].max() and waits[-1] <= 1.5 * waits[-6:-1].max():
            break
    else:
        return _under_way(t, N, what, swing, max(up.size - 1, 0))
    edges = np.searchsorted(t, up)
    samples = float(np.median(np.diff(edges)))
    if samples < FINE and not every_step:
        raise checks.InputError(f"a cycle has {samples:.0f} samples; the sampling is too coarse, {FINE} are needed")
    cycles = list(pairwise(edges))
    heights = np.array([top_of(t, N, i, j) - N[i:j].min() for i, j in cycles])
    missed = 0.0 if every_step else blur(N, edges, heights)
    close = SETTLED if every_step else max(SETTLED, missed, 0.5 / samples)
    # the fewest cycles after which heights and lengths return; what settles looks like a pattern of close ones, too
    together = next((n for n in range(1, LONGEST_PATTERN + 1) if miss(heights, waits[:-1], n) <= close), 1)
    tops = heights[heights.size % together :].reshape(-1, together).max(axis=1)
    limit = amplitude_limit(tops)
    seen = f"{heights.size} cycles of "
    if limit < GONE * tops[-1]:
        reason = seen + "an oscillation that dies away"
        return Pulsing(Regime.STABLE, reason, swing=swing, cycles=heights.size)
    wanted = _until_settled(tops, float(t[-1] - t[0]))
    if not abs(limit / tops[-1] - 1) <= close or tops[-1] < (1 - close) * tops[-2:].max():
        return _slow(f"{seen}an oscillation still falling, to where is not clear", wanted, swing, heights.size)
    if together == 1 and alternate(heights, close):
        return _slow(f"{seen}unequal pulses, too few to tell whether they repeat", wanted, swing, heights.size)
    if together == 1 and doubled(heights, max(10 * noise, missed)):
        together = 2
    change = limit / tops[tops.size // 3] - 1
    begin = float(up[-1 - together])
    end = float(up[-1])
    lengths = -np.diff(up[::-together])[::-1]  # of whole patterns, the last one at the end
    *_, earlier, drift = (0.0, 0.0, *(lengths[1:] / lengths[:-1] - 1))
    # while heat settles, the change gets smaller from cycle to cycle; one that grows may end the pulses
    most = max(SETTLED, min(FAR, abs(earlier))) if earlier * drift > 0 else FAR
    unclear = 0.0 if every_step else 1 / samples
    if abs(drift) > max(unclear, most if heights.size > 2 * together else SETTLED):
        words = f"{heights.size} cycles, whose length changes by {100 * drift:+.2g} % from one to the next"
        words += f", after {100 * earlier:+.2g} %" if abs(drift) <= FAR and earlier else ""
        return _slow(words, wanted, swing, heights.size)
    unequal = miss(heights, waits[:-1], together)
    left = [f"cycles differ by {100 * unequal:.2g} %"] if 10 * noise < unequal < np.inf else []
    if abs(drift) > STEADY_PERIOD:
        left.append(f"the period {'grows' if drift > 0 else 'falls'} by {100 * abs(drift):.2g} % per cycle")
    # the largest errors that so many samples per cycle cause (measured)
    errors = f", {samples:.0f} samples a cycle: period within {50 / samples:.1g} %, "
    errors += f"duty within {3.2 / samples:.1g}, swing within {150 / samples:.1g} %"
    last = (t >= begin) & (t <= end)
    low = drop[last].min()
    high = drop[last].max()
    return Pulsing(
        Regime.SELF_PULSING,
        seen
        + ("steady" if abs(change) < close else "growing" if change > 0 else "falling")
        + " amplitude"
        + (f", in a pattern of {together}" if together > 1 else "")
        + (f"; not settled: {', '.join(left)}" if left else "")
        + (errors if samples <= CLEAR and not every_step else ""),
        period=end - begin,
        duty=_duty(t, drop, begin, end),
        swing=float(np.ptp(dT[last])),
        cycles=heights.size,
        extinction=float(10 * np.log10(high / low)) if low > 0 else float("inf"),
        pattern=together,
        drift=float(drift),
    )


def _until_settled(tops: Array, passed: float) -> float:
    """Suggest a duration in s after which geometrically converging amplitudes are settled: 2 to 50 ``passed``."""
    steps = np.abs(np.diff(tops[-3:]))
    ratio = steps[-1] / steps[0] if steps.size == 2 and steps[0] > 0 else 1.0
    if not 0 < ratio < 1:
        return LONGER * passed
    cycles = np.log(0.1 * SETTLED * tops[-1] / max(steps[-1], 1e-300)) / np.log(ratio)
    return float(f"{passed * min(max(1 + cycles / tops.size, 2.0), 50.0):.1e}")


def crossings(t: Array, x: Array, level: float) -> Array:
    """Return the times at which ``x`` rises through ``level``, by bisection on the cubic through four samples.

    t, x [shape (n,), n >= 4]: times, increasing, and values.
    """
    at = np.flatnonzero((x[:-1] < level) & (x[1:] >= level))
    i = np.clip(at - 1, 0, t.size - 4)[:, None] + np.arange(4)
    s, v = t[i].T, x[i].T - level
    a, b, c = np.diff(v, axis=0) / np.diff(s, axis=0)  # divided differences
    ab = (b - a) / (s[2] - s[0])
    bc = (c - b) / (s[3] - s[1])
    abc = (bc - ab) / (s[3] - s[0])
    left, right = t[at], t[at + 1]
    for _ in range(32):  # to 2e-10 of a sample
        middle = 0.5 * (left + right)
        below = v[0] + (middle - s[0]) * (a + (middle - s[1]) * (ab + (middle - s[2]) * abc)) < 0
        left = np.where(below, middle, left)
        right = np.where(below, right, middle)
    return np.asarray(0.5 * (left + right))


def _duty(t: Array, drop: Array, begin: float, end: float) -> float:
    """Return the fraction of [begin, end] with the drop power above min + 0.45 (max - min)."""
    first, last = np.searchsorted(t, [begin, end])
    level = drop[first:last].min() + DUTY_LEVEL * np.ptp(drop[first:last])
    near = slice(max(first - 3, 0), last + 3)
    t, drop = t[near], drop[near]
    edges = np.concatenate([crossings(t, drop, level), crossings(t, -drop, -level)])
    edges = np.sort(np.concatenate([[begin, end], edges[(edges > begin) & (edges < end)]]))
    above = np.interp((edges[1:] + edges[:-1]) / 2, t, drop) > level
    return float(np.sum(np.diff(edges)[above]) / (end - begin))


def _under_way(t: Array, N: Array, what: str, swing: float, cycles: int) -> Pulsing:
    """Classify a trace with fewer than two cycles, or whose oscillation has ended, as stable or as a slow transient."""
    wanted = LONGER * float(t[-1] - t[0])
    tail = N[t >= t[-1] - (t[-1] - t[0]) / 4]
    before, after = np.diff(np.interp(t[-1] - (t[-1] - t[0]) * np.array([1 / 4, 1 / 8, 0]), t, N))
    ratio = np.clip(after / before, 0, 0.95) if before else 0.0
    change = float((np.ptp(tail) + abs(after) * ratio / (1 - ratio)) / tail.max())  # with what an exponential has left
    if change <= SETTLED:
        earlier, later = np.ptp(np.interp(t[-1] - (t[-1] - t[0]) * EIGHTHS, t, N), axis=1)
        if later > max(earlier, GROWS * tail.max()):
            return _slow(f"a movement of the {what} that grows instead of dying away", wanted, swing, cycles)
        words = f"in the last quarter of the run the {what} change by {100 * change:.1g} % only"
        return Pulsing(Regime.STABLE, words, swing=swing, cycles=cycles)
    seen = f"{cycles} complete cycle{'s' if cycles != 1 else ''} and no more" if cycles else "no complete cycle"
    return _slow(f"{seen}, yet still moving", wanted, swing, cycles)


def _slow(reason: str, wanted: float, swing: float, cycles: int) -> Pulsing:
    """Return a slow transient with the suggested duration ``wanted`` in s, at most `arguments.LONGEST`."""
    wanted = min(wanted, LONGEST)
    reason += _advice(wanted)
    return Pulsing(Regime.SLOW_TRANSIENT, reason, swing=swing, cycles=cycles, suggested_duration=wanted)


def _advice(wanted: float) -> str:
    return f": simulate {quantity.rounded(wanted, 's', 2)}"


def _values(run: xr.Dataset, name: str) -> Array:
    """Return one variable of a run as a checked array."""
    values = checks.array(f"run.{name}", run[name].values, increasing=name == "time")
    checks.enough(f"run.{name}", values.size, FEWEST)
    return values
