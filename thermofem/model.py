"""A thermal model is data: absorbed power in (W), mode-averaged temperature rise out (K).

Contract of a `ThermalModel` (whatever satisfies it drives the optics, trains, is validated and drawn):

1. ``model.inputs`` and ``model.outputs`` name the heated parts and the read ones.
2. ``model.thermal_resistance`` is the static gain R_th in K/W (at small power, where the model is not linear).
3. ``model.step_response(times)`` is the rise per watt after a step at t = 0, in K/W, shape of ``times``.
4. ``model.impedance(frequency)`` is the complex thermal impedance Z(f) in K/W, shape of ``frequency`` in Hz.
5. ``model.response(wave, times)`` is the rise in K under ``wave`` switched on at t = 0 from rest, shape of ``times``.
6. ``model.periodic_response(wave, samples)`` is one period of the periodic state in K, at
   `waveforms.period_times(wave, samples)`.

Adding a model: write a function that returns one of these kinds, and add it to the list in tests/models.py.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import checks, waveforms

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix

    from .transient.modal import Modal

Array = NDArray[np.float64]


class ThermalModel(Protocol):
    """Power in, temperature rise out; the numbered contract stands in the module's docstring."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the heated parts."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the read parts."""

    @property
    def thermal_resistance(self) -> float:
        """Static gain R_th in K/W."""

    def step_response(self, times: ArrayLike) -> Array:
        """Rise in K/W after a unit step."""

    def impedance(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Z(f) in K/W."""

    def response(self, wave: waveforms.Waveform, times: ArrayLike) -> Array:
        """Rise in K from rest."""

    def periodic_response(self, wave: waveforms.Waveform, samples: int) -> Array:
        """One period of the periodic state in K."""


@dataclass(frozen=True, eq=False)
class Foster:
    """Foster network: thermal resistances R_i in series, each with its own time constant.

        Z(s) = sum_i R_i / (1 + s tau_i),    dx_i/dt = (R_i P - x_i) / tau_i,    dT = sum_i x_i

    The canonical small form of every linear thermal model. A negative R_i is allowed (a fit may give one) but then the
    network is not passive, which ``passive`` tells.

    Parameters
    ----------
    R : array, shape (n,), K/W
    tau : array, shape (n,), s
        kept in increasing order, each with its R.

    Raises
    ------
    InputError
        a time constant that is not positive, lengths that differ, or numbers that are not finite.

    >>> Foster(R=[2000.0, 5000.0], tau=[50e-9, 1e-6]).thermal_resistance
    7000.0
    """

    R: ArrayLike
    tau: ArrayLike
    inputs: tuple[str, ...] = ("core",)
    outputs: tuple[str, ...] = ("core",)

    def __post_init__(self) -> None:
        R, tau = checks.array("R", self.R), checks.array("tau", self.tau)
        if R.size != tau.size:
            raise checks.InputError(f"R has {R.size} entries and tau {tau.size}; each pole needs one of both")
        if np.any(tau <= 0):
            raise checks.InputError(f"tau = {tau.min():g} s must be positive; a negative one grows without bound")
        order = np.argsort(tau)
        object.__setattr__(self, "R", R[order])
        object.__setattr__(self, "tau", tau[order])

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        from .display import model_card

        return model_card(self)

    @property
    def order(self) -> int:
        """Number of poles."""
        return int(np.size(self.R))

    @property
    def passive(self) -> bool:
        """Whether every R_i >= 0, so that no waveform can draw heat from nothing."""
        return bool(np.all(np.asarray(self.R) >= 0))

    @property
    def thermal_resistance(self) -> float:
        """R_th = sum_i R_i in K/W."""
        return float(np.sum(self.R))

    def step_response(self, times: ArrayLike) -> Array:
        """sum_i R_i (1 - exp(-t/tau_i)) in K/W; zero before t = 0."""
        t = np.maximum(checks.numbers("times", times), 0)[..., None]
        return -np.expm1(-t / self.tau) @ np.asarray(self.R)

    def impedance(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """sum_i R_i / (1 + 2 pi i f tau_i) in K/W."""
        f = checks.numbers("frequency", frequency)[..., None]
        return np.asarray((np.asarray(self.R) / (1 + 2j * np.pi * f * np.asarray(self.tau))).sum(axis=-1))

    @property
    def gain(self) -> Array:
        """R_i / tau_i in K/J: the initial slope that each pole adds per watt."""
        return np.asarray(self.R) / np.asarray(self.tau)

    def response(self, wave: waveforms.Waveform, times: ArrayLike) -> Array:
        """Rise in K under a piecewise-linear waveform from rest at t = 0, in closed form."""
        return (pole_responses(1 / np.asarray(self.tau), wave, times) @ self.gain).reshape(np.shape(times))

    def periodic_response(self, wave: waveforms.Waveform, samples: int) -> Array:
        """One period of the periodic state in K, in closed form."""
        times = waveforms.period_times(wave, samples)
        return pole_responses(1 / np.asarray(self.tau), wave, times, periodic=True) @ self.gain


def pole_responses(rate: Array, wave: waveforms.Waveform, times: ArrayLike, *, periodic: bool = False) -> Array:
    """Answers of poles dx/dt = -rate x + P(t) to a piecewise-linear waveform, in closed form.

    From rest at t = 0, or in the periodic state, where x(0) = x_cold(T) / (1 - exp(-rate T)).

    Parameters
    ----------
    rate : array, shape (n,), 1/s
    wave : Waveform
    times : array, shape (m,), s
        not negative; within one period when ``periodic``.

    Returns
    -------
    array, shape (m, n), J

    Raises
    ------
    InputError
        a negative or non-finite time, or a waveform that is not piecewise linear.
    """
    t = checks.array("times", times)
    if t.min() < 0:
        raise checks.InputError(f"times = {t.min():g} s lies before the start at t = 0")
    stop = wave.period if periodic and wave.period else max(float(t.max()), np.finfo(float).tiny)
    edges, after, before = waveforms.linear_pieces(wave, 0.0, stop)
    length = edges[1:] - edges[:-1]
    slope, settled = (before - after) / length, np.divide.outer(after, rate)
    ramps = slope.any()
    # from an edge on x(u) = x(0) + (x(0) - P/rate) (exp(-rate u) - 1), and a ramp's share
    fall = np.expm1(np.multiply.outer(length, -rate))
    gained = -settled * fall
    if ramps:
        gained += slope[:, None] * _phi2(rate, length[:, None])
    at_edges = np.zeros((edges.size, rate.size))
    for k in range(after.size):
        at_edges[k + 1] = at_edges[k] * (1 + fall[k]) + gained[k]
    if periodic:
        at_edges += np.exp(np.multiply.outer(edges, -rate)) * (at_edges[-1] / -np.expm1(-rate * edges[-1]))
    start = at_edges[:-1]
    piece = edges[1:-1].searchsorted(t, side="right")
    u = t - edges.take(piece)
    result = np.expm1(np.multiply.outer(-rate, u))  # poles first: long inner loops
    result *= (start - settled).T.take(piece, axis=1)
    result += start.T.take(piece, axis=1)
    if ramps:
        result += slope.take(piece) * _phi2(rate[:, None], u)
    return result.T


def _phi2(rate: Array, u: Array) -> Array:
    """Integral of v exp(-rate (u - v)): the answer of one pole to a ramp; a series where the difference cancels."""
    z = rate * u
    series = u * u * (0.5 - z / 6 + z * z / 24 - z**3 / 120)
    return np.where(z < 1e-3, series, (u + np.expm1(-z) / rate) / rate)


@dataclass(frozen=True, eq=False)
class StateSpace:
    """Linear thermal model E dx/dt = A x + B P, dT = C x: sparse for the FEM, small for a reduction.

    ``E`` and ``-A`` are symmetric positive definite for every heat problem, and where input and output are the same
    part ``C = B^T``; the system is then passive and equal to a Foster network with as many poles as states.

    Parameters
    ----------
    E, A : sparse matrix or array, shape (n, n); J/K and W/K
    B : array, shape (n, inputs)
    C : array, shape (outputs, n)
    inputs, outputs : tuple of str
    """

    E: Any
    A: Any
    B: Array
    C: Array
    inputs: tuple[str, ...] = ("core",)
    outputs: tuple[str, ...] = ("core",)

    def __post_init__(self) -> None:
        for name in ("E", "A", "B", "C"):
            matrix = getattr(self, name)
            checks.has(name, matrix, "shape", "dtype", hint="an array or a sparse matrix is needed")
            if 0 in matrix.shape or not np.isfinite(matrix.sum()):
                raise checks.InputError(f"{name} of shape {matrix.shape} is empty or holds what is not finite")
        n = self.A.shape[0]
        shapes = {"E": (n, n), "A": (n, n), "B": (n, len(self.inputs)), "C": (len(self.outputs), n)}
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise checks.InputError(f"{name} has shape {getattr(self, name).shape}; {shape} is needed")

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        from .display import model_card

        return model_card(self)

    def __getstate__(self) -> dict[str, Any]:
        """The fields alone: what is kept between runs stays in this process."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    def order(self) -> int:
        """Number of states."""
        return int(self.A.shape[0])

    def channel(self, heated: str | None = None, read: str | None = None) -> StateSpace:
        """The same system with one input and one output (default: the first of each)."""
        i = self.inputs.index(checks.choice("heated", heated or self.inputs[0], self.inputs))
        j = self.outputs.index(checks.choice("read", read or self.outputs[0], self.outputs))
        return StateSpace(
            self.E, self.A, self.B[:, [i]], self.C[[j]], inputs=(self.inputs[i],), outputs=(self.outputs[j],)
        )

    @cached_property
    def gain(self) -> Array:
        """Static gain -C A^-1 B in K/W, shape (outputs, inputs)."""
        from .factor import factorize

        solve = factorize(-self._sparse("A"))
        return np.asarray(self.C @ np.column_stack([solve(column) for column in self.B.T]))

    @property
    def thermal_resistance(self) -> float:
        """R_th of the only channel in K/W; InputError when there are several (take ``gain`` or ``channel``)."""
        check_single(self)
        return float(self.gain[0, 0])

    @cached_property
    def _modal(self) -> Modal:
        """Transients in closed form; InputError where E or A is not symmetric."""
        from .transient.krylov import check_heat_flow
        from .transient.modal import Modal

        check_heat_flow(self)
        return Modal(self)

    def step_response(self, times: ArrayLike, *, rtol: float = 1e-5) -> Array:
        """Rise in K/W after a unit step, see `response`."""
        milliwatt = 1e-3
        return self.response(waveforms.Constant(milliwatt), times, rtol=rtol) / milliwatt

    def impedance(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """C (i w E - A)^-1 B in K/W, one complex factorization a frequency."""
        from scipy.sparse.linalg import splu

        check_single(self)
        E, A = self._sparse("E"), self._sparse("A")
        f = np.atleast_1d(checks.numbers("frequency", frequency))
        z = [
            (self.C[0] @ splu((2j * np.pi * w) * E - A, permc_spec="MMD_AT_PLUS_A").solve(self.B[:, 0] + 0j)) for w in f
        ]
        return np.asarray(z, dtype=complex).reshape(np.shape(frequency))

    def response(self, wave: waveforms.Waveform, times: ArrayLike, *, rtol: float = 1e-5) -> Array:
        """Rise in K from rest: in closed form (`transient.modal`) where the power is straight, else stepped.

        ``rtol`` is as of `transient.integrate`.
        """
        from .transient.integration import integrate

        check_single(self)
        run = self._modal.run(self.C, wave, times, rtol=rtol) or integrate(self, wave, times, rtol=rtol)
        return run.outputs[:, 0].reshape(np.shape(times))

    def periodic_response(self, wave: waveforms.Waveform, samples: int, *, rtol: float = 1e-5) -> Array:
        """One period of the periodic state in K, at `waveforms.period_times`, as `response`."""
        from .transient.integration import integrate_periodic

        check_single(self)
        times = waveforms.period_times(wave, samples)
        run = self._modal.run(self.C, wave, times, rtol=rtol, periodic=True)
        return (run or integrate_periodic(self, wave, samples, rtol=rtol)).outputs[:, 0]

    def _sparse(self, name: str) -> csc_matrix:
        from scipy.sparse import csc_matrix

        return csc_matrix(getattr(self, name))


def check_single(system: StateSpace) -> None:
    """Raise InputError unless the system has one input and one output."""
    if (len(system.inputs), len(system.outputs)) != (1, 1):
        raise checks.InputError(
            f"inputs {system.inputs} and outputs {system.outputs}: pick one of each with .channel(heated, read)"
        )


def foster(system: StateSpace) -> Foster:
    """Diagonalise a small symmetric StateSpace: A v = -lambda E v, R_i = (C v_i)(v_i B)/lambda_i.

    Raises
    ------
    InputError
        more than 2000 states (reduce the FEM first), several channels, matrices that are not symmetric, E not positive
        definite, or a pole that does not decay.
    """
    from scipy.linalg import LinAlgError, eigh
    from scipy.sparse import issparse

    if system.order > 2000:
        raise checks.InputError(f"a system of {system.order} states is too large to diagonalise; reduce it first")
    check_single(system)
    E, A = (m.toarray() if issparse(m) else np.asarray(m) for m in (system.E, system.A))
    for name, matrix in (("E", E), ("A", A)):  # eigh reads one triangle
        checks.symmetric(name, matrix, hint="only a symmetric system is a Foster network")
    try:
        rate, modes = eigh(-A, E)
    except LinAlgError:
        raise checks.InputError("E is not positive definite; every heat capacity must be positive") from None
    if rate[0] <= 0:
        raise checks.InputError(
            f"the slowest pole has rate {rate[0]:g} 1/s; every one must decay (is a boundary held?)"
        )
    R = (system.C[0] @ modes) * (modes.T @ system.B[:, 0]) / rate
    return Foster(R=R, tau=1 / rate, inputs=system.inputs, outputs=system.outputs)


class AtSmallPower:
    """What a model that is not linear shares with ``linear``, the one it is at small power."""

    linear: Foster | StateSpace

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the heated parts."""
        return self.linear.inputs

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the read parts."""
        return self.linear.outputs

    @property
    def order(self) -> int:
        """Number of states."""
        return self.linear.order

    @property
    def thermal_resistance(self) -> float:
        """Static gain at small power in K/W."""
        return self.linear.thermal_resistance

    def step_response(self, times: ArrayLike) -> Array:
        """Rise in K/W after a step of small power."""
        return self.linear.step_response(times)

    def impedance(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Z(f) at small power in K/W."""
        return self.linear.impedance(frequency)
