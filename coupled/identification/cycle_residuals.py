"""Comparison of measured cycles with those of simulated runs: residuals, and reasons to doubt a fit."""

from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import xarray as xr

from thermofem.arrays import Array
from thermofem.data import dataset, quantity
from thermofem.errors import InputError

from ..resonator import RingResonator
from ..runs.pulsing import Regime, crossings, pulsing
from ..runs.repetition import LONGEST_PATTERN, miss
from ..runs.simulate import simulate
from ..thermal import Compact, as_read, without_origin
from ..unknowns import Unknowns
from .box_search import Residuals, at_bound
from .cycles import HARMONICS, NEAR, Cycle, Seen, Target, cycle_of, lag

EARLY, LATE = 5e-9, 1e-9  # s between samples of a free run in its first and second half, or
MOST_RUN_SAMPLES = 50_000  # so many samples in a half
RTOL = 1e-5
NOTED, APART = 1.5, 3.0  # widening, and distance from the forced fit in its deviations, above which a note reports it
REPEATS = 0.03  # relative change of heights and lengths of pulses that repeat


class Stage(NamedTuple):
    """A stage of the fit: harmonics, floors of the deviations of period (relative) and shape (of swing), and steps."""

    harmonics: int
    period: float
    shape: float
    steps: int


STAGES = (
    Stage(6, 1e-2, 2e-2, 12),
    Stage(HARMONICS, 5e-3, 1e-2, 10),
    Stage(HARMONICS, 1e-3, 2e-3, 10),
    Stage(HARMONICS, 3e-5, 2e-4, 12),
)
SOFT = Stage(HARMONICS, 1e-2, 4e-2, 20)  # for a thermal law that cannot reproduce the traces


def free_run(ring: RingResonator, model: Compact, target: Target) -> tuple[xr.Dataset, Cycle]:
    """Simulate the model under the drive of a trace: the run, and its mean cycle in the part that is compared."""
    begin, end = target.window(model)
    middle = (begin + end) / 2
    early = max(EARLY, middle / MOST_RUN_SAMPLES)
    late = max(LATE, (end - middle) / MOST_RUN_SAMPLES)
    times = np.concatenate([np.arange(0.0, middle, early), np.arange(middle + late, end, late)])
    run = simulate(
        as_read(ring, model), without_origin(model), power=target.power, detuning=target.detuning, duration=end,
        times=times, rtol=RTOL,
    )  # fmt: skip
    at = np.linspace(begin, end, int((end - begin) / late))
    return run, cycle_of(at, np.interp(at, run["time"].values, run["drop"].values))


def repeats(run: xr.Dataset) -> bool:
    """Whether a simulated run is periodic or constant at its end."""
    return pulsing(run).regime != Regime.SELF_PULSING or repeat_within(run["time"].values, run["carriers"].values)


def repeat_within(t: Array, N: Array) -> bool:
    """Whether the last pulses of N(t) repeat in height and interval after 1, 2, 3 or 4 pulses, to `REPEATS`."""
    late = t >= t[-1] / 2
    edges = crossings(t, N, (N[late].min() + N[late].max()) / 2)
    heights = np.array([N[i:j].max() for i, j in pairwise(np.searchsorted(t, edges))])
    return min(miss(heights, np.diff(edges), k) for k in range(1, LONGEST_PATTERN + 1)) < REPEATS


def compared(own: Cycle, aim: Seen, stage: Stage, absolute: bool) -> tuple[Array, Cycle]:
    """Residuals over their standard deviations, shape (66,), and the model's cycle, aligned in phase and scale.

    First ln(T_model/T) over hypot(deviation, floor of the stage), then the differences of c_0 and of the real and
    imaginary parts of c_1 to c_32 over hypot(deviation, floor times the swing).
    """
    trace = aim.cycle
    model_pulses, trace_pulses = np.isfinite([own.period, trace.period])
    aligned = own
    if model_pulses and trace_pulses:
        aligned = own.shifted(lag(own.harmonics, trace.harmonics))
    if not absolute:
        model = aligned.harmonics if trace_pulses else aligned.harmonics[:1]
        measured = trace.harmonics[: model.size]
        factor = float(np.vdot(model, measured).real / np.vdot(model, model).real)
        aligned = Cycle(aligned.period, factor * aligned.harmonics)
    counted = np.arange(HARMONICS + 1) <= stage.harmonics
    off = (aligned.harmonics - trace.harmonics) * counted
    level = abs(trace.harmonics[0])
    drift = 0.0
    if trace_pulses:
        # a model at rest counts as one of three times the period
        period = own.period if model_pulses else 3.0 * trace.period
        drift = np.log(period / trace.period) / np.hypot(aim.period_deviation, stage.period)
        scale = np.hypot(aim.deviations, stage.shape * trace.swing)
        scale[0] /= np.sqrt(2)  # the mean square over the cycle is |c_0|^2 + sum |c_k|^2/2
    else:
        # the noise of a trace at rest may hide a swing of 6 % of the mean
        scale = np.full(off.size, 0.06 * level)
        scale[0] = np.hypot(aim.deviations[0], stage.shape * level)
    mean, *pulses = off / scale
    rows = np.array([drift, mean.real])
    return np.concatenate([rows, np.real(pulses), np.imag(pulses)]), aligned


def residuals(what: Unknowns, targets: list[Target], stage: Stage) -> Residuals:
    """The residuals of all traces, shape (66 traces,), as a function of the logarithms of the unknowns."""

    def of(x: Array) -> Array | None:
        rows = []
        try:
            ring, model = what.build(x)
            for target in targets:
                rows.append(compared(free_run(ring, model, target)[1], target.seen, stage, target.absolute)[0])
        except (InputError, RuntimeError):
            return None
        return np.concatenate(rows)

    return of


def comparison(
    ring: RingResonator, model: Compact, targets: list[Target]
) -> tuple[xr.Dataset, xr.Dataset, tuple[str, ...]]:
    """Dataset of errors over trace, Dataset of cycles over trace and phase, and notes on periods not comparable."""
    phase = np.linspace(0, 1, 256, endpoint=False)
    rows = []
    curves = []
    notes = []
    for k, target in enumerate(targets):
        run, own = free_run(ring, model, target)
        trace = target.seen.cycle
        _, aligned = compared(own, target.seen, STAGES[-1], target.absolute)
        curves.append([cycle.curve(phase, smooth=True) for cycle in (trace, aligned)])
        off = aligned.curve(phase) - trace.curve(phase)
        period = aligned.period
        if not repeats(run):
            period = np.nan
            notes.append(f"the pulses of the model of traces[{k}] do not repeat: it has no period there")
        rows.append([target.power, target.detuning, trace.period, period, np.sqrt(np.mean(off**2)) / trace.scale])
    names = ("power", "detuning", "period", "period_model", "shape_error")
    columns = dict(zip(names, np.transpose(rows), strict=True))
    errors = over_traces(columns)
    units = {target.unit for target in targets}
    unit = units.pop() if len(units) == 1 else "unit of the trace"
    about = dataset.describe("drop") if unit == "W" else {"units": unit, "long_name": "drop signal"}
    drawn = np.array(curves)
    cycles = xr.Dataset(
        {name: (("trace", "phase"), drawn[:, k], about) for k, name in enumerate(("drop", "drop_model"))},
        coords={"phase": ("phase", phase, {"units": "1", "long_name": "fraction of the cycle"})},
    )
    return errors, cycles, tuple(notes) or read_apart(columns["period"], columns["period_model"])


def over_traces(columns: Mapping[str, Array]) -> xr.Dataset:
    """A Dataset over trace of drives, periods and numbers of a fit."""
    return xr.Dataset(dataset.variables("trace", columns, power="input_power", period_model="period"))


def doubts(what: Unknowns, spread: Array, values: Array, factor: float, off: float) -> list[str]:
    """Sentences on parameters that are undetermined, on a bound, or uncertain for another reason.

    spread: standard deviations of the logarithms; values [SI]; factor: largest widening by the profile.
    off: distance of the fit from the forced fit, in standard deviations.
    """
    notes = []
    named = list(zip(what.names, spread, strict=True))
    if loose := [name for name, one in named if np.isinf(one)]:
        notes.append(
            f"the traces do not determine {', '.join(loose)}: other values fit as well; give traces of other powers "
            "and detunings, or free fewer"
        )
    notes += [f"{name} is hardly determined: within {s:.0%}" for name, s in named if 0.3 < s < np.inf]
    for k in np.flatnonzero(at_bound(np.log(values), what.low, what.high)):
        notes.append(
            f"{what.names[k]} = {values[k]:.4g} ended on a bound of its search, {np.exp(what.low[k]):.4g} to "
            f"{np.exp(what.high[k]):.4g}: the other parameters hold for this value only; widen bounds"
        )
    if factor > NOTED:
        notes.append(
            f"the misfit is flatter than its slopes say, as near the edge of self-pulsing: deviations were widened by "
            f"up to {factor:.2g}; give traces farther from the edge"
        )
    if off > APART:
        notes.append(
            f"the settled cycles ask for parameters {off:.2g} deviations away from those of the whole traces: check "
            "the powers and detunings, and whether the light was switched on at time 0"
        )
    return notes


def read_apart(periods: Array, models: Array) -> tuple[str, ...]:
    """Sentences on traces whose period is incompatible with that of their model.

    One of the two is constant (period nan), or their periods have an integer ratio of 2 or more.
    """
    notes = []
    for k, (read, own) in enumerate(zip(periods, models, strict=True)):
        ratio = max(read / own, own / read)
        if np.isnan(read) != np.isnan(own):
            which = "rests, and its model pulses" if np.isnan(read) else "pulses, and its model rests"
            notes.append(
                f"traces[{k}] {which}: the parameters may be wrong; give a trace farther from the edge of self-pulsing"
            )
        elif ratio > 1.5 and abs(ratio / round(ratio) - 1) < NEAR:
            notes.append(
                f"traces[{k}] was read at a period of {quantity.rounded(read, 's', 4)} and its model at "
                f"{quantity.rounded(own, 's', 4)}, {round(ratio)} times as much or as little: one of them is misread, "
                "and the parameters may be wrong; sample the trace more finely, or leave it out"
            )
    return tuple(notes)
