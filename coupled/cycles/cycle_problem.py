"""The dynamical system of a ring, its thermal model and a constant laser, and its parameters by name."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from thermofem import Foster, InputError, Quadratic, checks
from thermofem.arrays import Array

from ..arguments import check_power
from ..equilibria.balance import InternalRing, absorbable, internal_ring
from ..equilibria.steady_states import survey
from ..heaters import turned_by
from ..kernel.integrator import CARRIERS, ENERGY, Problem
from ..kernel.tableaus import Method
from ..kernel.units import NS, internal_detuning, internal_pump, single_ring
from ..resonator import RingResonator
from ..ring_toml import UNITS
from ..thermal import Compact, compact
from ..unknowns import FROM_ZERO, number_of, optical_names, varied
from .cycle_search import settled
from .return_map import Flow, Orbit

LONGEST_TRANSIENT = 2e6  # ns
SLOWEST, MOST_TRANSIENT = 30, 1e8  # of the slowest time constant, where that is longer; ns, at most


@dataclass(frozen=True, eq=False)
class CycleProblem:
    """A ring with its thermal model under constant power and detuning, of which cycles are computed.

    model: as `thermal.compact` returns it.
    power [W], detuning [Hz]
    rise [K]: constant temperature rise by heaters.
    """

    ring: RingResonator
    model: Compact
    power: float
    detuning: float
    rise: float = 0.0

    @property
    def total_detuning(self) -> float:
        """Detuning in Hz plus the resonance shift by the heaters: that of the equivalent ring without heaters."""
        return self.detuning + turned_by(self.rise, self.ring)

    def kernel(self, method: Method) -> Problem:
        """The equations for the C++ kernel, in internal units, to be integrated with a Rosenbrock method."""
        return single_ring(self.ring, self.model, self.power, self.total_detuning, 1.0, method)

    @cached_property
    def flow(self) -> Flow:
        """The flow of the system, with a Poincare section in the carriers; in the energy if there are none."""
        quantity = CARRIERS if self.ring.g_tpa > 0 else ENERGY
        return Flow(self.kernel(Method.RODAS4), self.kernel(Method.RODAS5P), quantity)

    @cached_property
    def internal(self) -> InternalRing:
        """The ring and its steady thermal response in internal units; InputError if the model has no steady state."""
        return internal_ring(self.ring, self.model, absorbable(self.ring, self.power))

    @property
    def laser(self) -> tuple[float, float]:
        """Pump amplitude in sqrt(fJ)/ns and detuning in rad/ns, heaters included."""
        return internal_pump(self.ring, self.power), internal_detuning(self.total_detuning)

    @property
    def poles(self) -> Foster | None:
        """The Foster network of the thermal model, or that below its output map; None for a quadratic model."""
        return None if isinstance(self.model, Quadratic) else self.model.linear

    @cached_property
    def stable_points(self) -> Array:
        """Stable fixed points, rows (U, N, dT) in internal units; empty if the model has no steady state."""
        try:
            at = self.internal
        except InputError:
            return np.empty((0, 3))
        return survey(*self.laser, at)[0].stable

    @property
    def longest(self) -> float:
        """Longest transient in ns that is integrated before a cycle must have been found."""
        slowest = 1 / (NS * self.model.slowest_rate)
        return max(LONGEST_TRANSIENT, min(SLOWEST * slowest, MOST_TRANSIENT))

    @property
    def where(self) -> str:
        """Power and detuning as text for error messages."""
        return f" at power = {self.power:g} W, detuning = {self.detuning:g} Hz"

    def settled(self, y: Array, begin: str = "a cold ring") -> Orbit:
        """The stable cycle to which the transient from the state ``y`` converges; errors as `cycle_search.settled`."""
        orbit: Orbit = settled(
            self.flow, y, lambda: self.stable_points, self.longest, begin=begin, where=self.where,
            slow=self.longest >= MOST_TRANSIENT,
        )  # fmt: skip
        return orbit


RELATIVE_STEP = 1e-4  # of a number: its fourth power is the truncation, 1e-16 over it the round-off
LASER = ("power", "detuning")


def numbers_of(p: CycleProblem) -> dict[str, tuple[float, str]]:
    """Value and unit (SI) of every parameter that `changed` accepts, by name; "R1", "tau1": the fastest pole."""
    numbers = {"power": (p.power, "W"), "detuning": (p.detuning, "Hz")}
    for name in sorted(optical_names(p.ring)):
        numbers[name] = (number_of(p.ring, name), UNITS[name])
    for k, (coefficient, exponent) in enumerate(p.ring.fcd):
        numbers[f"fcd{k + 1}"] = (coefficient, f"m^{3 * exponent:g}")
    if p.poles:
        for name, unit in (("R", "K/W"), ("tau", "s")):
            for k, value in enumerate(getattr(p.poles, name)):
                numbers[f"{name}{k + 1}"] = (float(value), unit)
    return numbers


def value_of(p: CycleProblem, name: str) -> float:
    """Return the value of a parameter of a problem by its name, in SI."""
    numbers = numbers_of(p)
    return numbers[checks.choice("a parameter", name, numbers)][0]


def changed(p: CycleProblem, name: str, value: float) -> CycleProblem:
    """Return a copy of the problem in which the parameter ``name`` has another value (SI)."""
    if name in optical_names(p.ring):
        return replace(p, ring=varied(p.ring, {name: value}))
    if name == "power":
        return replace(p, power=check_power(value))
    if name == "detuning":
        return replace(p, detuning=value)
    kind = name.rstrip("0123456789")
    number = int(name.removeprefix(kind)) - 1
    if kind == "fcd":
        terms = [(value, term[1]) if k == number else term for k, term in enumerate(p.ring.fcd)]
        return replace(p, ring=replace(p.ring, fcd=tuple(terms)))
    assert p.poles is not None  # a quadratic model has no such parameter
    numbers: dict[str, Any] = {key: np.array(getattr(p.poles, key), dtype=float) for key in ("R", "tau")}
    numbers[kind][number] = value
    network = replace(p.poles, **numbers)  # checks them and sorts them
    checks.keep(network, **numbers)  # states and names keep their poles where one time constant passes another
    return replace(p, model=compact(replace(p.model, linear=network)))  # type: ignore[arg-type]


def differences(p: CycleProblem, name: str) -> list[tuple[float, CycleProblem]]:
    """Pairs (weight, problem) of a difference formula: sum of weight f(y; problem) is df/d(parameter), per SI unit."""
    value = value_of(p, name)
    size = p.ring.linear_rate / (2 * np.pi) if name == "detuning" else abs(value)
    h = RELATIVE_STEP * size or FROM_ZERO.get(name, 0.0)
    if h == 0:
        raise checks.InputError(f"{name} is 0 and has no step for differences; give it a small value")
    if value != 0 or name == "detuning":
        stencil = ((1, 8), (-1, -8), (2, -1), (-2, 1))  # of order 4: steps from the value, weights
        return [(weight / (12 * h), changed(p, name, value + steps * h)) for steps, weight in stencil]
    near = changed(p, name, h)
    far = changed(p, name, 2 * h)
    return [(4 / (2 * h), near), (-1 / (2 * h), far), (-3 / (2 * h), p)]
