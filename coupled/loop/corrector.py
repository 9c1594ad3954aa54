"""Correctors of a co-simulation: programs that compute the temperature of the core, such as the FEM.

Contract of a `Corrector`. Any object that satisfies it can be used: COMSOL behind a socket, NGSolve, a measured device.

1. ``corrector.advance(times, power)`` returns the mode-averaged rise dT in K at ``times`` (s, increasing), under the
   absorbed power ``power(t)`` in W, which may be called with any times between the first and the last.
2. It starts from the accepted state, which belongs to ``times[0]``. It may be called again for the same window, or for
   a shorter one, with another power: each call starts from the same accepted state, so its first value is the last
   accepted one, 0 K at t = 0. `coupled.cosimulate` checks that.
3. ``corrector.accept()`` makes the end of the last call the accepted state. The first window starts at t = 0.
4. The corrector itself includes all other heat sources, such as a heater or a neighbouring ring.
5. ``corrector.summary()`` returns numbers that are stored with the result; this method is optional.

A co-simulation begins cold, at the end of another one, or on the settled cycle of a compact model. In the last case the
field on the mesh is the periodic one under the power that the cycle absorbs. In the basis V of the FEM's Krylov
reduction it is known in closed form; the full-order FEM then integrates one period T, and

    x(0) <- x(T) + V diag(m/(1 - m)) V^T E [x(T) - x(0)],     m = exp(-rate T)

extrapolates the slow fields to their limit after many periods. One period is enough for constant conductivities; with
k(T) and c_p(T) this is repeated until the temperature is periodic.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from scipy.interpolate import CubicSpline

from thermofem import InputError, checks
from thermofem.algebra.krylov import krylov
from thermofem.algebra.pole_responses import cubic_pole_responses
from thermofem.arrays import Array, ArrayLike
from thermofem.data.variables import contents
from thermofem.fem import HeatProblem
from thermofem.models import NonlinearSystem, OutputMap, Quadratic, StateSpace, foster
from thermofem.solving import described, mesh_hash
from thermofem.transient.deflation import FieldIntegrator
from thermofem.transient.integration import heat_imbalance
from thermofem.waveforms import PiecewiseCubic, Waveform, to_json

from ..heaters import check_unlit
from ..states import State
from ..thermal import Compact

if TYPE_CHECKING:
    import xarray as xr

PERIODS = 6  # of the FEM alone, at most
INITIAL_KINDS = "a run of coupled.cosimulate with the same heat, or a cycle of coupled.limit_cycle"


class Corrector(Protocol):
    """Interface of a program that computes the temperature under a given absorbed power; contract: see the module."""

    def advance(self, times: Array, power: Waveform) -> Array:
        """Return the rise in K at ``times`` in s, shape (n,), from the accepted state under ``power`` in W."""

    def accept(self) -> None:
        """Make the end of the last call of ``advance`` the accepted state."""


class FEM:
    """The full-order heat problem as a corrector, linear or with k(T) and c_p(T).

    Parameters
    ----------
    heat : HeatProblem, StateSpace or NonlinearSystem
        or matrices of another program: E dx/dt = A x + B P, dT = C x with E and -A symmetric.
    heated : str, optional
        part that absorbs the light; default: the first heated part.
    read : str, optional
        output whose temperature shifts the resonance; default: the mean over ``heated``.
    heaters : mapping of name to Waveform
        other heated parts and their power in W.
    max_discrepancy : float, K
        that of the co-simulation; the error tolerance of the FEM's time steps is 0.3 of it.
    field_times : array, s
        times at which the whole temperature field is stored.
    """

    def __init__(
        self,
        heat: HeatProblem | StateSpace | NonlinearSystem,
        *,
        heated: str | None = None,
        read: str | None = None,
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
        readable = heat.readable if isinstance(heat, HeatProblem) else heat.outputs
        hint = "what shifts the resonance must also be read"
        self.read = checks.choice("read", read or self.heated, readable, hint=hint)
        for name in self.heaters:
            checks.choice("heaters", name, names)
        check_unlit(self.heaters, self.heated)
        kept = checks.array("field_times", field_times, increasing=True, empty=True)
        if kept.size and self.problem is None:
            raise InputError("field_times needs a HeatProblem, whose mesh the fields belong to")
        inputs = (self.heated, *self.heaters)
        system = heat.model(inputs, self.read) if isinstance(heat, HeatProblem) else _channels(heat, inputs, self.read)
        self.linear = system.linear if isinstance(system, NonlinearSystem) else system
        self.basis = krylov(self.linear)
        # the steps of the FEM may take 0.3 of the discrepancy of the co-simulation
        self.field = FieldIntegrator(
            system,
            self.basis,
            tolerance=0.3 * max_discrepancy,
            ledger=self.problem.ledger if self.problem else None,
            direct=[self.problem.audit(name).direct for name in inputs] if self.problem else (),
            factors=self.problem.discretization.factors if self.problem else None,
        )
        self.field_times = kept
        self.fields: list[Array] = []
        self.state = self.field.start()
        self.stored_before = 0.0
        self.max_discrepancy = max_discrepancy
        self._tried: Any = None  # FieldState and fields

    def __repr__(self) -> str:
        return f"FEM({self.problem!r})"

    def advance(self, times: Array, power: Waveform) -> Array:
        """Return the rise that is read, in K, at ``times`` in s, shape (n,), from the accepted state."""
        outputs, *self._tried = self.field.advance(
            self.state, [power, *self.heaters.values()], times, keep=self._kept(times)
        )
        return outputs[:, 0]

    def revise(self, times: Array, power: Waveform) -> Array:
        """Return the rise as `advance` does, for a slightly different power and without new time steps.

        The part of the rise outside the Krylov basis is kept from the last `advance` (`FieldIntegrator.revised`).
        """
        outputs, *self._tried = self.field.revised([power, *self.heaters.values()], times, keep=self._kept(times))
        return outputs[:, 0]

    @property
    def remainder(self) -> float:
        """Largest change in the last window, in K, of the part of the rise outside the Krylov basis."""
        return self.field.remainder

    def _kept(self, times: Array) -> Array:
        """Return the ``field_times`` that lie in the window ``times``; its start counts only at t = 0."""
        wanted = self.field_times
        return wanted[((wanted > times[0]) | (times[0] == 0)) & (wanted <= times[-1] * (1 + 1e-12))]

    def begin(self, rise: Array) -> None:
        """Set the state at t = 0 to a temperature field ``rise`` in K, shape (unknowns,)."""
        self.state = self.field.begin(rise)
        self.fields = []
        self.stored_before = self.field.stored(self.state)

    @property
    def rise(self) -> float:
        """Rise that is read in the accepted state, K."""
        return float(self.linear.C[0] @ self.field.temperature(self.state))

    @property
    def tried(self) -> Array:
        """Temperature field at the end of the last call of `advance`, K, shape (unknowns,)."""
        return self.field.temperature(self._tried[0])

    def accept(self) -> None:
        """Make the end of the last call of `advance` or `revise` the accepted state, and store its fields."""
        self.state, fields = self._tried
        self.fields.extend(fields)

    @cached_property
    def predictor(self) -> Compact:
        """Krylov reduction from the heated part to what is read; k(T) and c_p(T) enter to second order."""
        basis = self.basis
        curved = self.field.equations.curved
        if curved is None:
            return OutputMap(foster(basis.reduced(self.linear).channel(self.heated, self.read)), 0.0)
        inflow = curved.inverse * basis.rate
        symmetric = (inflow + inflow.transpose(0, 2, 1)) / 2
        H = symmetric - curved.flow
        B = basis.heating[:, 0]
        G = -(curved.inverse @ B)
        C = self.linear.C[0] @ basis.vectors
        return Quadratic(np.diag(-basis.rate), H, G, B, C, (self.heated,), (self.read,))

    def summary(self) -> dict[str, Any]:
        """Return the size of the FEM, the numbers of steps, solves and factorizations, and the heat balance in J."""
        stepper = self.field.stepper
        state = self.state
        stored = self.field.stored(state) - self.stored_before
        about = described(self.problem, self.heated, self.read) if self.problem else {}
        powers = {f"power_in_{name}": to_json(wave) for name, wave in self.heaters.items()}
        return {
            **about,
            **powers,
            "fem_unknowns": self.linear.order,
            "fem_steps": stepper.steps,
            "fem_solves": stepper.solves,
            "fem_factorizations": stepper.factorizations,
            "heat_in": state.heat_in,
            "heat_stored": stored,
            "heat_out": state.heat_out,
            "heat_imbalance": heat_imbalance(state.heat_in, stored, state.heat_out),
        }


def _channels(system: StateSpace | NonlinearSystem, inputs: tuple[str, ...], read: str) -> StateSpace | NonlinearSystem:
    """Return the system with the given inputs and one output only."""
    linear = system.linear if isinstance(system, NonlinearSystem) else system
    columns = [linear.inputs.index(name) for name in inputs]
    row = linear.outputs.index(read)
    B = linear.B[:, columns]
    C = linear.C[[row]]
    picked = StateSpace(linear.E, linear.A, B, C, inputs=inputs, outputs=(read,))
    return replace(system, linear=picked) if isinstance(system, NonlinearSystem) else picked


def beginning(initial: xr.Dataset | None, corrector: Any, model: Compact) -> State:
    """Set the corrector to the initial state of a run and return that of light, carriers and predictor.

    Raises
    ------
    InputError
        ``initial`` is neither a run nor a cycle, belongs to another mesh, or is given for a corrector that is not the
        FEM; or it is missing for an FEM that has already made a run.
    """
    if initial is None:
        if isinstance(corrector, FEM) and corrector.state.time > 0:
            raise InputError(
                "heat is a coupled.FEM that made a run before and is still hot; give initial= that run, or a new one"
            )
        return State.cold(model.order)
    if not isinstance(corrector, FEM):
        raise InputError("initial goes with a HeatProblem or matrices; another corrector keeps its own state")
    if "pulses" in initial.attrs:
        initial = contents("initial", initial, ("absorbed", "time"), what=INITIAL_KINDS)
        light, states = np.split(State.end_of(initial).as_array(), [3])
        corrector.begin(_lifted(initial, corrector))
    else:
        light, field = end_of_run(initial, corrector.problem, corrector.linear.order)
        states = None
        corrector.begin(field)
    return State.from_array(np.append(light, _predicted(corrector, model, states)))


def end_of_run(run: xr.Dataset, problem: HeatProblem | None, order: int) -> tuple[Array, Array]:
    """Light and carriers (SI), shape (3,), and the field over ambient (K), shape (order,), at the end of a run.

    problem: of the FEM that goes on; None for matrices.
    Raises InputError: no run of `cosimulate`, or one on another mesh.
    """
    field = contents("initial", run, ("final_rise",), what=INITIAL_KINDS)["final_rise"].values
    light = checks.array("initial.attrs['final_light']", run.attrs.get("final_light", ()))
    stated_mesh = run.attrs.get("mesh_hash")
    same_mesh = problem is None or stated_mesh in (None, mesh_hash(problem.mesh))
    if field.shape != (order,) or not same_mesh:
        raise InputError("initial was made on another mesh; go on with the same")
    return light, field


def _predicted(corrector: FEM, model: Compact, states: Array | None) -> Array:
    """Return the initial thermal states of the predictor ``model``, shape (order,).

    They are the FEM's where the predictor is its own reduction; else ``states``, those of the cycle, where their number
    is the order of the predictor; else zero.
    """
    if model is corrector.predictor:
        if model.bent:
            return corrector.state.z
        fields = (corrector.linear.C[0] @ corrector.basis.vectors) * corrector.state.z
        return fields[np.argsort(1 / corrector.basis.rate)]
    if states is not None and states.size == model.order:
        return states
    return np.zeros(model.order)


def _lifted(cycle: xr.Dataset, fem: FEM) -> Array:
    """Return the periodic temperature field of the FEM at the start of a given cycle, K, shape (unknowns,).

    The FEM is integrated over at most 6 periods under the power that the cycle absorbs; after each the field is
    extrapolated by the equation in the docstring of the module.
    """
    time = checks.array("initial['time']", cycle["time"].values, increasing=True)
    power = np.array(checks.array("initial['absorbed']", cycle["absorbed"].values))
    power[-1] = power[0]
    wave = PiecewiseCubic.of_spline(CubicSpline(time, power, bc_type="periodic"))
    period = float(time[-1])
    basis = fem.basis
    C = fem.linear.C
    if not np.isclose(period, float(cycle.attrs["period"]), rtol=1e-6, atol=0):
        raise InputError(f"initial['time'] ends at {period:g} s; a whole cycle has {cycle.attrs['period']:g} s")
    E = fem.linear.E
    z = cubic_pole_responses(basis.rate, wave.pieces(0.0, period), np.zeros(1), periodic=True)[0] * basis.heating[:, 0]
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
    return field
