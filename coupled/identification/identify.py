"""Estimation of ring, carrier and thermal parameters from drop traces: forced filters, limit cycles, and a fit test."""

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import itemgetter
from typing import NamedTuple

import numpy as np
import xarray as xr

from thermofem import Foster, checks
from thermofem.arrays import Array
from thermofem.models import HasModel, ThermalModel

from ..inputs import bar, check_ring
from ..resonator import RingResonator
from ..thermal import Compact, check_model, notes_of, plain
from ..unknowns import ThermalFamily, Unknowns, unknowns, with_equal_buses
from .box_search import End, Prior, cost, least_squares
from .cycle_residuals import SOFT, STAGES, comparison, doubts, residuals
from .cycles import Target, targets_of
from .deviations import curvature, leaning_of, spread_over_traces, unknown_as_inf, without_noise
from .forced_filters import forced_starts
from .held_numbers import held_deviations, held_numbers, summary

log = logging.getLogger("thermofem")

ALONG = np.append(0, np.outer((0.01, 0.02, 0.04, 0.07, 0.1, 0.15, 0.2), (-1, 1)))  # of a logarithm
DRAWN, TRIES = 10, 5  # further points about a forced fit, and how many of all are followed
NOISE_LEVEL = 1.5  # the same at the end: a fit above it failed
ALIKE = 1.05  # ratio of two misfits below which both count as the lowest
DRIFT, SHAPE = 0.03, 0.1  # of the period and the swing: a model that misses traces without noise by more has failed
MANY = 30  # residuals from which the noise is estimated where it is less than expected


@dataclass(frozen=True, eq=False, repr=False)
class Identification(HasModel):
    """Result of `identify`. ``print`` shows it in a dozen lines.

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
        over run: each free parameter, and misfit, the root mean square of the residuals over the noise, of every end of
        the search, the best first.
    failed : bool
        whether the misfit of the best fit is above 1.5: the model then does not reproduce the traces within noise; for
        traces without noise, whether it misses one by more than 3 % of the period or 10 % of the swing.
    smooth : bool
        whether the traces have no noise, so that the deviations hold the error of the model.
    notes : tuple of str
        reasons for which the result is doubtful: a failed fit; traces without noise; parameters that the traces do not
        determine, or that ended on a bound; deviations that were widened; another end of equal misfit; periods of trace
        and model that are a multiple of each other, or a model whose pulses do not repeat; traces that pulse while
        their model rests, or the other way round. They are logged, too.
    sensitivities : dict of str to dict of str to float
        of each parameter to each number of the ring that was held, d ln parameter/d ln held: -3 says that the parameter
        falls by 3 % where the held number is 1 % larger. Empty where the fit failed.
    thermal_resistance_deviation : float, K/W
        standard deviation of R_th of the model; nan where that of a parameter is.
    """

    parameters: dict[str, float]
    standard_deviations: dict[str, float]
    ring: RingResonator
    model: Foster | Compact
    residuals: xr.Dataset
    cycles: xr.Dataset
    samples: xr.Dataset
    failed: bool
    smooth: bool
    notes: tuple[str, ...] = ()
    sensitivities: dict[str, dict[str, float]] = field(default_factory=dict)
    thermal_resistance_deviation: float = float("nan")

    def __repr__(self) -> str:
        """The parameters and R_th with their deviations, what they lean on, and the notes: a line each."""
        verdict = "failed" if self.failed else "fitted"
        misfit = float(self.samples["misfit"].min())
        title = f"Identification from {self.residuals.sizes['trace']} traces: {verdict}, misfit {misfit:.3g}"
        resistance = float(self.model.thermal_resistance)
        parameters = self.parameters | {"thermal_resistance": resistance}
        deviations = self.standard_deviations | {"thermal_resistance": self.thermal_resistance_deviation}
        return summary(title, parameters, deviations, self.sensitivities, self.notes)


def identify(
    ring: RingResonator,
    traces: xr.Dataset | Sequence[xr.Dataset],
    *,
    free: Sequence[str],
    model: ThermalModel | ThermalFamily | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    runs: int = 3,
    seed: int = 1,
    show_bar: bool = False,
    held: Mapping[str, float] | None = None,
    noise: float | Sequence[float] | None = None,
) -> Identification:
    """Fit parameters of a ring, its carriers and its thermal model to one or several drop traces at once.

    1. Carriers and heat are driven by the measured light, which makes the misfit smooth (`forced_filters`): 1024 points
       within the bounds, least squares from the best 8.
    2. Simulations from the cold ring are fitted to the period and 32 harmonics of the second half of each trace,

           minimise  sum (ln(T_model/T)/s_T)^2 + sum_k |c_k,model - c_k|^2/s_k^2 + (x - x_0)^T L (x - x_0)

       in the logarithms x of the parameters; s are the standard deviations by noise, with 3e-5 (period) and 2e-4 of
       the swing (c_k) added in quadrature. The forced fit x_0 is the prior, with L from 15 times its standard
       deviations and 3 %, as it contains the information of the transient.
    3. A fit whose rms residual exceeds 1.5 standard deviations has failed. Traces without noise, as those of a
       simulation, have no such test: the deviations then hold the error of the model.

    Parameters
    ----------
    ring : RingResonator
    traces : xarray.Dataset or sequence of them
        from `simulate` or measured: drop (W; for any other unit, attribute "units", a scale is fitted) over time (s),
        with "input_power" or "power" (W) and "detuning" (Hz) among the attributes. The second half of each is used.
        At time 0 the light was switched on, on a cold ring: a trace may begin later. Where that time is unknown, set
        the attribute "settled" to True: the trace is compared with the limit cycle of the model. A run of `simulate`
        with ``initial`` is always treated so.
    free : sequence of str
        fields of the ring ("bus_rate", "loss_rate", "fca_cross_section", ...) or of its carriers ("tau_n", "tau_p", or
        "tau0" for both at one ratio), and the parameters of one thermal law: "kappa" (1/s), "tau_f", "tau_s" (s), "eta"
        of the second-order equation; "tau_th" (s) and "heat_capacity" (J/K) of Newton's law; "R" (K/W) and "tau" (s),
        all poles of ``model``; or the parameters of a family.
    model : ThermalModel or family, optional
        source of the start values of free thermal parameters (a linear model), or the fixed thermal model, of any kind
        that `simulate` takes. By default the paper's. All parameters of a family (`surrogate.train_family`) are free
        within its ranges; ``family.held(radius=7e-6)`` fixes some.
    bounds : mapping of name to (low, high), optional
        by default a factor of 4 either side of the start.
    runs : int
        largest number of minima of step 1 from which step 2 starts; a fit with residuals at the noise level ends it.
    seed : int
    show_bar : bool
        whether to draw a bar on the terminal.
    held : mapping of name to float, optional
        standard deviations (SI) of numbers of the ring that are held; those of the result then contain them.
    noise : float or sequence of float, optional
        standard deviation of a sample in the unit of its trace, one for all or one for each, where it is known: the
        misfit and the deviations are then those of this noise. By default estimated from each trace.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        a name, bound or trace that cannot be used.

    The standard deviations follow from the noise and the Jacobian of the residuals, and are widened where the misfit
    rises by less than 2 at two deviations, instead of 4. They are nan where the fit failed, where the periods of a
    trace and its model are incompatible, and for a parameter on a bound. They are inf for one that the traces do not
    determine, such as two of which only the ratio matters. ``notes`` names these parameters.

    Source: Borghi et al., Opt. Express 29, 4363 (2021), end of Section 5, which trains (kappa, tau_f, tau_s, eta) on
    three traces by a multi-objective swarm, and takes the standard deviation over ten runs.
    """
    check_ring(ring)
    ring = with_equal_buses(ring, free)
    what = unknowns(ring, free, model, bounds)
    contradicted = () if model is None else notes_of(check_model(ring, model, what.build(what.start)[1]))
    held = held_deviations(held, [*held_numbers(ring, what.names)], what.names)
    targets = targets_of(traces, noise)
    seed = checks.seed(seed)
    runs = checks.integer("runs", runs, 1, 100, hint="minima of the first step that are followed")
    with bar("identify", runs, show_bar) as advance:
        fits = _enough(_fits(what, targets, runs, seed, advance))
    if not fits:
        raise checks.InputError("no model in the bounds could be integrated under the drive of the traces")
    result = _result(what, targets, fits)
    if not result.failed:
        _, end, prior = fits[0]
        leaning = leaning_of(what, targets, end, prior, result.parameters, result.standard_deviations, held)
        result = replace(result, **leaning._asdict())
    return replace(result, notes=contradicted + result.notes)


def _followed(what: Unknowns, targets: list[Target], start: Prior, seed: int) -> Iterator[End]:
    """Least-squares fits of simulated runs, started at points around a forced fit, the start of lowest misfit first.

    Starts lie on both sides of the forced fit along the weakest direction of its precision, where it is least certain;
    others are drawn at random.
    """
    weights, directions = np.linalg.eigh(start.precision)
    weak = directions[:, 0] / np.abs(directions[:, 0]).max()
    drawn = np.random.default_rng(seed).standard_normal((DRAWN, start.centre.size)) / np.sqrt(weights)
    points = start.centre + np.vstack([np.outer(ALONG, weak), drawn @ directions.T])
    points = np.clip(points, what.low, what.high)
    first = residuals(what, targets, STAGES[0])
    last = residuals(what, targets, STAGES[-1])
    costs = [cost(first, x) for x in points]
    for k in np.argsort(costs)[:TRIES]:
        if not np.isfinite(costs[k]):
            return
        x = points[k]
        for stage in STAGES:
            end = least_squares(
                residuals(what, targets, stage), x, what.low, what.high, steps=stage.steps, traces=len(targets),
                prior=start,
            )  # fmt: skip
            x = end.x
            # where residuals are that large after a stage, a later one does not help
            if _rms(end.r, x.size) > 8.0:
                break
        if (r := last(x)) is not None:
            yield End(x, r, end.J, end.cost)


def _rms(r: Array, unknowns: int) -> float:
    """Root mean square of the residuals that are not 0, with the number of unknowns subtracted from their count."""
    return float(np.sqrt(r @ r / max(int(np.count_nonzero(r)) - unknowns, 1)))


class Fit(NamedTuple):
    """An end of the search with its misfit, and the forced fit from which it started."""

    misfit: float
    end: End
    start: Prior


def _fits(
    what: Unknowns, targets: list[Target], runs: int, seed: int, advance: Callable[[], None]
) -> Iterator[Fit]:  # fmt: skip
    """All fits, in the order of the search."""
    for start in forced_starts(what, [target.forced for target in targets], seed)[:runs]:
        advance()
        for end in _followed(what, targets, start, seed):
            yield Fit(_rms(end.r, end.x.size), end, start)


def _enough(fits: Iterator[Fit]) -> list[Fit]:
    """The fits up to one at the noise level or one found twice, the best first."""
    ends: list[Fit] = []
    for fit in fits:
        # two results that differ by less than 3 % are one
        twice = any(np.abs(fit.end.x - other.end.x).max() < 0.03 for other in ends)
        ends.append(fit)
        if twice or fit.misfit < NOISE_LEVEL:
            break
    return sorted(ends, key=itemgetter(0))


class Judgement(NamedTuple):
    """Best parameters (logarithms), their deviations, whether the fit failed, and sentences of doubt."""

    x: Array
    deviations: Array
    failed: bool
    notes: list[str]


def _by_noise(what: Unknowns, targets: list[Target], fits: list[Fit]) -> Judgement:
    """Test the best fit against the noise of the traces, from which the deviations follow."""
    misfit, end, start = fits[0]
    if misfit > NOISE_LEVEL:
        return _failed(_soft_fit(what, targets, end.x), f"the traces by {misfit:.3g} times their noise")
    wide = curvature(what, targets, STAGES[-1], end.x, start)
    deviations = unknown_as_inf(wide.deviations * _noise_factor(targets, end, misfit))
    step = end.x - start.centre
    off = float(np.sqrt(step @ start.precision @ step / step.size))
    notes = doubts(what, deviations, np.exp(end.x), wide.factor, off)
    return Judgement(end.x, deviations, False, notes + _others(deviations, fits))


def _noise_factor(targets: list[Target], end: End, misfit: float) -> float:
    """The noise that the residuals show over the expected one: 1 where it is known, and at least 1 by few residuals."""
    if all(target.noise is not None for target in targets):
        return 1.0
    many = np.count_nonzero(end.r) > MANY + end.x.size
    return misfit if many else max(misfit, 1.0)


def _by_model_error(what: Unknowns, targets: list[Target], fits: list[Fit]) -> Judgement:
    """Deviations where the traces have no noise: what is left is the error of the model, or of its integration.

    They add in quadrature what the slopes give with residuals as large as those that are left, the spread over starts
    that end at the lowest misfit, and that over fits without one trace each. A model within 1.5 times 3e-5 of the
    period and 2e-4 of the swing is compared to these, any other to 1 and 4 %.
    """
    misfit, end, start = fits[0]
    follows = misfit <= NOISE_LEVEL
    stage = STAGES[-1] if follows else SOFT
    x = end.x if follows else _soft_fit(what, targets, end.x)
    # a prior that says next to nothing: a deviation of 100 of the logarithm
    prior = start if follows else Prior(x, 1e-4 * np.eye(x.size))
    r = residuals(what, targets, stage)(x)
    assert r is not None
    left = _rms(r, x.size)
    errors = comparison(*what.build(x), targets)[0]
    drift = float(np.nanmax(np.abs(errors["period_model"] / errors["period"] - 1), initial=0.0))
    shape = float(errors["shape_error"].max())
    if drift > DRIFT or shape > SHAPE:
        return _failed(x, f"traces without noise by {drift:.2g} of the period and {shape:.2g} of the swing")
    wide = curvature(what, targets, stage, x, prior)
    # residuals by integration are no noise: over the harmonics they add up to twice what they would in quadrature
    slopes = unknown_as_inf(wide.deviations * (2.0 * max(left, 1.0) if follows else left))
    alike = [fit.end.x for fit in fits[1:] if fit.misfit < ALIKE * misfit]
    if not follows:
        alike = [_soft_fit(what, targets, y) for y in alike]
    ends = np.array([x, *alike])
    starts = np.sqrt(np.mean((ends - x) ** 2, axis=0))
    single = spread_over_traces(what, targets, stage, x, start if follows else None)
    deviations = np.sqrt(slopes**2 + starts**2 + single**2)
    about = (
        "the traces show no noise: the deviations hold the error of the model, from the residuals that it leaves, the "
        f"spread over starts that end at the lowest misfit ({len(ends)}) and that over fits without one trace each "
        f"({len(targets) if len(targets) > 1 else 'none'})"
    )
    return Judgement(x, deviations, False, [about, *doubts(what, deviations, np.exp(x), wide.factor, 0.0)])


def _soft_fit(what: Unknowns, targets: list[Target], x: Array) -> Array:
    """Least squares from ``x`` with the deviations of a law that cannot follow the traces within noise."""
    of = residuals(what, targets, SOFT)
    return least_squares(of, x, what.low, what.high, steps=SOFT.steps, traces=len(targets)).x


def _failed(x: Array, misses: str) -> Judgement:
    """The judgement of a fit that misses the traces: no deviations."""
    note = (
        f"the fit failed: the best model found misses {misses}; the law cannot follow them, or the parameters are not "
        "those of the ring; widen bounds, free more, or take another law"
    )
    return Judgement(x, np.full(x.size, np.nan), True, [note])


def _others(deviations: Array, fits: list[Fit]) -> list[str]:
    """A sentence where another end of the search, many deviations away, fits as well as the best."""
    best = fits[0]
    size = np.maximum(np.nan_to_num(deviations, posinf=1.0), 1e-3)
    alike = [fit.end.x for fit in fits if fit.misfit < ALIKE * best.misfit]
    if np.abs((np.array(alike) - best.end.x) / size).max() > 10:
        return ["another set of parameters fits as well: free fewer, or give traces of other powers"]
    return []


def _result(what: Unknowns, targets: list[Target], fits: list[Fit]) -> Identification:
    """Judge the best fit, compare its cycles with the traces, and assemble the Identification."""
    smooth = without_noise(targets)
    judge = _by_model_error if smooth else _by_noise
    x, deviations, failed, notes = judge(what, targets, fits)
    ring, model = what.build(x)
    errors, cycles, more = comparison(ring, model, targets)
    if more:
        notes = [*notes, *more]
        deviations = np.full(x.size, np.nan)
    for note in notes:
        log.warning("%s", note)
    values = np.exp(x)
    tried = np.exp([fit.end.x for fit in fits])
    samples = {name: ("run", tried[:, k]) for k, name in enumerate(what.names)}
    misfits = [fit.misfit for fit in fits]
    return Identification(
        parameters=dict(zip(what.names, values.tolist(), strict=True)),
        standard_deviations=dict(zip(what.names, (values * deviations).tolist(), strict=True)),
        ring=ring,
        model=plain(model),
        residuals=errors,
        cycles=cycles,
        samples=xr.Dataset(samples | {"misfit": ("run", misfits)}),
        failed=failed,
        smooth=smooth,
        notes=tuple(notes),
    )
