"""A mesh of the user's own, against the exact temperature of a heated cylinder in a cooled one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import thermofem as th
from thermofem.mesh import Mesh

OUTER, HEIGHT = 5e-6, 2e-6  # m, of the domain
INNER = 1.3e-6  # m, of the heated cylinder in the mesh; the geometry file says 1 um
GEOMETRY = f"""
outer_radius = "{OUTER} m"
[[layer]]
name = "glass"
material = "glass"
thickness = "{HEIGHT} m"
datum = true
[[part]]
name = "core"
material = "rod"
inner_radius = "0 um"
outer_radius = "1 um"
bottom = "-{HEIGHT} m"
height = "{HEIGHT} m"
heated = true
[boundary]
bottom = "insulated"
outer = "isothermal"
[material.glass]
conductivity = "1.5 W/m/K"
density = "2200 kg/m^3"
specific_heat = "700 J/kg/K"
[material.rod]
conductivity = "30 W/m/K"
density = "2300 kg/m^3"
specific_heat = "700 J/kg/K"
"""


def cylinder(radii, bottom=-HEIGHT, names=("core", "glass")):
    """Triangles between given radii, in two rows; inside ``INNER`` they are the core."""
    z = bottom + HEIGHT * np.array([0.0, 0.5, 1.0])
    points = np.array([(r, height) for height in z for r in radii])
    n = len(radii)
    corners = [
        (row * n + k, row * n + k + 1, (row + 1) * n + k, (row + 1) * n + k + 1) for row in (0, 1) for k in range(n - 1)
    ]
    triangles = np.array([triangle for a, b, c, d in corners for triangle in ((a, b, d), (a, d, c))])
    region = (points[triangles].mean(axis=1)[:, 0] > INNER).astype(int)
    return Mesh(points, triangles, region, names)


RADII = np.concatenate([np.linspace(0, INNER, 6), np.geomspace(INNER, OUTER, 16)[1:]])


@pytest.mark.parametrize("as_file", [True, False])
def test_the_shape_is_that_of_the_mesh_and_the_materials_those_of_the_geometry(tmp_path, as_file):
    """dT = P/(2 pi L) [ln(b/a)/k + 1/(4 k_in)], the mean over a cylinder heated evenly, cooled at b."""
    geometry = th.CrossSection.from_toml_text(GEOMETRY)
    mesh = cylinder(RADII)
    if as_file:
        mesh.save(tmp_path / "own.msh")
    heat = th.assemble(geometry, mesh=tmp_path / "own.msh" if as_file else mesh)
    exact = (np.log(OUTER / INNER) / 1.5 + 1 / (4 * 30)) / (2 * np.pi * HEIGHT)
    # P2 elements in a field ln r: (h/r)^4/100 of R_th with h/r = 0.09
    assert heat.thermal_resistance("core") == pytest.approx(exact, rel=1e-6)
    assert set(heat.regions) == {"core", "glass"}


def test_a_contact_is_that_of_the_geometry():
    """A resistance R around the cylinder adds R/(2 pi a L)."""
    contact = '\n[[interface]]\npart = "core"\nresistance = "1e-7 m^2*K/W"\n'
    bare, coated = (th.CrossSection.from_toml_text(GEOMETRY + more) for more in ("", contact))
    mesh = cylinder(RADII)
    added = th.assemble(coated, mesh=mesh).thermal_resistance("core") - th.assemble(bare, mesh=mesh).thermal_resistance(
        "core"
    )
    assert added == pytest.approx(1e-7 / (2 * np.pi * INNER * HEIGHT), rel=1e-6)


def test_a_coarse_mesh_is_taken_as_it_is_and_its_error_said(caplog):
    coarse = cylinder(np.array([0.0, INNER, OUTER]))
    heat = th.assemble(th.CrossSection.from_toml_text(GEOMETRY), mesh=coarse)
    assert len(heat.mesh.triangles) == 8
    assert "more than accuracy = 0.001" in caplog.text


def test_exchanged_names_are_said(caplog):
    """77 % of the core of the mesh lies in that of the geometry; of the glass under its name nothing does."""
    geometry = th.CrossSection.from_toml_text(GEOMETRY)
    th.assemble(geometry, mesh=cylinder(RADII))
    assert "exchanged" not in caplog.text
    th.assemble(geometry, mesh=cylinder(RADII, names=("glass", "core")))
    assert "100 % of the group 'core' lies outside of 'core'" in caplog.text


@pytest.mark.parametrize(
    ("mesh", "words"),
    [
        (cylinder(RADII, names=("core", "air")), "mesh: group.*'air'"),
        (replace(cylinder(RADII), region=np.zeros(80, dtype=int), region_names=("glass",)), "heated part.*'core'"),
        (replace(cylinder(RADII), region=np.ones(80, dtype=int)), "heated part.*'core'"),
        (cylinder(RADII * 1.01), "lies on no side"),
        (cylinder(RADII, bottom=0.0), "lies on no side"),
        (cylinder(RADII[1:]), "lies on no side|spans r"),
        ("missing.msh", "missing.msh"),
    ],
    ids=["name", "heated", "heated, named alone", "too wide", "shifted", "without its axis", "no file"],
)
def test_a_mesh_of_something_else_is_refused(mesh, words):
    with pytest.raises((th.InputError, OSError), match=words):
        th.assemble(th.CrossSection.from_toml_text(GEOMETRY), mesh=mesh)
