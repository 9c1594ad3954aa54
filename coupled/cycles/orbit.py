"""A closed orbit in internal units, and the two ways to one: along a trace, and by Newton's method on a mesh."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from thermofem.arrays import Array, NDArray
from thermofem.checks import InputError

from ..heaters import turned_by
from ..kernel.tableaus import Method, tableau
from ..kernels.collocation import Ring
from ..kernels.interrupts import new_watch, uninterrupted
from ..resonator import RingResonator
from ..runs import window
from ..thermal import Compact
from .scheme import scheme

FIRST, ROUGH = (0.4, 1e-3), (0.23, 2e-4)  # intervals for each step of a trace; a step of Newton's method that will do
FEWEST, MOST_INTERVALS = 20, 3000
POLYNOMIAL = 3e-7  # error of the polynomials between the stages; periods are far better (order 9, not 6)
GROWTH = 1.5  # of a mesh at most
SLACK = 8.0  # by how much the worst interval may exceed it
RESOLVED = 1e-7  # of the multiplier along the orbit, which is 1: a pulse much shorter than the period may be missed
ROUGHLY = 3e-5  # of the same, for a rough orbit: the period then errs by some 1e-6 at most
FINE_SHARES, AGREE = (0.1, 0.2, 0.4, 0.8), 1e-6  # of precise traces; relative difference of two equal periods
CLOSE_ENOUGH = 1e-7  # a step of Newton's method that small leaves less than its square times a hundred
TRACE_RTOL, FINE_RTOL = 1e-5, 1e-7  # of traces; the second for pulses some thousand times shorter than the period
SHOTS, FEW_SHOTS, STEPS = 12, 8, 12  # of Newton's method along traces, the same for a rough orbit, and on a mesh
UNKNOWN = np.empty((0, 0))


class CycleProblem(NamedTuple):
    """One ring, heat and laser, in the units of the compiled code."""

    at: Ring
    floor: Array
    units: Array  # of the states, in SI
    ring: RingResonator
    model: Compact
    power: float  # W
    detuning: float  # Hz
    rise: float = 0.0  # K, by constant heaters


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

    @property
    def off(self) -> float:
        """Distance from 1 of the multiplier that belongs to the direction along the orbit."""
        return float(np.abs(self.multipliers - 1).min())


def has_carriers(ring: RingResonator) -> bool:
    """Whether light generates free carriers."""
    return ring.g_tpa > 0


def check_carriers(ring: RingResonator) -> None:
    """InputError for a ring without carriers: pulses are told by them."""
    if not has_carriers(ring):
        raise InputError(
            "ring has no two-photon absorption and so no free carriers, by which settled cycles are followed; "
            "simulate and pulsing, or pulsing_map with a duration, show whether it pulses"
        )


def problem(ring: RingResonator, model: Compact, power: float, detuning: float, rise: float = 0.0) -> CycleProblem:
    """Return ring, heat (`thermal.compact`) and laser in internal units; heaters add ``rise`` in K.

    Raises InputError: a ring without carriers.
    """
    from ..kernels import equations as eq

    check_carriers(ring)
    rates, fcd = eq.internal_rates(ring)
    pump = eq.internal_pump(ring, power)
    thermal = eq.internal_thermal(model)
    at = Ring(pump, eq.internal_detuning(detuning + turned_by(rise, ring)), rates, fcd, thermal)
    floor = window.floor_of(rates, pump, model.thermal_resistance * eq.UW)  # type: ignore[arg-type]
    return CycleProblem(at, floor, window.units(thermal.order), ring, model, power, detuning, rise)


def until(p: CycleProblem, y: Array, duration: float, level: float) -> Array | None:
    """Integrate until the carriers rise through ``level``; the state there, None if not within ``duration`` in ns."""
    from ..kernels import orbit_return, rosenbrock

    _, end, reached, _, _, counts = uninterrupted(
        orbit_return.integrated, y, duration, level, p.at, p.floor, tableau(Method.RODAS4), TRACE_RTOL, 0.0,
        new_watch(),
    )  # fmt: skip
    if counts[2] == rosenbrock.EVENT:
        return np.asarray(end)
    window.check_end(counts, reached, duration * 1e-9, TRACE_RTOL)
    return None


def around(p: CycleProblem, y: Array, T: float, pulses: int) -> tuple[Array, Array] | None:
    """Integrate until the carriers have risen ``pulses`` times through their value in ``y``; rows, and the end."""
    from ..kernels import orbit_return

    rows, end, met = uninterrupted(
        orbit_return.around, y, T, pulses, p.at, p.floor, tableau(Method.RODAS4), TRACE_RTOL, new_watch()
    )
    return (rows, end) if met else None


def shoot(
    p: CycleProblem, y: Array, T: float, pulses: int = 1, rough: bool = False, *,
    rtol: float = TRACE_RTOL,
) -> Orbit | None:  # fmt: skip
    """Close an orbit from a state on it whose carriers rise, near ``T`` ns; None where Newton's method finds none.

    Far from the orbit every step integrates anew until the carriers return, so that the pulses stay where the equations
    put them; near it the stages of a fixed mesh move. A ``rough`` orbit is one on the mesh of a trace; `pulsing_map`
    states how far its period errs. ``rtol`` is that of the traces.
    """
    if rough:
        return _near(p, y, T, pulses, rtol, *ROUGH, FEW_SHOTS, ROUGHLY)
    trial = _near(p, y, T, pulses, rtol, *FIRST, SHOTS)
    found = None if trial is None else settle(p, trial)
    if found is not None:
        return found
    return _along_traces(p, y, T, pulses) if trial is None else _along_traces(p, trial.start, trial.T, pulses)


def _along_traces(p: CycleProblem, y: Array, T: float, pulses: int) -> Orbit | None:
    """The orbit on meshes of precise traces, where the remeshed one does not close or passes by a pulse."""
    found = None
    for share in FINE_SHARES:
        trial = _near(p, y, T, pulses, FINE_RTOL, share, CLOSE_ENOUGH, SHOTS)
        if trial is not None and found is not None and abs(trial.T - found.T) <= AGREE * trial.T:
            return trial
        found = trial or found
    return None


def _near(
    p: CycleProblem, y: Array, T: float, pulses: int, rtol: float, share: float, step: float, shots: int,
    resolved: float = np.inf,
) -> Orbit | None:  # fmt: skip
    """`orbit_return.near` as an Orbit; None where it found none."""
    from ..kernels import orbit_return

    start, Y, tau, T, M, move = uninterrupted(
        orbit_return.near, y, T, pulses, UNKNOWN, p.at, p.floor, scheme(), tableau(Method.RODAS4), rtol, share, step,
        shots, resolved, new_watch(),
    )  # fmt: skip
    return Orbit(start, Y, tau, float(T), M, float(move)) if move < np.inf else None


def closer(p: CycleProblem, trial: Orbit, tolerance: float = CLOSE_ENOUGH, most: int = STEPS) -> Orbit:
    """Close a trial orbit on its mesh; one whose ``move`` stays above the ``tolerance`` did not close."""
    from ..kernels import orbits

    y, Y, T, M, closed, move = orbits.close(*trial[:4], p.at, scheme(), tolerance, most)
    move = float(move) if closed and T > 0 else np.inf
    return Orbit(y, Y, trial.tau, float(T), np.ascontiguousarray(M[:, : y.size]), move)


def settle(p: CycleProblem, trial: Orbit, error: float = POLYNOMIAL) -> Orbit | None:
    """Close a trial orbit on its mesh, and on finer ones until the polynomials between the stages err by ``error``.

    Where the multiplier along the orbit still differs from 1, the mesh becomes finer twice more; None where it differs
    then, too: the mesh has lost a pulse.
    """
    tolerance, root = FIRST[1], 1 / (scheme().c.size + 1)  # the first mesh is the trace's, and good for a rough answer
    spare, found = 2, None
    for _ in range(8):
        if trial.move > tolerance:
            trial = closer(p, trial, tolerance)
            if trial.move == np.inf:
                return found
        finer, worst, _ = remeshed(trial, p.at.thermal, error)
        if tolerance == CLOSE_ENOUGH and worst <= (SLACK * error) ** root:
            found = trial if trial.off <= ROUGHLY * max(1.0, abs(trial.multipliers[0])) else found
            if not spare or trial.off < RESOLVED:
                return found
            spare, error = spare - 1, 1e-2 * error
            finer, _, _ = remeshed(trial, p.at.thermal, error)
        if finer.tau.size - 1 > MOST_INTERVALS:
            return found
        tolerance, trial = CLOSE_ENOUGH, finer._replace(move=np.inf)
    return found


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
