import contextlib
import os
import re
import sys
from dataclasses import replace

import hostile
import numpy as np
import pytest
from hypothesis import assume, given, settings
from sections import HEATER, STRIP, core, on_oxide, random_parts

from thermofem import mesh
from thermofem.checks import InputError, MissingLibraryError
from thermofem.geometry import CrossSection, Part, strip_ring
from thermofem.materials import Material
from thermofem.mesh import Mesh
from thermofem.mesh.element_sizes import size_function, sizes

ROUND_OFF = 1e-12  # 16 ulps of the largest coordinate (60 um) over the smallest thickness (100 nm)
REFERENCES = [(1e-3, 648), (1e-4, 1586)]  # accuracy and points, as meshes/README.md has them


def same(first: Mesh, second: Mesh) -> bool:
    arrays = ("points", "triangles", "region")
    return first.region_names == second.region_names and all(
        np.array_equal(getattr(first, name), getattr(second, name)) for name in arrays
    )


@pytest.fixture(scope="module")
def heater():
    return CrossSection.from_toml_text(HEATER)


@pytest.fixture(scope="module")
def heater_mesh(heater, needs_mesher):
    return mesh.make(heater, 1e-3)


# --- sizes ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("accuracy", [0.0, 1e-6, 0.1, float("nan"), -1e-3, "fine"])
def test_accuracy_has_limits(accuracy):
    with pytest.raises(InputError, match=r"accuracy = .*relative error"):
        mesh.mesh_for(strip_ring(), accuracy)


def test_size_at_corners_edges_and_far_away():
    size = size_function(strip_ring(), sizes(1e-3))
    assert size(7.73e-6, 220e-9) == pytest.approx(10e-9, rel=1e-12, abs=0)  # a corner
    assert size(7.955e-6, 220e-9) == pytest.approx(45e-9, rel=1e-12, abs=0)  # the middle of an edge
    assert size(7.955e-6, 320e-9) == pytest.approx(45e-9 + 0.5 * 100e-9, rel=1e-12, abs=0)
    assert size(7.75e-6, 220e-9) == pytest.approx(10e-9 + 0.5 * 20e-9, rel=1e-12, abs=0)
    assert size(28.18e-6, 0.0) == pytest.approx(4e-6, rel=1e-12, abs=0)  # 20 um away: the cap
    hole = on_oxide(core(), Part("hole", "void", 3e-6, 3.5e-6, bottom=-400e-9, height=400e-9))  # 1 um from a wide core
    at_hole = size_function(hole, sizes(1e-3))(3e-6, 0.0)
    assert at_hole == pytest.approx(0.15 * 20e-9 * (1 + 1e-6 / 0.3e-6), rel=1e-12, abs=0)
    assert size(108.18e-6, 0.0) == pytest.approx(10e-6, rel=1e-12, abs=0)  # 100 um away: a tenth of the distance


# --- committed meshes -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("accuracy", "points"), REFERENCES)
def test_the_reference_strip_has_committed_meshes(accuracy, points):
    for geometry in (strip_ring(), CrossSection.from_toml_text(STRIP)):
        found = mesh.mesh_for(geometry, accuracy)
        assert len(found.points) == points
        assert found.region_names == geometry.region_names
        assert found.volumes() == pytest.approx(geometry.volumes(), rel=ROUND_OFF, abs=0)


@pytest.mark.parametrize("accuracy", [1e-3, 1e-4])
def test_committed_meshes_are_what_this_mesher_makes(accuracy, needs_mesher):
    found, made = mesh.mesh_for(strip_ring(), accuracy), mesh.make(strip_ring(), accuracy)
    # another gmsh may place points otherwise; counts within 5 % say that the rules are the committed ones
    assert len(made.points) == pytest.approx(len(found.points), rel=0.05)
    assert made.volumes() == pytest.approx(found.volumes(), rel=ROUND_OFF, abs=0)


def test_the_hash_covers_what_determines_the_mesh_and_nothing_else():
    strip = strip_ring()
    key = mesh.content_hash(strip, 1e-3)
    silica = Material("SiO2", conductivity=1.0, density=2200.0, specific_heat=700.0)
    for same_mesh in (
        replace(strip, name="other"),
        replace(strip, ambient=300.0),
        replace(strip, top=strip.bottom),
        replace(strip, materials=(silica,)),
        strip_ring(width=450e-9 * (1 + 1e-15)),
    ):
        assert mesh.content_hash(same_mesh, 1e-3) == key
    heated_box = replace(strip.parts[0], name="ring")
    for other in (
        strip_ring(width=451e-9),
        strip_ring(outer_radius=61e-6),
        replace(strip, parts=(heated_box,)),
        replace(strip, parts=(*strip.parts, replace(strip.parts[0], name="inner", inner_radius=8e-6))),
    ):
        assert mesh.content_hash(other, 1e-3) != key
    assert mesh.content_hash(strip, 1e-4) != key


# --- making meshes ----------------------------------------------------------------------------------------------------


def test_triangles_are_positive_and_join(heater_mesh):
    corners = heater_mesh.points[heater_mesh.triangles]
    (r0, z0), (r1, z1), (r2, z2) = np.moveaxis(corners, 1, 0).transpose(0, 2, 1)
    assert np.all((r1 - r0) * (z2 - z0) - (r2 - r0) * (z1 - z0) > 0)
    assert np.array_equal(np.unique(heater_mesh.triangles), np.arange(len(heater_mesh.points)))
    # no two points at one place: neighbours share theirs (the finest element has 1.5 nm)
    assert len(np.unique(np.round(heater_mesh.points / 1e-11), axis=0)) == len(heater_mesh.points)


def test_every_boundary_facet_lies_on_exactly_one_side(heater, heater_mesh):
    triangles = heater_mesh.triangles
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    facets, uses = np.unique(edges, axis=0, return_counts=True)
    boundary = heater_mesh.points[facets[uses == 1]]
    r, z = boundary.mean(axis=1).T
    length = np.linalg.norm(boundary[:, 1] - boundary[:, 0], axis=1)
    on = {side: heater.on_boundary(side, r, z) for side in ("axis", "bottom", "outer", "top", "wall")}
    assert np.all(sum(on.values()) == 1)
    # round-off of sums of 10 .. 300 facets
    expected = {"axis": 34.22e-6, "bottom": 60e-6, "outer": 34.22e-6, "top": 60.2e-6, "wall": 36e-6}
    assert {side: length[where].sum() for side, where in on.items()} == pytest.approx(expected, rel=1e-10, abs=0)


def test_edges_have_the_size_that_was_asked_for(needs_mesher):
    made, size = mesh.make(strip_ring(), 1e-4), size_function(strip_ring(), sizes(1e-4))
    ends = made.points[made.triangles[:, [0, 1]]]
    ratio = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / [size(r, z) for r, z in ends.mean(axis=1)]
    # an even triangulation has edges of 0.6 .. 1.5 times the asked size
    assert 0.8 < np.median(ratio) < 1.2
    assert np.mean((ratio > 0.5) & (ratio < 2)) > 0.98


def test_meshes_are_deterministic(needs_mesher):
    first = mesh.make(strip_ring(), 1e-2)
    mesh.make(strip_ring(width=600e-9), 1e-2)
    assert same(mesh.make(strip_ring(), 1e-2), first)


def test_a_gap_in_the_mesh_is_noticed(needs_mesher, monkeypatch):
    volumes = strip_ring().volumes()
    monkeypatch.setattr(CrossSection, "volumes", lambda self: volumes | {"core": volumes["core"] * (1 + 1e-6)})
    with pytest.raises(InputError, match="gmsh cannot mesh 'strip ring': it leaves a gap in 'core'"):
        mesh.make(strip_ring(), 1e-2)


@given(random_parts())
@settings(max_examples=25, deadline=None)
def test_any_overlap_is_meshed_with_exact_volumes(needs_mesher, parts):
    try:
        geometry = on_oxide(*parts)
    except InputError:
        assume(False)
    made = mesh.make(geometry, 0.05)
    assert made.volumes() == pytest.approx(geometry.volumes(), rel=ROUND_OFF, abs=0)


# --- files ------------------------------------------------------------------------------------------------------------


def test_a_mesh_file_gives_back_everything(heater_mesh, tmp_path):
    named = replace(heater_mesh, region_names=("substrate", "box 1", "Ω-cladding", "core.a", "heater+"))
    named.save(tmp_path / "heater.msh")
    assert same(mesh.load(tmp_path / "heater.msh"), named)
    assert os.listdir(tmp_path) == ["heater.msh"]


def squares(path, version, binary, *, joined=True, quads=False, z=0.0):
    """Two squares of 1 um beside each other, as gmsh writes them."""
    import gmsh

    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        first, second = (gmsh.model.occ.addRectangle(k * 1e-6, 0, z, 1e-6, 1e-6) for k in range(2))
        if joined:
            gmsh.model.occ.fragment([(2, first)], [(2, second)])
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [first], 7, "core")
        gmsh.model.addPhysicalGroup(2, [second], 9, "box")
        gmsh.model.addPhysicalGroup(1, [1], 3, "edge")
        for name, value in (("MeshSizeMax", 3e-7), ("RecombineAll", quads), ("MshFileVersion", version)):
            gmsh.option.setNumber(f"Mesh.{name}", value)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    return path


@pytest.mark.parametrize("binary", [0, 1])
@pytest.mark.parametrize("version", [2.2, 4.1])
def test_what_gmsh_writes_is_read_or_refused(needs_mesher, tmp_path, version, binary):
    """Quadrangles are not left out, and points out of the plane not moved into it."""
    path = tmp_path / "squares.msh"
    found = mesh.load(squares(path, version, binary)).volumes()
    assert found == pytest.approx({"core": np.pi * 1e-18, "box": 3 * np.pi * 1e-18}, rel=ROUND_OFF, abs=0)
    for change, words in (
        ({"quads": True}, "are no triangles"),
        ({"z": 1e-6}, "out of the plane z = 0"),
        ({"joined": False}, "without sharing their points"),
    ):
        with pytest.raises(InputError, match=rf"squares\.msh'.*{words}"):
            mesh.load(squares(path, version, binary, **change))


TEXT = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
3
1 3 "axis"
2 7 "core"
2 9 "box"
$EndPhysicalNames
$Nodes
5
1 0 0 0
2 1e-6 0 0
3 1e-6 1e-6 0
4 0 1e-6 0
8 2e-6 0 0
$EndNodes
$Elements
4
1 1 2 3 1 1 4
2 2 2 7 1 1 2 3
3 2 2 7 1 1 3 4
4 2 2 9 2 2 8 3
$EndElements
"""


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("8 2e-6 0 0\n", "8 0.5e-6 0 0\n", "overlap"),
        ("8 2e-6 0 0\n", "8 1e308 0 0\n", "not finite"),
        ("8 2e-6 0 0\n", "8 nan 0 0\n", "not finite"),
        ("$Nodes\n5\n", "$Nodes\n999999999\n", "beyond 1e8"),
        ("8 2e-6 0 0\n", "999999999 2e-6 0 0\n", "beyond 1e8"),
        ("$Nodes\n5\n", "$Nodes\n6\n", "cannot be read"),
        ("2 8 3\n", "2 7 3\n", "none of its points"),
        ("2.2 0 8", "1.0 0 8", "cannot be read"),
        ("4 2 2 9", "4 2 2 5", r"groups \[5\] have no names"),
    ],
)
def test_a_damaged_text_file_is_one_line(old, new, words, tmp_path):
    assert old in TEXT
    path = tmp_path / "ring.msh"
    path.write_text(TEXT.replace(old, new))
    with pytest.raises(InputError, match=rf"ring\.msh'.*{words}"):
        mesh.load(path)


def test_a_mesh_drawn_in_micrometres_is_noticed(heater_mesh, tmp_path, caplog):
    """gmsh's files state no unit; a ring of 30 m is none of a chip."""
    path = tmp_path / "ring.msh"
    heater_mesh.save(path)
    mesh.load(path)
    assert not caplog.messages
    replace(heater_mesh, points=1e6 * heater_mesh.points).save(path)
    mesh.load(path)
    assert re.search(r"ring.msh' spans \S+ m; lengths are in m", caplog.text)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("binary", [0, 1])
@pytest.mark.parametrize("version", [2.2, 4.1])
def test_damaged_bytes_are_refused_or_make_a_mesh(needs_mesher, tmp_path, version, binary):
    """A count that is overwritten takes no 4 GB."""
    path = squares(tmp_path / "ring.msh", version, binary)
    for damaged in hostile.damaged(path.read_bytes(), 7, 100):
        path.write_bytes(damaged)
        with contextlib.suppress(InputError):
            mesh.load(path)


def test_gmsh_reads_the_file_and_its_names(heater_mesh, tmp_path):
    import gmsh

    heater_mesh.save(tmp_path / "heater.msh")
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / "heater.msh"))
        groups = [gmsh.model.getPhysicalName(*group) for group in gmsh.model.getPhysicalGroups()]
    finally:
        gmsh.finalize()
    assert tuple(groups) == heater_mesh.region_names


def test_files_that_cannot_be_read_or_written(tmp_path):
    found = mesh.mesh_for(strip_ring(), 1e-3)
    with pytest.raises(InputError, match=r"missing is not a folder; make it first to write ring\.msh"):
        found.save(tmp_path / "missing" / "ring.msh")
    with pytest.raises(InputError, match="does not exist"):
        mesh.load(tmp_path / "ring.msh")
    (tmp_path / "text.msh").write_text("not a mesh\n")
    with pytest.raises(InputError, match=r"text\.msh' cannot be read"):
        mesh.load(tmp_path / "text.msh")
    found.save(tmp_path / "ring.msh")
    whole = (tmp_path / "ring.msh").read_bytes()
    (tmp_path / "cut.msh").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"cut\.msh' cannot be read"):
        mesh.load(tmp_path / "cut.msh")
    start, stop = whole.index(b"$PhysicalNames"), whole.index(b"$Nodes")
    (tmp_path / "unnamed.msh").write_bytes(whole[:start] + whole[stop:])
    with pytest.raises(InputError, match=r"the physical groups \[1, 2, 3, 4\] have no names"):
        mesh.load(tmp_path / "unnamed.msh")


def rectangle(bottom, top, columns):
    """Points in um and triangles of a rectangle 2 um wide."""
    r, z = np.linspace(0, 2, columns + 1), np.array([bottom, (bottom + top) / 2, top])
    points = np.array([(a, b) for b in z for a in r])
    low = np.array([j * (columns + 1) + i for j in range(2) for i in range(columns)])
    right, high = low + 1, low + columns + 1
    return points, np.concatenate([np.column_stack([low, right, high]), np.column_stack([right, high + 1, high])])


def halves(path, gap, columns):
    """The file of a rectangle over another one, with a gap in um between them."""
    (low, first), (high, second) = rectangle(0, 0.3, 10), rectangle(0.3 + gap, 0.8, columns)
    region = np.repeat([0, 1], [len(first), len(second)])
    triangles = np.concatenate([first, second + len(low)])
    mesh.Mesh(1e-6 * np.concatenate([low, high]), triangles, region, ("low", "high")).save(path)
    return path


@pytest.mark.parametrize("columns", [10, 7])
def test_parts_that_meet_within_round_off_are_refused(columns, tmp_path):
    """One ulp between them, 0.3 and 0.1 + 0.2 um, loaded as two bodies: R_th = 79.6e6 for 26.5e3 K/W.

    Points at one place are one: with the same columns and no gap the parts are joined.
    """
    if columns == 10:
        found = mesh.load(halves(tmp_path / "m.msh", 0.0, columns))
        assert len(found.points) == 5 * 11
    for gap in (0.1 + 0.2 - 0.3, 1e-9, -1e-9):
        with pytest.raises(InputError, match=r"without sharing their points.*Coherence"):
            mesh.load(halves(tmp_path / "m.msh", gap, columns))
    for gap in (1e-5, 1e-3):  # in um: 5e-6 of the mesh is a gap
        assert mesh.load(halves(tmp_path / "m.msh", gap, columns)).region_names == ("low", "high")


def test_clockwise_triangles_are_turned_round():
    """Otherwise the volume of the cone is -pi/3."""
    given = np.array([[0, 2, 1]])
    cone = mesh.Mesh([[0, 0], [1, 0], [0, 1]], given, [0], ("a",))
    assert cone.volumes()["a"] == pytest.approx(np.pi / 3, rel=1e-15)  # a cone of radius and height 1 m
    assert given.tolist() == [[0, 2, 1]]


# --- without gmsh -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("failure", "words"),
    [
        ("OSError('libGLU.so.1: cannot open shared object file: No such file or directory')", "libglu1-mesa"),
        ("OSError('libUnheard.so.7: cannot open shared object file')", "libUnheard.so.7"),
        ("ModuleNotFoundError(\"No module named 'gmsh'\", name='gmsh')", "pip install gmsh"),
    ],
)
def test_without_gmsh_the_error_names_what_brings_it_and_committed_meshes_work(failure, words, tmp_path, monkeypatch):
    """In a process of its own: test_cli.py, where doctor names the library."""
    (tmp_path / "gmsh.py").write_text(f"raise {failure}\n")  # stands before the real one
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "gmsh", raising=False)
    assert len(mesh.mesh_for(strip_ring(), 1e-3).points) == 648
    problem = mesh.gmsh_problem()
    assert words in problem
    assert "committed meshes of the reference cross-sections work without it" in problem
    with pytest.raises(MissingLibraryError, match=re.escape(problem)):
        mesh.mesh_for(strip_ring(width=500e-9), 1e-3)
