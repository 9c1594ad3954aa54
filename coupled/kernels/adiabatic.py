"""The field eliminated: light that follows carriers and heat at once, and an explicit method for those two.

    0 = (i D - gamma) a + i pump:      a = pump (i gamma - D)/(gamma^2 + D^2)
    U [(loss + fca N + tpa U)^2 + (D_0 - kerr U)^2] = pump^2,          D_0 = -thermal_shift dT - S(N) - detuning

Newton's method finds U from that of the stage before. Without the 10 ps of the field nothing is stiff, and a step of
Dormand and Prince's method of order 5 needs no Jacobian.

Source of the method: Dormand and Prince, J. Comput. Appl. Math. 6, 19 (1980); dense output by cubic Hermite
interpolation of N and dT.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import equations, kinds
from .compiling import compiled, forget_if_older, inlined, inner
from .control import DONE, STEP_TOO_SMALL, STOPPED, TOO_MANY_STEPS, doubled, tally
from .equations import Array, Rates, absorbed_power, dispersion
from .kinds import flow, read, rise_of
from .laser import LaserPieces, power_and_detuning

A = np.array(
    [
        [0, 0, 0, 0, 0, 0],
        [1 / 5, 0, 0, 0, 0, 0],
        [3 / 40, 9 / 40, 0, 0, 0, 0],
        [44 / 45, -56 / 15, 32 / 9, 0, 0, 0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0, 0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0],
        [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
AT = np.array([0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1])
ERROR = np.array([71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
BETWEEN = 4  # rows for every accepted step: light turns faster than the carriers that the steps follow


@inner
def field(y: Array, power: float, detuning: float, U: float, rates: Rates, fcd: Array, thermal: Any) -> Array:
    """Return Re a, Im a and U at rest in given carriers and heat, from a guess of U; ``power`` is the squared pump."""
    N = y[2]
    own, D0 = rates.loss + rates.fca * N, -rates.thermal_shift * rise_of(read(y, thermal), thermal)[0] - detuning
    D0 -= dispersion(N, fcd)[0]
    U = max(U, 1e-30)
    for _ in range(60):
        gamma, D = own + rates.tpa * U, D0 - rates.kerr * U
        square = gamma * gamma + D * D
        change = (U * square - power) / (square + 2.0 * U * (gamma * rates.tpa - D * rates.kerr))
        U = max(U - change, 0.1 * U)
        if abs(change) <= 1e-14 * U:
            break
    gamma, D = own + rates.tpa * U, D0 - rates.kerr * U
    pump = math.sqrt(power) / (gamma * gamma + D * D)
    out = np.empty(3)
    out[0], out[1], out[2] = -D * pump, gamma * pump, U
    return out


@inlined
def _slopes(
    y: Array, power: float, detuning: float, U: float, rates: Rates, fcd: Array, thermal: Any, k: Array
) -> float:
    """Write dN/dt to k[2] and dx/dt to k[3:]; return U."""
    U = field(y, power, detuning, U, rates, fcd, thermal)[2]
    N = y[2]
    k[2] = rates.g * U * U - N * (1.0 + rates.b * N) / (rates.tau0 * (1.0 + rates.a * N))
    flow(y, absorbed_power(U, N, rates), thermal, k)
    return U


@compiled
def integrate(
    y: Array, laser: LaserPieces, rates: Rates, fcd: Array, thermal: Any, rtol: float, floor: Array, times: Array,
    max_steps: int, watch: Array,
) -> tuple[Array, Array, float, NDArray[np.int64]]:  # fmt: skip
    """Integrate carriers and heat from ``y`` through every piece of ``laser``; as `rosenbrock.integrate`.

    Returns rows (t, Re a, Im a, N, dT) at ``times`` or four for every accepted step, the state at the end, the time
    reached and the counts.
    """
    y, out, at = y.copy(), y.copy(), y.copy()
    k, wanted, filled = np.zeros((7, y.size)), times.size, 0
    rows = np.empty((wanted if wanted > 0 else 4096, 5))
    t, end, h, accepted, rejected = laser.edges[0], laser.edges[-1], 1e-2 / rates.loss, 0, 0
    U = y[0] * y[0] + y[1] * y[1]
    for piece in range(laser.edges.size - 1):
        begin, stop = laser.edges[piece], laser.edges[piece + 1]
        power, detuning = power_and_detuning(laser, piece, 0.0)
        if piece > 0:
            h = min(h, 1.0)
        U = _slopes(y, power, detuning, max(U, 1e-9), rates, fcd, thermal, k[0])
        if wanted == 0 or (filled < wanted and times[filled] <= t):
            a = field(y, power, detuning, U, rates, fcd, thermal)
            row = filled
            filled += 1
            rows[row, 0], rows[row, 1], rows[row, 2] = t, a[0], a[1]
            rows[row, 3], rows[row, 4] = y[2], rise_of(read(y, thermal), thermal)[0]
        while t < stop:
            if accepted + rejected >= max_steps or watch[0] > 0.0:
                ended = STOPPED if watch[0] > 0.0 else TOO_MANY_STEPS
                return rows[:filled], y, t, tally(accepted, rejected, ended)
            watch[1] = t
            landing = t + 1.0001 * h >= stop
            if landing:
                h = stop - t
            U_stage = U
            for q in range(1, 7):
                for i in range(2, y.size):
                    at[i] = y[i]
                    for j in range(q):
                        at[i] += h * A[q, j] * k[j, i]
                power, detuning = power_and_detuning(laser, piece, t - begin + AT[q] * h)
                U_stage = _slopes(at, power, detuning, U_stage, rates, fcd, thermal, k[q])
            for i in range(2, y.size):
                out[i] = at[i]
            e_N, e_x = 0.0, 0.0
            for j in range(7):
                e_N += h * ERROR[j] * k[j, 2]
            for i in range(3, y.size):
                e = 0.0
                for j in range(7):
                    e += h * ERROR[j] * k[j, i]
                e_x += abs(e)
            z, z_new = read(y, thermal), read(out, thermal)
            e_N /= max(abs(y[2]), abs(out[2]), floor[1])
            e_x /= max(abs(z), abs(z_new), floor[2])
            error = math.sqrt((e_N * e_N + e_x * e_x) / 2.0) / rtol if rise_of(z_new, thermal)[1] > 0.0 else math.inf
            if not error <= 1.0:
                rejected += 1
                h *= max(0.2, 0.9 * error**-0.2) if error < math.inf else 0.2
                if h < 1e-13 * max(abs(t), 1e-3):
                    return rows[:filled], y, t, tally(accepted, rejected, STEP_TOO_SMALL)
                continue
            accepted += 1
            t_new = stop if landing else t + h
            last = landing and stop == end
            between = 1
            if wanted == 0 and filled + BETWEEN > rows.shape[0]:
                rows = doubled(rows)
            while (filled < wanted and (last or times[filled] <= t_new)) or (wanted == 0 and between < BETWEEN):
                row_time = times[filled] if wanted > 0 else t + between / BETWEEN * h
                between += 1
                x = (row_time - t) / h
                for i in range(2, y.size):
                    rise = out[i] - y[i]
                    bend = (1.0 - 2.0 * x) * rise + (x - 1.0) * h * k[0, i] + x * h * k[6, i]
                    at[i] = (1.0 - x) * y[i] + x * out[i] + x * (x - 1.0) * bend
                power, detuning = power_and_detuning(laser, piece, row_time - begin)
                a = field(at, power, detuning, U_stage, rates, fcd, thermal)
                rows[filled, 0], rows[filled, 1], rows[filled, 2] = row_time, a[0], a[1]
                rows[filled, 3], rows[filled, 4] = at[2], rise_of(read(at, thermal), thermal)[0]
                filled += 1
            t, U = t_new, U_stage
            y, out = out, y
            for i in range(y.size):
                k[0, i] = k[6, i]
            if wanted == 0:
                power, detuning = power_and_detuning(laser, piece, t - begin)
                a = field(y, power, detuning, U, rates, fcd, thermal)
                rows[filled, 0], rows[filled, 1], rows[filled, 2] = t, a[0], a[1]
                rows[filled, 3], rows[filled, 4] = y[2], rise_of(z_new, thermal)[0]
                filled += 1
            h *= max(0.2, min(5.0, 0.9 * max(error, 1e-8) ** -0.2))
    a = field(y, power, detuning, U, rates, fcd, thermal)
    y[0], y[1] = a[0], a[1]
    return rows[:filled], y, t, tally(accepted, rejected, DONE)


for module in (equations, kinds):
    forget_if_older(integrate, str(module.__file__))
