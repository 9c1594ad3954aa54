"""Sections of a cross-section of gdsfactory, with a stand-in for the package: where they lie, and how many."""

from __future__ import annotations

import math
import sys
from types import ModuleType, SimpleNamespace

import pytest

import thermofem as th


def level(zmin, thickness, material, layer):
    return SimpleNamespace(
        zmin=zmin, thickness=thickness, material=material, layer=layer, sidewall_angle=0, width_to_z=0.5
    )


LEVELS = {
    "substrate": level(-500, 498, "si", (99, 0)),
    "box": level(-2, 2, "sio2", (99, 1)),
    "clad": level(0, 3, "sio2", (99, 2)),
    "core": level(0, 0.22, "si", (1, 0)),
    "heater": level(1.1, 0.75, "TiN", (47, 0)),
}


def section(width, layer, offset=0.0):
    return SimpleNamespace(width=width, layer=layer, offset=offset)


CORE = section(0.5, (1, 0))


def region(*holes):
    """Polygons as KLayout gives them, one for each length of a hole in nm."""
    edges = [[SimpleNamespace(length=lambda part=hole / 4: part)] * 4 for hole in holes]
    polygons = [SimpleNamespace(holes=lambda: 1, each_edge=lambda _, own=one: own) for one in edges]
    return SimpleNamespace(each=lambda: polygons)


def imported(monkeypatch, *sections, holes=(2e3 * math.pi * 9.75,)):
    """The cross-section of a ring of 10 um with these sections."""
    stand_in = ModuleType("gdsfactory")
    stand_in.get_cross_section = lambda _: SimpleNamespace(sections=sections, radius=10.0)
    stand_in.get_component = lambda *_, **__: SimpleNamespace(info={"length": 5 * math.pi})
    monkeypatch.setitem(sys.modules, "gdsfactory", stand_in)
    ring = SimpleNamespace(
        settings={"cross_section": "drawn", "radius": 10.0}, name="ring", kcl=SimpleNamespace(dbu=1e-3)
    )
    ring.get_region = lambda layer, merge: region(*holes)
    return th.from_gdsfactory(ring, SimpleNamespace(layers=LEVELS))


def test_sections_in_the_middle_become_parts(monkeypatch):
    found = imported(monkeypatch, CORE, section(2.0, (47, 0)), CORE)  # a heater's cross-section repeats the core
    assert [part.name for part in found.parts] == ["heater", "core"]
    assert [p.inner_radius for p in found.parts] == pytest.approx([9e-6, 9.75e-6])
    assert [p.outer_radius for p in found.parts] == pytest.approx([11e-6, 10.25e-6])


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ((CORE, section(1.0, (47, 0), 3.0), section(1.0, (47, 0), -3.0)), "'heater': offset of its section = 3 must"),
        ((section(0.5, (1, 0), -1.0),), "'core': offset of its section = -1 must"),
        ((CORE, section(1.0, (47, 0)), section(2.0, (47, 0))), "'heater' has two sections of different width"),
    ],
)
def test_sections_that_would_be_moved_or_dropped_are_refused(monkeypatch, sections, words):
    """An offset, and a second section on a level: two heaters beside the core are not one over it."""
    with pytest.raises(th.InputError, match=words):
        imported(monkeypatch, *sections)


@pytest.mark.parametrize(
    ("holes", "words"),
    [
        ((), "component has 0 closed waveguides on layer"),
        ((61e3, 61e3), "component has 2 closed waveguides on layer"),
        ((191.8e3,), "a loop of 193.4 um, but its settings make a ring of 62.83 um"),
    ],
)
def test_what_is_drawn_decides_whether_it_is_a_ring(monkeypatch, holes, words):
    """A straight, a disk, an array of rings and an interferometer became rings of 10 um."""
    with pytest.raises(th.InputError, match=words):
        imported(monkeypatch, CORE, holes=holes)
