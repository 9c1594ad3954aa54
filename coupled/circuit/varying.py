"""What varies at each ring of a circuit: lasers whose light reaches it, heaters, and lasers that beat in it."""

from __future__ import annotations

import numpy as np

from thermofem.arrays import NDArray

from ..inputs import pieces
from ..runs.driven import Spans, attribute, beats, changes, spans
from .circuit import Circuit
from .network import NOTHING, Light
from .system import System


def varies(circuit: Circuit, system: System, duration: float) -> dict[str, str]:
    """The attribute that `driven.varies_in` reads. Where heat goes from ring to ring, what drives one drives all."""
    common = spans(
        {"the detuning": system.frame} | {f"the power of {name}": wave for name, wave in system.heaters.items()},
        duration,
    )
    lasers = [changes(power) for power in system.powers]
    offsets = [pieces("offset", float(laser.offset), 0.0, duration) for laser in circuit.lasers]
    found: dict[str, dict[str, Spans]] = {}
    for name, here in zip(circuit.names, reached(system.light), strict=True):
        which = np.flatnonzero(here).tolist()
        own = {f"the power of {circuit.lasers[k].name}": lasers[k] for k in which}
        own[f"the light of {name}"] = beats([system.powers[k] for k in which], [offsets[k] for k in which])
        found[name] = common | {key: when for key, when in own.items() if when}
    if system.heat.crossed:
        together = {key: when for own in found.values() for key, when in own.items()}
        found = dict.fromkeys(found, together)
    return attribute(found)


def reached(light: Light) -> NDArray[np.bool_]:
    """Which lasers' light comes to which rings, on any way, shape (N, L)."""
    n, delayed = len(light.between), slice(0, light.delay.size)
    step = np.block([[light.between, light.from_delay], [light.seen_ring[delayed], light.seen_delay[delayed]]])
    found = _some(np.vstack([light.from_laser, light.seen_laser[delayed]]))
    way = _some(step).astype(float)
    for _ in range(len(way)):
        further = found | (way @ found.astype(float) > 0)
        if np.array_equal(further, found):
            break
        found = further
    return np.asarray(found[:n])


def _some(matrix: NDArray[np.complex128]) -> NDArray[np.bool_]:
    """Entries that are more than what round-off leaves."""
    return np.abs(matrix) > NOTHING * np.abs(matrix).max(initial=0.0)
