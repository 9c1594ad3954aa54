"""Rings and thermal models that several tests of `coupled` use, and the equations as the paper prints them."""

from __future__ import annotations

import numpy as np
from scipy import constants

import coupled
import surrogate
import thermofem as th

RING = coupled.borghi2021()
SECOND_ORDER = surrogate.second_order(kappa=7.45e5, tau_f=71e-9, tau_s=1030e-9, eta=0.29)
NEWTON = surrogate.newton(tau_th=275e-9)
FIVE = th.Foster(R=[600, 1500, 2000, 2200, 1500], tau=[20e-9, 100e-9, 400e-9, 2e-6, 12e-6])  # slow heat
NETWORKS = {
    1: NEWTON,
    2: SECOND_ORDER,
    16: th.Foster(R=np.linspace(100, 900, 16), tau=np.geomspace(1e-9, 20e-6, 16)),
}
LUMPED = RING.with_lumped_fcd()

# two poles as a quadratic model without quadratic terms, and with every one of them
R, TAU = np.asarray(SECOND_ORDER.R), np.asarray(SECOND_ORDER.tau)
LINEAR = th.Quadratic(np.diag(-1 / TAU), np.zeros((2, 2, 2)), np.zeros((2, 2)), R / TAU, np.ones(2))
DRAW = np.random.default_rng(3)
H = DRAW.normal(size=(2, 2, 2)) * 2e-3 / TAU[:, None, None]
BENT = th.Quadratic(
    np.array([[-1 / TAU[0], 2e5], [1e5, -1 / TAU[1]]]),
    (H + H.transpose(0, 2, 1)) / 2,
    DRAW.normal(size=(2, 2)) * 1e-3 * (R / TAU)[:, None],
    R / TAU,
    np.array([1.0, 0.9]),
)


def delay_loop(ring: coupled.RingResonator, delay: float, loss: float = 3.0, phase: float = 0.0) -> coupled.Circuit:
    """A ring whose through port leads back to its add port: optical feedback with memory."""
    loop = coupled.Waveguide("ring 1.through", "ring 1.add", loss, phase, delay)
    detector = coupled.Detector("drop", "ring 1.drop")
    return coupled.Circuit([ring], (loop,), (coupled.LaserPort("in", "ring 1.in"),), (detector,), name="loop")


def state(poles: int, carriers: float = 1.7) -> np.ndarray:
    """A state off every symmetry: U = 13.4 fJ, 7 K in all."""
    return np.array([-2.3, 2.85, carriers, *np.linspace(1, 2, poles) / np.linspace(1, 2, poles).sum() * 7.0])


def printed_equations(a, N, x, power, detuning, model):
    """Eqs. 1, 2.1-2.5 and Table 1 in SI with Python's complex numbers; returns da/dt, dN/dt, dx/dt in 1/s."""
    w0, n0, n_g, c = 2 * np.pi * 192.88e12, 3.485, 4.4, constants.c
    gamma_e, gamma_i = 43e9, 5.5e9
    g_tpa = 0.999 * c**2 * 8.1e-12 / (2 * n0**2 * constants.hbar * w0 * (4.87e-18) ** 2)
    eta_tpa, eta_fca = 0.992 * c**2 * 8.1e-12 / (2 * n0**2 * 5.35e-18), c * 1.5e-21 / n_g
    U = abs(a) ** 2
    delta = -(1.86e-4 * np.sum(x) - 1.07e-27 * N - 1.63e-22 * N**0.8) / n0
    gamma = 2 * gamma_e + gamma_i + eta_fca * N + eta_tpa * U
    tau = RING.carriers.lifetime(N)
    absorbed = 2 * (gamma - 2 * gamma_e) * U
    da = (1j * (w0 * delta - 2 * np.pi * detuning) - gamma) * a + 1j * np.sqrt(2 * gamma_e * power)
    return da, -N / tau + g_tpa * U**2, (model.R * absorbed - x) / model.tau
