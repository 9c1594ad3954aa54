"""The rational Krylov space of a reduction, and its certificate: a rigorous bound at every frequency.

The space is extended one shift at a time. It begins with some solves at s = 0, which give the static gain and the
slowest rate, and goes on with two or three shifts in turn: the factors of K then make place for those of the first
(A. Ruhe, Linear Algebra Appl. 58, 391 (1984); A. C. Antoulas, Approximation of Large-Scale Dynamical Systems (SIAM,
2005), ch. 11).

With ports F (columns that heat and read), an M-orthonormal basis V that holds the static solutions, Kr = V^T K V and
Y(s) = (Kr + s)^-1 V^T F, the residual of the reduced solution is

    R(s) = F - (K + s M) V Y(s) = Rhat Phi(s),   Rhat = F - M V V^T F,   Phi(s) = 1 - G Y(s),

always in the p-dimensional range of Rhat, because V spans a rational Krylov space. As V^T R = 0,

    H - H_r = R^T (K + s M)^-1 R,   so for s = i w and any two shifts s_j, s_l > 0 with a factor at hand, equal or not,
    |H_ab - H_r,ab| <= sqrt(|R_a|_j |R_a|_l |R_b|_j |R_b|_l) / rho_jl(w),     |r|_j^2 = r^H (K + s_j M)^-1 r,
    rho_jl = min over lambda >= 0 of sqrt(lambda^2 + w^2)/sqrt((lambda + s_j)(lambda + s_l)),
    rho_jl^-2 = (1 + c + sqrt((1 - c)^2 + (s_j + s_l)^2/w^2))/2,   c = s_j s_l/w^2   (1 + s_j^2/w^2 for j = l),

by Cauchy and Schwarz over the modes of the full system, none of which is needed: p solves with each factor give it at
all frequencies. Between two shifts both together bound best, elsewhere one alone.

Between samples. For one port |Phi|^2 = prod_j (w^2 + s_j^2)/(w^2 + theta_j^2) over the shifts used and the k Ritz
values, and 1/rho_jl is log-convex in ln w: the logarithm of the bound has a second derivative above -k in ln w, so over
an interval of length h it exceeds its larger end by at most k h^2/8. Below the first sample the bound falls with w
(s = 0 is a shift: |Phi|^2 falls with w^2, 1/rho_jl grows with 1/w), above the last every factor of |Phi|^2 is within
1e-6 of one. For several ports |R_a|_j^2 has the same denominator but a numerator that is no product: the same factor is
added between samples, without proof (20 times more samples found nothing higher on heaters, nor 700 frequencies on the
random pencils of tests/audit/reductions.py).

Round-off. Nearly equal ports, or a basis that holds the ports to their last digits, hide Rhat. `leftover` measures what
the closed form misses; beyond 1 % of the residual `certify_defect` takes the residual as it is.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from scipy.linalg import qr

from thermofem import checks
from thermofem.algebra import krylov
from thermofem.algebra.factor import Pencil
from thermofem.algebra.krylov import symmetric_part
from thermofem.arrays import Array, NDArray

Indices = NDArray[np.intp]

PER_DECADE = 60
BEYOND = 1e3  # the samples reach this factor below the slowest and above the fastest rate of the reduced model
SOLVE_ROUND_OFF = (
    1e-9  # of the ports' own gains: what solves leave at worst (measured 1e-12..1e-9); no bound is below it
)


@dataclass(frozen=True, eq=False)
class Projection:
    """A reduced system between its ports, and the part of the ports outside its basis.

    rate [shape (k,), 1/s]: Ritz values theta_i, increasing.
    ports [shape (k, p)]: Z^T V^T F in modal coordinates.
    remainder [shape (n, q)]: Q, independent columns that span what the basis leaves of the ports; for one port Rhat
        itself.
    shares [shape (q, p)]: T, so that Rhat = Q T.
    fields [shape (n, k)]: V.
    mass_basis [shape (n, k)]: M V.
    vectors [shape (k, k)]: Z, the eigenvectors of Kr.
    """

    rate: Array
    ports: Array
    remainder: Array
    mass_basis: Array
    vectors: Array
    shares: Array
    fields: Array

    @property
    def modes(self) -> Array:
        """Modes V Z in the full space, shape (n, k)."""
        return self.fields @ self.vectors

    @property
    def gain(self) -> Array:
        """Static gain between the ports, shape (p, p), exact."""
        return self.ports.T @ (self.ports / self.rate[:, None])

    def reduced(self, omega: Array) -> NDArray[np.complex128]:
        """Reduced solutions Y(i w) in modes at angular frequencies in rad/s, shape (m, k, p)."""
        s = np.asarray(1j * omega[:, None, None], dtype=complex)
        return self.ports / (self.rate[:, None] + s)


@dataclass(frozen=True, eq=False)
class Certificate:
    """The bound of |H - H_r| for c pairs of ports.

    omega [shape (m,), rad/s]
    samples [shape (m, c), K/W]: the bound at ``omega``.
    top [shape (c,), K/W]: not exceeded at any frequency.
    """

    omega: Array
    samples: Array
    top: Array


def certify(
    projection: Projection,
    shifts: Array,
    solutions: Sequence[Array],
    *,
    pairs: tuple[Indices, Indices],
    per_decade: int | None = None,
) -> Certificate:
    """Bound the error of a projection.

    shifts [1/s]: any of those at which the space was built, but 0.
    solutions [shape (n, q)]: (K + s_j M)^-1 Q for each of ``shifts``; fewer shifts give a looser bound.
    pairs [two arrays of int, shape (c,)]: the two ports of each channel.
    per_decade: samples; default `PER_DECADE`.
    """
    omega = _frequencies(projection, shifts, per_decade or PER_DECADE)
    grams = [symmetric_part(projection.remainder.T @ w) for w in solutions]
    phi = _phi(projection, float(shifts[0]), solutions[0], grams[0], omega)
    bounds = _bounds(omega, shifts, grams, phi, pairs)
    return _certificate(projection, omega, bounds, pairs)


def certify_defect(
    projection: Projection,
    parts: Array,
    shifts: Array,
    solutions: Sequence[Array],
    *,
    pairs: tuple[Indices, Indices],
) -> Certificate:
    """Bound the error from the computed residual R = Rhat - D Y, which includes the round-off in the basis.

        H - H_r = R^T (K + s M)^-1 R + R^T V Z Y

    holds for any basis; the second term, zero for an orthonormal one, is computed and added.

    parts [shape (n, p + k)]: Rhat and D = K V Z - M V Z diag(rate) side by side.
    shifts [1/s]: may include 0.
    solutions [shape (n, p + k)]: (K + s_j M)^-1 times ``parts`` for each of ``shifts``; they make it dearer than
        `certify`, which needs none beyond those of the basis.
    pairs [two arrays of int, shape (c,)]
    """
    a, b = pairs
    p = projection.ports.shape[1]
    omega = _frequencies(projection, projection.rate[-1:], PER_DECADE)
    Y = projection.reduced(omega)
    identity = np.broadcast_to(np.eye(p), (omega.size, p, p))
    residual = np.concatenate([identity, -Y], axis=1)
    grams = [symmetric_part(parts.T @ w) for w in solutions]
    bounds = _bounds(omega, shifts, grams, residual, pairs)
    along = parts.T @ projection.modes
    leak = residual.transpose(0, 2, 1) @ (along @ Y)
    return _certificate(projection, omega, bounds + np.abs(leak[:, a, b]), pairs)


def leftover(projection: Projection, defect: Array, weight: Array) -> float:
    """Largest ratio, over frequency, of the residual outside the span of Q, which `certify` neglects, to that inside.

    Round-off of the basis makes D = Q G + L with L != 0. Measured in the norm of ``weight`` (shape (n,)), at four
    frequencies a decade.
    """
    root = np.sqrt(weight)[:, None]
    Q, _ = np.linalg.qr(root * projection.remainder)
    D = root * defect
    G = Q.T @ D
    L = D - Q @ G
    Rhat = projection.remainder @ projection.shares
    ports = Q.T @ (root * Rhat)
    gram = L.T @ L
    low, high = projection.rate[[0, -1]]
    count = int(4 * np.log10(100 * high / low)) + 2
    omega = np.geomspace(low / 10, high * 10, count)
    worst = 0.0
    for Y in projection.reduced(omega):
        inside = np.linalg.norm(ports - G @ Y, axis=0)
        square = np.einsum("ia,ij,ja->a", Y.conj(), gram, Y).real
        outside = np.sqrt(np.maximum(square, 0))
        ratio = outside / np.maximum(inside, np.finfo(float).tiny)
        worst = max(worst, float(ratio.max()))
    return worst


def _frequencies(projection: Projection, shifts: Array, per_decade: int) -> Array:
    """Angular frequencies in rad/s at which the bound is sampled, shape (m,)."""
    low = projection.rate[0] / BEYOND
    high = max(projection.rate[-1], *shifts) * BEYOND
    count = int(np.ceil(np.log10(high / low) * per_decade))
    return np.geomspace(low, high, count)


def _bounds(
    omega: Array,
    shifts: Array,
    grams: Sequence[Array],
    residual: NDArray[np.complex128],
    pairs: tuple[Indices, Indices],
) -> Array:
    """Bounds sqrt(|R_a|_j |R_a|_l |R_b|_j |R_b|_l) / rho_jl in K/W for every two shifts, shape (bounds, m, c)."""
    a, b = pairs
    products = []  # of the two norms of each channel, |R_a|_j |R_b|_j
    for gram in grams:
        square = np.einsum("mia,mia->ma", residual.conj(), gram @ residual).real
        square = np.maximum(square, 0)
        products.append(np.sqrt(square[:, a] * square[:, b]))
    bounds = []
    for j, k in combinations_with_replacement(range(len(shifts)), 2):
        rho = _rho(omega, shifts[j], shifts[k])
        product = np.sqrt(products[j] * products[k])
        bounds.append(product / rho[:, None])
    return np.array(bounds)


def _certificate(projection: Projection, omega: Array, bounds: Array, pairs: tuple[Indices, Indices]) -> Certificate:
    """The certificate from several bounds at ``omega``, shape (bounds, m, c); the smallest holds."""
    a, b = pairs
    k = projection.rate.size
    static = projection.gain.diagonal()
    bounds = np.maximum(bounds, SOLVE_ROUND_OFF * np.sqrt(static[a] * static[b]))
    smallest = bounds.min(axis=0)
    step = np.log(omega[1] / omega[0])
    larger = np.maximum(bounds[:, 1:], bounds[:, :-1])  # of the two ends of each interval
    between = larger.min(axis=0) * np.exp(k * step**2 / 8)
    ends = np.maximum(smallest[0], smallest[-1])
    beyond = ends * (1 + k / BEYOND**2)
    top = np.maximum(between.max(axis=0), beyond)
    return Certificate(omega, smallest, top)


def _rho(omega: Array, s: float, t: float) -> Array:
    """rho_jl of shifts s, t: least sqrt(lambda^2 + w^2)/sqrt((lambda + s)(lambda + t)), lambda >= 0; shape (m,)."""
    c = s * t / omega**2
    d = (s + t) / omega
    inverse_square = (1 + c + np.hypot(1 - c, d)) / 2
    return 1 / np.sqrt(inverse_square)


def _phi(projection: Projection, shift: float, solution: Array, gram: Array, omega: Array) -> NDArray[np.complex128]:
    """Phi(i w) = T - G Y(i w), shape (m, q, p), from the modal residual D = K V - M V Kr = Q G.

    With W = (K + s M)^-1 Q and V^T Q = 0:  W^T D = -(W^T M V)(Kr + s),  W^T Q = gram,  so G = gram^-1 W^T D.
    """
    masses = solution.T @ projection.mass_basis @ projection.vectors
    D = -masses * (projection.rate + shift)
    G, *_ = np.linalg.lstsq(gram, D, rcond=1e-13)
    return np.asarray(projection.shares - G @ projection.reduced(omega), dtype=complex)


EXHAUSTED = 1e-13  # share of a port outside the basis that is round-off


class CertifiedSpace(krylov.KrylovSpace):
    """A rational Krylov space that grows one shift at a time, and its projection."""

    projection: Projection

    def __init__(self, K: Any, M: Any, ports: Array, tolerance: float) -> None:
        super().__init__(K, M, ports, smallest=1e-20)
        self.solves = 0
        self.visits = 0
        self._pencil = Pencil(M, K)
        self.shifts = np.zeros(1)
        for k in range(_static(tolerance)):
            fields = self.solve(0)
            gains = ports * fields  # b^T K^-1 b of each port b, before the sum
            least = SOLVE_ROUND_OFF * np.abs(gains).sum(axis=0)
            if k == 0 and np.any(gains.sum(axis=0) <= least):
                raise checks.InputError(
                    "-A is not positive definite (a static gain is not positive); is a boundary held?"
                )
            if not self.extend(fields) or self.exhausted:
                break
        self.shifts, self.growing = _shifts(M, ports, self.projection, tolerance)
        for s in self.shifts[2:]:
            self._pencil.keep(s, 1.0)

    @property
    def exhausted(self) -> bool:
        """Whether the basis contains every port up to round-off: Phi is then lost, and `certify_defect` is needed."""
        return not _outside(self.remainder, self.B).any()

    @property
    def defect(self) -> Array:
        """Defect K V Z - M V Z diag(rate) of the projection, shape (n, k)."""
        Z = self.projection.vectors
        flow = self.K @ (self.V @ Z)
        return flow - (self.MV @ Z) * self.projection.rate

    def solve(self, j: int) -> Array:
        """(K + s_j M)^-1 Q, shape (n, q), with Q what the basis leaves of the ports (`Projection.remainder`)."""
        columns = self.projection.remainder if self.order else self.remainder
        self.solves += columns.shape[1]
        return self.apply(j, columns)

    def next_residual(self) -> tuple[float, Array]:
        """At the next shift s: the largest error of a port's own channel in K/W, and the columns that correct it.

        The columns are (K + s M)^-1 times the residual at s: the same direction as `solve`, above round-off for longer.
        """
        j = self._next_shift()
        shifted = self.projection.rate + self.shifts[j]
        Y = self.projection.ports / shifted[:, None]
        residual = self.remainder - self.defect @ Y
        residual = residual[:, _outside(residual, self.B)]
        self.solves += residual.shape[1]
        columns = self.apply(j, residual)
        errors = np.einsum("ij,ij->j", residual, columns)
        return float(errors.max(initial=0.0)), columns

    def apply(self, j: int, columns: Array) -> Array:
        """(K + s_j M)^-1 times columns."""
        if not columns.shape[1]:
            return columns
        shift = self.shifts[j]
        return np.column_stack([self._pencil.solve(shift, 1.0, column) for column in columns.T])

    def solve_next(self) -> tuple[int, Array]:
        """Index of the next shift, and the solution there, which certifies the basis so far and then extends it."""
        j = self._next_shift()
        return j, self.solve(j)

    def _next_shift(self) -> int:
        j = 1 + self.visits % self.growing
        self.visits += 1
        return j

    def extend(self, W: Array) -> bool:
        """Add the columns of W, made orthogonal to the basis, and project; False if they lie in the basis."""
        if not super().extend(W):
            return False
        # slow fields come first: this triangle keeps the slow rates, and with them R_th, to 1e-12 beside the fast ones
        rate, Z = np.linalg.eigh(self.stiffness, UPLO="U")
        if not rate[0] > 0:
            raise checks.InputError(
                f"-A is not positive definite (a mode grows at {-rate[0]:g} 1/s); is a boundary held?"
            )
        Q, T = _independent(self.remainder, self.B)
        self.projection = Projection(rate, Z.T @ self.inside, Q, self.MV, Z, T, self.V)
        return True


def _outside(remainder: Array, ports: Array) -> NDArray[np.bool_]:
    """Which ports the basis does not contain up to round-off, shape (p,)."""
    least = EXHAUSTED * np.linalg.norm(ports, axis=0)
    return np.linalg.norm(remainder, axis=0) > least


def _independent(remainder: Array, ports: Array) -> tuple[Array, Array]:
    """Factors Q and T of the remainder Rhat = Q T, with independent columns Q even for nearly equal ports.

    A port that the basis contains up to round-off has zeros in T; a single port stays as it is.
    """
    count = remainder.shape[1]
    outside = np.flatnonzero(_outside(remainder, ports))
    if count == 1 or not outside.size:
        return remainder, np.eye(count)
    columns = remainder[:, outside]
    size = np.linalg.norm(columns, axis=0)
    Q, T, order = qr(columns / size, mode="economic", pivoting=True)
    independent = np.abs(T.diagonal()) > EXHAUSTED
    shares = np.zeros((independent.sum(), count))
    shares[:, outside[order]] = T[independent] * size[order]
    return np.ascontiguousarray(Q[:, independent]), shares


def _static(tolerance: float) -> int:
    """Number of solves at s = 0 before those at the other shifts."""
    return int(np.clip(round(-np.log10(tolerance)), 2, 4))


def _shifts(M: Any, ports: Array, projection: Projection, tolerance: float) -> tuple[Array, int]:
    """Shifts: 0, and log-spaced rates from a multiple of the slowest rate to a multiple of the fastest at the ports.

    Also returns the number of them, beside 0, that enlarge the space; a further one only tightens the bound.

    The fastest comes from the initial slope of the step response, b^T M^-1 b / (b^T K^-1 b). The multiples are where
    strips, a rib, a heater and a disc need the fewest states at 1e-2..1e-7 (measured; flat within a factor 1.3). Down
    to 1e-4 two shifts are enough, below a third keeps the states few.
    """
    slowest = projection.rate[0]
    fastest = float(np.max(krylov.slopes(M, ports) / projection.gain.diagonal()))
    if tolerance >= 1e-4:
        count = 2
        low = max(20.0, 40 * (1e-4 / tolerance) ** 0.22) * slowest
        high = 2.5 * tolerance**-0.3 * fastest
    else:
        count = 3
        low = 18 * slowest
        high = 1.1 * tolerance**-0.5 * fastest
    low = min(low, high / 10)
    # 200.0: between two shifts: beyond, the bound in their middle is three times the error (measured)
    wide = count == 2 and high > 200.0 * low
    between = [np.sqrt(low * high)] if wide else []
    growing = np.geomspace(low, high, count)
    return np.array([0.0, *growing, *between]), count
