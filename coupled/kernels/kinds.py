"""What differs between the kinds of thermal models, chosen when the integration is compiled and not while it runs.

    network:    dx_i/dt = gain_i P_abs - rate_i x_i,               dT = z + curvature z^2,  z = sum_i x_i
    quadratic:  dx/dt   = A x + H[x, x] + (G x + B) P_abs,         dT = z = C x

A bare array of poles, rows (gain_i, rate_i), is a network without curvature. A function here is a name for compiled
code to call, and numba takes the body that fits the type of ``thermal``; called from Python it returns None.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import NDArray

Array = NDArray[np.float64]
Body = Any


class Network(NamedTuple):
    """A Foster network with an output map, in internal units."""

    poles: Array  # rows (gain_i in K/fJ, rate_i in 1/ns)
    curvature: float  # 1/K


class Quadratic(NamedTuple):
    """A quadratic model in internal units."""

    A: Array  # 1/ns
    H: Array  # 1/(K ns)
    G: Array  # 1/fJ
    B: Array  # K/fJ
    C: Array  # 1
    weight: Array  # what an error of each state counts as, in K


Thermal = Network | Quadratic
SHARES, NEWTON_STEPS = 8, 12  # of the power, one after the other, and to each
ROUGH, TINY = 1e-2, 1e-300
OPTIONS = {"error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz", "arcp"}}


def _chosen(thermal: Any, poles: Body, network: Body, quadratic: Body) -> Body:
    """The body for the kind of ``thermal``, a type of numba."""
    if isinstance(thermal, types.Array):
        return poles
    return quadratic if thermal.instance_class is Quadratic else network


def read(y: Array, thermal: Any) -> Any:
    """Return z at a state."""


def lift(z: float, thermal: Any) -> Any:
    """Return dT and d(dT)/dz at ``z``."""


def weigh(k: Array, thermal: Any) -> Any:
    """Return the sizes of the thermal entries of a row of ``k``, added up, in K."""


def flow(y: Array, heat: float, thermal: Any, out: Array) -> Any:
    """Write dx/dt under the power ``heat`` to out[3:]."""


def order(thermal: Any) -> Any:
    """Return the number of thermal states."""


def rest(heat: float, thermal: Any, out: Array) -> Any:
    """Write the states at rest under the power ``heat`` to out[3:], of a quadratic model on the branch from zero."""


def spread(y: Array, heat: float, by_heat: Any, by_dT: Any, thermal: Any, out: Array) -> Any:
    """Fill the Jacobian ``out`` outside its first 3 x 3 block from dP_abs/d(Re a, Im a, N) and d(optics)/d(dT)."""


@overload(read, jit_options=OPTIONS, strict=False)
def _read(y: Any, thermal: Any) -> Body:
    def network(y: Array, thermal: Any) -> float:
        z = 0.0
        for i in range(3, y.size):
            z += y[i]
        return z

    def quadratic(y: Array, thermal: Any) -> float:
        z = 0.0
        for i in range(3, y.size):
            z += thermal.C[i - 3] * y[i]
        return z

    return _chosen(thermal, network, network, quadratic)


@overload(lift, jit_options=OPTIONS, strict=False)
def _lift(z: Any, thermal: Any) -> Body:
    def straight(z: float, thermal: Any) -> tuple[float, float]:
        return z, 1.0

    def bent(z: float, thermal: Any) -> tuple[float, float]:
        return z + thermal.curvature * z * z, 1.0 + 2.0 * thermal.curvature * z

    return _chosen(thermal, straight, bent, straight)


@overload(weigh, jit_options=OPTIONS, strict=False)
def _weigh(k: Any, thermal: Any) -> Body:
    def network(k: Array, thermal: Any) -> float:
        total = 0.0
        for i in range(3, k.shape[1]):
            total += abs(k[-1, i])
        return total

    def quadratic(k: Array, thermal: Any) -> float:
        total = 0.0
        for i in range(3, k.shape[1]):
            total += abs(k[-1, i]) * thermal.weight[i - 3]
        return total

    return _chosen(thermal, network, network, quadratic)


@overload(flow, jit_options=OPTIONS, strict=False)
def _flow(y: Any, heat: Any, thermal: Any, out: Any) -> Body:
    def bare(y: Array, heat: float, thermal: Any, out: Array) -> None:
        for i in range(3, y.size):
            out[i] = thermal[0, i - 3] * heat - thermal[1, i - 3] * y[i]

    def network(y: Array, heat: float, thermal: Any, out: Array) -> None:
        for i in range(3, y.size):
            out[i] = thermal.poles[0, i - 3] * heat - thermal.poles[1, i - 3] * y[i]

    def quadratic(y: Array, heat: float, thermal: Any, out: Array) -> None:
        n = y.size - 3
        for i in range(n):
            total = thermal.B[i] * heat
            for j in range(n):
                row = thermal.A[i, j] + heat * thermal.G[i, j]
                for m in range(n):
                    row += thermal.H[i, j, m] * y[3 + m]
                total += row * y[3 + j]
            out[3 + i] = total

    return _chosen(thermal, bare, network, quadratic)


@overload(order, jit_options=OPTIONS, strict=False)
def _order(thermal: Any) -> Body:
    def bare(thermal: Any) -> int:
        return int(thermal.shape[1])

    def network(thermal: Any) -> int:
        return int(thermal.poles.shape[1])

    def quadratic(thermal: Any) -> int:
        return int(thermal.C.size)

    return _chosen(thermal, bare, network, quadratic)


@overload(rest, jit_options=OPTIONS, strict=False)
def _rest(heat: Any, thermal: Any, out: Any) -> Body:
    def bare(heat: float, thermal: Any, out: Array) -> None:
        for i in range(thermal.shape[1]):
            out[3 + i] = thermal[0, i] / thermal[1, i] * heat

    def network(heat: float, thermal: Any, out: Array) -> None:
        for i in range(thermal.poles.shape[1]):
            out[3 + i] = thermal.poles[0, i] / thermal.poles[1, i] * heat

    def quadratic(heat: float, thermal: Any, out: Array) -> None:
        n = thermal.C.size
        J, f = np.empty((n, n)), np.empty(3 + n)
        out[3:] = 0.0
        for share in range(1, SHARES + 1):
            P, before = heat * share / SHARES, np.inf
            for _ in range(NEWTON_STEPS):
                flow(out, P, thermal, f)
                for i in range(n):
                    for j in range(n):
                        J[i, j] = thermal.A[i, j] + P * thermal.G[i, j]
                        for m in range(n):
                            J[i, j] += 2.0 * thermal.H[i, j, m] * out[3 + m]
                change = np.linalg.solve(J, f[3:])
                out[3:] -= change
                size = np.abs(change).max() / max(np.abs(out[3:]).max(), TINY)
                if size <= ROUGH if share < SHARES else (size < 1e-8 and size >= 0.5 * before) or size == 0.0:
                    break  # near enough for the next share; at the last one, where round-off stops it
                before = size

    return _chosen(thermal, bare, network, quadratic)


@overload(spread, jit_options=OPTIONS, strict=False)
def _spread(y: Any, heat: Any, by_heat: Any, by_dT: Any, thermal: Any, out: Any) -> Body:
    def bare(y: Array, heat: float, by_heat: Any, by_dT: Any, thermal: Any, out: Array) -> None:
        for j in range(3, y.size):
            out[j, j] = -thermal[1, j - 3]
            for i in range(3):
                out[i, j], out[j, i] = by_dT[i], thermal[0, j - 3] * by_heat[i]

    def network(y: Array, heat: float, by_heat: Any, by_dT: Any, thermal: Any, out: Array) -> None:
        slope = lift(read(y, thermal), thermal)[1]
        for j in range(3, y.size):
            out[j, j] = -thermal.poles[1, j - 3]
            for i in range(3):
                out[i, j], out[j, i] = by_dT[i] * slope, thermal.poles[0, j - 3] * by_heat[i]

    def quadratic(y: Array, heat: float, by_heat: Any, by_dT: Any, thermal: Any, out: Array) -> None:
        n = y.size - 3
        for j in range(n):
            gain = thermal.B[j]
            for i in range(n):
                gain += thermal.G[j, i] * y[3 + i]
                out[3 + j, 3 + i] = thermal.A[j, i] + heat * thermal.G[j, i]
                for m in range(n):
                    out[3 + j, 3 + i] += 2.0 * thermal.H[j, i, m] * y[3 + m]
            for i in range(3):
                out[i, 3 + j], out[3 + j, i] = by_dT[i] * thermal.C[j], gain * by_heat[i]

    return _chosen(thermal, bare, network, quadratic)
