"""Pictures of circuits: rings, waveguides, lasers and detectors; and traces of several rings."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle

from thermofem.checks import choice
from thermofem.data.variables import contents, label
from thermofem.plot import BLUE, CYCLE, GREEN, INK, PURPLE, SIZE, VERMILION, WIDTH, axes

from ..circuit import Circuit

RUN = "a Dataset of coupled.simulate"
PITCH, RADIUS, BUS = 2.4, 0.7, 0.85  # distance and size of the rings, and height of the buses above and below
_SIDES = {"in": (-0.75, -BUS), "through": (0.75, -BUS), "add": (0.75, BUS), "drop": (-0.75, BUS)}
_SPLITTER = {"in 1": (-0.4, -0.2), "in 2": (-0.4, 0.2), "out 1": (0.4, -0.2), "out 2": (0.4, 0.2)}


def plot_circuit(circuit: Circuit, ax: Axes | None = None) -> Axes:
    """The circuit as a drawing: rings in a row on their two buses, arrows for light from terminal to terminal."""
    ax = axes(ax, (max(WIDTH, 1.2 * (len(circuit.names) + len(circuit.splitters)) + 2.1), 2.4))
    at: dict[str, tuple[float, float]] = {}
    for k, name in enumerate(circuit.names):
        ax.add_patch(Circle((k * PITCH, 0), RADIUS, fill=False, linewidth=2, color=INK))
        ax.text(k * PITCH, 0, name, ha="center", va="center", fontsize="small")
        for side, (x, y) in _SIDES.items():
            at[f"{name}.{side}"] = (k * PITCH + x, y)
        for low, rate in ((-BUS, 1.0), (BUS, circuit.rings[name].drop_bus_rate)):
            if rate:
                ax.plot([k * PITCH - 0.75, k * PITCH + 0.75], [low, low], color=INK, linewidth=1)
    for k, splitter in enumerate(circuit.splitters, len(circuit.names)):
        ax.add_patch(Rectangle((k * PITCH - 0.4, -0.35), 0.8, 0.7, fill=False, color=INK))
        ax.text(k * PITCH, 0, splitter.name, ha="center", va="center", fontsize="small")
        at |= {f"{splitter.name}.{side}": (k * PITCH + x, y) for side, (x, y) in _SPLITTER.items()}
    for way in circuit.waveguides:
        _arrow(ax, at[way.start], at[way.stop], BLUE if way.delay == 0 else PURPLE)
        if way.delay:
            x, y = np.mean([at[way.start], at[way.stop]], axis=0)
            ax.text(x + 0.25, y, f"{way.delay * 1e9:.3g} ns", color=PURPLE, fontsize="small", va="center")
    for laser in circuit.lasers:
        x, y = at[laser.stop]
        _outside(ax, laser.name, (x, y), VERMILION, inward=True)
    for name, exit in circuit.outputs.items():
        _outside(ax, name, at[exit], GREEN, inward=False)
    ax.set_xlim(-2.0, max(x for x, _ in at.values()) + 1.4)
    ax.set_ylim(-1.5, 1.5)
    ax.set_aspect("equal")
    ax.axis("off")
    return ax


def _arrow(ax: Axes, start: tuple[float, float], stop: tuple[float, float], colour: str) -> None:
    straight = abs(start[1] - stop[1]) < 1e-9
    style = "arc3,rad=0" if straight else "arc3,rad=0.35"
    ax.add_patch(FancyArrowPatch(start, stop, arrowstyle="-|>", mutation_scale=9, connectionstyle=style, color=colour))


def _outside(ax: Axes, name: str, place: tuple[float, float], colour: str, *, inward: bool) -> None:
    """An arrow from or to the outside, with the name at its end, on the side on which the terminal lies."""
    x, y = place
    left = (x % PITCH) > PITCH / 2
    end = (x - 0.5 if left else x + 0.5, y)
    first, last = (end, place) if inward else (place, end)
    ax.add_patch(FancyArrowPatch(first, last, arrowstyle="-|>", mutation_scale=9, color=colour))
    ax.text(end[0], y + (0.14 if y > 0 else -0.14), name, color=colour, fontsize="small", ha="center",
            va="bottom" if y > 0 else "top")  # fmt: skip


def plot_rings(run: xr.Dataset, name: str = "delta_T", ax: Axes | None = None) -> Axes:
    """One quantity of every ring against time (us): a panel for each, or all in given Axes."""
    choice("name", name, [str(k) for k in run.data_vars if "ring" in run[k].dims])
    run = contents("run", run, ("time", "ring", name), what=RUN)
    return _lines(ax, run[name], "ring", label(run[name], name))


def plot_ports(run: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Power (mW) at every port against time (us): a panel for each, or all in given Axes."""
    run = contents("run", run, ("time", "port", "output"), what=RUN)
    return _lines(ax, run["output"] * 1e3, "port", "power (mW)")


def _lines(ax: Axes | None, values: xr.DataArray, over: str, label: str) -> Axes:
    """A line against time (us) for every ring or port, in panels of one scale, of which the first is returned.

    Pulses of several rings in one panel cover each other.
    """
    names = values[over].values
    if ax is None:
        # further lines share the eighth panel
        panels = min(names.size, 8)
        column = np.atleast_1d(axes(None, (SIZE[0], 0.9 + 1.1 * panels), panels, sharex=True, sharey=True))
        every = [column[min(k, panels - 1)] for k in range(names.size)]
        every[0].figure.supylabel(label, fontsize="medium")
    else:
        every = [axes(ax)] * names.size
        every[0].set(ylabel=label)
    for k, (one, panel) in enumerate(zip(names, every, strict=True)):
        panel.plot(values["time"] * 1e6, values.sel({over: one}), color=CYCLE[k % len(CYCLE)], label=str(one), lw=1)
    for panel in dict.fromkeys(every):
        beside = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)} if ax is None else {}
        panel.legend(frameon=False, fontsize="small", **beside)
        panel.margins(x=0)
    every[-1].set(xlabel="time (µs)")
    return every[0]
