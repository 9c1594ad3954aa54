"""A closed orbit in internal units, and the two ways to one: along a trace, and by Newton's method on a mesh."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import window
from ..kernels.collocation import Ring
from ..kernels.interrupts import new_watch, uninterrupted
from ..kernels.tableaus import Method, tableau
from ..resonator import RingResonator
from ..thermal import Compact
from .scheme import scheme

Array = NDArray[np.float64]

INTERVALS = 40  # of the first mesh, for each pulse of a period
FEWEST, MOST_INTERVALS = 20, 3000
POLYNOMIAL = 3e-7  # error of the polynomials between the stages; periods are far better (order 9, not 6)
GROWTH = 1.5  # of a mesh at most
SLACK = 8.0  # by how much the worst interval may exceed it
CLOSE_ENOUGH = 1e-7  # a step of Newton's method that small leaves less than its square times a hundred
TRACE_RTOL = 1e-5
SHOTS, STEPS = 12, 12  # of Newton's method along traces, and on a mesh
NEAR = 0.1  # of the largest values: a step that small is taken on the mesh
LONGEST_RETURN = 4.0  # periods
LARGEST_CHANGE = 0.3  # of the largest heat, in a step along a trace
NO_TIMES = np.empty(0)


class CycleProblem(NamedTuple):
    """One ring, heat and laser, in the units of the compiled code."""

    at: Ring
    floor: Array
    units: Array  # of the states, in SI
    ring: RingResonator
    model: Compact
    power: float  # W
    detuning: float  # Hz


class Orbit(NamedTuple):
    """A closed orbit on a mesh, in internal units."""

    start: Array  # shape (m,)
    Y: Array  # states at the stages, shape (N, s, m)
    tau: Array  # mesh as fractions of the period, shape (N + 1,)
    T: float  # ns
    M: Array  # derivative of the return map, shape (m, m)
    move: float  # size of the last step of Newton's method

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """Floquet multipliers, the largest modulus first."""
        found = np.linalg.eigvals(self.M).astype(complex)
        return np.asarray(found[np.argsort(-np.abs(found))])


def problem(ring: RingResonator, model: Compact, power: float, detuning: float) -> CycleProblem:
    """Return ring, heat (`thermal.compact`) and laser in internal units."""
    from ..kernels import equations as eq

    rates, fcd = eq.internal_rates(ring)
    drive = eq.internal_drive(ring, power)
    thermal = eq.internal_thermal(model)
    at = Ring(drive, eq.internal_detuning(detuning), rates, fcd, thermal)
    floor = window.floor_of(rates, drive, model.thermal_resistance * eq.UW)
    return CycleProblem(at, floor, window.units(thermal.order), ring, model, power, detuning)


def run(p: CycleProblem, y: Array, duration: float, level: float = np.inf) -> tuple[Array, Array, bool]:
    """Integrate over ``duration`` in ns, or until the carriers rise through ``level``.

    Returns rows (t, Re a, Im a, N, dT) at the accepted steps, the state at the end, and whether the level was met.
    """
    from ..kernels import rosenbrock

    laser = window.constant_laser(0.0, duration * 1e-9, p.at.drive, p.at.detuning)
    event = np.array([2.0, level, 1.0]) if level < np.inf else np.zeros(3)
    rows, end, reached, _, _, counts = uninterrupted(
        rosenbrock.integrate, y, laser, p.at.rates, p.at.fcd, p.at.thermal, tableau(Method.RODAS4), TRACE_RTOL,
        p.floor, NO_TIMES, 1, 0.0, event, window.MAX_STEPS, new_watch(),
    )  # fmt: skip
    window.check_end(counts, reached, duration * 1e-9, TRACE_RTOL)
    return rows, end, bool(counts[2] == rosenbrock.EVENT)


def around(p: CycleProblem, y: Array, T: float, pulses: int) -> tuple[Array, Array] | None:
    """Integrate until the carriers have risen ``pulses`` times through their value in ``y``; rows, and the end."""
    parts: list[Array] = []
    level = float(y[2])
    for _ in range(pulses):
        y = y.copy()
        y[2] = level * (1 + 1e-12)  # above it, so that the level is met after the pulse and not at once
        rows, y, met = run(p, y, LONGEST_RETURN * T, level)
        if not met:
            return None
        if parts:
            rows[:, 0] += parts[-1][-1, 0]
        parts.append(rows[1:] if parts else rows)
    return np.concatenate(parts), y


def shoot(
    p: CycleProblem, y: Array, T: float, pulses: int = 1, error: float = POLYNOMIAL, shots: int = SHOTS
) -> Orbit | None:
    """Close an orbit from a state on it whose carriers rise, near ``T`` ns; None where Newton's method finds none.

    Far from the orbit every step integrates anew until the carriers return, so that the pulses stay where the equations
    put them; near it the stages of a fixed mesh move.
    """
    from ..kernels import orbit_heat, orbits

    way, section = scheme(), np.eye(1, y.size + 1, 2)  # the beginning keeps its carriers
    for _ in range(shots):
        found = around(p, y, T, pulses)
        if found is None:
            return None
        rows, _ = found
        T, tau = float(rows[-1, 0]), _mesh(rows[:, 0], INTERVALS * pulses)
        Y = orbit_heat.along(rows, y, tau, p.at, way)
        none = np.empty((*Y.shape, 0))
        changes, stages, _, move = orbits.advance(y, Y, tau, T, p.at, way, none, section, np.zeros((1, 1)))
        first, turn, change = changes[0, :-1], float(changes[0, -1]), stages[0]
        if not move < np.inf:
            return None
        share = min(1.0, LARGEST_CHANGE * abs(Y[:, -1, 3:]).max() / max(np.abs(first[3:]).max(), 1e-30))
        if move < NEAR:
            closed = settle(p, Orbit(y + first, Y + change, tau, T + turn, np.empty((0, 0)), move), error)
            if closed is not None:
                return closed
        y = y + share * first
    return None


def settle(p: CycleProblem, trial: Orbit, error: float = POLYNOMIAL) -> Orbit | None:
    """Close a trial orbit on its mesh, and on finer ones until the polynomials between the stages err by ``error``."""
    from ..kernels import orbits

    way = scheme()
    y, Y, tau, T = trial[:4]
    unit = error ** (1 / (way.c.size + 1))
    fine = error <= POLYNOMIAL
    tolerance = 1e-3 if fine else CLOSE_ENOUGH  # the first mesh is the trace's, and good for a rough answer
    for _ in range(8):
        y, Y, T, M, closed, move = orbits.close(y, Y, tau, T, p.at, way, tolerance, STEPS)
        if not closed or not T > 0:
            return None
        closed_orbit = Orbit(y, Y, tau, T, np.ascontiguousarray(M[:, : y.size]), move)
        finer, worst, _ = remeshed(closed_orbit, p.at.thermal, error)
        if tolerance == CLOSE_ENOUGH and worst <= SLACK ** (1 / (way.c.size + 1)) * unit:
            return closed_orbit
        if finer.tau.size - 1 > MOST_INTERVALS:
            return None
        tolerance, Y, tau = CLOSE_ENOUGH, finer.Y, finer.tau
    return None


def remeshed(orbit: Orbit, thermal: Any, error: float) -> tuple[Orbit, float, int]:
    """The orbit on a mesh for ``error``; the worst density on its own; how many intervals are wanted."""
    from ..kernels import orbit_mesh

    way, (y, Y, tau) = scheme(), orbit[:3]
    unit = error ** (1 / (way.c.size + 1))
    parts = (density := orbit_mesh.densities(y, Y, tau, way, thermal)) * np.diff(tau)
    wanted = max(int(1.1 * parts.sum() / unit) + 1, FEWEST)
    number = min(wanted, int(GROWTH * (tau.size - 1)))  # a rough mesh tells more than there is
    finer = orbit_mesh.spaced(tau, density, number)
    between = orbit_mesh.interpolate(y, Y, tau, way, orbit_mesh.stages(finer, way.c))
    return orbit._replace(Y=between.reshape(number, way.c.size, y.size), tau=finer), float(parts.max()), wanted


def _mesh(t: Array, number: int) -> Array:
    """A mesh with as many steps of the integration in every interval."""
    where = np.interp(np.linspace(0, 1, number + 1), np.linspace(0, 1, t.size), (t - t[0]) / (t[-1] - t[0]))
    return np.asarray(where)
