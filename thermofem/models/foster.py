"""A Foster network: the canonical small form of every linear thermal model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .. import checks, waveforms
from ..algebra.poles import pole_responses
from ..algebra.system import LONGEST, SHORTEST
from ..arrays import Array, ArrayLike, NDArray, in_pieces
from ..checks import check_one
from ..data.display import model_html
from .contract import at_times
from .json_fields import columns, names, parts, reader, rows


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

    R: ArrayLike
    tau: ArrayLike
    inputs: tuple[str, ...] = ("core",)
    outputs: tuple[str, ...] = ("core",)
    origin: Mapping[str, Any] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        R, tau = checks.array("R", self.R), checks.array("tau", self.tau)
        checks.same_size(R=R, tau=tau)
        for end in (tau.min(), tau.max()):
            checks.between("tau", end, SHORTEST, LONGEST, unit="s", hint="a negative time constant grows without bound")
        for name in ("inputs", "outputs"):
            object.__setattr__(self, name, check_one(name, getattr(self, name)))
        order = np.argsort(tau)
        checks.keep(self, R=R[order], tau=tau[order])

    _repr_html_ = model_html

    @property
    def order(self) -> int:
        """Number of poles."""
        return int(np.size(self.R))

    @property
    def passive(self) -> bool:
        """Whether every R_i >= 0: the network then never releases more heat than it absorbed."""
        return bool(np.all(np.asarray(self.R) >= 0))

    @property
    def thermal_resistance(self) -> float:
        """R_th = sum_i R_i in K/W."""
        return float(np.sum(self.R))

    def step_response(self, times: ArrayLike) -> Array:
        """sum_i R_i (1 - exp(-t/tau_i)) in K/W; zero before t = 0."""
        t = np.maximum(checks.numbers("times", times, most=np.inf), 0)
        with np.errstate(over="ignore"):  # t / tau beyond all numbers: the step has settled
            return in_pieces(lambda t: -np.expm1(-t / self.tau) @ np.asarray(self.R), t, self.order)

    def impedance(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """sum_i R_i / (1 + 2 pi i f tau_i) in K/W."""
        R, tau = np.asarray(self.R), np.asarray(self.tau)
        f = checks.numbers("frequency", frequency)
        return in_pieces(lambda f: (R / (1 + 2j * np.pi * f * tau)).sum(axis=-1), f, self.order)

    @property
    def dynamics(self) -> Foster:
        """The network itself."""
        return self

    @property
    def gain(self) -> Array:
        """R_i / tau_i in K/J: the initial slope that each pole adds per watt."""
        return np.asarray(self.R) / np.asarray(self.tau)

    def response(self, wave: waveforms.Waveform, times: ArrayLike) -> Array:
        """Rise in K from rest at t = 0, in closed form; a function of time as its piecewise cubic."""
        return at_times(lambda t: pole_responses(1 / np.asarray(self.tau), wave, t) @ self.gain, times)

    def periodic_response(self, wave: waveforms.Waveform, samples: int) -> Array:
        """One period of the periodic state in K, in closed form."""
        times = waveforms.period_times(wave, samples)
        return pole_responses(1 / np.asarray(self.tau), wave, times, periodic=True) @ self.gain

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
        """The network of a model file."""
        model = cls(**columns(content, "poles", R="K/W", tau="s"), **parts(content))
        model.check_passive()
        return model

    def check_passive(self) -> None:
        """Raise InputError for a network that gives out heat it never took in; between two parts R may be negative."""
        R = np.asarray(self.R)
        if self.inputs == self.outputs:
            check_residues(R)
        if not np.any(R > 0):
            raise checks.InputError("every R is zero: the model never warms up")


def check_residues(R: Array, *, round_off: float = 0.0) -> None:
    """Raise InputError where a part that is heated and read has a negative R, in K/W: heat would cool it."""
    if R.min() < -round_off * np.abs(R).sum():
        raise checks.InputError(
            f"R = {R.min():g} K/W is negative: the network is not passive; fit_foster and reduce never give one"
        )


def linear_poles(model: Any, purpose: str) -> Foster:
    """Return the poles of a linear model, or InputError that says which models ``purpose`` holds for."""
    checks.has("model", model, "dynamics", hint="a thermal model is needed, such as thermofem.Foster or a fit")
    found = model.dynamics
    if not isinstance(found, Foster):
        raise checks.InputError(
            f"model is a {type(model).__name__} and not linear; only a linear model {purpose}: Foster, StateSpace, "
            "Network or Cauer, a fit or a reduction"
        )
    return found
