"""Drop traces as targets of a fit, and the misfit of a model; used by all identifications."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from thermofem import checks
from thermofem.arrays import Array, NDArray
from thermofem.data.variables import in_si

from ..arguments import check_detuning, check_power
from ..contradictions import without_origin
from ..kernel.units import slowest_rate
from ..resonator import RingResonator
from ..runs.simulate import simulate
from ..thermal import Compact
from ..unknowns import Unknowns
from .cycles import HARMONICS, Cycle, Observed, cycle_of, misfit, observe
from .forced_filters import Forced

if TYPE_CHECKING:
    import xarray as xr

STEP = 1e-3  # of a logarithm, for the slopes of a search: far above what the step control of the integration leaves
RTOL = 1e-5
LONGEST = 40e-6  # s simulated for a trace that is longer, or
SETTLED = 8.0  # time constants of the slowest pole, where these are more: e^-8 is 3e-4
MOST = 50_000  # samples of a simulated trace
STEPS = 5e-9  # s at most between two samples of the carriers, so that their spikes are seen
IMPOSSIBLE = 1e3  # residual where the parameters make no model
STAGES = (2, 6, HARMONICS)  # harmonics that count, one after the other
EVALUATIONS = 15  # steps of least squares in each
UNEVEN, COARSE = 3.0, 0.01  # largest gap between samples over the median one, and over the period
AT_BOUND = 1e-3  # of the logarithm: a parameter this near a bound has not ended before it


@dataclass(frozen=True, eq=False)
class Target:
    """One trace to meet.

    power [W]; detuning [Hz].
    times, drop [shape (n,)]: samples, in s from when the light was switched on, and in the unit of the trace.
    settled: whether nothing is known of its beginning, and it is compared with the settled cycle.
    """

    observed: Observed
    power: float
    detuning: float
    times: Array
    drop: Array
    settled: bool = False

    @property
    def uneven(self) -> bool:
        """Whether samples are so unevenly spread that straight lines between them bend the cycle by chance."""
        late = self.times[self.times >= (self.times[0] + self.times[-1]) / 2]
        gaps = np.diff(late)
        return bool(gaps.max() > UNEVEN * np.median(gaps) and gaps.max() > COARSE * self.observed.clock)

    @property
    def cold(self) -> bool:
        """Whether the trace begins where the light was switched on."""
        return not self.settled and self.times[0] <= 2 * float(np.median(np.diff(self.times)))

    def window(self, model: Compact) -> tuple[float, float]:
        """Begin and end in s of the run of a model that is compared, in its second half.

        Of a settled trace, and of one that is longer than the model needs to settle, the end of a run that is just so
        long is compared.
        """
        enough = max(LONGEST, SETTLED / slowest_rate(model))
        whole = not self.settled and self.times[-1] <= enough
        return (float(self.times[0]), float(self.times[-1])) if whole else (0.0, enough)

    def sampling(self, model: Compact) -> Array:
        """When the trace of a model is sampled, s."""
        begin, end = self.window(model)
        if end == self.times[-1] and self.times.size <= MOST:
            return self.times
        step = float(np.median(np.diff(self.times)))
        return np.linspace(begin, end, min(MOST, 1 + math.ceil((end - begin) / step)))

    @cached_property
    def forced(self) -> Forced:
        """The trace evenly sampled."""
        length = float(self.times[-1] - self.times[0])
        n = min(MOST, 1 + round(length / float(np.median(np.diff(self.times)))))
        drop = np.interp(np.linspace(self.times[0], self.times[-1], n), self.times, self.drop)
        return Forced(length / (n - 1), drop, self.power, self.detuning, self.cold, self.observed.absolute)


def targets_of(traces: xr.Dataset | Sequence[xr.Dataset]) -> list[Target]:
    """Check the traces and cut them into cycles."""
    several: list[Any] = list(traces) if isinstance(traces, list | tuple) else [traces]
    if not several:
        raise checks.InputError("traces is empty; give Datasets from coupled.simulate or measured ones")
    targets = []
    for k, trace in enumerate(several):
        name = f"traces[{k}]"
        _check_alone(name, trace)
        observed = observe(trace, name)
        power = trace.attrs.get("input_power", trace.attrs.get("power"))
        if power is None or "detuning" not in trace.attrs:
            raise checks.InputError(f"{name} does not say its drive; set its attrs 'power' (W) and 'detuning' (Hz)")
        power = check_power(power, f"the power of {name}")
        detuning = check_detuning(trace.attrs["detuning"], f"the detuning of {name}")
        times = np.asarray(in_si(name, trace[["time"]])["time"].values, dtype=float)
        settled = "initial" in trace.attrs or bool(checks.integer(f"{name}.attrs['settled']", _mark(trace), 0, 1))
        drop = np.asarray(trace["drop"].values, dtype=float)
        targets.append(Target(observed, power, detuning, times - min(times[0], 0.0), drop, settled))
    return targets


def _mark(trace: Any) -> Any:
    """The attribute "settled" of a trace as a number; a file keeps True as 1."""
    mark = trace.attrs.get("settled", 0)
    return int(mark) if isinstance(mark, bool | np.bool_) else mark


def _check_alone(name: str, trace: Any) -> None:
    """InputError for a run with a second laser or with heaters, whose light and heat no fit here counts."""
    lasers = int(checks.integer(f"{name}.attrs['lasers']", getattr(trace, "attrs", {}).get("lasers", 1), 1, 1e6))
    heated = "heater_power" in getattr(trace, "variables", {})
    others = "a second laser" if lasers > 1 else "heaters" if heated else ""
    if others:
        raise checks.InputError(f"{name} is of a ring with {others}; one laser alone can be fitted")


def simulated(ring: RingResonator, model: Compact, target: Target) -> Cycle:
    """The cycle of the model under the drive of a trace, sampled as the trace is."""
    at = target.sampling(model)
    end = float(at[-1])
    run = simulate(
        ring, without_origin(model), power=target.power, detuning=target.detuning, duration=end, rtol=RTOL,
        times=np.unique(np.minimum(np.concatenate([at, np.linspace(0.0, end, int(end / STEPS) + 1)]).round(15), end)),
    )  # fmt: skip
    return cycle_of(run, at=at, near=target.observed.clock)


def residuals(what: Unknowns, targets: list[Target], wanted: list[Cycle], x: Array) -> Array:
    """All residuals at the logarithms ``x``, shape (traces, 66)."""
    try:
        ring, model = what.build(x)
        cycles = [simulated(ring, model, target) for target in targets]
    except (checks.InputError, RuntimeError):
        return np.full((len(targets), 2 * wanted[0].harmonics.size), IMPOSSIBLE)
    return np.array(
        [
            misfit(cycle, aim, target.observed.absolute)[0]
            for cycle, aim, target in zip(cycles, wanted, targets, strict=True)
        ]
    )


def coarse(found: Array, harmonics: int) -> Array:
    """The residuals of `residuals` without those of the higher harmonics."""
    last = HARMONICS + 1
    return np.concatenate(
        [found[:, : 2 + harmonics], found[:, 1 + last : 1 + last + harmonics]], axis=1
    )  # fmt: skip


def polished(
    what: Unknowns, targets: list[Target], wanted: list[Cycle], start: Array, stages: tuple[int, ...] = STAGES
) -> tuple[Array, float]:  # fmt: skip
    """Least squares from ``start`` with more harmonics in each stage; the logarithms and the sum of squares.

    A steep edge of a cycle that is out of place by more than its own length gives no direction, and with all harmonics
    at once the way leads through a narrow, bent valley: 40 steps do not reach an end that 11 in stages do (measured,
    Newton's law). Few harmonics may leave a direction open, along which a good start is lost: where the end is worse
    than the start, the last stage begins there again.
    """
    from scipy.optimize import least_squares

    def stage(x: Array, harmonics: int) -> tuple[Array, float]:
        best = least_squares(
            lambda x: coarse(residuals(what, targets, wanted, x), harmonics).ravel(),
            x,
            bounds=(what.low - 1e-9, what.high + 1e-9),
            diff_step=STEP / np.maximum(np.abs(what.start), 1e-3),
            xtol=1e-5,
            ftol=1e-5,
            max_nfev=EVALUATIONS,
        )
        return np.clip(best.x, what.low, what.high), float(2 * best.cost)

    x, cost = start, np.inf
    for harmonics in stages:
        x, cost = stage(x, harmonics)
    if np.sum(coarse(residuals(what, targets, wanted, start), stages[-1]) ** 2) < cost:
        return stage(start, stages[-1])
    return x, cost


def at_bound(what: Unknowns, x: Array) -> NDArray[np.bool_]:
    """Which of the logarithms ``x`` ended on a bound of the search."""
    return (x < what.low + AT_BOUND) | (x > what.high - AT_BOUND)
