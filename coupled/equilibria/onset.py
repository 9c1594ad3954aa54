"""Where self-pulsing begins and how: the q of Van Vaerenbergh, and the first Lyapunov coefficient of a Hopf point.

With A the Jacobian at a Hopf point, A q = i w q, A^T p = -i w p, <p, q> = 1, and B and C the second and third
derivatives of the right-hand side,

    g = Re [<p, C(q, q, q*)> - 2 <p, B(q, A^-1 B(q, q*))> + <p, B(q*, (2 i w - A)^-1 B(q, q))>]/2
    dr/dt = growth r + g r^3,     x = x_0 + r (q exp(i w t) + q* exp(-i w t))

so that for g < 0 (supercritical) the ring begins to pulse with an amplitude like the root of the distance, and
for g > 0 (subcritical) it jumps to a large pulse and has hysteresis. Only the Jacobian is differentiated, by central
differences along Re q and Im q: B(q, .) = J'(Re q) + i J'(Im q), C(q, q*, .) = J''(Re q) + J''(Im q).

Source: Kuznetsov, Elements of Applied Bifurcation Theory (2004), Section 5.4.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from thermofem import checks
from thermofem.arrays import Array, NDArray
from thermofem.models import ThermalModel

from ..arguments import check_ring
from ..resonator import RingResonator
from ..thermal import compact

STEP = 1e-3  # of the sizes of the states: errors of 1e-6 by truncation and 1e-10 by round-off


def first_lyapunov(
    jacobians: Callable[[Array], Array], x: Array, size: Array, omega: Array, unit: NDArray[np.intp]
) -> tuple[Array, NDArray[np.complex128]]:
    """Return g and all eigenvalues at m Hopf points.

    jacobians: of the states, shape (m, n) to (m, n, n).
    x, size [shape (m, n)]: the fixed points, and sizes of their states for the differences.
    omega [shape (m,)]: near which the eigenvalue i w is looked for.
    unit [shape (m,)]: the state whose amplitude is r: q is scaled to |q[unit]| = 1/2.
    """
    m = np.arange(len(x))
    A = jacobians(x)
    values, vectors = np.linalg.eig(A.astype(complex))
    k = np.abs(values - 1j * omega[:, None]).argmin(axis=1)
    w, q = values[m, k].imag, vectors[m, :, k]
    q = q / (2 * q[m, unit])[:, None]
    left, lefts = np.linalg.eig(A.transpose(0, 2, 1).astype(complex))
    p = lefts[m, :, np.abs(left - values[m, k][:, None]).argmin(axis=1)].conj()
    p = p / np.einsum("mi,mi->m", p.conj(), q).conj()[:, None]
    h = STEP / np.max(np.abs(q) / size, axis=1)
    first, second = np.zeros(A.shape, dtype=complex), np.zeros(A.shape)
    for part, factor in ((q.real, 1), (q.imag, 1j)):
        ahead, behind = jacobians(x + h[:, None] * part), jacobians(x - h[:, None] * part)
        first += factor * (ahead - behind) / (2 * h[:, None, None])
        second += (ahead - 2 * A + behind) / h[:, None, None] ** 2

    def times(M: NDArray[Any], v: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(np.einsum("mij,mj->mi", M, v))

    mean = np.linalg.solve(A.astype(complex), times(first, q.conj())[..., None])[..., 0]
    twice = 2j * w[:, None, None] * np.eye(x.shape[1]) - A
    double = np.linalg.solve(twice, times(first, q)[..., None])[..., 0]
    terms = times(second, q) - 2 * times(first, mean) + times(first.conj(), double)
    return np.einsum("mi,mi->m", p.conj(), terms).real / 2, values


def van_vaerenbergh_q(ring: RingResonator, model: ThermalModel, *, carriers: float = 1e23) -> float:
    """Return q, up to a factor of quality factors, absorbed share and mode volume: compare rings that share those.

        q = sqrt(sigma_FCD tau_fc)/(R_th dn/dT),      R_th = tau_th/(m c_p) for Newton's law

    With a larger q the self-pulsing region lies at more positive detunings. sigma_FCD = |index change|/N and tau_fc are
    taken at the given density where they depend on it.

    Parameters
    ----------
    ring : RingResonator
    model : ThermalModel
        only its small-signal thermal resistance matters.
    carriers : float, 1/m^3
        N.

    Raises
    ------
    InputError
        a density out of range, or a ring without dn/dT.

    Source: Van Vaerenbergh et al., Phys. Rev. A 86, 063808 (2012), as quoted in Borghi et al., Opt. Express 29, 4363
    (2021), Section 4, where raising tau_th from 275 to 450 ns and c_p 8 times gives q = 5 q_0.

    >>> import coupled, thermofem as th
    >>> ring = coupled.borghi2021().with_lumped_fcd()
    >>> first, second = th.Foster(R=[275e-9 / 7.63e-12], tau=[275e-9]), th.Foster(R=[450e-9 / 61e-12], tau=[450e-9])
    >>> print(f"{van_vaerenbergh_q(ring, second) / van_vaerenbergh_q(ring, first):.1f}")
    4.9
    """
    check_ring(ring)
    N = checks.positive("carriers", carriers, unit="1/m^3", at_most=1e28, hint="1e17 cm^-3 is 1e23")
    turned = abs(ring.thermal_shift / ring.index_rate)  # dn/dT, also where the shift was set by with_rates
    dispersion = abs(sum(coefficient * N ** (exponent - 1) for coefficient, exponent in ring.fcd))
    R = float(compact(model).thermal_resistance)
    return math.sqrt(dispersion * float(ring.carriers.lifetime(N))) / (R * turned)
