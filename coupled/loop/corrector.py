"""Correctors of a co-simulation: programs that compute the temperature of the core, the FEM among them.

Contract of a `Corrector`. Any object that satisfies it can be used: COMSOL behind a socket, NGSolve, a measured device.

1. ``corrector.advance(times, power)`` returns the mode-averaged rise dT in K at ``times`` (s, increasing), under the
   absorbed power ``power(t)`` in W, which may be called with any times between the first and the last.
2. It starts from the accepted state, which belongs to ``times[0]``. It may be called again for the same window, or for
   a shorter one, with another power: each call starts from the same accepted state, so its first value is the last
   accepted one, 0 K at t = 0. `coupled.cosimulate` checks that.
3. ``corrector.accept()`` makes the end of the last call the accepted state. The first window starts at t = 0.
4. The corrector itself includes all other heat sources, such as a heater or a neighbouring ring.
5. ``corrector.summary()`` returns numbers that are stored with the result; this method is optional.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from thermofem import checks
from thermofem.algebra.krylov import CYCLES, krylov
from thermofem.arrays import Array, ArrayLike
from thermofem.data.display import card
from thermofem.fem import HeatProblem
from thermofem.models import Foster, NonlinearSystem, Quadratic, StateSpace, foster
from thermofem.solving import check_fields, mesh_hash
from thermofem.transient.deflation import FieldIntegrator
from thermofem.waveforms import Waveform, to_json

SHARE = 0.3  # of the largest discrepancy of the co-simulation, for the FEM's own steps


class Corrector(Protocol):
    """Absorbed power in, temperature out, window by window; the docstring of the module has the numbered contract."""

    def advance(self, times: Array, power: Waveform) -> Array:
        """Rise in K at ``times`` from the accepted state."""

    def accept(self) -> None:
        """Keep the end of the last call."""


class FEM:
    """The full-order heat problem as a corrector, linear or with k(T) and c_p(T).

    Parameters
    ----------
    heat : HeatProblem, StateSpace or NonlinearSystem
        matrices from elsewhere do as well: E dx/dt = A x + B P, dT = C x with E and -A symmetric.
    heated : str, optional
        part that the light heats and whose mean detunes it; default: the first heated part.
    heaters : mapping of name to Waveform
        other heated parts and their power in W.
    max_discrepancy : float, K
        of the co-simulation; the FEM's steps keep to a third of it.
    field_times : array, s
        when the whole temperature field is kept.
    cycles : int
        size of the Krylov basis (`thermofem.transient.krylov`); it changes the work, not the result.
    """

    def __init__(
        self,
        heat: HeatProblem | StateSpace | NonlinearSystem,
        *,
        heated: str | None = None,
        heaters: Mapping[str, Waveform] | None = None,
        max_discrepancy: float = 1e-3,
        field_times: ArrayLike = (),
        cycles: int = CYCLES,
    ) -> None:
        hint = "th.assemble(geometry) makes the HeatProblem"
        checks.instance("heat", heat, HeatProblem, StateSpace, NonlinearSystem, hint=hint)
        max_discrepancy = checks.between("max_discrepancy", max_discrepancy, 1e-9, 10, unit="K")
        self.problem = heat if isinstance(heat, HeatProblem) else None
        names = heat.heated if isinstance(heat, HeatProblem) else heat.inputs
        self.heaters = checks.mapping("heaters", heaters, hint="e.g. {'heater': th.Constant(5e-3)}")
        self.heated = checks.choice("heated", heated, names, default=names[0])
        for name, wave in self.heaters.items():
            checks.choice("heaters", name, names)
            if name == self.heated:
                raise checks.InputError(f"heaters holds {name!r}, which the light heats; give the power of other parts")
            if isinstance(wave, type) or not hasattr(wave, "breakpoints"):
                raise checks.InputError(f"heaters[{name!r}] = {wave!r} is no waveform; e.g. th.Constant(5e-3)")
        kept = checks.array("field_times", field_times, increasing=True, empty=True)
        if kept.size and self.problem is None:
            raise checks.InputError("field_times needs a HeatProblem, whose mesh the fields belong to")
        if self.problem is not None:
            check_fields(self.problem, kept)
        inputs = (self.heated, *self.heaters)
        system = heat.model(inputs, self.heated) if isinstance(heat, HeatProblem) else _channels(heat, inputs)
        self.nonlinear = system if isinstance(system, NonlinearSystem) else None
        self.linear = system.linear if isinstance(system, NonlinearSystem) else system
        self.basis = krylov(self.linear, checks.integer("cycles", cycles, 0, 100))
        self.field = FieldIntegrator(
            system,
            self.basis,
            tolerance=SHARE * max_discrepancy,
            ledger=self.problem.ledger if self.problem else None,
            direct=[self.problem.audit(name).direct for name in inputs] if self.problem else (),
            factors=self.problem.discretization.factors if self.problem else None,
        )
        self.field_times = kept if kept.size else None
        self.fields: list[Array] = []
        self.state, self.stored_before, self.max_discrepancy = self.field.start(), 0.0, max_discrepancy
        self._tried: Any = None  # FieldState and fields

    def __repr__(self) -> str:
        return f"FEM({self.problem!r})"

    def _repr_html_(self) -> str:
        """HTML for notebooks."""
        return card("FEM", [("heat", repr(self.problem or "matrices from elsewhere"))])

    def advance(self, times: Array, power: Waveform) -> Array:
        """Rise of the heated part in K at ``times``."""
        times = checks.array("times", times, increasing=True)
        outputs, *self._tried = self.field.advance(
            self.state, [power, *self.heaters.values()], times, keep=self._kept(times)
        )
        return outputs[:, 0]

    def revise(self, times: Array, power: Waveform) -> Array:
        """`advance` again under a power that differs little, without steps (`FieldIntegrator.revised`)."""
        outputs, *self._tried = self.field.revised([power, *self.heaters.values()], times, keep=self._kept(times))
        return outputs[:, 0]

    @property
    def remainder(self) -> float:
        """Largest change in the window of the part of the rise that `revise` keeps, outside the amplitudes, K."""
        return self.field.remainder

    def _kept(self, times: Array) -> Array:
        """The field times of a window."""
        wanted = np.empty(0) if self.field_times is None else self.field_times
        return wanted[((wanted > times[0]) | (times[0] == 0)) & (wanted <= times[-1] * (1 + 1e-12))]

    def begin(self, rise: Array) -> None:
        """Start at t = 0 from a field, K."""
        self.state, self.fields = self.field.begin(rise), []
        self.stored_before = self.field.stored(self.state)

    @property
    def rise(self) -> float:
        """Accepted rise of the heated part, K."""
        return float(self.linear.C[0] @ self.field.temperature(self.state))

    @property
    def tried(self) -> Array:
        """Field at the end of the last call of `advance`, K."""
        if self._tried is None:
            raise checks.InputError("tried comes after advance()")
        return self.field.temperature(self._tried[0])

    def accept(self) -> None:
        """Keep the end of the last call, and its fields."""
        if self._tried is None:
            raise checks.InputError("accept() comes after advance()")
        self.state, fields = self._tried
        self.fields.extend(fields)

    @cached_property
    def predictor(self) -> Foster | Quadratic:
        """The Krylov reduction from the heated part to itself, with k(T) and c_p(T) to second order in the rise."""
        curved, basis = self.field.curved, self.basis
        if self.nonlinear is None:
            return foster(basis.reduced(self.linear).channel(self.heated, self.heated))
        inflow = curved.inverse * basis.rate
        H, b = (inflow + inflow.transpose(0, 2, 1)) / 2 - curved.flow, basis.heating[:, 0]
        C, name = self.linear.C[0] @ basis.vectors, (self.heated,)
        return Quadratic(np.diag(-basis.rate), H, -(curved.inverse @ b), b, C, name, name)

    def background(self, times: Array, reduced: StateSpace | None = None) -> Array:
        """Rise in K caused by the heaters, from a reduced model with all inputs (default: the Krylov reduction)."""
        reduced, rise = reduced or self.basis.reduced(self.linear), np.zeros(np.size(times))
        for name, wave in self.heaters.items():
            if name in reduced.inputs:
                rise = rise + foster(reduced.channel(name, self.heated)).response(wave, times)
        return rise

    def summary(self) -> dict[str, Any]:
        """Size of the FEM, number of steps and solves, and its heat balance in J."""
        s, state = self.field.stepper, self.state
        stored = self.field.stored(state) - self.stored_before
        scale = max(abs(state.heat_in), abs(stored), abs(state.heat_out))
        imbalance = (state.heat_in - stored - state.heat_out) / scale if scale else 0.0
        heat, provenance = self.problem, {}
        if heat:
            provenance = {
                "heated": self.heated,
                "thermal_resistance": heat.thermal_resistance(self.heated),
                "geometry": heat.geometry.to_toml(),
                "mesh_hash": mesh_hash(heat.mesh),
                "accuracy": heat.accuracy,
                "materials": json.dumps({m.name: m.source for m in map(heat.geometry.material_of, heat.regions)}),
            }
        return {
            **provenance,
            **{f"power_in_{name}": to_json(wave) for name, wave in self.heaters.items()},
            "fem_unknowns": self.linear.order,
            "fem_steps": s.steps,
            "fem_solves": s.solves,
            "fem_factorizations": s.factorizations,
            "heat_in": state.heat_in,
            "heat_stored": stored,
            "heat_out": state.heat_out,
            "heat_imbalance": imbalance,
        }


def _channels(system: StateSpace | NonlinearSystem, inputs: tuple[str, ...]) -> StateSpace | NonlinearSystem:
    """The system with some of its inputs, the first of which is also read."""
    linear = system.linear if isinstance(system, NonlinearSystem) else system
    checks.choice("heated", inputs[0], linear.outputs, hint="the part that the light heats must also be read")
    columns, row = [linear.inputs.index(name) for name in inputs], linear.outputs.index(inputs[0])
    B, C = linear.B[:, columns], linear.C[[row]]
    picked = StateSpace(linear.E, linear.A, B, C, inputs=inputs, outputs=(inputs[0],))
    return replace(system, linear=picked) if isinstance(system, NonlinearSystem) else picked
