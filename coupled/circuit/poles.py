"""Thermal poles in a Rosenbrock step, in closed form of the powers of its stages; compiled.

A pole obeys dx/dt = gain P - rate x. With z = rate h, the matrices of the method (`kernels.tableaus`) and
Gamma = (1/gamma - c)^-1, its stages k under the powers F of the stages are

    k = h Gamma (1 + z beta)^-1 (gain F - rate x),    beta = a Gamma + Gamma = gamma + nu
      = sum_n t_n Gamma nu^n (gain F - rate x),       t_n = h (-z)^n / (1 + gamma z)^(n + 1)

where nu has nothing on its diagonal, so that the sum ends. Rings of the same poles share the t_n of a step, and a stage
needs no pole, only the sums of t_n over them.

Source: Hairer and Wanner, Solving Ordinary Differential Equations II (1996), Section IV.7, Eq. 7.25 (Gamma, beta).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..kernel.tableaus import Tableau
from ..kernels.compiling import compiled, inlined_lean
from ..kernels.equations import Array
from .layout import Heat

ROUND_OFF = 1e-14  # entries of Gamma nu^n, which are of order 1, below which the sum ends


class Series(NamedTuple):
    """Gamma nu^n of a method with s stages, n below M."""

    stages: Array  # (M, s, s)
    rows: Array  # (2, M, s): what the powers do to the end of the step, and to the error estimate
    faded: Array  # (M, s), row sums of each: what a state does to the stages by itself
    ends: Array  # (2, M), of rows


class Tables(NamedTuple):
    """What a step of one length does to the poles of each of G kinds of rings."""

    t: Array  # (G, M, K)
    within: Array  # (G, s, s), own temperature of a stage per F_j
    stay: Array  # (G, 2, K): x after the step, and the error estimate, per x before
    part: Array  # (2, M), of one ring
    new: Array  # (2, K), of one ring
    decay: Array  # (K,), of one ring


def series(method: Tableau) -> Series:
    """Return the sum's matrices of a method."""
    size = len(method.c)
    gamma = np.linalg.inv(np.eye(size) / method.gamma - method.c)
    nu = np.tril(method.a @ gamma + gamma, -1)
    found = [gamma]
    while len(found) < size and np.abs(found[-1] @ nu).max() > ROUND_OFF:
        found.append(found[-1] @ nu)
    stages, end = np.array(found), method.a[-1].copy()
    end[-1] = 1.0
    rows = np.stack([end @ stages, stages[:, -1]])
    return Series(stages, rows, stages.sum(axis=2), rows.sum(axis=2))


@compiled
def new_tables(kinds: int, terms: int, stages: int, poles: int) -> Tables:
    """Return empty tables."""
    e = np.empty
    return Tables(
        e((kinds, terms, poles)), e((kinds, stages, stages)), e((kinds, 2, poles)), e((2, terms)), e((2, poles)),
        e(poles),
    )  # fmt: skip


@inlined_lean
def fill(tables: Tables, h: float, heat: Heat, gamma: float, series: Series) -> None:
    """Fill the tables for a step of ``h`` ns."""
    t, within, stay, rates, share = tables.t, tables.within, tables.stay, heat.kind_rate, heat.kind_share
    matrices, ends = series.stages, series.ends
    terms, stages = matrices.shape[0], matrices.shape[1]
    for g in range(rates.shape[0]):
        for p in range(rates.shape[1]):
            stay[g, 0, p], stay[g, 1, p] = 1.0, 0.0
        for q in range(stages):
            for j in range(q + 1):
                within[g, q, j] = 0.0
        for n in range(terms):
            total, now, error = 0.0, ends[0, n], ends[1, n]
            for p in range(rates.shape[1]):
                z = rates[g, p] * h
                d = 1.0 / (1.0 + gamma * z)
                t[g, n, p] = h * d if n == 0 else -z * d * t[g, n - 1, p]
            for p in range(rates.shape[1]):
                total += share[g, p] * t[g, n, p]
            for p in range(rates.shape[1]):
                stay[g, 0, p] -= now * rates[g, p] * t[g, n, p]
                stay[g, 1, p] -= error * rates[g, p] * t[g, n, p]
            for q in range(stages):
                for j in range(q + 1):
                    within[g, q, j] += matrices[n, q, j] * total


@inlined_lean
def own_temperatures(y: Array, heat: Heat, series: Series, tables: Tables, before: Array, faded: Array) -> None:
    """Write each ring's own temperature at the start, and what its poles alone do to that of each stage."""
    t, decay, read, rate, kind, sums = tables.t, tables.decay, heat.read, heat.rate, heat.kind, series.faded
    rings, K = rate.shape
    for i in range(rings):
        at, g, z = 3 * rings + i * K, kind[i], 0.0
        for p in range(K):
            x = read[i, i, p] * y[at + p]
            z += x
            decay[p] = rate[i, p] * x
        before[i] = z
        for q in range(sums.shape[1]):
            faded[q, i] = 0.0
        for n in range(sums.shape[0]):
            z = 0.0
            for p in range(K):
                z += t[g, n, p] * decay[p]
            for q in range(sums.shape[1]):
                faded[q, i] -= sums[n, q] * z


@inlined_lean
def end(y: Array, heat: Heat, series: Series, tables: Tables, powers: Array, out: Array, weight: Array) -> None:
    """Write the poles at the end of a step whose stages had the ``powers``, and the errors of the own temperatures."""
    t, stay, part, new, rows = tables.t, tables.stay, tables.part, tables.new, series.rows
    gain, read, kind = heat.gain, heat.read, heat.kind
    rings, K = gain.shape
    terms, stages = rows.shape[1], rows.shape[2]
    for i in range(rings):
        at, g, total = 3 * rings + i * K, kind[i], 0.0
        for n in range(terms):
            a, b = 0.0, 0.0
            for j in range(stages):
                a += rows[0, n, j] * powers[j, i]
                b += rows[1, n, j] * powers[j, i]
            part[0, n], part[1, n] = a, b
        for p in range(K):
            new[0, p], new[1, p] = 0.0, 0.0
        for n in range(terms):
            a, b = part[0, n], part[1, n]
            for p in range(K):
                new[0, p] += a * t[g, n, p]
                new[1, p] += b * t[g, n, p]
        for p in range(K):
            x = y[at + p]
            out[at + p] = stay[g, 0, p] * x + gain[i, p] * new[0, p]
            total += abs(read[i, i, p] * (stay[g, 1, p] * x + gain[i, p] * new[1, p]))
        weight[i] = total
