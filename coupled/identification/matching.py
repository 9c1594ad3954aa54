"""Drop traces as targets of a fit, and the misfit of a model; used by all identifications."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thermofem import checks
from thermofem.arrays import Array, NDArray
from thermofem.data.variables import in_si

from ..arguments import check_detuning, check_power
from ..kernel.units import slowest_rate
from ..resonator import RingResonator
from ..runs.simulate import simulate
from ..thermal import Compact
from ..unknowns import Unknowns
from .cycles import HARMONICS, Cycle, Observed, cycle_of, misfit, observe

if TYPE_CHECKING:
    import xarray as xr

STEP = 1e-3  # of a logarithm, for the slopes of a search: far above what the step control of the integration leaves
BENT = 0.7  # second over first difference, beyond which a side of a step holds a jump: 1 there, else 0.3 (measured)
WIDE = 1e-2  # the same for deviations: edges move by several samples, whose lines between them make the misfit rough
RTOL = 1e-5
LONGEST = 40e-6  # s simulated for a trace that is longer, or
SETTLED = 8.0  # time constants of the slowest pole, where these are more: e^-8 is 3e-4
MOST = 50_000  # samples of a simulated trace
STEPS = 5e-9  # s at most between two samples of the carriers, so that their spikes are seen
IMPOSSIBLE = 1e3  # residual where the parameters make no model
STAGES = (2, 6, HARMONICS)  # harmonics that count, one after the other
EVALUATIONS = 15  # steps of least squares in each
FEWEST = 4  # cycles of a trace from which a scatter is estimated
WEAKEST = 0.1  # change of all residuals by a factor of e that determines something: a thousandth of the period
MIXED = 0.01  # share of a parameter in a direction that is open, from which on it is open itself
UNEVEN, COARSE = 3.0, 0.01  # largest gap between samples over the median one, and over the period
AT_BOUND = 1e-3  # of the logarithm: a parameter this near a bound has not ended before it


class Target(NamedTuple):
    """One trace to meet."""

    observed: Observed
    power: float
    detuning: float
    times: Array
    """At which the trace was sampled; s from when the light was switched on."""
    settled: bool = False
    """Whether nothing is known of its beginning, and it is compared with the settled cycle."""

    @property
    def uneven(self) -> bool:
        """Whether samples are so unevenly spread that straight lines between them bend the cycle by chance."""
        late = self.times[self.times >= (self.times[0] + self.times[-1]) / 2]
        gaps = np.diff(late)
        return bool(gaps.max() > UNEVEN * np.median(gaps) and gaps.max() > COARSE * self.observed.clock)

    def sampling(self, model: Compact) -> Array:
        """When the trace of a model is sampled, s.

        Of a settled trace, and of one that is longer than the model needs to settle, the last cycles of a trace that
        is just so long are compared.
        """
        enough = max(LONGEST, SETTLED / slowest_rate(model))
        if not self.settled and self.times[-1] <= enough and self.times.size <= MOST:
            return self.times
        step = float(np.median(np.diff(self.times)))
        whole = not self.settled and self.times[-1] <= enough
        begin, end = (self.times[0], self.times[-1]) if whole else (0.0, enough)
        return np.linspace(begin, end, min(MOST, 1 + math.ceil((end - begin) / step)))


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
        targets.append(Target(observed, power, detuning, times - min(times[0], 0.0), settled))
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
        ring, model, power=target.power, detuning=target.detuning, duration=end, rtol=RTOL,
        times=np.unique(np.concatenate([at, np.linspace(0.0, end, int(end / STEPS) + 1)])),
    )  # fmt: skip
    return cycle_of(run, at=at)


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


def deviations(what: Unknowns, targets: list[Target], x: Array) -> Array:
    """Standard deviations of the fitted logarithms ``x``, from the scatter between the cycles of each trace.

    inf where the traces do not determine a parameter, nan where it ended on a bound; the others then hold for that
    value. nan, too, where a trace has fewer than `FEWEST` cycles or uneven samples.

    Jackknife: leave out one cycle i of the n cycles of a trace. With the residuals r, without that cycle r_(i), and
    their derivative J,

        x_(i) = x - (J^T J)^-1 J^T (r_(i) - r),      variance = sum over the traces of (n - 1)/n sum_i (x_(i) - mean)^2
    """
    wanted = [target.observed.mean() for target in targets]
    found = np.full(x.size, np.nan)
    if any(target.uneven for target in targets):
        return found
    free = np.flatnonzero(~at_bound(what, x))
    if free.size == 0:
        return found

    def left(x: Array) -> Array:
        return residuals(what, targets, wanted, x).ravel()

    middle = left(x)
    slopes = [_slope(left, x, middle, int(k)) for k in free]
    U, size, Vt = np.linalg.svd(np.array(slopes).T, full_matrices=False)
    strong = size > WEAKEST
    loose = np.any(np.abs(Vt[~strong]) > MIXED, axis=0)
    if min(len(target.observed.pieces) for target in targets) >= FEWEST:
        solve = ((Vt[strong].T / size[strong]) @ U[:, strong].T).reshape(free.size, len(targets), -1)
        found[free] = np.sqrt(_variance(what, targets, solve, x))
    found[free[loose]] = np.inf
    return found


def _slope(of: Callable[[Array], Array], x: Array, middle: Array, k: int) -> Array:
    """d ``of``/d x_k by differences about its value ``middle``.

    The step is shorter where on one side a trace ends to pulse, or is read at twice its period.
    """
    slope = np.empty(0)
    for step in (WIDE, STEP):
        above, below = (of(x + sign * step * np.eye(x.size)[k]) for sign in (1, -1))
        slope = (above - below) / (2 * step)
        if np.linalg.norm(above + below - 2 * middle) < BENT * np.linalg.norm(above - below):
            break
    return slope


def _variance(what: Unknowns, targets: list[Target], solve: Array, x: Array) -> Array:
    """The sum of `deviations`, from (J^T J)^-1 J^T of shape (parameters, traces, residuals)."""
    ring, model = what.build(x)
    variance = np.zeros(len(solve))
    for k, target in enumerate(targets):
        cycle, n = simulated(ring, model, target), len(target.observed.pieces)
        rest = [target.observed.mean(np.delete(np.arange(n), i)) for i in range(n)]
        moved = np.array([solve[:, k] @ misfit(cycle, aim, target.observed.absolute)[0] for aim in rest])
        variance += (n - 1) * moved.var(axis=0)
    return variance
