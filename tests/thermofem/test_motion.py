"""Meshes that follow a geometry."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from sections import HEATER, says

import thermofem as th
from thermofem.checks import InputError
from thermofem.fem.surfaces import split
from thermofem.geometry import CrossSection
from thermofem.mesh import make, mesh_for
from thermofem.mesh.mesh_motion import Motion, quality

ROUND_OFF = 1e-12  # 16 ulps of the largest coordinate (60 um) over the smallest thickness (100 nm)


def tilted(degrees, width=450e-9):
    strip = th.strip_ring(width=width)
    return replace(strip, parts=(replace(strip.parts[0], sidewall_angle=math.radians(degrees)),))


def heater(text="", new=""):
    return CrossSection.from_toml_text(HEATER.replace(text, new) if text else HEATER)


@pytest.fixture(scope="module")
def strip_mesh():
    return mesh_for(th.strip_ring(), 1e-3)


@pytest.fixture(scope="module")
def heater_mesh(needs_mesher):
    return make(heater(), 1e-2)


@pytest.mark.parametrize(
    "changes",
    [
        {"radius": 4e-6},
        {"radius": 12e-6, "width": 600e-9, "box": 1e-6},
        {"box": 2.5e-6, "cladding": 1.5e-6, "height": 250e-9},
        {"substrate": 100e-6, "outer_radius": 150e-6},
    ],
)
def test_the_mesh_of_the_strip_becomes_that_of_another_one(strip_mesh, changes):
    new = th.strip_ring(**changes)
    points = Motion(strip_mesh, th.strip_ring()).moved(new)
    assert replace(strip_mesh, points=points).volumes() == pytest.approx(new.volumes(), rel=ROUND_OFF, abs=0)
    # the mesher's worst is 0.45; a factor of 3 in one direction, as the substrate has, brings an equal triangle to 0.6
    assert quality(points, strip_mesh.triangles).min() > 0.15


@pytest.mark.parametrize(
    ("text", "new"),
    [
        ('sidewall_angle = "80 deg"', 'sidewall_angle = "70 deg"'),
        ('sidewall_angle = "80 deg"', 'sidewall_angle = "90 deg"'),
        ('width = "2 um"', 'width = "1.5 um"'),
        ('outer_radius = "12 um"', 'outer_radius = "15 um"'),
        ('inner_radius = "4 um"', 'inner_radius = "3 um"'),
        ('thickness = "30 um"', 'thickness = "25 um"'),
    ],
)
def test_tilted_walls_heaters_and_voids_are_followed(heater_mesh, text, new):
    geometry = heater(text, new)
    points = Motion(heater_mesh, heater()).moved(geometry)
    assert replace(heater_mesh, points=points).volumes() == pytest.approx(geometry.volumes(), rel=ROUND_OFF, abs=0)


def test_a_vertical_wall_can_be_tilted(strip_mesh):
    points = Motion(strip_mesh, th.strip_ring()).moved(tilted(75))
    found = replace(strip_mesh, points=points).volumes()
    assert found == pytest.approx(tilted(75).volumes(), rel=ROUND_OFF, abs=0)


def test_velocities_are_differences_of_moved_meshes(strip_mesh):
    """Lengths move points along straight lines, so a finite step gives the velocity up to round-off."""
    old, new = th.strip_ring(), th.strip_ring(radius=8.955e-6, box=2.5e-6)
    motion = Motion(strip_mesh, old)
    velocity = motion.velocity(motion.corners_of(new) - motion.corners)
    # 1 ulp of 60 um over a step of 1 um
    assert motion.moved(new) - strip_mesh.points == pytest.approx(velocity, abs=1e-6 * 1e-13)
    axis = strip_mesh.points[:, 0] == 0
    assert np.all(velocity[axis, 0] == 0)
    core = strip_mesh.triangles[strip_mesh.region == strip_mesh.region_names.index("core")]
    assert velocity[core, 0] == pytest.approx(1e-6, rel=0.01)  # the core, finely meshed, hardly strains


def test_nodes_doubled_along_a_contact_stay_together(strip_mesh):
    doubled = split(strip_mesh, {"core": 1e-8})
    old, new = th.strip_ring(), th.strip_ring(radius=7e-6, width=500e-9)
    first, second = (Motion(mesh, old).moved(new) for mesh in (strip_mesh, doubled))
    pairs = {tuple(point) for point in np.round(second / 1e-18)}
    assert len(pairs) == len(first) < len(second)
    replace(doubled, points=second)  # it refuses triangles that turned over


def test_a_mesh_that_cannot_follow_says_so(strip_mesh):
    old = th.strip_ring()
    with pytest.raises(InputError) as error:
        Motion(strip_mesh, old).moved(th.heated_ring())
    says(error, "other faces", "cannot follow")
    with pytest.raises(InputError) as error:
        Motion(strip_mesh, th.strip_ring(width=500e-9)).moved(old)
    says(error, "no vertex at a corner", "the one it was made for")
    with pytest.raises(InputError) as error:
        Motion(strip_mesh, old).moved(
            th.strip_ring(radius=0.24e-6)
        )  # what was 7.7 um wide inside the ring is 15 nm wide
    says(error, "turn over", "make a new mesh")
