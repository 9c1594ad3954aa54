"""Thermal laws as papers print them: Newton's law and the second-order equation, by their parameters."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class NewtonParameters:
    """dT/dt = -dT/tau_th + P_abs/(m c_p), Eq. 2.3 of Borghi et al., Opt. Express 29, 4363 (2021)."""

    tau_th: float
    """s"""
    heat_capacity: float
    """m c_p in J/K"""


@dataclass(frozen=True)
class SecondOrderParameters:
    """Eq. 3 there: dT'' + (1/tau_f + 1/tau_s) dT' + dT/(tau_f tau_s) = (kappa P_abs + eta P_abs')/(m c_p).

    The print leaves m c_p out of the last term; with it eta is the dimensionless number that the text quotes.
    """

    kappa: float
    """1/s"""
    tau_f: float
    """s"""
    tau_s: float
    """s"""
    eta: float
    """dimensionless"""
    heat_capacity: float
    """m c_p in J/K"""
