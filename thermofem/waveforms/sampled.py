"""Samples, with straight lines between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..data.display import shown
from .contract import TIME_HINT, stored
from .lines import Lines


@stored
@shown
@dataclass(frozen=True, eq=False)
class Sampled(Lines):
    """P(t) through given samples, straight between them; two samples at one time make a jump.

    Parameters
    ----------
    times : array, s
        increasing; a time may stand twice.
    power : array, W, same length
    repeat : bool
        the samples are one period and repeat for ever.

    Outside the samples the power is not known: asking for it raises InputError (unless ``repeat``).
    """

    times: ArrayLike
    power: ArrayLike
    repeat: bool = False
    what: ClassVar[str] = "power"

    def __post_init__(self) -> None:
        power = checks.array("power", self.power, hint=checks.POWER_HINT)
        self.check_samples(power, hint=TIME_HINT)
        if np.any(power < 0):
            raise checks.InputError(f"power[{np.argmin(power)}] = {power.min():g} W is negative; absorbed power heats")
        checks.power("power", power.max(), zero=True)
        object.__setattr__(self, "power", power)

    @property
    def values(self) -> ArrayLike:  # type: ignore[override]
        """The power."""
        return self.power
