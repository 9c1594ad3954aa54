"""Layouts from files: [[shape]] tables, GDS polygons of gdstk, the commands reduce and show, and bad files."""

import json

import commands
import numpy as np
import pytest
from layouts import CHIP

import surrogate
import thermofem as th

GUIDE = th.straight_guide(substrate=20e-6)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("layout")
    (folder / "chip.toml").write_text(CHIP)
    return folder


def test_a_geometry_file_with_shapes_is_a_layout(folder):
    shapes = th.read_layout(folder / "chip.toml")
    assert [shape.name for shape in shapes] == ["ring 1", "heater 1", "ring 2", "strip"]
    assert shapes[2].centre == pytest.approx((24e-6, 0.0), abs=1e-12)
    assert shapes[3].width == pytest.approx(2e-6)


def answer(*arguments, cwd):
    run = commands.thermofem(*arguments, "--json", cwd=cwd)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def test_commands_take_a_layout(folder):
    made = answer("reduce", "chip.toml", "-o", "chip.json", cwd=folder)
    layout = surrogate.reduce_layout(th.read_layout(folder / "chip.toml"))
    np.testing.assert_allclose(made["thermal_resistance"], layout.crosstalk, rtol=1e-9)
    shown = answer("show", "chip.json", "--figure", "map.png", cwd=folder)
    np.testing.assert_allclose(shown["half_times"], layout.half_times, rtol=1e-9)
    assert (folder / "map.png").stat().st_size > 10_000


def gds(folder, *, labels=True):
    """A file with a ring, a bus beside it, and a strip on another layer, drawn by gdstk itself."""
    import gdstk

    cell = gdstk.Cell("TOP")
    cell.add(gdstk.ellipse((20, 3), 5.225, inner_radius=4.775, layer=1, tolerance=1e-4))
    cell.add(gdstk.rectangle((10, 8.425), (30, 8.875), layer=1))
    cell.add(gdstk.rectangle((27, -5), (29, 5), layer=11), gdstk.rectangle((27, 5), (29, 9), layer=11))
    if labels:
        cell.add(gdstk.Label("left ring", (20, 3), layer=10))
    library = gdstk.Library()
    library.add(cell)
    path = folder / f"chip-{labels}.gds"
    library.write_gds(path)
    return path


def test_a_gds_file_is_a_layout(folder):
    """The polygon of a ring is the ring that Python draws; pieces that touch are one; the bus is left out."""
    section = th.CrossSection.from_toml_text(CHIP.split("[[shape]]")[0])
    layers = {"core": (1, 0), "heater": (11, 0)}
    ring, strip = th.read_layout(gds(folder), layers=layers, section=section)
    assert (ring.name, strip.name) == ("left ring", "heater 1")
    # 2e-9: the grid of the file is 1 nm
    assert ring.length == pytest.approx(2 * np.pi * 5e-6, rel=2e-3)
    assert ring.width == pytest.approx(450e-9, abs=2e-9)
    assert strip.length == pytest.approx(14e-6, rel=1e-6)
    drawn = th.racetrack("ring", section, radius=5e-6, straight=0.0, at=(20e-6, 3e-6))
    gain = [surrogate.reduce_layout([shape]).model.gain[0, 0] for shape in (ring, drawn)]
    # 2e-3: the width on a grid of 1 nm, and circumference of the polygon
    assert gain[0] == pytest.approx(gain[1], rel=2e-3)
    numbered = th.read_layout(gds(folder, labels=False), layers={"core": (1, 0)}, section=section)
    assert [shape.name for shape in numbered] == ["core 1"]


def test_a_layout_file_names_a_gds_file(folder):
    path = gds(folder)
    text = CHIP.split("[[shape]]")[0] + f'[gds]\nfile = "{path.name}"\nlayers = {{ core = [1, 0], heater = [11, 0] }}\n'
    (folder / "drawn.toml").write_text(text)
    assert [shape.name for shape in th.read_layout(folder / "drawn.toml")] == ["left ring", "heater 1"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('radius = "5 um"', 'radius = "5 kg"', "kg"),
        ('radius = "5 um"', 'radius = "2 um"', "below 3e-06 m"),
        ('at = ["24 um", "0 um"]', 'at = ["24 um"]', "at has shape"),
        ('part = "heater"', 'part = "hater"', "hater"),
        ('name = "strip"', 'name = "strip"\nat = ["1 um", "1 um"]', "at belongs to a racetrack"),
        ('name = "strip"', 'nam = "strip"', "nam"),
        ('kind = "straight"', 'kind = "ring"', "length"),
    ],
)
def test_bad_layout_files_are_refused_in_one_line(tmp_path, old, new, message):
    (tmp_path / "bad.toml").write_text(CHIP.replace(old, new))
    with pytest.raises(th.InputError) as refused:
        th.read_layout(tmp_path / "bad.toml")
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_bad_gds_files_are_refused_in_one_line(folder, tmp_path):
    (tmp_path / "bad.gds").write_bytes(b"no GDS at all")
    for path, layers, message in (
        (tmp_path / "bad.gds", {"core": (1, 0)}, "no GDS file"),
        (tmp_path / "missing.gds", {"core": (1, 0)}, "missing.gds"),
        (gds(folder), {"core": (2, 0)}, "no polygon on layer 2/0"),
        (gds(folder), {"metal": (1, 0)}, "metal"),
        (gds(folder), None, "layers"),
    ):
        with pytest.raises(th.InputError, match=message):
            th.read_layout(path, layers=layers, section=GUIDE)
