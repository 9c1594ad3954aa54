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

A co-simulation begins cold, where another one ended, or on the settled cycle of a compact model, lifted to the mesh:
the field is periodic under the power that the cycle absorbs. In the fields V of the FEM's own reduction the periodic
state is closed form; the full-order FEM advances all of it for a period, and

    x(0) <- x(T) + V diag(m/(1 - m)) V^T E [x(T) - x(0)],     m = exp(-rate T)

takes the slow fields to where all later periods would. One period does for constant conductivities; with k(T) and
c_p(T) the periods go on until the temperature repeats.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from scipy.interpolate import CubicSpline

from thermofem import checks
from thermofem.algebra.krylov import krylov
from thermofem.algebra.pole_responses import cubic_pole_responses
from thermofem.arrays import Array, ArrayLike
from thermofem.data.variables import contents
from thermofem.fem import HeatProblem
from thermofem.models import Foster, NonlinearSystem, Quadratic, StateSpace, foster
from thermofem.solving import mesh_hash
from thermofem.transient.deflation import FieldIntegrator
from thermofem.waveforms import PiecewiseCubic, Waveform, to_json

from ..heaters import check_unlit
from ..states import State
from ..thermal import Compact

if TYPE_CHECKING:
    import xarray as xr

PERIODS = 6  # of the FEM alone, at most
KINDS = "a run of coupled.cosimulate with the same heat, or a cycle of coupled.limit_cycle"
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
    """

    def __init__(
        self,
        heat: HeatProblem | StateSpace | NonlinearSystem,
        *,
        heated: str | None = None,
        heaters: Mapping[str, Waveform] | None = None,
        max_discrepancy: float = 1e-3,
        field_times: ArrayLike = (),
    ) -> None:
        hint = "th.assemble(geometry) makes the HeatProblem"
        checks.instance("heat", heat, HeatProblem, StateSpace, NonlinearSystem, hint=hint)
        max_discrepancy = checks.between("max_discrepancy", max_discrepancy, 1e-9, 10, unit="K")
        self.problem = heat if isinstance(heat, HeatProblem) else None
        names = heat.heated if isinstance(heat, HeatProblem) else heat.inputs
        self.heaters = checks.mapping("heaters", heaters, hint="e.g. {'heater': th.Constant(5e-3)}")
        self.heated = checks.choice("heated", heated, names, default=names[0])
        for name in self.heaters:
            checks.choice("heaters", name, names)
        check_unlit(self.heaters, self.heated)
        kept = checks.array("field_times", field_times, increasing=True, empty=True)
        if kept.size and self.problem is None:
            raise checks.InputError("field_times needs a HeatProblem, whose mesh the fields belong to")
        inputs = (self.heated, *self.heaters)
        system = heat.model(inputs, self.heated) if isinstance(heat, HeatProblem) else _channels(heat, inputs)
        self.nonlinear = system if isinstance(system, NonlinearSystem) else None
        self.linear = system.linear if isinstance(system, NonlinearSystem) else system
        self.basis = krylov(self.linear)
        self.field = FieldIntegrator(
            system,
            self.basis,
            tolerance=SHARE * max_discrepancy,
            ledger=self.problem.ledger if self.problem else None,
            direct=[self.problem.audit(name).direct for name in inputs] if self.problem else (),
            factors=self.problem.discretization.factors if self.problem else None,
        )
        self.field_times = kept
        self.fields: list[Array] = []
        self.state, self.stored_before, self.max_discrepancy = self.field.start(), 0.0, max_discrepancy
        self._tried: Any = None  # FieldState and fields

    def __repr__(self) -> str:
        return f"FEM({self.problem!r})"

    def advance(self, times: Array, power: Waveform) -> Array:
        """Rise of the heated part in K at ``times``."""
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
        wanted = self.field_times
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
        return self.field.temperature(self._tried[0])

    def accept(self) -> None:
        """Keep the end of the last call, and its fields."""
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


class Beginning(NamedTuple):
    """State of light, carriers and predictor, and the temperature of the corrector in K."""

    state: State
    rise: float


def beginning(initial: xr.Dataset | None, corrector: Any, model: Compact) -> Beginning:
    """Set the corrector to the initial state of a run and return that of light, carriers and predictor.

    Raises
    ------
    InputError
        neither a run nor a cycle, one of another mesh, or a corrector that is not the FEM.
    """
    if not isinstance(corrector, FEM):
        if initial is not None:
            raise checks.InputError(
                "initial goes with a HeatProblem or matrices; another corrector keeps its own state"
            )
        return Beginning(State.cold(model.order), 0.0)
    if initial is None:
        if corrector.state.time > 0:
            raise checks.InputError(
                "heat is a coupled.FEM that made a run before and is still hot; give initial= that run, or a new one"
            )
        return Beginning(State.cold(model.order), 0.0)
    if "pulses" in initial.attrs:
        initial = contents("initial", initial, ("absorbed", "time"), what=KINDS)
        light, states = np.split(State.end_of(initial).as_array(), [3])
        corrector.begin(_lifted(initial, corrector))
    else:
        field = contents("initial", initial, ("final_rise",), what=KINDS)["final_rise"].values
        light, states = checks.array("initial.attrs['final_light']", initial.attrs["final_light"]), None
        own = corrector.problem.mesh if corrector.problem is not None else None
        known = initial.attrs.get("mesh_hash")
        if field.shape != (corrector.linear.order,) or (own is not None and known not in (None, mesh_hash(own))):
            raise checks.InputError("initial was made on another mesh; go on with the same")
        corrector.begin(field)
    at = State(complex(light[0], light[1]), max(float(light[2]), 0.0), _predicted(corrector, model, states))
    return Beginning(at, corrector.rise)


def _predicted(corrector: FEM, model: Compact, states: Array | None) -> Array:
    """States of the predictor: the FEM's own reduction holds its fields, a model of the cycle's order the cycle's."""
    if model is corrector.predictor:
        if isinstance(model, Quadratic):
            return np.asarray(corrector.state.z)
        fields = (corrector.linear.C[0] @ corrector.basis.vectors) * corrector.state.z
        return np.asarray(fields[np.argsort(1 / corrector.basis.rate)])
    if states is not None and states.size == model.order:
        return states
    return np.zeros(model.order)


def _lifted(cycle: xr.Dataset, fem: FEM) -> Array:
    """The field at the start of a cycle, K."""
    time = checks.array("initial['time']", cycle["time"].values, increasing=True)
    power = np.array(checks.array("initial['absorbed']", cycle["absorbed"].values))
    power[-1] = power[0]
    wave = PiecewiseCubic.of_spline(CubicSpline(time, power, bc_type="periodic"))
    period, basis, C = float(time[-1]), fem.basis, fem.linear.C
    if not np.isclose(period, float(cycle.attrs["period"]), rtol=1e-6, atol=0):
        raise checks.InputError(f"initial['time'] ends at {period:g} s; a whole cycle has {cycle.attrs['period']:g} s")
    E = fem.linear.E
    z = cubic_pole_responses(basis.rate, *wave.pieces(0.0, period), np.zeros(1), periodic=True)[0] * basis.heating[:, 0]
    field = basis.vectors @ z
    shrink = np.exp(-basis.rate * period)
    for _ in range(PERIODS):
        fem.begin(field)
        fem.advance(time.copy(), wave)
        end = fem.tried
        change = end - field
        field = end + basis.vectors @ (shrink / (1 - shrink) * (basis.vectors.T @ (E @ change)))
        # the temperature may still change by 0.3 of the largest discrepancy in a period
        if np.abs(C @ change).max() <= 0.3 * fem.max_discrepancy:
            break
    return np.asarray(field)
