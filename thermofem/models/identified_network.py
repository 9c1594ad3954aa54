"""A linear network that SINDy identified, and the gate that it passes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .. import checks
from ..arrays import Array, ArrayLike
from ..waveforms import Waveform
from .contract import Delegates, names, parts, reader, warn_beyond
from .foster import Foster

STATIC = 1e-3  # largest error of the static gain that passes


@dataclass(frozen=True, eq=False)
class Network(Delegates):
    """An identified linear network with the largest temperature rise of its training.

    Attributes
    ----------
    A : array, shape (n, n), 1/s
    b : array, shape (n,), K/J
    names : tuple of str
        states; the first is read.
    poles : Foster
        the same network, diagonalised.
    largest_rise : float, K
        of the training.
    origin : dict, optional
        where it comes from (geometry as TOML, how it was made); exports and model files keep it.
    """

    A: Array
    b: Array
    names: tuple[str, ...]
    poles: Foster
    largest_rise: float
    origin: Mapping[str, Any] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        checks.plain(self)
        object.__setattr__(self, "names", checks.check_names("states", self.names))
        checks.positive("largest_rise", self.largest_rise, unit="K")
        checks.keep(self, A=checks.numbers("A", self.A), b=checks.numbers("b", self.b))
        checks.shape("b", self.b, (len(self.names),))

    @property
    def _other(self) -> Foster:
        return self.poles

    @property
    def dynamics(self) -> Foster:
        """The network, diagonalised: exact, since its poles are real and its residues positive (`gate`)."""
        return self.poles

    def response(self, wave: Waveform, times: ArrayLike) -> Array:
        """Rise in K from rest; warns beyond the training."""
        return warn_beyond(self.poles.response(wave, times), self.largest_rise)

    def periodic_response(self, wave: Waveform, samples: int) -> Array:
        """One period of the periodic state in K; warns beyond the training."""
        return warn_beyond(self.poles.periodic_response(wave, samples), self.largest_rise)

    def to_json(self) -> dict[str, Any]:
        """Fields of the model file."""
        units = {"A": "1/s", "b": "K/J", "thermal_resistance": "K/W", "largest_rise": "K"}
        return {
            **names(self),
            "states": list(self.names),
            "A": self.A.tolist(),
            "b": self.b.tolist(),
            "thermal_resistance": self.thermal_resistance,
            "largest_rise": self.largest_rise,
            "units": units,
        }

    @classmethod
    @reader
    def from_json(cls, content: Mapping[str, Any]) -> Network:
        """The network that the content of a model file describes; it passes the `gate` again."""
        A = content["A"]
        b = content["b"]
        poles = gate(A, b, content["thermal_resistance"])
        return cls(A, b, content["states"], replace(poles, **parts(content)), content["largest_rise"])


def gate(A: ArrayLike, b: ArrayLike, static: float, *, name: str = "core") -> Foster:
    """Check a network dT/dt = A T + b P, read at its first state, and return it as a Foster network.

    Parameters
    ----------
    A : array, shape (n, n), 1/s
    b : array, shape (n,), K/J
    static : float, K/W
        the thermal resistance that the network must have.
    name : str
        of the part that is heated and read.

    Returns
    -------
    Foster

    Raises
    ------
    InputError
        complex or growing poles, a negative residue, or a static gain off by more than 1e-3.
    """
    A = checks.numbers("A", A)
    b = checks.array("b", b)
    static = checks.positive("static", static, unit="K/W")
    checks.shape("A", A, (b.size, b.size))
    rate, modes = np.linalg.eig(A)
    oscillates = (np.abs(rate.imag) > 1e-9 * np.abs(rate)).any()
    with checks.prefixed("the identified network is refused"):
        if oscillates or (rate.real >= 0).any():
            raise checks.InputError(f"it oscillates or is not stable, with the poles {rate} 1/s")
        tau = -1.0 / rate.real
        weights = np.linalg.solve(modes, b)
        R = np.real(modes[0] * weights) * tau
        worst = np.argmin(R)
        gain = R.sum()
        if R[worst] < 0:
            raise checks.InputError(f"it is not passive (R = {R[worst]:.3g} K/W at tau = {tau[worst]:.3g} s)")
        if abs(gain - static) > STATIC * static:
            raise checks.InputError(f"its static gain is {gain:.5g} K/W, not {static:.5g}")
    return Foster(R=R, tau=tau, inputs=(name,), outputs=(name,))
