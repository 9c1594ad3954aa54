"""A Foster network fitted to the light behind an interferometer.

    s(t) = a [1 + V cos(phi_0 + phi(t))],    phi(t) = phi_T sum_i R_i y_i(t; tau_i)

with y_i the response of a pole of gain 1 to the power. As s = a + b cos(phi) + c sin(phi) the trace is linear in a, b
and c, which are eliminated (variable projection); a = P0/2, V = hypot(b, c)/a and phi_0 = atan2(-c, b) follow. Only
ln R_i and ln tau_i are searched for, from several starts, as the trace is periodic in the phase. Where the start of the
heating was found in a measured trace, its share u of the range w is searched with them: y_i(t - u w), 0 <= u <= 1.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from scipy.optimize import approx_fprime, least_squares

from thermofem import MZI, Foster, checks
from thermofem.arrays import Array, correlations, deviations, independent, rms
from thermofem.data import quantity
from thermofem.data.dataset import LIGHT_UNIT, START_FROM, Response, responses_of

from .fit_result import UNSEEN, Fit, lowers_only_noise, pole_parameters
from .pole_projection import by_trace, covariance, late_responses

PHASES = np.pi * np.array([0.15, 0.4, 0.8, 1.2, 1.7, 2.4, 3.2])  # largest phases of the starts, rad
SPANS = ((0.02, 0.3), (0.002, 0.1))  # fastest and slowest time constant of the starts over the length of the data
UNCERTAIN = 0.1  # standard error of ln R, ln tau, V or phi_0 in rad from which a note says so
LIKELY = 0.9  # of the range of a start, at which its search begins: the light departs soon after
BOUND = 12.0  # of the natural logarithms from their start: five decades either way


@dataclass(frozen=True, eq=False)
class Optical:
    """Light traces behind an interferometer, the drives that heat it, and its phase per kelvin.

    light [each of shape (n,)]: measured, in any unit.
    shift [rad/K]
    """

    responses: list[Response]
    light: list[Array]
    shift: float

    @property
    def ranges(self) -> Array:
        """How much later than t = 0 the heating of each trace may begin, in s, for those whose start is fitted."""
        ranges = np.array([response.start_within for response in self.responses])
        return ranges[ranges > 0]

    def phases(self, unknowns: Array) -> Array:
        """Phase phi(t) of the light in rad at all samples of all traces, one after the other; shape (samples,).

            phi(t) = phi_T sum_i R_i y_i(t - u w; tau_i)

        unknowns [shape (2 poles + starts,)]: ln R_i (R in K/W) of all poles, ln tau_i (tau in s), u of every start.
        """
        logs, shares = np.split(unknowns, [unknowns.size - self.ranges.size])
        R, tau = np.exp(logs.reshape(2, -1))
        late = iter(shares * self.ranges)
        answers = []
        for response in self.responses:
            shift = next(late) if response.start_within > 0 else 0.0
            answers.append(late_responses(response, 1 / tau, float(shift)))
        phase = self.shift * np.concatenate(answers)
        return phase @ (R / tau)

    @property
    def target(self) -> Array:
        """Measured light of all traces, one after the other, shape (samples,)."""
        return np.concatenate(self.light)

    def linear(self, unknowns: Array) -> tuple[Array, Array]:
        """Best a, b and c of s = a + b cos(phi) + c sin(phi), shape (3,), and the residuals, shape (samples,)."""
        phi = self.phases(unknowns)
        columns = np.column_stack([np.ones_like(phi), np.cos(phi), np.sin(phi)])
        abc, *_ = np.linalg.lstsq(columns, self.target, rcond=1e-10)
        return abc, columns @ abc - self.target

    def misfit(self, unknowns: Array) -> Array:
        """Residuals of all samples, and one penalty that grows where V > 1 or P0 < 0, which no light can have."""
        (a, b, c), residuals = self.linear(unknowns)
        excess = max(np.hypot(b, c) - a, 0.0)
        return np.append(residuals, np.sqrt(residuals.size) * excess)

    def model(self, parameters: Array) -> Array:
        """Light s at every sample, shape (samples,), for the parameters ln R_i, ln tau_i, u of starts, V, phi_0, a."""
        V, bias, a = parameters[-3:]
        phase = bias + self.phases(parameters[:-3])
        return a * (1 + V * np.cos(phase))


def fit_optical(data: xr.Dataset | Sequence[xr.Dataset], order: int | None, readout: MZI) -> Fit:
    """Fit ``order`` poles, bias and visibility to Datasets with a variable ``optical`` (or light as ``delta_T``).

    Only phi_T of ``readout`` is taken as known. order: None for the smallest that leaves only noise.
    Raises InputError: a table whose start was searched as that of a temperature, which light does not follow.
    """
    if not readout.shift:
        raise checks.InputError("readout: shift = 0 rad/K turns no phase; give phi_T = 2 pi L (dn/dT)/wavelength")
    datasets: Any = data if isinstance(data, list | tuple) else [data]
    for dataset in datasets:
        if dataset.attrs.get(START_FROM) == "rise" and "optical" not in dataset:
            rule = "data: the start of the heating was found as if the light were a temperature"
            raise checks.InputError(rule, "read the table with light=True, or with start=")
    responses = responses_of([_light(dataset) for dataset in datasets])
    light = [np.asarray(response.rise, dtype=float) for response in responses]
    problem = Optical(responses, light, readout.shift)
    if order is None:
        order, unknowns = _smallest(problem)
    else:
        unknowns = _search(problem, order)
    log_R, log_tau, starts = np.split(unknowns, [order, 2 * order])
    fastest_first = np.argsort(log_tau)
    unknowns = np.concatenate([log_R[fastest_first], log_tau[fastest_first], starts])
    (a, b, c), residuals = problem.linear(unknowns)
    visibility = np.hypot(b, c) / a
    bias = np.arctan2(-c, b)
    end = np.append(unknowns, [visibility, bias, a])
    units = {dataset.attrs.get(LIGHT_UNIT, "") for dataset in datasets}
    unit = units.pop() if len(units) == 1 else ""
    return _concluded(problem, end, residuals, unit)


def _smallest(problem: Optical) -> tuple[int, Array]:
    """The smallest number of poles that leaves only noise, and its unknowns, as `fit._smallest_order` has it."""
    # 1e-6: of the swing: a misfit that more poles do not lower
    least = 1e-6 * float(np.ptp(problem.target))
    before = np.inf
    unknowns = np.empty(0)
    # 5: poles at most
    for order in range(1, 6):
        further = _search(problem, order)
        _, residuals = problem.linear(further)
        misfit = max(rms(residuals), least)
        if lowers_only_noise(before, misfit, independent(residuals)):
            return order - 1, unknowns
        unknowns = further
        before = misfit
        if misfit == least:
            break
    return order, unknowns


def _light(data: xr.Dataset) -> xr.Dataset:
    """The Dataset with its light as ``delta_T``, and without a thermal resistance."""
    if "optical" in data:
        light = data["optical"].assign_attrs(data["delta_T"].attrs)
        data = data.assign(delta_T=light)
    data = data.copy()
    data.attrs.pop("thermal_resistance", None)
    return data


def _search(problem: Optical, order: int) -> Array:
    """Unknowns of the smallest misfit, shape (2 order + starts,): ln R_i, ln tau_i, and u of the start of every trace.

    A search begins from each of `PHASES`, with equal R_i that turn the phase by so much, and from each of `SPANS`.
    """
    steps = [np.diff(np.unique(response.times)).min() for response in problem.responses]
    longest = max(np.ptp(response.times) for response in problem.responses)
    starts = problem.ranges.size
    late = np.full(starts, LIKELY)
    ends = []
    for phase, span in itertools.product(PHASES, SPANS):
        fastest, slowest = longest * np.array(span)
        fastest = max(fastest, min(steps)) if order > 1 else slowest
        log_tau = np.log(np.geomspace(fastest, slowest, order))
        guess = np.concatenate([np.ones(order), log_tau, late])
        turned = np.ptp(problem.phases(guess))
        guess[:order] += np.log(phase / turned)
        logs = guess[: 2 * order]
        least = np.append(logs - BOUND, np.zeros(starts))
        most = np.append(logs + BOUND, np.ones(starts))
        ends.append(least_squares(problem.misfit, guess, bounds=(least, most), max_nfev=60 * order))
    best = min(ends, key=lambda end: float(end.cost))
    return best.x


def _concluded(problem: Optical, end: Array, residuals: Array, unit: str) -> Fit:
    """Make the Fit from the optimum ``end``: parameters, errors, and what the trace cannot tell apart.

    residuals [shape (samples,), ``unit``]: of the light.
    """
    order = (end.size - problem.ranges.size - 3) // 2
    logs, starts, of_light = np.split(end, [2 * order, -3])
    R, tau = np.exp(logs.reshape(2, -1))
    model = Foster(R=R, tau=tau)
    late = starts * problem.ranges
    parameters = pole_parameters(model)
    parameters |= {f"late_{k}": value for k, value in enumerate(late.tolist(), 1)}
    parameters |= zip(("visibility", "bias", "half_power"), of_light.tolist(), strict=True)
    freedom = max(residuals.size - end.size, 1)
    square = float(residuals @ residuals)
    jacobian = approx_fprime(end, problem.model)
    spread = covariance(jacobian, by_trace(residuals, problem.responses), square / freedom)
    deviation = deviations(spread)
    slope = np.concatenate([R, tau, problem.ranges, np.ones(3)])  # of each parameter by its unknown
    unseen = deviation > UNSEEN
    unseen[2 * order :] = False  # of poles alone
    errors = np.where(unseen, np.inf, slope * deviation)
    size = np.append(np.ones(end.size - 1), abs(end[-1]))
    notes = _start_notes(starts, late, errors[2 * order : -3])
    misfit = rms(residuals)
    return Fit(
        model=model,
        parameters=parameters,
        standard_errors=dict(zip(parameters, errors.tolist(), strict=True)),
        correlations=correlations(spread),
        residual=misfit,
        residual_unit=unit,
        relative_residual=misfit / float(np.ptp(problem.target)),
        training=tuple(response.name for response in problem.responses),
        notes=(*notes, *_apart(list(parameters), spread, size)),
    ).recorded()


def _start_notes(shares: Array, late: Array, errors: Array) -> list[str]:
    """A sentence on every start that was fitted, by its share of the range, and in s."""
    notes = []
    for share, shift, error in zip(shares, late, errors, strict=True):
        size = quantity.rounded(float(shift), "s")
        error = quantity.rounded(float(error), "s", 2)
        notes.append(f"the start is fitted with the poles: {size} +- {error} after the earliest that the light allows")
        # 1e-3: of the range of a start, from its end on which it counts as held there
        if share > 1 - 1e-3:
            notes.append("the start is at the end of its range, and may be later: say it with --start")
    return notes


def _apart(names: Sequence[str], covariance: Array, size: Array) -> list[str]:
    """A sentence for every direction of the parameters that the trace leaves open by more than `UNCERTAIN`.

    covariance: of ln R_i, ln tau_i, V, phi_0 and the half power, shape (p, p); ``size``: scale of each.
    """
    notes = []
    squares, directions = np.linalg.eigh(covariance / np.outer(size, size))
    for square, direction in zip(squares[::-1], directions.T[::-1], strict=True):
        error = np.sqrt(max(square, 0.0)) * np.abs(direction)
        open_names = ", ".join(itertools.compress(names, error > UNCERTAIN))
        verb = f"cannot tell {open_names} apart" if "," in open_names else f"does not determine {open_names}"
        if open_names:
            notes.append(f"the trace {verb}: drive it further, or at another bias")
    return list(dict.fromkeys(notes))
