"""The mesh that follows an orbit, and values of the polynomials on it.

The mesh equidistributes the error of the polynomials between the stages, whose next derivative is told by the jumps of
their highest one from interval to interval.

Source: Ascher, Mattheij and Russell, Numerical Solution of Boundary Value Problems (1995), Section 9.3.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from . import equations, kinds
from .collocation import Ring, Scheme
from .compiling import compiled, forget_if_older
from .equations import Array
from .kinds import read

BISECTIONS = 34  # of a bracket, to 1e-13 of the period
FLATTEST = 0.05  # of its mean, the smallest density of the mesh


@compiled
def sizes(Y: Array, thermal: Any) -> Array:
    """Return the largest |a|, N and dT of an orbit, in internal units."""
    field, carriers, heat = 1e-30, 1e-30, 1e-30
    for k in range(Y.shape[0]):
        for j in range(Y.shape[1]):
            y = Y[k, j]
            field = max(field, np.sqrt(y[0] * y[0] + y[1] * y[1]))
            carriers = max(carriers, abs(y[2]))
        heat = max(heat, abs(read(Y[k, Y.shape[1] - 1], thermal)))
    return np.array([field, carriers, heat])


@compiled
def densities(start: Array, Y: Array, tau: Array, scheme: Scheme, thermal: Any) -> Array:
    """Return for every interval the (s + 1)th root of the error that a unit of the period would have there.

    The error is that of the polynomials, relative to the largest values of field, carriers and temperature.
    """
    number, s = Y.shape[:2]
    size = sizes(Y, thermal)
    top = np.zeros((number, 4))
    for k in range(number):
        width = (tau[k + 1] - tau[k]) ** s
        for j in range(s + 1):
            y = (start if k == 0 else Y[k - 1, s - 1]) if j == 0 else Y[k, j - 1]
            for a in range(3):
                top[k, a] += scheme.top[j] * y[a] / (size[min(max(a - 1, 0), 1)] * width)
            top[k, 3] += scheme.top[j] * read(y, thermal) / (size[2] * width)
    reach = 0.0  # the largest |x (x - c_1) .. (x - c_s)| of an interval
    for i in range(1, 64):
        x = i / 64
        product = x
        for j in range(s):
            product *= x - scheme.c[j]
        reach = max(reach, abs(product))
    jumps = np.empty(number)
    for k in range(number):  # between the intervals k and k + 1
        after = (k + 1) % number
        gap = 0.5 * (tau[k + 1] - tau[k] + tau[after + 1] - tau[after])
        total = 0.0
        for a in range(4):
            total += (top[after, a] - top[k, a]) ** 2
        jumps[k] = np.sqrt(total) / gap / (s + 1)
    out = np.empty(number)
    for k in range(number):
        out[k] = (reach * max(jumps[k], jumps[k - 1])) ** (1.0 / (s + 1))
    return out


@compiled
def spaced(tau: Array, density: Array, number: int) -> Array:
    """Return a mesh of ``number`` intervals that all hold the same part of the integral of ``density``."""
    old = density.size
    mean = 0.0
    for k in range(old):
        mean += density[k] * (tau[k + 1] - tau[k])
    level = np.empty(old)
    for k in range(old):  # half way from the mesh there is, in logarithms: the jumps of a rough mesh are rough
        near = (density[k - 1] * density[k] * density[k] * density[(k + 1) % old]) ** 0.25
        level[k] = max(np.sqrt(near / (mean * old * (tau[k + 1] - tau[k]))), FLATTEST)
    total = np.zeros(old + 1)
    for k in range(old):
        total[k + 1] = total[k] + level[k] * (tau[k + 1] - tau[k])
    out, at = np.empty(number + 1), 0
    out[0], out[number] = 0.0, 1.0
    for i in range(1, number):
        want = total[old] * i / number
        while total[at + 1] < want:
            at += 1
        out[i] = tau[at] + (want - total[at]) / level[at]
    return out


@compiled
def interpolate(start: Array, Y: Array, tau: Array, scheme: Scheme, at: Array) -> Array:
    """Return the states at the fractions ``at`` of the period, increasing, by the polynomials; shape (.., m)."""
    number, s, m = Y.shape
    out, k = np.zeros((at.size, m)), 0
    if at.size == 1:
        above = number - 1
        while k < above:
            middle = (k + above + 1) // 2
            if tau[middle] < at[0]:
                k = middle
            else:
                above = middle - 1
    for p in range(at.size):
        while k < number - 1 and at[p] > tau[k + 1]:
            k += 1
        x = (at[p] - tau[k]) / (tau[k + 1] - tau[k])
        for j in range(s + 1):
            node = 0.0 if j == 0 else scheme.c[j - 1]
            weight = 1.0
            for i in range(s + 1):
                if i != j:
                    other = 0.0 if i == 0 else scheme.c[i - 1]
                    weight *= (x - other) / (node - other)
            y = (start if k == 0 else Y[k - 1, s - 1]) if j == 0 else Y[k, j - 1]
            for a in range(m):
                out[p, a] += weight * y[a]
    return out


def stages(tau: Array, c: Array) -> Array:
    """Return the fractions of the period at all stages, shape (N s,)."""
    return np.ravel(tau[:-1, None] + np.diff(tau)[:, None] * c)


@compiled
def look(start: Array, Y: Array, tau: Array, ring: Ring, scheme: Scheme, at: Array) -> Array:
    """Return rows U, dU/dt, dT, d(dT)/dt at the fractions ``at`` of the period, increasing; shape (.., 4)."""
    states = interpolate(start, Y, tau, scheme, at)
    out = np.empty((at.size, 4))
    for p in range(at.size):
        y = states[p]
        f = equations.right_hand_side(y, ring.pump, ring.detuning, ring.rates, ring.fcd, ring.thermal)
        dT, slope = kinds.rise_of(read(y, ring.thermal), ring.thermal)
        out[p, 0], out[p, 1] = y[0] * y[0] + y[1] * y[1], 2.0 * (y[0] * f[0] + y[1] * f[1])
        out[p, 2], out[p, 3] = dT, slope * read(f, ring.thermal)
    return out


@compiled
def passes(
    start: Array, Y: Array, tau: Array, ring: Ring, scheme: Scheme, grid: Array, seen: Array, column: int, level: float
) -> Array:
    """Return where a column of `look`, ``seen`` on the ``grid``, passes ``level``: one bisection in every bracket."""
    out, found, at = np.empty(grid.size), 0, np.empty(1)
    for i in range(grid.size - 1):
        up = seen[i + 1, column] > level
        if (seen[i, column] > level) == up:
            continue
        left, right = grid[i], grid[i + 1]
        for _ in range(BISECTIONS):
            at[0] = 0.5 * (left + right)
            if (look(start, Y, tau, ring, scheme, at)[0, column] > level) == up:
                right = at[0]
            else:
                left = at[0]
        out[found] = 0.5 * (left + right)
        found += 1
    return out[:found]


for module in (equations, kinds):
    forget_if_older(interpolate, str(module.__file__))
