"""The temperature of the ambient as an input of heat problems: gain 1 at rest, and a slab in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import skfem

import surrogate
import thermofem as th
from thermofem.geometry import Boundary, CrossSection, Interface, Layer, Part

STRIP = th.strip_ring()
GUIDE = th.straight_guide()
COOLED = Boundary("convection", 1e4)
HOLE = Part("undercut", "void", 4e-6, 12e-6, -1.9e-6, 1e-6)
SINK = Part("sink", "Al", 0.0, 20e-6, -32e-6, 5e-6)
SECTIONS = {
    "held below": STRIP,
    "convective above": replace(STRIP, top=COOLED),
    "convective everywhere": replace(STRIP, bottom=COOLED, top=COOLED, outer=COOLED),
    "open": STRIP.opened(),
    "interface": replace(STRIP, interfaces=(Interface("core", 1e-8),)),
    "interface on a held side": replace(STRIP, parts=(*STRIP.parts, SINK), interfaces=(Interface("sink", 1e-8),)),
    "void": replace(STRIP, parts=(*STRIP.parts, HOLE)),
    "heater": th.heated_ring(),
    "guide held below": GUIDE,
    "guide convective": replace(GUIDE, top=COOLED, outer=COOLED),
    "guide open": GUIDE.opened(),
}


def ambient_gain(section):
    heat = th.assemble(section, accuracy=1e-2)
    return heat, heat.channels("ambient", "core").gain[0, 0]


@pytest.mark.parametrize("kind", SECTIONS)
def test_the_static_gain_of_the_ambient_is_one(kind):
    """The whole chip takes on the temperature around it; 1e-12 is the round-off of a refined solve."""
    heat, gain = ambient_gain(SECTIONS[kind])
    assert gain == pytest.approx(1, rel=0, abs=1e-12)
    both = surrogate.reduce(heat.channels(("core", "ambient"), "core"), tolerance=1e-3)
    # the projection of a reduction is not refined: 3e-12 measured
    assert both.model.gain[0, 1] == pytest.approx(1, rel=0, abs=2e-11)
    assert both.model.gain[0, 0] == pytest.approx(heat.thermal_resistance("core"), rel=1e-9)


def test_heat_enters_through_the_sides_alone():
    """B against scikit-fem: int 2 pi r h u ds of the convective top, and the reaction -K_fh 1 of the held bottom.

    1e-10 of the largest entry: K_ff 1 has the round-off of the sums of conduction, 1e-17 W/K of up to 1e-3.
    """
    heat = th.assemble(SECTIONS["convective above"], accuracy=1e-2)
    d = heat.discretization
    top = d.basis.mesh.facets_satisfying(lambda x: np.isclose(x[1], x[1].max()), boundaries_only=True)
    side = skfem.FacetBasis(d.basis.mesh, d.basis.elem, facets=top, intorder=7)
    load = skfem.LinearForm(lambda v, w: 2 * np.pi * w.x[0] * COOLED.coefficient * v).assemble(side)
    reaction = np.asarray(d.stiffness[d.free][:, d.held].sum(axis=1)).ravel()
    expected = load[d.free] - reaction
    assert d.inflow == pytest.approx(expected, rel=0, abs=1e-10 * np.abs(expected).max())
    # h times the area of the lid, 1e-4 of the sum of both
    assert load.sum() == pytest.approx(COOLED.coefficient * np.pi * STRIP.outer_radius**2, rel=1e-9, abs=0)


def test_a_slab_follows_its_bottom():
    """T_top/T_bottom = 1/cosh(L q), q^2 = s/D, averaged over a lid of height a: sinh(a q)/(a q).

    Within 1e-4 of the static gain: the mass between held and free unknowns, which is left out, is 5e-5 (see
    `Discretization.inflow`); the P2 triangles of 4 um leave 3e-6.
    """
    L = 30e-6
    a = 0.5e-6
    layers = (Layer("low", "SiO2", L - 1e-6, datum=True), Layer("high", "SiO2", 1e-6))
    lid = Part("core", "SiO2", 7e-6, 8e-6, 0.5e-6, a, heated=True)
    section = CrossSection("slab", 20e-6, layers, (lid,))
    oxide = section.material_of("core")
    D = oxide.conductivity / oxide.heat_capacity
    frequency = D / L**2 * np.array([1e-2, 0.1, 0.3, 1, 3, 10])
    q = np.sqrt(2j * np.pi * frequency / D)
    expected = np.sinh(a * q) / (a * q) / np.cosh(L * q)
    assert 0.005 < np.abs(expected[-1]) < 0.01  # so that the slab lags far behind
    heat = th.assemble(section, accuracy=1e-2)
    full = heat.channels("ambient", "core").impedance(frequency)
    assert np.abs(full - expected).max() < 1e-4
    small = surrogate.reduce(heat.channels(("core", "ambient"), "core"), tolerance=1e-4).model
    found = small.channel("ambient").dynamics.impedance(frequency)
    assert np.abs(found - full).max() < 1e-4  # the tolerance of the reduction


@pytest.mark.parametrize(
    ("heated", "read", "words"),
    [
        (("core", "ambient"), "substrate", ("'substrate'", "ambient", "at once")),
        (("core", "ambience"), "core", ("heated", "'ambience'", "ambient")),
    ],
)
def test_what_cannot_follow_the_ambient_is_refused(heated, read, words):
    heat = th.assemble(STRIP, accuracy=1e-2)
    with pytest.raises(th.InputError) as error:
        heat.channels(heated, read)
    message = str(error.value)
    assert all(word in message for word in words), message
    assert "\n" not in message


def test_a_region_called_ambient_and_a_nonlinear_model_are_refused():
    named = replace(STRIP, parts=(replace(STRIP.parts[0], name="ambient"),))
    with pytest.raises(th.InputError, match="rename the region"):
        th.assemble(named, accuracy=1e-2).channels("ambient")
    silicon = th.geometry.CrossSection.from_toml_text(
        STRIP.to_toml()
        + '\n[material.Si]\nconductivity = { value = "130 W/m/K", exponent = -1.3, reference = "300 K" }\n'
    )
    with pytest.raises(th.InputError, match="linear"):
        th.assemble(silicon, accuracy=1e-2).model(("core", "ambient"), "core")
