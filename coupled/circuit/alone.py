"""A circuit of one ring on its buses: integrated by the kernel of a ring alone, step by step as `simulate` does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from thermofem.arrays import Array, NDArray

from ..inputs import Pieces, pieces
from ..kernel.tableaus import Method
from ..runs.window import advance
from ..states import State
from ..thermal import compact
from .circuit import Circuit
from .heat import _model_of
from .network import Light


def is_alone(circuit: Circuit) -> bool:
    """Whether the circuit is one ring that one laser reaches by its first coupler, without any waveguide."""
    return (
        len(circuit.names) == 1
        and not circuit.waveguides
        and len(circuit.lasers) == 1
        and circuit.lasers[0].stop == circuit.entries[0]
    )


def run_alone(
    circuit: Circuit,
    light: Light,
    thermal: Any,
    begin: Array,
    *,
    power: Any,
    detuning: Any,
    offset: Pieces,
    duration: float,
    rtol: float,
    method: Method,
    times: Array,
    progress: Callable[[float], None] | None,
) -> tuple[Array, Array, NDArray[np.int64]]:
    """Rows as of `integrate.integrate`, that of the start included, the final state, and the counts."""
    from ..kernels import equations as eq
    from ..runs.window import units

    ring, port = circuit.resonators[0], circuit.lasers[0]
    share = abs(port.transmission) ** 2
    turned = float(circuit.frequency or 0.0) - ring.frequency + port.offset
    arriving: Any = power if share == 1 else pieces("power", power, 0.0, duration).times(share)
    moved: Any = detuning if turned == 0 else [detuning, turned]
    heated = offset if np.any(offset.coefficients) else 0.0
    unit = units(begin.size - 3)
    run = advance(
        ring, compact(_model_of(thermal)), State.from_array(begin * unit), 0.0, duration,
        power=float(arriving) if _is_number(arriving) else arriving,
        detuning=float(moved) if _is_number(moved) else moved,
        offset=heated, rtol=rtol, method=method, times=times, progress=progress,
    )  # fmt: skip
    a = run.field / np.sqrt(eq.FJ) * port.transmission / np.sqrt(share) if share else run.field / np.sqrt(eq.FJ)
    laser = np.sqrt(np.maximum(pieces("power", power, 0.0, duration)(run.time), 0) / eq.UW)
    rows = np.empty((len(a), 5 + 2 * len(light.terminals)))
    rows[:, 0], rows[:, 1], rows[:, 2] = run.time / eq.NS, a.real, a.imag
    rows[:, 3], rows[:, 4] = run.carriers / eq.DENSITY, run.delta_T
    for q, (by_ring, by_laser) in enumerate(zip(light.seen_ring[:, 0], light.seen_laser[:, 0], strict=True)):
        wave = (by_ring * np.sqrt(eq.NS)) * a + by_laser * laser
        rows[:, 5 + 2 * q], rows[:, 6 + 2 * q] = wave.real, wave.imag
    return rows, run.final.as_array() / unit, np.array([*run.counts, 0])


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.number)
