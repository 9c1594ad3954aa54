"""The small cycles that a Hopf point sheds: their plane, and how large they are.

    x = x_0 + r Re(q exp(i w t)),     J q = i w q,     dr/dt = growth r + g r^3

r is the relative amplitude of the carriers and g the first Lyapunov coefficient (`equilibria.lyapunov`).

Source: Kuznetsov, Elements of Applied Bifurcation Theory (2004), Section 10.2.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thermofem.checks import InputError

from .orbit import FEWEST, Orbit, Problem
from .scheme import scheme

Array = NDArray[np.float64]

SMALL = 0.02  # relative amplitude of the first cycle
KIND = "Hopf curve"


class HopfPoint(NamedTuple):
    """A fixed point with a pair of eigenvalues +- i w."""

    state: Array  # internal units
    vector: NDArray[np.complex128]  # with carriers of the fixed point as its third entry
    omega: float  # rad/ns


def is_hopf_point(guess: Any) -> bool:
    """Whether a guess is one point of a Hopf curve."""
    return bool(getattr(guess, "attrs", {}).get("kind") == KIND)


def laser_of(guess: Any) -> tuple[float, float]:
    """Power in W and detuning in Hz of a point of a Hopf curve."""
    if np.ndim(guess["power"]) != 0:
        raise InputError("guess is a whole Hopf curve; give one point of it, such as curve.isel(point=0)")
    return float(guess["power"]), float(guess["detuning"])


def hopf_point(p: Problem, energy: float, frequency: float) -> HopfPoint:
    """The Hopf point of a problem that has the energy (J) and frequency (Hz)."""
    from ..equilibria import balance, spectrum
    from ..equilibria.steady import absorbable, internal
    from ..kernels import equations as eq

    at = internal(p.ring, p.model, absorbable(p.ring, p.power))
    U = energy / eq.FJ
    _, _, _, shift, _, gamma, _ = balance.balances(np.array([U]), at.rates, at.fcd, at.static)[:, 0]
    D = shift - p.at.detuning
    y, _ = spectrum.state(U, D, at.rates, at.fcd, p.at.thermal, at.static)
    turn = 1j / (gamma - 1j * D)
    turn /= abs(turn)  # `state` has a real field, a problem a real drive
    y[0], y[1] = np.sqrt(U) * turn.real, np.sqrt(U) * turn.imag
    J = eq.jacobian(y, p.at.detuning, p.at.rates, p.at.fcd, p.at.thermal)
    values, vectors = np.linalg.eig(J)
    omega = 2 * np.pi * eq.NS * frequency
    k = int(np.argmin(np.abs(values - 1j * omega)))
    if not abs(values[k] - 1j * omega) < 1e-3 * omega:
        raise InputError("guess is a Hopf point of another ring or model: no pair of eigenvalues is at its frequency")
    return HopfPoint(y, vectors[:, k] * y[2] / vectors[2, k], omega)


def small_cycle(p: Problem, point: HopfPoint, r: float) -> Orbit:
    """The ellipse of relative amplitude ``r``, as a trial orbit."""
    from ..kernels import orbit_mesh

    tau, c = np.linspace(0, 1, FEWEST + 1), scheme().c
    at = np.concatenate([[0.0], orbit_mesh.stages(tau, c)])
    wave = (np.exp(2j * np.pi * at)[:, None] * point.vector).real
    states = point.state + r * wave
    Y = np.ascontiguousarray(states[1:].reshape(FEWEST, c.size, -1))
    return Orbit(states[0].copy(), Y, tau, 2 * np.pi / point.omega, np.empty((0, 0)), np.inf)
