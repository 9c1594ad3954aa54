"""What varies in a run of a circuit, ring by ring: lasers, heaters, and lasers of several frequencies that meet."""

from __future__ import annotations

import numpy as np

from thermofem.arrays import NDArray

from ..runs.driven import LIGHT, varying
from .circuit import Circuit
from .network import NOTHING, Light
from .system import System


def varies(circuit: Circuit, system: System, duration: float) -> dict[str, str]:
    """The attribute that `driven.varying` makes, with the rings in which light beats."""
    given = {"the detuning": system.frame}
    given |= {f"the power of {one.name}": wave for one, wave in zip(circuit.lasers, system.powers, strict=True)}
    given |= {f"the power of {name}": wave for name, wave in system.heaters.items()}
    on = np.array([bool(np.any(wave.coefficients)) for wave in system.powers])
    offsets = np.array([laser.offset for laser in circuit.lasers])
    beating = [
        LIGHT + name
        for name, lasers in zip(circuit.names, reached(system.light), strict=True)
        if np.unique(offsets[lasers & on]).size > 1
    ]
    return varying(given, duration, beating)


def reached(light: Light) -> NDArray[np.bool_]:
    """Which lasers' light comes to which rings, on any way, shape (N, L)."""
    n, delayed = len(light.between), slice(0, light.delay.size)
    step = np.block([[light.between, light.from_delay], [light.seen_ring[delayed], light.seen_delay[delayed]]])
    found = _some(np.vstack([light.from_laser, light.seen_laser[delayed]]))
    way = _some(step)
    for _ in range(len(way)):
        found = found | (way.astype(int) @ found.astype(int) > 0)
    return np.asarray(found[:n])


def _some(matrix: NDArray[np.complex128]) -> NDArray[np.bool_]:
    """Entries that are more than what round-off leaves."""
    return np.abs(matrix) > NOTHING * np.abs(matrix).max(initial=0.0)
