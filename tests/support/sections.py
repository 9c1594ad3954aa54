"""Cross-sections that several tests use."""

from __future__ import annotations

from hypothesis import strategies as st

from thermofem.geometry import CrossSection, Layer, Part

# every table of the geometry file at once
HEATER = """
name = "strip with a heater"
outer_radius = "60 um"
ambient = "293.15 K"

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
material = "SiO2"
thickness = "2.22 um"

[[part]]
name = "core"
material = "Si"
radius = "7.955 um"
width = "450 nm"
bottom = "0 nm"
height = "220 nm"
sidewall_angle = "80 deg"
heated = true
[[part]]
name = "heater"
material = "TiN"
radius = "7.955 um"
width = "2 um"
bottom = "2.22 um"
height = "100 nm"
heated = true
[[part]]
name = "undercut"
material = "void"
inner_radius = "4 um"
outer_radius = "12 um"
bottom = "-12 um"
height = "10 um"

[[interface]]
part = "core"
resistance = "1e-8 m^2*K/W"

[boundary]
bottom = "isothermal"
top = { convection = "1e4 W/m^2/K" }
outer = "insulated"

[material.Si]
conductivity = { value = "130 W/m/K", exponent = -1.3, reference = "300 K" }
density = "2330 kg/m^3"
specific_heat = "700 J/kg/K"
"""

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
