"""Is an oscillation born small or large? The first Lyapunov coefficient of a Hopf point.

With A the Jacobian at a Hopf point, A q = i w q, A^T p = -i w p, <p, q> = 1, and B and C the second and third
derivatives of the right-hand side,

    g = Re [<p, C(q, q, q*)> - 2 <p, B(q, A^-1 B(q, q*))> + <p, B(q*, (2 i w - A)^-1 B(q, q))>]/2
    dr/dt = growth r + g r^3,     x = x_0 + r (q exp(i w t) + q* exp(-i w t))

so that for g < 0 (supercritical) the ring begins to pulse with an amplitude like the root of the distance, and
for g > 0 (subcritical) it jumps to a large pulse and has hysteresis. Only the Jacobian is differentiated, by central
differences along Re q and Im q: B(q, .) = J'(Re q) + i J'(Im q), C(q, q*, .) = J''(Re q) + J''(Im q).

Source: Kuznetsov, Elements of Applied Bifurcation Theory (2004), Section 5.4.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from thermofem.arrays import Array, NDArray

STEP = 1e-3  # of the sizes of the states: errors of 1e-6 by truncation and 1e-10 by round-off


def first_lyapunov(
    jacobian: Callable[[Array], Array], x: Array, size: Array, omega: float, unit: int
) -> tuple[float, NDArray[np.complex128]]:
    """Return g and all eigenvalues at a Hopf point.

    jacobian: of the state, shape (n,) to (n, n).
    x, size [shape (n,)]: the fixed point, and sizes of its states for the differences.
    omega: near which the eigenvalue i w is looked for.
    unit: the state whose amplitude is r: q is scaled to |q[unit]| = 1/2.
    """
    A = jacobian(x)
    values, vectors = np.linalg.eig(A)
    k = int(np.argmin(np.abs(values - 1j * omega)))
    w, q = float(values[k].imag), vectors[:, k]
    q = q / (2 * q[unit])
    left, lefts = np.linalg.eig(A.T)
    p = lefts[:, int(np.argmin(np.abs(left - values[k])))].conj()
    p = p / np.vdot(p, q).conj()
    h = STEP / float(np.max(np.abs(q) / size))
    first, second = np.zeros(A.shape, dtype=complex), np.zeros(A.shape)
    for part, factor in ((q.real, 1), (q.imag, 1j)):
        ahead, behind = jacobian(x + h * part), jacobian(x - h * part)
        first += factor * (ahead - behind) / (2 * h)
        second += (ahead - 2 * A + behind) / h**2
    eye = np.eye(x.size)
    mean = np.linalg.solve(A, first @ q.conj())
    double = np.linalg.solve(2j * w * eye - A, first @ q)
    terms = second @ q - 2 * first @ mean + first.conj() @ double
    return float(np.vdot(p, terms).real / 2), values
