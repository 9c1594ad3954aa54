"""Fields of members on the reference mesh, and the few functions that hold them all.

Every member is reduced first (`surrogate.reduce`). Its fields x(s) = (K + s M)^-1 c at many shifts, on the real and on
the imaginary axis, are then combinations of a few modes. Each is divided by the square root of |Z(s)|: a projection
that leaves the share e of its energy errs by about e in Z(s).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from thermofem import HeatProblem
from thermofem.arrays import Array

from .certify import own
from .reduced import MemberModes

PER_DECADE = 4  # shifts
FASTEST = 1e10  # 1/s; faster poles do not change the step response after 1 ns
NEGLIGIBLE = 1e-5  # of the tolerance: energy of a mode of the snapshots that is left out


@dataclass(frozen=True, eq=False)
class Member:
    """A member solved on the reference mesh.

    row [shape (p,)]
    modes: its certified reduction.
    static [shape (unknowns, ports)]: fields at s = 0, of unit energy.
    fields [shape (unknowns, m)]: orthogonal combinations of the fields at all shifts, their energies decreasing.
    """

    row: Array
    modes: MemberModes
    static: Array
    fields: Array


def solved(row: Array, heat: HeatProblem, ports: tuple[str, ...], tolerance: float) -> Member:
    """Reduce one ring of the family and compute its temperature fields at many shifts."""
    modes, found = own(heat, ports, tolerance)
    rate, beta = found.projection.rate, found.projection.ports  # (k,), (k, ports)
    slow = min(rate[0], FASTEST / 10)
    real = np.append(0.0, np.geomspace(slow, FASTEST, int(PER_DECADE * np.log10(FASTEST / slow))))
    weights, scale = [], found.projection.gain.diagonal()
    for p in range(len(ports)):
        for s in (*real, *(1j * real[1:])):
            y = beta[:, p] / (rate + s)
            size = np.sqrt(abs(beta[:, p] @ y))
            weights += [y.real / size, y.imag / size] if np.iscomplexobj(y) else [y / size]
    W = np.array(weights).T  # modes by snapshots; energy of a mode is its rate
    u, s, _ = np.linalg.svd(np.sqrt(rate)[:, None] * W, full_matrices=False)
    kept = s**2 > NEGLIGIBLE * tolerance
    fields = found.basis @ (u[:, kept] * s[kept] / np.sqrt(rate)[:, None])
    static = found.basis @ (beta / rate[:, None] / np.sqrt(scale))
    return Member(row, modes, static, fields)


def extended(V: Array, X: Any, fields: Array, least: float) -> Array:
    """Extend X-orthonormal functions V by the principal directions of the fields outside their span, down to an energy.

    V [shape (n, k)]
    X [sparse, shape (n, n)]: inner product.
    fields [shape (n, m)]
    least: energy of the weakest direction that is added.
    """
    for _ in range(2):
        fields = fields - V @ (V.T @ (X @ fields))
    gram = fields.T @ (X @ fields)
    value, vector = np.linalg.eigh((gram + gram.T) / 2)
    value, vector = value[::-1], vector[:, ::-1]
    count = int((value > max(least, 1e-13 * max(value[0], 1.0))).sum())
    if not count:
        return V
    new = fields @ (vector[:, :count] / np.sqrt(value[:count]))
    new = new - V @ (V.T @ (X @ new))
    lower = np.linalg.cholesky(new.T @ (X @ new))
    return np.hstack([V, np.linalg.solve(lower, new.T).T])
