"""Triangles in (r, z) with named regions, and their files (written and read through meshio)."""

from __future__ import annotations

import contextlib
import os
import threading
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import checks
from ..checks import InputError


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
