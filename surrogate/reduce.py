"""Certified reduction of a heat problem to a few poles by rational Krylov projection.

The basis V collects (K + s_j M)^-1 R for a few real shifts s_j taken in turn, R being what the basis so far leaves of
the heat vectors. As the system is symmetric, so is the reduction: every pole decays, every R_i of a heated part is
positive, and as s = 0 is a shift R_th is exact. For real s >= 0 it approaches H(s) from below.

Sources: A. Ruhe, Linear Algebra Appl. 58, 391 (1984) (rational Krylov); A. C. Antoulas, Approximation of Large-Scale
Dynamical Systems (SIAM, 2005), ch. 11. The bound is derived in `surrogate.certificate`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thermofem import Foster, StateSpace, checks
from thermofem.factor import factorize
from thermofem.model import pole_responses
from thermofem.waveforms import Waveform

from .certificate import Certificate, Indices, Projection, certify, certify_defect

Array = NDArray[np.float64]

MOST = 300  # columns of the basis before a tolerance counts as out of reach
ROOM = 32  # columns that the basis has room for at first
PROMISING = 10.0  # the full certificate is worked out once one shift alone comes this near to the tolerance


@dataclass(frozen=True, eq=False)
class Reduction:
    """A reduced model and the proof of its accuracy.

    Attributes
    ----------
    model : Foster, or a small StateSpace where there are several inputs or outputs
    error_bound : float
        |H - H_r| / H(0) of the worst channel, not exceeded at any frequency from 0 to infinity.
    channel_bounds : array, shape (outputs, inputs)
        the same for each channel, relative to its own static gain.
    frequency : array, shape (m,), Hz
    bound : array, shape (m,) or (m, outputs, inputs)
        the bound at each frequency, relative to the static gain.
    basis : array, shape (states of the full system, order)
        full state = basis @ state of the model.
    shifts : array, 1/s
    tolerance : float
    solves : int
        with the factors of K + s_j M, one factor for each shift.
    """

    model: Foster | StateSpace
    error_bound: float
    channel_bounds: Array = field(repr=False)
    frequency: Array = field(repr=False)
    bound: Array = field(repr=False)
    basis: Array = field(repr=False)
    shifts: Array = field(repr=False)
    tolerance: float
    solves: int

    @property
    def order(self) -> int:
        """Number of states."""
        return self.model.order

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        from thermofem.display import card, model_card

        bound = f"below {self.error_bound:.1e} of R_th at every frequency"
        return card("Reduction", [("error", bound), ("solves", str(self.solves))], model_card(self.model))

    @property
    def provenance(self) -> dict[str, Any]:
        """What `surrogate.save_model` keeps beside the model."""
        method = "rational Krylov reduction"
        bound, shifts = self.error_bound, self.shifts.tolist()
        return {"method": method, "tolerance": self.tolerance, "error_bound": bound, "shifts": shifts}

    def lift(self, states: ArrayLike) -> Array:
        """States of the full system, shape (..., n), from states of the model, shape (..., order).

        ``heat.field(rom.lift(states))`` is the temperature field on the mesh.
        """
        return np.asarray(np.asarray(states) @ self.basis.T)

    def full_states(self, wave: Waveform, times: ArrayLike) -> Array:
        """States of the full system under a piecewise-linear waveform from rest, in closed form, shape (times, n)."""
        if not isinstance(self.model, Foster):
            raise checks.InputError("full_states needs one input and one output; reduce system.channel(heated, read)")
        return self.lift(pole_responses(1 / np.asarray(self.model.tau), wave, times) * self.model.gain)


def reduce(system: StateSpace, tolerance: float = 1e-4) -> Reduction:
    """Reduce a symmetric thermal system until its error is provably below ``tolerance`` at every frequency.

        |H(2 pi i f) - H_r(2 pi i f)| <= tolerance H(0)      for 0 <= f < infinity, for every channel

    Parameters
    ----------
    system : StateSpace
        E and -A symmetric positive definite, as of every heat problem; any number of inputs and outputs.
    tolerance : float
        relative to the static gain of each channel, 1e-7..0.1.

    Returns
    -------
    Reduction
        measured on the reference strip (6145 unknowns): order 10 / 14 / 18 / 23 for 1e-3 / 1e-4 / 1e-5 / 1e-6; the
        bound is at most three times the true error where that is largest.

    Raises
    ------
    InputError
        a model of another kind, matrices that are not symmetric or not definite, or a tolerance out of reach.

    >>> rom = reduce(assemble(strip_ring()).system, tolerance=1e-4)
    >>> rom.error_bound < 1e-4
    True
    """
    check_matrices(system)
    found = project(system, tolerance)
    projection, certificate = found.projection, found.certificate
    shape = (found.read.size, found.heated.size)
    scale = _scale(projection, found.pairs)
    model, basis = _model(system, projection, found.basis, found.heated, found.read)
    bound = (certificate.samples / scale).reshape(-1, *shape)
    return Reduction(
        model=model,
        error_bound=float(np.max(certificate.top / scale)),
        channel_bounds=(certificate.top / scale).reshape(shape),
        frequency=certificate.omega / (2 * np.pi),
        bound=bound[:, 0, 0] if isinstance(model, Foster) else bound,
        basis=basis,
        shifts=found.shifts,
        tolerance=tolerance,
        solves=found.solves,
    )


@dataclass(frozen=True, eq=False)
class Projected:
    """A system in the modes of a certified basis, between its ports.

    Attributes
    ----------
    projection, certificate
    basis : array, shape (n, k)
        M-orthonormal modes of ``projection.rate``.
    heated, read : array of int
        which port each input and output is.
    shifts : array, 1/s
    solves : int
    """

    projection: Projection
    certificate: Certificate
    basis: Array
    heated: Indices
    read: Indices
    shifts: Array
    solves: int

    @property
    def pairs(self) -> tuple[Indices, Indices]:
        """The two ports of each channel, outputs slowest."""
        return np.repeat(self.read, self.heated.size), np.tile(self.heated, self.read.size)


def check_matrices(system: StateSpace) -> None:
    """Raise InputError unless ``system`` is a StateSpace."""
    if not isinstance(system, StateSpace):
        raise checks.InputError(
            f"a {type(system).__name__} cannot be reduced: give the StateSpace of a heat problem (heat.system); "
            "fewer poles from a model come from surrogate.fit_foster on its step response"
        )


def project(system: StateSpace, tolerance: float) -> Projected:
    """The certified projection that `reduce` and `balanced_truncation` begin with; raises as `reduce`."""
    checks.between("tolerance", tolerance, 1e-7, 0.1, hint="it is relative to the static gain")
    K, M, ports, heated, read = _parts(system)
    space = _Space(K, M, ports, tolerance)
    pairs = (np.repeat(read, heated.size), np.tile(heated, read.size))
    projection, certificate = _grow(space, pairs, tolerance)
    basis = space.V @ projection.vectors
    return Projected(projection, certificate, basis, heated, read, space.shifts, space.solves)


def _grow(space: _Space, pairs: tuple[Indices, Indices], tolerance: float) -> tuple[Projection, Certificate]:
    """Extend the basis until its certificate meets the tolerance."""
    reached = np.inf
    while space.order < MOST:
        j, solution = space.solve_next()
        projection = space.projection
        if projection is not None:
            scale = tolerance * _scale(projection, pairs)
            if projection.exhausted:
                certificate = certify_defect(projection, space.defect, space.factors[0], pairs=pairs)
                reached = float(np.max(certificate.top / scale)) * tolerance
                if reached <= tolerance:
                    return projection, certificate
                break
            alone = certify(projection, space.shifts[[j]], [solution], pairs=pairs)
            if np.max(alone.top / scale) <= PROMISING:
                solutions = [solution if i == j else space.solve(i) for i in range(space.shifts.size)]
                certificate = certify(projection, space.shifts, solutions, pairs=pairs)
                reached = float(np.max(certificate.top / scale)) * tolerance
                if reached <= tolerance:
                    return projection, certificate
        if not space.extend(solution):
            break
    raise checks.InputError(f"tolerance = {tolerance:g} is out of reach: {space.order} states leave {reached:.1e}")


class _Space:
    """A rational Krylov space that grows one shift at a time, M-orthonormal."""

    def __init__(self, K: Any, M: Any, ports: Array, tolerance: float) -> None:
        from scipy.sparse import triu

        self.K, self.M, self.ports, self.solves = K, M, ports, 0
        self.order, self.stiffness = 0, np.empty((0, 0))
        self._V, self._MV = (np.empty((ports.shape[0], ROOM), order="F") for _ in range(2))
        self.projection: Projection | None = None
        self.remainder = ports
        self.turn = 0
        upper_K, upper_M = triu(K, format="csc"), triu(M, format="csc")
        static = factorize(upper_K, upper=True)
        self.shifts = _shifts(M, static, ports, tolerance)
        self.factors = [static, *(factorize(upper_K + s * upper_M, upper=True) for s in self.shifts[1:])]

    @property
    def V(self) -> Array:
        """The basis."""
        return self._V[:, : self.order]

    @property
    def MV(self) -> Array:
        """M times the basis."""
        return self._MV[:, : self.order]

    @property
    def defect(self) -> Array:
        """K V Z - M V Z diag(rate) of the projection."""
        assert self.projection is not None
        Z, rate = self.projection.vectors, self.projection.rate
        return np.asarray(self.K @ (self.V @ Z) - (self.MV @ Z) * rate)

    def solve(self, j: int) -> Array:
        """(K + s_j M)^-1 times what the basis leaves of the ports."""
        self.solves += self.remainder.shape[1]
        return np.column_stack([self.factors[j](column) for column in self.remainder.T])

    def solve_next(self) -> tuple[int, Array]:
        """The solve with the next shift in turn: it extends the basis and also certifies the one so far."""
        j = self.turn % self.shifts.size
        self.turn += 1
        return j, self.solve(j)

    def extend(self, W: Array) -> bool:
        """Add the columns of W; False when the space holds them already, or everything."""
        room = self.M.shape[0] - self.order
        if room == 0:
            return False
        MW = self.M @ W
        before = np.einsum("ij,ij->j", W, MW)
        if np.any(before <= 0):
            raise checks.InputError("E is not positive definite; every heat capacity must be positive")
        W, MW = W / np.sqrt(before), MW / np.sqrt(before)
        for _ in range(2):  # once more removes what round-off left
            inside = self.MV.T @ W
            W, MW = W - self.V @ inside, MW - self.MV @ inside
        value, vector = np.linalg.eigh(_symmetric(W.T @ MW))
        kept = value > 1e-20  # columns are of unit length before projection: below, only round-off is left
        kept[: max(0, kept.size - room)] = False
        if not kept.any():
            return False
        turn = vector[:, kept] / np.sqrt(value[kept])
        W = W @ turn
        KW = self.K @ W
        across, corner = self.V.T @ KW, W.T @ KW
        self._append(W, self.M @ W)
        self.stiffness = np.block([[self.stiffness, across], [across.T, _symmetric(corner)]])
        rate, Z = np.linalg.eigh(self.stiffness)
        if rate[0] <= 0:
            raise checks.InputError(
                f"-A is not positive definite (a mode grows at {-rate[0]:g} 1/s); is a boundary held?"
            )
        inside = self.V.T @ self.ports
        self.remainder = self.ports - self.MV @ inside
        self.projection = Projection(rate, Z.T @ inside, self.remainder, self.MV, Z)
        return True

    def _append(self, W: Array, MW: Array) -> None:
        """New columns, in room made before."""
        wanted = self.order + W.shape[1]
        if wanted > self._V.shape[1]:
            more = np.empty_like(self._V)
            self._V, self._MV = (
                np.asfortranarray(np.hstack([self._V, more])),
                np.asfortranarray(np.hstack([self._MV, more])),
            )
        self._V[:, self.order : wanted], self._MV[:, self.order : wanted] = W, MW
        self.order = wanted


def _symmetric(matrix: Array) -> Array:
    return (matrix + matrix.T) / 2


def _shifts(M: Any, static: Callable[[Array], Array], ports: Array, tolerance: float) -> Array:
    """{0} and log-spaced rates from 30 times the slowest to the fastest that the tolerance sees.

    The fastest comes from the initial slope of the step response, b^T M^-1 b / (b^T K^-1 b), estimated from below by
    (b^T D^-1 b)^2 / (b^T D^-1 M D^-1 b) with D the diagonal of M; the factor 50 tolerance^-1/6 in front of it is where
    the order of reference and random strips was smallest for 1e-3..1e-6 (measured; flat within a factor 3).
    """
    x = np.column_stack([static(b) for b in ports.T])
    gain = np.einsum("ij,ij->j", ports, x)
    if np.any(gain <= 0):
        raise checks.InputError(f"the static gain {gain.min():g} K/W is not positive; is -A positive definite?")
    if M.diagonal().min() <= 0:
        raise checks.InputError("E is not positive definite; every heat capacity must be positive")
    lumped = ports / M.diagonal()[:, None]
    slope = np.einsum("ij,ij->j", ports, lumped) ** 2 / np.einsum("ij,ij->j", lumped, M @ lumped)
    fastest = 50 * tolerance ** (-1 / 6) * float(np.max(slope / gain))
    v = x.sum(axis=1)
    for _ in range(4):  # inverse iteration; its Rayleigh quotient is above the slowest rate by a few percent at most
        v = v / np.linalg.norm(v)
        w = static(M @ v)
        slowest, v = float(v @ (M @ w)) / float(w @ (M @ w)), w
    if slowest <= 0:
        raise checks.InputError(f"-A is not positive definite (a mode grows at {-slowest:g} 1/s); is a boundary held?")
    low = min(30 * slowest, fastest / 10)
    return np.concatenate([[0.0], np.geomspace(low, fastest, max(3, round(np.log10(fastest / low))))])


def _scale(projection: Projection, pairs: tuple[Indices, Indices]) -> Array:
    """Static gain of each channel; a channel between parts that hardly feel each other counts as 1e-6 of their own."""
    gain, (a, b) = projection.gain, pairs
    return np.maximum(np.abs(gain[a, b]), 1e-6 * np.sqrt(gain[a, a] * gain[b, b]))


def _model(
    system: StateSpace, projection: Projection, modes: Array, heated: Indices, read: Indices
) -> tuple[Foster | StateSpace, Array]:
    """The reduced model, and the basis that takes its states to those of the full system."""
    rate, B, C = projection.rate[::-1], projection.ports[::-1, heated], projection.ports[::-1, read].T
    names = {"inputs": system.inputs, "outputs": system.outputs}
    if heated.size == 1 and read.size == 1:
        return Foster(R=C[0] * B[:, 0] / rate, tau=1 / rate, **names), modes[:, ::-1] / C[0]
    return StateSpace(np.eye(rate.size), -np.diag(rate), B, C, **names), modes[:, ::-1]


def _parts(system: StateSpace) -> tuple[Any, Any, Array, Indices, Indices]:
    """K, M, the different columns among B and C^T, and which of them each input and output is."""
    from scipy.sparse import csr_matrix

    K, M = -csr_matrix(system.A), csr_matrix(system.E)
    for name, matrix in (("E", M), ("A", K)):
        checks.symmetric(name, matrix, hint="this reduction and its bound need the matrices of heat flow")
    ports: list[Array] = []
    where: list[int] = []
    for column in (*np.asarray(system.B, dtype=float).T, *np.asarray(system.C, dtype=float)):
        if not np.any(column):
            raise checks.InputError("an input or output of the system is zero everywhere; is its part in the mesh?")
        same = [i for i, port in enumerate(ports) if np.array_equal(port, column)]
        if not same:
            ports.append(column)
        where.append(same[0] if same else len(ports) - 1)
    split = len(system.inputs)
    return K, M, np.column_stack(ports), np.array(where[:split], dtype=np.intp), np.array(where[split:], dtype=np.intp)
