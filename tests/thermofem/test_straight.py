"""Straight sections against the exact layered line source, a line source on a half space, and themselves."""

from dataclasses import replace

import check_femwell_guide as femwell_guide
import numpy as np
import pytest

import thermofem as th

# exact step response in K/W (shared table, Fourier in x and Laplace in t, trusted to 1e-5): core of 450 x 220 nm with
# oxide's properties, 2 um of oxide above and below, L = 320 um, on a silicon half space
TIMES = np.array([1e-9, 1e-8, 1e-7, 1e-6, 3e-6, 1e-5, 3e-5])
EXACT = np.array([17.265881, 117.869696, 412.890674, 809.796541, 1007.310302, 1212.724652, 1304.204651])
GUIDE = """
name = "line source"
kind = "straight"
length = "320 um"
half_width = "300 um"
layer = [
    { name = "substrate", material = "Si", thickness = "300 um" },
    { name = "box", material = "SiO2", thickness = "2 um", datum = true },
    { name = "cladding", material = "SiO2", thickness = "2.22 um" },
]
[[part]]
name = "core"
material = "SiO2"
x = "0 um"
width = "450 nm"
bottom = "0 um"
height = "220 nm"
heated = true
[material.Si]
conductivity = "148 W/m/K"
density = "2330 kg/m^3"
specific_heat = "711 J/kg/K"
[material.SiO2]
conductivity = "1.38 W/m/K"
density = "2203 kg/m^3"
specific_heat = "709 J/kg/K"
"""


@pytest.fixture(scope="module")
def guide():
    return th.CrossSection.from_toml_text(GUIDE)


def bars(*places, width=2e-6):
    return [th.Part(f"bar{k}", "void", x=x, width=width, bottom=-2e-6, height=4.22e-6) for k, x in enumerate(places)]


@pytest.mark.parametrize("accuracy", [1e-3, 1e-4])
@pytest.mark.parametrize("x", [0.0, 1e-6])  # the half of a mirrored section, and a whole one
def test_exact_line_source(guide, accuracy, x):
    heat = th.assemble(guide.with_({"part.core.x": x}), accuracy)
    data = th.solve(heat, th.Constant(1.0), times=np.append(0.0, TIMES), rtol=accuracy / 10)
    # the domain ends 300 um away: heat has spread over 100 um after 30 us, which leaves 1e-5
    np.testing.assert_allclose(data.delta_T[1:], EXACT, rtol=accuracy)


def test_file_and_python_say_the_same(guide):
    core = th.Part("core", "SiO2", x=0.0, width=450e-9, bottom=0.0, height=220e-9, heated=True)
    made = th.CrossSection(
        "line source",
        kind="straight",
        length=320e-6,
        half_width=300e-6,
        layers=guide.layers,
        parts=(core,),
        materials=guide.materials,
    )
    assert made == guide == th.CrossSection.from_toml_text(guide.to_toml())
    assert guide.with_({"length": "160 um"}).length == 160e-6
    assert guide.volumes()["core"] == pytest.approx(320e-6 * 450e-9 * 220e-9, rel=1e-12, abs=0)


def test_half_equals_whole(guide):
    """A mirrored section is solved on its half; one that is a nanometre off, on the whole."""
    trenches = replace(guide, parts=(*guide.parts, *bars(-4e-6, 4e-6)))
    assert guide.mirrored
    assert trenches.mirrored
    for geometry in (guide, trenches):
        whole = geometry.with_({"part.core.x": 1e-9})
        assert not whole.mirrored
        half, whole = (th.assemble(g, 1e-4) for g in (geometry, whole))
        assert half.unknowns < whole.unknowns
        # each within its accuracy
        assert half.thermal_resistance() == pytest.approx(whole.thermal_resistance(), rel=2e-4)


def test_resistance_per_length_is_that_of_a_large_ring():
    """Around a ring of 2 mm the section is straight: its curvature is 60 um/2 mm squared of the far field's share."""
    radius, half = 2e-3, 40e-6
    ring = th.strip_ring(radius=radius, outer_radius=radius + half)
    inside = th.Part("inside", "void", 0.0, radius - half, bottom=ring.bottom_z, height=ring.top_z - ring.bottom_z)
    ring = replace(ring, parts=(inside, *ring.parts))
    guide = th.straight_guide(length=2 * np.pi * radius, half_width=half)
    R = [th.assemble(g, 1e-4).thermal_resistance() for g in (ring, guide)]
    assert R[0] == pytest.approx(R[1], rel=4e-4)


def test_open_sides_of_a_uniform_half_space():
    """R of a uniform line on a half space, averaged over its length: the wider domain with ends has it.

    The mean over a core of half side a is that of a line at a distance of 0.59 a times 2 (square of side 2 a: geometric
    mean distance 0.44705 times the side): [ln(2 L/d) - 1]/(pi k L) with d = 0.44705 side. An image above the surface
    makes the heated core at the surface one of twice the height.
    """
    L, side, k = 300e-6, 2e-6, 148.0
    core = th.Part("core", "Si", x=0.0, width=side, bottom=-side / 2, height=side / 2, heated=True)
    material = th.Material("Si", k, 2330.0, 711.0, source="test")
    for domain in (20e-6, 60e-6):
        base = th.CrossSection(
            "half space",
            kind="straight",
            length=L,
            half_width=domain,
            layers=(th.Layer("substrate", "Si", domain, datum=True),),
            parts=(core,),
            materials=(material,),
        )
        heat = th.assemble(base.opened(), 1e-4)
        exact = (np.log(2 * L / (0.44705 * side)) - 1) / (np.pi * k * L)
        R, error = heat.thermal_resistance(), heat.domain_error()
        # without ends R is too large by what the error says; coarse elements beyond the domain leave 5e-3
        assert R / exact - 1 == pytest.approx(error, abs=5e-3)
        assert 0 < error < 0.06
        closed = th.assemble(base, 1e-3)
        assert closed.thermal_resistance() * (1 + closed.domain_error()) == pytest.approx(exact, rel=5e-3)


@pytest.mark.parametrize(
    ("path", "value", "step", "within"),
    [
        ("part.core.width", 450e-9, 2e-8, 2e-3),
        ("half_width", 30e-6, 1e-6, 2e-3),
        ("part.bar1.x", 4e-6, 2e-8, 2e-3),
        ("part.core.x", 1e-6, 2e-7, 5e-3),
    ],
)
def test_derivatives_of_open_sections(path, value, step, within):
    """Against differences of two meshes, whose noise over the step leaves less than 1e-4, and the step's square."""
    core = th.Part("core", "Si", x=0.0, width=450e-9, bottom=0.0, height=220e-9, heated=True)
    base = th.straight_guide(substrate=30e-6, half_width=30e-6).opened()
    geometry = replace(base, parts=(core, *bars(-4e-6, 4e-6, width=1e-6))).with_({path: value})
    found = float(th.derivatives(th.assemble(geometry, 1e-4), [path]).thermal_resistance[0])
    R = [th.assemble(geometry.with_({path: value + s * step}), 1e-4).thermal_resistance() for s in (1, -1)]
    assert found == pytest.approx((R[0] - R[1]) / (2 * step), rel=within)


# mean rise in K/W over the heated length of a finite guide of silicon in three dimensions: NGSolve, 1.5e5 unknowns
# (`benchmarks/check_finite_guide.py`, elements of order 2): 4e-4 too low by its mesh in x and z
FINITE = {10e-6: 28324.4, 40e-6: 9033.43, 100e-6: 3790.58, 320e-6: 1214.81}


@pytest.mark.parametrize("length", FINITE)
def test_ends_of_a_finite_guide(guide, length):
    """The section lacks what leaves through the ends: 3 um of the length, as the docs say; `domain_error` bounds it."""
    change = {"part.core.material": "Si", "half_width": 60e-6, "layer.substrate.thickness": 60e-6, "length": length}
    heat = th.assemble(guide.with_(change).opened(), 1e-3)
    R, lost = heat.thermal_resistance(), 1 - FINITE[length] / heat.thermal_resistance()
    assert lost * length == pytest.approx(3.0e-6, rel=0.1)  # 2.7 to 3.2 um
    assert R / (1 + heat.domain_error()) < FINITE[length] < R


def test_a_short_open_guide_is_told_of_its_ends(guide, caplog):
    """Open sides that move outwards change nothing."""
    short = guide.with_({"length": "30 um", "half_width": "60 um", "name": "short"}).opened()
    th.solve(th.assemble(short), th.Constant(1.0), [1e-6])
    assert "the ends of the guide" in caplog.text
    assert "outwards" not in caplog.text


# rises of core and heater in K/W at rest and after 1, 3 and 10 us by femwell 0.1.12 (`check_femwell_guide.py`)
FEMWELL = {
    "core": [330.624846, 20.33663, 123.58469, 277.47204],
    "heater": [1228.769133, 459.12489, 768.81823, 1110.97787],
}


@pytest.mark.parametrize("read", FEMWELL)
def test_section_of_femwell(read):
    heat = th.assemble(th.CrossSection.from_toml_text(femwell_guide.SECTION), 1e-3)
    data = th.solve(heat, th.Constant(1.0), [0.0, *femwell_guide.TIMES], heated="heater", read=read, rtol=1e-5)
    rest, *steps = FEMWELL[read]
    # the same elements on the same mesh; it moves by less than 1e-6 with the version of the mesh generator
    assert heat.thermal_resistance("heater", read) == pytest.approx(rest, rel=1e-5)
    # femwell's linear elements, extrapolated, leave a few 1e-4 of the step
    np.testing.assert_allclose(data.delta_T[1:], steps, rtol=5e-4)


def test_undercut_bridge(guide):
    """A guide over a wide void is a bar that conducts to its two ends: R = w^2 shape/(k h L), exact for a plate.

    A film of width 2 a and thickness h, heated evenly over its middle 2 b and held at both ends by the chip: the mean
    over the middle is (a - b)/(2 k h L) + b/(6 k h L).
    """
    a, b, h, L = 20e-6, 5e-6, 0.5e-6, 100e-6
    layers = (th.Layer("film", "SiO2", h, datum=True),)
    core = th.Part("core", "SiO2", x=0.0, width=2 * b, bottom=-h, height=h, heated=True)
    bridge = th.CrossSection(
        "bridge",
        kind="straight",
        length=L,
        half_width=a,
        layers=layers,
        parts=(core,),
        bottom=th.Boundary("insulated"),
        outer=th.Boundary("isothermal"),
    )
    exact = ((a - b) / 2 + b / 6) / (1.38 * h * L)
    assert th.assemble(bridge, 1e-4).thermal_resistance() == pytest.approx(exact, rel=1e-4)


def test_neighbour_of_a_straight_guide(guide):
    """A copy at a distance reads what a part of oxide at that place reads."""
    probe = th.Probe(name="beside", part="core", distance=10e-6)
    heat = th.assemble(replace(guide, probes=(probe,)), 1e-4)
    other = th.Part("other", "SiO2", x=10e-6, width=450e-9, bottom=0.0, height=220e-9)
    part = th.assemble(replace(guide, parts=(*guide.parts, other)), 1e-4)
    assert heat.thermal_resistance("core", "beside") == pytest.approx(
        part.thermal_resistance("core", "other"), rel=3e-4
    )


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"kind": "bent"}, "kind"),
        ({"length": None}, "length"),
        ({"length": 320.0}, "length"),
        ({"parts": (th.Part("core", "Si", 1e-6, 2e-6, 0.0, 220e-9, heated=True),)}, "core"),
        ({"kind": "ring", "outer_radius": 60e-6, "length": None, "half_width": None}, "core"),
        ({"half_width": 0.1e-6}, "half_width"),
    ],
)
def test_what_cannot_be(guide, change, name):
    with pytest.raises(th.InputError, match=name):
        replace(guide, **change)
