"""Resistances of heaters in geometry files, against published ones, and the data sheet that follows from them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from commands import thermofem
from sections import says

import thermofem as th
from thermofem.geometry import CrossSection

RING = th.heated_ring()


def straight(length, resistivity, width, height):
    """A heater over a straight guide."""
    heater = th.geometry.Part("heater", "TiN", x=0.0, width=width, bottom=2.22e-6, height=height, heated=True)
    guide = th.straight_guide(length=length)
    section = CrossSection(**{**vars_of(guide), "parts": (*guide.parts, heater)})
    return section.with_({"material.TiN.resistivity": resistivity})


def vars_of(section):
    return {name: getattr(section, name) for name in CrossSection.__dataclass_fields__}


def test_the_published_resistance_of_an_arc(validated):
    """TiN of 2.3e6 S/m, 30.4 um long, 2 um x 140 nm: 45.9145 ohm (0.229573 V at 5 mA) with contacts, in 3-D; 4 %."""
    found = straight(30.4e-6, 1 / 2.3e6, 2e-6, 140e-9).resistor("heater")
    solid = {"unit": "ohm", "source": "published 3-D calculation of 0.229573 V at 5 mA"}
    validated("Heaters", "TiN arc of 30.4 um with contacts", found.resistance, 0.229573 / 5e-3, rel=0.04, **solid)
    assert found.resistance == pytest.approx(47.2, rel=1e-3)  # three digits of the plain arc
    assert "L = 30.4 um" in found.origin


def test_the_resistance_per_length_of_a_public_design_kit(validated):
    """0.375 ohm/um: 120 ohm at 320 um."""
    section = straight(320e-6, 0.375e6 * 2e-6 * 100e-9, 2e-6, 100e-9)
    kit = {"unit": "ohm", "source": "public design kit, 0.375 ohm/um"}
    validated("Heaters", "TiN strip of 320 um", section.resistor("heater").resistance, 120.0, rel=1e-9, **kit)


def test_a_ring_is_as_long_as_its_mean_circumference():
    """rho over the cross-section, integrated along concentric filaments in series: 2 pi r, r the mean of both radii."""
    section = RING.with_({"material.TiN.resistivity": "1e-6 ohm*m"})
    part = next(part for part in section.parts if part.name == "heater")
    area = (part.outer_radius - part.inner_radius) * part.height
    radii = np.linspace(part.inner_radius, part.outer_radius, 1001)
    expected = 1e-6 * np.trapezoid(2 * np.pi * radii, radii) / (radii[-1] - radii[0]) / area
    assert section.resistor("heater").resistance == pytest.approx(expected, rel=1e-9)


def test_a_racetrack_has_the_straights_and_the_radius_of_the_heater_itself():
    """2 pi R + 2 straight, R that of a heater beside the core; the origin says which L."""
    outside = {"part.heater.inner_radius": 9e-6, "part.heater.outer_radius": 11e-6}
    section = RING.with_({**outside, "material.TiN.resistivity": "1e-6 ohm*m"})
    part = next(part for part in section.parts if part.name == "heater")
    area = 2e-6 * part.height
    circle = section.resistor("heater")
    assert circle.resistance == pytest.approx(1e-6 * 2 * np.pi * 10e-6 / area, rel=1e-9)
    assert "L = 62.8319 um = 2 pi x 10 um, at its own mean radius" in circle.origin
    racetrack = replace(section, straight=8e-6).resistor("heater")
    assert racetrack.resistance == pytest.approx(1e-6 * (2 * np.pi * 10e-6 + 16e-6) / area, rel=1e-9)
    assert "2 pi x 10 um + 2 x 8 um" in racetrack.origin


def test_a_geometry_file_keeps_resistances():
    given = RING.with_({"part.heater.resistance": "0.12 kohm", "part.heater.tcr": "1.5e-3 1/K"})
    assert 'resistance = "120 ohm"' in given.to_toml()
    assert CrossSection.from_toml_text(given.to_toml()) == given
    assert given.resistor("heater") == th.geometry.resistor.Resistor(120.0, 1.5e-3, "given")
    # the contact of a part keeps its own unit under the same key
    both = CrossSection.from_toml_text(
        given.to_toml() + '\n[[interface]]\npart = "core"\nresistance = "1e-8 m^2*K/W"\n'
    )
    assert both.interfaces[0].resistance == 1e-8
    assert CrossSection.from_toml_text(both.to_toml()) == both
    assert both.with_({"interface.core.resistance": 2e-8}).interfaces[0].resistance == 2e-8


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (
            {"part.heater.resistance": "120 ohm", "material.TiN.resistivity": "1e-6 ohm*m"},
            ("'heater' has a resistance", "TiN a resistivity", "one of the two"),
        ),
        ({"part.heater.tcr": "1e-3 1/K"}, ("'heater' has a tcr", "no resistance")),
        ({"part.heater.resistance": "-1 ohm"}, ("part 'heater': resistance", "-1")),
        ({"part.heater.resistance": "120 W"}, ("resistance", "ohm")),
        ({"part.heater.resistance": "120 ohm", "part.heater.tcr": "1.5 1/K"}, ("part 'heater': tcr", "1.5")),
        ({"material.TiN.resistivity": "1e6 ohm*m"}, ("material 'TiN': resistivity", "1000000")),
    ],
)
def test_bad_resistances_are_named_in_one_line(values, words):
    with pytest.raises(th.InputError) as error:
        RING.with_(values)
    says(error, *words)


def test_a_heater_without_resistance_is_named():
    with pytest.raises(th.InputError) as error:
        RING.resistor("heater")
    says(error, "'heater' has no resistance", "TiN no resistivity", "120 ohm")


def test_the_data_sheet_of_a_straight_shifter():
    """P(2 pi) = lambda/(L dn_eff/dT R), with dn_eff/dT by two further modes whose materials are 10 K warmer.

    1e-3: the index laws are linear in 10 K of 1.9e-4/K each, whose square is 1e-5 of the difference; alpha n_g is
    dn_eff/dT up to the error of the mode, 1e-4.
    """
    length = 300e-6
    wavelength = 1.55e-6
    values = {"light.wavelength": wavelength, "part.heater.resistance": 500.0, "part.heater.tcr": 2e-3}
    section = straight(length, "1e-6 ohm*m", 2e-6, 100e-9)
    section = CrossSection(**{**vars_of(section), "materials": ()}).with_(values)
    heat = th.assemble(section, accuracy=1e-2)
    sheet = heat.heater_sheet("heater")

    def index(kelvin):
        moved = {}
        for name in ("Si", "SiO2"):
            material = section.material_of("core" if name == "Si" else "box")
            n = float(material.index.index(wavelength))
            moved[f"material.{name}.index"] = n + kelvin * material.thermo_optic
        return th.light(section.with_(moved), wavelength=wavelength).mode("TE0").n_eff

    slope = (index(10.0) - index(0.0)) / 10.0
    expected = wavelength / (length * slope * sheet["thermal_resistance"])
    assert sheet["fsr_power"] == pytest.approx(expected, rel=1e-3)
    assert sheet["pi_power"] == pytest.approx(sheet["fsr_power"] / 2, rel=1e-12, abs=0)
    rise = sheet["fsr_power"] * heat.thermal_resistance("heater")
    hot = 500.0 * (1 + 2e-3 * rise)
    assert sheet["fsr_voltage"] / sheet["fsr_current"] == pytest.approx(hot, rel=1e-9)
    assert sheet["fsr_voltage"] * sheet["fsr_current"] == pytest.approx(sheet["fsr_power"], rel=1e-12, abs=0)
    # the same as the read-out in time takes it: lambda alpha per kelvin of the mode
    mode = heat.lit.light
    assert sheet["shift_per_kelvin"] == pytest.approx(wavelength / mode.n_g * slope, rel=1e-3, abs=0)


def test_a_tcr_that_makes_the_resistance_of_a_data_sheet_negative_is_named():
    """-2 % per kelvin: R is negative from 50 K on, and pi takes 19 mW, about 300 K."""
    values = {"light.wavelength": "1.55 um", "part.heater.resistance": "120 ohm", "part.heater.tcr": "-0.02 1/K"}
    with pytest.raises(th.InputError) as error:
        th.assemble(RING.with_(values), accuracy=5e-2).heater_sheet()
    says(error, "resistance of 'heater'", "tcr = -0.02 1/K")


def test_commands_print_the_data_sheet(tmp_path):
    section = RING.with_({"light.wavelength": "1.55 um", "light.loss": "2 dB/cm", "part.heater.resistance": "120 ohm"})
    (tmp_path / "ring.toml").write_text(section.to_toml())
    expected = th.assemble(section, accuracy=1e-2).heater_sheet()
    done = thermofem("solve", "ring.toml", "--accuracy", "1e-2", "--heated", "heater", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["heaters"]["heater"]
    assert found == pytest.approx(expected, rel=1e-9)
    done = thermofem("show", "ring.toml", cwd=tmp_path)
    assert "heater: 120 ohm (given)" in done.stdout
    # the mesh of show is finer: 1 % of it
    power = float(done.stdout.split("heater, pi: ")[1].split(" mW")[0])
    assert power == pytest.approx(expected["pi_power"] * 1e3, rel=1e-2)
    assert "mW/FSR" in done.stdout
    done = thermofem("ring", "ring.toml", "--coupling", "0.05", "-o", "optics.toml", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    # the mode of ring is that of a finer mesh, too
    assert json.loads(done.stdout)["heaters"]["heater"] == pytest.approx(expected, rel=1e-2)
