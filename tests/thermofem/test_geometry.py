"""Cross-sections: volumes and sides of the planar subdivision, what contradicts itself, and the common rings."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import event, given, settings
from sections import CELL, NM, core, on_oxide, random_parts, says

from thermofem.checks import InputError
from thermofem.geometry import CrossSection, disc, heated_ring, rib_ring, strip_ring
from thermofem.geometry.section_parts import OPEN, Boundary, Part, Probe
from thermofem.materials.material_library import Material
from thermofem.mesh import content_hash

ROUND_OFF = 1e-12  # 16 ulps of the largest coordinate (60 um) over the smallest thickness (100 nm), 2e-16 * 16 * 600
# pytest.approx allows 1e-12 beside rel unless abs=0 is said: more than any volume in m^3 here


def ring_volume(radius, width, height):
    return 2 * math.pi * radius * width * height


def test_strip_ring_volumes_are_those_of_hollow_cylinders():
    volumes = strip_ring().volumes()
    core = ring_volume(7.955e-6, 450e-9, 220e-9)
    disc = math.pi * (60e-6) ** 2
    expected = {"substrate": disc * 30e-6, "box": disc * 2e-6, "cladding": disc * 2.22e-6 - core, "core": core}
    assert list(volumes) == list(expected)
    assert volumes == pytest.approx(expected, rel=ROUND_OFF, abs=0)


# --- the planar subdivision -------------------------------------------------------------------------------------------


def test_a_trapezoid_keeps_its_width_at_half_height():
    part = core(sidewall_angle=math.radians(60))
    lean = 200e-9 / math.tan(math.radians(60))
    foot, top = part.outline()[:2], part.outline()[2:]
    assert foot == pytest.approx(np.array([(1e-6 - lean, 0), (2e-6 + lean, 0)]), abs=1e-18)
    assert top == pytest.approx(np.array([(2e-6 - lean, 400e-9), (1e-6 + lean, 400e-9)]), abs=1e-18)
    # symmetric about its centre line: the volume is that of the rectangle (Pappus)
    assert on_oxide(part).volumes()["core"] == pytest.approx(ring_volume(1.5e-6, 1e-6, 400e-9), rel=ROUND_OFF, abs=0)


def test_a_tilted_disc_is_a_truncated_cone():
    part = core(inner_radius=0.0, sidewall_angle=math.radians(60))
    foot, top = part.outline()[1, 0], part.outline()[2, 0]
    cone = math.pi * 400e-9 / 3 * (foot**2 + foot * top + top**2)
    assert on_oxide(part).volumes()["core"] == pytest.approx(cone, rel=ROUND_OFF, abs=0)


def test_hidden_outlines_do_not_cut_what_hides_them():
    geometry = on_oxide(core(), Part("metal", "Al", 1.5e-6, 3e-6, bottom=200e-9, height=400e-9))
    assert sorted(face.owner for face in geometry.subdivision.faces) == ["bulk", "core", "metal", "oxide", "top"]


def test_a_void_takes_its_volume_away_and_leaves_walls():
    hole = Part("hole", "void", 2.5e-6, 3e-6, bottom=-1e-6, height=500e-9)
    geometry = on_oxide(core(), hole)
    full = on_oxide(core()).volumes()
    assert geometry.region_names == ("bulk", "oxide", "top", "core")
    assert geometry.volumes()["oxide"] == pytest.approx(
        full["oxide"] - ring_volume(2.75e-6, 500e-9, 500e-9), rel=ROUND_OFF, abs=0
    )
    assert geometry.on_boundary("wall", [2.75e-6, 2.5e-6, 2.5e-6], [-1e-6, -0.7e-6, 0.5e-6]).tolist() == [1, 1, 0]


def test_a_trench_open_to_the_top_has_walls_too():
    geometry = on_oxide(core(), Part("trench", "void", 2.5e-6, 3e-6, bottom=-1e-6, height=3e-6))
    assert geometry.on_boundary("wall", [2.5e-6, 2.75e-6], [0.5e-6, -1e-6]).all()
    assert geometry.on_boundary("top", [1e-6, 2.75e-6], [1e-6, 1e-6]).tolist() == [True, False]


def test_a_part_on_the_stack_belongs_to_the_top():
    geometry = on_oxide(core(), Part("heater", "TiN", 1e-6, 2e-6, bottom=1e-6, height=100e-9))
    assert geometry.volumes()["heater"] == pytest.approx(ring_volume(1.5e-6, 1e-6, 100e-9), rel=ROUND_OFF, abs=0)
    # left of it, its side, its roof; beneath it the stack's surface is inside
    r, z = [0.5e-6, 1e-6, 1.5e-6, 1.5e-6], [1e-6, 1.05e-6, 1.1e-6, 1e-6]
    assert geometry.on_boundary("top", r, z).tolist() == [True, True, True, False]
    assert geometry.top_z == 1e-6


def test_a_bridge_encloses_air_with_insulated_walls():
    posts = [Part(f"post{k}", "Al", r, r + 200e-9, bottom=1e-6, height=200e-9) for k, r in enumerate((1e-6, 2e-6))]
    deck = Part("deck", "Al", 1e-6, 2.2e-6, bottom=1.2e-6, height=100e-9)
    geometry = on_oxide(core(), *posts, deck)
    assert geometry.on_boundary("wall", [1.5e-6, 1.5e-6], [1e-6, 1.2e-6]).all()
    assert geometry.on_boundary("top", [1.5e-6, 1.5e-6], [1e-6, 1.3e-6]).tolist() == [False, True]


def test_sides_cover_the_outline_of_the_stack():
    geometry = on_oxide(core())
    r, z = [0, 4e-6, 2e-6, 2e-6, 2e-6], [0.5e-6, 0.5e-6, -3e-6, 1e-6, 0.0]
    for k, side in enumerate(("axis", "outer", "bottom", "top")):
        assert geometry.on_boundary(side, r, z).tolist() == [j == k for j in range(5)]
    with pytest.raises(InputError, match="side = 'botom' is unknown; did you mean 'bottom'"):
        geometry.on_boundary("botom", 0, 0)


def painted_volumes(geometry):
    """The same volumes by painting cells of 50 nm one after the other."""
    r = (np.arange(80) + 0.5) * CELL
    z = (np.arange(-60, 20) + 0.5) * CELL
    owner = np.full((r.size, z.size), "", dtype=object)
    for layer, low, high in zip(geometry.layers, geometry.layer_edges, geometry.layer_edges[1:], strict=False):
        owner[:, (z > low / NM) & (z < high / NM)] = layer.name
    for part in geometry.parts:
        inside_r = (r > part.inner_radius / NM) & (r < part.outer_radius / NM)
        owner[np.ix_(inside_r, (z > part.bottom / NM) & (z < part.top / NM))] = part.name
    cell = np.broadcast_to(2 * np.pi * r[:, None] * NM * (CELL * NM) ** 2, owner.shape)
    solid = {layer.name for layer in geometry.layers} | {p.name for p in geometry.parts if p.material != "void"}
    return {name: cell[owner == name].sum() for name in set(owner.ravel().tolist()) & solid}


@given(random_parts())
@settings(max_examples=40, deadline=None)
def test_any_overlap_gives_the_volumes_of_painting(parts):
    try:
        geometry = on_oxide(*parts)
    except InputError:  # a later part covers an earlier one, or voids cut a piece off
        event("refused")
        return
    event("cut")
    assert geometry.volumes() == pytest.approx(painted_volumes(geometry), rel=ROUND_OFF, abs=0)


# --- what cannot be ---------------------------------------------------------------------------------------------------


MOAT = Part("moat", "void", 0.0, 4e-6, bottom=-1.5e-6, height=500e-9)
LID = Part("lid", "Al", 0.0, 3e-6, bottom=-1e-6, height=2e-6)
FILM = Part("film", "Al", 0.0, 4e-6, bottom=-5e-11, height=1e-9)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: strip_ring(width=0.45), ["width = 0.45 m is larger than radius = 7.955e-06 m", "450e-9?"]),
        (lambda: strip_ring(radius=59.9e-6), ["part 'core' reaches r = 6.0125e-05 m", "outer_radius"]),
        (lambda: strip_ring(height=0.22), ["height = 0.22", "did you mean 220e-9?"]),
        (lambda: strip_ring(cladding=2.0), ["cladding = 2", "did you mean 2e-6?"]),
        (lambda: strip_ring(box=-2e-6), ["box = -2e-06 must lie between 1e-10 and 0.1 (in m)"]),
        (lambda: strip_ring(width=math.nan), ["width = nan is not finite"]),
        (lambda: strip_ring(width="450 nm"), ["width = '450 nm' is not a number"]),
        (lambda: rib_ring(slab=220e-9), ["height"]),
        (lambda: rib_ring(slab_width=100e-9), ["slab_width"]),
        (lambda: disc(rim=5e-6), ["outer_radius"]),
        (lambda: heated_ring(heater_width=20e-6), ["heater: width = 2e-05 m is larger"]),
        (lambda: core(inner_radius=2e-6), ["'core': inner_radius = 2e-06 must be below outer_radius = 2e-06"]),
        (lambda: core(outer_radius=1.1e-6, height=1e-6, sidewall_angle=1.0), ["'core'", "the sidewalls cross"]),
        (lambda: replace(MOAT, heated=True), ["part 'moat': void cannot be heated"]),
        (lambda: on_oxide(core(), LID), ["'core' is wholly covered by 'lid'"]),
        (lambda: on_oxide(core(), MOAT), ["'core'", "cut off from the stack by the void 'moat'", "no way out"]),
        (lambda: on_oxide(core(bottom=2e-6)), ["'core'", "outside the stack, which 'top' ends at z = 1e-06 m"]),
        (lambda: on_oxide(core(height=1e-6 - 5e-11)), ["'top' has a sliver of 5e-11 m", "of 'top' and 'core'"]),
        (lambda: on_oxide(core(), FILM), ["sliver of 5e-11 m", "outlines of 'oxide' and 'top' and 'film' agree"]),
        (lambda: Boundary("convection"), ["convection = 0 must be positive"]),
        (lambda: Material("void", 1.0, 1.0, 1.0), ["void"]),
        (lambda: disc().with_({"part.disc.radius": 5e-6}), ["is a disc"]),
        (lambda: Probe("near", "core", 0.3), ["shell = 0.3", "did you mean 300e-9"]),
        (lambda: replace(strip_ring(), probes=(Probe("near", "cor", 3e-7),)), ["did you mean 'core'"]),
        (lambda: replace(strip_ring(), probes=(Probe("box", "core", 3e-7),)), ["probes holds 'box' twice"]),
        (lambda: replace(strip_ring(), top=OPEN), ["only bottom and outer can be open"]),
    ],
)
def test_contradictions_name_what_contradicts(call, words):
    with pytest.raises(InputError) as error:
        call()
    says(error, *words)


def test_pieces_that_touch_in_a_chain_hold_each_other():
    """A tower on the stack, its parts in an order that mixes them: each touches only its neighbours."""
    floors = [core(bottom=1e-6 + k * 400 * NM, heated=False) for k in range(5)]
    tower = [replace(floors[k], name=f"t{k}") for k in (0, 3, 1, 4, 2)]
    assert len(on_oxide(core(), *tower).region_names) == 9
    with pytest.raises(InputError, match="touches no side"):
        on_oxide(core(), *(part for part in tower if part.name != "t1"))


# --- common rings, probes, open sides ---------------------------------------------------------------------------------


def test_common_rings_are_valid_and_hold_what_they_say():
    rib, disc_, heated = rib_ring(), disc(), heated_ring()
    assert rib.volumes()["slab"] == pytest.approx(ring_volume(7.955e-6, 4e-6, 90e-9), rel=ROUND_OFF, abs=0)
    assert rib.volumes()["core"] == pytest.approx(ring_volume(7.955e-6, 500e-9, 130e-9), rel=ROUND_OFF, abs=0)
    silicon = disc_.volumes()["core"] + disc_.volumes()["disc"]
    assert silicon == pytest.approx(math.pi * (5e-6) ** 2 * 220e-9, rel=ROUND_OFF, abs=0)
    assert heated.volumes()["heater"] == pytest.approx(ring_volume(7.955e-6, 2e-6, 100e-9), rel=ROUND_OFF, abs=0)
    for geometry in (rib, disc_, heated):
        assert CrossSection.from_toml_text(geometry.to_toml()) == geometry


def test_a_void_of_zero_height_changes_nothing():
    nothing = Part("nothing", "void", 1.2e-6, 3e-6, bottom=100e-9, height=0.0)
    with_it, without = on_oxide(core(), nothing), on_oxide(core())
    assert with_it.volumes() == without.volumes()
    assert CrossSection.from_toml_text(with_it.to_toml()) == with_it
    assert content_hash(with_it, 1e-3) == content_hash(without, 1e-3)  # the same mesh, so the same numbers
    with pytest.raises(InputError, match="height = 0 must lie between"):
        replace(nothing, material="Al")
