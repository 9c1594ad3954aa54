"""Certified reduction of a heat problem to a few poles by rational Krylov projection.

The basis V collects (K + s_j M)^-1 R for a few real shifts, s = 0 first and the others in turn, R being what the basis
so far leaves of the heat vectors. As the system is symmetric, so is the reduction: every pole decays, every R_i of a
heated part is positive, and as s = 0 is a shift R_th is exact. For real s >= 0 it approaches H(s) from below.

Sources: A. Ruhe, Linear Algebra Appl. 58, 391 (1984) (rational Krylov); A. C. Antoulas, Approximation of Large-Scale
Dynamical Systems (SIAM, 2005), ch. 11. The bound is derived in `surrogate.reduction.certified_space`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import xarray as xr
from scipy.sparse import csr_matrix

from thermofem import Foster, StateSpace, checks
from thermofem.algebra.factor import check_symmetric
from thermofem.arrays import Array, ArrayLike
from thermofem.fem import HeatProblem
from thermofem.fem.heat_derivatives import ModalDerivative, project as on_modes, tangents_of
from thermofem.models import HasModel

from .certified_space import Certificate, CertifiedSpace, Indices, Projection, certify, certify_defect, leftover

MOST_COLUMNS = 300  # columns of the basis before a tolerance counts as out of reach
PROMISING = 10.0  # the full certificate is worked out once one shift alone comes this near to the tolerance


@dataclass(frozen=True, eq=False)
class Reduction(HasModel):
    """A reduced model and the proof of its accuracy.

    Attributes
    ----------
    model : Foster, or a small StateSpace where there are several inputs or outputs
    error_bound : float
        |H - H_r| / H(0) of the worst channel. With one port (input and output the same) it is not exceeded at any
        frequency from 0 to infinity, by proof; with several it is a bound at each of ``frequency`` and sampled between,
        60 to a decade, with no proof.
    channel_bounds : array, shape (outputs, inputs)
        the same for each channel, relative to its own static gain (at least 1e-6 of its parts' own, see `reduce`).
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

    def _repr_html_(self) -> str:
        """HTML for notebooks."""
        from thermofem.data.display import card

        bound = f"below {self.error_bound:.1e} of R_th at every frequency"
        rows = [("error", bound), ("solves", str(self.solves))]
        return card("Reduction", rows, self.model._repr_html_())

    @property
    def provenance(self) -> dict[str, Any]:
        """Provenance that `surrogate.save_model` writes with the model."""
        names = {*self.model.inputs, *self.model.outputs}
        return {
            **(self.model.origin or {}),
            "method": "rational Krylov reduction",
            "tolerance": self.tolerance,
            "error_bound": self.error_bound,
            "shifts": self.shifts.tolist(),
            "ports": sorted(names),  # of one the bound is proven, see `Reduction`
        }

    def lift(self, states: ArrayLike) -> Array:
        """States of the full system, shape (..., n), from states of the model, shape (..., order).

        ``heat.field(rom.lift(states))`` is the temperature field on the mesh.
        """
        return np.asarray(states) @ self.basis.T


def reduce(system: StateSpace, tolerance: float = 1e-4) -> Reduction:
    """Reduce a symmetric thermal system until its error is provably below ``tolerance`` at every frequency.

        |H(2 pi i f) - H_r(2 pi i f)| <= tolerance H(0)      for 0 <= f < infinity, for every channel

    Parameters
    ----------
    system : StateSpace
        E and -A symmetric positive definite, as of every heat problem; any number of inputs and outputs.
    tolerance : float
        relative to the static gain of each channel, or to 1e-6 of the geometric mean of its two parts' own gains where
        that is larger (parts that hardly feel each other); 1e-7..0.1.

    Returns
    -------
    Reduction
        measured on the reference strip (6253 unknowns): order 10 / 14 / 18 / 26 for 1e-3 / 1e-4 / 1e-5 / 1e-6; the
        bound is at most three times the true error where that is largest.

    Raises
    ------
    InputError
        a model of another kind, matrices that are not symmetric or not definite, or a tolerance out of reach.

    >>> rom = reduce(assemble(strip_ring()).system, tolerance=1e-4)
    >>> rom.error_bound < 1e-4
    True
    """
    projected = project(system, tolerance)
    certificate = projected.certificate
    shape = (projected.read.size, projected.heated.size)
    scale = _scale(projected.projection, projected.pairs)
    model, basis = _model(system, projected)
    of_channels = certificate.top / scale
    bound = certificate.samples / scale
    single = shape == (1, 1)
    return Reduction(
        model=replace(model, origin=system.origin),
        error_bound=float(of_channels.max()),
        channel_bounds=of_channels.reshape(shape),
        frequency=certificate.omega / (2 * np.pi),
        bound=bound[:, 0] if single else bound.reshape(-1, *shape),
        basis=basis,
        shifts=projected.shifts,
        tolerance=float(tolerance),
        solves=projected.solves,
    ).recorded()


@dataclass(frozen=True, eq=False)
class Projected:
    """Projection of a system on a certified basis, in modes, and its certificate.

    basis [shape (n, k)]: M-orthonormal modes of ``projection.rate``.
    heated, read: index of the port of each input and of each output.
    pairs: the two ports of each channel, all inputs of the first output first.
    shifts [1/s]: at which the basis was built.
    solves: number of columns solved for.
    """

    projection: Projection
    certificate: Certificate
    basis: Array
    heated: Indices
    read: Indices
    pairs: tuple[Indices, Indices]
    shifts: Array
    solves: int


def project(system: StateSpace, tolerance: float) -> Projected:
    """The certified projection that `reduce` and `balanced_truncation` begin with; raises as `reduce`."""
    hint = "the StateSpace of a heat problem is needed (heat.system); fit_foster on a step response gives fewer poles"
    checks.instance("system", system, StateSpace, hint=hint)
    tolerance = checks.between("tolerance", tolerance, 1e-7, 0.1, hint="it is relative to the static gain")
    K, M, ports, heated, read = _parts(system)
    space = CertifiedSpace(K, M, ports, tolerance)
    pairs = (np.repeat(read, heated.size), np.tile(heated, read.size))
    projection, certificate = _grow(space, pairs, tolerance)
    basis = space.V @ projection.vectors
    return Projected(projection, certificate, basis, heated, read, pairs, space.shifts, space.solves)


def _grow(space: CertifiedSpace, pairs: tuple[Indices, Indices], tolerance: float) -> tuple[Projection, Certificate]:
    """Extend the basis until its certificate meets the tolerance."""
    while space.order < MOST_COLUMNS and not space.exhausted:
        j, solution = space.solve_next()
        projection = space.projection
        scale = tolerance * _scale(projection, pairs)
        # 4: samples in a decade before the full certificate is worked out
        alone = certify(projection, space.shifts[[j]], [solution], pairs=pairs, per_decade=4)
        if np.all(alone.samples <= PROMISING * scale):
            solutions = [solution if i == j else space.solve(i) for i in range(1, space.shifts.size)]
            certificate = certify(projection, space.shifts[1:], solutions, pairs=pairs)
            if np.all(certificate.top <= scale):
                share = leftover(projection, space.defect, 1 / space.M.diagonal())
                # 1e-2: share of the residual that `certify` neglects, above which `certify_defect` is used
                if share > 1e-2:
                    break  # round-off has entered the basis
                return projection, certificate
        if not space.extend(solution):
            break
    return _grow_on(space, pairs, tolerance)


def _grow_on(space: CertifiedSpace, pairs: tuple[Indices, Indices], tolerance: float) -> tuple[Projection, Certificate]:
    """`_grow` where the remainder of the ports is lost in round-off: bounds from computed residuals and defects."""
    reached = np.inf
    idle = 0
    while True:
        error, columns = space.next_residual()
        projection = space.projection
        scale = tolerance * _scale(projection, pairs)
        done = idle >= space.growing or space.order >= MOST_COLUMNS
        if done or error <= PROMISING * scale.min():
            parts = np.column_stack([space.remainder, space.defect])
            solutions = [space.apply(j, parts) for j in range(space.shifts.size)]
            certificate = certify_defect(projection, parts, space.shifts, solutions, pairs=pairs)
            reached = np.max(certificate.top / scale) * tolerance
            if reached <= tolerance:
                return projection, certificate
        if done:
            raise checks.InputError(
                f"tolerance = {tolerance:g} is out of reach: {space.order} states leave {reached:.1e}"
            )
        idle = 0 if space.extend(columns) else idle + 1


def _scale(projection: Projection, pairs: tuple[Indices, Indices]) -> Array:
    """Reference of relative errors of each channel in K/W: its static gain, at least 1e-6 of those of its two parts."""
    a, b = pairs
    gain = projection.gain
    of_parts = np.sqrt(gain[a, a] * gain[b, b])
    return np.maximum(np.abs(gain[a, b]), 1e-6 * of_parts)


def _model(system: StateSpace, projected: Projected) -> tuple[Foster | StateSpace, Array]:
    """The reduced model, and the basis that takes its states to those of the full system."""
    rate = projected.projection.rate[::-1]
    ports = projected.projection.ports[::-1]
    B = ports[:, projected.heated]
    C = ports[:, projected.read].T
    modes = projected.basis[:, ::-1]
    names = system.inputs, system.outputs
    if B.shape[1] == C.shape[0] == 1:
        R = C[0] * B[:, 0] / rate
        return Foster(R, 1 / rate, *names), modes / C[0]
    return StateSpace(np.eye(rate.size), -np.diag(rate), B, C, *names), modes


def _parts(system: StateSpace) -> tuple[Any, Any, Array, Indices, Indices]:
    """K, M, the distinct columns of [B, C^T], and the index of the column of each input and each output."""
    K = -csr_matrix(system.A)
    M = csr_matrix(system.E)
    check_symmetric(E=M, A=K, hint="this reduction and its bound need the matrices of heat flow")
    ports: list[Array] = []
    where: list[int] = []
    for column in (*np.asarray(system.B, dtype=float).T, *np.asarray(system.C, dtype=float)):
        if not column.any():
            raise checks.InputError("an input or output of the system is zero everywhere; is its part in the mesh?")
        same = (i for i, port in enumerate(ports) if np.array_equal(port, column))
        index = next(same, len(ports))
        if index == len(ports):
            ports.append(column)
        where.append(index)
    heated, read = np.split(np.array(where, dtype=np.intp), [len(system.inputs)])
    return K, M, np.column_stack(ports), heated, read


def pole_derivatives(heat: HeatProblem, reduction: Reduction, parameters: str | Sequence[str]) -> xr.Dataset:
    """Derivatives of every R_i and tau_i of a reduction, exact for its basis.

    Parameters
    ----------
    heat : HeatProblem
        that was reduced.
    reduction : Reduction
        of ``heat.system``, or of one of its channels.
    parameters : str or sequence of str
        paths, as of `thermofem.derivatives`.

    Returns
    -------
    xarray.Dataset
        over "parameter" and "pole" (tau increasing): R (K/W per unit) and tau (s per unit), nan where a pole is not
        simple; over "parameter": thermal_resistance.

    Raises
    ------
    InputError
        a reduction with several channels, one of another problem, or a path without a derivative.
    """
    model: Any = reduction.model
    checks.instance("reduction.model", model, Foster, hint="reduce one channel, heat.channels(heated, read)")
    (heated,) = model.inputs
    (read,) = model.outputs
    d = heat.discretization
    b = d.means[heated][d.free]
    c = d.means[read][d.free]
    squares = np.einsum("nk,nk->k", reduction.basis, d.E @ reduction.basis)
    V = reduction.basis / np.sqrt(squares)
    rate = 1 / np.asarray(model.tau)
    identity = np.eye(rate.size)
    K = V.T @ (-heat.channels(heated, read).A @ V)
    off = K / np.sqrt(np.outer(rate, rate)) - identity
    # 1e-6: largest element of V^T K V, over its poles, minus 1: round-off leaves 1e-10
    if np.abs(off).max() > 1e-6:
        raise checks.InputError("the reduction is of another heat problem: its poles are not those of heat's matrices")
    changes, tangents = tangents_of(heat, parameters, (heated, read))
    slopes = on_modes(tangents, (heated, read), d.free, V)
    modal = ModalDerivative(rate, V.T @ b, V.T @ c, *slopes)
    of_R, of_tau = modal.poles()
    apart = np.abs(rate[:, None] / rate - 1) + identity
    # 1e-6: relative distance of neighbouring rates below which a pole is not simple
    double = apart.min(axis=1) < 1e-6
    of_R[:, double] = np.nan
    of_tau[:, double] = np.nan
    per_unit = "per unit of the parameter"
    of_pole = ("parameter", "pole")
    derivatives = {
        "R": (of_pole, of_R, {"units": f"K/W {per_unit}"}),
        "tau": (of_pole, of_tau, {"units": f"s {per_unit}"}),
        "thermal_resistance": ("parameter", modal.resistance(), {"units": f"K/W {per_unit}"}),
    }
    units = [change.unit for change in changes]
    return xr.Dataset(derivatives, {"parameter": [change.name for change in changes], "unit": ("parameter", units)})
