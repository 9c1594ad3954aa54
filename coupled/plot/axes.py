"""Units of the axes that figures of this package share."""

from __future__ import annotations

import numpy as np

from thermofem.plot_style import BLUE as LIGHT
from thermofem.plot_style import VERMILION as HEAT

__all__ = ["HEAT", "LIGHT", "dbm", "readable"]


def dbm(power: np.ndarray) -> np.ndarray:
    """Power in W as dBm."""
    return 10 * np.log10(power * 1e3)


def readable(values: np.ndarray, unit: str) -> tuple[np.ndarray, str]:
    """Scale values so that their largest reads well, and name the scaled unit."""
    largest = float(np.max(np.abs(values), initial=0.0))
    for factor, prefix in (
        (1e9, "G"),
        (1e6, "M"),
        (1e3, "k"),
        (1.0, ""),
        (1e-3, "m"),
        (1e-6, "µ"),
        (1e-9, "n"),
        (1e-12, "p"),
    ):
        if largest >= factor:
            return values / factor, prefix + unit
    return values, unit
