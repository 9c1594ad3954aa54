"""Thermal boundary resistance and shells: exact cylinders, limits, volumes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from grids import facets_where, tensor_mesh

import surrogate
import thermofem as th
from thermofem.fem.probe_means import shell_integral
from thermofem.fem.surfaces import Surfaces, contacts, split
from thermofem.fem.weak_forms import discretize

ROD, SHELL, LENGTH = 1e-3, 5e-3, 2e-3  # m


def composite_cylinder(resistance, conductivity=20.0):
    """A rod heated inside, a contact, a shell held at its outside."""
    r = np.append(np.linspace(0, ROD, 9), np.linspace(ROD, SHELL, 33)[1:])
    mesh = tensor_mesh(r, [0, LENGTH / 3, LENGTH], lambda r, z: r > ROD, ("core", "shell"))
    mesh = split(mesh, resistance)
    held = facets_where(mesh, lambda r, z: np.isclose(r, SHELL))
    return discretize(mesh, conductivity, 1e6, Surfaces(held=held, contacts=contacts(mesh, resistance)))


def resistance_of(discretization):
    return discretization.state_space(("core",), ("core",)).thermal_resistance


@pytest.mark.parametrize("contact", [{"core": 1e-4}, {"shell": 1e-4}, {"core": 3e-5, "shell": 7e-5}])
def test_composite_cylinder_with_contact_resistance(contact):
    """R_th = R/(2 pi b L) + ln(a/b)/(2 pi k L) + 1/(8 pi k L), exact; two resistances in series add."""
    wall = 1e-4 / (2 * np.pi * ROD * LENGTH)
    exact = wall + np.log(SHELL / ROD) / (2 * np.pi * 20 * LENGTH) + 1 / (8 * np.pi * 20 * LENGTH)
    assert resistance_of(composite_cylinder(contact)) == pytest.approx(exact, rel=1e-6)  # as without the contact


def with_contact(resistance):
    contact = (th.Interface("core", resistance),)
    return th.assemble(replace(th.strip_ring(), interfaces=contact), accuracy=3e-3)


@pytest.mark.parametrize("resistance", [0.0, 1e-15])
def test_a_perfect_contact_keeps_the_resistance_and_has_a_derivative(resistance):
    """1.9e10 /m^2 by differences, also below 1e-14 m^2 K/W."""
    heat = with_contact(resistance)
    perfect = th.assemble(th.strip_ring(), accuracy=3e-3).thermal_resistance()
    assert heat.thermal_resistance() == pytest.approx(perfect, rel=1e-6)
    path, near = ["interface.core.resistance"], (1e-12, 2e-12)
    low, high = (with_contact(R).thermal_resistance() for R in near)
    slope = (high - low) / (near[1] - near[0])  # round-off of 1e-10 over a change by 2.4e-6
    assert th.derivatives(heat, path).thermal_resistance.values == pytest.approx([slope], rel=2e-3)
    found = surrogate.reduce(heat.system, 1e-4)
    poles = surrogate.reduction.reduce.pole_derivatives(heat, found, path)
    assert poles.thermal_resistance.values == pytest.approx([slope], rel=2e-3)


def test_the_field_jumps_at_the_contact_and_stays_on_the_mesh():
    heat = th.assemble(replace(th.strip_ring(), interfaces=(th.Interface("core", 1e-7),)))
    data = th.solve(heat, th.Constant(1e-3), [1e-6], field_times=[1e-6])
    places = np.unique(heat.mesh.points, axis=0)
    assert len(places) == len(th.assemble(th.strip_ring()).mesh.points)
    assert data.sizes["vertex"] == len(heat.mesh.points) > len(places)
    assert abs(data.attrs["heat_imbalance"]) < 1e-10


DISC, THICK, OWN = np.pi * (10e-6) ** 2, 0.5e-6, 1e-7  # m^2, m, m^2 K/W


def disc_on(side, *, base=0.0):
    """A heated disc of silicon on a side of the domain, or on ``base`` m of oxide; nothing flows sideways."""
    top = base > 0
    layers = (th.Layer("base", "SiO2", base or 1e-6, True), th.Layer("clad", "SiO2", 1e-6))
    return th.CrossSection(
        "disc",
        10e-6,
        layers[: 1 if top else 2],
        (th.Part("core", "Si", 0.0, 10e-6, 0.0 if top else -1e-6, THICK, heated=True),),
        (th.Interface("core", OWN),),
        bottom=th.Boundary("insulated") if top else side,
        top=side if top else th.Boundary("insulated"),
    )


SIDES = {
    "isothermal bottom": (disc_on(th.Boundary("isothermal")), 0.0),
    "convective bottom": (disc_on(th.Boundary("convection", 1e6)), 1e6),
    "convective top": (disc_on(th.Boundary("convection", 1e6), base=1e-6), 1e6),
}


@pytest.mark.parametrize("name", SIDES)
def test_a_surface_on_a_side_of_the_domain_has_its_resistance_in_series(name):
    """R_th = (R + 1/h + thickness/(3 k))/area, exact: 322.4 K/W, and 4.08 without it."""
    geometry, h = SIDES[name]
    heat = th.assemble(geometry)
    inverse = 1 / h if h else 0.0
    # cubic profiles of quadratic elements: the mean is exact to round-off of meshes with contacts
    assert heat.thermal_resistance() == pytest.approx((OWN + inverse + THICK / 390) / DISC, rel=1e-8)
    paths = ["interface.core.resistance", *([f"boundary.{name.split()[1]}.convection"] if h else [])]
    slopes = th.derivatives(heat, paths).thermal_resistance.values
    assert slopes == pytest.approx([1 / DISC, -1 / (h**2 * DISC)] if h else [1 / DISC], rel=1e-8)
    data = th.solve(heat, th.Constant(1e-3), [1e-8, 1e-6])
    assert abs(data.attrs["heat_imbalance"]) < 1e-10
    assert data.attrs["discretization_error"] < 1e-3


SHELL_SIZES = [0.1e-6, 0.3e-6, 0.8e-6, 1.8e-6]


@pytest.mark.parametrize("shell", SHELL_SIZES)
def test_a_shell_has_the_volume_of_the_dilation(shell):
    """2 pi R (perimeter s + pi s^2), by Pappus: the dilation of a rectangle is symmetric about its centre."""
    probe = th.Probe("near", "core", shell)
    heat = th.assemble(replace(th.strip_ring(), probes=(probe,)))
    integral = shell_integral(heat.geometry, heat.mesh, heat.discretization.basis, probe)
    exact = 2 * np.pi * 7.955e-6 * (2 * 670e-9 * shell + np.pi * shell**2)
    # some 100 cut triangles, each counted in 576 pieces: a few pieces per triangle are on the wrong side
    assert integral.sum() == pytest.approx(exact, rel=2e-3, abs=0)
