"""Several lasers on one ring: fields of several resonances that share carriers and heat.

State: y = [Re a_0, Im a_0, N, x_1 .. x_n, Re a_1, Im a_1, ...], with U_f = |a_f|^2 and W_f = U_f + 2 sum_(m != f) U_m.

    da_f/dt = (i D_f - gamma_f) a_f + i sum_l pump_l exp(i theta_l),     lasers l on resonance f
    D_f     = -shift_f dT - turn_f S(N) - kerr_f W_f - detuning_f,        gamma_f = loss_f + fca_f N + tpa_f W_f
    dN/dt   = -N/tau(N) + sum_f g_f U_f W_f
    P_abs   = 2 sum_f (absorbed_f + fca_f N + tpa_f W_f) U_f

Light of another frequency counts twice in W: the average of |a + b|^4 over the beat is U_a^2 + U_b^2 + 4 U_a U_b. A
field turns with the first laser on its resonance; others on the same one beat with it, theta_l being the phase between.
Every step solves the full system, whose order is small. Internal units, as in `equations`.

Sources: Lin, Painter and Agrawal, Opt. Express 15, 16604 (2007) (cross two-photon absorption and cross-Kerr,
factor 2); Agrawal, Nonlinear Fiber Optics (2019), chapter on cross-phase modulation.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..kernel.tableaus import Tableau
from . import algebra, equations, kinds
from .algebra import factorize, follows, solve
from .compiling import OPTIONS, compiled, forget_if_older, inlined, inner, overload
from .control import DONE, STEP_TOO_SMALL, STOPPED, TOO_MANY_STEPS, dense_output, doubled, tally
from .equations import Array, Rates, dispersion
from .kinds import flow, read, rise_of, spread, weigh
from .laser import largest_power

LOSS, ABSORBED, FCA, TPA, G, SHIFT, TURN, KERR = range(8)


class Lasers(NamedTuple):
    """Powers and detunings of the lasers, as cubics in t - edges[k] between edges[k] and edges[k + 1] (ns)."""

    edges: Array  # shape (m + 1,)
    power: Array  # 2 gamma_e P in fJ/ns^2, shape (lasers, m, 4)
    detuning: Array  # rad/ns, shape (lasers, m, 4)
    phase: Array  # rad at the edges, relative to the first laser on the resonance, shape (lasers, m)
    field: NDArray[np.int64]  # which resonance, shape (lasers,)
    first: NDArray[np.int64]  # the first laser of every resonance, shape (fields,)


@compiled
def brightest(lasers: Lasers) -> float:
    """Return the largest squared pump of any laser at the ends of all pieces; 1e-300 in the dark."""
    largest = 1e-300
    for k in range(lasers.power.shape[0]):
        largest = max(largest, largest_power(lasers.edges, lasers.power[k]))
    return largest


@inlined
def _place(f: int, n: int) -> int:
    """Return where the field of resonance ``f`` begins in the state."""
    return 0 if f == 0 else 3 + n + 2 * (f - 1)


@inlined
def shine(lasers: Lasers, piece: int, u: float, largest: float, s: Array, ds: Array, d: Array, dd: Array) -> None:
    """Write pumps (fields, 2), their slopes, detunings (fields,) and their slopes ``u`` after the edge of a piece."""
    s[:], ds[:] = 0.0, 0.0
    for f in range(d.size):
        q = lasers.detuning[lasers.first[f], piece]
        d[f] = q[0] + u * (q[1] + u * (q[2] + u * q[3]))
        dd[f] = q[1] + u * (2.0 * q[2] + u * 3.0 * q[3])
    for k in range(lasers.field.size):
        f, p, q = lasers.field[k], lasers.power[k, piece], lasers.detuning[k, piece]
        o = lasers.detuning[lasers.first[f], piece]
        power = max(p[0] + u * (p[1] + u * (p[2] + u * p[3])), 0.0)
        size = math.sqrt(power)
        grows = 0.5 * (p[1] + u * (2.0 * p[2] + u * 3.0 * p[3])) * size / max(power + 1e-12 * largest, 1e-300)
        turn, rate = lasers.phase[k, piece], 0.0
        for j in range(4):
            turn += (q[j] - o[j]) * u ** (j + 1) / (j + 1)
            rate += (q[j] - o[j]) * u**j
        c, si = math.cos(turn), math.sin(turn)
        s[f, 0] += size * c
        s[f, 1] += size * si
        ds[f, 0] += grows * c - rate * size * si
        ds[f, 1] += grows * si + rate * size * c


@inlined
def _shared(y: Array, n: int, fields: int, fcd: Array, thermal: Any) -> tuple[float, float, float, float]:
    """Return what all resonances share: the sum of U, S(N), dS/dN and dT."""
    total = 0.0
    for f in range(fields):
        i = _place(f, n)
        total += y[i] * y[i] + y[i + 1] * y[i + 1]
    shift, slope = dispersion(y[2], fcd)
    return total, shift, slope, rise_of(read(y[: 3 + n], thermal), thermal)[0]


@inner
def slopes(
    y: Array, n: int, s: Array, d: Array, modes: Array, rates: Rates, fcd: Array, thermal: Any, out: Array
) -> None:
    """Write dy/dt; ``modes`` has a row for each resonance, columns as named at the top of the module."""
    fields, N = d.size, y[2]
    total, shift, _, dT = _shared(y, n, fields, fcd, thermal)
    heat, made = 0.0, 0.0
    for f in range(fields):
        i, m = _place(f, n), modes[f]
        re, im = y[i], y[i + 1]
        U = re * re + im * im
        W = 2.0 * total - U
        gamma = m[LOSS] + m[FCA] * N + m[TPA] * W
        D = -m[SHIFT] * dT - m[TURN] * shift - m[KERR] * W - d[f]
        out[i] = -gamma * re - D * im - s[f, 1]
        out[i + 1] = -gamma * im + D * re + s[f, 0]
        heat += 2.0 * (m[ABSORBED] + m[FCA] * N + m[TPA] * W) * U
        made += m[G] * U * W
    flow(y[: 3 + n], heat, thermal, out[: 3 + n])
    out[2] = made - N * (1.0 + rates.b * N) / (rates.tau0 * (1.0 + rates.a * N))


@inner
def jacobian(y: Array, n: int, d: Array, modes: Array, rates: Rates, fcd: Array, thermal: Any, out: Array) -> None:
    """Write d(dy/dt)/dy."""
    size, fields, N, heat = y.size, d.size, y[2], 0.0
    out[:] = 0.0
    total, shift, slope, dT = _shared(y, n, fields, fcd, thermal)
    by_heat, by_dT = np.zeros(size), np.zeros(size)
    for f in range(fields):
        i, m = _place(f, n), modes[f]
        re, im = y[i], y[i + 1]
        U = re * re + im * im
        W = 2.0 * total - U
        gamma = m[LOSS] + m[FCA] * N + m[TPA] * W
        D = -m[SHIFT] * dT - m[TURN] * shift - m[KERR] * W - d[f]
        own = m[ABSORBED] + m[FCA] * N + m[TPA] * W
        heat += 2.0 * own * U
        out[i, i] -= gamma
        out[i, i + 1] -= D
        out[i + 1, i + 1] -= gamma
        out[i + 1, i] += D
        out[i, 2] = -m[FCA] * re + m[TURN] * slope * im
        out[i + 1, 2] = -m[FCA] * im - m[TURN] * slope * re
        by_dT[i], by_dT[i + 1] = m[SHIFT] * im, -m[SHIFT] * re
        by_heat[2] += 2.0 * m[FCA] * U
        for other in range(fields):
            j = _place(other, n)
            weight = 1.0 if other == f else 2.0  # dW_f/dU_other
            for c in range(2):
                dU = 2.0 * y[j + c]
                out[i, j + c] += (-m[TPA] * re + m[KERR] * im) * weight * dU
                out[i + 1, j + c] += (-m[TPA] * im - m[KERR] * re) * weight * dU
                direct = 1.0 if other == f else 0.0
                out[2, j + c] += m[G] * (direct * W + U * weight) * dU
                by_heat[j + c] += 2.0 * (direct * own + m[TPA] * U * weight) * dU
    saturation = 1.0 + rates.a * N
    out[2, 2] = -(1.0 + rates.b * N * (2.0 + rates.a * N)) / (rates.tau0 * saturation * saturation)
    block = np.zeros((3 + n, 3 + n))
    spread(y[: 3 + n], heat, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), thermal, block)
    for j in range(3, 3 + n):
        for i in range(size):
            if i < 3 or i >= 3 + n:
                out[i, j] = by_dT[i] * block[1, j]
                out[j, i] = block[j, 0] * by_heat[i]
        for i in range(3, 3 + n):
            out[i, j] = block[i, j]


def _follows(M: Array, n: int, thermal: Any) -> Any:
    """Return whether heat alone grows no faster than a step with the matrix ``M`` follows; `algebra.follows`."""


@overload(_follows, jit_options=OPTIONS, strict=False)
def _follows_of(M: Any, n: Any, thermal: Any) -> Any:
    def network(M: Array, n: int, thermal: Any) -> bool:
        return True

    def full(M: Array, n: int, thermal: Any) -> bool:
        return follows(M[3 : 3 + n, 3 : 3 + n].copy(), np.empty(n, np.int64))

    return kinds.chosen(thermal, network, full)


@compiled
def integrate(
    y: Array, n: int, lasers: Lasers, modes: Array, rates: Rates, fcd: Array, thermal: Any, method: Tableau,
    rtol: float, floor: Array, times: Array, longest: float, max_steps: int, watch: Array,
) -> tuple[Array, Array, float, NDArray[np.int64]]:  # fmt: skip
    """Integrate through every piece of ``lasers``, on whose edges it lands; as `rosenbrock.integrate`.

    ``longest`` bounds the steps (ns). Returns rows (t, Re a_0, Im a_0, N, dT, Re a_1, Im a_1, ...) at ``times`` or at
    the accepted steps, the state at the end, the time reached and the counts.
    """
    size, stages, fields = y.size, method.a.shape[0], modes.shape[0]
    y, out, at, f0 = y.copy(), np.empty(size), np.empty(size), np.empty(size)
    J, order, k = np.empty((size, size)), np.empty(size, np.int64), np.zeros((stages, size))
    s, ds, d, dd = np.empty((fields, 2)), np.empty((fields, 2)), np.empty(fields), np.empty(fields)
    s1, ds1, d1, dd1 = np.empty((fields, 2)), np.empty((fields, 2)), np.empty(fields), np.empty(fields)
    zero: Any = np.int64(0)  # no literal: what is called with one is compiled twice
    wanted, filled, wide = times.size, zero, 5 + 2 * (fields - 1)
    rows = np.empty((wanted if wanted > 0 else 4096, wide))
    largest = brightest(lasers)
    t, end, cautious = lasers.edges[0], lasers.edges[-1], 1e-2 / modes[0, LOSS]
    h, accepted, rejected = cautious, 0, 0
    if wanted == 0:
        _record(rows, filled, t, y, n, thermal)
        filled = 1
    while filled < wanted and times[filled] <= t:
        _record(rows, filled, times[filled], y, n, thermal)
        filled += 1
    for piece in range(lasers.edges.size - 1):
        begin, stop = lasers.edges[piece], lasers.edges[piece + 1]
        shine(lasers, piece, 0.0, largest, s, ds, d, dd)
        if piece > 0:
            shine(lasers, piece - 1, begin - lasers.edges[piece - 1], largest, s1, ds1, d1, dd1)
            jump = np.abs(s - s1).max() > 1e-6 * math.sqrt(largest) or np.abs(d - d1).max() > 1e-6 * modes[0, LOSS]
            h = min(h, cautious) if jump else h
        while t < stop:
            if accepted + rejected >= max_steps or watch[0] > 0.0:
                ended = STOPPED if watch[0] > 0.0 else TOO_MANY_STEPS
                return rows[:filled], y, t, tally(accepted, rejected, ended)
            watch[1] = t
            h = min(h, longest)
            planned, landing = h, t + 1.0001 * h >= stop
            if landing:
                h = stop - t
            u, per_h = t - begin, 1.0 / h
            shine(lasers, piece, u, largest, s, ds, d, dd)
            jacobian(y, n, d, modes, rates, fcd, thermal, J)
            for i in range(size):
                for j in range(size):
                    J[i, j] = -J[i, j]
                J[i, i] += per_h / method.gamma
            followed = _follows(J, n, thermal)
            factorize(J, order)
            for q in range(stages):
                for i in range(size):
                    at[i] = y[i]
                for j in range(q):
                    for i in range(size):
                        at[i] += method.a[q, j] * k[j, i]
                shine(lasers, piece, u + method.at[q] * h, largest, s1, ds1, d1, dd1)
                slopes(at, n, s1, d1, modes, rates, fcd, thermal, f0)
                for j in range(q):
                    for i in range(size):
                        f0[i] += method.c[q, j] * per_h * k[j, i]
                g = method.slope[q] * h
                for f in range(fields):
                    i = _place(f, n)
                    f0[i] += g * (dd[f] * y[i + 1] - ds[f, 1])
                    f0[i + 1] += g * (ds[f, 0] - dd[f] * y[i])
                solve(J, order, f0)
                for i in range(size):
                    k[q, i] = f0[i]
            for i in range(size):
                out[i] = at[i] + k[stages - 1, i]
            error = _error(y, out, k, n, fields, rtol, floor, thermal) if followed else math.inf
            if not error <= 1.0:
                rejected += 1
                h *= max(0.2, 0.9 * error ** (-1.0 / method.order)) if error < math.inf else 0.2
                if h < 1e-13 * max(abs(t), 1e-3):
                    return rows[:filled], y, t, tally(accepted, rejected, STEP_TOO_SMALL)
                continue
            accepted += 1
            last = landing and stop == end
            while filled < wanted and (last or times[filled] <= t + h):
                x = (times[filled] - t) / h
                for i in range(size):
                    at[i] = dense_output(x, y[i], out[i], k[:, i], method.dense)
                _record(rows, filled, times[filled], at, n, thermal)
                filled += 1
            t = stop if landing else t + h
            y, out = out, y
            if wanted == 0:
                if filled == rows.shape[0]:
                    rows = doubled(rows)
                _record(rows, filled, t, y, n, thermal)
                filled += 1
            h *= max(0.2, min(5.0, 0.9 * max(error, 1e-8) ** (-1.0 / method.order)))
            if landing and t < end:
                h = max(h, planned)
    return rows[:filled], y, t, tally(accepted, rejected, DONE)


@inlined
def _record(rows: Array, at: int, t: float, y: Array, n: int, thermal: Any) -> None:
    """Write t, the first field, N, dT and the other fields into one row."""
    rows[at, 0], rows[at, 1], rows[at, 2], rows[at, 3] = t, y[0], y[1], y[2]
    rows[at, 4] = rise_of(read(y[: 3 + n], thermal), thermal)[0]
    for i in range(y.size - 3 - n):
        rows[at, 5 + i] = y[3 + n + i]


@inlined
def _error(y: Array, out: Array, k: Array, n: int, fields: int, rtol: float, floor: Array, thermal: Any) -> float:
    """Return the error of a step in units of the tolerance: of every field, of carriers and of temperature."""
    last, worst = k.shape[0] - 1, 0.0
    for f in range(fields):
        i = _place(f, n)
        size = max(y[i] ** 2 + y[i + 1] ** 2, out[i] ** 2 + out[i + 1] ** 2, floor[0] ** 2)
        worst += (k[last, i] ** 2 + k[last, i + 1] ** 2) / size
    e1 = k[last, 2] / max(abs(y[2]), abs(out[2]), floor[1])
    z, z_new = read(y[: 3 + n], thermal), read(out[: 3 + n], thermal)
    e2 = weigh(k[:, : 3 + n], thermal) / max(abs(z), abs(z_new), floor[2])
    error = math.sqrt((worst / fields + e1 * e1 + e2 * e2) / 3.0) / rtol
    return error if rise_of(z_new, thermal)[1] > 0.0 else math.inf


for module in (equations, algebra, kinds):
    forget_if_older(integrate, str(module.__file__))
