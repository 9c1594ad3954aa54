"""Triangle meshes of a cross-section: made by gmsh through pygmsh, written and read through meshio."""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import importlib
import os
import re
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import checks
from .checks import InputError, MissingLibraryError
from .geometry.regions import GRID
from .sizes import size_function, sizes

if TYPE_CHECKING:
    from .geometry.cross_section import CrossSection
    from .geometry.regions import Face

VERSION = 2  # of the mesher: a new number where the same geometry gets another mesh
OPTIONS = {"General.Terminal": 0, "General.NumThreads": 1, "Mesh.LcIntegrationPrecision": 1e-2}
MICRON = 1e-6  # gmsh has absolute tolerances of 1e-8: it is given micrometres

# shared libraries that the gmsh wheel links to, and the Debian package that brings each
_PACKAGES = {
    "libGLU.so.1": "libglu1-mesa",
    "libGL.so.1": "libgl1",
    "libOpenGL.so.0": "libopengl0",
    "libX11.so.6": "libx11-6",
    "libXext.so.6": "libxext6",
    "libXrender.so.1": "libxrender1",
    "libXcursor.so.1": "libxcursor1",
    "libXfixes.so.3": "libxfixes3",
    "libXft.so.2": "libxft2",
    "libXinerama.so.1": "libxinerama1",
    "libfontconfig.so.1": "libfontconfig1",
    "libgomp.so.1": "libgomp1",
}
_GMSH = threading.Lock()  # gmsh has one global state


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles in (r, z) with named regions.

    Parameters
    ----------
    points : array, shape (n, 2), m
        (r, z).
    triangles : int array, shape (m, 3)
        counterclockwise indices into ``points``.
    region : int array, shape (m,)
        index into ``region_names``.
    region_names : tuple of str
    """

    points: NDArray[np.float64]
    triangles: NDArray[np.int64]
    region: NDArray[np.int64]
    region_names: tuple[str, ...]

    @cached_property
    def skfem(self) -> Any:
        """The triangles as scikit-fem holds them."""
        import skfem

        return skfem.MeshTri(np.ascontiguousarray(self.points.T), np.ascontiguousarray(self.triangles.T))

    def volumes(self) -> dict[str, float]:
        """Volume of every region in m^3: the sum of 2 pi r_centroid area, exact for triangles."""
        (r0, z0), (r1, z1), (r2, z2) = (self.points[self.triangles[:, k]].T for k in range(3))
        area = ((r1 - r0) * (z2 - z0) - (r2 - r0) * (z1 - z0)) / 2
        share = np.bincount(self.region, 2 * np.pi * (r0 + r1 + r2) / 3 * area, minlength=len(self.region_names))
        return dict(zip(self.region_names, map(float, share), strict=True))

    def save(self, path: str | Path) -> None:
        """Write a binary gmsh file (format 2.2: the one that keeps region names and reads back everywhere).

        The file appears under its name only when it is complete.
        """
        import meshio

        path = checks.path("path", path)
        cells = [("triangle", self.triangles.astype(np.int32))]
        tags = [(self.region + 1).astype(np.int32)]
        names = {name: np.array([k + 1, 2]) for k, name in enumerate(self.region_names)}
        points = np.column_stack([self.points, np.zeros(len(self.points))])
        mesh = meshio.Mesh(points, cells, cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags}, field_data=names)
        temporary = path.with_name(f".{path.name}.{os.getpid()}.{threading.get_ident()}")
        try:
            meshio.gmsh.write(temporary, mesh, fmt_version="2.2", binary=True)
            temporary.replace(path)
        except OSError as error:
            raise InputError(f"mesh file {str(path)!r} cannot be written: {error.strerror or error}") from None
        finally:
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)


def load(path: str | Path) -> Mesh:
    """Read a mesh that `Mesh.save` or gmsh wrote: triangles whose physical groups are named.

    Raises
    ------
    InputError
        no such file, not a gmsh file, or one without named groups of triangles.
    """
    import meshio

    if not checks.path("path", path).is_file():
        raise InputError(f"mesh file {str(path)!r} does not exist")
    try:
        mesh = meshio.gmsh.read(path)
        blocks = [k for k, block in enumerate(mesh.cells) if block.type == "triangle"]
        triangles = np.concatenate([mesh.cells[k].data for k in blocks]).astype(np.int64)
        tags = np.concatenate([mesh.cell_data["gmsh:physical"][k] for k in blocks])
        points = mesh.points[:, :2].astype(float)
    except Exception as error:  # meshio raises whatever a damaged file makes it trip over
        raise InputError(f"mesh file {str(path)!r} cannot be read: {error or type(error).__name__}") from None
    named = {int(tag): name for name, (tag, dimension) in mesh.field_data.items() if dimension == 2}
    unnamed = set(map(int, tags)) - set(named)
    if unnamed:
        raise InputError(f"mesh file {str(path)!r}: the physical groups {sorted(unnamed)} have no names")
    used = sorted(set(map(int, tags)))
    return Mesh(points, triangles, np.searchsorted(used, tags), tuple(named[tag] for tag in used))


def mesh_for(geometry: CrossSection, accuracy: float) -> Mesh:
    """The committed mesh of this geometry where there is one, else a new one from gmsh.

    Raises
    ------
    InputError
        accuracy outside 1e-5 .. 0.05, or a geometry that cannot be meshed.
    MissingLibraryError
        gmsh is needed and cannot be loaded.
    """
    sizes(accuracy)
    committed = find_committed(geometry, accuracy)
    return load(committed) if committed else make(geometry, accuracy)


def find_committed(geometry: CrossSection, accuracy: float) -> Path | None:
    """The file of the committed mesh with this content, in the installed package or in the checkout."""
    here = Path(__file__).resolve().parent
    pattern = f"*-{content_hash(geometry, accuracy)}.msh"
    return next((path for folder in (here / "meshes", here.parent / "meshes") for path in folder.glob(pattern)), None)


def write_references(folder: str | Path) -> str:
    """Make the meshes that are committed to meshes/, and return the rows of its table.

    Raises
    ------
    InputError, MissingLibraryError
        as `mesh_for`; a folder that cannot be written.
    """
    from .geometry.rings import strip_ring

    rows = []
    for accuracy in (1e-3, 1e-4):
        geometry = strip_ring()
        mesh, key = make(geometry, accuracy), content_hash(geometry, accuracy)
        path = Path(folder) / f"strip_ring-{accuracy:.0e}-{key}.msh"
        mesh.save(path)
        extent = f"{len(mesh.points)} | {len(mesh.triangles)} | {path.stat().st_size / 1024:.0f} kB"
        rows.append(f"| `{path.name}` | `strip_ring()` | {accuracy:.0e} | {extent} |")
    return "\n".join(rows)


def content_hash(geometry: CrossSection, accuracy: float) -> str:
    """Twelve hexadecimal digits of what determines the mesh: outlines, names, what is heated, copies, sizes, mesher.

    Materials, boundary conditions and the geometry's name do not enter.
    """
    role = {part.name: "heated" if part.heated else "part" for part in geometry.parts}
    faces = [
        (face.owner, role.get(face.owner, "layer"), [np.rint(ring / GRID).astype(int).tolist() for ring in face.rings])
        for face in geometry.subdivision.faces
    ]
    copies = sorted(probe.distance for probe in geometry.probes if probe.distance is not None)
    text = repr((VERSION, f"{accuracy:.6e}", faces, *([copies] if copies else [])))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def make(geometry: CrossSection, accuracy: float) -> Mesh:
    """Mesh a geometry with gmsh (deterministic; works in any thread).

    Raises
    ------
    InputError, MissingLibraryError
        as `mesh_for`.
    """
    problem = gmsh_problem()
    if problem:
        raise MissingLibraryError(problem)
    import gmsh
    import pygmsh

    size = size_function(geometry, sizes(accuracy))
    faces = geometry.subdivision.faces
    with _GMSH, _pipe_signal():
        ours = not gmsh.isInitialized()
        if ours:  # not by pygmsh's context manager: it installs a signal handler, which only the main thread may do
            gmsh.initialize(readConfigFiles=False, interruptible=False)
        try:
            points, triangles, region, names = _triangulate(gmsh, pygmsh.geo.Geometry(), faces, size)
        except Exception as error:  # gmsh raises plain Exception
            raise InputError(f"gmsh cannot mesh {geometry.name!r}: {error}") from None
        finally:
            if ours:
                gmsh.finalize()
    mesh = Mesh(points, triangles, region, names)
    meshed = mesh.volumes()
    for name, volume in geometry.volumes().items():
        if abs(meshed[name] - volume) > 1e-9 * volume:
            raise InputError(f"gmsh cannot mesh {geometry.name!r}: it leaves a gap in {name!r}; simplify its outline")
    return mesh


def _triangulate(
    gmsh: Any, builder: Any, faces: Sequence[Face], size: Callable[[float, float], float]
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64], tuple[str, ...]]:
    """Points (m), triangles, region and region names of the faces, sharing points and lines."""
    before = gmsh.model.getCurrent()  # the caller's, where gmsh was running already
    gmsh.model.add("thermofem")
    try:
        surfaces = _surfaces(builder, faces)
        builder.set_mesh_size_callback(lambda dim, tag, r, z, _, size_given: size(r * MICRON, z * MICRON) / MICRON)
        for option, value in OPTIONS.items():
            gmsh.option.setNumber(option, value)
        builder.synchronize()
        gmsh.model.mesh.generate(2)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        cells = [gmsh.model.mesh.getElementsByType(2, surface._id)[1].reshape(-1, 3) for surface in surfaces]
    finally:
        gmsh.model.mesh.removeSizeCallback()
        gmsh.model.remove()
        gmsh.model.setCurrent(before)
    names = tuple(dict.fromkeys(face.owner for face in faces))
    region = np.repeat([names.index(face.owner) for face in faces], [len(cell) for cell in cells])
    order = np.argsort(tags)
    used, triangles = np.unique(np.concatenate(cells), return_inverse=True)
    points = coordinates.reshape(-1, 3)[order[np.searchsorted(tags, used, sorter=order)], :2] * MICRON
    return points, triangles.reshape(-1, 3).astype(np.int64), region.astype(np.int64), names


def _surfaces(builder: Any, faces: Sequence[Face]) -> list[Any]:
    """A pygmsh surface for every face; neighbours share their points and lines."""
    points: dict[tuple[float, float], Any] = {}
    lines: dict[tuple[Any, Any], Any] = {}

    def line(start: tuple[float, float], stop: tuple[float, float]) -> Any:
        for corner in (start, stop):
            if corner not in points:
                points[corner] = builder.add_point([corner[0] / MICRON, corner[1] / MICRON, 0.0])
        if (stop, start) in lines:
            return -lines[stop, start]
        if (start, stop) not in lines:
            lines[start, stop] = builder.add_line(points[start], points[stop])
        return lines[start, stop]

    def loop(ring: NDArray[np.float64]) -> Any:
        corners = [(float(r), float(z)) for r, z in ring]
        return builder.add_curve_loop([line(a, b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)])

    return [builder.add_plane_surface(loop(face.rings[0]), [loop(hole) for hole in face.rings[1:]]) for face in faces]


@contextlib.contextmanager
def _pipe_signal() -> Iterator[None]:
    """Keep what SIGPIPE does: gmsh sets it back to killing the process, at the next write to a pipe nobody reads."""
    number = getattr(signal, "SIGPIPE", None)
    if number is None:  # Windows
        yield
        return
    get, put = ctypes.pythonapi.PyOS_getsig, ctypes.pythonapi.PyOS_setsig  # unlike signal.signal, in any thread
    get.argtypes, get.restype = [ctypes.c_int], ctypes.c_void_p
    put.argtypes, put.restype = [ctypes.c_int, ctypes.c_void_p], ctypes.c_void_p
    before = get(number)
    try:
        yield
    finally:
        put(number, before)


def _loads(library: str) -> bool:
    """Whether a shared library is on the machine."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def gmsh_problem() -> str | None:
    """None where gmsh and pygmsh can be loaded, else one line that says what is missing and what brings it."""
    remedy = "the committed meshes of the reference cross-sections work without it"
    for module in ("gmsh", "pygmsh"):
        try:
            importlib.import_module(module)
        except ModuleNotFoundError as error:
            package = error.name
            missing, brings = f"the Python package {package}", f"pip install {package}"
        except (ImportError, OSError) as error:
            library = re.match(r"(lib[\w.+-]+?\.so[.\d]*)", str(error))
            if library is None:
                return f"{module} cannot be loaded: {error}; {remedy}"
            missing = f"the shared library {library[1]}"
            absent = [known for known in _PACKAGES if known == library[1] or not _loads(known)]  # the loader names one
            packages = " ".join(_PACKAGES[known] for known in absent)
            named = library[1] in _PACKAGES
            brings = f"Debian, Ubuntu: apt-get install {packages}" if named else "apt-file search finds its package"
        else:
            continue
        return f"{module} cannot be loaded: {missing} is missing ({brings}); {remedy}"
    return None
