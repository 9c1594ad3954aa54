"""Cross-sections from gdsfactory, with the real package and its generic PDK."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from functools import partial

import pytest
from paths import ROOT

import surrogate
import thermofem as th

gf = pytest.importorskip("gdsfactory", reason="gdsfactory is not installed here; `make gdsfactory` runs these tests")


# a block of the documentation that the other tests leave out, and the output that stands below it
PRINTED = re.compile(
    r"<!-- not run: gdsfactory.*-->\n```python\n((?:.*\n)*?)```\n\n<!--.*-->\n```text\n((?:.*\n)*?)```"
)


@pytest.fixture(scope="module", autouse=True)
def pdk():
    from gdsfactory.gpdk import PDK

    PDK.activate()


def test_a_ring_on_the_generic_stack():
    """Levels and widths are those printed by gdsfactory 9: 10 um Si, 3 um SiO2, 0.22 um core at 10 deg, 3 um clad."""
    ring = th.from_gdsfactory(gf.components.ring_double(radius=8))
    assert [(layer.name, layer.material) for layer in ring.layers] == [
        ("substrate", "Si"),
        ("box", "SiO2"),
        ("clad", "SiO2"),
    ]
    assert [layer.thickness for layer in ring.layers] == pytest.approx([10e-6, 3e-6, 3e-6])
    (core,) = ring.parts
    assert (core.name, core.material, core.heated) == ("core", "Si", True)
    assert core.outer_radius - core.inner_radius == pytest.approx(
        0.5e-6, rel=1e-6, abs=0
    )  # width_to_z = 0.5: given at half height
    assert (core.bottom, core.height) == pytest.approx((0, 0.22e-6), rel=1e-6, abs=1e-15)
    assert math.degrees(core.sidewall_angle) == pytest.approx(80)


def test_the_radius_is_that_of_the_circle_as_long_as_the_racetrack():
    bend = gf.components.bend_circular(radius=8).info["length"]
    assert bend == pytest.approx(math.pi * 4, rel=1e-3)  # gdsfactory's own length of a quarter circle, on a 1 nm grid
    ring = th.from_gdsfactory(gf.components.ring_double(radius=8, length_x=3, length_y=1, bend="bend_circular"))
    (core,) = ring.parts
    middle = (core.inner_radius + core.outer_radius) / 2
    assert 2 * math.pi * middle == pytest.approx((2 * math.pi * 8 + 2 * 3 + 2 * 1) * 1e-6, rel=1e-3)


def test_a_heater_and_a_slab_become_parts():
    heated = th.from_gdsfactory(gf.components.ring_double_heater(radius=10))
    parts = {part.name: part for part in heated.parts}
    heater = parts["heater"]
    assert (heater.material, heater.heated) == ("TiN", True)
    assert heater.outer_radius - heater.inner_radius == pytest.approx(2.5e-6, rel=1e-6, abs=0)
    assert (heater.bottom, heater.height) == pytest.approx((1.1e-6, 0.75e-6), rel=1e-6, abs=0)
    rib = th.from_gdsfactory(gf.components.ring_single(radius=10, cross_section="rib"))
    assert [part.name for part in rib.parts] == ["slab90", "core"]
    assert rib.parts[0].height == pytest.approx(90e-9, rel=1e-6, abs=0)


def test_the_result_solves(needs_mesher):
    """Like a strip of the same size with vertical walls: a wall of 80 deg moves 4 % of the core by 20 nm."""
    heat = th.assemble(th.from_gdsfactory(gf.components.ring_double(radius=8, bend="bend_circular")))
    similar = th.assemble(th.strip_ring(8e-6, 500e-9, box=3e-6, cladding=2.78e-6, substrate=10e-6).opened())
    assert heat.thermal_resistance("core") == pytest.approx(similar.thermal_resistance("core"), rel=0.01)


@pytest.mark.parametrize("page", ["geometry", "answers"])
def test_the_blocks_of_the_documentation_run_in_a_process_of_their_own(page, needs_mesher):
    """A process has no active PDK before the block makes one so."""
    text = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
    ((block, output),) = PRINTED.findall(text)
    done = subprocess.run([sys.executable, "-c", block], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    number, words = done.stdout.split(maxsplit=1)
    printed, printed_words = output.split(maxsplit=1)
    assert words == printed_words
    assert float(number) == pytest.approx(float(printed), abs=0.0151)  # the last digit, and the mesh's 1e-3


@pytest.mark.parametrize(
    ("component", "options", "reason"),
    [
        ("straight", {"core": "cor"}, "did you mean 'core'"),
        ("mmi1x2", {"background": ("substrate", "clad")}, "must touch"),
        ("ring_single", {"background": ("substrate", "box", "clads")}, "did you mean 'clad'"),
    ],
)
def test_bad_input_is_refused(component, options, reason):
    with pytest.raises(th.InputError, match=reason):
        th.from_gdsfactory(getattr(gf.components, component)(), **options)


@pytest.mark.parametrize(
    ("count", "names"),
    [
        (0, "straight mmi1x2 bend_euler spiral disk disk_heater coupler coupler_ring"),
        (2, "ring_single_array"),
        (3, "ring_crow"),
    ],
)
def test_a_component_that_is_no_ring_is_refused(count, names):
    """It is no ring of the radius of its cross-section; neither is a coupler."""
    for name in names.split():
        with pytest.raises(th.InputError, match=f"component has {count} closed waveguides on layer WG"):
            th.from_gdsfactory(getattr(gf.components, name)())


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("ring_single", {}),
        ("ring_single", {"cross_section": "rib"}),
        ("ring_double", {"radius": 5}),
        ("ring_single_heater", {}),
        ("ring_asymmetric", {}),
        ("ring_double_pn", {}),
    ],
)
def test_rings_with_buses_and_couplers_are_taken(name, options):
    assert th.from_gdsfactory(getattr(gf.components, name)(**options)).parts[-1].name == "core"


def test_another_width_is_a_registered_cross_section():
    """An object or a partial is refused in one line."""
    narrow = partial(gf.cross_section.strip, width=0.45)
    for given in (narrow, narrow()):
        with pytest.raises(th.InputError, match=r"^cross_section of the component = .* register it first"):
            th.from_gdsfactory(gf.components.ring_single(cross_section=given))
    gf.get_active_pdk().register_cross_sections(narrow=narrow)
    (core,) = th.from_gdsfactory(gf.components.ring_single(cross_section="narrow")).parts
    assert core.outer_radius - core.inner_radius == pytest.approx(0.45e-6, rel=1e-6, abs=0)


@gf.cell
def bank(name="", label=""):
    """Two racetracks with heaters, 80 um apart, as gdsfactory's own instances."""
    component = gf.Component()
    for number in range(2):
        options = {"name": f"{name} {number + 1}"} if name else {}
        ring = component.add_ref(gf.components.ring_double_heater(radius=10, bend="bend_circular"), **options)
        ring.move((80 * number, 0))
    if label:
        component.add_label(label, position=(0, 20.7), layer=(1, 0))
    return component


def test_a_component_with_several_rings_is_a_layout(caplog):
    """gdsfactory draws bends of 10 um with 2 and 0.01 um between them, guides of 0.5 um and heaters of 2.5 um."""
    layout = th.read_layout(bank(name="filter"))
    assert [shape.name for shape in layout] == ["filter 1", "filter 2", "filter 1 heater", "filter 2 heater"]
    ring, other, heater, _ = layout
    settings = gf.components.ring_double_heater().settings
    length = 2 * math.pi * 10 + 2 * settings["length_x"] + 2 * settings["length_y"]
    # 2e-3: polygons on a grid of 1 nm
    assert ring.length == pytest.approx(length * 1e-6, rel=2e-3)
    assert ring.width == pytest.approx(0.5e-6, abs=2e-9)
    assert other.centre[0] - ring.centre[0] == pytest.approx(80e-6, abs=1e-9)
    # 4 %: the ends with their contacts are wider
    assert heater.width == pytest.approx(2.5e-6, rel=0.04)
    section = ring.section
    assert [layer.name for layer in section.layers] == ["substrate", "box", "clad"]
    assert [(part.name, part.bottom) for part in section.parts] == [("core", 0.0), ("heater", pytest.approx(1.1e-6))]
    assert "also draws via1" in caplog.text


def test_shapes_of_a_component_are_named_by_labels_else_by_cells():
    names = [shape.name for shape in th.read_layout(bank(label="left"))]
    cell = "ring_double_heater"
    assert names == ["left", cell, "left heater", f"{cell} heater"]


def test_layers_of_a_component_may_be_given(needs_mesher):
    """With a section of one's own; and the layout is reduced: the rise of the other ring on an endless substrate."""
    component = bank(name="filter")
    section = th.straight_guide(width=500e-9).opened()
    layout = th.read_layout(component, layers={"core": (1, 0)}, section=section)
    gain = surrogate.reduce_layout(layout).model.gain
    # a point on silicon, 1/(2 pi k d); 3 %: rings of 10 um (1 %), and oxide that spreads heat
    assert gain[0, 1] == pytest.approx(1 / (2 * math.pi * 130 * 80e-6), rel=0.03)
    with pytest.raises(th.InputError, match="no polygon on layer"):
        th.read_layout(component, layers={"core": (77, 0)}, section=section)
    with pytest.raises(th.InputError, match="path"):
        th.read_layout(3)
    with pytest.raises(th.InputError, match="read_layout"):
        th.from_gdsfactory(component)


def test_an_unknown_material_is_named():
    stack = gf.get_active_pdk().layer_stack.model_copy(deep=True)
    stack.layers["core"].material = "unobtainium"
    with pytest.raises(th.InputError, match="unobtainium"):
        th.from_gdsfactory(gf.components.ring_single(), stack)
    assert th.from_gdsfactory(gf.components.ring_single(), stack, materials={"unobtainium": "Si"}).parts


def test_without_gdsfactory_the_message_says_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "gdsfactory", None)
    with pytest.raises(th.checks.MissingLibraryError, match="pip install"):
        th.from_gdsfactory(None)
