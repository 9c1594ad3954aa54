"""[plan] straight in a geometry file: racetracks against circles, the FEM, and formulas of the perimeter."""

import json
import math
from dataclasses import replace

import commands
import numpy as np
import pytest

import coupled
import surrogate
import thermofem as th
from surrogate.reduction.racetrack_reduction import racetrack_sheets, reduce_racetrack

LIGHT = th.geometry.Guide(part="core", wavelength=1.55e-6)
PAPER = replace(th.strip_ring(radius=7e-6), straight=3e-6, light=LIGHT)  # Borghi et al. 2021: 7 um and 3 um
PERIMETER = 2 * math.pi * 7e-6 + 2 * 3e-6


@pytest.fixture(scope="module")
def paper():
    return reduce_racetrack(PAPER)


def test_without_straights_it_is_the_circle():
    """Of straights of 1 nm: R_th and the temperature of the light, against the axisymmetric FEM."""
    circle = th.assemble(replace(th.strip_ring(outer_radius=90e-6), light=LIGHT), 1e-4)
    exact = [circle.thermal_resistance("core"), circle.thermal_resistance("core", "light")]
    nearly = reduce_racetrack(replace(th.strip_ring(), straight=1e-9, light=LIGHT))
    assert nearly.outputs == ("core", "light")
    # 1e-3: the mesh of the section has 2e-4 of R_th, the bend 4e-4 (measured), the poles 1e-4 of R_th
    np.testing.assert_allclose(nearly.gain[:, 0], exact, rtol=1e-3)
    # 2e-4: the bend shifts the mode in the core, and both meshes have 1e-4
    ratio = nearly.gain[1, 0] / nearly.gain[0, 0]
    assert ratio == pytest.approx(exact[1] / exact[0], abs=2e-4)
    assert ratio < 1 - 5e-4  # the light sees another temperature than the core's mean


def test_the_ring_of_the_paper_over_the_circle_of_its_length(paper):
    circle = th.racetrack("ring", th.straight_guide(), radius=PERIMETER / (2 * math.pi), straight=0.0)
    equal = surrogate.reduce_layout([circle]).model.gain[0, 0]
    # 1.0010: a computation of the path by another Green function; 2e-4 for the smoothing and the sums of either
    assert paper.gain[0, 0] / equal == pytest.approx(1.0010, abs=2e-4)


def test_a_ring_file_has_the_perimeter():
    """Rates and volumes by L = 2 pi R + 2 straight, with n_g and the area of the mode in the bends."""
    given = {"loss": 161.0, "coupling": 0.05}
    racetrack = coupled.ring_from(PAPER, **given)
    bends = coupled.ring_from(replace(PAPER, straight=0.0), **given)
    longer = PERIMETER / (2 * math.pi * 7e-6)
    ring = racetrack.ring
    rate = -3e8 / ring.group_index / (2 * PERIMETER) * math.log(1 - 0.05)
    # 1e-3: c = 3e8
    assert ring.bus_rate == pytest.approx(rate, rel=1e-3)
    assert ring.tpa_volume / bends.ring.tpa_volume == pytest.approx(longer, rel=1e-9)
    assert ring.loss_rate == pytest.approx(bends.ring.loss_rate, rel=1e-9)
    # a resonance within half of the free spectral range c/(n_g L)
    spacing = 3e8 / ring.group_index / PERIMETER
    assert abs(ring.frequency - 299792458 / 1.55e-6) < 0.501 * spacing
    turns = racetrack.mode.n_eff * PERIMETER / 1.55e-6
    assert f"order {round(turns)}" in racetrack.origins["frequency"].origin
    assert PAPER.volumes()["core"] == pytest.approx(450e-9 * 220e-9 * PERIMETER, rel=1e-9, abs=0)


def test_coupling_along_the_straight_of_a_racetrack():
    """As a bus with that straight section beside a circle whose bends have the same radius."""
    own = replace(PAPER, buses=(th.geometry.Bus("bus", 250e-9),))
    circle = th.strip_ring(radius=7e-6 + 3e-6 / math.pi)
    made = coupled.ring_from(own, loss=161.0).derivatives(["bus.bus.gap"])
    known = coupled.ring_from(circle, wavelength=1.55e-6, loss=161.0, gap=250e-9, straight=3e-6, buses=1)
    rate = coupled.ring_from(own, loss=161.0).ring.bus_rate
    # 1 %: the modes of bends of 7 and 7.955 um, whose tails fall alike
    assert rate == pytest.approx(known.ring.bus_rate, rel=0.01)
    assert float(made.bus_rate[0]) < 0
    with pytest.raises(th.InputError, match="has no derivative: the bus of a racetrack runs along it"):
        coupled.ring_from(own, loss=161.0).derivatives(["bus.bus.straight"])
    other = replace(PAPER, buses=(th.geometry.Bus("bus", 250e-9, straight=2e-6),))
    with pytest.raises(th.InputError, match=r"\[plan\] has 3e-06 m"):
        coupled.ring_from(other, loss=161.0)


def test_a_heater_follows_the_racetrack():
    """Heat of the heater in the ring is between that of a circle of the bends and that of the equal circle, as 1/L."""
    small, equal = (
        th.assemble(th.heated_ring(radius=radius).with_(outer_radius=90e-6)).thermal_resistance("heater", "core")
        for radius in (7e-6, PERIMETER / (2 * math.pi))
    )
    made = reduce_racetrack(replace(th.heated_ring(radius=7e-6), straight=3e-6))
    gain = made.gain[0, 1]
    assert equal < gain * 1.01 < small
    # 1 %: 1e-3 of the shape, the error of the mesh, and the bends of a wide heater (bound 0.5 %)
    assert gain == pytest.approx(equal, rel=0.01)


def test_files_and_refusals(tmp_path):
    assert th.CrossSection.from_toml_text(PAPER.to_toml()) == PAPER
    assert PAPER.with_({"plan.straight": "5 um"}).straight == pytest.approx(5e-6)
    path = tmp_path / "ring.toml"
    path.write_text(PAPER.to_toml())
    (shape,) = th.read_layout(path)
    assert shape.length == pytest.approx(PERIMETER, rel=1e-4)
    with pytest.raises(th.InputError, match="is a racetrack"):
        th.assemble(PAPER)
    with pytest.raises(th.InputError, match="disc"):
        replace(th.disc(), straight=1e-6)
    with pytest.raises(th.InputError, match="belongs to a ring"):
        replace(th.straight_guide(), straight=1e-6)
    with pytest.raises(th.InputError, match="below 3e-06 m"):
        reduce_racetrack(replace(th.strip_ring(radius=2e-6), straight=3e-6))


@pytest.mark.parametrize("command", ["cosimulate", "validate", "noise"])
def test_commands_that_solve_circles_refuse_it_in_one_line(command, tmp_path):
    (tmp_path / "ring.toml").write_text(PAPER.to_toml())
    run = commands.thermofem(command, "ring.toml", cwd=tmp_path)
    assert run.returncode
    errors = [line for line in run.stderr.splitlines() if "error" in line]
    assert len(errors) == 1
    assert "is a racetrack" in errors[0]
    assert "thermofem reduce" in errors[0]


def test_solve_follows(tmp_path, paper):
    """Mean of the core and the temperature of the light, as the model of the racetrack has them."""
    (tmp_path / "ring.toml").write_text(PAPER.to_toml())
    options = "--read", "core, light", "--power", "2 mW", "--duration", "20 us", "--samples", "11", "-o", "heat.nc"
    done = commands.thermofem("solve", "ring.toml", *options, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "R_th of core = 7.8" in done.stdout
    data = th.load(tmp_path / "heat.nc")
    for name in ("core", "light"):
        rise = 2e-3 * paper.channel(read=name).step_response(data["time"].values)
        # one model, by two routes: the step of a StateSpace has rtol = 1e-5
        np.testing.assert_allclose(data["delta_T"].sel(probe=name), rise, rtol=1e-5, atol=1e-12)
    periodic = "--square", "1 us", "--periodic", "--samples", "50", "-o", "period.nc"
    assert commands.thermofem("solve", "ring.toml", *periodic, cwd=tmp_path).returncode == 0
    drop = th.load(tmp_path / "period.nc")["delta_T"].values
    assert drop[0] == pytest.approx(drop[-1], rel=1e-9)
    two = commands.thermofem("solve", "ring.toml", "--heated", "core, box", cwd=tmp_path)
    assert (two.returncode, "one part of a racetrack" in two.stderr) == (2, True)


def test_show_and_ring_print_the_data_sheet_of_a_racetrack(tmp_path):
    """P(2 pi) = FSR/(f alpha R) with FSR = c/(n_g L), L the perimeter; rho L/(w h) of the heater along it."""
    values = {"material.TiN.resistivity": "1e-6 ohm*m", "light.wavelength": "1.55 um", "light.loss": "2 dB/cm"}
    section = replace(th.heated_ring(radius=7e-6), straight=3e-6).with_(values)
    (tmp_path / "ring.toml").write_text(section.to_toml())
    done = commands.thermofem("show", "ring.toml", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    sheet = json.loads(done.stdout)["heaters"]["heater"]
    mode = th.light(section).mode()
    spacing = 299792458 / (mode.n_g * PERIMETER)
    gain = reduce_racetrack(section).channel("heater", "light").thermal_resistance
    assert sheet["fsr_power"] == pytest.approx(spacing * 1.55e-6 / 299792458 / mode.thermo_optic / gain, rel=1e-6)
    part = next(part for part in section.parts if part.name == "heater")
    area = (part.outer_radius - part.inner_radius) * part.height
    assert sheet["resistance"] == pytest.approx(1e-6 * PERIMETER / area, rel=1e-9)
    ring = commands.thermofem("ring", "ring.toml", "--coupling", "0.05", "-o", "optics.toml", "--json", cwd=tmp_path)
    assert ring.returncode == 0, ring.stderr
    # th.light and ring_from solve for the mode alike
    assert json.loads(ring.stdout)["heaters"]["heater"] == pytest.approx(sheet, rel=1e-6)


def test_the_data_sheet_of_a_racetrack_is_that_of_the_mode_asked_for(caplog):
    """TM0 of a file whose [light] is TE: the rise where TM0 runs. Without heat in the core there is no such rise."""
    heated = replace(th.heated_ring(radius=7e-6), straight=3e-6)
    section = replace(heated, light=LIGHT)
    vertical = replace(heated, light=replace(LIGHT, polarisation="TM"))
    sheet = racetrack_sheets(section, th.light(section).mode("TM0"))["heater"]
    gain = reduce_racetrack(vertical).channel("heater", "light").thermal_resistance
    # 1e-6: the same computation; TE0 sees another rise by 3e-4
    assert sheet["thermal_resistance"] == pytest.approx(gain, rel=1e-6)
    core, heater = section.parts
    wide = replace(section, parts=(replace(core, inner_radius=6.5e-6, outer_radius=7.5e-6), heater))
    assert racetrack_sheets(wide, th.light(wide).mode("TE1")) == {}
    assert "no data sheet of heaters: the light is TE1" in caplog.text
    lower = replace(heater, name="lower", bottom=heater.bottom - 0.5e-6)
    dark = replace(section, parts=(replace(core, heated=False), heater, lower))
    assert racetrack_sheets(dark) == {}
    assert "no data sheet of heaters: the light is read beside the heat of 'core'" in caplog.text


def test_reduce_ring_and_simulate_follow(tmp_path, paper):
    (tmp_path / "ring.toml").write_text(PAPER.to_toml())
    made = commands.thermofem("reduce", "ring.toml", "-o", "model.json", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    assert "49.982 um" in made.stdout
    model = surrogate.load_model(tmp_path / "model.json")
    np.testing.assert_allclose(model.gain, paper.gain, rtol=1e-9)
    ring = commands.thermofem("ring", "ring.toml", "--coupling", "0.05", "-o", "optics.toml", cwd=tmp_path)
    assert ring.returncode == 0, ring.stderr
    run = commands.thermofem(
        "simulate", "model.json", "--ring", "optics.toml", "--duration", "100 ns", "-o", "run.nc", cwd=tmp_path
    )
    assert run.returncode == 0, run.stderr
    assert "warning" not in run.stderr
