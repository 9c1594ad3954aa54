"""What varies in a run is told by its inputs: samples may miss it, and a second laser has no row of its own."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from rings import RING

import coupled
import thermofem as th
from coupled.inputs import ATTRIBUTE, changes, pieces

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
    "the light ": {**QUIET, "lasers": coupled.Laser([0.1e-3, 0.0], coupled.Sweep([0, 1], [5e6, 5e6]))},
    "the power": {**QUIET, "power": [0.3e-3, th.SquareWave(6e-3, 500e-9, 0.01)], "times": SPARSE},
}  # fmt: skip


@pytest.mark.parametrize("name", DRIVEN)
def test_the_answer_to_a_drive_is_no_self_pulsing(name):
    """They were "self-pulsing", with the period of the drive or of the beat."""
    found = coupled.pulsing(coupled.simulate(RING, HEAT, **DRIVEN[name]))
    assert found.regime == "driven"
    assert found.reason.startswith(f"{name.strip()} varies: ")
    assert found.period < 2e-6


def test_light_that_varies_early_or_not_at_all_drives_nothing():
    quiet = {"power": 6.31e-3, "duration": 10e-6}
    for more in ({}, {"lasers": coupled.Laser(1e-6, 0.0, OTHER)}, {"lasers": coupled.Laser(0.0, 5e6)}):
        run = coupled.simulate(RING, HEAT, **quiet, **more)
        assert json.loads(run.attrs[ATTRIBUTE]) == {}
        assert coupled.pulsing(run).regime == "self-pulsing"
    second = coupled.Laser(th.Pulse(1e-4, 1e-6), 1e9)  # dark in the half that is judged
    assert coupled.pulsing(coupled.simulate(RING, HEAT, **quiet, lasers=second)).regime == "self-pulsing"
    early = coupled.simulate(RING, HEAT, power=[6.31e-3, th.Pulse(1e-3, 1e-6, 2e-6)], duration=10e-6)
    assert coupled.pulsing(early).regime == "self-pulsing"
    assert coupled.pulsing(early.sel(time=slice(0, 4e-6))).regime == "driven"  # its second half holds the last edge


def test_a_ring_of_a_circuit_is_driven_by_light_that_beats_in_it():
    """Lasers 5 MHz apart at ring 1; what it passes on by its first coupler is that of the first laser alone."""
    circuit = coupled.Circuit(
        rings=[RING, RING],
        waveguides=[],
        lasers=[
            coupled.LaserPort("a", "ring 1.in"),
            coupled.LaserPort("b", "ring 1.add", offset=5e6),
            coupled.LaserPort("c", "ring 2.in"),
        ],
    )
    run = coupled.simulate(circuit, HEAT, power={"a": 0.3e-3, "b": 0.2e-3, "c": 6.31e-3}, duration=12e-6)
    one, two = (coupled.pulsing(run.sel(ring=name)) for name in ("ring 1", "ring 2"))
    assert (one.regime, two.regime) == ("driven", "self-pulsing")
    assert one.reason.startswith("the light of ring 1 varies: ")
    assert one.period == pytest.approx(200e-9, rel=0.01, abs=0)
    dark = coupled.simulate(circuit, HEAT, power={"a": 6.31e-3}, duration=2e-6)
    assert json.loads(dark.attrs[ATTRIBUTE]) == {"ring 1": {}, "ring 2": {}}


def test_a_ring_is_driven_by_what_reaches_it():
    """Light of a laser elsewhere is none of its business; heat of a neighbour that beats is."""
    lasers = [coupled.LaserPort("one", "ring 1.in"), coupled.LaserPort("two", "ring 2.in")]
    apart = coupled.Circuit([RING, RING], lasers=lasers)
    inputs = {"one": 6.31e-3, "two": th.SquareWave(1e-3, 1e-6, 0.5)}
    run = coupled.simulate(apart, HEAT, power=inputs, duration=8e-6)
    assert [coupled.pulsing(run.sel(ring=name)).regime for name in apart.names] == ["self-pulsing", "driven"]
    R = np.array([[7784.0, 1500.0], [1500.0, 7784.0]])
    w, V = np.linalg.eigh(R)
    C, names = V * np.sqrt(w / 1.2e-6), ("ring 1", "ring 2")
    crossed = th.StateSpace(np.eye(2), -np.eye(2) / 1.2e-6, C.T, C, names, names)
    beating = coupled.Circuit([RING, RING], lasers=[*lasers, coupled.LaserPort("b", "ring 1.add", offset=2e6)])
    inputs = {"one": 1e-3, "b": 8e-4, "two": 2e-4}
    run = coupled.simulate(beating, crossed, power=inputs, duration=10e-6, detuning=-3e9)
    found = coupled.pulsing(run.sel(ring="ring 2"))
    assert found.reason.startswith("the light of ring 1 varies: ")


def test_a_cut_run_is_not_judged_by_its_heaters_at_the_end():
    """ "No fixed point is stable": the attribute was that of the end of the uncut run."""
    two = th.StateSpace(
        np.eye(2), -np.eye(2) / 1.2e-6, np.sqrt(np.eye(2) * 7784 / 1.2e-6),
        np.sqrt(np.array([[7784, 1], [1, 7784]]) / 1.2e-6), ("core", "heater"), ("core", "heater")
    )  # fmt: skip
    run = coupled.simulate(
        RING, two, power=0.5e-3, duration=40e-6, heaters={"heater": th.Pulse(8e-3, 30e-6)}, heated="core", read="core"
    )
    cut = coupled.pulsing(run.isel(time=run["time"].values < 28e-6))
    assert cut.regime == "stable"
    assert "as far as the trace alone tells" in cut.reason


def test_when_an_input_changes():
    """Jumps, ramps and constants; pauses shorter than a fiftieth of the run are not kept."""

    def seen(value):
        return changes(pieces("power", value, 0.0, 10e-6))

    assert seen(1e-3) == seen(th.Constant(1e-3)) == seen([1e-3, th.Constant(0.0)]) == []
    assert seen(th.Pulse(1e-3, 1e-6, 2e-6)) == [[2e-6, 2e-6], [3e-6, 3e-6]]
    assert seen(th.Sampled([0, 4e-6, 6e-6, 10e-6], [0, 0, 1e-3, 1e-3])) == [[4e-6, 6e-6]]
    assert seen(th.SquareWave(1e-3, 1e-7, 0.5)) == [[5e-8, 9.95e-6]]


def test_rows_that_vary_count_whatever_the_attribute_says():
    run = coupled.simulate(RING, HEAT, power=SQUARE, duration=10e-6)
    assert coupled.pulsing(run.assign_attrs({ATTRIBUTE: "{}"})).regime == "driven"
