"""The kinds of heat that are integrated with the optics, and the one place where compiled code tells them apart.

    poles:      dx_i/dt = gain_i P_abs - rate_i x_i,               dT = z + curvature z^2,  z = sum_i x_i
    quadratic:  dx/dt   = A x + H[x, x] + (G x + B) P_abs,         dT = z = C x

Functions such as `read` and `flow` are stubs, overloaded in Numba: the type of ``thermal`` selects the body when the
integration is compiled. Called from Python they return None. Another module that needs a body for each kind declares a
stub in the same way and selects with `chosen`. Internal units, as in `equations`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .compiling import OPTIONS, overload

Array = NDArray[np.float64]
Body = Any
AtRest = Callable[[], tuple[Array, Array, NDArray[np.intp]]]


class Poles(NamedTuple):
    """A Foster network with an output map, in internal units."""

    poles: Array  # rows (gain_i in K/fJ, rate_i in 1/ns)
    curvature: float  # 1/K

    @property
    def order(self) -> int:
        """Number of thermal states."""
        return int(self.poles.shape[1])

    @property
    def slowest(self) -> float:
        """Rate of the slowest decay in 1/ns."""
        return float(self.poles[1].min())

    def without_idle_poles(self) -> Poles:
        """The network without poles of zero gain, equal rates merged; the stability of the ring does not change."""
        rate, where = np.unique(self.poles[1], return_inverse=True)
        merged = np.array([np.bincount(where, self.poles[0]), rate])
        return self._replace(poles=np.ascontiguousarray(merged[:, merged[0] > 0]))

    def impedance(self, z: NDArray[np.complex128], at_rest: AtRest) -> NDArray[np.complex128]:
        """Thermal impedance in K/uW of small changes at the complex frequencies ``z``; it needs no states."""
        total = np.zeros(z.shape, dtype=complex)
        for gain, rate in self.poles.T:
            total += gain / (z + rate)
        return total


class QuadraticHeat(NamedTuple):
    """A quadratic model in internal units."""

    A: Array  # 1/ns
    H: Array  # 1/(K ns)
    G: Array  # 1/fJ
    B: Array  # K/fJ
    C: Array  # 1
    weight: Array  # temperature error in K per unit error of each state

    @property
    def order(self) -> int:
        """Number of thermal states."""
        return int(self.C.size)

    @property
    def slowest(self) -> float:
        """Rate of the slowest decay at rest in 1/ns."""
        return float(-np.linalg.eigvals(self.A).real.max())

    def without_idle_poles(self) -> QuadraticHeat:
        """The system itself."""
        return self

    def impedance(self, z: NDArray[np.complex128], at_rest: AtRest) -> NDArray[np.complex128]:
        """Thermal impedance in K/uW of small changes about states at rest, at the complex frequencies ``z``.

        ``at_rest()`` returns states (m, n), their absorbed powers (m,) in uW, and for each z which of them it is about.
        """
        x, power, which = at_rest()
        J = self.A + 2 * np.einsum("ijk,mk->mij", self.H, x) + power[:, None, None] * self.G
        rates, modes = np.linalg.eig(J)
        heating = (self.B + x @ self.G.T)[..., None].astype(complex)
        gains = (self.C @ modes) * np.linalg.solve(modes, heating)[..., 0]
        total = np.zeros(z.shape, dtype=complex)
        for k in range(self.C.size):
            total += gains[which, k] / (z - rates[which, k])
        return total


class Static(NamedTuple):
    """Heat at rest of a Foster network with an output map: dT = z + curvature z^2, z = R P."""

    R: float  # K/uW
    curvature: float = 0.0  # 1/K


class Curve(NamedTuple):
    """Heat at rest of a quadratic model: dT = P f(P), and beyond ``top`` the tangent there."""

    top: float  # uW
    f: Array  # K/uW, Chebyshev coefficients over [0, top]
    slope: Array  # those of df/dx, x = 2 P/top - 1


Thermal = Poles | QuadraticHeat
SHARES, NEWTON_STEPS = 8, 12  # of the power, one after the other, and to each
ROUGH, TINY = 1e-2, 1e-300


def chosen(thermal: Any, poles: Body, quadratic: Body) -> Body:
    """Return the body for the kind of ``thermal``, a Numba type."""
    return quadratic if thermal.instance_class in (QuadraticHeat, Curve) else poles


def read(y: Array, thermal: Any) -> Any:
    """Return z at a state."""


def rise_of(z: float, thermal: Any) -> Any:
    """Return dT and d(dT)/dz at ``z``; no step ends beyond the top of an output map, where d(dT)/dz < 0."""


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
    def poles(y: Array, thermal: Any) -> float:
        z = 0.0
        for i in range(3, y.size):
            z += y[i]
        return z

    def quadratic(y: Array, thermal: Any) -> float:
        z = 0.0
        for i in range(3, y.size):
            z += thermal.C[i - 3] * y[i]
        return z

    return chosen(thermal, poles, quadratic)


@overload(rise_of, jit_options=OPTIONS, strict=False)
def _rise_of(z: Any, thermal: Any) -> Body:
    def poles(z: float, thermal: Any) -> tuple[float, float]:
        return z + thermal.curvature * z * z, 1.0 + 2.0 * thermal.curvature * z

    def quadratic(z: float, thermal: Any) -> tuple[float, float]:
        return z, 1.0

    return chosen(thermal, poles, quadratic)


@overload(weigh, jit_options=OPTIONS, strict=False)
def _weigh(k: Any, thermal: Any) -> Body:
    def poles(k: Array, thermal: Any) -> float:
        total = 0.0
        for i in range(3, k.shape[1]):
            total += abs(k[-1, i])
        return total

    def quadratic(k: Array, thermal: Any) -> float:
        total = 0.0
        for i in range(3, k.shape[1]):
            total += abs(k[-1, i]) * thermal.weight[i - 3]
        return total

    return chosen(thermal, poles, quadratic)


@overload(flow, jit_options=OPTIONS, strict=False)
def _flow(y: Any, heat: Any, thermal: Any, out: Any) -> Body:
    def poles(y: Array, heat: float, thermal: Any, out: Array) -> None:
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

    return chosen(thermal, poles, quadratic)


@overload(order, jit_options=OPTIONS, strict=False)
def _order(thermal: Any) -> Body:
    def poles(thermal: Any) -> int:
        return int(thermal.poles.shape[1])

    def quadratic(thermal: Any) -> int:
        return int(thermal.C.size)

    return chosen(thermal, poles, quadratic)


@overload(rest, jit_options=OPTIONS, strict=False)
def _rest(heat: Any, thermal: Any, out: Any) -> Body:
    def poles(heat: float, thermal: Any, out: Array) -> None:
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

    return chosen(thermal, poles, quadratic)


@overload(spread, jit_options=OPTIONS, strict=False)
def _spread(y: Any, heat: Any, by_heat: Any, by_dT: Any, thermal: Any, out: Any) -> Body:
    def poles(y: Array, heat: float, by_heat: Any, by_dT: Any, thermal: Any, out: Array) -> None:
        slope = rise_of(read(y, thermal), thermal)[1]
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

    return chosen(thermal, poles, quadratic)


def rise(heat: float, static: Any) -> Any:
    """Return dT and d(dT)/dP at the absorbed power ``heat``."""


def bend(heat: float, static: Any) -> Any:
    """Return d(dT)/dz: what an output map does to small changes of a network, and 1 for a quadratic model."""


@overload(rise, jit_options=OPTIONS, strict=False)
def _rise(heat: Any, static: Any) -> Any:
    def poles(heat: float, static: Any) -> tuple[float, float]:
        z = static.R * heat
        return z + static.curvature * z * z, static.R * (1.0 + 2.0 * static.curvature * z)

    def quadratic(heat: float, static: Any) -> tuple[float, float]:
        P = min(heat, static.top)
        x = 2.0 * P / static.top - 1.0
        a, b, c, d = 0.0, 0.0, 0.0, 0.0  # Clenshaw's recurrences
        for k in range(static.f.size - 1, 0, -1):
            a, b = static.f[k] + 2.0 * x * a - b, a
        for k in range(static.slope.size - 1, 0, -1):
            c, d = static.slope[k] + 2.0 * x * c - d, c
        f, slope = static.f[0] + x * a - b, static.slope[0] + x * c - d
        by_heat = f + P * slope * 2.0 / static.top
        return P * f + (heat - P) * by_heat, by_heat

    return chosen(static, poles, quadratic)


@overload(bend, jit_options=OPTIONS, strict=False)
def _bend(heat: Any, static: Any) -> Any:
    def poles(heat: float, static: Any) -> float:
        return 1.0 + 2.0 * static.curvature * static.R * heat

    def quadratic(heat: float, static: Any) -> float:
        return 1.0

    return chosen(static, poles, quadratic)
