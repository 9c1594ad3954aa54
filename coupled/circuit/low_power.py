"""Spectra of a circuit at low power: no carriers, no heat, every detuning solved for itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from thermofem import checks

from ..arguments import check_axis
from .circuit import Circuit
from .network import light_of

WEAK = 1e-6  # W; heat of a tenth of it moves a resonance by 1e-3 of its width
RESONANT = 1e9  # light in a loop over that which enters it, from which on fewer than seven digits are left


def low_power_transmission(circuit: Circuit, detuning: Any, power: Mapping[str, float] | None = None) -> xr.Dataset:
    """Transmission from one laser to every port at low power.

        [(gamma - i D) - M] a = i K^T G E l,      D_i = -2 pi (reference + detuning - f_i)

    Parameters
    ----------
    circuit : Circuit
    detuning : array, shape (n,), Hz
        increasing; laser minus the circuit's reference frequency.
    power : mapping of laser name to float, W, optional
        which laser is lit, by at most 1 uW; default the first one. Its offset counts.

    Returns
    -------
    xarray.Dataset
        transmission (power at the port per power of the laser) and phase (rad) by port, and energy (J per W) by ring,
        over detuning.

    Raises
    ------
    InputError
        detunings that do not increase, a resonance of a loop of waveguides without loss, a name that is no laser, or
        more than low power.

    >>> import coupled
    >>> at = coupled.transmission(coupled.bus(coupled.borghi2021()), detuning=[0.0])
    >>> at.transmission.sel(port="drop 1").round(4).values
    array([0.8834])
    """
    nu = check_axis("detuning", detuning)
    names = [one.name for one in circuit.lasers]
    lit = [name for name, value in checks.mapping("power", power).items() if value > 0]
    for name in lit:
        checks.choice("power", name, names)
    if len(lit) > 1 or max((dict(power or {})[name] for name in lit), default=0.0) > WEAK:
        raise checks.InputError(
            f"power = {power!r} must hold one laser of at most {WEAK:g} W: the transmission of a circuit is that of "
            "low power; steady_states finds fixed points at more"
        )
    k = names.index(lit[0]) if lit else 0
    rings, ports, D = circuit.resonators, circuit.ports, sum(w.delay > 0 for w in circuit.waveguides)
    seen, fields = np.empty((len(ports), nu.size), dtype=complex), np.empty((len(rings), nu.size), dtype=complex)
    for m, detuning in enumerate(nu + circuit.lasers[k].offset):
        light = light_of(circuit, float(detuning))
        turn = np.array([2 * np.pi * (float(circuit.frequency or 0) + detuning - ring.frequency) for ring in rings])
        own = np.diag([ring.linear_rate for ring in rings] + 1j * turn)
        # waves at the starts of the delayed waveguides are unknowns, too: u = A a + B l + P u
        A, B, P = light.seen_ring[:D], light.seen_laser[:D, k], light.seen_delay[:D]
        around = np.eye(D) - P
        if D and np.linalg.norm(around, -2) * RESONANT < 1:
            what = f"detuning[{m}] = {nu[m]:g} Hz is a resonance of a loop of waveguides without loss"
            raise checks.InputError(what, "give one of them a loss, or leave that detuning out")
        late = np.linalg.inv(around)
        matrix = own - light.between - 1j * light.from_delay @ late @ A
        a = np.linalg.solve(matrix, 1j * (light.from_laser[:, k] + light.from_delay @ late @ B))
        u = late @ (A @ a + B)
        waves = light.seen_ring @ a + light.seen_laser[:, k] + light.seen_delay @ u
        seen[:, m], fields[:, m] = waves[D : D + len(ports)], a
    return xr.Dataset(
        {
            "transmission": (("port", "detuning"), np.abs(seen) ** 2, {"units": "1", "long_name": "transmission"}),
            "phase": (("port", "detuning"), np.angle(seen), {"units": "rad", "long_name": "phase"}),
            "energy": (("ring", "detuning"), np.abs(fields) ** 2, {"units": "J/W", "long_name": "energy per power"}),
        },
        coords={
            "port": list(ports),
            "ring": list(circuit.names),
            "detuning": ("detuning", nu, {"units": "Hz", "long_name": "detuning"}),
        },
    )
