"""The output "light" of a family: members against finite elements of their own geometry, at widths not in training.

Silicon under a polymer with dn/dT < 0, where light sees three times the rise of the core at 1 ns, and K falls by a
quarter over the box.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import stats
from sections import COVERED, LIGHT

import coupled
import surrogate
import thermofem as th
from coupled.ring_family import MovingRing, SettledPeriod, ring_at
from surrogate.family import members

pytestmark = pytest.mark.slow

CAMPAIGN = """
geometry = "covered.toml"
[[vary]]
name = "width"
path = "part.core.width"
from = "346 nm"
to = "372 nm"
"""
TIMES = np.geomspace(1e-9, 1e-3, 61)
WIDTHS = (350e-9, 357e-9, 368e-9)
POWER = 1e-2  # W


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    folder = tmp_path_factory.mktemp("covered")
    (folder / "covered.toml").write_text(COVERED + LIGHT)
    (folder / "rings.toml").write_text(CAMPAIGN)
    return surrogate.train_family(folder / "rings.toml", 2e-3).save(folder / "family.npz")


@pytest.fixture(scope="module")
def family(path):
    return surrogate.load_family(path)


def geometry(width):
    return th.CrossSection.from_toml_text(COVERED + LIGHT).with_({"part.core.width": width})


@pytest.mark.parametrize("width", WIDTHS)
def test_the_light_of_a_member_is_that_of_its_geometry(family, width):
    own = surrogate.reduce(th.assemble(geometry(width), accuracy=2e-4).system, tolerance=1e-5).model
    step = own.channel("core", "light").step_response(TIMES)
    off = np.abs(family.step_response(TIMES, read="light", width=width) - step).max() / step[-1]
    assert family.error < 2e-3
    # the error of the family on members it has not seen, half as much again as their meshes differ; and the mode here,
    # 7e-4 of a coarser mesh
    assert off < 1.5 * family.error + 7e-4
    assert family.thermal_resistance(read="light", width=width) == pytest.approx(step[-1], rel=2 * family.error)
    assert off < 0.1 * np.abs(own.channel("core", "core").step_response(TIMES) - step).max() / step[-1]
    assert family.certify(width=width).error < 2 * family.error


def test_the_period_of_a_made_ring_is_that_of_its_geometry(family, caplog):
    """The mean over the core would give 3.8 us for 0.26 us at 350 nm."""
    section = geometry(350e-9)
    ring = coupled.ring_from(section, coupling=0.05).ring
    heat = surrogate.reduce(th.assemble(section).system, tolerance=1e-4)
    expected = coupled.limit_cycle(ring, heat, power=POWER).attrs["period"]
    caplog.clear()
    for model in (family.model(width=350e-9), family.reduced(read="light", width=350e-9)):
        cycle = coupled.limit_cycle(ring, model, power=POWER)
        # the period moves by about as much as the steps of the light
        assert cycle.attrs["period"] == pytest.approx(expected, rel=2 * family.error)
        assert cycle.attrs["read"] == "light"
        assert "warning" not in cycle.attrs
    run = coupled.simulate(ring, family.model(width=357e-9), power=POWER, duration=10e-6)
    assert coupled.pulsing(run).regime == "self-pulsing"
    assert "warning" not in run.attrs
    assert not caplog.records
    wrong = coupled.limit_cycle(ring, family.model(read="core", width=350e-9), power=POWER)
    assert "reads the temperature 'light'" in wrong.attrs["warning"]
    assert wrong.attrs["period"] > 10 * expected


def test_studies_of_a_made_ring_read_the_light(family, caplog):
    ring = ring_at(family, {"width": 357e-9}, coupling=0.05)
    optics = MovingRing(family, ring)
    settled = SettledPeriod(ring, POWER)
    spread = {"width": stats.norm(360e-9, 1e-9)}
    found = surrogate.uncertainty(family, spread, settled, optics=optics, samples=4, interpolate=12)
    assert found.attrs["read"] == "core, light"
    chosen = surrogate.uncertainty(family, spread, settled, optics=optics, samples=4, interpolate=12, read="light")
    assert chosen.attrs["mean"] == pytest.approx(found.attrs["mean"], rel=1e-9)
    target = {settled: 320e-9}
    designed = surrogate.design(family, target=target, optics=optics)
    assert designed.reached
    assert "core to core, light" in designed.message
    assert not [record for record in caplog.records if "temperature" in record.message]
    assert surrogate.uncertainty(family, spread, "thermal_resistance", samples=4).attrs["read"] == "core"


def test_a_model_file_of_a_member_keeps_both_outputs(family, tmp_path):
    member = family.model(width=357e-9)
    saved = surrogate.load_model(surrogate.save_model(member, tmp_path / "member.json"))
    assert saved.outputs == ("core", "light")
    light = saved.channel("core", "light").step_response(TIMES)
    np.testing.assert_allclose(light, family.step_response(TIMES, read="light", width=357e-9), rtol=1e-9)
    np.testing.assert_allclose(
        member.step_response(TIMES), saved.channel("core", "core").step_response(TIMES), rtol=1e-6
    )


def test_outputs_without_weights_of_the_light_are_refused(path, tmp_path):
    """A file whose outputs name the light, and whose members lack it, is not complete; nor is one the other way."""
    arrays = members.unpack(path.read_bytes())
    header = json.loads(str(arrays.pop("header")))
    for parts in ({"outputs": ["core"]}, {"members": {**header["family"]["members"], "light": None}}):
        damaged = {**header, "family": header["family"] | parts}
        (tmp_path / "lacking.npz").write_bytes(members.pack(arrays | {"header": np.array(json.dumps(damaged))}))
        with pytest.raises(th.InputError, match="not a complete family"):
            surrogate.load_family(tmp_path / "lacking.npz")
