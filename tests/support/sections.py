"""Cross-sections that several tests use."""

from __future__ import annotations

import re

from hypothesis import strategies as st
from paths import ROOT

from thermofem.geometry import CrossSection, Layer, Part

# every table of the geometry file at once, as the docs show it
HEATER = re.search(r"```toml[^\n]*\n(.*?)```", (ROOT / "docs" / "geometry.md").read_text(), re.DOTALL)[1]

# the reference strip, as a person would write it
STRIP = """
outer_radius = "60 um"
layer = [
  { name = "substrate", material = "Si", thickness = "30 um" },
  { name = "box", material = "SiO2", thickness = "2 um", datum = true },
  { name = "cladding", material = "SiO2", thickness = "2.22 um" },
]
[[part]]
name = "core"
material = "Si"
radius = "7.955 um"
width = "450 nm"
bottom = "0 nm"
height = "220 nm"
heated = true
"""


def on_oxide(*parts, **changes):
    layers = (Layer("bulk", "Si", 1e-6), Layer("oxide", "SiO2", 2e-6, datum=True), Layer("top", "SiO2", 1e-6))
    return CrossSection("test", 4e-6, layers, parts, **changes)


def core(**changes):
    values = {"inner_radius": 1e-6, "outer_radius": 2e-6, "bottom": 0.0, "height": 400e-9, "heated": True}
    return Part("core", "Si", **(values | changes))


NM = 1e-9
CELL = 50  # nm
lattice = st.integers


@st.composite
def random_parts(draw):
    parts = []
    for k in range(draw(lattice(1, 4))):
        left, low = draw(lattice(0, 60)), draw(lattice(-40, 10))
        right, high = draw(lattice(left + 1, 80)), draw(lattice(low + 1, 20))
        material = draw(st.sampled_from(["Si", "Al", "SiO2", "void"])) if k else "Si"
        numbers = (left * CELL * NM, right * CELL * NM, low * CELL * NM, (high - low) * CELL * NM)
        parts.append(Part(f"part{k}", material, *numbers, heated=k == 0))
    return parts


def says(error, *words):
    """The message holds the words, in one line."""
    message = str(error.value)
    assert all(word in message for word in words), message
    assert "\n" not in message


# silicon under a polymer with dn/dT < 0: the mean over the core is a third of what light sees at first
COVERED = """
name = "strip under a polymer"
outer_radius = "40 um"
[[layer]]
name = "substrate"
material = "Si"
thickness = "30 um"
[[layer]]
name = "box"
material = "SiO2"
thickness = "2 um"
datum = true
[[layer]]
name = "cladding"
material = "polymer"
thickness = "2 um"
[[part]]
name = "core"
material = "Si"
radius = "10 um"
width = "350 nm"
bottom = "0 nm"
height = "220 nm"
heated = true
[material.polymer]
conductivity = "0.2 W/m/K"
density = "1200 kg/m^3"
specific_heat = "1500 J/kg/K"
index = 1.5
thermo_optic = "-3e-4 1/K"
"""
LIGHT = '[light]\nwavelength = "1550 nm"\nloss = "2 dB/cm"\n'
