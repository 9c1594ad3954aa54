"""Fixed points of a circuit under constant light, and their stability: Newton from many starts, dense eigenvalues."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from thermofem import checks
from thermofem.arrays import Array
from thermofem.data import dataset

from ..kernel import units as eq
from ..kernel.integrator import Problem
from ..kernel.tableaus import Method
from ..thermal import trusted
from .circuit import Circuit
from .run import described
from .system import System, system_of

LARGEST = 500  # states; the Jacobian is dense
CLOSED = 1e-11  # relative size of the last Newton correction
SAME = 1e-6  # relative difference of the states of two fixed points that count as one
ITERATIONS, SWEEPS, RAMP = 60, 40, 30
LINES = 5.0  # half widths of a resonance beyond which light hardly heats


def circuit_steady_states(
    circuit: Circuit,
    thermal: Any,
    power: Mapping[str, float],
    detuning: float = 0.0,
    heaters: Mapping[str, float] | None = None,
    starts: int = 100,
    seed: int = 0,
) -> xr.Dataset:
    """Fixed points of a circuit that Newton's method finds, with the eigenvalues of the Jacobian.

        0 = f(y),    growth_rate = max Re eig(df/dy),    y = (Re a, Im a, N of each ring, states of heat)

    Newton's method starts on the branch of low power, followed from 0 to the whole power, and from ``starts`` random
    detunings of the hot rings, with the light, carriers and heat that belong to them. No method is known that finds all
    fixed points of several rings: some may be missed. `steady_states` misses none of a ring alone.

    Parameters
    ----------
    circuit, thermal
        as for `simulate`; without delays.
    power : mapping of laser name to float, W
    heaters : mapping of name to float, W
    detuning : float, Hz
    starts, seed : int

    Returns
    -------
    xarray.Dataset
        over state, by increasing energy: energy (J), carriers (1/m^3), delta_T (K) and absorbed (W) by ring; output (W)
        by port; growth_rate (1/s), frequency (Hz, of the eigenvalue with that real part) and growing, the number of
        eigenvalues with a positive real part: 0 for a stable state.

    Raises
    ------
    InputError
        powers that vary, lasers of different frequency, delays, or more than 500 states.

    >>> import coupled, thermofem as th
    >>> model = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    >>> circuit = coupled.bus(coupled.borghi2021())
    >>> coupled.steady_states(circuit, model, power={"in": 5e-3}, detuning=-32e9).growing.values
    array([0, 1, 2])
    """
    starts = checks.integer("starts", starts, 0, 100_000)
    system = autonomous(circuit, thermal, power, heaters, detuning)
    problem = system.problem(Method.RODAS5P)
    found: list[Array] = []
    for guess in _guesses(system, starts, seed):
        y = _newton(system, problem, guess)
        if y is not None and not any(_same(y, other, len(circuit.names)) for other in found):
            found.append(y)
    n = len(circuit.names)
    found.sort(key=lambda y: float(np.sum(y[0 : 3 * n : 3] ** 2 + y[1 : 3 * n : 3] ** 2)))
    states = _described(system, problem, found)
    trusted(thermal, states["delta_T"].values, states["absorbed"].values * system.heat.thermal_resistance)
    return states


def autonomous(
    circuit: Circuit, thermal: Any, power: Mapping[str, Any], heaters: Mapping[str, Any] | None, detuning: Any
) -> System:
    """A circuit under constant light, or InputError."""
    checks.instance("circuit", circuit, Circuit, hint="it must be a Circuit, such as coupled.bus([ring])")
    heaters = checks.mapping("heaters", heaters)
    for what, values in (("power", power), ("heaters", heaters), ("detuning", {"": detuning})):
        checks.has(what, values, "items", hint="give numbers by name, {'in': 1e-3}")
        for name, value in values.items():
            if not isinstance(value, int | float | np.number):
                named = f"{what}[{name!r}]" if name else what
                raise checks.InputError(
                    f"{named} is a {type(value).__name__}; fixed points and limit cycles belong to a number"
                )
    if any(w.delay > 0 for w in circuit.waveguides):
        raise checks.InputError("the circuit has delays; fixed points and limit cycles are for circuits without")
    lit = [laser for laser in circuit.lasers if power.get(laser.name, 0.0) > 0] or list(circuit.lasers)
    if len({laser.offset for laser in lit}) > 1:
        raise checks.InputError("lasers of different frequency beat: there is no fixed point; light one of them only")
    for name in power:
        checks.choice("a name in power", name, [laser.name for laser in circuit.lasers])
    own = {laser.name: power.get(laser.name, 0.0) for laser in lit}
    system = system_of(
        replace(circuit, lasers=lit), thermal, power=own, heaters=heaters, detuning=detuning, duration=1e-6
    )
    if system.size > LARGEST:
        raise checks.InputError(f"the circuit has {system.size} states, more than {LARGEST}; reduce its heat further")
    return system


def _newton(system: System, problem: Problem, y: Array) -> Array | None:
    """Newton's method, damped until the next correction is smaller; None where that does not converge."""
    n = problem.rings
    least = np.concatenate([system.rings.floor[:, [0, 0, 1]].ravel(), np.full(y.size - 3 * n, 1e-6)])
    try:
        for _ in range(ITERATIONS):
            rate, J = problem.slopes(y)
            step = np.linalg.solve(J, -rate)
            scale = np.maximum(np.abs(y), least)
            size = float(np.linalg.norm(step / scale))
            if size < CLOSED * np.sqrt(y.size):
                y = y + step
                return y if np.all(y[2 : 3 * n : 3] >= -least[2]) else None
            damping = 1.0
            while damping > 1e-4:
                following = np.linalg.solve(J, -problem.slopes(y + damping * step)[0])
                if float(np.linalg.norm(following / scale)) < (1 - damping / 4) * size:
                    break
                damping /= 2
            y = y + damping * step
    except np.linalg.LinAlgError:
        return None
    return None


def _guesses(system: System, starts: int, seed: int) -> Iterator[Array]:
    """States to start from: the branch of low power, then random detunings of the hot rings."""
    n = len(system.circuit.names)
    y = np.zeros(system.size)
    for share in np.geomspace(1e-3, 1.0, RAMP):
        following = _newton(system, system.scaled(float(share)).problem(Method.RODAS5P), y)
        if following is None:
            break
        y = following
    yield y
    rng = np.random.default_rng(checks.seed(seed))
    for _ in range(starts):
        u = rng.uniform(-1, 1, n)
        yield _state_at(system, LINES * system.rings.modes[:, 0, 0] * u * np.abs(u))


def _state_at(system: System, D: Array) -> Array:
    """State with given detunings D in rad/ns: light and carriers of the coupled rings, heat of each ring alone."""
    n = len(D)
    power, phase = system.drive.power.coefficients[0, :, 0], system.drive.phase.coefficients[0, :, 0]
    into = system.drive.entry @ (np.sqrt(power) * np.exp(1j * phase))
    between = system.light.between * eq.NS
    loss, absorbed, fca, tpa, g = system.rings.modes[:, 0, :5].T
    tau0, a, b = system.rings.carriers.T
    U, N = np.zeros(n), np.zeros(n)
    for _ in range(SWEEPS):
        field = np.linalg.solve(np.diag(loss + fca * N + tpa * U - 1j * D) - between, 1j * into)
        U = 0.5 * U + 0.5 * np.abs(field) ** 2
        k = tau0 * g * U**2  # b N^2 + (1 - a k) N - k = 0
        half = 1 - a * k
        N = 0.5 * N + 0.5 * 2 * k / (half + np.sqrt(half**2 + 4 * b * k))
    heating = 2 * (absorbed + fca * N + tpa * U) * U
    x = system.heat.gain / system.heat.rate * eq.UW * heating[:, None]
    return np.concatenate([np.column_stack([field.real, field.imag, N]).ravel(), x.ravel()])


def _same(y: Array, other: Array, rings: int) -> bool:
    light, before = y[: 3 * rings], other[: 3 * rings]
    return bool(np.linalg.norm(light - before) <= SAME * np.linalg.norm(light))


def _described(system: System, problem: Problem, found: list[Array]) -> xr.Dataset:
    """The fixed points as a Dataset, in SI."""
    circuit = system.circuit
    n, K = system.heat.gain.shape
    y = np.array(found).reshape(len(found), 3 * n + n * K)
    field = y[:, 0 : 3 * n : 3] + 1j * y[:, 1 : 3 * n : 3]
    N, x = y[:, 2 : 3 * n : 3], y[:, 3 * n :].reshape(len(y), n, K)
    U = np.abs(field) ** 2
    own = np.einsum("iik,sik->si", system.heat.read, x)
    rises = np.einsum("ijk,sjk->si", system.heat.read, x) + system.heat.curvature * own**2
    rises = rises + np.array([float(offset(0.0)) for offset in system.offsets])
    absorbed, fca, tpa = system.rings.modes[:, 0, 1:4].T
    waves = system.waves(field.T * eq.FJ**0.5, np.zeros(len(y)))[: len(circuit.ports)].T
    values = [np.linalg.eigvals(problem.slopes(one)[1]) for one in y]
    first = [v[np.argmax(v.real)] for v in values]
    by_ring = {
        "energy": U * eq.FJ,
        "carriers": N * eq.DENSITY,
        "delta_T": rises,
        "absorbed": 2 * (absorbed + fca * N + tpa * U) * U * eq.UW,
    }
    variables: dict[str, Any] = {k: (("state", "ring"), v, described(k)) for k, v in by_ring.items()}
    variables["output"] = (("state", "port"), np.abs(waves) ** 2, described("output"))
    rate = np.array([v.real / eq.NS for v in first])
    turn = np.array([abs(v.imag) / (2 * np.pi * eq.NS) for v in first])
    growing = np.array([int(np.sum(v.real > 0)) for v in values], dtype=int)
    variables["growth_rate"] = ("state", rate, {"units": "1/s", "long_name": "largest real part of the eigenvalues"})
    variables["frequency"] = ("state", turn, {"units": "Hz", "long_name": "frequency of that eigenvalue"})
    variables["growing"] = ("state", growing, {"units": "1", "long_name": "number of growing modes"})
    coordinates = {"ring": list(circuit.names), "port": list(circuit.ports)}
    attrs = dataset.stamp("fixed points of a circuit") | {"circuit": circuit.name, "detuning": system.detuning or 0.0}
    return xr.Dataset(variables, coords=coordinates, attrs=attrs)
