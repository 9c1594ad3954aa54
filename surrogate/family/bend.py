"""k(T) and c_p(T) in a family: the output map of a member, interpolated between members that were solved.

    dT = z + a(p) z^2,      z = rise of the member of the reduced basis, at small power

with a the coefficient of `surrogate.output_map` at one power, a quadratic polynomial and a Gaussian process of the
parameters (scikit-learn). Members that were not interpolated between, and the hottest of the others, give the error of
the steady rise at the power and at half of it, and of a pulse, against finite elements with the laws of temperature.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from thermofem import Foster, HeatProblem, OutputMap, Pulse, checks, solve
from thermofem.arrays import Array
from thermofem.models import NonlinearSystem

from ..reduction.output_map import output_map
from .affine import LineEngine
from .box import Box
from .interpolant import smooth
from .moved import MovedEngine
from .solving import Solver

TESTED = 4  # members, and the hottest one
ASKED = 256  # corners of the box, among which the hottest member is looked for
PULSE, TIMES = 3e-6, np.append(0.0, np.geomspace(1e-8, 1e-5, 31))  # s; during the pulse and after it
SLOPE = 1e-4  # of a range: half the width of the differences of a


@dataclass(frozen=True, eq=False)
class Bend:
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
        step = SLOPE * (box.high - box.low)
        up, down = (self._curve(box.share(np.clip(row + sign * np.diag(step), box.low, box.high))) for sign in (1, -1))
        width = np.minimum(row + step, box.high) - np.maximum(row - step, box.low)
        return np.asarray((up - down) / width)

    def on(self, linear: Foster, share: Array) -> OutputMap:
        """The member with its map."""
        a, z = self.coefficient(share), linear.thermal_resistance * self.power
        return OutputMap(linear, a, largest_rise=float(z + a * z * z))


def bend_of(
    engine: LineEngine | MovedEngine,
    channel: tuple[str, str],
    power: float,
    member: Callable[[Array], Foster],
    seed: int,
    solver: Solver,
) -> Bend:
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
    every = np.vstack([rows, box.corners(ASKED)])
    hottest = max(every, key=lambda row: member(row).thermal_resistance)  # where a map of one coefficient errs most
    tests = np.vstack([box.draw(TESTED, seed + 7919), hottest])
    found = solver(coefficient_of, [(engine, row, channel, power) for row in rows], rows)
    there = [k for k, one in enumerate(found) if one is not None]
    made = Bend(power, box.share(rows[there]), np.array([found[k] for k in there]), 0.0)
    truths = solver(truth_of, [(engine, row, channel, power) for row in tests], tests)
    errors = [
        deviation(made.on(member(row), box.share(row)), truth, power)
        for row, truth in zip(tests, truths, strict=True)
        if truth is not None
    ]
    return Bend(power, made.shares, made.coefficients, max(errors))


def coefficient_of(engine: LineEngine | MovedEngine, row: Array, channel: tuple[str, str], power: float) -> float:
    """Coefficient of the output map of one member, in 1/K."""
    system = _system(engine.heat(row), channel)
    unit = Foster(R=[system.linear.thermal_resistance], tau=[1e-6])  # the coefficient is static
    return output_map(system, power, linear=unit).coefficient


def truth_of(
    engine: LineEngine | MovedEngine, row: Array, channel: tuple[str, str], power: float
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


def _system(heat: HeatProblem, channel: tuple[str, str]) -> NonlinearSystem:
    found = heat.model(*channel)
    if not isinstance(found, NonlinearSystem):
        raise TypeError("the geometry has laws of temperature")
    return found
