"""The laser as the compiled integrators read it: power and detuning as piecewise cubics of time."""

from __future__ import annotations

import math
from typing import NamedTuple

from .compiling import compiled, inlined
from .equations import Array


class LaserPieces(NamedTuple):
    """The light that comes in, as cubics in t - edges[k] between edges[k] and edges[k + 1] (ns)."""

    edges: Array  # shape (m + 1,)
    power: Array  # 2 gamma_e P in fJ/ns^2, shape (m, 4)
    detuning: Array  # rad/ns, shape (m, 4)


@inlined
def light(laser: LaserPieces, piece: int, u: float, h: float, at: Array, largest: float, pump: Array, detuning: Array, slopes: Array) -> None:  # fmt: skip  # noqa: E501
    """Write the laser at the stages of a step that begins ``u`` after the edge of its piece, and its slopes there.

    The slope of the pump sqrt(2 gamma_e P) is unbounded where P leaves 0. Its slope is an ingredient of the step, not
    of the equations: below 1e-12 of the ``largest`` P it is bounded, and the step control does the rest.
    """
    p, d = laser.power[piece], laser.detuning[piece]
    for q in range(at.size):
        v = u + at[q] * h
        pump[q] = math.sqrt(max(p[0] + v * (p[1] + v * (p[2] + v * p[3])), 0.0))
        detuning[q] = d[0] + v * (d[1] + v * (d[2] + v * d[3]))
    rise = p[1] + u * (2.0 * p[2] + u * 3.0 * p[3])
    slopes[0] = 0.5 * rise * pump[0] / max(pump[0] * pump[0] + 1e-12 * largest, 1e-300)
    slopes[1] = d[1] + u * (2.0 * d[2] + u * 3.0 * d[3])


@compiled
def largest_power(edges: Array, power: Array) -> float:
    """Return the largest squared pump at the ends of all pieces, for ``power`` of shape (m, 4); 1e-300 in the dark."""
    largest = 1e-300
    for k in range(power.shape[0]):
        p, u = power[k], edges[k + 1] - edges[k]
        largest = max(largest, abs(p[0]), abs(p[0] + u * (p[1] + u * (p[2] + u * p[3]))))
    return largest


@inlined
def power_and_detuning(laser: LaserPieces, piece: int, u: float) -> tuple[float, float]:
    """Return the squared pump and the detuning ``u`` after the edge of a piece."""
    p, d = laser.power[piece], laser.detuning[piece]
    power = p[0] + u * (p[1] + u * (p[2] + u * p[3]))
    return max(power, 0.0), d[0] + u * (d[1] + u * (d[2] + u * d[3]))
