"""A linear thermal model with a static map of its output."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .. import checks, waveforms
from ..arrays import Array, ArrayLike
from ..data.display import model_html
from .contract import AtSmallPower, check_rise, warn_beyond
from .foster import Foster
from .json_fields import reader


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
        checks.instance("linear", self.linear, Foster, hint="a thermofem.Foster is needed, such as the model of a fit")
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
    def dynamics(self) -> OutputMap:
        """The output map over a Foster network of the linear model."""
        return self if isinstance(self.linear, Foster) else replace(self, linear=self.linear.dynamics)

    def steady_rise(self, power: ArrayLike) -> Array:
        """Static rise in K at constant power in W, shape of ``power``."""
        return warn_beyond(self.of(self.thermal_resistance * checks.numbers("power", power)), self.largest_rise)

    def of(self, z: ArrayLike) -> Array:
        """dT in K of a linear rise z in K."""
        z = checks.numbers("z", z)
        if np.any(1 + 2 * self.coefficient * z <= 0):
            top = -0.5 / self.coefficient
            raise checks.InputError(
                f"a linear rise of {z.flat[np.argmax(np.abs(z))]:.4g} K lies beyond the top of the output map at "
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
        """The model of a model file."""
        return cls(Foster.from_json(content), content["coefficient"], content.get("largest_rise"))
