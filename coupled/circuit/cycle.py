"""Limit cycle of a small circuit: single shooting from the end of a run, Floquet multipliers by differences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from thermofem import checks
from thermofem.arrays import Array

from ..kernel.tableaus import Method, tableau
from ..runs.window import MAX_STEPS
from .circuit import Circuit
from .fixed_points import _flow, autonomous
from .simulate import simulate_circuit
from .system import System, units_of

if TYPE_CHECKING:
    import xarray as xr

RTOL = 1e-10  # of the flow over a period
CHANGE = 3e-5  # relative, of a state, for the derivatives of the flow
CLOSED = 1e-7  # relative distance of the two ends of a cycle
LAPS = (1, 2, 3, 4)  # pulses in one period, tried in turn
ITERATIONS = 12
SWING = 1e-3  # relative, below which a state counts as at rest
# difference from 1 of the multiplier of a shift in time; differences of steep pulses leave 5e-6 (measured)
TURNED = 0.01


def circuit_limit_cycle(
    circuit: Circuit,
    thermal: Any,
    *,
    inputs: Mapping[str, float],
    heaters: Mapping[str, float] | None = None,
    detuning: float = 0.0,
    settle: float = 20e-6,
    samples: int = 401,
) -> xr.Dataset:
    """The limit cycle that a circuit under constant light runs into, with its Floquet multipliers.

        phi_T(y) = y,    f(y) . dy = 0 in every Newton step,    multipliers = eig(d phi_T/dy)

    A run of the length ``settle`` leads to its neighbourhood; Newton's method closes it. The derivatives of the flow
    are central differences. Only a cycle that attracts is found; `limit_cycle` has more for a ring alone.

    Parameters
    ----------
    circuit, thermal, inputs, heaters, detuning
        as for `steady_states`.
    settle : float, s
        long against the slowest time scale of the heat.
    samples : int
        times in the period, its two ends included.

    Returns
    -------
    xarray.Dataset
        one period, as of `simulate_circuit`, without dark lasers before the one that is lit; attrs["period"] in s;
        variable multipliers, the largest first. One of them is 1, and the cycle attracts where all others are inside
        the unit circle.

    Raises
    ------
    InputError
        as `steady_states`; a circuit that comes to rest, or whose pulses do not repeat within four.

    >>> import coupled, thermofem as th
    >>> model = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    >>> circuit = coupled.bus(coupled.borghi2021())
    >>> cycle = coupled.circuit_limit_cycle(circuit, model, inputs={"in": 6.31e-3})
    >>> print(f"{cycle.attrs['period'] * 1e9:.1f} ns")
    686.0 ns
    """
    import xarray as xr

    settle = checks.between("settle", settle, 1e-9, 1, unit="s", hint="times are in s")
    samples = checks.integer("samples", samples, 3, 10_000_000)
    system = autonomous(circuit, thermal, inputs, heaters, detuning)
    lit = [laser for laser in circuit.lasers if inputs.get(laser.name, 0.0) > 0]
    if lit and lit[0] != circuit.lasers[0]:  # states turn with the first laser, which is dark
        circuit, inputs = replace(circuit, lasers=lit), {laser.name: inputs[laser.name] for laser in lit}
        system = autonomous(circuit, thermal, inputs, heaters, detuning)
    drive = {"inputs": inputs, "heaters": heaters, "detuning": detuning}
    run = simulate_circuit(circuit, thermal, duration=settle, rtol=1e-6, **drive)  # type: ignore[arg-type]
    guess = _period(run, settle)
    units = units_of(*system.heat.gain.shape)
    start = np.asarray(run.attrs["final_state"]) / units
    for laps in LAPS:
        closed = _closed(system, start, laps * guess * 1e9)
        if closed is not None:
            break
    else:
        raise checks.InputError(
            f"settle = {settle:g} s leads to no cycle that repeats within {LAPS[-1]} pulses",
            "lengthen it, unless the pulses die away or never repeat",
        )
    y, period, multipliers = closed
    begin = xr.Dataset(attrs=run.attrs | {"final_state": y * units})
    duration = period * 1e-9
    times = np.linspace(0.0, duration, int(samples))
    cycle = simulate_circuit(
        circuit, thermal, duration=duration, rtol=1e-9, times=times, initial=begin, **drive  # type: ignore[arg-type]
    )  # fmt: skip
    cycle["multipliers"] = ("multiplier", multipliers, {"units": "1", "long_name": "Floquet multipliers"})
    cycle.attrs["period"] = duration
    return cycle


def _period(run: xr.Dataset, settle: float) -> float:
    """Mean time in s between rises of the carriers that swing most through their middle, in the last half of a run.

    Of a ring without carriers the energy counts.
    """
    late = run.isel(time=run["time"].values > settle / 2)
    N, t = late.carriers.values, late["time"].values
    N = np.where(N.max(axis=1, keepdims=True) > 0, N, late.energy.values)
    low, high = N.min(axis=1), N.max(axis=1)
    swing = (high - low) / np.maximum(high, 1e-300)
    k = int(np.argmax(swing))
    if swing[k] < SWING:
        raise checks.InputError("the circuit comes to rest and has no pulses there; steady_states finds it")
    level = N[k] - (low[k] + high[k]) / 2
    up = np.flatnonzero((level[:-1] < 0) & (level[1:] >= 0))
    if up.size < 3:
        raise checks.InputError(f"settle = {settle:g} s holds fewer than three pulses in its last half; lengthen it")
    rises = t[up] - level[up] * (t[up + 1] - t[up]) / (level[up + 1] - level[up])
    return float(np.diff(rises).mean())


def _flown(system: System, y: Array, period: float) -> Array:
    """The state after ``period`` ns."""
    from ..kernels.control import DONE
    from ..kernels.interrupts import new_watch
    from .integrate import integrate
    from .poles import series

    drive, method = system.drive._replace(edges=np.array([0.0, period])), tableau(Method.RODAS5P)
    _, end, _, counts = integrate(
        y, drive, system.rings, system.states, system.net, method, series(method), RTOL, np.array([period]), False,
        np.empty(0), MAX_STEPS, new_watch(),
    )  # fmt: skip
    return np.asarray(end) if counts[2] == DONE else np.full(y.size, np.nan)


def _closed(system: System, y: Array, period: float) -> tuple[Array, float, Any] | None:
    """State, period in ns and multipliers of the cycle that Newton's method finds, or None."""
    n = len(system.rings.rates)
    x = np.abs(y[3 * n :])
    light = np.repeat(np.abs(y[0 : 3 * n : 3] + 1j * y[1 : 3 * n : 3]), 3).reshape(n, 3)
    light[:, 2] = np.abs(y[2 : 3 * n : 3])
    scale = np.maximum(
        np.concatenate([light.ravel(), x]),
        np.concatenate([system.rings.floor[:, [0, 0, 1]].ravel(), np.full(x.size, 1e-3 * x.max())]),
    )
    for _ in range(ITERATIONS):
        end = _flown(system, y, period)
        missed = (end - y) / scale
        if not np.linalg.norm(missed) < 10.0 * np.sqrt(y.size):  # nan too
            return None
        M = np.empty((y.size, y.size))
        for j in range(y.size):
            delta = np.zeros(y.size)
            delta[j] = CHANGE * scale[j]
            M[:, j] = (_flown(system, y + delta, period) - _flown(system, y - delta, period)) / (2 * CHANGE) / scale
        if np.linalg.norm(missed) < CLOSED * np.sqrt(y.size):
            values = np.linalg.eigvals(M)
            moves = np.linalg.norm(_flow(system, y) / scale) * period > SWING  # at a fixed point every period closes
            if not moves or np.abs(values - 1).min() > TURNED:
                return None
            return y, period, values[np.argsort(-np.abs(values))]
        along, leaving = _flow(system, end) / scale, _flow(system, y) / scale
        matrix = np.block([[M - np.eye(y.size), along[:, None]], [leaving[None], np.zeros((1, 1))]])
        step = np.linalg.lstsq(matrix, np.append(-missed, 0.0), rcond=None)[0]
        share = min(1.0, 0.1 * period / max(abs(step[-1]), 1e-300))
        y, period = y + share * step[:-1] * scale, period + share * step[-1]
    return None
