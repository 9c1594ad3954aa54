"""Thermal models that are not linear: the FEM with k(T) and c_p(T), and a small quadratic system.

The equations of the FEM are those of `thermofem.transient.nonlinear`. The quadratic system is the FEM in a small basis,
or a polynomial SINDy network.
"""

from __future__ import annotations

import warnings
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import ODEintWarning, odeint
from scipy.linalg import expm

from .. import checks, waveforms
from ..arrays import Array, ArrayLike, Complex, in_pieces
from ..checks import InputError
from ..data.display import model_html
from ..transient.integration import integrate, integrate_periodic
from ..transient.nonlinear import NonlinearEquations, factorize_general
from .contract import AtSmallPower, at_times, check_rise, check_single, keep_names, names, parts, reader, warn_beyond
from .state_space import StateSpace

RTOL = 1e-8  # of LSODA per step; 1e-6 of the largest rise accumulates over 50 us at most (measured)
PERIOD_PASSES = 40  # of the period map
_TINY = np.finfo(float).tiny


@dataclass(frozen=True, eq=False)
class Quadratic:
    """Quadratic thermal system: a reduced model with k(T) and c_p(T), or a polynomial SINDy network.

        dx/dt = A x + H[x, x] + (G x) P + B P,      dT = C x,      H[x, x]_i = sum_jk H_ijk x_j x_k

    Parameters
    ----------
    A : array, shape (n, n), 1/s
        every eigenvalue with a negative real part.
    H : array, shape (n, n, n), 1/(K s)
        its part that is symmetric in the last two indices is kept, the only one that H[x, x] knows.
    G : array, shape (n, n), 1/J
    B : array, shape (n,), K/J
    C : array, shape (n,)
    inputs, outputs : tuple of one str
    largest_rise : float, K, optional
        of the training; beyond it responses warn.
    origin : dict, optional
        where the model comes from (geometry as TOML, how it was made); exports and model files keep it.

    Raises
    ------
    InputError
        shapes that do not fit, numbers that are not finite, A not stable; a response that leaves the range in which the
        system has one (a quadratic system may diverge).
    """

    A: Array
    H: Array
    G: Array
    B: Array
    C: Array
    inputs: tuple[str, ...] = ("core",)
    outputs: tuple[str, ...] = ("core",)
    largest_rise: float | None = None
    origin: Mapping[str, Any] | None = field(default=None, repr=False)
    bent = True  # not linear
    top = np.inf  # K, as `OutputMap.top`

    def __post_init__(self) -> None:
        checks.plain(self)
        n = checks.array("B", self.B).size
        for name, shape in {"A": (n, n), "H": (n, n, n), "G": (n, n), "B": (n,), "C": (n,)}.items():
            value = checks.numbers(name, getattr(self, name))
            checks.shape(name, value, shape)
            if name == "H":
                value = (value + value.transpose(0, 2, 1)) / 2
            checks.keep(self, **{name: value})
        checks.positive("rate of the slowest pole of A", self.slowest_rate, unit="1/s", hint="every pole must decay")
        keep_names(self)
        check_rise(self.largest_rise)

    _repr_html_ = model_html

    @property
    def order(self) -> int:
        """Number of states."""
        return len(self.B)

    @property
    def slowest_rate(self) -> float:
        """Slowest thermal decay rate in 1/s, at small temperature rise."""
        return float(-np.linalg.eigvals(self.A).real.max())

    def read(self, x: Array) -> Any:
        """C x: the rise in K in the states x, shape (..., n)."""
        return x @ self.C

    def read_slope(self, x: Array) -> Array:
        """Derivative of the rise with respect to the states x, shape (..., n)."""
        return np.broadcast_to(self.C, x.shape)

    def state_gain(self, x: Array) -> Array:
        """Derivative of dx/dt with respect to the power at the states x, shape (n,), K/J."""
        return self.G @ x + self.B

    @cached_property
    def linear(self) -> StateSpace:
        """The system at small power; InputError where A is not symmetric, as that of a SINDy network."""
        eye = np.eye(self.order)
        return StateSpace(eye, self.A, self.B[:, None], self.C[None], inputs=self.inputs, outputs=self.outputs)

    @property
    def dynamics(self) -> Quadratic:
        """The system itself."""
        return self

    @property
    def thermal_resistance(self) -> float:
        """-C A^-1 B in K/W, at small power."""
        return float(-self.C @ np.linalg.solve(self.A, self.B))

    def step_response(self, times: ArrayLike) -> Array:
        """Rise in K/W after a step of small power, C A^-1 (e^(A t) - 1) B, also for equal poles."""
        t = np.maximum(checks.numbers("times", times), 0)
        weight = np.linalg.solve(self.A.T, self.C)
        settled = 1e3 / self.slowest_rate  # s; expm of a longer time would overflow

        def rise(t: Array) -> Array:
            flow = expm(np.minimum(t, settled)[..., None] * self.A)
            return (flow @ self.B - self.B) @ weight

        return in_pieces(rise, t, self.order**2)

    def impedance(self, frequency: ArrayLike) -> Complex:
        """Z(f) = C (2 pi i f - A)^-1 B at small power in K/W."""
        f = checks.numbers("frequency", frequency)
        eye = np.eye(self.order)

        def read(f: Array) -> Any:
            states = np.linalg.solve(2j * np.pi * f[..., None] * eye - self.A, self.B[:, None])
            return states[..., 0] @ self.C

        return in_pieces(read, f, self.order**2)

    def rate(self, x: Array, power: float) -> Array:
        """dx/dt for states x, shape (n,), in K/s, at a power in W."""
        return self.A @ x + (self.H @ x) @ x + power * (self.G @ x + self.B)

    def jacobian(self, x: Array, power: float) -> Array:
        """Derivative of dx/dt with respect to x, shape (n, n), in 1/s."""
        return self.A + 2 * (self.H @ x) + power * self.G

    def response(self, wave: waveforms.Waveform, times: ArrayLike) -> Array:
        """Rise in K from rest: LSODA from one breakpoint to the next."""
        rise = self.states(wave, times) @ self.C
        return warn_beyond(rise.reshape(np.shape(times)), self.largest_rise)

    def periodic_response(self, wave: waveforms.Waveform, samples: int) -> Array:
        """One period of the periodic state in K, by Newton's method on the period map."""
        return warn_beyond(self.periodic_states(wave, samples) @ self.C, self.largest_rise)

    def steady_rise(self, power: ArrayLike) -> Array:
        """Static rise in K at constant power in W, shape of ``power``."""
        power = checks.numbers("power", power)
        rise = np.array([self.C @ self.steady_state(p) for p in power.ravel()])
        return warn_beyond(rise.reshape(power.shape), self.largest_rise)

    def steady_state(self, power: float) -> Array:
        """States at constant power, on the branch that begins at rest.

        Raises
        ------
        InputError
            no steady state at this power: the quadratic terms have taken over.
        """
        power = checks.finite("power", power, unit="W")
        x = np.zeros(self.order)
        for share in np.linspace(0.125, 1, 8):
            for _ in range(20):
                rate = self.rate(x, share * power)
                change = np.linalg.solve(self.jacobian(x, share * power), rate)
                x = x - change
                size = np.abs(change).max()
                if size <= 1e-12 * np.abs(x).max() + _TINY:
                    break
            else:
                raise InputError(f"power = {power:g} W: the quadratic model has no steady state there")
        return x

    def states(self, wave: waveforms.Waveform, times: ArrayLike, *, initial: Array | None = None) -> Array:
        """States under ``wave`` at ``times`` (s, any order), shape (times, n), from rest or ``initial`` at t = 0."""
        t = checks.array("times", checks.numbers("times", times).ravel())
        checks.between("times", t.min(), 0, np.inf, unit="s")
        stop = max(float(t.max()), _TINY)
        pieces = waveforms.heating_pieces(wave, 0.0, stop)
        x = np.zeros(self.order) if initial is None else initial
        peaks = np.abs([pieces.coefficients[:, 0], pieces.ends])
        scale = self._size(float(peaks.max())) + np.abs(x)
        result = np.empty((t.size, self.order))
        result[t == 0] = x
        if not t.any():
            return result
        marks = [0.0, *wave.breakpoints(0.0, stop).tolist(), stop]
        for a, b in pairwise(marks):
            inside = (t > a) & (t <= b)
            distinct, back = np.unique(t[inside], return_inverse=True)
            track = self._stretch(x, np.unique([a, *distinct, b]), pieces, RTOL * scale)
            result[inside] = track[1 : 1 + distinct.size][back]
            x = track[-1]
        return result

    def periodic_states(self, wave: waveforms.Waveform, samples: int) -> Array:
        """States over one period of the periodic state, shape (samples, n)."""
        times = waveforms.period_times(wave, samples)
        period = times[-1]
        mean_power = wave.mean(0.0, period)
        x = self.steady_state(mean_power)
        scale = float(np.abs(x * self.C).sum())
        for _ in range(PERIOD_PASSES):
            track = self.states(wave, times, initial=x)
            mean = np.trapezoid(track, times, axis=0) / period
            monodromy = expm(self.jacobian(mean, mean_power) * period)
            change = np.linalg.solve(np.eye(self.order) - monodromy, track[-1] - x)
            x = x + change
            if np.abs(change * self.C).sum() <= 1e-6 * scale:
                return track + change  # a correction this small has no shape left
        raise InputError(f"no periodic state found in {PERIOD_PASSES} passes; is the power beyond the model's range?")

    def _size(self, power: float) -> Array:
        """Size of every state at a constant power, first plus second order, shape (n,), which scales the tolerances."""
        first = -np.linalg.solve(self.A, self.B) * power
        force = (self.H @ first) @ first + power * (self.G @ first)
        second = np.linalg.solve(self.A, force)
        return np.abs(first) + np.abs(second)

    def _stretch(self, x: Array, times: Array, pieces: waveforms.Pieces, atol: Array) -> Array:
        """States at ``times``, shape (times, n), between two breakpoints of the power, from x at times[0].

        The steps end on every edge of ``pieces``, between which the power is one cubic: none is stepped over.
        """
        start = times[0]
        stop = times[-1]
        slack = 1e-9 * (stop - start)
        after = int(np.searchsorted(pieces.edges, start + slack, side="right"))
        first = max(after - 1, 0)
        last = int(np.searchsorted(pieces.edges, stop - slack, side="left"))
        edges = pieces.edges[first:last] - start
        coefficients = pieces.coefficients[first:last].tolist()
        if not np.any(x) and not np.any(coefficients):
            return np.zeros((times.size, x.size))
        starts = edges.tolist()

        def power(t: float) -> float:
            k = max(bisect_right(starts, t) - 1, 0)
            a, b, c, d = coefficients[k]
            u = t - starts[k]
            return float(a + u * (b + u * (c + u * d)))

        ends = np.append(edges[1:], stop - start)
        marks = np.concatenate([times - start, ends])
        grid, where = np.unique(marks, return_inverse=True)
        with warnings.catch_warnings():
            warnings.simplefilter("error", ODEintWarning)
            warnings.simplefilter("ignore", RuntimeWarning)  # overflow of a run-away, which ends in the next line
            try:
                track = odeint(
                    lambda t, x: self.rate(x, power(t)),
                    x,
                    grid,
                    tfirst=True,
                    Dfun=lambda t, x: self.jacobian(x, power(t)),
                    rtol=RTOL,
                    atol=np.maximum(atol, _TINY),
                    tcrit=ends,  # each of them is in the grid, as odeint needs it
                    mxstep=20000,
                )
            except ODEintWarning:
                track = np.full((1, 1), np.nan)
        if not np.isfinite(track).all():
            raise InputError("the quadratic model runs away: the power is far beyond the range it describes")
        return track[where[: times.size]]

    def to_json(self) -> dict[str, Any]:
        """Fields of the model file; InputError for a system that cools where it is heated."""
        self._check_gain()
        arrays = {name: getattr(self, name).tolist() for name in ("A", "H", "G", "B", "C")}
        units = {"A": "1/s", "H": "1/(K s)", "G": "1/J", "B": "K/J", "C": "1", "largest_rise": "K"}
        return {**names(self), **arrays, "largest_rise": self.largest_rise, "units": units}

    @classmethod
    @reader
    def from_json(cls, content: Mapping[str, Any]) -> Quadratic:
        """The system that the content of a model file describes."""
        arrays = {name: content[name] for name in ("A", "H", "G", "B", "C")}
        model = cls(**arrays, **parts(content), largest_rise=content.get("largest_rise"))
        model._check_gain()
        return model

    def _check_gain(self) -> None:
        checks.positive("static gain", self.thermal_resistance, unit="K/W", hint="heat would cool it")


@dataclass(frozen=True, eq=False)
class NonlinearSystem(AtSmallPower, NonlinearEquations):
    """A thermal model with k(T) and c_p(T); keeps the contract of `thermofem.models.contract`.

    linear: the same at small power, around the ambient temperature.
    flow, content: F(x) in W and H(x) in J.
    """

    linear: StateSpace

    @property
    def dynamics(self) -> Any:
        """Not available: the full-order system is too large to be integrated with the optics.

        Raises InputError: always.
        """
        raise InputError(
            f"model is the FEM with k(T), {self.order} states; reduce it first (surrogate.reduce_quadratic), or keep "
            "it in the loop (coupled.cosimulate)"
        )

    def response(self, wave: waveforms.Waveform, times: ArrayLike, *, rtol: float = 1e-5) -> Array:
        """Rise in K from rest, by error-controlled integration (`transient.integrate`)."""
        check_single(self.linear)

        def run(t: Array) -> Array:
            waveforms.check_heating(wave, float(t.max(initial=0.0)))
            return integrate(self, wave, t, rtol=rtol).outputs[:, 0]

        return at_times(run, times)

    def periodic_response(self, wave: waveforms.Waveform, samples: int, *, rtol: float = 1e-5) -> Array:
        """One period of the periodic state in K, shape (samples,).

        Times are `waveforms.period_times`, both ends included; found by `transient.integrate_periodic`.
        """
        check_single(self.linear)
        waveforms.check_heating(wave, getattr(wave, "period", None))
        return integrate_periodic(self, wave, samples, rtol=rtol).outputs[:, 0]

    def steady_state(self, power: float | Sequence[float]) -> Array:
        """Rise in K of all unknowns at constant power in W (one for each input): Newton's method on F(x) = B P.

        Raises InputError: no steady state is found, as where the conductivity falls so fast that the heat cannot leave.
        """
        powers = np.atleast_1d(checks.numbers("power", power))
        heat = self.linear.B @ np.broadcast_to(powers, len(self.inputs))
        x = np.zeros(self.order)
        half_ambient = 0.5 * self.flow.ambient  # K
        size_before = np.inf
        for _ in range(60):
            try:
                solve = factorize_general(self.flow.jacobian(x))
            except RuntimeError:  # SuperLU: the Jacobian is singular, as where k(T) has gone to nothing
                break
            change = solve(heat - self.flow(x))
            size = np.abs(change).max()
            if not np.isfinite(size):
                break
            # a step that would cool some place by more than half of the ambient temperature is cut short
            share = half_ambient / size if change.min() < -half_ambient else 1.0
            x = x + share * change
            largest = np.abs(x).max()
            stagnates = size <= 1e-9 * largest and size >= size_before / 2
            if size <= 1e-12 * largest or stagnates:
                self.flow.slopes(x, positive=True)
                return x
            size_before = size
        raise InputError(
            f"power = {power} W: no steady state is found; does the conductivity fall so "
            "fast with temperature that the heat cannot leave?"
        )

    def steady_rise(self, power: float | Sequence[float]) -> Array:
        """Rise of every output at constant power in W, in K, shape (outputs,)."""
        return self.linear.C @ self.steady_state(power)
