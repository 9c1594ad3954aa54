"""The engine on moved meshes: the matrices of every member are assembled and projected, some tens of ms each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from thermofem import assemble, checks
from thermofem.algebra.krylov import symmetric_part
from thermofem.arrays import Array
from thermofem.fem import HeatProblem
from thermofem.fem.assembly import on_mesh
from thermofem.mesh import Mesh
from thermofem.mesh.mesh_motion import Motion

from .members import MemberMatrices
from .parameter_box import Box


class MovedMeshEngine:
    """Assembles the full matrices of a member on the moved base mesh and projects them, which takes some tens of ms.

    accuracy: of the base mesh.
    mesh: that mesh; None makes it.
    """

    def __init__(self, box: Box, accuracy: float, mesh: Mesh | None = None) -> None:
        self.box = box
        self.accuracy = accuracy
        self.reference = assemble(box.base, accuracy) if mesh is None else on_mesh(box.base, mesh, accuracy)
        self.mesh = self.reference.mesh
        self._motion = Motion(self.mesh, box.base)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle box, accuracy and mesh; another process makes factors anew."""
        return MovedMeshEngine, (self.box, self.accuracy, self.mesh)

    def heat(self, row: Array) -> HeatProblem:
        """The heat problem of a member on the moved mesh.

        Raises InputError: the mesh cannot follow: a face appears or vanishes inside the box, or triangles turn over.
        """
        geometry = self.box.geometry(row)
        with checks.prefixed(f"no family over this box: at {self.box.words(row)}", hint="take smaller ranges"):
            moved = replace(self.mesh, points=self._motion.moved(geometry))
        return on_mesh(geometry, moved, self.accuracy)

    def project(self, V: Array, ports: tuple[str, ...]) -> MovedMeshMembers:
        """Project the family on the functions V, shape (unknowns, N)."""
        return MovedMeshMembers(self, V, ports)


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
        """Number of basis functions."""
        return int(self.basis.shape[1])

    @property
    def box(self) -> Box:
        """The box of parameters."""
        return self.moved.box

    def matrices(self, rows: Array) -> MemberMatrices:
        """Projected matrices of n members with the parameters ``rows``, shape (n, p), stacked along a first axis."""
        members = [projected(self.moved.heat(row), self.basis, self.ports) for row in rows]
        K = np.array([member.K for member in members])
        M = np.array([member.M for member in members])
        return MemberMatrices(K, M, np.array([member.ports for member in members]))


def projected(heat: HeatProblem, V: Array, ports: tuple[str, ...]) -> MemberMatrices:
    """Project a member, given by its heat problem, on the functions V, shape (unknowns, N)."""
    d = heat.discretization
    K = symmetric_part(V.T @ (d.K @ V))
    M = symmetric_part(V.T @ (d.E @ V))
    means = [d.means[name][d.free] @ V for name in ports]
    return MemberMatrices(K, M, np.array(means))
