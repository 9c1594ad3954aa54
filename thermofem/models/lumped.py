"""The two lumped thermal models of the paper, as Foster networks.

Source: M. Borghi, D. Bazzanella, M. Mancinelli, L. Pavesi, Opt. Express 29, 4363 (2021), Eqs. (2.3) and (3).
"""

from __future__ import annotations

import numpy as np

from .. import checks
from .foster import Foster

BORGHI2021_HEAT_CAPACITY = 1.09e-14 * 700.0  # J/K: mass 1.09e-14 kg x 700 J/(kg K), Appendix A


def newton(*, tau_th: float, heat_capacity: float = BORGHI2021_HEAT_CAPACITY) -> Foster:
    """Newton's law of cooling: one pole.

        d(dT)/dt = -dT/tau_th + P/(m c_p)                                  (Eq. 2.3)

    Parameters
    ----------
    tau_th : float, s
    heat_capacity : float, J/K
        m c_p of the heated core; the default is the paper's resonator.

    Raises
    ------
    InputError
        a value that is not positive, or out of range by a unit.
    """
    tau_th = checks.positive("tau_th", tau_th, unit="s", at_most=1e6, hint="times are in s (did you mean 275e-9?)")
    heat_capacity = check_heat_capacity(heat_capacity)
    return Foster(R=[tau_th / heat_capacity], tau=[tau_th])


def second_order(
    *, kappa: float, tau_f: float, tau_s: float, eta: float, heat_capacity: float = BORGHI2021_HEAT_CAPACITY
) -> Foster:
    """The paper's second-order equation: a fast and a slow pole.

        dT'' + (1/tau_f + 1/tau_s) dT' + dT/(tau_f tau_s) = (kappa P + eta dP/dt) / (m c_p)      (Eq. 3)

    which is exactly two parallel poles, so that dP/dt is never evaluated:

        dx_i/dt = -x_i/tau_i + c_i P/(m c_p),   c_f = (eta/tau_f - kappa)/(1/tau_f - 1/tau_s),   c_s = eta - c_f

    Both driving terms are divided by m c_p here; the print divides only the first, which leaves eta with a unit that
    its quoted value 0.31 does not have.

    Parameters
    ----------
    kappa : float, 1/s
    tau_f, tau_s : float, s
        fast and slow time constant, tau_f < tau_s.
    eta : float
    heat_capacity : float, J/K

    Raises
    ------
    InputError
        a value that is not positive, out of range by a unit, or tau_f >= tau_s.

    >>> model = second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1200e-9, eta=0.31)
    >>> print(f"{model.thermal_resistance:.1f}")
    7784.2
    """
    hint = "times are in s (did you mean 55.8e-9?)"
    tau_f = checks.positive("tau_f", tau_f, unit="s", at_most=1e6, hint=hint)
    tau_s = checks.positive("tau_s", tau_s, unit="s", at_most=1e6, hint=hint)
    kappa = checks.positive("kappa", kappa, unit="1/s", at_most=1e12, hint="8.87e-4 /ns is 8.87e5 1/s")
    eta = checks.positive("eta", eta, at_most=100, hint="eta has no unit")
    if tau_f >= tau_s:
        raise checks.InputError(f"tau_f = {tau_f:g} s must be below tau_s = {tau_s:g} s; are they swapped?")
    fast, slow = 1 / tau_f, 1 / tau_s
    if not eta * slow <= kappa <= eta * fast:
        raise checks.InputError(
            f"kappa = {kappa:g} 1/s must lie between eta/tau_s = {eta * slow:g} and eta/tau_f = {eta * fast:g} 1/s, "
            "or one of the poles cools when heated; is it in 1/s (8.87e-4 /ns is 8.87e5)?"
        )
    return second_order_poles(kappa, tau_f, tau_s, eta, check_heat_capacity(heat_capacity))


def second_order_poles(kappa: float, tau_f: float, tau_s: float, eta: float, heat_capacity: float) -> Foster:
    """The two poles of Eq. 3 for any values: an R may be negative. `second_order` checks them first."""
    fast, slow = 1 / tau_f, 1 / tau_s
    c_f = (eta * fast - kappa) / (fast - slow)
    c_s = (kappa - eta * slow) / (fast - slow)
    return Foster(R=[c_f * tau_f / heat_capacity, c_s * tau_s / heat_capacity], tau=[tau_f, tau_s])


def second_order_parameters(model: Foster, heat_capacity: float = BORGHI2021_HEAT_CAPACITY) -> dict[str, float]:
    """The parameters of Eq. 3 of a network with two poles, the inverse of `second_order_poles`.

        kappa = c_f/tau_s + c_s/tau_f,     eta = c_f + c_s,     c_i = m c_p R_i/tau_i

    >>> found = second_order_parameters(second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1.2e-6, eta=0.31))
    >>> print(f"{found['kappa']:.4g}, {found['eta']:.4g}")
    8.87e+05, 0.31
    """
    tau, c = np.asarray(model.tau, dtype=float), model.gain * heat_capacity  # in order of tau: fast, slow
    return {
        "kappa": float(c[0] / tau[1] + c[1] / tau[0]),
        "tau_f": float(tau[0]),
        "tau_s": float(tau[1]),
        "eta": float(c.sum()),
    }


def check_heat_capacity(value: float) -> float:
    """``value``, or InputError unless it is a heat capacity in J/K."""
    hint = "m c_p is in J/K (the paper's resonator has 7.63e-12)"
    return checks.positive("heat_capacity", value, unit="J/K", at_most=1e6, hint=hint)
