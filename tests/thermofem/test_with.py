"""A geometry with other values, by the paths of a campaign."""

from __future__ import annotations

import math

import pytest

import thermofem as th

STRIP = th.strip_ring()
CASES = {
    "part.core.radius": (5e-6, th.strip_ring(radius=5e-6)),
    "part.core.width": ("500 nm", th.strip_ring(width=500e-9)),
    "layer.box.thickness": (3e-6, th.strip_ring(box=3e-6)),
    "outer_radius": (50e-6, th.strip_ring(outer_radius=50e-6)),
}


@pytest.mark.parametrize("path", CASES)
def test_it_is_the_geometry_made_with_that_value(path):
    value, expected = CASES[path]
    assert STRIP.with_({path: value}) == expected


def test_paths_without_a_dot_are_keywords_too():
    assert STRIP.with_(outer_radius=50e-6, ambient=300.0) == STRIP.with_({"outer_radius": "50 um", "ambient": "300 K"})


def test_edges_where_the_part_is_given_by_its_centre_and_back():
    both = STRIP.with_({"part.core.inner_radius": 7e-6, "part.core.outer_radius": 8e-6})
    assert (both.parts[0].inner_radius, both.parts[0].outer_radius) == (7e-6, 8e-6)
    assert both.with_({"part.core.radius": 7.955e-6, "part.core.width": 450e-9}) == STRIP


def test_materials_boundaries_angles_and_words():
    changed = STRIP.with_(
        {
            "material.SiO2.conductivity": 1.2,
            "boundary.top.convection": 1e4,
            "part.core.material": "Si3N4",
            "part.core.sidewall_angle": math.radians(80),
        }
    )
    assert changed.material_of("box").conductivity == 1.2
    assert changed.material_of("box").density == th.materials["SiO2"].density
    assert changed.top == th.Boundary("convection", 1e4)
    assert changed.material_of("core").name == "Si3N4"
    assert changed.parts[0].sidewall_angle == pytest.approx(math.radians(80), rel=1e-12)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"part.cor.radius": 5e-6}, "did you mean 'core'"),
        ({"core.radius": 5e-6}, "leads nowhere"),
        ({f"material.SiO2.conductivity{end}": 1.0 for end in ("", ".value")}, "'material.SiO2.conductivity' twice"),
        ({"part.core.width": 4e-7, "part.core.inner_radius": 6e-6}, "'core': width and inner_radius are of two forms"),
        ({"boundary.top": "insulated", "boundary.top.convection": 1e4}, "'boundary.top' twice"),
        ({"part": "x", "part.core.width": 5e-7}, "path 'part' leads nowhere"),
    ],
)
def test_what_cannot_be_changed(values, words):
    with pytest.raises(th.InputError, match=words):
        STRIP.with_(values)
