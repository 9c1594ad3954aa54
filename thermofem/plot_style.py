"""Style of all figures: colours and sizes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt

from .data.variables import takes as takes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Okabe and Ito: apart for every kind of colour vision, and in grey
INK, BLUE, VERMILION, GREEN, ORANGE, SKY, PURPLE = (
    "#222222", "#0072B2", "#D55E00", "#009E73", "#E69F00", "#56B4E9", "#CC79A7",
)  # fmt: skip
CYCLE = (VERMILION, BLUE, GREEN, ORANGE, PURPLE, SKY)  # of several lines in one panel
WIDTH = 5.7  # inches at most: in half a column of 88 mm "small", the smallest text, is then 5 pt high
SIZE = (WIDTH, 3.5)  # of a figure by default


def axes(ax: Axes | None, size: tuple[float, float] = SIZE) -> Axes:
    """``ax``, or the Axes of a new figure."""
    if ax is None:
        _, ax = plt.subplots(figsize=size, layout="constrained")
    return takes("ax", ax, "plot", what="matplotlib Axes, or nothing for a new figure")


def time_unit(longest: float) -> tuple[float, str]:
    """Factor from s and the unit in which a time axis up to ``longest`` (s) has short numbers.

    >>> time_unit(20e-6), time_unit(95.8)
    ((1000000.0, 'µs'), (1.0, 's'))
    """
    return next(
        (f, unit) for f, unit in ((1.0, "s"), (1e3, "ms"), (1e6, "µs"), (1e9, "ns")) if longest * f >= 1 or f == 1e9
    )
