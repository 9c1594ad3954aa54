"""Until when a run is driven is told by its inputs: samples may miss it, and a second laser has no row of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rings import RING

import coupled
import thermofem as th

HEAT = th.Foster(R=[600, 1500, 2000, 2200, 1500], tau=[20e-9, 100e-9, 400e-9, 2e-6, 12e-6])
OTHER = replace(RING, frequency=RING.frequency + 1.5e12)
SQUARE = th.SquareWave(2e-3, 1e-6, 0.5)
TURNING = th.Function(lambda t: 10e9 * np.sin(2 * np.pi * t / 1e-6))
SPARSE = np.arange(1999) * 10e-9 + 7e-9  # between the pulses of 5 ns

# no laser here makes the ring pulse by itself: at these powers it has one fixed point, and that is stable
QUIET = {"power": 0.1e-3, "duration": 20e-6}
DRIVEN = {
    "the power of laser 2": {**QUIET, "lasers": coupled.Laser(SQUARE, 0.0, OTHER)},
    "the detuning of laser 2": {**QUIET, "lasers": coupled.Laser(2e-3, TURNING, OTHER)},
    "the light of resonance 2": {
        **QUIET, "lasers": [coupled.Laser(0.3e-3, 0.0, OTHER), coupled.Laser(0.2e-3, 5e6, OTHER)]
    },
    "the light": {**QUIET, "lasers": coupled.Laser(0.1e-3, 5e6)},
    "the light of a sweep": {**QUIET, "lasers": coupled.Laser([0.1e-3, 0.0], coupled.Sweep([0, 1], [5e6, 5e6]))},
    "the power": {**QUIET, "power": [0.3e-3, th.SquareWave(6e-3, 500e-9, 0.01)], "times": SPARSE},
}  # fmt: skip


@pytest.mark.parametrize("name", DRIVEN)
def test_the_answer_to_a_drive_is_no_self_pulsing(name):
    """A drive or a beat has a period; the ring that follows it does not pulse by itself."""
    found = coupled.pulsing(coupled.simulate(RING, HEAT, **DRIVEN[name]))
    assert found.regime == "driven"
    assert found.reason.startswith("light or heaters vary up to ")
    assert found.period < 2e-6


def test_light_that_varies_early_or_not_at_all_drives_nothing():
    quiet = {"power": 6.31e-3, "duration": 10e-6}
    for more in ({}, {"lasers": coupled.Laser(1e-6, 0.0, OTHER)}, {"lasers": coupled.Laser(0.0, 5e6)}):
        run = coupled.simulate(RING, HEAT, **quiet, **more)
        assert run.attrs["driven_until"] == 0
        assert coupled.pulsing(run).regime == "self-pulsing"
    second = coupled.Laser(th.Pulse(1e-4, 1e-6), 1e9)  # dark in the half that is judged
    assert coupled.pulsing(coupled.simulate(RING, HEAT, **quiet, lasers=second)).regime == "self-pulsing"
    early = coupled.simulate(RING, HEAT, power=[6.31e-3, th.Pulse(1e-3, 1e-6, 2e-6)], duration=10e-6)
    assert coupled.pulsing(early).regime == "self-pulsing"
    assert coupled.pulsing(early.sel(time=slice(0, 4e-6))).regime == "driven"  # its second half holds the last edge


def test_a_circuit_is_driven_by_light_that_varies_or_beats():
    """Lasers 5 MHz apart at ring 1, as long as both are on."""
    lasers = [coupled.LaserPort("a", "ring 1.in"), coupled.LaserPort("b", "ring 1.add", offset=5e6)]
    circuit = coupled.Circuit(rings=[RING, RING], waveguides=[], lasers=[*lasers, coupled.LaserPort("c", "ring 2.in")])

    def run(**power):
        return coupled.simulate(circuit, HEAT, power=power, duration=12e-6)

    beating = coupled.pulsing(run(a=0.3e-3, b=0.2e-3).sel(ring="ring 1"))
    assert beating.regime == "driven"
    assert beating.period == pytest.approx(200e-9, rel=0.01, abs=0)
    assert coupled.pulsing(run(a=1e-3, c=SQUARE).sel(ring="ring 2")).regime == "driven"
    early = run(a=6.31e-3, b=th.Pulse(1e-3, 2e-6))
    assert early.attrs["driven_until"] == pytest.approx(2e-6)
    assert coupled.pulsing(early.sel(ring="ring 1")).regime == "self-pulsing"
    assert run(a=6.31e-3).attrs["driven_until"] == 0
