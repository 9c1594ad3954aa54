"""The collocation method of the cycles: Radau IIA with five stages, order 9.

    sum_l A_jl c_l^(q-1) = c_j^q / q,   q = 1 .. s;     c_1 .. c_(s-1): zeros of the Jacobi polynomial (1, 0), c_s = 1

Light that follows within 10 ps makes the equations stiff, so the method must be stiffly accurate: Gauss points lose
their order there.

Source: Hairer and Wanner, Solving Ordinary Differential Equations II (1996), Section IV.5.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.special import roots_jacobi

from ..kernels.collocation import Scheme

STAGES = 5


@cache
def scheme(stages: int = STAGES) -> Scheme:
    """Return the coefficients for ``stages`` stages."""
    c = np.append((1 + roots_jacobi(stages - 1, 1, 0)[0]) / 2, 1.0)
    powers = np.arange(stages)
    A = np.linalg.solve((c[:, None] ** powers).T, (c[:, None] ** (powers + 1) / (powers + 1)).T).T
    values, vectors = np.linalg.eig(A.astype(complex))
    forth = np.linalg.inv(vectors)
    kept = np.flatnonzero(values.imag > -1e-12)
    twice = np.where(np.abs(values[kept].imag) > 1e-12, 2.0, 1.0)
    nodes = np.concatenate([[0.0], c])
    gaps = nodes[:, None] - nodes + np.eye(stages + 1)
    rows = np.ascontiguousarray(forth[kept])
    return Scheme(
        c=c,
        A=np.ascontiguousarray(A),
        eigenvalue=np.ascontiguousarray(values[kept]),
        back=np.ascontiguousarray(vectors[:, kept] * twice),
        forth=rows,
        one=np.ascontiguousarray(rows.sum(axis=1)),
        top=1 / gaps.prod(axis=1),
    )
