"""Figures of coupled runs; the only module of the package that imports matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

LIGHT, HEAT = "#0072B2", "#D55E00"  # blue and vermilion of Okabe and Ito, apart for every kind of colour vision


def plot_traces(run: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the drop power (left axis) and the temperature rise (right axis) against time.

    Parameters
    ----------
    run : xarray.Dataset
        from `simulate`.
    ax : matplotlib Axes, optional
        drawn into; a new figure by default.

    Returns
    -------
    matplotlib Axes
        the left one; the right one is its twin.
    """
    if ax is None:
        _, ax = plt.subplots(figsize=(7, 3.2), layout="constrained")
    t, time_unit = _readable(run["time"].values, "s")
    drop, power_unit = _readable(run["drop"].values, "W")
    ax.plot(t, drop, color=LIGHT, linewidth=1.2)
    ax.set_xlabel(f"time ({time_unit})")
    ax.set_ylabel(f"drop power ({power_unit})", color=LIGHT)
    ax.set_xlim(t[0], t[-1])
    ax.set_ylim(bottom=0)
    right = ax.twinx()
    right.plot(t, run["delta_T"].values, color=HEAT, linewidth=1.2, linestyle=(0, (5, 1)))
    right.set_ylabel("temperature rise (K)", color=HEAT)
    right.set_ylim(bottom=0)
    ax.spines["top"].set_visible(False)
    right.spines["top"].set_visible(False)
    return ax


def _readable(values: np.ndarray, unit: str) -> tuple[np.ndarray, str]:
    """Scale values so that their largest reads well, and name the scaled unit."""
    largest = float(np.max(np.abs(values), initial=0.0))
    for factor, prefix in ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p")):
        if largest >= factor:
            return values / factor, prefix + unit
    return values, unit
