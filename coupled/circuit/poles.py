"""Thermal poles in a Rosenbrock step, in closed form of the powers of its stages; compiled.

A pole obeys dx/dt = gain P - rate x. Its stages are linear in where it starts and in the powers F_j of the stages,

    x_q = fade_q x + gain sum_(j <= q) drive_qj F_j,    d = 1/(s + rate),    s = 1/(gamma h)
    fade_q  = d [-rate + sum_(m < q) (c_qm/h - rate a_qm) fade_m]
    drive_qj = d sum_(j <= m < q) (c_qm/h - rate a_qm) drive_mj,    drive_qq = d

so rings of the same poles share one table for each step, and a stage needs no pole, only their sums.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..kernels.compiling import compiled, inlined
from ..kernels.equations import Array
from ..kernels.tableaus import Tableau
from .layout import Heat


class Tables(NamedTuple):
    """What a step of one length does to the poles of each of G kinds of rings."""

    fade: Array  # (G, stages, K)
    drive: Array  # (G, stages, stages, K)
    stay: Array  # (G, K), x after the step per x before
    gained: Array  # (G, stages, K), and per gain F_j
    within: Array  # (G, stages, stages), own temperature of stage q per F_j: sum of read gain drive_qj over the poles
    damping: Array  # (K,), d of one kind
    new: Array  # (K,), of one ring
    missed: Array


@compiled
def new_tables(kinds: int, stages: int, poles: int) -> Tables:
    """Return empty tables."""
    return Tables(
        np.zeros((kinds, stages, poles)), np.zeros((kinds, stages, stages, poles)), np.zeros((kinds, poles)),
        np.zeros((kinds, stages, poles)), np.zeros((kinds, stages, stages)),
        np.zeros(poles), np.zeros(poles), np.zeros(poles),
    )  # fmt: skip


@inlined
def fill(tables: Tables, h: float, heat: Heat, method: Tableau) -> None:
    """Fill the tables for a step of ``h`` ns."""
    stages, a, c = method.a.shape[0], method.a, method.c
    s, per_h, last = 1.0 / (method.gamma * h), 1.0 / h, method.a.shape[0] - 1
    for g in range(heat.kind_rate.shape[0]):
        rate, share = heat.kind_rate[g], heat.kind_share[g]
        K = rate.size
        stay, damping = tables.stay[g], tables.damping
        stay[:] = 1.0
        tables.gained[g] = 0.0
        for p in range(K):
            damping[p] = 1.0 / (s + rate[p])
        for q in range(stages):
            fade, weight = tables.fade[g, q], a[last, q] if q < last else 1.0
            for p in range(K):
                fade[p] = -rate[p]
            for m in range(q):
                f, z, early = a[q, m], c[q, m] * per_h, tables.fade[g, m]
                for p in range(K):
                    fade[p] += (z - f * rate[p]) * early[p]
            for p in range(K):
                fade[p] *= damping[p]
                stay[p] += weight * fade[p]
            for j in range(q + 1):
                drive, gained, total = tables.drive[g, q, j], tables.gained[g, j], 0.0
                start = 1.0 if j == q else 0.0
                for p in range(K):
                    drive[p] = start
                for m in range(j, q):
                    f, z, early = a[q, m], c[q, m] * per_h, tables.drive[g, m, j]
                    for p in range(K):
                        drive[p] += (z - f * rate[p]) * early[p]
                for p in range(K):
                    drive[p] *= damping[p]
                    gained[p] += weight * drive[p]
                    total += share[p] * drive[p]
                tables.within[g, q, j] = total


@inlined
def own_temperatures(y: Array, heat: Heat, tables: Tables, before: Array, faded: Array) -> None:
    """Write each ring's own temperature at the start, and what its poles alone do to that of each stage."""
    n, K = heat.gain.shape
    stages = faded.shape[0]
    for i in range(n):
        at, g, read, z = 3 * n + i * K, heat.kind[i], heat.read[i, i], 0.0
        for p in range(K):
            z += read[p] * y[at + p]
        before[i] = z
        for q in range(stages):
            fade, z = tables.fade[g, q], 0.0
            for p in range(K):
                z += fade[p] * read[p] * y[at + p]
            faded[q, i] = z


@inlined
def end(y: Array, heat: Heat, tables: Tables, powers: Array, out: Array, weight: Array) -> None:
    """Write the poles at the end of a step whose stages had the ``powers``, and the errors of the own temperatures."""
    n, K = heat.gain.shape
    last = powers.shape[0] - 1
    for i in range(n):
        at, g, gain, read = 3 * n + i * K, heat.kind[i], heat.gain[i], heat.read[i, i]
        total, stay, fade = 0.0, tables.stay[g], tables.fade[g, last]
        new, missed = tables.new, tables.missed
        for p in range(K):
            new[p], missed[p] = 0.0, 0.0
        for j in range(last + 1):
            power, gained, drive = powers[j, i], tables.gained[g, j], tables.drive[g, last, j]
            for p in range(K):
                new[p] += power * gained[p]
                missed[p] += power * drive[p]
        for p in range(K):
            out[at + p] = stay[p] * y[at + p] + gain[p] * new[p]
            total += abs(read[p] * (fade[p] * y[at + p] + gain[p] * missed[p]))
        weight[i] = total
