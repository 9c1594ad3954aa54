"""Numbers of members by interpolation between some that were solved: properties and output maps.

    y(p) = sum over k of c_k T_k1(x_1) T_k2(x_2) ...,    k1 + k2 + ... <= degree,    x = 2 share - 1

with T Chebyshev's polynomials, by least squares; members left out give the error.

Output maps of k(T) and c_p(T):

    dT = z + a(p) z^2,      z = rise of the member by projection, at small power

with a the coefficient of `surrogate.output_map` at one power. The error is that of the steady rise at the power and at
half of it, and of a pulse, against finite elements with the laws of temperature; the hottest member is among those left
out.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import comb
from typing import Any

import numpy as np
from numpy.polynomial.chebyshev import chebvander
from scipy.stats import qmc

from thermofem import Foster, OutputMap, Pulse, checks, solve
from thermofem.arrays import Array, NDArray, rms

from ..reduction.nonlinear_reduction import output_map
from .members import Solver
from .parameter_box import Box

TAIL_PROBABILITY = 1e-4  # probability beyond either end of the span on which members are worked out


def interpolate_members(
    values: Callable[[Array], Any], span: Array, count: int, reason: Callable[[], str]
) -> tuple[Callable[[Array], Array], float]:
    """Compute a property for ``count`` members; returns a polynomial through it, and its rms error at held-out members.

    The interpolant takes parameters of shape (p, n), and moves those outside the span to its ends; the error is
    relative to the mean of the members.

    values: the property from parameters of shape (p, n).
    span [shape (p, 2)]: ends of the ranges in which the members lie.
    reason: says why members lack the property.
    Raises InputError: too few members for the polynomial, members without the property, or one that is an array.
    """
    p = len(span)
    least = 2 * (p + 1) * (p + 2)
    checks.between("interpolate", count, least, 2000, hint=f"members; {p} parameters need {least} at least")
    digits = int(np.ceil(np.log2(count)))
    sobol = qmc.Sobol(p, seed=np.random.default_rng(1))
    u = sobol.random_base2(digits)[:count]
    low, high = span.T
    width = high - low
    members = low + u * width
    y = np.asarray(values(members.T), dtype=float)
    if y.ndim > 1:
        raise checks.InputError("interpolate is for one number, and the quantity returns an array")
    missing = np.isnan(y).sum()
    if missing:
        raise checks.InputError(
            f"{missing} of {count} members do not have the property, and an interpolation needs it "
            f"everywhere ({reason()}); take narrower distributions, or leave interpolate out"
        )
    test = np.arange(count) % 5 == 0  # 5: one member of so many is held out
    scale = float(abs(y.mean())) or 1.0
    curve = Polynomial.fit(u[~test], y[~test])
    misfit = curve(u[test]) - y[test]

    def interpolant(x: Array) -> Array:
        shares = (x.T - low) / np.where(width > 0, width, 1.0)
        return curve(shares)

    return interpolant, rms(misfit / scale)


@dataclass(frozen=True, eq=False)
class Polynomial:
    """Sum over k of c_k T_k(x) at points x of the unit cube, with products T_k of Chebyshev polynomials.

    powers [shape (terms, p)]: degrees of the polynomials in each term.
    coefficients [shape (terms, ...)]
    """

    powers: NDArray[Any]
    coefficients: Array

    def __call__(self, x: Array) -> Array:
        """Values at n points, shape (n, p) -> (n, ...)."""
        return np.asarray(chebyshev(x, self.powers) @ self.coefficients)

    @classmethod
    def fit(cls, x: Array, y: Array, powers: NDArray[Any] | None = None) -> Polynomial:
        """Least squares from samples y (n, ...) at points x (n, p); default ``powers``: at most n/2 terms."""
        if powers is None:
            powers = total_degree(x.shape[1], len(x) // 2)
        solution: Any = np.linalg.lstsq(chebyshev(x, powers), y, rcond=None)
        return cls(powers, solution[0])


# Degree. Optical numbers of strips 350 to 700 nm wide are off by 1e-2 at 3, 2e-4 at 6, as the modes themselves are, and
# 12 takes half as many members more; R_th over radius and oxide is off by 4e-3 at 3, 2e-5 at 6 and 6e-8 at 12.
HIGHEST = 6


def total_degree(size: int, most: int) -> NDArray[np.intp]:
    """Exponents (terms, size) of all monomials up to the highest total degree that has at most ``most`` of them."""
    degree = 1
    while degree < HIGHEST and comb(size + degree + 1, size) <= most:
        degree += 1
    degrees = itertools.product(range(degree + 1), repeat=size)
    return np.array([exponents for exponents in degrees if sum(exponents) <= degree])


def chebyshev(shares: Array, powers: NDArray[Any]) -> Array:
    """Products of Chebyshev polynomials of degrees ``powers`` at n points of the unit cube, shape (n, terms)."""
    x = np.clip(2 * shares - 1, -1, 1)
    T = chebvander(x, powers.max())  # (n, size, degree + 1)
    factors = [T[:, k, degrees] for k, degrees in enumerate(powers.T)]
    return np.prod(factors, axis=0)


PULSE = 3e-6  # s
TIMES = np.append(0.0, np.geomspace(1e-8, 1e-5, 31))  # s; during the pulse and after it


@dataclass(frozen=True, eq=False)
class OutputMaps:
    """Coefficients a(p) of the output maps dT = z + a z^2 of all members, interpolated over the box.

    power [W]: largest power, which the maps are made for.
    curve [1/K]: a over the parameters as fractions 0 to 1 of their ranges.
    error: largest relative error of steady rises, and of a pulse relative to its peak, at held-out members and the
        hottest one.
    """

    power: float
    curve: Polynomial
    error: float

    def coefficient(self, share: Array) -> float:
        """Coefficient a in 1/K of the member at fractions ``share`` of the ranges, shape (p,)."""
        return float(self.curve(share[None])[0])

    def slopes(self, box: Box, row: Array) -> Array:
        """Derivatives of a with respect to the parameters at ``row`` (SI), shape (p,)."""
        step = 1e-4 * (box.high - box.low)  # 1e-4 of a range: half the width of the differences of a
        shift = np.diag(step)
        above = np.minimum(row + shift, box.high)
        below = np.maximum(row - shift, box.low)
        width = (above - below).diagonal()
        up = self.curve(box.share(above))
        down = self.curve(box.share(below))
        return (up - down) / width

    def on(self, linear: Foster, share: Array) -> OutputMap:
        """Output map of the member at fractions ``share`` of the ranges, over its model ``linear`` at small power."""
        a = self.coefficient(share)
        z = linear.thermal_resistance * self.power
        rise = z + a * z * z
        return OutputMap(linear, a, largest_rise=float(rise))


def interpolate_output_maps(
    engine: Any,
    channel: tuple[str, str],
    power: float,
    member: Callable[[Array], Foster],
    seed: int,
    solver: Solver,
) -> OutputMaps:
    """Solve members with k(T), interpolate the coefficients of their output maps, and test them on other members.

    engine [Engine]
    channel [(str, str)]: heated and read.
    power [W]: the largest of interest.
    member: Foster network of the family at parameters of shape (p,).
    solver: runs the tasks; its store is not used.
    Raises InputError: no material depends on temperature, or a member has no steady state at this power.
    """
    power = checks.power("power", power)
    if not engine.reference.nonlinear:
        raise checks.InputError("power is for materials that depend on temperature, and none here does; leave it out")
    box = engine.box
    count = (box.size + 1) * (box.size + 2)
    rows = np.vstack([box.middle, box.corners(2 * box.size), box.draw(count, seed + 77)])
    # 256: corners of the box, among which the hottest member is looked for
    every = np.vstack([rows, box.corners(256)])
    hottest = max(every, key=lambda row: member(row).thermal_resistance)  # where a map of one coefficient errs most
    tests = np.vstack([box.draw(4, seed, unseen=True), hottest])  # 4 members, and the hottest one
    tasks = [(engine, row, channel, power) for row in rows]
    # nan of a member that failed
    coefficients = np.array(solver(coefficient_of, tasks, rows), dtype=float)
    solved = np.isfinite(coefficients)
    curve = Polynomial.fit(box.share(rows[solved]), coefficients[solved])
    maps = OutputMaps(power, curve, 0.0)
    test_tasks = [(engine, row, channel, power) for row in tests]
    fine_members = solver(nonlinear_reference, test_tasks, tests)
    errors = []
    for row, truth in zip(tests, fine_members, strict=True):
        if truth is not None:
            model = maps.on(member(row), box.share(row))
            errors.append(deviation(model, truth, power))
    return replace(maps, error=max(errors))


def coefficient_of(engine: Any, row: Array, channel: tuple[str, str], power: float) -> float:
    """Coefficient of the output map of one member, in 1/K."""
    system: Any = engine.heat(row).model(*channel)  # nonlinear, as the geometry has laws of temperature
    unit = Foster(R=[system.linear.thermal_resistance], tau=[1e-6])  # the coefficient is static
    return output_map(system, power, linear=unit).coefficient


def nonlinear_reference(engine: Any, row: Array, channel: tuple[str, str], power: float) -> tuple[Array, Array]:
    """Rises in K of the FEM with k(T): in the steady state at half and full power, shape (2,), and under a pulse."""
    heat = engine.heat(row)
    heated, read = channel
    steady = np.array([heat.steady_rise(share * power, *channel) for share in (0.5, 1.0)])
    run = solve(heat, Pulse(power, PULSE), TIMES, heated=heated, read=read, rtol=1e-3)
    return steady, np.asarray(run.delta_T.values)


def deviation(model: OutputMap, truth: tuple[Array, Array], power: float) -> float:
    """Largest relative error of an output map: of steady rises, and of a pulse response relative to its peak."""
    steady, rise = truth
    powers = power * np.array([0.5, 1.0])
    static = model.steady_rise(powers) / steady - 1
    z = model.linear.response(Pulse(power, PULSE), TIMES)
    pulse = (model.of(z) - rise) / rise.max()
    return float(np.abs([*static, *pulse]).max())
