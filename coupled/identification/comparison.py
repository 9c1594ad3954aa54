"""An identified model beside the traces: errors, cycles, and sentences on what makes its parameters doubtful."""

from __future__ import annotations

import numpy as np
import xarray as xr

from thermofem.arrays import Array
from thermofem.data import dataset, quantity

from ..resonator import RingResonator
from ..thermal import Compact
from ..unknowns import Unknowns
from .cycles import NEAR
from .matching import Target, at_bound
from .settled_cycles import STAGES, Seen, compared, free_run, repeats

NOTED, APART = 1.5, 3.0  # widening, and distance from the forced fit in its deviations, that are said
HARDLY = 0.3  # deviation of a logarithm that is said


def comparison(
    ring: RingResonator, model: Compact, targets: list[Target], aims: list[Seen]
) -> tuple[xr.Dataset, xr.Dataset, tuple[str, ...]]:
    """Errors over trace, cycles over trace and phase, and sentences on periods that cannot be compared."""
    phase = np.linspace(0, 1, 256, endpoint=False)
    rows, curves, notes = [], [], []
    for k, (target, aim) in enumerate(zip(targets, aims, strict=True)):
        run, own = free_run(ring, model, target)
        _, aligned = compared(own, aim, STAGES[-1], target.observed.absolute)
        curves.append([cycle.curve(phase, smooth=True) for cycle in (aim.cycle, aligned)])
        off = aligned.curve(phase) - aim.cycle.curve(phase)
        period = aligned.period
        if not repeats(run):
            period = np.nan
            notes.append(f"the pulses of the model of traces[{k}] do not repeat: it has no period there")
        rows.append(
            [target.power, target.detuning, aim.cycle.period, period, np.sqrt(np.mean(off**2)) / aim.cycle.scale]
        )
    power, detuning, period, own_period, shape = np.array(rows).T
    about = {"units": "1", "long_name": "rms difference of the cycles over the swing"}
    errors = xr.Dataset(
        {
            "power": ("trace", power, dataset.describe("input_power")),
            "detuning": ("trace", detuning, dataset.describe("detuning")),
            "period": ("trace", period, dataset.describe("period")),
            "period_model": ("trace", own_period, dataset.describe("period")),
            "shape_error": ("trace", shape, about),
        }
    )
    units = {target.observed.unit for target in targets}
    unit = units.pop() if len(units) == 1 else "unit of the trace"
    about = dataset.describe("drop") if unit == "W" else {"units": unit, "long_name": "drop signal"}
    drawn = np.array(curves)
    cycles = xr.Dataset(
        {name: (("trace", "phase"), drawn[:, k], about) for k, name in enumerate(("drop", "drop_model"))},
        coords={"phase": ("phase", phase, {"units": "1", "long_name": "fraction of the cycle"})},
    )
    return errors, cycles, tuple(notes) or read_apart(period, own_period)


def doubts(what: Unknowns, targets: list[Target], spread: Array, values: Array, factor: float, off: float) -> list[str]:
    """Sentences on what makes parameters doubtful that meet the traces."""
    notes = [
        f"traces[{k}] is sampled unevenly, and lines between its samples bend the cycle by chance: the parameters have "
        "no deviations; sample it evenly or more finely"
        for k, target in enumerate(targets)
        if target.uneven
    ]
    named = list(zip(what.names, spread, strict=True))
    if loose := [name for name, one in named if np.isinf(one)]:
        notes.append(
            f"the traces do not determine {', '.join(loose)}: other values fit as well; give traces of other powers "
            "and detunings, or free fewer"
        )
    notes += [f"{name} is hardly determined: within {s:.0%}" for name, s in named if HARDLY < s < np.inf]
    for k in np.flatnonzero(at_bound(what, np.log(values))):
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
    """Sentences on traces that were read otherwise than their models are.

    One of the two rests (a period of nan), or has a multiple of the other's period.
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
