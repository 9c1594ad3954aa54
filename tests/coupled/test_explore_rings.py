"""The page knows a published ring by its numbers: names promise nothing."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

import coupled
import surrogate
import thermofem as th
from coupled.explore.contents import RESISTANCE, published, same_numbers, window_of
from coupled.resonator import PUBLISHED
from thermofem_cli.inputs.command_files import ring_of

MODEL = th.Foster(R=[2e3, 2e3], tau=[1e-7, 15e-6])  # has no folds of cycles, which a page takes seconds for
LOSSY = replace(coupled.borghi2021(), loss_rate=9e9).with_lumped_fcd()  # bears the name of the published ring
EXPERIMENT = surrogate.second_order(**asdict(coupled.parameters.SECOND_ORDER_EXPERIMENT))
NAMES = ["Borghi 2021", "Borghi 2021, lumped FCD", "Van Vaerenbergh 2012"]


def data_of(ring, models):
    """What the page of a ring holds."""
    text = coupled.explore(ring, models).html
    return json.loads(text.split('id="data">')[1].split("</script>")[0])


def ring_at(place, data):
    """The name of the published ring that stands at a place of the page, or None."""
    found = data["rings"][place["ring"]]
    return next((ring.name for ring, _ in published() if same_numbers(asdict(ring), found)), None)


def test_a_changed_ring_under_a_published_name_is_a_ring_of_its_own():
    data = data_of(LOSSY, {"m": MODEL})
    first = data["rings"][0]
    assert first["loss_rate"] == 9e9
    assert first["name"] == data["title"] == "Borghi 2021, lumped FCD (changed)"
    assert [ring["name"] for ring in data["rings"][1:]] == NAMES


@pytest.mark.parametrize("quality", [2e4, 2e6])
def test_the_plane_of_a_ring_shows_where_it_begins_to_pulse(quality):
    """The threshold is that of the curve on a wide plane: -6.8 dBm at 5.3 GHz, and -34.6 dBm at 0.23 GHz."""
    ring = _of_quality(quality)
    curves = coupled.hopf_curves(ring, EXPERIMENT, [1e-8, 1.0], [-20e9, 20e9])
    leading = [curve.isel(point=curve["leading"].values) for curve in curves]
    level, detuning = min((point for curve in leading for point in _points(curve)), default=None)
    window = data_of(ring, {"m": EXPERIMENT})["rings"][0]["window"]
    assert window["power"][0] < level - 3 < level < window["power"][1]
    assert window["detuning"][0] < 0 < detuning < window["detuning"][1]


def _of_quality(quality):
    """The ring of the paper with its coupling and its loss scaled to a loaded Q."""
    paper = coupled.borghi2021()
    share = paper.omega / (2 * quality) / paper.linear_rate
    return replace(paper, bus_rate=share * paper.bus_rate, loss_rate=share * paper.loss_rate)


def _points(curve):
    """Powers in dBm and detunings in GHz of a curve."""
    return zip(10 * np.log10(curve["power"].values / 1e-3), curve["detuning"].values / 1e9, strict=True)


def test_a_ring_without_a_hopf_curve_has_the_plane_of_its_widths():
    ring = _of_quality(2e3)
    window = data_of(ring, {"m": EXPERIMENT})["rings"][0]["window"]
    assert window == {name: list(ends) for name, ends in window_of(ring, EXPERIMENT.thermal_resistance).items()}


@pytest.mark.parametrize("ring", [ring for ring, _ in published()], ids=lambda ring: ring.name)
def test_a_published_ring_under_another_name_is_that_ring(ring):
    data = data_of(replace(ring, name="mine"), {"m": MODEL})
    others = [name for name in NAMES if name != ring.name]
    assert [one["name"] for one in data["rings"]] == ["mine", *others]
    window = {one.name: window for one, window in published()}[ring.name]
    assert data["rings"][0]["window"] == {name: list(ends) for name, ends in window.items()}
    low, high = window["power"]
    assert data["start"]["power"] == min(8, high) >= low  # the laser stands at 8 dBm, or at the end of the plane
    assert {ring_at(preset["state"], data) for preset in data["presets"][1:]} == set(NAMES)


def test_one_function_makes_a_ring_known_to_commands_and_to_the_page(monkeypatch):
    mine = replace(coupled.borghi2021(), name="Mine 2030", lumped_fcd=None)
    monkeypatch.setitem(PUBLISHED, "mine2030", lambda: mine)
    assert ring_of("mine2030") is mine
    assert (mine, window_of(mine, RESISTANCE)) in published()


def test_the_last_digit_of_a_ring_file_is_no_other_ring():
    """The page writes a temperature for kT; read back, kT may differ in its last digit."""
    ring = coupled.borghi2021()
    carriers = replace(ring.carriers, thermal_energy=ring.carriers.thermal_energy * (1 + 3e-16))
    assert carriers != ring.carriers
    assert [one["name"] for one in data_of(replace(ring, carriers=carriers), {"m": MODEL})["rings"]] == NAMES
