"""Compact models of heat flow with k(T) and c_p(T): quadratic Galerkin reduction, and the static output map.

The full system d/dt H(x) = -F(x) + b P of `thermofem.transient.nonlinear` is projected on the basis V of the certified
linear reduction, x = V z, with every law replaced by its second-order chord,

    g_l(x) = x + beta_l x^2,     c_l(x) = 1 / (1 - gamma_l x),

so that with m[z] = sum_l gamma_l V^T M_l diag(V z) V and Q[z, z] = sum_l beta_l V^T K_l (V z)^2

    dz/dt = (1 - m[z]) (-L z + b P) - Q[z, z] + s m[zbar] Q[z, z],      dT = c^T V z.

What the first order in m leaves out is the cubic m[z] Q[z, z], which keeps steady states where they are; the last term
stands for it, with the steady state zbar in place of one factor. beta and gamma are those of the steady field at the
power asked for, weighted with the adjoint of the read-out; with data they and s are fitted.

Sources: B. Kramer, K. Willcox, AIAA J. 57, 2297 (2019) (quadratic form of laws, Galerkin); R. Becker, R. Rannacher,
Acta Numer. 10, 1 (2001) (adjoint weights); G. Kirchhoff, Vorlesungen ueber die Theorie der Waerme (1894) (output map).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from thermofem import Foster, OutputMap, Quadratic, checks
from thermofem.dataset import Drive, drive_of
from thermofem.factor import factorize
from thermofem.materials.laws import Law
from thermofem.model import pole_responses
from thermofem.transient.nonlinear import Lift, NonlinearSystem

from .reduce import Reduction, reduce

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

CUBIC = 0.8  # s without data: between 1 (exact steady state at full power) and 0 (exact small-signal limit)
PRIOR = 3e-5  # weight of the chords' own coefficients in a fit, relative to the peak: data that see one outweigh it
EVALUATIONS = 8
_POWER_HINT = "powers are in W (did you mean 2e-3 for 2 mW?)"


@dataclass(frozen=True, eq=False)
class QuadraticReduction:
    """A quadratic reduced model, and where it holds.

    Attributes
    ----------
    model : Quadratic
    linear : Reduction
        the certified reduction at small power whose basis it uses.
    power : float, W
        largest that it is made for.
    static_error : float
        of its steady rise at ``power``, relative, against the full order.
    residual : float, K
        rms against the data it was fitted to; nan without data.
    basis : array, shape (states of the full system, order)
        full state = basis @ state of the model.
    """

    model: Quadratic
    linear: Reduction
    power: float
    static_error: float
    residual: float
    basis: Array

    @property
    def order(self) -> int:
        """Number of states."""
        return self.model.order

    @property
    def provenance(self) -> dict[str, Any]:
        """What `surrogate.save_model` keeps beside the model."""
        return {
            "method": "quadratic Galerkin reduction",
            "power_W": self.power,
            "static_error": self.static_error,
            "residual_K": None if np.isnan(self.residual) else self.residual,
        }


def reduce_quadratic(
    system: NonlinearSystem,
    power: float,
    *,
    data: xr.Dataset | Sequence[xr.Dataset] = (),
    tolerance: float = 1e-4,
) -> QuadraticReduction:
    """Reduce heat flow with k(T) and c_p(T) to a small quadratic system.

    Parameters
    ----------
    system : NonlinearSystem
        ``heat.model("core", "core")`` of a geometry whose materials have laws of temperature; one input, one output.
    power : float, W
        largest constant power that the model is made for.
    data : Dataset or list of them
        transients from rest of the full order; the coefficients of the laws are fitted to them. Worth it where c_p
        depends on temperature.
    tolerance : float
        of the linear reduction.

    Returns
    -------
    QuadraticReduction
        measured on the reference strip at 20 mW, 147 K, worst and mean error over the peak rise, on a step, half of
        it, a 20 us pulse, a telegraph and a 1 us square wave: k(T) alone (Si T^-1.3, oxide T^0.3) 1.3e-3 and 5e-4;
        with c_p(T) (oxide T^0.5) 1.5e-3 and 4e-4, fitted to the pulse and half of the step 8e-4 and 2e-4; the library's
        Si(T) and SiO2(T), whose laws are far from parabolas, 5e-3 and 2e-3, fitted 4e-4 and 2e-4 on steps and pulse,
        3.3e-3 and 1.3e-3 on the others. The linear model is off by 7e-2.

    Raises
    ------
    InputError
        a system that is linear, has several channels, a power without a steady state, data of another kind.
    """
    _check(system)
    power = checks.positive("power", power, unit="W", at_most=10, hint=_POWER_HINT)
    steady = system.steady_state(power)
    rom = reduce(system.linear, tolerance)
    terms = _Terms.of(system, _modes(system, rom.basis), steady)
    weights, residual = terms.start, float("nan")
    drives = _drives(data)
    if drives:
        weights, residual = _fit(terms, drives)
    largest = float(system.linear.C[0] @ steady)
    model = terms.model(weights, largest_rise=largest)
    error = abs(float(model.steady_rise(power)) / largest - 1)
    return QuadraticReduction(model, rom, power, error, residual, terms.basis)


def output_map(system: NonlinearSystem, power: float, *, linear: Foster | None = None) -> OutputMap:
    """Linear dynamics with the static map dT = z + coefficient z^2 of two nonlinear steady solutions.

    Parameters
    ----------
    system : NonlinearSystem
        ``heat.model("core", "core")``; one input, one output.
    power : float, W
        the largest of interest; the map is the least-squares one for it and half of it.
    linear : Foster
        default the certified reduction at 1e-4.

    Returns
    -------
    OutputMap
        measured as in `reduce_quadratic`: worst error 0.9 to 1.2 % of the peak rise, mean 0.1 to 0.5 %.

    Raises
    ------
    InputError
        a system that is linear or has several channels, a power without a steady state.
    """
    _check(system)
    power = checks.positive("power", power, unit="W", at_most=10, hint=_POWER_HINT)
    if linear is None:
        linear = reduce(system.linear, 1e-4).model  # type: ignore[assignment]  # one channel: a Foster network
    powers = np.array([power / 2, power])
    z = system.thermal_resistance * powers
    rise = np.array([float(system.steady_rise(p)[0]) for p in powers])
    coefficient = (rise - z) @ z**2 / (z**2 @ z**2)
    return OutputMap(linear, float(coefficient), largest_rise=float(rise[-1]))  # type: ignore[arg-type]


def fit_output_map(linear: Foster, data: xr.Dataset | Sequence[xr.Dataset]) -> OutputMap:
    """The static map of the output, dT = z + coefficient z^2, that fits data best; the linear model is kept.

    Parameters
    ----------
    linear : Foster
        at small power, as of `reduce` or a fit to a weak drive.
    data : Dataset or list of them
        with rises large enough to show the nonlinearity.

    Raises
    ------
    InputError
        data without power or rise.
    """
    drives = _drives(data)
    if not drives:
        raise checks.InputError("data is empty; give at least one Dataset")
    z = np.concatenate([_linear_answer(linear, d) for d in drives])
    rise = np.concatenate([d.rise for d in drives])
    return OutputMap(linear, float((rise - z) @ z**2 / (z**2 @ z**2)), largest_rise=float(rise.max()))


def _check(system: NonlinearSystem) -> None:
    if not isinstance(system, NonlinearSystem):
        raise checks.InputError(
            f"a {type(system).__name__} has no laws of temperature; give heat.model(heated, read) of a geometry whose "
            "materials have some, or take surrogate.reduce"
        )
    if (len(system.inputs), len(system.outputs)) != (1, 1):
        raise checks.InputError(f"inputs {system.inputs} and outputs {system.outputs}: give heat.model(heated, read)")


def _drives(data: xr.Dataset | Sequence[xr.Dataset]) -> list[Drive]:
    return [drive_of(d) for d in (data if isinstance(data, Sequence) else [data])]


def _linear_answer(linear: Foster, drive: Drive) -> Array:
    return pole_responses(1 / np.asarray(linear.tau), drive.wave, drive.times, periodic=drive.periodic) @ linear.gain


def _modes(fem: NonlinearSystem, basis: Array) -> tuple[Array, Array]:
    """Rates, and the basis of M-orthonormal modes that it spans."""
    from scipy.linalg import eigh

    basis = basis / np.linalg.norm(basis, axis=0)
    rate, Z = eigh(-basis.T @ (fem.linear.A @ basis), basis.T @ (fem.linear.E @ basis))
    return rate, basis @ Z


def _operators(lift: Lift) -> Iterator[tuple[Law, Any, Any]]:
    """Every law with its nodes and its part of the matrix."""
    start = lift.matrix.shape[1] - sum(at.size for _, at in lift.laws)
    for law, at in lift.laws:
        yield law, at, lift.matrix[:, start : start + at.size]
        start += at.size


@dataclass(frozen=True, eq=False)
class _Terms:
    """The quadratic terms of a reduced system, each to be multiplied by a weight.

    Attributes
    ----------
    rate : array, shape (n,); the linear part
    H, G : list of array
        terms of H and of G.
    start : array
        their weights from the steady field: first those of H, then those of G.
    """

    rate: Array
    basis: Array
    b: Array
    c: Array
    H: list[Array]
    G: list[Array]
    start: Array
    names: tuple[tuple[str, ...], tuple[str, ...]]

    @classmethod
    def of(cls, fem: NonlinearSystem, modes: tuple[Array, Array], steady: Array) -> _Terms:
        """Project every law, with the chord that the steady field sees."""
        rate, V = modes
        T0, b = fem.flow.ambient, V.T @ fem.linear.B[:, 0]
        adjoint = factorize(-fem.linear.A.tocsc())(fem.linear.C[0])
        H, beta = [], []
        for law, at, block in _operators(fem.flow):
            x, weight = steady[at], block.T @ adjoint
            beta.append(weight @ (law.integral(T0, x) / law.factor(T0) - x) / (weight @ (x * x)))
            H.append(-_cubic_form(block.T @ V, V[at], V[at]))
        G, gamma, frozen = [], [], np.zeros((rate.size, rate.size))
        z = V.T @ (fem.linear.E @ steady)
        for law, at, block in _operators(fem.content):
            x, weight = steady[at], block.T @ adjoint
            gamma.append(weight @ ((1 - law.factor(T0) / law.factor(T0 + x)) * x) / (weight @ (x * x)))
            m = _cubic_form(block.T @ V, V[at], V[at])
            inflow = m * rate
            H.append((inflow + inflow.transpose(0, 2, 1)) / 2)
            G.append(-(m @ b))
            frozen += gamma[-1] * (m @ z)
        chords = [*beta, *gamma]
        if gamma and beta:
            H.append(-np.einsum("ij,jkl->ikl", frozen, sum(w * h for w, h in zip(beta, H, strict=False))))
            chords.append(CUBIC)
        names = fem.inputs, fem.outputs
        return cls(rate, V, b, V.T @ fem.linear.C[0], H, G, np.array([*chords, *gamma]), names)

    def model(self, weights: Array, *, largest_rise: float | None = None) -> Quadratic:
        """The system with these weights of its terms."""
        n = self.rate.size
        H = sum((w * h for w, h in zip(weights, self.H, strict=False)), np.zeros((n, n, n)))
        G = sum((w * g for w, g in zip(weights[len(self.H) :], self.G, strict=True)), np.zeros((n, n)))
        inputs, outputs = self.names
        return Quadratic(-np.diag(self.rate), H, G, self.b, self.c, inputs, outputs, largest_rise)


def _cubic_form(left: Array, first: Array, second: Array) -> Array:
    """sum over nodes of left_i first_j second_k, shape (n, n, n)."""
    return np.stack([left.T @ (first[:, [j]] * second) for j in range(first.shape[1])], axis=1)


def _fit(terms: _Terms, drives: Sequence[Drive]) -> tuple[Array, float]:
    """Weights that fit data best, and the rms misfit in K."""
    from scipy.optimize import least_squares

    if any(d.periodic for d in drives):
        raise checks.InputError("data holds a periodic state; reduce_quadratic is fitted to transients from rest")
    used = np.abs(terms.start) > 0
    scale = np.concatenate([np.full(d.rise.size, 1 / d.rise.max()) for d in drives])
    rise = np.concatenate([d.rise for d in drives])

    def misfit(share: Array) -> Array:
        weights = terms.start.copy()
        weights[used] *= share
        model = terms.model(weights)
        return np.concatenate([model.response(d.wave, d.times) for d in drives]) - rise

    def goal(share: Array) -> Array:
        return np.append(misfit(share) * scale, PRIOR * np.sqrt(rise.size) * (share - 1))

    found = least_squares(goal, np.ones(int(used.sum())), diff_step=1e-3, max_nfev=EVALUATIONS)
    weights = terms.start.copy()
    weights[used] *= found.x
    return weights, float(np.sqrt(np.mean(misfit(found.x) ** 2)))
