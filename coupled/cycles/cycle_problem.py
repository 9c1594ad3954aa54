"""One ring, its heat and its laser, whose cycles are wanted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from thermofem.arrays import Array
from thermofem.checks import InputError

from ..equilibria.balance import InternalRing, absorbable, internal_ring
from ..equilibria.spectrum import stable_points
from ..heaters import turned_by
from ..kernel.integrator import CARRIERS, ENERGY, PoleHeat, Problem
from ..kernel.tableaus import Method
from ..kernel.units import NS, internal_detuning, internal_pump, single_ring, units
from ..resonator import RingResonator
from ..thermal import Compact
from .return_map import FINE, Flow, Orbit
from .settling import settled

LONGEST = 2e6  # ns, of a transient
SLOWEST, MOST = 30, 1e8  # of the slowest time constant, where that is longer; ns, at most
SECOND = 1e9  # ns


@dataclass(frozen=True, eq=False)
class CycleProblem:
    """A ring under constant light.

    model: `thermal.compact`.
    power [W], detuning [Hz]
    rise [K]: by constant heaters.
    """

    ring: RingResonator
    model: Compact
    power: float
    detuning: float
    rise: float = 0.0

    @property
    def total_detuning(self) -> float:
        """The detuning with what heaters turn the resonance by, Hz."""
        return self.detuning + turned_by(self.rise, self.ring)

    def kernel(self, method: Method) -> Problem:
        """The system as the kernel takes it."""
        return single_ring(self.ring, self.model, self.power, self.total_detuning, SECOND * NS, method)

    @cached_property
    def flow(self) -> Flow:
        """Its flow, with a section in the carriers, or in the energy of a ring that has none."""
        quantity = CARRIERS if self.ring.g_tpa > 0 else ENERGY
        return Flow(self.kernel(Method.RODAS4), self.kernel(Method.RODAS5P), quantity)

    @cached_property
    def units(self) -> Array:
        """SI value of the internal units of the states."""
        return units(self.flow.rough.order)

    @cached_property
    def internal(self) -> InternalRing:
        """Ring and heat at rest; InputError for a model without a steady state at the power."""
        return internal_ring(self.ring, self.model, absorbable(self.ring, self.power))

    @property
    def laser(self) -> tuple[float, float]:
        """Pump in sqrt(fJ)/ns and detuning in rad/ns."""
        return internal_pump(self.ring, self.power), internal_detuning(self.total_detuning)

    @cached_property
    def stable_points(self) -> Array:
        """Stable fixed points, rows (U, N, dT); none for a model without steady states at the largest power."""
        try:
            at = self.internal
        except InputError:
            return np.full((1, 3), np.nan)
        pump, detuning = self.laser
        return np.asarray(stable_points(pump, np.array([detuning]), at)[0])

    @property
    def slowest(self) -> float:
        """Time constant of the slowest heat, ns."""
        heat = self.flow.rough.heat
        return 1 / float(np.min(heat.rate) if isinstance(heat, PoleHeat) else -np.linalg.eigvals(heat.A).real.max())

    @property
    def longest(self) -> float:
        """The longest transient, ns."""
        return max(LONGEST, min(SLOWEST * self.slowest, MOST))

    @property
    def where(self) -> str:
        """Power and detuning, for messages."""
        return f" at power = {self.power:g} W, detuning = {self.detuning:g} Hz"

    def settled(
        self, y: Array, begin: str = "a cold ring", rtol: float = FINE, look: Callable[[], None] = lambda: None
    ) -> Orbit:
        """The cycle on which the ring settles from a state; InputError as `settling.settled`."""
        return settled(
            self.flow, y, self.stable_points, self.longest, begin=begin, rtol=rtol, where=self.where,
            slow=self.longest < SLOWEST * self.slowest, look=look,
        )  # fmt: skip
