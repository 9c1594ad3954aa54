"""Limit cycle of a small circuit: shooting, as for a ring alone, from the end of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from thermofem import checks

from ..circuit.circuit import Circuit
from ..circuit.run import run_circuit
from ..circuit.stationary import autonomous
from ..circuit.system import System
from ..kernel import units as eq
from ..kernel.integrator import CARRIERS, ENERGY
from ..kernel.tableaus import Method
from .return_map import FINE, Flow
from .settling import Part, measured, pulse_train

LONGEST = 1.0  # s, of a trace
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

    A run of the length ``settle`` leads near it, and `settling.pulse_train` closes it. Only a cycle that attracts is
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
        as `steady_states`; a circuit that comes to rest, or whose pulses do not repeat.

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
    flow, seen = _pulses(system, run, settle)
    units = eq.units(system.heat.gain.shape[1], len(system.circuit.names))
    orbit, why, _ = pulse_train(flow, np.asarray(run.attrs["final_state"]) / units, seen, False, True, FINE)
    if orbit is None:
        raise checks.InputError(
            f"settle = {settle:g} s leads to no cycle: {why}",
            "lengthen it, unless the pulses die away or never repeat",
        )
    begin, period = xr.Dataset(attrs=run.attrs | {"final_state": orbit.start * units}), orbit.T
    times = np.linspace(0.0, period * 1e-9, int(samples))
    cycle = run_to(duration=times[-1], rtol=1e-9, times=times, initial=begin)
    cycle["multipliers"] = ("multiplier", orbit.multipliers, {"units": "1", "long_name": "Floquet multipliers"})
    cycle.attrs["period"] = float(times[-1])
    return cycle


def _pulses(system: System, run: xr.Dataset, settle: float) -> tuple[Flow, Part]:
    """The flow with its section in the ring whose carriers swing most late in a run, and what these carriers do.

    Of rings without carriers the energy counts.
    """
    late = run["time"].values > settle / 2
    N, U = run.carriers.values / eq.DENSITY, run.energy.values / eq.FJ
    quantity = CARRIERS if N.max() > 0 else ENERGY
    q = N if quantity == CARRIERS else U
    low, high = q[:, late].min(axis=1), q[:, late].max(axis=1)
    swing = (high - low) / np.maximum(high, 1e-300)
    k = int(np.argmax(swing))
    if swing[k] < SWING:
        raise checks.InputError("the circuit comes to rest and has no pulses there; steady_states finds it")
    seen = measured(run["time"].values / eq.NS, q[k], settle / eq.NS)
    if seen.rises < 3:
        raise checks.InputError(f"settle = {settle:g} s holds fewer than three pulses in its last part; lengthen it")
    edges, drive = np.array([0.0, LONGEST / eq.NS]), system.drive
    tables = {name: getattr(drive, name)._replace(edges=edges) for name in ("power", "phase", "detuning")}
    whole = replace(system, drive=drive._replace(edges=edges, **tables))
    return Flow(whole.problem(Method.RODAS4), whole.problem(Method.RODAS5P), quantity, k), seen
