"""Foster networks: the canonical small form of every linear thermal model, the paper's two, and one with an output map.

Source of the paper's two: M. Borghi, D. Bazzanella, M. Mancinelli, L. Pavesi, Opt. Express 29, 4363 (2021), Eqs. (2.3)
and (3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .. import checks, waveforms
from ..algebra.pole_responses import pole_responses
from ..arrays import Array, ArrayLike, Complex, in_pieces
from ..checks import InputError
from ..data.display import model_html
from .contract import AtSmallPower, at_times, check_rise, columns, keep_names, names, parts, reader, rows, warn_beyond


@dataclass(frozen=True, eq=False)
class Foster:
    """Foster network: thermal resistances R_i in series, each with its own time constant.

        Z(s) = sum_i R_i / (1 + s tau_i),    dx_i/dt = (R_i P - x_i) / tau_i,    dT = sum_i x_i

    The canonical small form of every linear thermal model. A negative R_i is allowed (a fit may give one); the network
    is then not passive, see ``passive``.

    Parameters
    ----------
    R : array, shape (n,), K/W
    tau : array, shape (n,), s
        kept in increasing order, each with its R.
    origin : dict, optional
        where the model comes from (geometry as TOML, how it was made); exports and model files keep it.

    Raises
    ------
    InputError
        a time constant that is not positive, lengths that differ, or numbers that are not finite.

    >>> Foster(R=[2000.0, 5000.0], tau=[50e-9, 1e-6]).thermal_resistance
    7000.0
    """

    R: Any
    tau: Any
    inputs: tuple[str, ...] = ("core",)
    outputs: tuple[str, ...] = ("core",)
    origin: Mapping[str, Any] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        R = checks.array("R", self.R)
        tau = checks.array("tau", self.tau)
        checks.shape("tau", tau, R.shape)
        hint = "a negative time constant grows without bound"
        for end in (tau.min(), tau.max()):
            # s; the rates of shorter ones and the charges of longer ones overflow in other programs
            checks.between("tau", end, 1e-20, 1e12, unit="s", hint=hint)
        keep_names(self)
        order = np.argsort(tau)
        checks.keep(self, R=R[order], tau=tau[order])

    _repr_html_ = model_html

    @property
    def order(self) -> int:
        """Number of poles."""
        return len(self.R)

    @property
    def passive(self) -> bool:
        """Whether every R_i >= 0: the network then never releases more heat than it absorbed."""
        return bool((self.R >= 0).all())

    @property
    def thermal_resistance(self) -> float:
        """R_th = sum_i R_i in K/W."""
        return float(self.R.sum())

    def step_response(self, times: ArrayLike) -> Array:
        """sum_i R_i (1 - exp(-t/tau_i)) in K/W; zero before t = 0."""
        t = np.maximum(checks.numbers("times", times, most=np.inf), 0)
        with np.errstate(over="ignore"):  # t / tau beyond all numbers: the step has settled
            return in_pieces(lambda t: -np.expm1(-t / self.tau) @ self.R, t, self.order)

    def impedance(self, frequency: ArrayLike) -> Complex:
        """sum_i R_i / (1 + 2 pi i f tau_i) in K/W."""
        f = checks.numbers("frequency", frequency)
        return in_pieces(lambda f: (self.R / (1 + 2j * np.pi * f * self.tau)).sum(axis=-1), f, self.order)

    @property
    def dynamics(self) -> Foster:
        """The network itself."""
        return self

    @property
    def gain(self) -> Array:
        """R_i / tau_i in K/J: the initial slope that each pole adds per watt."""
        return self.R / self.tau

    def response(self, wave: waveforms.Waveform, times: ArrayLike) -> Array:
        """Rise in K from rest at t = 0, in closed form; a `Function` enters as its piecewise cubic."""
        return at_times(lambda t: pole_responses(1 / self.tau, wave, t) @ self.gain, times)

    def periodic_response(self, wave: waveforms.Waveform, samples: int) -> Array:
        """One period of the periodic state in K, in closed form."""
        times = waveforms.period_times(wave, samples)
        return pole_responses(1 / self.tau, wave, times, periodic=True) @ self.gain

    def to_json(self) -> dict[str, Any]:
        """Fields of the model file; InputError for a network that is not passive."""
        self.check_passive()
        return {
            **names(self),
            "thermal_resistance": self.thermal_resistance,
            "poles": rows(("R", self.R), ("tau", self.tau)),
            "units": {"thermal_resistance": "K/W", "R": "K/W", "tau": "s"},
        }

    @classmethod
    @reader
    def from_json(cls, content: Mapping[str, Any]) -> Foster:
        """The network that the content of a model file describes, as `to_json` wrote it: R in K/W and tau in s.

        Raises InputError: content of another layout, or a network that is not passive (`check_passive`).
        """
        model = cls(**columns(content, "poles", R="K/W", tau="s"), **parts(content))
        model.check_passive()
        return model

    def check_passive(self) -> None:
        """Raise InputError for a network that releases more heat than it absorbed, or that never warms up.

        R of a network between two different parts may be negative.
        """
        if self.inputs == self.outputs:
            check_residues(self.R)
        if not (self.R > 0).any():
            raise InputError("every R is zero: the model never warms up")


def check_residues(R: Array, *, round_off: float = 0.0) -> None:
    """Raise InputError for a negative R (K/W), by which heat would cool the part where it is made and read.

    round_off: fraction of sum |R| by which one may be negative.
    """
    if R.min() < -round_off * np.abs(R).sum():
        raise InputError(
            f"R = {R.min():g} K/W is negative: the network is not passive; fit_foster and reduce never give one"
        )


def two_kinds(model: Any) -> Any:
    """``model.dynamics`` as one of two kinds: an `OutputMap` of poles, of coefficient 0 if linear, or a Quadratic."""
    small = model.dynamics
    return OutputMap(small, 0.0, origin=small.origin) if isinstance(small, Foster) else small


def linear_poles(model: Any, purpose: str) -> Foster:
    """Return the poles of a linear model as a Foster network; for other models an InputError that names ``purpose``."""
    small = two_kinds(model)
    if small.bent:
        raise InputError(
            f"model is a {type(model).__name__} and not linear; only a linear model {purpose}: Foster, StateSpace, "
            "Network or Cauer, a fit or a reduction"
        )
    return small.linear


BORGHI2021_HEAT_CAPACITY = 1.09e-14 * 700.0  # J/K: mass 1.09e-14 kg x 700 J/(kg K), Appendix A


def newton(*, tau_th: float, heat_capacity: float = BORGHI2021_HEAT_CAPACITY) -> Foster:
    """Newton's law of cooling: one pole.

        d(dT)/dt = -dT/tau_th + P/(m c_p)                                  (Eq. 2.3)

    Parameters
    ----------
    tau_th : float, s
    heat_capacity : float, J/K
        m c_p of the heated core; the default is the paper's resonator.

    Raises
    ------
    InputError
        a value that is not positive, or out of range by a unit.
    """
    tau_th = checks.positive("tau_th", tau_th, unit="s", at_most=1e6, hint="times are in s (did you mean 275e-9?)")
    heat_capacity = check_heat_capacity(heat_capacity)
    return Foster(R=[tau_th / heat_capacity], tau=[tau_th])


def second_order(
    *, kappa: float, tau_f: float, tau_s: float, eta: float, heat_capacity: float = BORGHI2021_HEAT_CAPACITY
) -> Foster:
    """The paper's second-order equation: a fast and a slow pole.

        dT'' + (1/tau_f + 1/tau_s) dT' + dT/(tau_f tau_s) = (kappa P + eta dP/dt) / (m c_p)      (Eq. 3)

    which is exactly two parallel poles, so that dP/dt is never evaluated:

        dx_i/dt = -x_i/tau_i + c_i P/(m c_p),   c_f = (eta/tau_f - kappa)/(1/tau_f - 1/tau_s),   c_s = eta - c_f

    Both driving terms are divided by m c_p here; the print divides only the first, which leaves eta with a unit that
    its quoted value 0.31 does not have.

    Parameters
    ----------
    kappa : float, 1/s
    tau_f, tau_s : float, s
        fast and slow time constant, tau_f < tau_s.
    eta : float
    heat_capacity : float, J/K

    Raises
    ------
    InputError
        a value that is not positive, out of range by a unit, or tau_f >= tau_s.

    >>> model = second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1200e-9, eta=0.31)
    >>> print(f"{model.thermal_resistance:.1f}")
    7784.2
    """
    hint = "times are in s (did you mean 55.8e-9?)"
    tau_f = checks.positive("tau_f", tau_f, unit="s", at_most=1e6, hint=hint)
    tau_s = checks.positive("tau_s", tau_s, unit="s", at_most=1e6, hint=hint)
    kappa = checks.positive("kappa", kappa, unit="1/s", at_most=1e12, hint="8.87e-4 /ns is 8.87e5 1/s")
    eta = checks.positive("eta", eta, at_most=100, hint="eta has no unit")
    checks.ordered("tau_f", tau_f, "tau_s", tau_s, unit="s", hint="are they swapped?")
    fast = 1 / tau_f
    slow = 1 / tau_s
    hint = "outside eta/tau_s to eta/tau_f one of the poles cools when heated; 8.87e-4 /ns is 8.87e5 1/s"
    checks.between("kappa", kappa, eta * slow, eta * fast, unit="1/s", hint=hint)
    return second_order_poles(kappa, tau_f, tau_s, eta, check_heat_capacity(heat_capacity))


def second_order_poles(kappa: float, tau_f: float, tau_s: float, eta: float, heat_capacity: float) -> Foster:
    """The two poles of Eq. 3, whose R may be negative here; `second_order` checks the values first."""
    fast = 1 / tau_f
    slow = 1 / tau_s
    c_f = (eta * fast - kappa) / (fast - slow)
    c_s = (kappa - eta * slow) / (fast - slow)
    return Foster(R=[c_f * tau_f / heat_capacity, c_s * tau_s / heat_capacity], tau=[tau_f, tau_s])


def second_order_parameters(model: Foster, heat_capacity: float = BORGHI2021_HEAT_CAPACITY) -> dict[str, float]:
    """The parameters of Eq. 3 of a network with two poles, the inverse of `second_order_poles`.

        kappa = c_f/tau_s + c_s/tau_f,     eta = c_f + c_s,     c_i = m c_p R_i/tau_i

    >>> found = second_order_parameters(second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1.2e-6, eta=0.31))
    >>> print(f"{found['kappa']:.4g}, {found['eta']:.4g}")
    8.87e+05, 0.31
    """
    c_f, c_s = model.gain * heat_capacity
    tau_f, tau_s = model.tau.tolist()
    kappa = c_f / tau_s + c_s / tau_f
    return {"kappa": float(kappa), "tau_f": tau_f, "tau_s": tau_s, "eta": float(c_f + c_s)}


def check_heat_capacity(value: float) -> float:
    """``value``, or InputError unless it is a heat capacity in J/K."""
    hint = "m c_p is in J/K (the paper's resonator has 7.63e-12)"
    return checks.positive("heat_capacity", value, unit="J/K", at_most=1e6, hint=hint)


@dataclass(frozen=True, eq=False)
class OutputMap(AtSmallPower):
    """Linear dynamics with a static map of the output, the Kirchhoff transformation in one number.

        dT = z + coefficient z^2,      z = rise of the linear model

    With k(T) the Kirchhoff variable obeys a nearly linear heat equation and the temperature is a function of it. As
    stable as the linear model, whatever the coefficient.

    Parameters
    ----------
    linear : Foster
        the model at small power.
    coefficient : float, 1/K
        positive where the conductivity falls with temperature.
    largest_rise : float, K, optional
        that the coefficient was fitted to; beyond it responses warn.
    origin : dict, optional
        where the model comes from (geometry as TOML, how it was made); exports and model files keep it.

    Raises
    ------
    InputError
        a coefficient that is not finite or larger than 0.1 /K; a response beyond the top of the map, where
        1 + 2 coefficient z = 0.

    >>> OutputMap(Foster(R=[7800.0], tau=[1e-6]), -4e-4).steady_rise(20e-3).round(1)
    np.float64(146.3)
    """

    linear: Foster
    coefficient: float
    largest_rise: float | None = None
    origin: Mapping[str, Any] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        checks.plain(self)
        hint = "it is in 1/K, of the order of -4e-4 for silicon in oxide"
        object.__setattr__(self, "coefficient", checks.between("coefficient", self.coefficient, -0.1, 0.1, hint=hint))
        check_rise(self.largest_rise)

    _repr_html_ = model_html

    def response(self, wave: waveforms.Waveform, times: ArrayLike) -> Array:
        """Rise in K from rest, in closed form."""
        return warn_beyond(self.of(self.linear.response(wave, times)), self.largest_rise)

    def periodic_response(self, wave: waveforms.Waveform, samples: int) -> Array:
        """One period of the periodic state in K, in closed form."""
        return warn_beyond(self.of(self.linear.periodic_response(wave, samples)), self.largest_rise)

    @property
    def bent(self) -> bool:
        """Whether the model is not linear."""
        return self.coefficient != 0

    @property
    def top(self) -> float:
        """Highest rise dT in K, -1/(4 coefficient), which the linear rise -1/(2 coefficient) gives; inf without one."""
        return -0.25 / self.coefficient if self.coefficient < 0 else np.inf

    @property
    def slowest_rate(self) -> float:
        """Slowest thermal decay rate in 1/s."""
        slowest = self.linear.tau[self.linear.R != 0].max()
        return float(1 / slowest)

    def read(self, x: Array) -> Any:
        """Rise in K in the states x of the poles, shape (..., n)."""
        return self.of(x.sum(axis=-1))

    def read_slope(self, x: Array) -> Array:
        """Derivative of the rise with respect to the states x, shape (..., n)."""
        z = x.sum(axis=-1, keepdims=True)
        return np.tile(1 + 2 * self.coefficient * z, self.order)

    def state_gain(self, x: Array) -> Array:
        """Derivative of dx/dt with respect to the power at the states x, shape (n,), K/J."""
        return self.linear.gain

    @property
    def dynamics(self) -> OutputMap:
        """The output map over a Foster network of the linear model."""
        return self if isinstance(self.linear, Foster) else replace(self, linear=self.linear.dynamics)

    def steady_rise(self, power: ArrayLike) -> Array:
        """Static rise in K at constant power in W, shape of ``power``."""
        return warn_beyond(self.of(self.thermal_resistance * checks.numbers("power", power)), self.largest_rise)

    def of(self, z: ArrayLike) -> Array:
        """Temperature rise dT in K for the rise z in K of the linear model."""
        z = checks.numbers("z", z)
        if (1 + 2 * self.coefficient * z <= 0).any():
            top = -0.5 / self.coefficient
            largest = z.flat[np.argmax(np.abs(z))]
            raise InputError(
                f"a linear rise of {largest:.4g} K lies beyond the top of the output map at "
                f"{top:.4g} K; the power is far beyond what the coefficient describes"
            )
        return z + self.coefficient * z * z

    def to_json(self) -> dict[str, Any]:
        """Fields of the model file: those of the Foster network, and the map."""
        content = self.dynamics.linear.to_json()
        units = {**content.pop("units"), "coefficient": "1/K", "largest_rise": "K"}
        return {**content, "coefficient": self.coefficient, "largest_rise": self.largest_rise, "units": units}

    @classmethod
    @reader
    def from_json(cls, content: Mapping[str, Any]) -> OutputMap:
        """The model that the content of a model file describes."""
        return cls(Foster.from_json(content), content["coefficient"], content.get("largest_rise"))
