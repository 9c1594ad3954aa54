"""Compact thermal models trained on heat data.

Every fit ends in variable projection (`pole_projection`), whose optimum is unique for the paper's models; the paper's
particle swarm, on the logarithms of time constants and gains, can be put before it and then only picks the start. Alone
it is not enough: 4000 evaluations find the optimum 0 to 20 times out of 100 (measured), 20 particles for 10 generations
followed by least squares every time.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import xarray as xr

from thermofem import MZI, CrossSection, Foster, checks
from thermofem.arrays import Array, correlations, deviations, rms
from thermofem.data.dataset import START_FROM, at_probe, responses_of
from thermofem.geometry.section_parts import LIGHT, MODE, WAVELENGTH
from thermofem.models.foster import (
    BORGHI2021_HEAT_CAPACITY,
    check_heat_capacity,
    newton,
    second_order,
    second_order_parameters as parameters_of,
)
from thermofem.ring_temperature import CORE

from .fit_result import (
    OUTSIDE,
    UNSEEN,
    Fit,
    check_explained,
    common,
    lowers_only_noise,
    model_notes,
    pole_parameters,
    undetermined,
)
from .optical_fit import fit_optical
from .pole_projection import FitProblem, Optimum, optimum, polish

METHODS = ("variable projection", "pso")
TRANSFER = "where another part is read than the one that is heated, give transfer=True"
LEAST_MISFIT = 1e-9  # of the swing: one that more poles do not lower


def fit_newton(
    data: xr.Dataset | Sequence[xr.Dataset],
    *,
    heat_capacity: float = BORGHI2021_HEAT_CAPACITY,
    method: str = "variable projection",
) -> Fit:
    """Train Newton's law: one pole, dT' = -dT/tau_th + P/(m c_p).

    Parameters
    ----------
    data : Dataset or list of them
        from `thermofem.solve` or `solve_periodic`; each is weighted by its swing.
    heat_capacity : float, J/K
        the heated core's own m c_p, for the ratio below.
    method : "variable projection" or "pso"
        "pso" lets the paper's particle swarm find the start; it needs pymoo, ``thermofem[swarm]``.

    Returns
    -------
    Fit
        parameters ``tau_th`` (s), ``heat_capacity`` (m c_p of the fit, J/K) and ``heat_capacity_ratio`` (to the core's
        own: the paper finds about 7, an artefact of the single pole).

    Raises
    ------
    InputError
        data without power or rise, or whose best pole is not stable and heating.
    """
    heat_capacity = check_heat_capacity(heat_capacity)
    training = Training.of(data)
    best = training.search(1, method)
    tau = 1 / np.exp(best.log_rate[0])
    capacity = 1 / best.gain[0]
    ratio = capacity / heat_capacity
    parameters = {"tau_th": tau, "heat_capacity": capacity, "heat_capacity_ratio": ratio}
    jacobian = np.array([[-tau, 0], [0, -(capacity**2)], [0, -capacity * ratio]])  # by (log rate, gain)
    model = replace(newton(tau_th=tau, heat_capacity=capacity), **training.parts)
    return training.fit(model, parameters, jacobian, best)


def fit_second_order(
    data: xr.Dataset | Sequence[xr.Dataset],
    *,
    heat_capacity: float = BORGHI2021_HEAT_CAPACITY,
    method: str = "variable projection",
    transfer: bool | None = None,
) -> Fit:
    """Train the paper's second-order equation (Eq. 3): two poles.

    Parameters
    ----------
    data : Dataset or list of them
        from `thermofem.solve` or `solve_periodic`; each is weighted by its swing.
    heat_capacity : float, J/K
        m c_p by which kappa and eta are normalised.
    method : "variable projection" or "pso"
    transfer : bool, optional
        as in `fit_foster`; eta may then be negative.

    Returns
    -------
    Fit
        parameters ``kappa`` (1/s), ``tau_f``, ``tau_s`` (s), ``eta``. They depend on the drive far more than on
        anything else: quote ``training`` with them.

    Raises
    ------
    InputError
        data without power or rise, that show one pole only, or that no stable pair of heating poles fits.
    """
    heat_capacity = check_heat_capacity(heat_capacity)
    training = Training.of(data, transfer=transfer)
    best = training.search(2, method)
    slow, fast = np.exp(best.log_rate)
    g_s, g_f = best.gain
    c_f = g_f * heat_capacity
    c_s = g_s * heat_capacity
    poles = Foster(R=[g_f / fast, g_s / slow], tau=[1 / fast, 1 / slow], **training.parts)
    parameters = parameters_of(poles, heat_capacity)
    if min(c_f, c_s) < 0 and not training.transfer:
        single = optimum(training.problem, 1)
        # 1.02: ratio of two misfits that differ by noise: each parameter of a fit to n samples takes off 1/(2 n)
        alike = single.relative_residual < best.relative_residual * 1.02 + 1e-6
        if alike and single.gain[0] > 0:
            raise checks.InputError("delta_T shows one pole: a second one fits noise", "train fit_newton")
        raise checks.InputError(
            f"the best pair of poles cools when heated (kappa = {parameters['kappa']:.3g} 1/s, eta = "
            f"{parameters['eta']:.3g}); do power and delta_T belong together? {TRANSFER}"
        )
    jacobian = np.array(  # of (kappa, tau_f, tau_s, eta) by (log slow, log fast, g_s, g_f)
        [
            [c_f * slow, c_s * fast, heat_capacity * fast, heat_capacity * slow],
            [0, -1 / fast, 0, 0],
            [-1 / slow, 0, 0, 0],
            [0, 0, heat_capacity, heat_capacity],
        ]
    )
    equation = second_order(**parameters, heat_capacity=heat_capacity) if not training.transfer else poles
    model = replace(equation, **training.parts)
    return training.fit(model, parameters, jacobian, best)


def fit_foster(
    data: xr.Dataset | Sequence[xr.Dataset],
    order: int | str = 5,
    *,
    thermal_resistance: float | None = None,
    method: str = "variable projection",
    transfer: bool | None = None,
    readout: MZI | None = None,
) -> Fit:
    """Train a Foster network of ``order`` poles, every R_i >= 0 where the heated part is read.

        dT = sum_i x_i,    dx_i/dt = (R_i P - x_i)/tau_i

    Parameters
    ----------
    data : Dataset or list of them
        each is weighted by its swing. A step sampled evenly in log t shows every time scale equally.
    order : int, 1 to 12, or "auto"
        "auto" is the smallest that leaves only noise: the next one does not lower the Bayesian information criterion,
        or has a time constant that the data do not determine (Schwarz, Ann. Statist. 6, 461 (1978)).
    thermal_resistance : float, K/W
        static gain to impose; default the Datasets' own ``thermal_resistance`` where all agree (`thermofem.solve`
        writes it), else none.
    method : "variable projection" or "pso"
    transfer : bool, optional
        whether another part is read than the one that is heated, as a core under its heater: the R_i then have either
        sign, because the rise begins late. By default what the Datasets' ``heated`` and ``read`` say, else False.

    readout : MZI, optional
        the data is light behind this interferometer, in any unit: a variable ``optical``, or ``delta_T`` of a table.
        Its ``shift`` is taken as known; bias and visibility are fitted, with the network, as further parameters
        ``bias`` (rad), ``visibility`` and ``half_power`` (P0/2 in the unit of the trace). ``notes`` say which of them
        the trace cannot tell apart. The sign of the bias is that of the first phase turned by heat.

    Returns
    -------
    Fit
        parameters ``R_1``.. (K/W), ``tau_1``.. (s), fastest first. Trained on a log-sampled step of the reference strip
        the rms error over square waves of .1-10 us is 8.5/3.0/1.1/.47/.18/.03 % of the swing for order 2/3/4/5/6/8.

    Raises
    ------
    InputError
        too few samples, an order out of range, data without power or rise, or that no heating pole fits.
    """
    count = None if order == "auto" else checks.integer("order", order, 1, 12)
    if readout is not None:
        return fit_optical(data, count, readout)
    training = Training.of(data, thermal_resistance=thermal_resistance, impose=True, transfer=transfer)
    best = training.search(count or _smallest_order(training), method)
    present = best.gain != 0 if training.transfer else best.gain > 0
    fastest_first = np.flatnonzero(present)[::-1]
    rate = np.exp(best.log_rate)
    n = rate.size
    R = best.gain / rate
    tau = 1 / rate
    jacobian = np.block([[-np.diag(R), np.diag(tau)], [-np.diag(tau), np.zeros((n, n))]])
    rows = np.append(fastest_first, n + fastest_first)
    model = Foster(R=R[fastest_first], tau=tau[fastest_first], **training.parts)
    return training.fit(model, pole_parameters(model), jacobian[rows], best)


def _smallest_order(training: Training) -> int:
    """The smallest number of poles that leaves only noise: a further one lowers n ln(misfit^2) + 2 order ln(n) no more.

    n is the number of independent samples; noise that stays for several rows is not taken for poles.
    """
    problem = training.problem
    shortest, longest = problem.span
    highest = min(12, problem.weight.size // 3)
    before = np.inf
    for order in range(1, highest + 1):
        best = optimum(problem, order)
        tau = np.exp(-best.log_rate)
        beyond = tau.max() > OUTSIDE * longest or tau.min() < shortest / OUTSIDE
        unseen = np.any(best.gain == 0) or best.deviation.max() > UNSEEN
        misfit = max(best.relative_residual, LEAST_MISFIT)
        noise = lowers_only_noise(before, misfit, best.independent)
        if order > 1 and (beyond or unseen or noise):
            return order - 1
        if misfit == LEAST_MISFIT:
            break
        before = misfit
    return order


def _guide(geometry: str | None) -> str:
    """Name of the part that guides the light of a geometry, given by its text."""
    section = CrossSection.from_toml_text(geometry) if geometry else None
    return CORE if section is None or section.light is None else section.light.part


@dataclass(frozen=True, eq=False)
class Training:
    """The training data and the attributes of their Datasets."""

    problem: FitProblem
    names: tuple[str, ...]
    geometry: str | None
    transfer: bool = False
    parts: Mapping[str, Any] = field(default_factory=dict)
    """Names of the heated and the read part, of a transfer channel."""

    @classmethod
    def of(
        cls,
        data: xr.Dataset | Sequence[xr.Dataset],
        *,
        thermal_resistance: float | None = None,
        impose: bool = False,
        transfer: bool | None = None,
    ) -> Training:
        """Collect Datasets for a fit.

        impose: require the static gain that they state and, unless it is a ``transfer`` channel, positive gains.
        transfer: whether another part is read than heated; None: as the Datasets say.
        """
        responses = responses_of(data)
        datasets = [at_probe(d) for d in (data if isinstance(data, Sequence) else [data])]
        if thermal_resistance is not None:
            hint = "it is in K/W (7.87 K/mW is 7870)"
            thermal_resistance = checks.positive("thermal_resistance", thermal_resistance, unit="K/W", hint=hint)
        elif impose:
            thermal_resistance = common([d.thermal_resistance for d in responses])

        def shared(name: str) -> Any:
            return common([d.attrs.get(name) for d in datasets])

        geometry = shared("geometry")
        heated = shared("heated")
        read = shared("read")
        named = bool(heated and read)
        if transfer is None:
            guided = read == LIGHT and heated == _guide(geometry)
            transfer = named and heated != read and not guided
        transfer = checks.flag("transfer", transfer)
        if transfer and any(d.attrs.get(START_FROM) == "rise" for d in datasets):
            raise checks.InputError(
                "data: the start of the heating was found as if the heated part were read; another part rises late by "
                "itself",
                "read the table with start=",
            )
        parts: dict[str, Any] = {}
        if named:
            parts = {"inputs": (heated,), "outputs": (read,)}
        elif transfer:
            parts = {"inputs": ("heater",), "outputs": ("core",)}
        light = {MODE: shared(MODE), WAVELENGTH: shared(WAVELENGTH)}
        if parts and read == LIGHT and None not in light.values():
            parts["origin"] = light
        problem = FitProblem(responses, thermal_resistance, impose and not transfer)
        names = tuple(d.name for d in responses)
        return cls(problem, names, geometry, transfer, parts)

    @property
    def doubts(self) -> tuple[str, ...]:
        """Sentences on doubtful data."""
        doubts = itertools.chain(*(response.doubts for response in self.problem.responses))
        return tuple(dict.fromkeys(doubts))

    def search(self, order: int, method: str) -> Optimum:
        """Find the best poles, from starts on a grid or from the best particle of the swarm."""
        if checks.choice("method", method, METHODS) == "pso":
            start, residual = swarm(self.problem, order)
            best = replace(polish(self.problem, start), swarm_residual=residual)
        else:
            best = optimum(self.problem, order)
        self.check(best.gain, best.relative_residual)
        return best

    def check(self, gain: Array, relative_residual: float) -> None:
        """Raise InputError if no pole heats, or if the best poles explain too little of the data."""
        if not np.any(gain > 0):
            raise checks.InputError(f"no pole of the fit heats; do power and delta_T belong together? {TRANSFER}")
        spread = [(d.rise - d.rise.mean()) / d.swing for d in self.problem.responses]
        deviation = rms(np.concatenate(spread))
        check_explained(relative_residual, deviation, "the power", "delta_T")

    def fit(self, model: Foster, parameters: Mapping[str, float], jacobian: Array, best: Optimum) -> Fit:
        """Make the Fit: named parameters, with standard errors and correlations by first-order propagation."""
        spread = jacobian @ best.covariance @ jacobian.T
        unknown = undetermined(best, self.problem.span, jacobian)
        errors = np.where(unknown, np.inf, deviations(spread))
        notes = model_notes(model, best, self.problem)
        return Fit(
            model=model,
            parameters={name: float(value) for name, value in parameters.items()},
            standard_errors=dict(zip(parameters, errors.tolist(), strict=True)),
            correlations=correlations(spread),
            residual=best.residual,
            relative_residual=best.relative_residual,
            training=self.names,
            notes=(*self.doubts, *notes),
            geometry=self.geometry,
            swarm_residual=best.swarm_residual,
            misfit_is_noise=best.noise,
            training_period=common([r.wave.period for r in self.problem.responses]),
            thermal_resistance_deviation=self.resistance_deviation(best),
        ).recorded()

    def resistance_deviation(self, best: Optimum) -> float:
        """Standard deviation of R_th = sum_i g_i/lambda_i in K/W, by its derivatives -R_i and tau_i; see `Optimum`."""
        tau = np.exp(-best.log_rate)
        slope = np.concatenate([-best.gain * tau, tau])
        if undetermined(best, self.problem.span, slope[np.newaxis])[0]:
            return float("inf")
        variance = float(slope @ best.covariance @ slope)
        return float(np.sqrt(max(variance, 0.0)))


def swarm(problem: FitProblem, order: int) -> tuple[Array, float]:
    """Find rates and amplitudes with the least squared residual by particle swarm, to start a fit from.

    Returns log_rate [shape (order,)]: ln of the rates 1/tau of the best particle, in order.
    Returns residual [K]: rms of that particle, before least squares improve it.
    """
    from pymoo.algorithms.soo.nonconvex.pso import PSO
    from pymoo.optimize import minimize
    from pymoo.problems.functional import FunctionalProblem

    shortest, longest = problem.span
    slopes = []
    for d in problem.responses:
        power = d.wave.mean(0.0, float(d.times[-1]))
        slopes.append(d.rise.max() / max(power, 1e-300))
    slope = max(slopes)
    low = np.repeat([1 / longest, 1e-2 * slope], order)
    high = np.repeat([1 / shortest, 1e1 * slope], order)

    def misfit(particle: Array) -> Array:
        """Residuals of a particle (ln of the rates, then ln of R_i = g_i/lambda_i)."""
        log_rate, log_R = np.split(particle, 2)
        phi = problem.columns(log_rate)
        return problem.misfit(phi, np.exp(log_R + log_rate))

    def square(particle: Array) -> float:
        residuals = misfit(particle)
        return float(np.sum(residuals**2))

    search = FunctionalProblem(2 * order, square, xl=np.log(low), xu=np.log(high))
    best = minimize(search, PSO(pop_size=20), ("n_gen", 10), seed=1).X
    residuals = misfit(best) / problem.weight
    return best[:order], rms(residuals)
