"""Copies of a part beside the axis: exact fields, the exact layered stack, quadrature, the error estimate, refusals."""

from dataclasses import replace

import numpy as np
import pytest
from off_axis_exact import Stack

import surrogate
import thermofem as th

RADIUS, WIDTH, HEIGHT = 7.955e-6, 450e-9, 220e-9


def neighbours(*distances: float, part: str = "core") -> tuple[th.Probe, ...]:
    return tuple(th.Probe(name=f"{d * 1e6:g} um", part=part, distance=d) for d in distances)


def uniform_oxide(*distances: float, cladding: float = 2e-6) -> th.CrossSection:
    """The reference strip in a wide domain; its core has the properties of the oxide."""
    geometry = th.strip_ring(cladding=cladding, outer_radius=300e-6)
    core = replace(geometry.parts[0], material="SiO2")
    return replace(geometry, parts=(core,), probes=neighbours(*distances))


@pytest.fixture(scope="module")
def oxide() -> th.fem.HeatProblem:
    return th.assemble(uniform_oxide(17e-6, 20e-6, 30e-6))


def test_the_exact_solution_has_the_published_values():
    """With the oxide ending 2 um above z = 0: 203.39 and 21.983 K/W at 20 and 30 um, five digits."""
    stack = Stack(cladding=1.78e-6)
    assert stack.impedance(20e-6) == pytest.approx(203.39, rel=2.5e-5, abs=0)
    assert stack.impedance(30e-6) == pytest.approx(21.983, rel=2.5e-5, abs=0)
    # 500 um of silicon: 10.6 K/W at 100 um, three digits
    assert replace(stack, substrate=500e-6).impedance(100e-6) == pytest.approx(10.6, rel=5e-3, abs=0)


@pytest.mark.parametrize("s", [0.0, 1e4, 1e5, 1e6])
def test_neighbours_read_what_the_exact_layered_solution_says(oxide, s):
    """1e-3 of the channel's static value is what the mesh was asked for; the outer side at 300 um adds nothing."""
    d = oxide.discretization
    field = d.factors.solve(s, 1.0, d.means["core"][d.free])
    for probe in oxide.geometry.probes:
        exact = Stack().impedance(probe.distance, s)
        assert d.means[probe.name][d.free] @ field == pytest.approx(
            exact, rel=0, abs=1e-3 * Stack().impedance(probe.distance)
        )


def test_a_copy_integrates_quadratic_fields_exactly(oxide):
    """The mean of rho^2 over a ring at distance d is d^2 + (r1^2 + r2^2)/2; that of z its middle height."""
    d = oxide.discretization
    r, z = d.basis.doflocs
    r1, r2 = RADIUS - WIDTH / 2, RADIUS + WIDTH / 2
    for probe in oxide.geometry.probes:
        mean = d.means[probe.name]
        # round-off of sums of about 1e4 terms
        assert mean.sum() == pytest.approx(1, rel=1e-12, abs=0)
        assert mean @ r**2 == pytest.approx(probe.distance**2 + (r1**2 + r2**2) / 2, rel=1e-11, abs=0)
        assert mean @ z == pytest.approx(HEIGHT / 2, rel=1e-9, abs=0)


def test_the_estimated_error_covers_the_channel_of_a_neighbour():
    """On a coarse mesh, against a fine one: the estimate is between a third of and ten times the true error."""
    geometry = uniform_oxide(20e-6)
    coarse = th.assemble(geometry, 2e-2)
    true = abs(coarse.thermal_resistance("core", "20 um") / Stack().impedance(20e-6) - 1)
    estimated = coarse.mesh_error("core", "20 um")
    assert true / 10 < estimated
    assert true < 3 * estimated
    assert estimated <= 2e-2


def test_the_domain_error_says_what_the_substrate_does(oxide):
    """30 um of silicon over a held bottom against silicon without end: 209.5 and 236 K/W at 20 um."""
    without_end = replace(Stack(), substrate=1e-2).impedance(20e-6)
    expected = without_end / Stack().impedance(20e-6) - 1
    # open sides stand for the rest of the chip to 1e-4 of R_th (docs); here of 8 K/mW, against 0.2 K/mW
    assert oxide.errors("core", "20 um")[1] == pytest.approx(expected, rel=0.05, abs=0)


def test_heater_and_core_of_two_rings_are_reciprocal():
    """Core heated and the neighbour's heater read, or the other way round: the same number, but for the mesh."""
    strip = th.strip_ring(outer_radius=120e-6)
    heater = th.Part("heater", "TiN", 6.955e-6, 8.955e-6, bottom=1.5e-6, height=100e-9, heated=True)
    probes = (th.Probe("other core", "core", distance=25e-6), th.Probe("other heater", "heater", distance=25e-6))
    heat = th.assemble(replace(strip, parts=(*strip.parts, heater), probes=probes))
    there, back = heat.thermal_resistance("core", "other heater"), heat.thermal_resistance("heater", "other core")
    # the copy lacks its silicon and its metal, which moves either way by less than 1e-3 each
    assert there == pytest.approx(back, rel=2e-3, abs=0)


def test_a_neighbour_is_read_in_transients_and_certified_in_reductions():
    strip = th.strip_ring(cladding=1.78e-6, outer_radius=120e-6)
    heat = th.assemble(replace(strip, probes=neighbours(20e-6)))
    # silicon core, by the axisymmetric and by a three-dimensional FEM with silicon in both rings: 203.55 K/W
    assert heat.thermal_resistance("core", "20 um") == pytest.approx(203.55, rel=1e-3, abs=0)
    times = np.geomspace(1e-6, 3e-4, 100)
    wave, read = th.Constant(1e-3), ("core", "20 um")
    data = th.solve(heat, wave, times, read=read)
    assert list(data.probe.values) == list(read)
    settled = data.delta_T.sel(probe="20 um").values[-1] / 1e-3
    assert settled == pytest.approx(heat.thermal_resistance("core", "20 um"), rel=2e-3, abs=0)  # of slow poles left
    rom = surrogate.reduce(heat.channels(read=read), tolerance=1e-4)
    assert rom.channel_bounds.shape == (2, 1)
    assert np.all(rom.channel_bounds <= 1e-4)
    step = rom.model.channel(read="20 um").step_response(times)
    # 1e-4 by the certificate for each frequency, twice that for a monotone step, and 1e-4 of `solve`
    assert step == pytest.approx(data.delta_T.sel(probe="20 um").values / 1e-3, rel=0, abs=3e-4 * settled)
    # half of the final value after about 10.7 us: published for this distance and substrate
    assert np.interp(0.5 * settled, step, times) == pytest.approx(10.7e-6, rel=0.03, abs=0)


TOML = '[[probe]]\nname = "neighbour"\npart = "core"\ndistance = "20 um"\n'


def test_a_probe_off_the_axis_in_toml():
    text = th.strip_ring().to_toml() + TOML
    geometry = th.CrossSection.from_toml_text(text)
    assert geometry.probes == (th.Probe(name="neighbour", part="core", distance=20e-6),)
    assert th.CrossSection.from_toml_text(geometry.to_toml()) == geometry


def with_parts(*parts: th.Part, distance: float = 20e-6, part: str = "core") -> th.CrossSection:
    strip = th.strip_ring()
    return replace(strip, parts=(*strip.parts, *parts), probes=neighbours(distance, part=part))


UNDERCUT = th.Part("undercut", "void", 4e-6, 12e-6, bottom=-12e-6, height=10e-6)
WIDE = th.Part("pad", "Si", 0.0, 14e-6, bottom=1e-6, height=100e-9)
SLAB = th.Part("slab", "Si", 0.0, 60e-6, bottom=-100e-9, height=100e-9)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: th.Probe("n", "core"), "give shell, or distance .*it has neither"),
        (
            lambda: with_parts(distance=10e-6),
            r"distance = 1e-05 must lie between 1.636e-05 and .*overlaps the ring itself",
        ),
        (
            lambda: with_parts(distance=55e-6),
            "distance = 5.5e-05 must lie between .* and 5.182e-05 .*leaves the domain",
        ),
        (lambda: with_parts(UNDERCUT, distance=40e-6), "the void 'undercut' makes the stack laterally not uniform"),
        (lambda: with_parts(WIDE), "distance = 2e-05 must lie between 2.218e-05"),
    ],
)
def test_probes_that_cannot_be_read_are_refused(call, words):
    with pytest.raises(th.InputError, match=words):
        call()


def test_a_part_that_covers_the_domain_is_as_uniform_as_a_layer():
    assert with_parts(SLAB).probes[0].distance == 20e-6
