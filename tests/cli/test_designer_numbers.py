"""Numbers that a designer looks for: rise times, cross resistances, thresholds, pm/K, arrays, the card of a ring."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from commands import thermofem
from scipy.constants import c

import coupled
import surrogate
import thermofem as th

MODEL = th.Foster(R=[5e3], tau=[1e-6])


def numbers(*arguments, cwd):
    done = thermofem(*arguments, "--json", cwd=cwd)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_a_heater_and_the_core_in_solve_and_reduce(tmp_path):
    section = th.heated_ring()
    (tmp_path / "ring.toml").write_text(section.to_toml())
    heat = th.assemble(section, 1e-2)
    cross = heat.thermal_resistance("heater", "core")
    common = "ring.toml", "--accuracy", "1e-2"
    solved = numbers("solve", *common, "--heated", "heater", "--read", "core", cwd=tmp_path)
    assert solved["thermal_resistance"] == pytest.approx(cross, rel=1e-9)
    both = numbers("solve", *common, "--heated", "heater", "--read", "core", "--read", "heater", cwd=tmp_path)
    assert both["thermal_resistances"]["core"] == pytest.approx(cross, rel=1e-9)
    reduced = numbers("reduce", *common, "--heated", "core, heater", cwd=tmp_path)
    assert reduced["thermal_resistance"][0][1] == pytest.approx(cross, rel=1e-3)
    # 800 steps of 50 ns in 15 us, and the tolerance of the reduction
    assert reduced["rise_time"][0][1] == pytest.approx(solved["rise_time"]["core"], rel=5e-3)


def test_parts_that_share_a_power_heat_by_the_mean_of_their_channels(tmp_path):
    """Superposition: half of the power in each of two parts makes half of the sum of both rises."""
    section = th.heated_ring()
    (tmp_path / "ring.toml").write_text(section.to_toml())
    heat = th.assemble(section, 1e-2)
    channels = [heat.thermal_resistance(part, "core") for part in ("core", "heater")]
    common = "solve", "ring.toml", "--accuracy", "1e-2", "--power", "10 mW", "--duration", "400 us"
    shared = numbers(*common, "--heated", "core, heater", "--read", "core", cwd=tmp_path)
    assert shared["thermal_resistance"] == pytest.approx(sum(channels) / 2, rel=1e-12)
    assert shared["steady_rise"]["core"] == pytest.approx(10e-3 * sum(channels) / 2, rel=1e-12)
    rise = th.load(tmp_path / "heat.nc").delta_T.values
    alone = [th.solve(heat, th.Constant(5e-3), [5e-6, 50e-6], heated=part, read="core") for part in ("core", "heater")]
    # 400 us in 800 steps: 5 and 50 us are rows; each transient is within its rtol = 1e-4
    np.testing.assert_allclose(rise[[10, 100]], alone[0].delta_T + alone[1].delta_T, rtol=4e-4)
    several = thermofem(*common, cwd=tmp_path)
    assert "core alone carries the power" in several.stderr


def test_the_steady_rise_of_warm_silicon_is_that_at_its_power(tmp_path):
    """The linear problem takes 104 % of the settled rise for what is still to come."""
    laws = [replace(th.materials.find(f"{name}(T)"), name=name) for name in ("Si", "SiO2")]
    section = replace(th.strip_ring(), materials=tuple(laws))
    (tmp_path / "warm.toml").write_text(section.to_toml())
    arguments = "solve", "warm.toml", "--accuracy", "1e-2", "--power", "10 mW", "--duration", "300 us"
    done = thermofem(*arguments, "--samples", "301", cwd=tmp_path)
    assert "of the steady rise" not in done.stdout
    assert "rise 10-90 %" in done.stdout
    heat = th.assemble(section, 1e-2)
    settled = numbers(*arguments, "--samples", "301", cwd=tmp_path)["steady_rise"]["core"]
    assert settled == pytest.approx(heat.steady_rise(10e-3), rel=1e-6)
    assert float(th.load(tmp_path / "heat.nc").delta_T[-1]) == pytest.approx(settled, rel=1e-3)
    assert abs(settled / (10e-3 * heat.thermal_resistance()) - 1) > 5e-3


def test_the_card_of_a_model_shows_every_pole(tmp_path):
    tau = np.geomspace(1e-9, 1e-4, 60)
    surrogate.save_model(th.Foster(R=np.full(60, 100.0), tau=tau), tmp_path / "m.json")
    assert thermofem("show", "m.json", cwd=tmp_path).stdout.count("pole :") == 60
    surrogate.save_model(MODEL, tmp_path / "one.json")
    card = numbers("show", "one.json", cwd=tmp_path)
    assert card["rise_times"] == pytest.approx([np.log(9) * 1e-6], rel=1e-6, abs=0)  # of one exponential


def test_the_card_of_a_ring(tmp_path):
    (tmp_path / "ring.toml").write_text('base = "borghi2021"\nloss_rate = "6e9 1/s"\n')
    ring = coupled.RingResonator.from_toml(tmp_path / "ring.toml")
    done = thermofem("show", "ring.toml", cwd=tmp_path)
    assert "loss rate : 6e+09 1/s" in done.stdout
    assert "frequency : 192.88 THz" in done.stdout
    card = numbers("show", "ring.toml", cwd=tmp_path)
    # d(lambda)/dT = lambda/n0 dn/dT
    expected = c / ring.frequency / ring.refractive_index * ring.thermo_optic
    assert card["shift_per_kelvin"] == pytest.approx(expected, rel=1e-3, abs=0)  # the paper's rounded rate


def test_thresholds_and_tuning_of_a_map(tmp_path):
    surrogate.save_model(MODEL, tmp_path / "m.json")
    found = numbers("stability", "m.json", "--power", "-5 dBm, 10 dBm", "--points", "16, 40", cwd=tmp_path)
    table = th.load(tmp_path / "stability.nc")
    ring = coupled.borghi2021()
    assert found["shift_per_watt"] == pytest.approx(
        c / ring.frequency * ring.thermal_shift / ring.omega * 5e3, rel=1e-6, abs=0
    )
    for regime, power in found["thresholds"].items():
        pulsing = (table["regime"] == regime).any("detuning")
        assert power == pytest.approx(float(table["power"][pulsing].min()))


def test_an_array_from_a_table_of_places(tmp_path):
    (tmp_path / "ring.toml").write_text(th.strip_ring(outer_radius=120e-6).opened().to_toml())
    (tmp_path / "rings.csv").write_text("x (um),y (um)\n0,0\n20,0\n")
    found = numbers("reduce", "ring.toml", "--positions", "rings.csv", cwd=tmp_path)
    # the example of surrogate.reduce_array
    assert np.round(np.array(found["thermal_resistance"]) / 1e3, 2).tolist() == [[7.89, 0.24], [0.24, 7.89]]
    assert len(surrogate.load_model(tmp_path / "model.json").inputs) == 2
    (tmp_path / "rings.csv").write_text("0,0\n20,0\n")
    done = thermofem("reduce", "ring.toml", "--positions", "rings.csv", cwd=tmp_path)
    assert (done.returncode, "has no unit" in done.stderr) == (2, True)
