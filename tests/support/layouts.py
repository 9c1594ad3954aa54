"""Layouts that several tests use."""

from dataclasses import replace

import numpy as np

import thermofem as th

# two racetracks, a heater along the first and a strip between them, as a layout file
CHIP = """
name = "two racetracks, a heater and a pad"
kind = "straight"
length = "100 um"
half_width = "60 um"
[[layer]]
name = "substrate"
material = "Si"
thickness = "20 um"
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
x = "0 um"
width = "450 nm"
bottom = "0 nm"
height = "220 nm"
heated = true
[[part]]
name = "heater"
material = "TiN"
x = "0 um"
width = "2 um"
bottom = "2.22 um"
height = "100 nm"
heated = true
[[shape]]
name = "ring 1"
radius = "5 um"
straight = "8 um"
[[shape]]
name = "heater 1"
part = "heater"
radius = "5 um"
straight = "8 um"
[[shape]]
name = "ring 2"
radius = "5 um"
straight = "8 um"
at = ["24 um", "0 um"]
[[shape]]
name = "strip"
part = "heater"
path = [["12 um", "-8 um"], ["12 um", "8 um"]]
"""


def heated_section() -> th.CrossSection:
    """A straight strip with a heater of 2 um on the top of the stack."""
    guide = th.straight_guide()
    heater = th.Part("heater", "TiN", bottom=guide.top_z, height=100e-9, heated=True, x=0.0, width=2e-6)
    return replace(guide, parts=(*guide.parts, heater))


def random_layout(seed: int) -> list[th.Shape]:
    """Two to four racetracks on a grid, some with a heater along them or a pad or strip beside them."""
    rng = np.random.default_rng(seed)
    section = heated_section()
    shapes: list[th.Shape] = []
    pitch = rng.uniform(34e-6, 60e-6)
    for number in range(1, int(rng.integers(2, 5)) + 1):
        x = pitch * (number % 3) + rng.uniform(-2e-6, 2e-6)
        y = pitch * (number // 3) + rng.uniform(-2e-6, 2e-6)
        size = {"radius": rng.uniform(3e-6, 6e-6), "straight": rng.uniform(0.0, 8e-6), "at": (x, y)}
        shapes.append(th.racetrack(f"ring {number}", section, **size))
        beside = x + size["radius"] + rng.uniform(2e-6, 4e-6)
        extra = rng.integers(0, 4)
        if extra == 1:
            shapes.append(th.racetrack(f"heater {number}", section, part="heater", **size))
        elif extra == 2:
            path = [(beside, y - 6e-6), (beside, y + 6e-6)]
            shapes.append(th.Shape(f"strip {number}", section, part="heater", path=path))
        elif extra == 3:
            far = beside + 4e-6
            corners = [(beside, y), (far, y), (far, y + 9e-6), (beside, y + 9e-6)]
            shapes.append(th.Shape(f"pad {number}", section, part="heater", outline=corners))
    return shapes
