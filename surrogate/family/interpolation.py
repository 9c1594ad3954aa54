"""Properties of members by interpolation between some that were solved; the output maps of k(T) and c_p(T).

    dT = z + a(p) z^2,      z = rise of the member by projection, at small power

with a the coefficient of `surrogate.output_map` at one power, a quadratic polynomial and a Gaussian process of the
parameters (scikit-learn). Members that were not interpolated between, and the hottest of the others, give the error of
the steady rise at the power and at half of it, and of a pulse, against finite elements with the laws of temperature.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.stats import qmc

from thermofem import Foster, OutputMap, Pulse, checks, solve
from thermofem.arrays import Array
from thermofem.fem import HeatProblem
from thermofem.models import NonlinearSystem

from ..reduction.nonlinear_reduction import output_map
from .affine_engine import AffineEngine
from .members import Solver
from .moved_mesh_engine import MovedMeshEngine
from .parameter_box import Box

TAIL = 1e-4  # probability beyond either end of the span on which members are worked out


@dataclass(frozen=True, eq=False)
class Interpolant:
    """A property as a function of the varied parameters.

    low, high [shape (p,)]: span of the computed members; samples outside it are moved to its ends.
    curve: of `smooth`.
    error, worst: rms and largest error over held-out members, relative to their mean.
    """

    low: Array
    high: Array
    curve: Callable[[Array], Array]
    error: float
    worst: float

    def __call__(self, x: Array) -> Array:
        """The property at parameters of shape (p, n)."""
        return self.curve(_shares(x, self.low, self.high))


def interpolate_members(
    values: Callable[[Array], Any], span: Array, count: int, reason: Callable[[], str]
) -> Interpolant:
    """Compute a property for ``count`` members, and interpolate between them.

    values: the property from parameters of shape (p, n).
    span [shape (p, 2)]: ends of the ranges in which the members lie.
    reason: says why members lack the property.
    Raises InputError: too few members for the polynomial, members without the property, or one that is an array.

    Source: Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), Section 2.7.
    """
    p = len(span)
    least = 2 * (p + 1) * (p + 2)
    checks.between("interpolate", count, least, 2000, hint=f"members; {p} parameters need {least} at least")
    u = qmc.Sobol(p, seed=np.random.default_rng(1)).random(2 ** int(np.ceil(np.log2(count))))[:count]
    found = np.asarray(values(span[:, :1] + u.T * (span[:, 1:] - span[:, :1])), dtype=float)
    if found.ndim > 1:
        raise checks.InputError("interpolate is for one number, and the quantity returns an array")
    if np.isnan(found).any():
        raise checks.InputError(
            f"{np.isnan(found).sum()} of {count} members do not have the property, and an interpolation needs it "
            f"everywhere ({reason()}); take narrower distributions, or leave interpolate out"
        )
    test = np.arange(count) % 5 == 0  # 5: one member of so many is held out
    scale = float(abs(found.mean())) or 1.0
    curve = smooth(u[~test], found[~test])
    off = (curve(u[test]) - found[test]) / scale
    rms, worst = float(np.sqrt(np.mean(off**2))), float(np.abs(off).max())
    return Interpolant(span[:, 0], span[:, 1], curve, rms, worst)


def smooth(u: Array, y: Array) -> Callable[[Array], Array]:
    """A quadratic polynomial through samples y (n,) at u (n, p) in a unit cube, and a Gaussian process of the rest."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel

    curve = np.linalg.lstsq(_terms(u), y, rcond=None)[0]
    kernel = ConstantKernel(1.0) * RBF(np.ones(u.shape[1]), (0.05, 50.0))
    process = GaussianProcessRegressor(kernel, alpha=1e-8, normalize_y=True)
    with warnings.catch_warnings():  # of its likelihood: held-out members say how good it is
        warnings.simplefilter("ignore", ConvergenceWarning)
        process.fit(u, y - _terms(u) @ curve)
    return lambda x: np.asarray(_terms(x) @ curve + process.predict(x))


def _shares(x: Array, low: Array, high: Array) -> Array:
    """Place in the span, shape (n, p); the middle where a parameter has one value only."""
    span = high - low
    return np.where(span > 0, np.clip((x.T - low) / np.where(span > 0, span, 1.0), 0.0, 1.0), 0.5)


def _terms(u: Array) -> Array:
    """1, u_i and u_i u_j, shape (n, terms)."""
    i, j = np.triu_indices(u.shape[1])
    return np.column_stack([np.ones(len(u)), u, u[:, i] * u[:, j]])


PULSE, TIMES = 3e-6, np.append(0.0, np.geomspace(1e-8, 1e-5, 31))  # s; during the pulse and after it


@dataclass(frozen=True, eq=False)
class OutputMaps:
    """Coefficients of output maps over the box.

    power [W]: that they hold for.
    shares [shape (n, p)]: places of the solved members, 0 to 1 of each range.
    coefficients [shape (n,), 1/K]
    error: worst over held-out members and the hottest one, of steady rises, relative, and of a pulse, relative to its
        peak.
    """

    power: float
    shares: Array
    coefficients: Array
    error: float

    @cached_property
    def _curve(self) -> Callable[[Array], Array]:
        scale = float(np.abs(self.coefficients).max()) or 1.0
        curve = smooth(self.shares, self.coefficients / scale)
        return lambda x: scale * curve(x)

    def coefficient(self, share: Array) -> float:
        """a in 1/K at a place in the box."""
        return float(self._curve(share[None])[0])

    def slopes(self, box: Box, row: Array) -> Array:
        """d(a)/d(parameter), shape (p,)."""
        step = 1e-4 * (box.high - box.low)  # 1e-4 of a range: half the width of the differences of a
        up, down = (self._curve(box.share(np.clip(row + sign * np.diag(step), box.low, box.high))) for sign in (1, -1))
        width = np.minimum(row + step, box.high) - np.maximum(row - step, box.low)
        return np.asarray((up - down) / width)

    def on(self, linear: Foster, share: Array) -> OutputMap:
        """The member with its map."""
        a, z = self.coefficient(share), linear.thermal_resistance * self.power
        return OutputMap(linear, a, largest_rise=float(z + a * z * z))


def interpolate_output_maps(
    engine: AffineEngine | MovedMeshEngine,
    channel: tuple[str, str],
    power: float,
    member: Callable[[Array], Foster],
    seed: int,
    solver: Solver,
) -> OutputMaps:
    """Solve members with k(T), interpolate their maps, and test them on others.

    channel [(str, str)]: heated and read.
    power [W]: the largest of interest.
    member: Foster network of the family at parameters of shape (p,).
    solver: nothing is kept in its folder.
    Raises InputError: no material depends on temperature, or a member has no steady state at this power.
    """
    power = checks.power("power", power)
    if not engine.reference.nonlinear:
        raise checks.InputError("power is for materials that depend on temperature, and none here does; leave it out")
    box = engine.box
    rows = np.vstack(
        [box.middle[None], box.corners(2 * box.size), box.draw((box.size + 1) * (box.size + 2), seed + 77)]
    )
    # 256: corners of the box, among which the hottest member is looked for
    every = np.vstack([rows, box.corners(256)])
    hottest = max(every, key=lambda row: member(row).thermal_resistance)  # where a map of one coefficient errs most
    tests = np.vstack([box.draw(4, seed, unseen=True), hottest])  # 4 members, and the hottest one
    found = solver(coefficient_of, [(engine, row, channel, power) for row in rows], rows)
    there = [k for k, one in enumerate(found) if one is not None]
    made = OutputMaps(power, box.share(rows[there]), np.array([found[k] for k in there]), 0.0)
    fine_members = solver(nonlinear_reference, [(engine, row, channel, power) for row in tests], tests)
    errors = [
        deviation(made.on(member(row), box.share(row)), truth, power)
        for row, truth in zip(tests, fine_members, strict=True)
        if truth is not None
    ]
    return OutputMaps(power, made.shares, made.coefficients, max(errors))


def coefficient_of(engine: AffineEngine | MovedMeshEngine, row: Array, channel: tuple[str, str], power: float) -> float:
    """Coefficient of the output map of one member, in 1/K."""
    system = _nonlinear_system(engine.heat(row), channel)
    unit = Foster(R=[system.linear.thermal_resistance], tau=[1e-6])  # the coefficient is static
    return output_map(system, power, linear=unit).coefficient


def nonlinear_reference(
    engine: AffineEngine | MovedMeshEngine, row: Array, channel: tuple[str, str], power: float
) -> tuple[Array, Array]:
    """Steady rises at half the power and at the power, and a pulse, of the finite elements with k(T); K."""
    heat = engine.heat(row)
    steady = np.array([heat.steady_rise(share * power, *channel) for share in (0.5, 1.0)])
    run = solve(heat, Pulse(power, PULSE), TIMES, heated=channel[0], read=channel[1], rtol=1e-3)
    return steady, np.asarray(run.delta_T.values)


def deviation(model: OutputMap, truth: tuple[Array, Array], power: float) -> float:
    """Largest error of the steady rises, relative, and of the pulse, relative to its peak."""
    steady, rise = truth
    static = np.abs(model.steady_rise(power * np.array([0.5, 1.0])) / steady - 1).max()
    return max(
        float(static),
        float(np.abs(model.of(model.linear.response(Pulse(power, PULSE), TIMES)) - rise).max() / rise.max()),
    )


def _nonlinear_system(heat: HeatProblem, channel: tuple[str, str]) -> NonlinearSystem:
    found: Any = heat.model(*channel)  # nonlinear, as the geometry has laws of temperature
    return found
