"""Derivatives of the matrices of all triangles with the velocities of their corners, k and rho c_p."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array, NDArray
from .matrices import maps, reference


@dataclass(frozen=True, eq=False)
class _Maps:
    """Jacobians, their determinants and radii of the corners of all triangles, and their derivatives."""

    J: Array
    r: Array
    det: Array
    of_J: Array
    of_r: Array
    of_det: Array

    @classmethod
    def of(cls, basis: Any, moved: Array) -> _Maps:
        J, r = maps(basis.mesh)
        of_J, of_r = maps(basis.mesh, moved)
        det = J[0, 0] * J[1, 1] - J[0, 1] * J[1, 0]
        of_det = of_J[0, 0] * J[1, 1] + J[0, 0] * of_J[1, 1] - of_J[0, 1] * J[1, 0] - J[0, 1] * of_J[1, 0]
        return cls(J, r, det, of_J, of_r, of_det)


def element_conduction_tangent(basis: Any, k: Array, of_k: Array, moved: Array) -> Array:
    """Derivative of `matrices.element_conduction`; with A = adj J its metric is A diag(k) A^T / |det J|."""
    m, integrals = _Maps.of(basis, moved), reference(basis)
    A, of_A = (np.array([[J[1, 1], -J[0, 1]], [-J[1, 0], J[0, 0]]]) for J in (m.J, m.of_J))
    metric = np.einsum("mde,de,nde->mne", A, k, A)
    cross = np.einsum("mde,de,nde->mne", of_A, k, A)
    of_metric = cross + cross.swapaxes(0, 1) + np.einsum("mde,de,nde->mne", A, of_k, A) - metric * m.of_det / m.det
    weights = 2 * np.pi / np.abs(m.det) * (of_metric[:, :, None] * m.r + metric[:, :, None] * m.of_r)
    return _elements(basis, weights.reshape(-1, basis.nelems), integrals.stiffness)


def element_capacity_tangent(basis: Any, c: Array, of_c: Array, moved: Array) -> Array:
    """Derivative of `matrices.element_capacity`."""
    m = _Maps.of(basis, moved)
    share = of_c + c * m.of_det / m.det
    weights = 2 * np.pi * np.abs(m.det) * (share * m.r + c * m.of_r)
    return _elements(basis, weights, reference(basis).mass)


def _elements(basis: Any, weights: Array, integrals: Array) -> Array:
    return (weights.T @ integrals).reshape(basis.nelems, basis.Nbfun, basis.Nbfun)


def volume_tangent(basis: Any, inside: NDArray[np.bool_], moved: Array) -> Array:
    """Derivative of `matrices.volume`."""
    m, integrals = _Maps.of(basis, moved), reference(basis)
    weights = 2 * np.pi * np.abs(m.det) * (m.r * m.of_det / m.det + m.of_r)
    shares = weights[:, inside].T @ integrals.load
    places = basis.element_dofs.T[inside].ravel()
    return np.asarray(np.bincount(places, shares.ravel(), minlength=basis.N), dtype=float)
