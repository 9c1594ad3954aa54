"""Limit cycle of a small circuit: single shooting from the end of a run, with the kernel's derivative of the flow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from thermofem import checks
from thermofem.arrays import Array

from ..kernel import units as eq
from ..kernel.integrator import Problem
from ..kernel.tableaus import Method
from .circuit import Circuit
from .run import run_circuit
from .stationary import autonomous
from .system import System

LAPS = (1, 2, 3, 4)  # pulses in one period, tried in turn
SWING = 1e-3  # relative, below which a state counts as at rest


def circuit_limit_cycle(
    circuit: Circuit,
    thermal: Any,
    *,
    power: Mapping[str, float],
    heaters: Mapping[str, float] | None = None,
    detuning: float = 0.0,
    settle: float = 20e-6,
    samples: int = 401,
) -> xr.Dataset:
    """The limit cycle that a circuit under constant light runs into, with its Floquet multipliers.

        phi_T(y) = y,    f(y) . dy = 0 in every Newton step,    multipliers = eig(d phi_T/dy)

    A run of the length ``settle`` leads to its neighbourhood; Newton's method closes it. Only a cycle that attracts is
    found; `limit_cycle` has more for a ring alone.

    Parameters
    ----------
    circuit, thermal, power, heaters, detuning
        as for `steady_states`.
    settle : float, s, long against the slowest time scale of the heat.
    samples : int, times in the period, its two ends included.

    Returns
    -------
    xarray.Dataset
        one period, as of `simulate`, without dark lasers before the one that is lit; attrs["period"] in s;
        variable multipliers, the largest first. One of them is 1, and the cycle attracts where all others are inside
        the unit circle.

    Raises
    ------
    InputError
        as `steady_states`; a circuit that comes to rest, or whose pulses do not repeat within four.

    >>> import coupled, thermofem as th
    >>> model = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    >>> circuit = coupled.bus(coupled.borghi2021())
    >>> cycle = coupled.limit_cycle(circuit, model, power={"in": 6.31e-3})
    >>> print(f"{cycle.attrs['period'] * 1e9:.1f} ns")
    686.0 ns
    """
    settle = checks.between("settle", settle, 1e-9, 1, unit="s", hint="times are in s")
    samples = checks.integer("samples", samples, 3, 10_000_000)
    system = autonomous(circuit, thermal, power, heaters, detuning)
    run_to = partial(
        run_circuit, system.circuit, thermal, heaters=heaters, detuning=detuning, average=False, method=None,
        power={laser.name: power.get(laser.name, 0.0) for laser in system.circuit.lasers}, progress=None,
    )  # fmt: skip
    run = run_to(duration=settle, rtol=1e-6, times=None, initial=None)
    guess, units = _period(run, settle), eq.units(system.heat.gain.shape[1], len(system.circuit.names))
    start = np.asarray(run.attrs["final_state"]) / units
    y, period, multipliers = _repeating(system, start, guess * 1e9, settle)
    begin = xr.Dataset(attrs=run.attrs | {"final_state": y * units})
    times = np.linspace(0.0, period * 1e-9, int(samples))
    cycle = run_to(duration=times[-1], rtol=1e-9, times=times, initial=begin)
    cycle["multipliers"] = ("multiplier", multipliers, {"units": "1", "long_name": "Floquet multipliers"})
    cycle.attrs["period"] = float(times[-1])
    return cycle


def _repeating(system: System, start: Array, pulse: float, settle: float) -> tuple[Array, float, Any]:
    """The cycle of the fewest pulses of ``pulse`` ns that Newton's method closes."""
    for laps in LAPS:
        closed = _closed(system, start, laps * pulse)
        if closed is not None:
            return closed
    raise checks.InputError(
        f"settle = {settle:g} s leads to no cycle that repeats within {LAPS[-1]} pulses",
        "lengthen it, unless the pulses die away or never repeat",
    )


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


def _problem(system: System, period: float) -> Problem:
    """The problem over ``period`` ns."""
    edges, drive = np.array([0.0, period]), system.drive
    tables = {name: getattr(drive, name)._replace(edges=edges) for name in ("power", "phase", "detuning")}
    return replace(system, drive=drive._replace(edges=edges, **tables)).problem(Method.RODAS5P)


def _closed(system: System, y: Array, period: float) -> tuple[Array, float, Any] | None:
    """Newton's method for phi_T(y) = y: state, period in ns and multipliers, or None where it does not converge."""
    n = len(system.circuit.names)
    x = np.abs(y[3 * n :])
    light = np.repeat(np.abs(y[0 : 3 * n : 3] + 1j * y[1 : 3 * n : 3]), 3).reshape(n, 3)
    light[:, 2] = np.abs(y[2 : 3 * n : 3])
    scale = np.maximum(
        np.concatenate([light.ravel(), x]),
        np.concatenate([system.rings.floor[:, [0, 0, 1]].ravel(), np.full(x.size, 1e-3 * x.max())]),
    )
    for _ in range(12):
        problem = _problem(system, period)
        # to 1e-10 of the flow over a period
        run = problem.integrate(y, rtol=1e-10, times=np.array([period]), keep_steps=True)
        end = run.y
        missed = (end - y) / scale
        if not np.linalg.norm(missed) < 10.0 * np.sqrt(y.size):  # nan too
            return None
        M = problem.follow(y, run.steps, np.diag(scale))[1] / scale[:, None]
        # a closed cycle: its ends are 1e-7 apart
        if np.linalg.norm(missed) < 1e-7 * np.sqrt(y.size):
            values = np.linalg.eigvals(M)
            moves = (
                np.linalg.norm(problem.slopes(y)[0] / scale) * period > SWING
            )  # at a fixed point every period closes
            # 0.01 from 1: the multiplier of a shift in time, which is right to 5e-6 (measured)
            if not moves or np.abs(values - 1).min() > 0.01:
                return None
            return y, period, values[np.argsort(-np.abs(values))]
        along, leaving = problem.slopes(end)[0] / scale, problem.slopes(y)[0] / scale
        matrix = np.block([[M - np.eye(y.size), along[:, None]], [leaving[None], np.zeros((1, 1))]])
        step = np.linalg.lstsq(matrix, np.append(-missed, 0.0), rcond=None)[0]
        share = min(1.0, 0.1 * period / max(abs(step[-1]), 1e-300))
        y, period = y + share * step[:-1] * scale, period + share * step[-1]
    return None
