"""Classify a trace, and measure period, duty cycle and swing of its pulses; the fixed points at which it may rest.

Slow modes may outlast a trace, so that a trace near an unstable fixed point may look like rest for long. Only the
eigenvalues at the fixed point decide whether it is stable.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thermofem import Foster, InputError, OutputMap, checks
from thermofem.arrays import Array
from thermofem.checks import Words
from thermofem.data import quantity
from thermofem.data.variables import contents
from thermofem.ring_temperature import GuidedMode

from ..carriers import law_with
from ..equilibria.steady_states import steady_states
from ..heaters import turned_by
from ..inputs import LONGEST
from ..resonator import RingResonator
from ..thermal import as_read
from .repetition import FAR, SMALL_CHANGE, Train, alternate, amplitude_limit, doubled, goes_on, miss, tops_of, train_of

if TYPE_CHECKING:
    import xarray as xr

TINY = 1e-99  # J and K, of a dark ring
DUTY_LEVEL = 0.45  # of the drop power between its minimum and its maximum; the paper's definition, caption of Fig. 6
QUIET = 1e-4  # relative range of the carriers that is no oscillation (at least ten times rtol)
EIGHTHS = np.linspace([1 / 4, 1 / 8], [1 / 8, 0], 64, axis=1)  # of a trace, before its end: the last but one, the last
FEWEST = 8  # samples of a trace
THINNED = 40  # steps of the integration to one sample: fewer samples may show a slow beat instead of the pulses
LONGER = 10  # times as long, where a trace does not tell how much of it is missing


class Rest(NamedTuple):
    """All fixed points of a ring under one light; the arrays have an entry for each."""

    energy: Array
    """Light energy, J."""
    delta_T: Array
    """Temperature rise, K."""
    growth: Array
    """Largest real part of the eigenvalues, 1/s."""

    def nearest(self, energy: float, delta_T: float) -> tuple[int, float]:
        """Return the index of the fixed point nearest to a state, and the larger relative error of energy and rise."""
        points = np.array([self.energy, self.delta_T])
        state = np.array([[energy], [delta_T]])
        scale = np.maximum(np.abs(points), np.abs(state) + TINY)
        errors = (np.abs(points - state) / scale).max(axis=0)
        return int(errors.argmin()), float(errors.min())


def rest_of_run(run: xr.Dataset) -> Rest | None:
    """Return the fixed points under the light at the end of a run; None where its attributes do not determine them.

    This is so for traces that are not of `simulate`, for quadratic models, and for several lasers.
    """
    attrs = run.attrs
    if "lasers" in attrs:
        return None
    try:
        ring = ring_in(attrs["ring_parameters"])
        rise = float(attrs.get("heater_rise", 0.0))
        power = _at_end(run, "input_power")
        detuning = _at_end(run, "detuning") + turned_by(rise, ring)
        model: Any = Foster(np.atleast_1d(attrs["model_R"]), np.atleast_1d(attrs["model_tau"]))
        if "model_coefficient" in attrs:
            model = OutputMap(model, attrs["model_coefficient"])
        if power == 0:
            return Rest(np.zeros(1), np.array([rise]), np.array([-np.inf]))
        points = steady_states(as_read(ring, model), model, power=power, detuning=detuning)
        return Rest(points["energy"].values, points["delta_T"].values + rise, points["growth_rate"].values)
    except (InputError, ValueError, TypeError, KeyError, OverflowError, RecursionError):
        return None  # attributes that another program wrote


def _at_end(run: xr.Dataset, name: str) -> float:
    """Return a quantity of the light at the end of a run, from its trace or else its attribute."""
    return float(run[name].values[-1] if name in run.variables else run.attrs[name])


def ring_in(text: str) -> RingResonator:
    """Return the ring from the JSON text that `resonator.origin` wrote."""
    fields = json.loads(text)
    law = law_with(fields["carriers"])
    pairs = {name: tuple(tuple(pair) for pair in fields[name]) for name in ("fcd", "rates")}
    mode = GuidedMode(*fields["mode"]) if fields["mode"] else None
    return RingResonator(**fields | pairs | {"carriers": law(**fields["carriers"]), "mode": mode})


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
    light = "energy" if "ring" in run.coords else "drop"  # the drop power of a ring is its energy times a constant
    run = contents("run", run, ("time", "carriers", light, "delta_T"), what="a Dataset from coupled.simulate")
    if run.sizes.get("ring"):
        names = run["ring"].values
        raise InputError(f"run holds {names.size} rings; pick one of them, run.sel(ring={str(names[0])!r})")
    t = _values(run, "time")
    N = _values(run, "carriers")
    drop = _values(run, light)
    dT = _values(run, "delta_T")
    if not drop.any() and "energy" in run.variables:
        drop = _values(run, "energy")
    steps = checks.integer("run.attrs['steps']", run.attrs.get("steps", 0), 0, 1e18)
    if steps > THINNED * t.size:
        raise InputError(
            f"run has {t.size} samples of {steps} steps; the sampling is too coarse to tell pulses from their beat: "
            f"ask for {steps // THINNED} times or more, or for none, which keeps every step"
        )
    rtol = checks.between("run.attrs['rtol']", run.attrs.get("rtol", 0), 0, 1)
    result = classify(t, N, drop, dT, rtol=rtol, every_step=t.size - 1 == steps)
    until = checks.between("run.attrs['driven_until']", run.attrs.get("driven_until", 0), 0, np.inf, unit="s")
    if until > (t[0] + t[-1]) / 2:
        return _driven(result, until)
    if result.regime == Regime.SELF_PULSING:
        return warming(result, run, t, dT)
    if result.regime != Regime.STABLE:
        return result
    energy = _values(run, "energy") if "energy" in run.variables else drop
    return lasting(result, t, energy, dT, rest_of_run(run))


def _driven(answer: Pulsing, until: float) -> Pulsing:
    """Return a trace whose light or heaters vary up to the time ``until`` in s, as ``answer`` describes it."""
    words = answer.reason.removesuffix(_advice(answer.suggested_duration))  # a longer run has a longer drive
    if answer.regime == Regime.SELF_PULSING:
        words = f"{answer.cycles} cycles in the answer"
    reason = f"light or heaters vary up to {quantity.rounded(until, 's', 3)}: {words}"
    return replace(answer, regime=Regime.DRIVEN, reason=reason, suggested_duration=float("nan"))


def lasting(stable: Pulsing, t: Array, energy: Array, dT: Array, rest: Rest | None) -> Pulsing:
    """Return the ``stable`` trace; a slow transient if its fixed point is unstable or not yet reached."""
    if rest is None:
        reason = f"{stable.reason}, as far as the trace alone tells: slow heat may start pulses yet"
        return replace(stable, reason=reason)
    passed = float(t[-1] - t[0])
    last = np.linspace(t[-1] - passed / 8, t[-1], 64)
    last_energy = float(np.interp(last, t, energy).mean())
    last_rise = float(np.interp(last, t, dT).mean())
    k, off = rest.nearest(last_energy, last_rise)
    growth = float(rest.growth[k])
    if not growth < 0:
        which = "the fixed point there is not" if np.any(rest.growth < 0) else "no fixed point is"
        # in 20 e-foldings what is left of a transient, some 1e-9, becomes as large as the ring allows
        duration = max(LONGER * passed, passed + 20 / max(growth, 1e-300))
        return _slow(f"{stable.reason}, but {which} stable", duration, stable.swing, stable.cycles)
    if off <= SMALL_CHANGE:
        return stable
    missing = np.log(off / (0.1 * SMALL_CHANGE)) / -growth
    reason = f"{stable.reason}, but slow heat still moves the ring: {last_rise:.3g} K of {rest.delta_T[k]:.3g} K"
    return _slow(reason, passed + max(passed, missing), stable.swing, stable.cycles)


def warming(pulses: Pulsing, run: xr.Dataset, t: Array, dT: Array) -> Pulsing:
    """Return a self-pulsing result, with a note where the mean rise of the last cycle has not reached its final value.

    The final value for a linear model is <dT> = R_th <P> over a cycle, whatever its time constants; tolerance 2 %.
    """
    several = {"model_coefficient", "heater_rise", "lasers"} & {*run.attrs}
    if several or "model_R" not in run.attrs or "absorbed" not in run.variables:
        return pulses
    last = np.append(t[-1] - pulses.period, t[t > t[-1] - pulses.period])
    absorbed = np.trapezoid(np.interp(last, t, _values(run, "absorbed")), last)
    rise = np.trapezoid(np.interp(last, t, dT), last)
    resistances = checks.array("run.attrs['model_R']", np.ravel(run.attrs["model_R"]))
    final = float(resistances.sum()) * absorbed
    if not abs(rise - final) > SMALL_CHANGE * final:
        return pulses
    note = f"the mean rise is {rise / final:.0%} of what the absorbed power leads to, so slow heat will move the period"
    return replace(pulses, reason=f"{pulses.reason}; {note}: limit_cycle has the settled one")


def classify(t: Array, N: Array, drop: Array, dT: Array, *, rtol: float = 0.0, every_step: bool = False) -> Pulsing:
    """Classify a trace given as arrays of time (s), carriers, drop power and temperature rise (K), as `pulsing` does.

    A ring without carriers is judged by its drop power. ``rtol``: tolerance with which the arrays were computed;
    ``every_step``: whether they are the accepted steps of an integration, which are as dense as the trace needs.
    """
    N, what = (N, "carriers") if N.any() else (drop, "photons")
    middle = (t[0] + t[-1]) / 2
    swing = float(np.ptp(dT[t >= middle]))
    noise = min(max(QUIET, 10 * rtol), SMALL_CHANGE)
    for share in (1 / 2, 1 / 4):  # a slow drift may hide a small oscillation
        begin = t[-1] - share * (t[-1] - t[0])
        late = N[t >= begin]
        low = late.min()
        high = late.max()
        if high - low <= noise * high:
            return Pulsing(Regime.STABLE, f"the {what} are constant over the last {share:.0%}", swing=swing)
        rises = crossings(t, N, (low + high) / 2)
        if goes_on(rises, t[-1]):
            train = train_of(t, N, rises, every_step)
            return _oscillating(train, t, drop, dT, noise=noise, swing=swing)
    return _under_way(t, N, what, swing, max(rises.size - 1, 0))


def _oscillating(train: Train, t: Array, drop: Array, dT: Array, *, noise: float, swing: float) -> Pulsing:
    """Classify a trace that oscillates until its end. ``swing`` [K]: of the second half, unless it pulses."""
    heights = train.heights
    cycles = heights.size
    pattern = train.pattern()
    tops = tops_of(heights, pattern)
    limit = amplitude_limit(tops)
    # an oscillation whose limit is below a fifth of its last amplitude decays to rest
    if limit < 0.2 * tops[-1]:
        reason = f"{cycles} cycles of an oscillation that dies away"
        return Pulsing(Regime.STABLE, reason, swing=swing, cycles=cycles)
    duration = _until_settled(tops, float(t[-1] - t[0]))
    reaches = abs(limit / tops[-1] - 1) <= train.close
    if not reaches or tops[-1] < (1 - train.close) * tops[-2:].max():
        reason = f"{cycles} cycles of an oscillation still falling, to where is not clear"
        return _slow(reason, duration, swing, cycles)
    if pattern == 1 and alternate(heights, train.close):
        reason = f"{cycles} cycles of unequal pulses, too few to tell whether they repeat"
        return _slow(reason, duration, swing, cycles)
    if pattern == 1 and doubled(heights, max(10 * noise, train.missed)):
        pattern = 2
    earlier, drift = train.drifts(pattern)
    if abs(drift) > train.largest_drift(earlier, drift, pattern):
        reason = f"{cycles} cycles, whose length changes by {100 * drift:+.2g} % from one to the next"
        reason += f", after {100 * earlier:+.2g} %" if abs(drift) <= FAR and earlier else ""
        return _slow(reason, duration, swing, cycles)
    reason = f"{cycles} cycles of {_trend(tops, limit, train.close)} amplitude"
    reason += f", in a pattern of {pattern}" if pattern > 1 else ""
    reason += _unsettled(miss(heights, train.waits, pattern), drift, noise)
    reason += _errors(train.samples)
    return _last_cycle(train, t, drop, dT, reason, pattern, drift)


def _trend(tops: Array, limit: float, close: float) -> str:
    change = limit / tops[tops.size // 3] - 1
    if abs(change) < close:
        return "steady"
    return "growing" if change > 0 else "falling"


def _unsettled(unequal: float, drift: float, noise: float) -> str:
    """Say what still changes: ``unequal`` [1], cycles from one to the next; ``drift`` [1], their length."""
    changes = []
    if 10 * noise < unequal < np.inf:
        changes.append(f"cycles differ by {100 * unequal:.2g} %")
    # a relative change of the period below 1e-5 from cycle to cycle counts as none
    if abs(drift) > 1e-5:
        changes.append(f"the period {'grows' if drift > 0 else 'falls'} by {100 * abs(drift):.2g} % per cycle")
    return f"; not settled: {', '.join(changes)}" if changes else ""


def _errors(samples: float) -> str:
    """Say the largest errors that so many samples per cycle cause (measured)."""
    # the duty errs by up to 3.2 over the number of samples of a cycle (measured)
    if samples > 320:
        return ""
    period = f"period within {50 / samples:.1g} %"
    duty = f"duty within {3.2 / samples:.1g}"
    swing = f"swing within {150 / samples:.1g} %"
    return f", {samples:.0f} samples a cycle: {period}, {duty}, {swing}"


def _last_cycle(train: Train, t: Array, drop: Array, dT: Array, reason: str, pattern: int, drift: float) -> Pulsing:
    """Measure the last cycle, or the last pattern, of a self-pulsing trace."""
    begin = float(train.rises[-1 - pattern])
    end = float(train.rises[-1])
    last = (t >= begin) & (t <= end)
    low = drop[last].min()
    high = drop[last].max()
    return Pulsing(
        Regime.SELF_PULSING,
        reason,
        period=end - begin,
        duty=_duty(t, drop, begin, end),
        swing=float(np.ptp(dT[last])),
        cycles=train.heights.size,
        extinction=float(10 * np.log10(high / low)) if low > 0 else float("inf"),
        pattern=pattern,
        drift=drift,
    )


def _until_settled(tops: Array, passed: float) -> float:
    """Suggest a duration in s after which geometrically converging amplitudes are settled: 2 to 50 ``passed``."""
    steps = np.abs(np.diff(tops[-3:]))
    if steps.size < 2 or not 0 < steps[-1] < steps[0]:
        return LONGER * passed
    missing = np.log(0.1 * SMALL_CHANGE * tops[-1] / max(steps[-1], 1e-300))
    cycles = missing / np.log(steps[-1] / steps[0])
    times = min(max(1 + cycles / tops.size, 2.0), 50.0)
    return float(f"{passed * times:.1e}")


def crossings(t: Array, x: Array, level: float) -> Array:
    """Return the times at which ``x`` rises through ``level``, by bisection on the cubic through four samples.

    t, x [shape (n,), n >= 4]: times, increasing, and values.
    """
    before = np.flatnonzero((x[:-1] < level) & (x[1:] >= level))
    first = np.clip(before - 1, 0, t.size - 4)
    i = first[:, None] + np.arange(4)
    s = t[i].T
    v = x[i].T - level
    a, b, c = np.diff(v, axis=0) / np.diff(s, axis=0)  # divided differences
    ab = (b - a) / (s[2] - s[0])
    bc = (c - b) / (s[3] - s[1])
    abc = (bc - ab) / (s[3] - s[0])
    left = t[before]
    right = t[before + 1]
    for _ in range(32):  # to 2e-10 of a sample
        middle = 0.5 * (left + right)
        value = v[0] + (middle - s[0]) * (a + (middle - s[1]) * (ab + (middle - s[2]) * abc))
        below = value < 0
        left = np.where(below, middle, left)
        right = np.where(below, right, middle)
    return 0.5 * (left + right)


def _duty(t: Array, drop: Array, begin: float, end: float) -> float:
    """Return the fraction of [begin, end] with the drop power above min + 0.45 (max - min)."""
    first, last = np.searchsorted(t, [begin, end])
    cycle = drop[first:last]
    level = cycle.min() + DUTY_LEVEL * np.ptp(cycle)
    around = slice(max(first - 3, 0), last + 3)
    t = t[around]
    drop = drop[around]
    edges = np.concatenate([crossings(t, drop, level), crossings(t, -drop, -level)])
    inside = edges[(edges > begin) & (edges < end)]
    edges = np.sort(np.concatenate([[begin, end], inside]))
    middles = (edges[1:] + edges[:-1]) / 2
    above = np.interp(middles, t, drop) > level
    return float(np.sum(np.diff(edges)[above]) / (end - begin))


def _under_way(t: Array, N: Array, what: str, swing: float, cycles: int) -> Pulsing:
    """Classify a trace with fewer than two cycles, or whose oscillation has ended, as stable or as a slow transient."""
    passed = t[-1] - t[0]
    duration = float(LONGER * passed)
    top = N[t >= t[-1] - passed / 4].max()
    change = _left_to_change(t, N) / top
    if change <= SMALL_CHANGE:
        earlier, later = np.ptp(np.interp(t[-1] - passed * EIGHTHS, t, N), axis=1)
        # a movement of 1e-3, ten times `QUIET`, counts where it was smaller before
        if later > max(earlier, 1e-3 * top):
            return _slow(f"a movement of the {what} that grows instead of dying away", duration, swing, cycles)
        words = f"in the last quarter of the run the {what} change by {100 * change:.1g} % only"
        return Pulsing(Regime.STABLE, words, swing=swing, cycles=cycles)
    count = "no complete cycle"
    if cycles:
        count = f"{cycles} complete cycle{'s' if cycles != 1 else ''} and no more"
    return _slow(f"{count}, yet still moving", duration, swing, cycles)


def _left_to_change(t: Array, N: Array) -> float:
    """Return the range of N in the last quarter of a trace, and what an exponential through its eighths has left."""
    passed = t[-1] - t[0]
    tail = N[t >= t[-1] - passed / 4]
    before, after = np.diff(np.interp(t[-1] - passed * np.array([1 / 4, 1 / 8, 0]), t, N))
    ratio = np.clip(after / before, 0, 0.95) if before else 0.0
    return float(np.ptp(tail) + abs(after) * ratio / (1 - ratio))


def _slow(reason: str, duration: float, swing: float, cycles: int) -> Pulsing:
    """Return a slow transient with the suggested ``duration`` in s, at most `inputs.LONGEST`."""
    duration = min(duration, LONGEST)
    reason += _advice(duration)
    return Pulsing(Regime.SLOW_TRANSIENT, reason, swing=swing, cycles=cycles, suggested_duration=duration)


def _advice(duration: float) -> str:
    return f": simulate {quantity.rounded(duration, 's', 2)}"


def _values(run: xr.Dataset, name: str) -> Array:
    """Return one variable of a run as a checked array."""
    values = checks.array(f"run.{name}", run[name].values, increasing=name == "time")
    checks.enough(f"run.{name}", values.size, FEWEST)
    return values
