"""The engine on moved meshes: the matrices of every member are assembled and projected, some tens of ms each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from thermofem import assemble, checks
from thermofem.arrays import Array
from thermofem.fem import HeatProblem
from thermofem.fem.assembly import on_mesh
from thermofem.mesh import Mesh
from thermofem.mesh.mesh_motion import Motion

from .members import MemberMatrices
from .parameter_box import Box


class MovedMeshEngine:
    """Full matrices on moved meshes; a reduced member is their projection, some tens of milliseconds.

    accuracy: of the base mesh.
    reference: the base problem, where it is there already.
    """

    name = "moved mesh"

    def __init__(self, box: Box, accuracy: float, reference: HeatProblem | None = None) -> None:
        self.box, self.accuracy = box, accuracy
        self.reference = reference or assemble(box.base, accuracy)
        self.mesh = self.reference.mesh
        self._motion = Motion(self.mesh, box.base)

    def __reduce__(self) -> tuple[Any, ...]:
        """For other processes: the mesh, without factors."""
        return MovedMeshEngine.on, (self.box, self.accuracy, self.mesh)

    @classmethod
    def on(cls, box: Box, accuracy: float, mesh: Mesh) -> MovedMeshEngine:
        """The engine on an existing base mesh."""
        return cls(box, accuracy, on_mesh(box.base, mesh, accuracy))

    @property
    def unknowns(self) -> int:
        """Unknowns of the base mesh."""
        return self.reference.unknowns

    def heat(self, row: Array) -> HeatProblem:
        """The heat problem of a member on the moved mesh.

        Raises InputError: the mesh cannot follow: a face appears or vanishes inside the box, or triangles turn over.
        """
        geometry = self.box.geometry(row)
        try:
            moved = replace(self.mesh, points=self._motion.moved(geometry))
        except checks.InputError as error:
            where = ", ".join(f"{name} = {value:g}" for name, value in zip(self.box.names, row, strict=True))
            raise checks.InputError(f"no family over this box: at {where} {error}; take smaller ranges") from None
        return on_mesh(geometry, moved, self.accuracy)


@dataclass(frozen=True, eq=False)
class MovedMeshMembers:
    """Members whose full matrices are assembled on the moved mesh and projected on the basis.

    basis [shape (unknowns, N)]
    """

    moved: MovedMeshEngine
    basis: Array
    ports: tuple[str, ...]
    engine = "moved mesh"

    @property
    def size(self) -> int:
        """Number of functions."""
        return int(self.basis.shape[1])

    def member(self, row: Array) -> MemberMatrices:
        """Matrices of one member."""
        return projected(self.moved.heat(row), self.basis, self.ports)

    def resistances(self, rows: Array, heated: int, read: int) -> Array:
        """Static gain of many members, shape (n,)."""
        small = (self.member(row) for row in rows)
        return np.array([one.ports[read] @ np.linalg.solve(one.K, one.ports[heated]) for one in small])


def projected(heat: HeatProblem, V: Array, ports: tuple[str, ...]) -> MemberMatrices:
    """A member in the functions V, from its full matrices."""
    d = heat.discretization
    K, M = (V.T @ (matrix @ V) for matrix in (d.K, d.E))
    return MemberMatrices((K + K.T) / 2, (M + M.T) / 2, np.array([d.means[name][d.free] @ V for name in ports]))
