"""The meshes that are committed with the code, and which mesh a geometry gets."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..geometry.regions import GRID
from .element_sizes import sizes
from .gmsh_mesher import make
from .triangles import Mesh

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection

VERSION = 2  # of the mesher: a new number where the same geometry gets another mesh


def mesh_for(geometry: CrossSection, accuracy: float) -> Mesh:
    """The committed mesh of this geometry where there is one, else a new one from gmsh.

    Raises InputError: accuracy outside 1e-5 .. 0.05, or a geometry that cannot be meshed.
    Raises MissingLibraryError: gmsh is needed and cannot be loaded.
    """
    sizes(accuracy)
    committed = find_committed(geometry, accuracy)
    return read(committed) if committed else make(geometry, accuracy)


def find_committed(geometry: CrossSection, accuracy: float) -> Path | None:
    """The file of the committed mesh with this content, in the installed package or in the checkout."""
    here = Path(__file__).resolve().parents[1]
    pattern = f"*-{content_hash(geometry, accuracy)}.npz"
    return next((path for folder in (here / "meshes", here.parent / "meshes") for path in folder.glob(pattern)), None)


def read(path: Path) -> Mesh:
    """A mesh that `write_references` wrote: the arrays of a `Mesh` under their names."""
    with np.load(path) as found:
        return Mesh(found["points"], found["triangles"], found["region"], tuple(found["region_names"].tolist()))


def write_references(folder: str | Path) -> str:
    """Make the meshes that are committed to meshes/, and return the rows of its table.

    Raises InputError, MissingLibraryError: as `mesh_for`; a folder that cannot be written.
    """
    from ..geometry.rings import strip_ring

    rows = []
    for accuracy in (1e-3, 1e-4):
        geometry = strip_ring()
        mesh, key = make(geometry, accuracy), content_hash(geometry, accuracy)
        path = Path(folder) / f"strip_ring-{accuracy:.0e}-{key}.npz"
        named = np.array(mesh.region_names)
        np.savez_compressed(path, points=mesh.points, triangles=mesh.triangles, region=mesh.region, region_names=named)
        extent = f"{len(mesh.points)} | {len(mesh.triangles)} | {path.stat().st_size / 1024:.0f} kB"
        rows.append(f"| `{path.name}` | `strip_ring()` | {accuracy:.0e} | {extent} |")
    return "\n".join(rows)


def content_hash(geometry: CrossSection, accuracy: float) -> str:
    """Hash (12 hex digits) of all that determines the mesh: outlines, names, heated parts, copies, sizes, mesher.

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
