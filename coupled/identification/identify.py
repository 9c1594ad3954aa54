"""Train the ring, its carriers and its heat on drop traces: evolution for the basin, least squares for the rest."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from thermofem import checks
from thermofem.arrays import Array
from thermofem.data import quantity
from thermofem.models import HasModel, ThermalModel

from ..arguments import check_ring
from ..bar import bar
from ..resonator import RingResonator
from ..thermal import Compact
from ..unknowns import ThermalFamily, Unknowns, unknowns
from .cycles import Cycle, misfit
from .matching import Target, at_bound, coarse, deviations, polished, residuals, simulated, targets_of

if TYPE_CHECKING:
    import xarray as xr

log = logging.getLogger("thermofem")

NEAR = 0.1  # of a whole number, relative: a ratio of periods that is one
POPULATION, GENERATIONS = 20, 8
SEARCHED = 6  # harmonics that count in the evolution


@dataclass(frozen=True, eq=False)
class Identification(HasModel):
    """Result of `identify`.

    Attributes
    ----------
    parameters, standard_deviations : dict of str to float
        of the free parameters, in SI; the deviations hold the noise of the traces, see `identify`.
    ring, model : RingResonator, Foster (or the kind of the given model, where nothing of it is free)
        with those parameters.
    residuals : xarray.Dataset
        over trace: power (W), detuning (Hz), period and period_model (s), and shape_error, the root mean square
        difference of the cycles over the measured swing (or a twentieth of the mean, where that is more).
    cycles : xarray.Dataset
        over trace and phase: drop, the measured mean cycle, and drop_model, both in the unit of the trace; each the
        mean over 1/33 of the cycle.
    samples : xarray.Dataset
        over run: each free parameter, and misfit, the root of the mean over the traces of the sum of squares.
    notes : tuple of str
        what makes numbers of the result doubtful: uneven samples; parameters that the traces do not determine, or that
        ended on a bound of the search; traces whose period and that of the model are a multiple of each other;
        traces that pulse while their model rests, or the other way round. They are logged, too.
    front : array, shape (n, traces)
        sums of squares, with six harmonics, of the Pareto front at which the evolution of the first run ended.
    """

    parameters: dict[str, float]
    standard_deviations: dict[str, float]
    ring: RingResonator
    model: Compact
    residuals: xr.Dataset
    cycles: xr.Dataset
    samples: xr.Dataset
    front: Array
    notes: tuple[str, ...] = ()


def identify(
    ring: RingResonator,
    traces: xr.Dataset | Sequence[xr.Dataset],
    *,
    free: Sequence[str],
    model: ThermalModel | ThermalFamily | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    runs: int = 10,
    seed: int = 1,
    show_bar: bool = False,
) -> Identification:
    """Find the parameters with which the simulated drop traces are closest to all the given ones at once.

        minimise, one objective a trace,  (ln(T_model/T)/0.01)^2 + mean(((drop_model - drop)/(0.03 swing))^2)

    by a multi-objective evolution (NSGA-II) in the logarithms of the parameters, with six harmonics of the cycle, then
    least squares on the sum from the best point of its front, with 2, 6 and all 32 of them.

    Period and shape of the mean cycle are compared instead of the traces themselves: two that differ by a hundredth in
    period are out of phase after some tens of cycles. The cycle is cut at its 32nd harmonic, and shifted in phase to
    where it is closest.

    Parameters
    ----------
    ring : RingResonator
    traces : xarray.Dataset or sequence of them
        from `simulate` or measured: drop (W; any other unit in its attribute "units" frees the scale) over time (s),
        with "input_power" or "power" (W) and "detuning" (Hz) among the attributes. The second half of each is used.
        At time 0 the light was switched on, on a cold ring: a trace may begin later. Where that time is unknown, set
        the attribute "settled" to True: the trace is compared with the cycle on which the model settles, as is one of
        `simulate` with ``initial``.
    free : sequence of str
        fields of the ring ("bus_rate", "loss_rate", "fca_cross_section", ...) or of its carriers ("tau_n", "tau_p", or
        "tau0" for both at one ratio), and the parameters of one thermal law: "kappa" (1/s), "tau_f", "tau_s" (s), "eta"
        of the second-order equation; "tau_th" (s) and "heat_capacity" (J/K) of Newton's law; "R" (K/W) and "tau" (s),
        all poles of ``model``; or the parameters of a family.
    model : ThermalModel or family, optional
        what the thermal parameters start from (a linear one), or where none is free the model, of any kind that
        `simulate` takes. By default the paper's. Of a family of models, as of `surrogate.train_family`, all parameters
        are free, within its ranges; ``family.held(radius=7e-6)`` holds some.
    bounds : mapping of name to (low, high), optional
        by default a factor of 4 either side of the start.
    runs : int
        independent searches, each with its own evolution. The one with the smallest misfit gives the parameters;
        ``samples`` shows how far the others, which may have ended in another minimum, are from it.
    seed : int
    show_bar : bool
        whether to draw a bar on the terminal.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        a name, bound or trace that cannot be used.

    The standard deviations are those of the noise: every cycle of a trace is left out once, and the change of the
    residuals moves the parameters by their linearisation (jackknife). They do not hold what the law itself cannot do,
    which ``residuals`` shows. They are nan where a trace has fewer than four cycles in its second half, or uneven
    samples with gaps above a hundredth of the period, and for a parameter that ended on a bound. They are inf for one
    that the traces do not determine, such as two of which only the ratio counts. All are nan where a trace and its
    model were read otherwise, at another period or at rest. ``notes`` names these. Measured on 50 synthetic cases of
    four parameters, two traces and 2 % noise (tests/audit/pulls.py): the deviations of (found - true)/deviation are
    0.89 to 0.95. Of seven nearly exchangeable parameters (those four, bus_rate, loss_rate and fca_cross_section) on
    four traces, whose deviations reach 3 %, they are 0.86 to 1.11 over 29 of 30 cases; in the other one a trace was
    read at twice the period of its model. Of tau_n and the poles of the network (tau_n, R, tau) they are 0.8 to 1.5.
    The simulated traces are sampled as the given ones are: straight lines between other samples would move such
    parameters by more than a deviation.

    Source: Borghi et al., Opt. Express 29, 4363 (2021), end of Section 5, which trains (kappa, tau_f, tau_s, eta) on
    three traces by a multi-objective swarm, and takes the standard deviation over ten runs. Deb et al., IEEE Trans.
    Evol. Comput. 6, 182 (2002), for NSGA-II.
    """
    check_ring(ring)
    what = unknowns(ring, free, model, bounds)
    targets = targets_of(traces)
    seed = checks.seed(seed)
    runs = checks.integer("runs", runs, 1, 1000, hint="several show whether the search ends in one minimum")
    found, front = [], np.empty((0, len(targets)))
    wanted = [target.observed.mean() for target in targets]
    with bar("identify", runs, show_bar) as advance:
        for run in range(runs):
            rng = np.random.default_rng([seed, run])
            found.append(_one_run(what, targets, wanted, int(rng.integers(2**31))))
            front = front if run else found[0][2]
            advance()
    return _result(what, targets, found, front)


def _one_run(what: Unknowns, targets: list[Target], wanted: list[Cycle], seed: int) -> tuple[Array, float, Array]:
    """Logarithms of the parameters, the misfit, and the front of the evolution."""
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.core.problem import ElementwiseProblem
    from pymoo.optimize import minimize

    class Search(ElementwiseProblem):
        def __init__(self) -> None:
            super().__init__(n_var=what.start.size, n_obj=len(targets), xl=what.low, xu=what.high)

        def _evaluate(self, x: Array, out: dict[str, Any], *args: Any, **kwargs: Any) -> None:
            out["F"] = np.sum(coarse(residuals(what, targets, wanted, x), SEARCHED) ** 2, axis=1)

    rng = np.random.default_rng(seed)
    first = rng.uniform(what.low, what.high, size=(POPULATION, what.start.size))
    first[0] = what.start
    ended = minimize(Search(), NSGA2(pop_size=POPULATION, sampling=first), ("n_gen", GENERATIONS), seed=seed)
    points, front = np.atleast_2d(ended.X), np.atleast_2d(ended.F)
    x, cost = polished(what, targets, wanted, points[np.argmin(front.sum(axis=1))])
    return x, float(np.sqrt(cost / len(targets))), front


def _result(
    what: Unknowns, targets: list[Target], found: list[tuple[Array, float, Array]], front: Array
) -> Identification:  # fmt: skip
    """Put the result together."""
    import xarray as xr

    from thermofem.data import dataset

    values, best = np.exp([x for x, _, _ in found]), int(np.argmin([m for _, m, _ in found]))
    ring, model = what.build(found[best][0])
    spread = values[best] * deviations(what, targets, found[best][0])
    phase = np.linspace(0, 1, 256, endpoint=False)
    rows, curves = [], []
    for target in targets:
        aim = target.observed.mean()
        _, aligned = misfit(simulated(ring, model, target), aim, target.observed.absolute)
        curves.append([cycle.curve(phase, smooth=True) for cycle in (aim, aligned)])
        shape = float(np.sqrt(np.mean((aligned.curve(phase) - aim.curve(phase)) ** 2)) / aim.scale)
        rows.append([target.power, target.detuning, aim.period, aligned.period, shape])
    columns = np.array(rows).T
    errors = xr.Dataset(
        {
            "power": ("trace", columns[0], dataset.describe("input_power")),
            "detuning": ("trace", columns[1], dataset.describe("detuning")),
            "period": ("trace", columns[2], dataset.describe("period")),
            "period_model": ("trace", columns[3], dataset.describe("period")),
            "shape_error": (
                "trace",
                columns[4],
                {"units": "1", "long_name": "rms difference of the cycles over the swing"},
            ),
        }
    )
    notes = _doubts(what, targets, spread, values[best])
    if apart := read_apart(columns[2], columns[3]):
        notes, spread = notes + apart, np.full(spread.size, np.nan)
    drawn = np.array(curves)
    units = {target.observed.unit for target in targets}
    about = {"units": units.pop() if len(units) == 1 else "unit of the trace", "long_name": "drop signal"}
    about = dataset.describe("drop") if about["units"] == "W" else about
    cycles = xr.Dataset(
        {
            "drop": (("trace", "phase"), drawn[:, 0], about),
            "drop_model": (("trace", "phase"), drawn[:, 1], about),
        },
        coords={"phase": ("phase", phase, {"units": "1", "long_name": "fraction of the cycle"})},
    )
    samples = xr.Dataset(
        {name: ("run", values[:, k]) for k, name in enumerate(what.names)}
        | {"misfit": ("run", [m for _, m, _ in found])}
    )
    return Identification(
        dict(zip(what.names, values[best].tolist(), strict=True)),
        dict(zip(what.names, spread.tolist(), strict=True)),
        ring, model, errors, cycles, samples, front, notes,
    )  # fmt: skip


def _doubts(what: Unknowns, targets: list[Target], spread: Array, values: Array) -> tuple[str, ...]:
    """Sentences on uneven samples, and on parameters whose deviations are inf or that stand on a bound; logged, too."""
    notes = [
        f"traces[{k}] is sampled unevenly, and lines between its samples bend the cycle by chance: the parameters may "
        "be a few percent off, and have no deviations; sample it evenly or more finely"
        for k, target in enumerate(targets)
        if target.uneven
    ]
    if loose := [name for name, one in zip(what.names, spread, strict=True) if np.isinf(one)]:
        notes.append(
            f"the traces do not determine {', '.join(loose)}: other values fit as well; give traces of other powers "
            "and detunings, or free fewer"
        )
    for k in np.flatnonzero(at_bound(what, np.log(values))):
        notes.append(
            f"{what.names[k]} = {values[k]:.4g} ended on a bound of its search, {np.exp(what.low[k]):.4g} to "
            f"{np.exp(what.high[k]):.4g}: the other parameters hold for this value only; widen bounds"
        )
    for note in notes:
        log.warning("%s", note)
    return tuple(notes)


def read_apart(periods: Array, models: Array) -> tuple[str, ...]:
    """Sentences on traces that were read otherwise than their models are; logged as warnings.

    One of the two rests (a period of nan), or has a multiple of the other's period.
    """
    notes = []
    for k, (seen, own) in enumerate(zip(periods, models, strict=True)):
        ratio = max(seen / own, own / seen)
        if np.isnan(seen) != np.isnan(own):
            which = "rests, and its model pulses" if np.isnan(seen) else "pulses, and its model rests"
            notes.append(
                f"traces[{k}] {which}: the parameters may be wrong; give a trace farther from the edge of self-pulsing"
            )
        elif ratio > 1.5 and abs(ratio / round(ratio) - 1) < NEAR:
            notes.append(
                f"traces[{k}] was read at a period of {quantity.rounded(seen, 's', 4)} and its model at "
                f"{quantity.rounded(own, 's', 4)}, {round(ratio)} times as much or as little: one of them is misread, "
                "and the parameters may be wrong; sample the trace more finely, or leave it out"
            )
    for note in notes:
        log.warning("%s", note)
    return tuple(notes)
