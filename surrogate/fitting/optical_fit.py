"""A Foster network fitted to the light behind an interferometer.

    s(t) = a [1 + V cos(phi_0 + phi(t))],    phi(t) = phi_T sum_i R_i y_i(t; tau_i)

with y_i the response of a pole of gain 1 to the power. As s = a + b cos(phi) + c sin(phi) the trace is linear in a, b
and c, which are eliminated (variable projection); a = P0/2, V = hypot(b, c)/a and phi_0 = atan2(-c, b) follow. Only
ln R_i and ln tau_i are searched for, from several starts, as the trace is periodic in the phase.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from scipy.optimize import approx_fprime, least_squares

from thermofem import MZI, Foster, checks
from thermofem.algebra.pole_responses import pole_responses
from thermofem.arrays import Array
from thermofem.data.dataset import Response, responses_of

from .fit_result import Fit
from .pole_projection import covariance

PHASES = np.pi * np.array([0.15, 0.4, 0.8, 1.2, 1.7, 2.4, 3.2])  # largest phases of the starts, rad
UNCERTAIN = 0.1  # standard error of ln R, ln tau, V or phi_0 in rad from which a note says so
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

    def phases(self, logs: Array) -> Array:
        """Phase phi(t) of the light in rad at all samples of all traces, one after the other; shape (samples,).

            phi(t) = phi_T sum_i R_i y_i(t; tau_i)

        logs [shape (2 poles,)]: ln R_i (R in K/W) of all poles, then ln tau_i (tau in s).
        """
        R, tau = np.exp(logs.reshape(2, -1))
        answers = [pole_responses(1 / tau, d.wave, d.times, periodic=d.periodic) for d in self.responses]
        return np.asarray(self.shift * np.concatenate(answers) @ (R / tau))

    @property
    def target(self) -> Array:
        """Measured light of all traces, one after the other, shape (samples,)."""
        return np.concatenate(self.light)

    def linear(self, logs: Array) -> tuple[Array, Array]:
        """Best a, b and c of s = a + b cos(phi) + c sin(phi), shape (3,), and the residuals, shape (samples,)."""
        phi = self.phases(logs)
        columns = np.column_stack([np.ones_like(phi), np.cos(phi), np.sin(phi)])
        found = np.linalg.lstsq(columns, self.target, rcond=1e-10)[0]
        return found, columns @ found - self.target

    def misfit(self, logs: Array) -> Array:
        """Residuals of all samples, and one penalty that grows where V > 1 or P0 < 0, which no light can have."""
        (a, b, c), left = self.linear(logs)
        return np.append(left, np.sqrt(left.size) * max(float(np.hypot(b, c) - a), 0.0))

    def model(self, parameters: Array) -> Array:
        """Light s at every sample, shape (samples,), for the parameters ln R_i, ln tau_i, V, phi_0 and a."""
        logs, (V, bias, a) = parameters[:-3], parameters[-3:]
        return np.asarray(a * (1 + V * np.cos(bias + self.phases(logs))))


def fit_optical(data: xr.Dataset | Sequence[xr.Dataset], order: int, readout: MZI) -> Fit:
    """Fit ``order`` poles, bias and visibility to Datasets with a variable ``optical`` (or light as ``delta_T``).

    Only phi_T of ``readout`` is taken as known; its bias and visibility are the first of several starts.
    """
    if not readout.shift:
        raise checks.InputError("readout: shift = 0 rad/K turns no phase; give phi_T = 2 pi L (dn/dT)/wavelength")
    each: Any = data if isinstance(data, list | tuple) else [data]
    responses = responses_of([_light(one) for one in each])
    problem = Optical(responses, [np.asarray(one.rise, dtype=float) for one in responses], readout.shift)
    logs = _search(problem, order)
    order_by_tau = np.argsort(logs[order:])
    logs = np.concatenate([logs[:order][order_by_tau], logs[order:][order_by_tau]])
    (a, b, c), left = problem.linear(logs)
    end = np.concatenate([logs, [np.hypot(b, c) / a, np.arctan2(-c, b), a]])
    return _concluded(problem, end, left, order)


def _light(data: xr.Dataset) -> xr.Dataset:
    """The Dataset with its light as ``delta_T``, and without a thermal resistance."""
    if "optical" in data:
        data = data.assign(delta_T=data["optical"].assign_attrs(data["delta_T"].attrs))
    data = data.copy()
    data.attrs.pop("thermal_resistance", None)
    return data


def _search(problem: Optical, order: int) -> Array:
    """ln R_i, then ln tau_i, of the smallest misfit from all starts, shape (2 order,)."""
    first = np.concatenate([one.times[one.times > 0][:1] for one in problem.responses]).min()
    last = max(float(one.times.max()) for one in problem.responses)
    ends = []
    for phase in PHASES:
        for low, high in ((0.02, 0.3), (0.002, 0.1)):
            tau = np.geomspace(max(low * last, first), high * last, order) if order > 1 else np.array([high * last])
            logs = np.log(np.concatenate([np.full(order, 1.0), tau]))
            largest = float(np.abs(problem.phases(logs)).max())
            logs[:order] += np.log(phase / largest)
            ends.append(least_squares(problem.misfit, logs, bounds=(logs - BOUND, logs + BOUND), max_nfev=60 * order))
    return np.asarray(min(ends, key=lambda end: float(end.cost)).x)


def _concluded(problem: Optical, end: Array, left: Array, order: int) -> Fit:
    """Make the Fit from the optimum ``end``: parameters, errors, and what the trace cannot tell apart."""
    names = [f"{kind}_{k}" for kind in ("R", "tau") for k in range(1, order + 1)] + ["visibility", "bias", "half_power"]
    traces = np.split(left, np.cumsum([one.size for one in problem.light])[:-1])
    variance = float(left @ left) / max(left.size - end.size, 1)
    found = covariance(approx_fprime(end, problem.model), traces, variance)
    deviation = np.sqrt(np.maximum(found.diagonal(), 0))
    safe = np.maximum(deviation, np.finfo(float).tiny)
    scale = np.concatenate([np.exp(end[:-3]), [1.0, 1.0, 1.0]])
    values = np.concatenate([np.exp(end[:-3]), end[-3:]])
    rms = float(np.sqrt(np.mean(left**2)))
    return Fit(
        model=Foster(R=values[:order], tau=values[order : 2 * order]),
        parameters=dict(zip(names, values.tolist(), strict=True)),
        standard_errors=dict(zip(names, (scale * deviation).tolist(), strict=True)),
        correlations=found / np.outer(safe, safe),
        residual=rms,
        relative_residual=rms / float(np.ptp(problem.target)),
        training=tuple(one.name for one in problem.responses),
        notes=tuple(_apart(names, found, np.append(np.ones(end.size - 1), abs(end[-1])))),
    ).recorded()


def _apart(names: Sequence[str], covariance: Array, size: Array) -> list[str]:
    """A sentence for every direction of the parameters that the trace leaves open by more than `UNCERTAIN`.

    covariance: of ln R_i, ln tau_i, V, phi_0 and the half power, shape (p, p); ``size``: scale of each.
    """
    notes = []
    squares, directions = np.linalg.eigh(covariance / np.outer(size, size))
    for square, direction in zip(squares[::-1], directions.T[::-1], strict=True):
        open_by = np.sqrt(max(square, 0.0)) * np.abs(direction)
        open_names = [name for name, size in zip(names, open_by, strict=True) if size > UNCERTAIN]
        if len(open_names) > 1:
            notes.append(f"the trace cannot tell {', '.join(open_names)} apart: drive it further, or at another bias")
        elif open_names:
            notes.append(f"the trace does not determine {open_names[0]}: drive it further, or at another bias")
    return list(dict.fromkeys(notes))
