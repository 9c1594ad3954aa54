"""Panels on self-pulsing: Figs. 4 and 6, and the same with models that the paper did not have."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patheffects import withStroke

from coupled.parameters import borghi2021 as paper
from coupled.plot import plot_map
from thermofem.plot import BLUE, GREEN, INK, ORANGE, PURPLE, VERMILION

from .plot_heat import COLOURS, figure_of, panel
from .pulsing_stages import label
from .settings import MARKED
from .stack_stages import CORE, STATED
from .store import Result

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

WINDOW = 2.6e-6  # s, of the traces
STACK_LINES = (
    ("period", "period 0.75, 0.85 µs"),
    ("frequency", "0.7, 1.4 MHz over the plane"),
    ("tau_th", "417 ns ± 5 %"),
    ("heat_capacity", "6.9 c_p ± 5 %"),
)


def map_of(results: Mapping[str, Result], model: str) -> xr.Dataset:
    """The map of a model."""
    if model == "FEM":
        return results["reference"].data["map"]
    return next(data for data in results["maps"].data.values() if data.attrs["model"] == model)


def regime_map(results: Mapping[str, Result], model: str) -> Axes:
    """Where the ring pulses, the FEM's border over it."""
    ax, data = panel(), map_of(results, model)
    plot_map(data, "regime", ax)
    runs = [] if model != "FEM" else _loop(ax, results["loop_map"].data["elements"])
    key = ax.get_legend()
    if key is not None:  # beside the map, which has something to say in every corner
        handles = [handle for handle in key.legend_handles if handle is not None] + runs
        names = [text.get_text() for text in key.get_texts()] + [str(line.get_label()) for line in runs]
        key.remove()
        figure_of(ax).legend(handles, names, loc="outside upper left", ncols=3, frameon=False, fontsize="small")
    if model != "FEM":
        _border(ax, map_of(results, "FEM"))
        _points(ax)
    return ax


def _loop(ax: Axes, loop: xr.Dataset) -> list[Line2D]:
    """The points that ran with the FEM in the loop, filled where they pulse."""
    ghz, dbm = np.meshgrid(loop["detuning"].values * 1e-9, 10 * np.log10(loop["power"].values * 1e3))
    pulses = loop["regime"].values == "self-pulsing"
    style: dict[str, Any] = {"color": INK, "markersize": 4, "linestyle": "none", "marker": "o"}
    (does,) = ax.plot(ghz[pulses], dbm[pulses], label="FEM in the loop pulses", **style)
    (rests,) = ax.plot(ghz[~pulses], dbm[~pulses], label="it does not", fillstyle="none", **style)
    return [does, rests]


def frequency_map(results: Mapping[str, Result], model: str) -> Axes:
    """Maps of the period, on one colour scale for all models."""
    ax = panel()
    plot_map(map_of(results, model), "frequency", ax, limits=(0.4, 2.6))
    _points(ax)
    return ax


def _border(ax: Axes, fem: xr.Dataset) -> None:
    """Outline of where the FEM-coupled ring pulses."""
    pulses = (fem["regime"].values == "self-pulsing").astype(float)
    dbm = 10 * np.log10(fem["power"].values * 1e3)
    ax.contour(fem["detuning"].values * 1e-9, dbm, pulses, levels=[0.5], colors=[INK], linewidths=1.2)
    ax.plot([], [], color=INK, linewidth=1.2, label="FEM")
    ax.annotate("line: border of the FEM's", (0.02, 0.02), xycoords="axes fraction", fontsize="x-small", color=INK,
                bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5})  # fmt: skip


def _points(ax: Axes) -> None:
    for k, (dbm, ghz) in enumerate(MARKED, 1):
        text = ax.annotate(f"({k})", (ghz, dbm), ha="center", va="center", fontsize="x-small", color=INK)
        text.set_path_effects([withStroke(linewidth=2, foreground="white")])


def traces(results: Mapping[str, Result], lines: Mapping[str, tuple[str, str, str]]) -> Axes:
    """Drop traces at the marked points, one row each: the FEM in the loop in black, models over it."""
    _, axes = plt.subplots(len(MARKED), 1, figsize=(4.6, 4.6), sharex=True, layout="constrained")
    for k, (ax, point) in enumerate(zip(axes, MARKED, strict=True), 1):
        name = label(point)
        _trace(ax, results["loop"].data[name], color=INK, linewidth=2.0, label="FEM in the loop")
        for data in results["marked"].data.values():
            if data.attrs["point"] == name and data.attrs["model"] in lines:
                style, colour, words = lines[data.attrs["model"]]
                _trace(ax, data, linestyle=style, color=colour, linewidth=1.2, label=words)
        ax.set_title(f"({k})  {point[0]:g} dBm, {point[1]:g} GHz", fontsize="small", loc="left")
        ax.set(xlim=(0, WINDOW * 1e6), ylim=(0, 1.08), yticks=(0, 0.5, 1))
    axes[1].set_ylabel("drop power over its maximum")
    axes[-1].set_xlabel("time (µs)")
    handles, names = axes[0].get_legend_handles_labels()
    axes[0].figure.legend(handles, names, loc="outside upper left", ncols=2, frameon=False, fontsize="small")
    return axes[0]


def _trace(ax: Axes, run: xr.Dataset, **style: object) -> None:
    """The end of a run from a rise of the carriers on, over the drop power's maximum."""
    time, N, drop = (run[name].values for name in ("time", "carriers", "drop"))
    late = time >= time[-1] - 2 * WINDOW
    time, N, drop = time[late], N[late], drop[late]
    up = np.flatnonzero((N[:-1] < N.max() / 2) & (N[1:] >= N.max() / 2))
    up = up[time[up] <= time[-1] - WINDOW]
    start = time[up[-1]] if up.size else time[-1] - WINDOW
    ax.plot((time - start) * 1e6, drop / drop.max(), **style)  # type: ignore[arg-type]


def centre_traces(results: Mapping[str, Result]) -> Axes:
    """Drop power of every model at (8 dBm, 0 GHz), one row each."""
    result = results["traces"]
    runs = list(result.data.values())
    _, axes = plt.subplots(len(runs), 1, figsize=(4.6, 0.75 * len(runs) + 0.6), sharex=True, layout="constrained")
    for ax, run in zip(axes, runs, strict=True):
        name = run.attrs["model"]
        _trace(ax, run, color=BLUE, linewidth=1.3)
        ax.set_title(f"{name}: {result.numbers[name]['period_s'] * 1e9:.0f} ns", fontsize="small", loc="left")
        ax.set(xlim=(0, WINDOW * 1e6), ylim=(0, 1.1), yticks=(0, 1))
    axes[len(runs) // 2].set_ylabel("drop power over its maximum")
    axes[-1].set_xlabel("time (µs)")
    return axes[0]


def newton_fits(results: Mapping[str, Result]) -> Axes:
    """Fig. 4(d): what Newton's law needs at every point, and the pair that the paper uses in Fig. 5."""
    ax, data = panel(), results["newton_fits"].data["newton"]
    tau, period = data["tau_th"].values * 1e9, data["period"].values * 1e9
    ratio = data["heat_capacity"].values / paper.HEAT_CAPACITY
    dots = ax.scatter(tau, ratio, c=period, s=36, cmap="viridis", edgecolor=INK, linewidth=0.4)
    ax.figure.colorbar(dots, ax=ax, label="period (ns)")
    fit = paper.NEWTON_FIT
    ax.plot(fit.tau_th * 1e9, fit.heat_capacity / paper.HEAT_CAPACITY, "*", color=VERMILION, markersize=11)
    ax.annotate("the paper\n(8 dBm, 0 GHz)", (fit.tau_th * 1e9, 6.9), xytext=(6, 4), textcoords="offset points",
                fontsize="x-small", color=VERMILION)  # fmt: skip
    ax.set(xlabel="thermal lifetime τ$_{th}$ (ns)", ylabel="c$_p$ over silicon's", ylim=(0, 9.5))
    return ax


def bars(results: Mapping[str, Result], what: str) -> Axes:
    """Fig. 6(b): frequency or duty cycle at every FEM-in-the-loop point, model against FEM."""
    ax, fem = panel((4.6, 3.4)), map_of(results, "FEM")
    shown = {"second order": (BLUE, "o"), "Newton, the paper's": (VERMILION, "x")}
    factor, words = (1e-6, "frequency (MHz)") if what == "frequency" else (1.0, "duty cycle")
    for name, (colour, marker) in shown.items():
        own = map_of(results, name)
        x, y = ((1 / m["period"] if what == "frequency" else m["duty"]).values.ravel() * factor for m in (fem, own))
        ax.plot(x, y, marker, color=colour, markersize=2.4, alpha=0.55, linestyle="none", label=name)
    top = 2.7 if what == "frequency" else 0.85
    ax.plot([0, top], [0, top], color=INK, linewidth=0.8)
    ax.set(xlim=(0, top), ylim=(0, top), xlabel=f"{words}, FEM-coupled", ylabel=f"{words}, model")
    ax.set_aspect("equal")
    ax.legend(frameon=False, fontsize="small", loc="upper left", markerscale=2)
    return ax


def overlaps(results: Mapping[str, Result]) -> Axes:
    """Share of the map on which each model agrees with the FEM-coupled ring, and the paper's two numbers."""
    numbers, ax = results["maps"].numbers, panel((4.6, 3.0))
    names = list(numbers)[::-1]
    ax.barh(names, [100 * numbers[n]["overlap"] for n in names], color=[COLOURS[n] for n in names], height=0.6)
    for k, name in enumerate(names):
        ax.text(100 * numbers[name]["overlap"] - 1.5, k, f"{100 * numbers[name]['overlap']:.1f} %", va="center",
                ha="right", fontsize="small", color="white", fontweight="bold")  # fmt: skip
    for value, words in ((41, "41 % Newton"), (89, "89 % Eq. 3")):
        ax.axvline(value, color=INK, linewidth=0.9, linestyle=":")
        ax.annotate(words, (value, 1.01), xycoords=("data", "axes fraction"), ha="center", fontsize="x-small")
    ax.set(xlim=(0, 100), xlabel="share of points that agree (%); dotted: the paper")
    ax.xaxis.label.set_fontsize("small")
    return ax


def cost(results: Mapping[str, Result]) -> Axes:
    """Error of the period at (8 dBm, 0 GHz) against the cost of a simulated microsecond."""
    ax = panel()
    markers = dict(zip(results["cost"].numbers, "sv^oDP", strict=False))
    for name, row in results["cost"].numbers.items():
        ax.semilogy(row["seconds_per_us"] * 1e3, 100 * abs(row["period_error"]), markers[name], color=COLOURS[name],
                  markersize=8, label=name)  # fmt: skip
    ax.set(xlabel="CPU time per simulated µs (ms)", ylabel="error of the period (%)")
    ax.set_xlim(0, 1.5 * max(row["seconds_per_us"] for row in results["cost"].numbers.values()) * 1e3)
    figure_of(ax).legend(loc="outside upper left", ncols=2, frameon=False, fontsize="small", columnspacing=1.0)
    return ax


NEWTON_LINES = {
    "Newton, the paper's": ("--", VERMILION, "Model 1: c$_p$, 275 ns"),
    "Newton, fitted to this trace": ("-", ORANGE, "Model 2: fitted c$_p$, τ$_{th}$"),
}
SECOND_LINES = {"second order": ("-", BLUE, "second order")}
OTHER_LINES = {"SINDy": ("-.", GREEN, "SINDy"), "reduction": ("--", PURPLE, "reduction")}


def stacks(results: Mapping[str, Result]) -> Axes:
    """Worst statement of the paper over both oxide thicknesses at the best conductivity; one line a statement."""
    ax, result = panel(), results["stacks_explained"]
    data = result.data["stacks"]
    box, above = data["box"].values * 1e6, (data["oxide"].values - CORE) * 1e6
    worst = data["worst"].min("conductivity").transpose("oxide", "box").values
    drawn = ax.contourf(box, above, worst, levels=np.arange(0.8, 3.1, 0.2), cmap="Greys_r", extend="both")
    figure_of(ax).colorbar(drawn, ax=ax, label="worst statement / half of its range")
    silica = data.interp(conductivity=1.38)
    for (name, words), colour in zip(STACK_LINES, (BLUE, GREEN, VERMILION, ORANGE), strict=True):
        lines = ax.contour(box, above, silica[name].transpose("oxide", "box").values, STATED[name], colors=colour)
        if any(np.size(path.vertices) for path in lines.get_paths()):
            ax.plot([], [], color=colour, label=words)
    best = result.numbers["nearest"]
    ax.plot(best["box"] * 1e6, best["oxide"] * 1e6, "*", color="white", mec=INK, ms=13, clip_on=False, zorder=5)
    figure_of(ax).legend(loc="outside upper left", ncols=2, frameon=False, fontsize="small")
    ax.set(xlabel="buried oxide (µm)", ylabel="oxide above the core (µm)")
    return ax
