"""Figures of single runs: traces against time, with what drives them, and sweeps against detuning or power."""

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from thermofem.checks import InputError, choice
from thermofem.data import quantity
from thermofem.data.variables import contents
from thermofem.plot import GREEN, ORANGE, PURPLE, WIDTH, axes, readable

from .curves import HEAT, LEGEND, LIGHT, joined, lit_port

RUN = "a Dataset of coupled.simulate or coupled.cosimulate; plot_rings and plot_ports draw that of a circuit"
OTHERS = (GREEN, PURPLE, ORANGE)
OUTPUTS = {
    "drop": "drop power",
    "through": "through power",
    "absorbed": "absorbed power",
    "delta_T": "temperature rise",
}


def plot_traces(run: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the drop power, of a ring on one bus the through power, and the temperature rise against time.

    In a figure of its own each has a panel; the drop power of other resonances has one below, and so have laser power,
    heater powers and detuning where they vary.
    In given Axes the temperature rise has the right axis.

    run: from `simulate` or `cosimulate`.
    ax: drawn into, without panels below; a new figure by default.
    Returns: the Axes with the power.
    """
    run = contents("run", run, ("time", "drop", "delta_T"), what=RUN)
    t, time_unit = readable(run["time"].values, "s")
    port = lit_port(run)
    output, power_unit = readable(run[port].values, "W")
    if ax is None:
        drives = _drives(run)
        heights = [1.9, 1.9, *(1.2 for _ in drives)]
        column = axes(None, (WIDTH, sum(heights)), len(heights), height_ratios=heights, sharex=True)
        style: Any = "-"
        ax, right, *further = column
        for panel, (label, curves) in zip(further, drives, strict=True):
            _draw_drive(panel, t, label, curves)
        column[-1].set_xlabel(f"time ({time_unit})")
        right.spines["right"].set_visible(False)
        ax.spines["right"].set_visible(False)
        column[0].figure.align_ylabels(column)
        ax.set_title(_title(run), fontsize="small", loc="left")
    else:
        right = ax.twinx()
        style = (0, (5, 1))
        ax.set_xlabel(f"time ({time_unit})")
    ax.plot(t, output, color=LIGHT, linewidth=1.1)
    ax.set_ylabel(f"{port} power ({power_unit})", color=LIGHT)
    ax.set_xlim(t[0], t[-1])
    late = output[_switched(t) :]
    ax.set_ylim(0, 1.05 * float(late[np.isfinite(late)].max(initial=0.0)) or None)
    right.plot(t, run["delta_T"].values, color=HEAT, linewidth=1.1, linestyle=style)
    right.set_ylabel("temperature rise (K)", color=HEAT)
    right.set_ylim(bottom=0)
    for one in (ax, right):
        one.spines["top"].set_visible(False)
    return ax


def _title(run: xr.Dataset) -> str:
    """Return the title: name of the ring, and power and detuning where they are constant."""
    held = ((name, unit) for name, unit in (("input_power", "W"), ("detuning", "Hz")) if name in run.attrs)
    return ", ".join(
        [str(run.attrs.get("ring", "")), *(quantity.rounded(run.attrs[name], unit) for name, unit in held)]
    )


def _switched(t: np.ndarray) -> int:
    """Return the index after the transient of the switch-on, a thousandth of the run; 0 if sampled coarsely."""
    with np.errstate(invalid="ignore"):  # times of any origin: at least two samples are left
        # in the first thousandth of a run the light that was switched on rings
        return max(int(np.argmax(t - t[0] >= 1e-3 * (t[-1] - t[0]))) - 1, 0)


def _drives(run: xr.Dataset) -> list[tuple[str, dict[str, np.ndarray]]]:
    """Return label and curves (SI, by name) of each further panel: other resonances, and inputs that vary in time."""
    powers: dict[str, np.ndarray] = {}
    if "input_power" in run and np.ptp(run["input_power"].values) > 0:
        powers["laser"] = run["input_power"].values
    if "heater_power" in run:
        for name in run["heater"].values:
            one = run["heater_power"].sel(heater=name).values
            if np.ptp(one) > 0:
                powers[str(name)] = one
    panels = []
    if "probe_drop" in run:
        names = [f"{at / 1e12:.3f} THz" for at in run["resonance"].values]
        panels.append(("probe power", dict(zip(names, run["probe_drop"].values, strict=True))))
    if powers:
        panels.append(("power", powers))
    if "detuning" in run and np.ptp(run["detuning"].values) > 0:
        panels.append(("detuning", {"laser": run["detuning"].values}))
    return panels


def _draw_drive(ax: Axes, t: np.ndarray, label: str, curves: dict[str, np.ndarray]) -> None:
    """Draw one panel of inputs that vary in time, or of the drop power of other resonances."""
    unit = "Hz" if label == "detuning" else "W"
    together, shown = readable(np.concatenate(list(curves.values())), unit)
    colours = (LIGHT, *OTHERS)
    for k, (name, values) in enumerate(zip(curves, np.split(together, len(curves)), strict=True)):
        colour = colours[(k + (name != "laser" and "laser" not in curves)) % len(colours)]
        ax.plot(t, values, color=colour, linewidth=1.1, label=name)
    ax.set_ylabel(f"{label} ({shown})" if len(label) < 10 else f"{label}\n({shown})")
    if label != "detuning":
        ax.set_ylim(bottom=0)
        ax.legend(**LEGEND, loc="center left", bbox_to_anchor=(1.0, 0.5))
    ax.spines[["top", "right"]].set_visible(False)


def plot_sweep(run: xr.Dataset, show: str | None = None, ax: Axes | None = None) -> Axes:
    """Draw one output of a run against the detuning or power that is swept, with the direction of every stretch.

    run: from `simulate` with a detuning or power that varies; the detuning counts where both do.
    show: "drop", "through", "absorbed" or "delta_T"; by default "drop", "through" of a ring on one bus.
    Raises InputError: nothing is swept, or an unknown name.
    """
    show = show or lit_port(run)
    choice("show", show, OUTPUTS)
    run = contents("run", run, ("time", "drop", show), what=RUN)
    swept = [name for name in ("detuning", "input_power") if name in run and np.ptp(run[name].values) > 0]
    if not swept:
        raise InputError("run has a constant laser; a sweep needs a detuning or power that varies")
    ax = axes(ax, (5.4, 3.6))
    x, x_unit = readable(run[swept[0]].values, "Hz" if swept[0] == "detuning" else "W")
    y, y_unit = readable(run[show].values, "K" if show == "delta_T" else "W")
    first = _switched(run["time"].values)  # before it the light follows no detuning yet
    x = x[first:]
    y = y[first:]
    rising = np.append(np.diff(x) >= 0, np.diff(x)[-1] >= 0)
    for label, part, colour in (("upwards", rising, HEAT), ("downwards", ~rising, LIGHT)):
        if part.any():
            ax.plot(x, np.where(joined(part), y, np.nan), label=label, color=colour, linewidth=1.1, alpha=0.9)
    ax.set(
        xlabel=f"{'detuning' if swept[0] == 'detuning' else 'power'} ({x_unit})", ylabel=f"{OUTPUTS[show]} ({y_unit})"
    )
    ax.set_xlim(x.min(), x.max())
    ax.set_ylim(0, 1.05 * y.max() or None)
    ax.legend(**LEGEND)
    ax.spines[["top", "right"]].set_visible(False)
    return ax
