"""Which mesh a geometry gets: a committed one of the reference cross-sections, else a new one from gmsh."""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import importlib
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array, NDArray
from ..checks import InputError, MissingLibraryError
from ..geometry.regions import CUT_GRID
from .element_sizes import size_function, sizes
from .triangles import Mesh

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection
    from ..geometry.regions import Face

# packages of the shared libraries that the gmsh wheel links to
DEBIAN = (
    "apt-get install libglu1-mesa libgl1 libopengl0 libx11-6 libxext6 libxrender1 libxcursor1 libxfixes3 libxft2 "
    "libxinerama1 libfontconfig1 libgomp1"
)
VERSION = 2  # of the mesher: a new number where the same geometry gets another mesh


def mesh_for(geometry: CrossSection, accuracy: float) -> Mesh:
    """The committed mesh of this geometry where there is one, else a new one from gmsh.

    Raises InputError: accuracy outside 1e-5 .. 0.05, or a geometry that cannot be meshed.
    Raises MissingLibraryError: gmsh is needed and cannot be loaded.
    """
    sizes(accuracy)
    return committed_mesh(geometry, accuracy) or make(geometry, accuracy)


def committed_mesh(geometry: CrossSection, accuracy: float) -> Mesh | None:
    """The mesh with this content that benchmarks/make_meshes.py wrote; None where there is none.

    ``meshes`` stands at the top of a checkout, and a wheel has it inside the package.
    """
    package = Path(__file__).resolve().parents[1]
    pattern = f"meshes/*-{content_hash(geometry, accuracy)}.npz"
    files = [*package.glob(pattern), *package.parent.glob(pattern)]
    if not files:
        return None
    with np.load(files[0]) as arrays:
        names = tuple(arrays["region_names"].tolist())
        return Mesh(arrays["points"], arrays["triangles"], arrays["region"], names)


def content_hash(geometry: CrossSection, accuracy: float) -> str:
    """Hash (12 hex digits) of all that determines the mesh: outlines, names, heated parts, copies, sizes, mesher.

    Materials, boundary conditions and the geometry's name do not enter.
    """
    role = {part.name: "heated" if part.heated else "part" for part in geometry.parts}
    faces = []
    for face in geometry.subdivision.faces:
        rings = [np.rint(ring / CUT_GRID).astype(int).tolist() for ring in face.rings]
        faces.append((face.owner, role.get(face.owner, "layer"), rings))
    copies = sorted(probe.distance for probe in geometry.probes if probe.distance is not None)
    content = [VERSION, f"{accuracy:.6e}", faces]
    if copies:
        content.append(copies)
    text = repr(tuple(content))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def gmsh_problem() -> str | None:
    """None where gmsh and pygmsh can be loaded; otherwise one line with what is missing and how to install it."""
    try:
        for module in ("gmsh", "pygmsh"):
            importlib.import_module(module)
    except (ImportError, OSError) as error:
        brings = f"Debian: {DEBIAN}"
        if isinstance(error, ModuleNotFoundError):
            brings = f"pip install {error.name}"
        remedy = "the committed meshes of the reference cross-sections work without it"
        return f"gmsh cannot be loaded: {error} ({brings}); {remedy}"
    return None


OPTIONS = {"General.Terminal": 0, "General.NumThreads": 1, "Mesh.LcIntegrationPrecision": 1e-2}
MICRON = 1e-6  # gmsh has absolute tolerances of 1e-8: it is given micrometres

_GMSH = threading.Lock()  # gmsh has one global state


def make(geometry: CrossSection, accuracy: float) -> Mesh:
    """Mesh a geometry with gmsh (deterministic; works in any thread).

    Raises InputError, MissingLibraryError: as `mesh_for`.
    """
    size = size_function(geometry, sizes(accuracy))
    mesh = make_faces(geometry.subdivision.faces, size, geometry.name, geometry.depth)
    meshed = mesh.volumes()
    for name, volume in geometry.volumes().items():
        if abs(meshed[name] - volume) > 1e-9 * volume:
            raise InputError(f"gmsh cannot mesh {geometry.name!r}: it leaves a gap in {name!r}; simplify its outline")
    return mesh


def make_faces(
    faces: Sequence[Face], size: Callable[[float, float], float], name: str, depth: float | None = None
) -> Mesh:
    """Mesh faces that share points and edges; their owners are the regions.

    size: element size in m at (r, z) in m.
    name: for messages.
    depth: of a straight section, m.
    """
    problem = gmsh_problem()
    if problem:
        raise MissingLibraryError(problem)
    import gmsh
    import pygmsh

    with _GMSH, _pipe_signal():
        ours = not gmsh.isInitialized()
        if ours:  # not by pygmsh's context manager: it installs a signal handler, which only the main thread may do
            gmsh.initialize(readConfigFiles=False, interruptible=False)
        try:
            points, triangles, region, names = _triangulate(gmsh, pygmsh.geo.Geometry(), faces, size)
        except Exception as error:  # gmsh raises plain Exception
            raise InputError(f"gmsh cannot mesh {name!r}: {error}") from None
        finally:
            if ours:
                gmsh.finalize()
    return Mesh(points, triangles, region, names, depth)


def _triangulate(
    gmsh: Any, builder: Any, faces: Sequence[Face], size: Callable[[float, float], float]
) -> tuple[Array, NDArray[np.int64], NDArray[np.int64], tuple[str, ...]]:
    """Points (m), triangles, region and region names of the faces, sharing points and lines."""
    before = gmsh.model.getCurrent()  # the caller's, where gmsh was running already
    gmsh.model.add("thermofem")
    try:
        surfaces = _surfaces(builder, faces)

        def in_microns(dim: int, tag: int, r: float, z: float, _: float, __: float) -> float:
            return size(r * MICRON, z * MICRON) / MICRON

        builder.set_mesh_size_callback(in_microns)
        for option, value in OPTIONS.items():
            gmsh.option.setNumber(option, value)
        builder.synchronize()
        gmsh.model.mesh.generate(2)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        cells = []
        for surface in surfaces:
            _, nodes = gmsh.model.mesh.getElementsByType(2, surface.dim_tag[1])
            cells.append(nodes.reshape(-1, 3))
    finally:
        gmsh.model.mesh.removeSizeCallback()
        gmsh.model.remove()
        gmsh.model.setCurrent(before)
    names = tuple(dict.fromkeys(face.owner for face in faces))
    owners = [names.index(face.owner) for face in faces]
    region = np.repeat(owners, [len(cell) for cell in cells])
    order = np.argsort(tags)
    used, triangles = np.unique(np.concatenate(cells), return_inverse=True)
    rows = order[np.searchsorted(tags, used, sorter=order)]
    points = coordinates.reshape(-1, 3)[rows, :2] * MICRON
    return points, triangles.reshape(-1, 3).astype(np.int64), region.astype(np.int64), names


def _surfaces(builder: Any, faces: Sequence[Face]) -> list[Any]:
    """A pygmsh surface for every face; neighbours share their points and lines."""
    points: dict[tuple[float, float], Any] = {}
    lines: dict[tuple[Any, Any], Any] = {}

    def line(start: tuple[float, float], stop: tuple[float, float]) -> Any:
        for corner in (start, stop):
            if corner not in points:
                r, z = corner
                points[corner] = builder.add_point([r / MICRON, z / MICRON, 0.0])
        if (stop, start) in lines:
            return -lines[stop, start]
        if (start, stop) not in lines:
            lines[start, stop] = builder.add_line(points[start], points[stop])
        return lines[start, stop]

    def loop(ring: Array) -> Any:
        corners = [(float(r), float(z)) for r, z in ring]
        following = corners[1:] + corners[:1]
        return builder.add_curve_loop([line(a, b) for a, b in zip(corners, following, strict=True)])

    surfaces = []
    for face in faces:
        loops = [loop(ring) for ring in face.rings]
        surfaces.append(builder.add_plane_surface(loops[0], loops[1:]))
    return surfaces


@contextlib.contextmanager
def _pipe_signal() -> Iterator[None]:
    """Preserve the handler of SIGPIPE: gmsh resets it, and the next write to a closed pipe would kill the process."""
    number = getattr(signal, "SIGPIPE", None)
    if number is None:  # Windows
        yield
        return
    get, put = ctypes.pythonapi.PyOS_getsig, ctypes.pythonapi.PyOS_setsig  # gmsh resets SIGPIPE, in any thread
    get.argtypes, get.restype = [ctypes.c_int], ctypes.c_void_p
    put.argtypes, put.restype = [ctypes.c_int, ctypes.c_void_p], ctypes.c_void_p
    before = get(number)
    try:
        yield
    finally:
        put(number, before)
