"""Waves of a circuit at a time: lasers, light behind delays, what reaches the rings and the detectors; compiled.

Light from a waveguide with delay is a cubic over every past step. A detector of bandwidth B shows

    dz/dt = 2 pi B (|s|^2 - z),

exactly for a power that is a cubic within a step.
"""

from __future__ import annotations

import math
from typing import Any

from ..kernels.compiling import inlined_lean, lean
from ..kernels.equations import Array
from .layout import Complex, LaserTable, LightNetwork

FOLLOW = 2.0  # lengths of the past steps that a step may span; at 1 the steps of a long run could never grow again


@inlined_lean
def lasers_at(drive: LaserTable, piece: int, t: float, wave: Complex, slope: Complex) -> None:
    """Write the waves of the lasers in sqrt(uW) at ``t``, and their slopes, bounded where a power leaves 0."""
    p, power, turns, largest = drive.power_piece[piece], drive.power, drive.turn, drive.largest
    u = t - drive.power_edges[p]
    for m in range(turns.size):
        c0, c1, c2, c3 = power[p, m, 0], power[p, m, 1], power[p, m, 2], power[p, m, 3]
        size = math.sqrt(max(c0 + u * (c1 + u * (c2 + u * c3)), 0.0))
        rise = c1 + u * (2.0 * c2 + u * 3.0 * c3)
        steep = 0.5 * rise * size / max(size * size + 1e-12 * largest[m], 1e-300)
        if turns[m] == 0.0:
            wave[m], slope[m] = size, steep
        else:
            phase = complex(math.cos(turns[m] * t), math.sin(turns[m] * t))
            wave[m], slope[m] = size * phase, (steep + 1j * turns[m] * size) * phase


@inlined_lean
def detunings_at(drive: LaserTable, piece: int, t: float, values: Array, slopes: Array) -> None:
    """Write the detunings of all rings at ``t`` in rad/ns, and their slopes."""
    p, d = drive.detuning_piece[piece], drive.detuning
    u = t - drive.detuning_edges[p]
    for i in range(values.size):
        values[i] = d[p, i, 0] + u * (d[p, i, 1] + u * (d[p, i, 2] + u * d[p, i, 3]))
        slopes[i] = d[p, i, 1] + u * (2.0 * d[p, i, 2] + u * 3.0 * d[p, i, 3])


@inlined_lean
def step_at(time: float, past: Array, filled: int) -> int:
    """Return the number of the past step that holds ``time``: the first one where it lies before all."""
    low, high = 0, filled - 1
    while low < high:
        middle = (low + high + 1) // 2
        if past[middle, 0] <= time:
            low = middle
        else:
            high = middle - 1
    return low


@lean
def following(t: float, h: float, delay: Array, past: Array, filled: int) -> float:
    """Return how much of ``h`` a step from ``t`` may take to resolve what the delays bring.

    The step is `FOLLOW` times as long as the past steps that it reads, at most, or ends where a shorter one begins.
    """
    for d in range(delay.size):
        at = t - delay[d]
        for k in range(step_at(at, past, filled), filled):
            if past[k, 0] >= at + h:
                break
            h = min(h, max(FOLLOW * past[k, 2], past[k, 0] - at))
    return h


@lean
def delayed_at(
    t: float, aside: float, delay: Array, past: Array, cubics: Complex, filled: int, wave: Complex, slope: Complex
) -> None:
    """Write the waves at the starts of the delayed waveguides at t - delay, and their slopes; 0 before the start.

    The past step is the one at t + aside - delay: a front that comes back just at ``t`` has not come yet where
    ``aside`` is negative.
    ``past``, shape (m, 3), holds start and length of every past step, and the length that its error control had
    planned; ``cubics``, shape (m, D, 4), their waves.
    """
    for d in range(delay.size):
        at = t - delay[d]
        wave[d], slope[d] = 0.0, 0.0
        if filled == 0 or at + aside < past[0, 0]:
            continue
        low = step_at(at + aside, past, filled)
        x = (at - past[low, 0]) / past[low, 1]
        c = cubics[low, d]
        wave[d] = c[0] + x * (c[1] + x * (c[2] + x * c[3]))
        slope[d] = (c[1] + x * (2.0 * c[2] + x * 3.0 * c[3])) / past[low, 1]


@inlined_lean
def arriving(by_laser: Complex, by_delay: Complex, laser: Complex, delayed: Complex, out: Complex) -> None:
    """Write the sums of the waves of lasers and delayed waveguides with their weights, shape (size of out, waves)."""
    for i in range(out.size):
        total = 0.0 + 0.0j
        for m in range(laser.size):
            total += by_laser[i, m] * laser[m]
        for d in range(delayed.size):
            total += by_delay[i, d] * delayed[d]
        out[i] = total


@inlined_lean
def inputs_of(net: LightNetwork, laser: Complex, delayed: Complex, out: Complex) -> None:
    """Write what lasers and delayed waveguides send into each ring, in sqrt(fJ)/ns."""
    arriving(net.from_laser, net.from_delay, laser, delayed, out)


@inlined_lean
def observe(net: LightNetwork, state: Array, laser: Complex, delayed: Complex, out: Complex) -> None:
    """Write the observed waves in sqrt(uW); ``state``, shape (2 N or more,), begins with Re a and Im a of the rings."""
    ring, fed, n = net.seen_ring, net.seen_from, net.own.size
    arriving(net.seen_laser, net.seen_delay, laser, delayed, out)
    for q in range(out.size):
        for i in range(fed[q, 0], fed[q, 1]):
            out[q] += ring[q, i] * complex(state[i], state[n + i])


@lean
def cubic_through(p0: Any, p1: Any, p2: Any, p3: Any) -> tuple[Any, Any, Any, Any]:
    """Return the cubic through values at 0, 1/3, 2/3 and 1, constant term first."""
    c1 = -5.5 * p0 + 9.0 * p1 - 4.5 * p2 + p3
    c2 = 9.0 * p0 - 22.5 * p1 + 18.0 * p2 - 4.5 * p3
    c3 = -4.5 * p0 + 13.5 * p1 - 13.5 * p2 + 4.5 * p3
    return p0, c1, c2, c3


@inlined_lean
def _power_cubic(nodes: Complex) -> Any:
    """Return the cubic of |wave|^2 in the fraction of a step from its nodes at 0, 1/3, 2/3 and 1."""
    return cubic_through(
        nodes[0].real**2 + nodes[0].imag**2, nodes[1].real**2 + nodes[1].imag**2,
        nodes[2].real**2 + nodes[2].imag**2, nodes[3].real**2 + nodes[3].imag**2,
    )  # fmt: skip


@lean
def energy_to(nodes: Complex, f: float) -> float:
    """Return the integral of |wave|^2 from 0 to ``f`` of a step of length 1."""
    c0, c1, c2, c3 = _power_cubic(nodes)
    return f * (c0 + f * (c1 / 2.0 + f * (c2 / 3.0 + f * c3 / 4.0)))


@lean
def detected_at(nodes: Complex, f: float, before: float, x: float) -> float:
    """Return the signal of a detector at the fraction ``f`` of a step that begins with ``before``; ``x`` = 2 pi B h.

        z(f) = exp(-x f) z(0) + sum_m c_m I_m,    I_m = x int_0^f exp(-x (f - u)) u^m du = f^m - (m/x) I_(m-1)

    The recurrence loses digits where x f is small; there I_m = x f^(m+1) sum_j (-x f)^j m!/(m+1+j)!.
    """
    c = _power_cubic(nodes)
    passed, total = x * f, math.exp(-x * f) * before
    integral, power = -math.expm1(-passed), 1.0
    for m in range(4):
        if passed > 0.5:
            if m > 0:
                integral = power - m / x * integral
        else:
            term, series = 1.0 / (m + 1.0), 0.0
            for j in range(14):  # 0.5^14/14! is below round-off
                series += term
                term *= -passed / (m + 2.0 + j)
            integral = x * power * f * series
        total += c[m] * integral
        power *= f
    return total
