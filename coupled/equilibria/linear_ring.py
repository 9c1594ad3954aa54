"""The linear equations of a ring or a circuit about a steady state: plant of a lock, and filter of its noise.

    dx/dt = A x + B u,     y = C x + D u           x, u, y: departures from the steady state, in SI
    A     = df/dx          by the dual numbers of the kernel, with x = [Re a, Im a, N] of every ring, then the heat

The inputs enter f linearly, but for the root of a power:

    da_i/dt = ... + i e_il d(s_l),      s_l = sqrt(P_l) exp(i phase_l),     d(s_l) = s_l dP_l/(2 P_l)
    da_i/dt = ... - 2 pi i a_i d(detuning) - i w_i a_i d(ambient)            w: `RingResonator.thermal_shift`
    dz_k/dt = ... + gain_k d(heat)
    P_port  = |sum_i S_i a_i + sum_l L_l s_l|^2,     delta_T_i = sum_k read_ik z_k + ambient

e, S and L are the matrices of `coupled.circuit.network`. The ambient reaches the ring through the chip where the
thermal model has that input; with any other model every temperature follows it at once, as the last terms say.
"""

import logging
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from thermofem import OutputMap, Quadratic, StateSpace, checks
from thermofem.arrays import Array, Complex
from thermofem.geometry.section_parts import AMBIENT
from thermofem.models import ThermalModel, bare
from thermofem.models.state_space import eigenmodes

from ..circuit.circuit import Circuit
from ..circuit.stationary import autonomous, described, fixed_points
from ..circuit.system import System
from ..kernel import units as eq
from ..kernel.integrator import Problem
from ..kernel.problem_parts import Drive, PoleHeat
from ..kernel.tableaus import Method
from ..resonator import RingResonator
from ..thermal import Heaters, trusted
from .balance import balance
from .linear_response import Linear
from .steady_states import Resting, resting

LIGHT_STATES = ("Re a", "Im a", "N")  # states of a ring
log = logging.getLogger("thermofem")


class Optics(NamedTuple):
    """The light of R rings, L lasers and Q ports at a steady state, in SI.

    shift [rad/s/K]: of every ring.
    fields [sqrt(J)], waves [sqrt(W)]: of the rings and of the lasers.
    entry [shape (R, L), 1/sqrt(s)]: e. seen_ring, seen_laser [shape (Q, R) and (Q, L)]: S and L.
    """

    shift: Array
    fields: Complex
    waves: Complex
    entry: Complex
    seen_ring: Complex
    seen_laser: Complex


class Heat(NamedTuple):
    """The n thermal states, which follow fields and carriers: columns of B and rows of C.

    gain [shape (n, R)]: per W absorbed in each ring. heaters: per W in each heater, and per K of the ambient.
    read: of every temperature in K. forces: as of `Linear`, for these states.
    """

    gain: Array
    heaters: dict[str, Array]
    read: dict[str, Array]
    forces: Array | None


class Names(NamedTuple):
    """Names of the lasers' powers, of the heat of every ring and of the ports."""

    powers: list[str]
    heats: list[str]
    ports: list[str]


def linearize(
    ring: RingResonator | Circuit,
    model: ThermalModel,
    *,
    power: Any,
    detuning: float = 0.0,
    heaters: Heaters = None,
    branch: int = 0,
    heated: str | None = None,
    read: str | None = None,
    starts: int = 100,
    seed: int = 0,
) -> Linear:
    """Return the small-signal equations of a ring or a circuit at a steady state.

        dx/dt = A x + B u,     y = C x + D u,     A = df/dx, B = df/du of the equations of `simulate`

    Parameters
    ----------
    ring, model, power, detuning, heaters, heated, read, starts, seed
        as of `steady_states`. Heaters that are not given are at 0 W; all of them are inputs.
    branch : int
        number of the steady state, by increasing energy, where there are several: the log lists them.

    Returns
    -------
    Linear
        an unstable state is linearized, too; ``stable`` and the log say so.

    Raises
    ------
    InputError
        as `steady_states`; no light; no steady state of that number; a heater called as another input.

    Compared with ngspice ``.ac`` of the exported circuit, to six digits.

    >>> import coupled, thermofem as th
    >>> model = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    >>> linear = coupled.linearize(coupled.borghi2021(), model, power=1e-3, detuning=-5e9)
    >>> print(linear.stable, f"{linear.thermal_resistance:.0f} K/W")
    True 14804 K/W
    """
    if isinstance(ring, Circuit):
        return _of_circuit(ring, model, power, detuning, heaters, branch, starts, seed)
    points = resting(ring, model, power, detuning, heaters, heated, read)
    state = _picked(points.states, "branch", branch)
    problem, y, heat = _of_ring(ring, points, branch)
    amplitude = np.sqrt(points.states.attrs["input_power"])
    into_drop = np.sqrt(2 * ring.drop_bus_rate)
    into_bus = np.sqrt(2 * ring.bus_rate)
    optics = Optics(
        shift=np.array([ring.thermal_shift]),
        fields=_fields(y, 1),
        waves=np.array([amplitude + 0j]),
        entry=np.array([[into_bus + 0j]]),
        seen_ring=1j * np.array([[into_drop], [into_bus]]),
        seen_laser=np.array([[0j], [1 + 0j]]),
    )
    names = Names(["power"], ["heat"], ["drop", "through"])
    A = _jacobian(problem, y)
    return _assembled(A, optics, heat, names, state)


def _of_ring(ring: RingResonator, points: Resting, branch: int) -> tuple[Problem, Array, Heat]:
    """The equations of one ring for the kernel, the steady state y in its units, and the heat in SI."""
    internal = points.internal
    here = balance(points.energy[branch], internal)
    D = points.detuned[branch]
    laser = points.states.attrs
    pump = eq.internal_pump(ring, laser["input_power"])
    a = 1j * pump / (here.gamma - 1j * D)
    light = [a.real, a.imag, here.N]
    system = bare(points.warm.rest.model)
    if not isinstance(system, StateSpace) or len(system.inputs) == len(system.outputs) == 1:
        problem = internal.problem
        problem.set_detuning(float(here.shift) - D)
        x = internal.heat.states(here.P_abs)
        return problem, np.append(light, x), _heat_of_port(internal.model, x)
    rate, modes = eigenmodes(system)
    B = modes.T @ system.B
    C = system.C @ modes
    lit = system.inputs.index(internal.model.inputs[0])
    seen = system.outputs.index(internal.model.outputs[0])
    powers = {**points.warm.rest.sources, system.inputs[lit]: float(here.P_abs) * eq.UW}
    x = sum(B[:, system.inputs.index(name)] * watts for name, watts in powers.items()) / rate
    gain = B[:, lit][None] * (eq.UW * eq.NS)
    poles = PoleHeat(gain, rate[None] * eq.NS, C[seen][None])
    rings = eq.internal_rings([ring], pump, internal.model.thermal_resistance * eq.UW)
    detuning = eq.internal_detuning(laser["detuning"])
    problem = Problem(rings, poles, Drive.constant(pump**2, detuning, 1.0), Method.RODAS4)
    heaters = {name: B[:, k] for k, name in enumerate(system.inputs) if k != lit}
    others = {name: C[k] for k, name in enumerate(system.outputs) if k != seen}
    # under a tcr the states hold the feedback of the heaters, and not the dissipation alone
    forces = None if points.warm.rest.fed_back else np.diag(np.sqrt(rate))
    heat = Heat(B[:, [lit]], heaters, {"delta_T": C[seen], **others}, forces)
    return problem, np.append(light, x), heat


def _heat_of_port(model: Any, x: Array) -> Heat:
    """The heat of a model with one input and one output at its states x (K)."""
    if isinstance(model, Quadratic):
        gain = model.G @ x + model.B
        return Heat(gain[:, None], {}, {"delta_T": np.asarray(model.C)}, None)
    poles = model.linear if isinstance(model, OutputMap) else model
    slope = 1 + 2 * getattr(model, "coefficient", 0.0) * x.sum()
    forces = None
    if poles.inputs == poles.outputs and poles.passive:
        forces = np.diag(np.sqrt(poles.gain / np.asarray(poles.tau)))
    return Heat(poles.gain[:, None], {}, {"delta_T": np.full(x.size, slope)}, forces)


def _of_circuit(
    circuit: Circuit, model: Any, power: Any, detuning: float, heaters: Any, branch: int, starts: int, seed: int
) -> Linear:
    """`linearize` of a circuit without delays."""
    system = autonomous(circuit, model, power, heaters, detuning)
    waves = system.lights.amplitudes(np.zeros(1))[:, 0]
    checks.positive("power of the weakest laser that is lit", np.abs(waves).min() ** 2, unit="W")
    points = fixed_points(system, starts, seed)
    states = described(system, points)
    linear_rise = states["absorbed"].values * system.heat.thermal_resistance
    trusted(model, states["delta_T"].values, linear_rise)
    state = _picked(states, "state", branch).assign_attrs(detuning=float(detuning), **system.heat.doubts)
    y = points[branch]
    rings = len(circuit.names)
    ports = slice(len(circuit.ports))
    optics = Optics(
        shift=np.array([ring.thermal_shift for ring in circuit.resonators]),
        fields=_fields(y, rings),
        waves=waves,
        entry=system.light.from_laser,
        seen_ring=system.light.seen_ring[ports],
        seen_laser=system.light.seen_laser[ports],
    )
    heat = _heat_of_rings(system, y)
    A = _with_heaters(_jacobian(system.problem(Method.RODAS5P), y), optics, system)
    powers = [f"power {laser.name}" for laser in system.circuit.lasers]
    heats = [f"heat {name}" for name in circuit.names]
    return _assembled(A, optics, heat, Names(powers, heats, list(circuit.ports)), state)


def _heat_of_rings(system: System, y: Array) -> Heat:
    """The heat of a circuit: K states of each ring, then the poles of every heater."""
    heat = system.heat
    R, K = heat.gain.shape
    x = y[3 * R :].reshape(R, K)
    slope = 1 + 2 * heat.curvature * np.einsum("ijk,jk->i", heat.read, x)
    poles = list(heat.heaters.values())
    ends = R * K + np.cumsum([0, *(heater.rate.size for heater in poles)])
    order = ends[-1]
    gain = np.zeros((order, R))
    read = np.zeros((R, order))
    for i in range(R):
        gain[i * K : (i + 1) * K, i] = heat.gain[i]
        read[i, : R * K] = slope[i] * heat.read[i].ravel()
    heaters: dict[str, Array] = {}
    for k, (name, heater) in enumerate(heat.heaters.items()):
        block = slice(ends[k], ends[k + 1])
        read[:, block] = heater.gain
        heaters[name] = np.zeros(order)
        heaters[name][block] = 1.0
    alone = not heat.crossed and not poles and bool(np.all(heat.gain >= 0))
    forces = np.diag(np.sqrt(heat.gain * heat.rate).ravel()) if alone else None
    names = [f"delta_T {name}" for name in system.circuit.names]
    return Heat(gain, heaters, dict(zip(names, read, strict=True)), forces)


def _with_heaters(A: Array, optics: Optics, system: System) -> Array:
    """A with the poles of the heaters, whose rises turn the resonances: da_i/dt = ... - i w_i a_i dT_i."""
    poles = list(system.heat.heaters.values())
    if not poles:
        return A
    rate = np.concatenate([heater.rate for heater in poles])
    gain = np.concatenate([heater.gain for heater in poles], axis=1)
    per_kelvin = -1j * optics.shift * optics.fields
    turned = _rows(per_kelvin[:, None] * gain)
    coupling = np.zeros((len(A), rate.size))
    coupling[: len(turned)] = turned
    alone = np.zeros((rate.size, len(A)))
    return np.block([[A, coupling], [alone, -np.diag(rate)]])


def _picked(states: xr.Dataset, over: str, branch: int) -> xr.Dataset:
    """The steady state of the given number; the log lists them where there are several, and says if it is unstable."""
    growth = states["growth_rate"].values
    if not growth.size:
        raise checks.InputError("no steady state of the circuit is found", "take more starts=")
    energy = states["energy"].values.reshape(growth.size, -1).sum(axis=1)
    each = enumerate(zip(energy * 1e15, growth, strict=True))
    words = [f"{k}: {femtojoules:.4g} fJ, growth {rate:.3g} 1/s" for k, (femtojoules, rate) in each]
    hint = f"the steady states are {'; '.join(words)}; branch= chooses"
    branch = checks.integer("branch", branch, 0, growth.size - 1, hint=hint)
    if growth.size > 1:
        log.warning("branch = %d is linearized; %s", branch, hint)
    if growth[branch] > 0:
        log.warning("the steady state is unstable: its linear answer grows by %.4g 1/s", growth[branch])
    return states.isel({over: branch})


def _jacobian(problem: Problem, y: Array) -> Array:
    """df/dx in SI (1/s between SI states) at the state y in the kernel's units."""
    unit = eq.units(problem.order, problem.rings)
    return problem.slopes(y)[1] * unit[:, None] / (unit * eq.NS)


def _fields(y: Array, rings: int) -> Complex:
    """Fields of the rings in sqrt(J) from the state y in the kernel's units."""
    return (y[0 : 3 * rings : 3] + 1j * y[1 : 3 * rings : 3]) * eq.FJ**0.5


def _rows(turned: Complex) -> Array:
    """Rows [Re, Im, 0] of every ring from the derivatives of its field, shape (R, m) to (3 R, m)."""
    return np.stack([turned.real, turned.imag, np.zeros(turned.shape)], axis=1).reshape(-1, turned.shape[1])


def _assembled(A: Array, optics: Optics, heat: Heat, names: Names, state: xr.Dataset) -> Linear:
    """The matrices B, C and D of the equations at the top of this file."""
    R = optics.fields.size
    per_watt = optics.waves / (2 * np.abs(optics.waves) ** 2)
    turned = -1j * optics.fields
    at_once = AMBIENT not in heat.heaters
    ambient = turned * optics.shift * at_once
    by_power = 1j * optics.entry * per_watt
    fields = np.column_stack([by_power, 2 * np.pi * turned, np.zeros((R, R)), ambient])
    heaters = [name for name in heat.heaters if name != AMBIENT]
    inputs = (*names.powers, "detuning", *names.heats, AMBIENT, *heaters)
    temperatures = list(heat.read)
    outputs = (*names.ports, *temperatures)
    for kind, listed in (("inputs", inputs), ("outputs", outputs)):
        checks.unique(f"list of {kind}", listed, hint="rename a heater or part of the thermal model")
    lasers = len(names.powers)
    B = np.zeros((len(A), len(inputs)))
    B[: 3 * R, : fields.shape[1]] = _rows(fields)
    B[3 * R :, lasers + 1 : lasers + 1 + R] = heat.gain
    for name, column in heat.heaters.items():
        B[3 * R :, inputs.index(name)] = column

    Q = len(names.ports)
    waves = optics.seen_ring @ optics.fields + optics.seen_laser @ optics.waves
    by_field = 2 * waves.conj()[:, None] * optics.seen_ring
    C = np.zeros((len(outputs), len(A)))
    C[:Q, 0 : 3 * R : 3] = by_field.real
    C[:Q, 1 : 3 * R : 3] = -by_field.imag
    C[Q:, 3 * R :] = list(heat.read.values())
    D = np.zeros((len(outputs), len(inputs)))
    D[:Q, :lasers] = 2 * (waves.conj()[:, None] * optics.seen_laser * per_watt).real
    D[Q:, inputs.index(AMBIENT)] = at_once

    forces = None
    if heat.forces is not None:
        forces = np.vstack([np.zeros((3 * R, heat.forces.shape[1])), heat.forces])
    rings = [name.removeprefix("heat").strip() for name in names.heats]
    light = [f"{part} {ring}".strip() for ring in rings for part in LIGHT_STATES]
    states = (*light, *(f"heat {k + 1}" for k in range(len(A) - 3 * R)))
    shift = float(optics.shift[0] / (2 * np.pi))
    return Linear(A, B, C, D, inputs, outputs, states, state, forces, shift)
