"""A linear thermal model as matrices: the FEM itself, or a reduction of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import LinAlgError, eigh
from scipy.sparse import csc_matrix, csr_matrix, issparse
from scipy.sparse.linalg import splu

from .. import checks, waveforms
from ..algebra.factor import REFUSAL, check_symmetric, factorize, singular_refused
from ..arrays import Array, ArrayLike, Complex
from ..checks import InputError
from ..data.display import model_html
from ..geometry.section_parts import AMBIENT
from ..transient.integration import integrate, integrate_periodic
from ..transient.modal import Modal
from .contract import at_times, check_single, keep_names, names, parts, reader
from .foster import Foster, check_residues

MOST_STATES = 500  # states to integrate with the optics; a certified reduction needs 10 to 40, and each costs time
SAVED = 5000  # states of a model file, where more than 500 are written as the diagonals of E and A
DEFINITE_ROUND_OFF = 1e-9  # of a matrix with ones on its diagonal, by which an eigenvalue may be negative


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
    origin : dict, optional
        where the model comes from (geometry as TOML, how it was made); exports and model files keep it.
    """

    E: Any
    A: Any
    B: Array
    C: Array
    inputs: tuple[str, ...] = ("core",)
    outputs: tuple[str, ...] = ("core",)
    origin: Mapping[str, Any] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        for name in ("E", "A", "B", "C"):
            matrix = _matrix(name, getattr(self, name), sparse=name in ("E", "A"))
            checks.keep(self, **{name: matrix})
        keep_names(self, single=False)
        n = self.A.shape[0]
        shapes = {"E": (n, n), "A": (n, n), "B": (n, len(self.inputs)), "C": (len(self.outputs), n)}
        for name, shape in shapes.items():
            checks.shape(name, getattr(self, name), shape)

    _repr_html_ = model_html

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the fields only; cached results are not copied to other processes."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    def order(self) -> int:
        """Number of states."""
        return self.A.shape[0]

    @property
    def heated(self) -> tuple[str, ...]:
        """The inputs that take power: all but "ambient", the temperature around the chip in K."""
        return tuple(name for name in self.inputs if name != AMBIENT)

    @property
    def without_ambient(self) -> StateSpace:
        """The same system under a constant ambient."""
        return self if AMBIENT not in self.inputs else self.channels(self.heated, self.outputs)

    def channel(self, heated: str | None = None, read: str | None = None) -> StateSpace:
        """The subsystem of one input and one output (default: the first of each)."""
        return self.channels((heated or self.inputs[0],), (read or self.outputs[0],))

    def channels(self, heated: Sequence[str], read: Sequence[str]) -> StateSpace:
        """The subsystem of some inputs and outputs, in this order."""
        columns = [self.inputs.index(checks.choice("heated", name, self.inputs)) for name in heated]
        rows = [self.outputs.index(checks.choice("read", name, self.outputs)) for name in read]
        return replace(self, B=self.B[:, columns], C=self.C[rows], inputs=tuple(heated), outputs=tuple(read))

    def of_rings(self, names: Sequence[str]) -> StateSpace:
        """The same system with only the outputs ``names``, in this order, whose inputs come first.

        The other shapes of a layout then are heaters. A system whose outputs have other names is returned as it is.
        """
        if not {*names} <= {*self.outputs} & {*self.inputs}:
            return self
        return self.channels((*names, *(name for name in self.inputs if name not in names)), names)

    @cached_property
    def gain(self) -> Array:
        """Static gain -C A^-1 B in K/W, shape (outputs, inputs); its solutions are refined once."""
        self._check_settles()
        K = -self._sparse("A")
        solve = factorize(K)
        states = np.column_stack([solve(column) for column in self.B.T])
        residual = self.B - K @ states
        states += np.column_stack([solve(column) for column in residual.T])
        return self.C @ states

    @property
    def thermal_resistance(self) -> float:
        """R_th of the only channel in K/W; InputError when there are several (take ``gain`` or ``channel``)."""
        check_single(self)
        return float(self.gain[0, 0])

    @cached_property
    def dynamics(self) -> Foster:
        """The system diagonalised into a Foster network, by `foster`.

        Raises InputError: more than 500 states, several channels, or a system that is not one of heat flow.
        """
        if self.order > MOST_STATES:
            raise InputError(
                f"model is a system of {self.order} states, at most {MOST_STATES} can be integrated with the optics; "
                "reduce it first (surrogate.reduce), or keep the FEM in the loop (coupled.cosimulate)"
            )
        return foster(self)

    @cached_property
    def _modal(self) -> Modal:
        """Closed-form solver of transients; InputError where E or A is not symmetric."""
        check_symmetric(E=self.E, A=self.A, hint=REFUSAL)
        return Modal(self)

    def _check_settles(self) -> None:
        """Raise InputError unless E and A are symmetric and, up to 500 states, E and -A positive definite.

        A system that grows has a transient, but no static gain and no periodic state.
        """
        check_symmetric(E=self.E, A=self.A, hint=REFUSAL)
        if self.order <= MOST_STATES:
            matrices = {"E": self._sparse("E"), "-A": -self._sparse("A")}
            for name, matrix in matrices.items():
                if not _definite(matrix.toarray()):
                    raise InputError(f"{name} is not positive definite: some mode would not decay", REFUSAL)

    def step_response(self, times: ArrayLike, *, rtol: float = 1e-5) -> Array:
        """Rise in K/W after a unit step, see `response`; zero before t = 0."""
        t = np.maximum(checks.numbers("times", times), 0)
        if not t.size:
            return t
        milliwatt = 1e-3
        return self.response(waveforms.Constant(milliwatt), t, rtol=rtol) / milliwatt

    def impedance(self, frequency: ArrayLike) -> Complex:
        """C (i w E - A)^-1 B in K/W, one complex factorization a frequency."""
        check_single(self)
        E = self._sparse("E")
        A = self._sparse("A")
        frequencies = checks.numbers("frequency", frequency)
        z = []
        with singular_refused():
            for f in frequencies.ravel():
                factor = splu((2j * np.pi * f) * E - A, permc_spec="MMD_AT_PLUS_A")
                states = factor.solve(self.B[:, 0] + 0j)
                z.append(self.C[0] @ states)
        return np.asarray(z, dtype=complex).reshape(frequencies.shape)

    def response(self, wave: waveforms.Waveform, times: ArrayLike, *, rtol: float = 1e-5) -> Array:
        """Rise in K from rest: in closed form (`transient.modal`) where the power is piecewise linear, else stepped.

        ``rtol`` is as of `transient.integrate`.
        """
        check_single(self)

        def run(t: Array) -> Array:
            waveforms.check_heating(wave, float(t.max(initial=0.0)))
            found = self._modal.run(self.C, wave, t, rtol=rtol) or integrate(self, wave, t, rtol=rtol)
            return found.outputs[:, 0]

        return at_times(run, times)

    def periodic_response(self, wave: waveforms.Waveform, samples: int, *, rtol: float = 1e-5) -> Array:
        """One period of the periodic state in K, at `waveforms.period_times`, as `response`."""
        check_single(self)
        self._check_settles()
        times = waveforms.period_times(wave, samples)
        waveforms.check_heating(wave, float(times[-1]))
        run = self._modal.run(self.C, wave, times, rtol=rtol, periodic=True)
        return (run or integrate_periodic(self, wave, samples, rtol=rtol)).outputs[:, 0]

    def _sparse(self, name: str) -> csc_matrix:
        return csc_matrix(getattr(self, name))

    def to_json(self) -> dict[str, Any]:
        """Fields of the model file; InputError for a large system or one that does not decay.

        Matrices are written in full; in a system of more than 500 states a diagonal E or A as its diagonal.
        """
        full = {name: self._sparse(name) for name in ("E", "A", "B", "C")}
        if self.order > MOST_STATES:
            diagonal = all(full[name].nnz == np.count_nonzero(full[name].diagonal()) for name in ("E", "A"))
            if not diagonal or self.order > SAVED:
                raise InputError(
                    f"a StateSpace of {self.order} states is too large for a file, which takes {MOST_STATES}, or "
                    f"{SAVED} with diagonal E and A, as of arrays",
                    "reduce finite elements (surrogate.reduce); of an array take fewer rings or a larger tolerance",
                )
        tables = {name: matrix.toarray() for name, matrix in full.items()}
        self.check_passive()
        if self.order > MOST_STATES:
            tables |= {name: full[name].diagonal() for name in ("E", "A")}
        units = {"E": "J/K", "A": "W/K", "B": "1", "C": "1"}
        return {**names(self), **{name: matrix.tolist() for name, matrix in tables.items()}, "units": units}

    @classmethod
    @reader
    def from_json(cls, content: Mapping[str, Any]) -> StateSpace:
        """The system that the content of a model file describes."""
        E = _square(content, "E")
        A = _square(content, "A")
        model = cls(E, A, content["B"], content["C"], **parts(content))
        model.check_passive()
        return model

    def check_passive(self) -> None:
        """Raise InputError where a mode does not decay, or a pole cools a part that is heated and read."""
        if self.order > MOST_STATES:  # of a file: both are diagonal
            capacity = self._sparse("E").diagonal()
            rate = -self._sparse("A").diagonal()
            B = self.B
            C = self.C
            smallest = min(capacity.min(), rate.min())
            checks.positive("smallest entry of E and -A", smallest)
        else:
            rate, modes = eigenmodes(self)
            B = modes.T @ self.B
            C = self.C @ modes
        for i, part in enumerate(self.inputs):
            if part in self.outputs:
                j = self.outputs.index(part)
                check_residues(C[j] * B[:, i] / rate, round_off=DEFINITE_ROUND_OFF)


def _square(content: Mapping[str, Any], name: str) -> Array:
    """Matrix E or A from a model file, which holds it in full or as its diagonal."""
    matrix = checks.numbers(name, content[name])
    checks.integer(f"states of {name}", len(matrix), 1, SAVED)
    return np.diag(matrix) if matrix.ndim == 1 else matrix


def _matrix(name: str, value: Any, *, sparse: bool) -> Any:
    """Copy of a matrix as real floats: dense, or where ``sparse`` a sparse one in CSC or CSR form."""
    if not issparse(value):
        return checks.numbers(name, value)
    checks.numbers(name, value.tocoo().data)
    if not sparse:
        return value.toarray().astype(float)
    kind = csr_matrix if value.format == "csr" else csc_matrix
    return kind(value, dtype=float, copy=True)


def _definite(matrix: Array) -> bool:
    """Whether a symmetric matrix is positive semidefinite, up to 1e-9 after scaling its diagonal to 1."""
    diagonal = np.diagonal(matrix)
    if (diagonal <= 0).any():
        return False
    length = np.sqrt(diagonal)
    smallest = np.linalg.eigvalsh(matrix / length / length[:, None])[0]
    return bool(smallest > -DEFINITE_ROUND_OFF)


def has_ports(model: Any) -> bool:
    """Whether a model has several inputs or outputs, of which `StateSpace.channel` picks one each."""
    return isinstance(model, StateSpace) and (len(model.inputs), len(model.outputs)) != (1, 1)


def foster(system: StateSpace) -> Foster:
    """Diagonalise a small symmetric StateSpace: A v = -lambda E v, R_i = (C v_i)(v_i B)/lambda_i.

    Raises InputError: several channels, matrices that are not symmetric, E not positive definite, or a pole that does
        not decay.
    """
    check_single(system)
    rate, modes = eigenmodes(system)
    read = system.C[0] @ modes
    heated = modes.T @ system.B[:, 0]
    return Foster(R=read * heated / rate, tau=1 / rate, inputs=system.inputs, outputs=system.outputs)


def eigenmodes(system: StateSpace) -> tuple[Array, Array]:
    """Rates in 1/s, rising, and E-orthonormal modes of a small system: A v = -rate E v.

    Raises InputError: matrices that are not symmetric, E not positive definite, or a mode that does not decay.
    """
    E = system.E.toarray() if issparse(system.E) else system.E
    A = system.A.toarray() if issparse(system.A) else system.A
    check_symmetric(E=E, A=A, hint="only a symmetric system is a Foster network")
    try:
        rate, modes = eigh(-A, E)
    except LinAlgError:
        raise InputError("E is not positive definite; every heat capacity must be positive") from None
    checks.positive("rate of the slowest pole", rate[0], unit="1/s", hint="every pole must decay: is a boundary held?")
    return rate, modes
