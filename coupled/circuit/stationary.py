"""Steady states of circuits: fixed points under constant light with their stability, and low-power transmission."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from thermofem import InputError, checks, dataset
from thermofem.arrays import Array, Complex, Indices

from ..heaters import heating
from ..inputs import check_axis
from ..kernel import units as eq
from ..kernel.integrator import Problem
from ..kernel.rates import absorbed_power, field_loss, steady_carriers
from ..kernel.tableaus import Method
from ..resistive_heaters import at_rest
from ..thermal import Heaters, trusted
from .circuit import Circuit
from .network import light_of, ring_heat
from .system import System, as_dataset, system_of

ITERATIONS, SWEEPS, RAMP = 60, 40, 30
WEAK = 1e-6  # W; heat of a tenth of it moves a resonance by 1e-3 of its width


def circuit_steady_states(
    circuit: Circuit,
    thermal: Any,
    power: Mapping[str, float],
    detuning: float = 0.0,
    heaters: Heaters = None,
    starts: int = 100,
    seed: int = 0,
) -> xr.Dataset:
    """Fixed points of a circuit that Newton's method finds, with the eigenvalues of the Jacobian.

        0 = f(y),    growth_rate = max Re eig(df/dy),    y = (Re a, Im a, N of each ring, thermal states)

    Newton's method starts on the low-power branch, continued from zero to full power, and from ``starts`` random
    detunings of the hot rings with matching light, carriers and heat. No method is known that finds all fixed points of
    several coupled rings: some may be missed.
    """
    system = autonomous(circuit, thermal, power, heaters, detuning)
    states = described(system, fixed_points(system, starts, seed))
    linear_rise = states["absorbed"].values * system.heat.thermal_resistance
    trusted(thermal, states["delta_T"].values, linear_rise)
    rest = at_rest(thermal, heaters)
    return states.assign_attrs(system.heat.doubts, **rest.attributes)


def fixed_points(system: System, starts: int, seed: int) -> list[Array]:
    """States in the kernel's units that Newton's method finds, by increasing energy; `circuit_steady_states`."""
    starts = checks.integer("starts", starts, 0, 100_000)
    problem = system.problem(Method.RODAS5P)
    light = slice(3 * problem.rings)
    points: list[Array] = []
    for guess in _guesses(system, starts, seed):
        y = _fixed_point(system, problem, guess)
        if y is None:
            continue
        # two fixed points nearer than this are one
        allowed = 1e-6 * np.linalg.norm(y[light])
        if all(np.linalg.norm((y - other)[light]) > allowed for other in points):
            points.append(y)
    return sorted(points, key=lambda y: _energy(y[light]))


def _energy(light: Array) -> float:
    """Energy in fJ of all rings, from their fields and carriers."""
    return float(np.sum(light[0::3] ** 2 + light[1::3] ** 2))


def autonomous(circuit: Circuit, thermal: Any, power: Mapping[str, Any], heaters: Heaters, detuning: Any) -> System:
    """The system of a circuit under constant light of one frequency; InputError for varying light or with delays."""
    powers = checks.mapping("power", power, hint="give powers by the lasers' names, {'in': 1e-3}")
    numbers = {f"power[{name!r}]": watts for name, watts in powers.items()} | {"detuning": detuning}
    for name, value in numbers.items():
        checks.finite(name, value, hint="fixed points and limit cycles belong to a number")
    rest = at_rest(thermal, heaters)
    if any(w.delay > 0 for w in circuit.waveguides):
        raise InputError("the circuit has delays; fixed points and limit cycles are for circuits without")
    names = [laser.name for laser in circuit.lasers]
    for name in powers:
        checks.choice("a name in power", name, names)
    lit = [laser for laser in circuit.lasers if powers.get(laser.name, 0.0) > 0] or list(circuit.lasers)
    if len({laser.offset for laser in lit}) > 1:
        raise InputError("lasers of different frequency beat: there is no fixed point; light one of them only")
    lit_powers = {laser.name: powers.get(laser.name, 0.0) for laser in lit}
    alone = replace(circuit, lasers=lit)
    return system_of(alone, rest.model, power=lit_powers, heaters=rest.sources, detuning=detuning, duration=1.0)


def _fixed_point(system: System, problem: Problem, y: Array) -> Array | None:
    """The fixed point to which damped Newton's method converges from ``y``.

    None without convergence, or if a carrier density is negative. Corrections are relative to the larger of |y| and the
    absolute tolerances of the states.
    """
    n = problem.rings
    floor = system.rings.floor
    least = np.concatenate([floor[:, [0, 0, 1]].ravel(), np.full(y.size - 3 * n, 1e-6)])
    try:
        for _ in range(ITERATIONS):
            rate, J = problem.slopes(y)
            step = np.linalg.solve(J, -rate)
            scale = np.maximum(np.abs(y), least)
            size = float(np.linalg.norm(step / scale))
            # the last correction is below 1e-11
            if size < 1e-11 * np.sqrt(y.size):
                y = y + step
                carriers = y[2 : 3 * n : 3]
                return None if np.any(carriers < -least[2]) else y
            damping = 1.0
            while damping > 1e-4:
                ahead, _ = problem.slopes(y + damping * step)
                following = np.linalg.solve(J, -ahead)
                if float(np.linalg.norm(following / scale)) < (1 - damping / 4) * size:
                    break
                damping /= 2
            y = y + damping * step
    except np.linalg.LinAlgError:
        return None
    return None


def _guesses(system: System, starts: int, seed: int) -> Iterator[Array]:
    """Start states for Newton's method: the low-power branch at full power, then random detunings of the hot rings."""
    n = len(system.circuit.names)
    drive = system.lights.drive
    y = system.problem(Method.RODAS5P).zero()
    for share in np.geomspace(1e-3, 1.0, RAMP):
        power = drive.power._replace(coefficients=share * drive.power.coefficients)
        dimmed = system.lights._replace(drive=drive._replace(power=power))
        weaker = replace(system, lights=dimmed)
        following = _fixed_point(weaker, weaker.problem(Method.RODAS5P), y)
        if following is None:
            break
        y = following
    yield y
    rng = np.random.default_rng(checks.seed(seed))
    for _ in range(starts):
        u = rng.uniform(-1, 1, n)
        # within five half widths of the resonance; beyond light hardly heats
        widest = 5.0 * system.rings.modes[:, 0, 0]
        yield _state_at(system, widest * u * np.abs(u))


def _state_at(system: System, D: Array) -> Array:
    """State vector at the resonance detunings D (rad/ns) of the hot rings; without heat flow between the rings."""
    n = len(D)
    drive = system.lights.drive
    power = drive.power.coefficients[0, :, 0]
    phase = drive.phase.coefficients[0, :, 0]
    into = drive.entry @ (np.sqrt(power) * np.exp(1j * phase))
    between = system.light.between * eq.NS
    rates = eq.Mode(*system.rings.modes[:, 0].T)
    law = eq.Carriers(*system.rings.carriers.T)
    U = np.zeros(n)
    N = np.zeros(n)
    for _ in range(SWEEPS):
        alone = np.diag(field_loss(U, N, rates) - 1j * D)
        field = np.linalg.solve(alone - between, 1j * into)
        U = 0.5 * U + 0.5 * np.abs(field) ** 2
        steady, _ = steady_carriers(rates.generation * U**2, law)
        N = 0.5 * N + 0.5 * steady
    heating = absorbed_power(U, N, rates)[:, None]
    x = system.heat.gain / system.heat.rate * eq.UW * heating
    return np.concatenate([np.column_stack([field.real, field.imag, N]).ravel(), x.ravel()])


def described(system: System, points: list[Array]) -> xr.Dataset:
    """The fixed points as a Dataset over state, ring and port, in SI."""
    problem = system.problem(Method.RODAS5P)
    n, K = system.heat.gain.shape
    y = np.array(points).reshape(-1, problem.size)
    light = y[:, : 3 * n].reshape(-1, n, 3)
    x = y[:, 3 * n :].reshape(-1, n, K)
    z = np.einsum("ijk,sjk->si", system.heat.read, x)  # of one ring alone where the model has a curvature
    by_heaters = np.array([float(offset(0.0)) for offset in system.heating.rises])
    rises = z + system.heat.curvature * z**2 + by_heaters
    rows = np.dstack([light, rises]).reshape(len(y), -1)
    states = as_dataset(system, np.hstack([np.zeros((len(y), 1)), rows]))
    states = states[["energy", "carriers", "delta_T", "absorbed", "output"]].drop_vars("time")
    states = states.rename_dims(time="state").transpose("state", "ring", "port")
    values = np.array([np.linalg.eigvals(problem.slopes(state)[1]) for state in y]).reshape(y.shape)
    growth, omega, growing = leading(values)
    columns = {"growth_rate": growth / eq.NS, "frequency": omega / (2 * np.pi * eq.NS), "growing": growing}
    return states.assign(dataset.variables("state", columns)).assign_attrs(dataset.stamp("fixed points of a circuit"))


def leading(values: Complex) -> tuple[Array, Array, Indices]:
    """Return, for each row of eigenvalues: the largest real part, |Im| of that eigenvalue, and the count of Re > 0."""
    k = values.real.argmax(axis=1)
    first = np.take_along_axis(values, k[:, None], axis=1)[:, 0]
    # real, too, with |Im|/|lambda| below 1e-6: a double eigenvalue splits by the root of round-off
    frequency = np.abs(first.imag)
    omega = np.where(frequency > 1e-6 * np.abs(first), frequency, 0.0)
    return first.real, omega, (values.real > 0).sum(axis=1)


def low_power_transmission(
    circuit: Circuit, detuning: Any, power: Mapping[str, float] | None, thermal: Any, heaters: Mapping[str, Any]
) -> xr.Dataset:
    """Linear transmission from one laser to every port as a Dataset over detuning, with phase and energies.

    [(gamma - i D) - M] a = i K^T G E l,      D_i = -2 pi (reference + detuning - f_i) - w_i dT_i

    dT_i is the rise by constant heaters, w_i the `RingResonator.thermal_shift`.
    """
    nu = check_axis("detuning", detuning)
    names = [laser.name for laser in circuit.lasers]
    powers = checks.mapping("power", power)
    lit = {name: watts for name, watts in powers.items() if watts > 0} or {names[0]: 0.0}
    for name in lit:
        checks.choice("power", name, names)
    if len(lit) > 1 or max(lit.values()) > WEAK:
        raise InputError(
            f"power = {power!r} must hold one laser of at most {WEAK:g} W: the transmission of a circuit is that of "
            "low power; steady_states finds fixed points at more"
        )
    k = names.index(next(iter(lit)))
    rings = circuit.resonators
    rest = at_rest(thermal, heaters)
    poles = {} if thermal is None else ring_heat(thermal, rings, circuit.names).heaters
    rises = heating(poles, rest.powers, 1.0, 1e-6, None, len(rings)).rises
    warmed = np.array([ring.thermal_shift * float(rise(0.0)) for ring, rise in zip(rings, rises, strict=True)])
    waves = np.empty((len(circuit.ports), nu.size), dtype=complex)
    fields = np.empty((len(circuit.names), nu.size), dtype=complex)
    for column, detuned in enumerate((nu + circuit.lasers[k].offset).tolist()):
        waves[:, column], fields[:, column] = _response(circuit, detuned, k, warmed)
    transmission = {"units": "1", "long_name": "transmission"}
    spectra = {
        "transmission": (("port", "detuning"), np.abs(waves) ** 2, transmission),
        "energy": (("ring", "detuning"), np.abs(fields) ** 2, {"units": "J/W", "long_name": "energy per power"}),
    }
    spectra |= dataset.variables(("port", "detuning"), {"phase": np.angle(waves)})
    spectra |= dataset.variables("detuning", {"detuning": nu})
    places = {"port": list(circuit.ports), "ring": list(circuit.names)}
    return xr.Dataset(spectra, places, rest.attributes)


def _response(circuit: Circuit, detuning: float, k: int, warmed: Array) -> tuple[Complex, Complex]:
    """Linear response to laser ``k`` with unit amplitude: waves at the ports and fields of the rings (sqrt(s)).

    warmed [rad/s]: by which heaters lower the resonance of every ring.
    """
    with checks.prefixed(f"detuning = {detuning:g} Hz"):
        light = light_of(circuit, detuning)
    rates = np.array([ring.linear_rate for ring in circuit.resonators])
    cold = np.array([ring.frequency for ring in circuit.resonators])
    frequency = float(circuit.frequency or 0) + detuning
    turn = 2 * np.pi * (frequency - cold) + warmed
    alone = np.diag(rates + 1j * turn)
    a = np.linalg.solve(alone - light.between, 1j * light.from_laser[:, k])
    waves = light.seen_ring @ a + light.seen_laser[:, k]
    return waves[: len(circuit.ports)], np.asarray(a)
