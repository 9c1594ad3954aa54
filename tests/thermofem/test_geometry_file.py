"""The geometry file: TOML in and out, its laws of temperature, and errors that begin with the file."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from sections import HEATER, STRIP, says

from thermofem.checks import InputError
from thermofem.geometry import CrossSection, strip_ring
from thermofem.geometry.section_parts import INSULATED, ISOTHERMAL, OPEN, Boundary, Probe
from thermofem.materials import Polynomial, PowerLaw, Table
from thermofem.materials.material_library import LIBRARY, Material


def test_the_reference_strip_in_toml_is_strip_ring():
    geometry = CrossSection.from_toml_text(STRIP)
    assert replace(geometry, name="strip ring") == strip_ring()
    assert (geometry.bottom, geometry.top, geometry.outer) == (ISOTHERMAL, INSULATED, INSULATED)
    assert geometry.ambient == 293.15
    assert geometry.layer_edges == pytest.approx((-32e-6, -2e-6, 0.0, 2.22e-6), rel=1e-15, abs=0)
    assert (geometry.bottom_z, geometry.top_z) == (geometry.layer_edges[0], 2.22e-6)


def test_every_table_of_the_file_arrives():
    geometry = CrossSection.from_toml_text(HEATER)
    core, _, undercut = geometry.parts
    assert geometry.name == "ring with a heater over an undercut"
    assert (geometry.ambient, geometry.heated) == (293.15, ("core", "heater"))
    assert geometry.region_names == ("substrate", "box", "cladding", "core", "heater")  # no void
    assert core.sidewall_angle == pytest.approx(math.radians(80), rel=1e-15)
    assert (undercut.inner_radius, undercut.outer_radius, undercut.bottom) == (4e-6, 12e-6, -12e-6)
    assert geometry.interfaces[0].resistance == 1e-8
    assert geometry.probes == (Probe("near oxide", "core", 3e-7),)
    assert (geometry.bottom, geometry.top, geometry.outer) == (OPEN, Boundary("convection", 10.0), OPEN)
    oxide = geometry.material_of("box")
    assert (oxide.conductivity_law, oxide.conductivity) == (PowerLaw(0.2, 300.0), 1.2)
    assert geometry.material_of("heater") is LIBRARY["TiN"]
    with pytest.raises(InputError, match="region = 'coer' is unknown; did you mean 'core'"):
        geometry.material_of("coer")


def test_a_file_of_optics_is_called_that():
    with pytest.raises(InputError, match="optics of a ring; a geometry has outer_radius"):
        CrossSection.from_toml_text('name = "my ring"\nbase = "borghi2021"\n')


@pytest.mark.parametrize("geometry", [strip_ring(), CrossSection.from_toml_text(HEATER)], ids=["strip", "heater"])
def test_toml_round_trip(geometry, tmp_path):
    (tmp_path / "ring.toml").write_text(geometry.to_toml(), encoding="utf-8")
    again = CrossSection.from_toml(tmp_path / "ring.toml")
    assert again == geometry
    assert hash(again) == hash(geometry)
    assert again.to_toml() == geometry.to_toml()


def test_names_survive_toml_whatever_they_hold():
    geometry = replace(strip_ring(), name='a "ring" with \\ and\ttab, Ω and \x7f')
    assert CrossSection.from_toml_text(geometry.to_toml()) == geometry


def test_an_override_keeps_what_it_leaves_out_and_says_so():
    geometry = CrossSection.from_toml_text(STRIP + '[material.Si]\nconductivity = "60 W/m/K"\n')
    silicon = geometry.material_of("core")
    assert (silicon.conductivity, silicon.density, silicon.specific_heat) == (60, 2330, 700)
    assert "density, specific_heat: " + LIBRARY["Si"].source in silicon.source


BAD_FILES = [
    ("outer_radius", "outer_radios", ["the file: key = 'outer_radios' is unknown; did you mean 'outer_radius'"]),
    ('material = "Si"\nr', 'material = "Sl"\nr', ["part 'core': material = 'Sl' is unknown; did you mean 'Si'"]),
    ('"450 nm"', "0.45", ["part 'core': width = 0.45 has no unit", '"450 nm"']),
    ('"450 nm"', '"450 ns"', ["part 'core': width = '450 ns' has the wrong dimension; a length"]),
    ('"0 nm"', '"2.1 um"', ["part 'core'", "sticks out of the stack, which ends at z = 2.22e-06"]),
    (
        'width = "450 nm"\n',
        "",
        ["part 'core': give radius and width, or inner_radius and outer_radius (given: radius)"],
    ),
    ('height = "220 nm"\n', "", ["part 'core': height is missing"]),
    ("heated = true", 'heated = "yes"', ["part 'core': heated = 'yes' must be true or false"]),
    ("heated = true", "", ["no part is heated"]),
    ("heated = true", 'sidewall_angle = "10 deg"\nheated = true', ["sidewall_angle = 10", "deg"]),
    (", datum = true", "", ["0 layers have datum = true"]),
    ('"Si", thickness', '"void", thickness', ["layer 'substrate' is void"]),
    ('name = "core"', 'name = "box"', ["layers, parts and probes holds 'box' twice"]),
    ('name = "core"', 'name = "a/b"', ["part name = 'a/b' is not usable"]),
    ("[[part]]", "[[part]", ["not valid TOML", "line 8"]),
    ("[[part]]", '[boundary]\nbottom = "isotermal"\n[[part]]', ["boundary bottom = 'isotermal'", "'isothermal'"]),
    ("[[part]]", '[boundary]\nbottom = "insulated"\n[[part]]', ["all insulated", "no steady state"]),
    ("[[part]]", '[material.Si]\ndensity = "2330 kg"\n[[part]]', ["density = '2330 kg' has the wrong dimension"]),
    ("[[part]]", '[material.SiC]\ndensity = "3 g/cm^3"\n[[part]]', ["[material.SiC]: conductivity is missing"]),
    ("[[part]]", '[[interface]]\npart = "coer"\nresistance = "1e-8 m^2*K/W"\n[[part]]', ["did you mean 'core'"]),
]


@pytest.mark.parametrize(("old", "new", "words"), BAD_FILES, ids=[f"{k}" for k in range(len(BAD_FILES))])
def test_bad_files_are_refused_in_one_line_that_begins_with_the_file(old, new, words, tmp_path):
    assert old in STRIP
    path = tmp_path / "ring.toml"
    path.write_text(STRIP.replace(old, new, 1))
    with pytest.raises(InputError) as error:
        CrossSection.from_toml(path)
    says(error, str(path), *words)


def test_missing_unreadable_and_empty_files(tmp_path):
    with pytest.raises(InputError, match=r"ring\.toml' does not exist"):
        CrossSection.from_toml(tmp_path / "ring.toml")
    with pytest.raises(InputError, match="cannot be read"):
        CrossSection.from_toml(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="must be UTF-8"):
        CrossSection.from_toml(tmp_path / "binary.toml")
    with pytest.raises(InputError, match="outer_radius is missing"):
        CrossSection.from_toml_text("")
    with pytest.raises(InputError, match=r"add \[\[part\]\] tables"):
        CrossSection.from_toml_text(STRIP[: STRIP.index("[[part]]")])


LAWS = """
[material.Si]
conductivity = { value = "130 W/m/K", polynomial = [-3e-3, 5e-6], reference = "293.15 K" }
specific_heat = { temperature = ["200 K", "300 K", "400 K"], values = ["556 J/kg/K", "712 J/kg/K", "790 J/kg/K"] }
[material.SiO2]
conductivity = { r = "1.38 W/m/K", z = "1.1 W/m/K", exponent = 0.3 }
"""


def test_laws_in_toml():
    geometry = CrossSection.from_toml_text(STRIP + LAWS)
    silicon, oxide = geometry.material_of("core"), geometry.material_of("box")
    assert silicon.conductivity_law == Polynomial((-3e-3, 5e-6), 293.15)
    assert (silicon.specific_heat, silicon.specific_heat_law.values) == (712, (556, 712, 790))
    assert (oxide.conductivity, oxide.conductivity_z, oxide.conductivity_law) == (1.38, 1.1, PowerLaw(0.3))
    assert CrossSection.from_toml_text(geometry.to_toml()) == geometry


TABLE = 'temperature = ["200 K", "400 K"], values = ["1 W/m/K", "2 W/m/K"]'


@pytest.mark.parametrize(
    ("law", "words"),
    [
        ("{ exponent = -1.3 }", "conductivity: value is missing"),
        ('{ value = "1 W/m/K", exponent = 1, polynomial = [1] }', "give exponent, or polynomial, or temperature"),
        ('{ temperature = ["300 K", "200 K"], values = ["1 W/m/K", "2 W/m/K"] }', "increasing temperatures"),
        ('{ value = "1 W/m/K", r = "1 W/m/K" }', "value and r are the same"),
        ('{ r = "0.5 W/m/K" }', "conductivity: z is missing; r is along the layers alone"),
        (f"{{ {TABLE}, value = '5 W/m/K' }}", "conductivity: value = 5 W/m/K, but the table has 1.5 W/m/K at 300 K"),
        (f"{{ {TABLE}, r = '2 W/m/K', z = '1 W/m/K' }}", "conductivity: r = 2 W/m/K, but the table has 1.5 W/m/K"),
    ],
)
def test_bad_laws(law, words):
    with pytest.raises(InputError, match=words):
        CrossSection.from_toml_text(STRIP + f"[material.Si]\nconductivity = {law}\n")


@pytest.mark.parametrize("more", ["", ", value = '1.5 W/m/K'", ", r = '1.5 W/m/K', z = '1 W/m/K'", ", z = '1 W/m/K'"])
def test_a_value_beside_a_table_is_that_of_the_table(more):
    """It scales no table; a path does, and every form is written and read back."""
    text = STRIP + f"[material.Si]\nconductivity = {{ {TABLE}{more} }}\n"
    geometry = CrossSection.from_toml_text(text)
    silicon = geometry.material_of("core")
    assert (silicon.conductivity, silicon.conductivity_z) == (1.5, 1.0 if "z" in more else None)
    assert CrossSection.from_toml_text(geometry.to_toml()) == geometry
    for path in ("material.Si.conductivity", "material.Si.conductivity.value"):
        scaled = geometry.with_({path: 3.0})
        changed = scaled.material_of("core")
        assert (changed.conductivity, changed.conductivity_z) == (3.0, silicon.conductivity_z)
        assert changed.conductivity_law.factor(350) == pytest.approx(silicon.conductivity_law.factor(350), rel=1e-15)
        assert CrossSection.from_toml_text(scaled.to_toml()) == scaled


def test_a_relative_table_is_written_in_the_unit_of_its_property():
    law = Table((250.0, 350.0), (1.0, 1.2))
    alloy = Material("Si", 20.0, 8000.0, 500.0, conductivity_law=law)
    given = replace(CrossSection.from_toml_text(STRIP), materials=(alloy,))
    found = CrossSection.from_toml_text(given.to_toml())
    silicon = found.material_of("core")
    assert silicon.conductivity == 20
    assert float(silicon.conductivity_law.value(300)) == pytest.approx(20, rel=1e-12)
    assert silicon.conductivity_law.factor(330) == pytest.approx(law.factor(330), rel=1e-12)
    assert CrossSection.from_toml_text(found.to_toml()) == found
