"""A family on lines as a sum of fixed matrices with coefficients that depend on the parameters.

On cell (i, j), with r = a_i + b_i rho and z = c_j + d_j zeta,

    K = 2 pi sum_ij [k_r (d_j/b_i) (a_i K^rr0 + b_i K^rr1) + k_z (b_i/d_j) (a_i K^zz0 + b_i K^zz1)] + surfaces
    M = 2 pi sum_ij rho c_p b_i d_j (a_i M^0 + b_i M^1)

where the superscript 1 has the weight rho. Heating and reading are sums of the same kind over the volume of a region.
Surfaces (convection, open sides, contacts) are sums over quadrature points with positive weights that depend on the
parameters; their weights lie in a small space, from which a few points determine all.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from thermofem.arrays import Array, NDArray
from thermofem.fem.matrices import maps, reference

from .box import Box
from .laws import Values, values
from .lines import CellGrid

ALIKE = 1e-12  # two coefficients whose ratio is constant to this over the box are one


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of a grid that are meshed.

    i, j [shape (c,)]: interval across r and z.
    """

    i: NDArray[np.intp]
    j: NDArray[np.intp]
    owner: list[str]
    material: list[str]

    @classmethod
    def of(cls, grid: CellGrid, box: Box) -> Cells:
        """Number them."""
        found = [(i, j, name) for i, column in enumerate(grid.owner) for j, name in enumerate(column) if name]
        i, j, owner = zip(*found, strict=True)
        return cls(np.array(i), np.array(j), list(owner), [box.base.material_of(name).name for name in owner])

    @cached_property
    def _materials(self) -> tuple[list[str], NDArray[np.intp]]:
        """Every material once, and which one each cell has."""
        names = list(dict.fromkeys(self.material))
        return names, np.array([names.index(m) for m in self.material])

    def laws(self, at: Values) -> tuple[Array, Array, Array]:
        """2 pi times k_r, k_z and rho c_p of every cell, each of shape (n or 1, c)."""
        names, index = self._materials
        k_r, k_z, c = (2 * np.pi * np.array([x[m] for m in names])[index].T for x in (at.k_r, at.k_z, at.capacity))
        return k_r, k_z, c

    def coefficients(
        self, grid: CellGrid, box: Box, rows: Array, at: Values | None = None
    ) -> tuple[Array, Array, Array]:
        """Coefficients of stiffness (n, 4 c), capacity (n, 2 c) and volume (n, 2 c) for parameters (n, p)."""
        k_r, k_z, c = self.laws(at or values(box, rows))
        a, b, d = self.places(grid, rows - box.middle)
        volume = self.volume(a, b, d)
        return self.stiffness(k_r, k_z, a, b, d), np.concatenate([c, c], axis=1) * volume / (2 * np.pi), volume

    def places(self, grid: CellGrid, offset: Array) -> tuple[Array, Array, Array]:
        """a, b and d of every cell, each of shape (n, c)."""
        a, b = grid.r.maps(offset)
        return a[:, self.i], b[:, self.i], grid.z.maps(offset)[1][:, self.j]

    @staticmethod
    def stiffness(k_r: Array, k_z: Array, a: Array, b: Array, d: Array) -> Array:
        """Coefficients of the stiffness, shape (n, 4 c)."""
        ratio = d / b
        along_r, along_z = k_r * ratio, k_z / ratio
        return np.concatenate([along_r * a, along_r * b, along_z * a, along_z * b], axis=1)

    @staticmethod
    def volume(a: Array, b: Array, d: Array) -> Array:
        """Coefficients of volumes, shape (n, 2 c)."""
        area = 2 * np.pi * b * d
        return np.concatenate([area * a, area * b], axis=1)


def element_terms(basis: Any) -> tuple[Array, Array, Array]:
    """Matrices of every triangle: stiffness (4, t, b, b) as rr0, rr1, zz0, zz1; capacity (2, t, b, b); load (2, t, b).

    Without the factor 2 pi; the weight is 1 or the radius.
    """
    J, r = maps(basis.mesh)
    det = J[0, 0] * J[1, 1] - J[0, 1] * J[1, 0]
    inverse = np.array([[J[1, 1], -J[0, 1]], [-J[1, 0], J[0, 0]]]) / det
    integrals, t, n = reference(basis), basis.nelems, basis.Nbfun
    stiffness, capacity, load = [], [], []
    for along in (0, 1):
        metric = np.abs(det) * inverse[:, None, along] * inverse[None, :, along]
        for weight in (np.ones_like(r), r):
            share = (metric[:, :, None] * weight).reshape(-1, t)
            stiffness.append((share.T @ integrals.stiffness).reshape(t, n, n))
    for weight in (np.ones_like(r), r):
        share = np.abs(det) * weight
        capacity.append((share.T @ integrals.mass).reshape(t, n, n))
        load.append(share.T @ integrals.load)
    return np.array(stiffness), np.array(capacity), np.array(load)


def merged(samples: Array) -> tuple[NDArray[np.intp], Array]:
    """Group the coefficients that are multiples of each other: group of each, and its ratio to the first of the group.

    ``samples`` has shape (n, q): q coefficients at n random members.
    """
    size = np.linalg.norm(samples, axis=0)
    kind, ratio = np.full(samples.shape[1], -1), np.zeros(samples.shape[1])
    count = 0
    for k in range(samples.shape[1]):
        if kind[k] >= 0:
            continue
        if size[k] == 0:
            kind[k], ratio[k] = count, 1.0
            count += 1
            continue
        unit = samples[:, k] / size[k]
        rest = np.flatnonzero((kind < 0) & (size > 0))
        off = np.linalg.norm(samples[:, rest] / size[rest] - unit[:, None], axis=0)
        alike = rest[off < ALIKE]
        kind[alike], ratio[alike] = count, size[alike] / size[k]
        count += 1
    return kind, ratio
