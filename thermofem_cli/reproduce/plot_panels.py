"""Every panel of the report by name; each is drawn into figures/<name>.svg."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt

from . import plot_heat, plot_maps
from .plot_heat import figure_of
from .store import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NEWTON, SECOND = "Newton, the paper's", "second order"
PANELS: dict[str, Callable[[Mapping[str, Result]], Axes]] = {
    "fig3a": plot_heat.decay,
    "fig3b": plot_heat.lifetime,
    "fig4a": partial(plot_maps.regime_map, model=NEWTON),
    "fig4b": partial(plot_maps.frequency_map, model=NEWTON),
    "fig4c": partial(plot_maps.traces, lines=plot_maps.NEWTON_LINES),
    "fig4d": plot_maps.newton_fits,
    "fig5a": plot_heat.pulse,
    "fig5b": plot_heat.heating,
    "fig6a": partial(plot_maps.regime_map, model=SECOND),
    "fig6a_frequency": partial(plot_maps.frequency_map, model=SECOND),
    "fig6b_frequency": partial(plot_maps.bars, what="frequency"),
    "fig6b_duty": partial(plot_maps.bars, what="duty"),
    "fig6c": partial(plot_maps.traces, lines=plot_maps.SECOND_LINES),
    "fig7": plot_heat.period_points,
    "period_models": plot_heat.period_models,
    "fem_map": partial(plot_maps.regime_map, model="FEM"),
    "fem_frequency": partial(plot_maps.frequency_map, model="FEM"),
    "reduction_map": partial(plot_maps.regime_map, model="reduction"),
    "reduction_frequency": partial(plot_maps.frequency_map, model="reduction"),
    "other_traces": partial(plot_maps.traces, lines=plot_maps.OTHER_LINES),
    "overlaps": plot_maps.overlaps,
    "cost": plot_maps.cost,
    "stacks_explained": plot_maps.stacks,
    "square": plot_heat.square,
    "traces": plot_maps.centre_traces,
}


def draw(name: str, results: Mapping[str, Result]) -> bytes:
    """The panel as an SVG file: letters as outlines, so that it looks the same everywhere, and no date in it."""
    with plt.rc_context({"svg.fonttype": "path", "svg.hashsalt": name, "font.size": 9.5}):
        figure, buffer = figure_of(PANELS[name](results)), io.BytesIO()
        figure.savefig(buffer, format="svg", dpi=200, metadata={"Date": None})
        plt.close(figure)
    return buffer.getvalue()
