"""The result of a transient and its energy balance."""

from __future__ import annotations

from dataclasses import dataclass

from ..arrays import Array


@dataclass(frozen=True, eq=False)
class Ledger:
    """Closes the energy balance: heat stored = storage x, heat flowing out = drain_A x + drain_E dx/dt + direct P.

    ``direct`` is the share of the power that enters at held unknowns, where a heated part touches a held boundary.
    """

    storage: Array
    drain_A: Array
    drain_E: Array
    direct: float = 0.0

    def content(self, x: Array) -> float:
        """Heat in the field in J."""
        return float(self.storage @ x)

    def outflow(self, h: float, weights: Array, states: Array, slopes: Array) -> float:
        """Heat in J that left during one step."""
        return h * float(weights @ (states @ self.drain_A + slopes @ self.drain_E))


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The result of a transient.

    times [shape (n,), s]
    outputs [shape (n, outputs), K]
    final [shape (states,), K]
    snapshots [shape (snapshots, states), K]
    heat_in, heat_stored, heat_out [J]: exact energy delivered, energy now in the field above the start, energy that
        left; nan without a ledger.
    steps, rejected, factorizations, solves: steps of the integrator, or straight pieces of the power in closed form.
    method: "stepping" (`transient.integration`) or "closed form" (`transient.modal`).
    """

    times: Array
    outputs: Array
    final: Array
    snapshots: Array
    heat_in: float
    heat_stored: float
    heat_out: float
    steps: int
    rejected: int
    factorizations: int
    solves: int
    method: str = "stepping"

    @property
    def imbalance(self) -> float:
        """(in - stored - out) relative to the largest of the three."""
        scale = max(abs(self.heat_in), abs(self.heat_stored), abs(self.heat_out))
        return (self.heat_in - self.heat_stored - self.heat_out) / scale if scale else 0.0
