"""Figures of branches of cycles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from thermofem.checks import text
from thermofem.data.variables import contents
from thermofem.plot import INK, axes

from .axes import HEAT, draw_stability, readable

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

MARKS = {"fold": ("s", "fold of cycles"), "period doubling": ("D", "period doubling"), "torus": ("^", "torus"),
         "Hopf": ("o", "Hopf point")}  # fmt: skip

BRANCH = "a Dataset of coupled.continue_cycle"


def plot_branch(branch: xr.Dataset, ax: Axes | None = None, *, fixed: xr.Dataset | None = None) -> Axes:
    """Draw the lowest and highest drop power of a branch of cycles: stable stretches solid, others dotted.

    branch: from `continue_cycle`.
    ax: drawn into; a new figure by default.
    fixed: from `transmission` over the same parameter: the fixed points, drawn below the cycles.
    """
    name = text("branch.attrs['parameter']", branch.attrs.get("parameter"))
    dims = (name, "drop_high", "drop_low", "stability", "special")
    branch = contents("branch", branch, dims, what=BRANCH)
    ax = axes(ax, (5.6, 3.6))
    factor, label = _axis(branch, name)
    if fixed is not None:
        shape = (name, "drop", "regime")
        fixed = contents("fixed", fixed, shape, what=f"a Dataset of coupled.transmission over {name}")
        stable = fixed["regime"].values == "stable"
        labels = ("fixed point, stable", "fixed point, unstable")
        draw_stability(ax, fixed[name].values * factor, fixed["drop"].values * 1e3, stable, color=INK, labels=labels)
    stable = branch["stability"].values == "stable"
    x = branch[name].values * factor
    for k, edge in enumerate(("drop_high", "drop_low")):
        labels = ("", "") if k else ("cycle, highest and lowest, stable", "cycle, highest and lowest, unstable")
        draw_stability(ax, x, branch[edge].values * 1e3, stable, color=HEAT, labels=labels)
    for kind, (marker, words) in MARKS.items():
        at = branch["special"].values == kind
        style: dict[str, Any] = {"marker": marker, "linestyle": "", "markersize": 5.5, "zorder": 4}
        for k, edge in enumerate(("drop_high", "drop_low")):
            if at.any():
                ax.plot(x[at], branch[edge].values[at] * 1e3, color="#7B2D8B", label="" if k else words, **style)
    ax.set(xlabel=label, ylabel="drop power (mW)")
    ax.set_ylim(bottom=0)
    ax.legend(frameon=False, fontsize="small")
    return ax


def _axis(branch: xr.Dataset, name: str) -> tuple[float, str]:
    """Factor and label of the parameter's axis."""
    if name == "detuning":
        return 1e-9, "detuning (GHz)"
    if name == "power":
        return 1e3, "power (mW)"
    values, unit = readable(branch[name].values, branch[name].attrs.get("units", "1").removeprefix("1"))
    largest = np.argmax(np.abs(values))
    return float(values[largest] / branch[name].values[largest]), f"{name} ({unit})" if unit else name
