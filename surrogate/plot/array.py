"""Pictures of the thermal model of several rings: size and delay of the crosstalk."""

from __future__ import annotations

from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm

from thermofem.plot import BLUE, INK, VERMILION, axes, takes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..arrays.array import ArrayReduction


def plot_crosstalk(array: ArrayReduction, ax: Axes | None = None) -> Axes:
    """Steady rise of every ring (rows) per watt in every input (columns), in K/mW, colours logarithmic."""
    takes("array", array, "crosstalk", "positions", what="the result of surrogate.reduce_array")
    ax = axes(ax)
    matrix = array.crosstalk / 1e3
    picture = ax.imshow(matrix, cmap="magma_r", norm=LogNorm(vmin=matrix.min() / 2, vmax=matrix.max()), aspect="equal")
    if matrix.size <= 64:
        luma = picture.to_rgba(matrix)[..., :3] @ (0.299, 0.587, 0.114)  # ITU-R BT.601
        for (i, j), value in np.ndenumerate(matrix):
            colour = "white" if luma[i, j] < 0.5 else INK
            ax.text(j, i, f"{value:.2g}", ha="center", va="center", fontsize="small", color=colour)
    ax.set_xticks(range(len(array.model.inputs)), array.model.inputs, rotation=60, ha="right", fontsize="small")
    ax.set_yticks(range(array.rings), array.model.outputs, fontsize="small")
    ax.set(xlabel="heated", ylabel="read")
    ax.figure.colorbar(picture, ax=ax, label="steady rise (K/mW)")
    return ax


def plot_time_scales(array: ArrayReduction, ax: Axes | None = None) -> Axes:
    """Step of every pair against time (us), relative to its own end; dots where half of it is reached."""
    takes("array", array, "crosstalk", "positions", what="the result of surrogate.reduce_array")
    ax = axes(ax)
    between = np.linalg.norm(array.positions[:, None] - array.positions, axis=-1)
    first = np.unique(np.round(between, 12), return_index=True)[1]
    times = np.geomspace(1e-8, 1e-3, 200)
    for k, index in enumerate(first[:: max(1, first.size // 8)]):
        i, j = np.unravel_index(index, between.shape)
        channel = array.channel(int(j), int(i))
        share = k / max(1, min(first.size, 8) - 1)
        colour = VERMILION if k == 0 else plt.get_cmap("viridis")(0.85 * share)
        name = "own ring" if k == 0 else f"{between[i, j] * 1e6:.3g} µm"
        ax.plot(times * 1e6, channel.step_response(times) / channel.thermal_resistance, color=colour, label=name)
        ax.plot(array.half_times[i, j] * 1e6, 0.5, "o", color=colour, markersize=4)
    ax.axhline(0.5, color=BLUE, linewidth=0.5, linestyle=":")
    ax.set(xscale="log", xlabel="time (µs)", ylabel="rise / steady rise", xlim=(1e-2, 1e3))
    ax.xaxis.set_major_formatter("{x:g}")
    ax.legend(frameon=False, fontsize="small", title="distance")
    return ax
