"""Thermal boundary resistance and shells: exact cylinders, limits, volumes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from grids import facets_where, tensor_mesh

import thermofem as th
from thermofem.algebra.factor import factorize
from thermofem.heat.interface import contacts, split
from thermofem.heat.matrices import build
from thermofem.heat.shell import shell_integral
from thermofem.heat.surfaces import Surfaces

ROD, SHELL, LENGTH = 1e-3, 5e-3, 2e-3  # m


def composite_cylinder(resistance, conductivity=20.0):
    """A rod heated inside, a contact, a shell held at its outside."""
    r = np.append(np.linspace(0, ROD, 9), np.linspace(ROD, SHELL, 33)[1:])
    mesh = tensor_mesh(r, [0, LENGTH / 3, LENGTH], lambda r, z: r > ROD, ("core", "shell"))
    mesh = split(mesh, resistance)
    held = facets_where(mesh, lambda r, z: np.isclose(r, SHELL))
    return build(mesh, conductivity, 1e6, Surfaces(held=held, contacts=contacts(mesh, resistance)))


def resistance_of(discretization):
    return discretization.state_space(("core",), ("core",)).thermal_resistance


@pytest.mark.parametrize("contact", [{"core": 1e-4}, {"shell": 1e-4}, {"core": 3e-5, "shell": 7e-5}])
def test_composite_cylinder_with_contact_resistance(contact):
    """R_th = R/(2 pi b L) + ln(a/b)/(2 pi k L) + 1/(8 pi k L), exact; two resistances in series add."""
    wall = 1e-4 / (2 * np.pi * ROD * LENGTH)
    exact = wall + np.log(SHELL / ROD) / (2 * np.pi * 20 * LENGTH) + 1 / (8 * np.pi * 20 * LENGTH)
    assert resistance_of(composite_cylinder(contact)) == pytest.approx(exact, rel=1e-6)  # as without the contact


def test_heat_is_conserved_across_the_contact():
    d = composite_cylinder({"core": 1e-4})
    system = d.state_space(("core",), ("core",))
    assert d.ledger.drain_A @ factorize(-system.A)(system.B[:, 0]) == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("resistance", [1e-9, 1e-11, 1e-13])
def test_a_vanishing_resistance_recovers_perfect_contact(resistance):
    """The rise is R/(surface of the core), to first order: the heat still leaves where it did."""
    perfect, strip = th.assemble(th.strip_ring()).thermal_resistance(), th.strip_ring()
    found = th.assemble(replace(strip, interfaces=(th.Interface("core", resistance),))).thermal_resistance()
    core = strip.parts[0]
    surface = 2 * np.pi * (core.inner_radius + core.outer_radius) * (450e-9 + 220e-9)
    # flux concentrates at the corners: between the mean flux's rise and a third more; below, 1e-10 of round-off
    assert 1.0 * resistance / surface - 1e-9 * perfect < found - perfect < 1.4 * resistance / surface + 1e-9 * perfect


def test_no_resistance_leaves_the_mesh_alone():
    strip = th.strip_ring()
    same = th.assemble(replace(strip, interfaces=(th.Interface("core", 0.0),)))
    assert same.unknowns == th.assemble(strip).unknowns
    assert same.thermal_resistance() == th.assemble(strip).thermal_resistance()


def test_the_field_jumps_at_the_contact_and_stays_on_the_mesh():
    heat = th.assemble(replace(th.strip_ring(), interfaces=(th.Interface("core", 1e-7),)))
    data = th.solve(heat, th.Constant(1e-3), [1e-6], field_times=[1e-6])
    places = np.unique(heat.mesh.points, axis=0)
    assert len(places) == len(th.assemble(th.strip_ring()).mesh.points)
    assert data.sizes["vertex"] == len(heat.mesh.points) > len(places)
    assert abs(data.attrs["heat_imbalance"]) < 1e-10


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


def test_shells_get_colder_with_distance():
    probes = tuple(th.Probe(f"s{k}", "core", s) for k, s in enumerate(SHELL_SIZES))
    heat = th.assemble(replace(th.strip_ring(), probes=probes))
    names = ("core", *(probe.name for probe in probes))
    steady = [heat.thermal_resistance(read=name) for name in names]
    assert np.all(np.diff(steady) < 0)
    data = th.solve(heat, th.Constant(1e-3), [1e-6], read=names)
    assert np.all(np.diff(data.delta_T.values[0]) < 0)
    with pytest.raises(th.InputError, match="read = 's9' is unknown"):
        heat.channels(read="s9")


def test_a_shell_mean_is_exact_for_linear_fields():
    """The shell is symmetric about the middle of the core: its mean of z is 110 nm."""
    probe = th.Probe("near", "core", 0.3e-6)
    heat = th.assemble(replace(th.strip_ring(), probes=(probe,)))
    d = heat.discretization
    _, z = d.basis.doflocs
    # a shift by 1e-4 of the shell's thickness, as its volume is that good
    assert d.means["near"] @ z == pytest.approx(110e-9, rel=0, abs=1e-3 * probe.shell)
