"""Units of the axes and styles of the lines that figures of this package share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from thermofem.data.variables import contents
from thermofem.plot import BLUE as LIGHT
from thermofem.plot import VERMILION as HEAT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["HEAT", "LIGHT", "curves_over", "dbm", "draw_stability", "joined", "readable"]


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


def curves_over(name: str, given: Any, needed: Sequence[str], *, what: str) -> list[Any]:
    """Curves that are drawn over a figure, in SI, each with the needed variables; one alone counts as a list of one."""
    several = [given] if hasattr(given, "variables") else given
    return [contents(f"{name}[{k}]", curve, needed, what=what) for k, curve in enumerate(several)]


def joined(part: np.ndarray) -> np.ndarray:
    """Extend each true stretch of a mask by the next point, so that lines of different styles meet."""
    return part | np.concatenate([part[:1], part[:-1]])


def draw_stability(
    ax: Axes, x: np.ndarray, y: np.ndarray, stable: np.ndarray, *, color: str, labels: tuple[str, str]
) -> None:
    """Draw a line, solid where stable and dotted elsewhere; ``labels`` name the two styles in the legend."""
    if stable.any():
        ax.plot(x, np.where(joined(stable), y, np.nan), color=color, linewidth=1.4, label=labels[0])
    if not stable.all():
        dots = (0, (1, 1.5))
        ax.plot(x, np.where(stable, np.nan, y), color=color, linewidth=1.2, linestyle=dots, label=labels[1])
