"""One Rosenbrock step of a ring coupled to a quadratic thermal model, dx/dt = A x + H[x, x] + (G x + B) P, dT = C x.

With s = 1/(gamma h) and heat eliminated, what is left is a 3 x 3 system, as for a network (`rosenbrock`):

    k_x = M^-1 (r_x + b (w.k_o)),        M = s - A - 2 H[x, .] - G P,    b = G x + B,    w = d(P_abs)/d(Re a, Im a, N)
    (s - J_o - (C M^-1 b) u w^T) k_o = r_o + u C M^-1 r_x,               u = d(optics)/d(dT)

A step whose heat grows faster than s has no answer (`algebra.follows`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..kernel.tableaus import Tableau
from .algebra import follows, inverse, solve
from .compiling import compiled
from .equations import Array, Rates, absorbed_power, dispersion, optics, optics_jacobian
from .kinds import QuadraticHeat, flow


@compiled
def step(
    y: Array, h: float, pump: Array, detuning: Array, slopes: Array, rates: Rates, fcd: Array, thermal: QuadraticHeat,
    method: Tableau, out: Array, k: Array, total: Array, space: tuple[Array, NDArray[np.int64], Array],
) -> tuple[float, float]:  # fmt: skip
    """Take one step; as `rosenbrock.step`, with workspace of shape (n, n), (n,) and (3, 3 + n).

    Its error is nan where heat alone grows faster than the step can follow.
    """
    n, stages = y.size - 3, method.a.shape[0]
    a, c, s, per_h = method.a, method.c, 1.0 / (method.gamma * h), 1.0 / h
    matrix, order, work = space
    b, x, f = work[0, 3:], work[1], work[2]
    heat = absorbed_power(y[0] * y[0] + y[1] * y[1], y[2], rates)
    start = 0.0
    for i in range(n):
        start += thermal.C[i] * y[3 + i]
        b[i] = thermal.B[i]
        for j in range(n):
            b[i] += thermal.G[i, j] * y[3 + j]
            matrix[i, j] = -thermal.A[i, j] - thermal.G[i, j] * heat
            for m in range(n):
                matrix[i, j] -= 2.0 * thermal.H[i, j, m] * y[3 + m]
        matrix[i, i] += s
    if not follows(matrix, order):
        k[stages - 1, 0] = np.nan
        return start, start
    solve(matrix, order, b)
    G = 0.0
    for i in range(n):
        G += thermal.C[i] * b[i]
    shift, slope = dispersion(y[2], fcd)
    J = optics_jacobian(y[0], y[1], y[2], start, shift, slope, detuning[0], rates)
    u0, u1, w = J[0][3], J[1][3], J[3]
    m3 = inverse(
        (
            (s - J[0][0] - G * u0 * w[0], -J[0][1] - G * u0 * w[1], -J[0][2] - G * u0 * w[2]),
            (-J[1][0] - G * u1 * w[0], s - J[1][1] - G * u1 * w[1], -J[1][2] - G * u1 * w[2]),
            (-J[2][0], -J[2][1], s - J[2][2]),
        )
    )
    ar, ai, N, dT = y[0], y[1], y[2], start
    for q in range(stages):
        ar, ai, N, dT = y[0], y[1], y[2], start
        r0, r1, r2 = 0.0, 0.0, 0.0
        for i in range(n):
            x[3 + i], k[q, 3 + i] = y[3 + i], 0.0
        for j in range(q):
            p, z = a[q, j], c[q, j] * per_h
            ar, ai, N, dT = ar + p * k[j, 0], ai + p * k[j, 1], N + p * k[j, 2], dT + p * total[j]
            r0, r1, r2 = r0 + z * k[j, 0], r1 + z * k[j, 1], r2 + z * k[j, 2]
            for i in range(n):
                x[3 + i] += p * k[j, 3 + i]
                k[q, 3 + i] += z * k[j, 3 + i]
        f0, f1, f2, heat = optics(ar, ai, N, dT, dispersion(N, fcd)[0], pump[q], detuning[q], rates)
        flow(x, heat, thermal, f)
        kx = k[q, 3:]
        for i in range(n):
            kx[i] += f[3 + i]
        solve(matrix, order, kx)
        back = 0.0
        for i in range(n):
            back += thermal.C[i] * kx[i]
        turn = method.slope[q] * h * slopes[1]
        r0, r1, r2 = r0 + f0 + u0 * back + turn * y[1], r1 + f1 + u1 * back - turn * y[0], r2 + f2
        r1 += method.slope[q] * h * slopes[0]
        k0 = m3[0][0] * r0 + m3[0][1] * r1 + m3[0][2] * r2
        k1 = m3[1][0] * r0 + m3[1][1] * r1 + m3[1][2] * r2
        k2 = m3[2][0] * r0 + m3[2][1] * r1 + m3[2][2] * r2
        feedback = w[0] * k0 + w[1] * k1 + w[2] * k2
        for i in range(n):
            k[q, 3 + i] += feedback * b[i]
        k[q, 0], k[q, 1], k[q, 2], total[q] = k0, k1, k2, back + feedback * G
    last = stages - 1
    out[0], out[1], out[2] = ar + k[last, 0], ai + k[last, 1], N + k[last, 2]
    for i in range(n):
        out[3 + i] = x[3 + i] + k[last, 3 + i]
    return start, dT + total[last]
