"""Small cycles beside a Hopf point: where a branch of cycles begins and ends.

    x = x_0 + r Re(q exp(i w t)),     J q = i w q,     dr/dt = growth r + g r^3

r is the relative amplitude of the carriers and g the first Lyapunov coefficient (`equilibria.onset`). A branch of
ever smaller cycles ends where a pair of eigenvalues crosses the imaginary axis, found by the secant method on the real
part; its last "cycle" is the fixed point itself.

Source: Kuznetsov, Elements of Applied Bifurcation Theory (2004), Section 10.2.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import expm
from scipy.optimize import newton

from thermofem import checks
from thermofem.arrays import Array, NDArray
from thermofem.checks import InputError
from thermofem.data.variables import contents

from ..arguments import check_detuning, check_power
from ..equilibria.balance import balance, fixed_points
from ..equilibria.spectrum import states
from ..heaters import turned_by
from ..kernel.tableaus import Method
from ..kernel.units import FJ, NS
from .cycle_problem import CycleProblem
from .multiple_shooting import Family, Nodes, Place, corrected, extent_of, flow, weights
from .orbit_measures import time_weights
from .return_map import FINE, PER_STEP, Orbit, Trace

SMALL, FAINT = 0.02, 1e-3  # relative amplitude of the first cycle; of one still nearer to the Hopf point
KIND = "Hopf curve"


class HopfPoint(NamedTuple):
    """A fixed point with a pair of eigenvalues +- i w."""

    state: Array  # internal units
    vector: NDArray[np.complex128]  # with -i times the carriers of the fixed point as its third entry
    omega: float  # rad/ns


def is_hopf_point(guess: Any) -> bool:
    """Whether a guess is one point of a Hopf curve."""
    kind = getattr(guess, "attrs", {}).get("kind")
    return isinstance(kind, str) and kind == KIND


def laser_of(guess: Any, turn: float = 0.0) -> tuple[float, float]:
    """Power in W and detuning in Hz of a point of a Hopf curve; heaters turn the resonance by ``turn`` in Hz."""
    if np.ndim(guess["power"] if "power" in getattr(guess, "variables", {}) else 0.0) != 0:
        raise InputError("guess is a whole Hopf curve; give one point of it, such as curve.isel(point=0)")
    what = "one point of a Dataset of coupled.hopf_curves, such as curve.isel(point=0)"
    contents("guess", guess, ("power", "detuning", "energy", "frequency"), what=what)
    for name, unit in (("energy", "J"), ("frequency", "Hz")):
        checks.positive(f"guess[{name!r}]", guess[name].item(), unit=unit, hint=what)
    power = check_power(guess["power"].item(), "guess['power']")
    return power, check_detuning(guess["detuning"].item(), "guess['detuning']") - turn


def at_rest(p: CycleProblem, U: float, D: float) -> tuple[Array, Array]:
    """The fixed point (U, D) of a problem, and its Jacobian; under a real pump the field turns as i/(gamma - i D)."""
    y = states(np.array([U]), np.array([D]), p.internal)[0][0]
    turn = 1j / (float(balance(U, p.internal).gamma) - 1j * D)
    y[:2] = np.sqrt(U) * (np.array([turn.real, turn.imag]) / abs(turn))
    return y, p.kernel(Method.RODAS4).slopes(y)[1]


def hopf_point(p: CycleProblem, guess: Any) -> HopfPoint:
    """The Hopf point of a problem that a point of a Hopf curve names by its energy and frequency."""
    U, omega = float(guess["energy"]) / FJ, 2 * np.pi * NS * float(guess["frequency"])
    y, J = at_rest(p, U, float(balance(U, p.internal).shift) - p.laser[1])
    values, vectors = np.linalg.eig(J)
    k = int(np.argmin(np.abs(values - 1j * omega)))
    if not abs(values[k] - 1j * omega) < 1e-3 * omega:
        raise InputError("guess is a Hopf point of another ring or model: no pair of eigenvalues is at its frequency")
    return HopfPoint(y, -1j * vectors[:, k] * y[2] / vectors[2, k], omega)


def born(family: Family, guess: Any, size: float = SMALL) -> tuple[Place, Array]:
    """A small cycle of a family beside a Hopf point, and the tangent of its branch away from it.

    size: relative amplitude of its carriers.
    """
    p = family.base
    power, detuning = laser_of(guess, turned_by(p.rise, p.ring))
    point = hopf_point(replace(p, power=power, detuning=detuning), guess)
    outward, T = np.concatenate([point.vector.real, [0.0, 0.0]]), 2 * np.pi / point.omega
    for r in (size, size / 4):
        trial = Nodes((point.state + r * point.vector.real)[None], np.array([T]), family.start())
        turn = flow(p.flow.fine, trial.y[0], T, FINE).rows
        unit = weights(family, p.flow.scale(turn), T)
        row = outward * unit
        found = corrected(family, trial, (row / np.linalg.norm(row))[None], unit, extent=extent_of(turn))
        if found is not None and relative_range(family, found) > r / 4:
            tangent = found.directions[0] * found.unit
            return found, tangent * np.sign(tangent @ (outward * found.unit)) / np.linalg.norm(tangent)
    raise InputError("no small cycle was found at the Hopf point given as guess: Newton's method finds none")


def relative_range(family: Family, place: Place) -> float:
    """Largest less smallest of the carriers, over the largest."""
    seen = family.base.flow.seen(place.orbit.trace.rows)
    return float(np.ptp(seen) / seen.max())


def hopf_near(family: Family, place: Place) -> Place | None:
    """The Hopf point near a small cycle of a family with one parameter; None where there is none."""
    orbit, start, span = place.orbit, float(place.values[0]), float(family.ranges[0])
    energy = float(time_weights(orbit) @ (orbit.trace.rows[:, 1:3] ** 2).sum(axis=1)) / orbit.T

    def pair(value: float) -> tuple[Array, complex, Array]:
        """The fixed point of about that energy, its eigenvalue of about that frequency, and its Jacobian."""
        p = family.at(np.array([value]))
        U, D, _ = fixed_points(*p.laser, p.internal)
        k = int(np.argmin(np.abs(U - energy)))
        y, J = at_rest(p, U[k], D[k])
        values = np.linalg.eigvals(J).astype(complex)
        return y, complex(values[np.argmin(np.abs(values - 2j * np.pi / orbit.T))]), J

    try:
        value = float(newton(lambda v: pair(v)[1].real, start, x1=start + 1e-5 * span, tol=1e-11 * span, maxiter=20))
        y, root, J = pair(value)
    except (RuntimeError, ValueError):
        return None
    T = 2 * np.pi / root.imag
    if abs(value - start) > 0.05 * span or abs(T - orbit.T) > 0.1 * orbit.T:
        return None
    row = flow(family.at(np.array([value])).kernel(Method.RODAS4), y, 1e-3, 1e-5).rows[0]
    rows = np.column_stack([np.linspace(0, T, PER_STEP + 1), np.tile(row[1:], (PER_STEP + 1, 1))])
    rest = Orbit(Trace(y, y, T, rows, [(y, np.array([T]))]), expm(J * T), 0.0)
    return place._replace(nodes=Nodes(y[None], np.array([T]), np.array([value])), orbit=rest)
