"""Figures of runs, circuits and fits; those of curves and maps have files of their own."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from thermofem.checks import InputError, choice
from thermofem.data import quantity
from thermofem.data.variables import contents, label
from thermofem.plot import CYCLE, GREEN, INK, ORANGE, PURPLE, WIDTH, axes as new_axes, readable

from ..identification.identify import Identification
from ..sweeps.fit_transmission import TransmissionFit
from .curves import (
    HEAT,
    LASER,
    LEGEND,
    LIGHT,
    OUTPUTS,
    dbm,
    joined,
    leaves,
    lit_port,
    plot_bode,
    plot_branch,
    plot_transmission,
)  # fmt: skip
from .maps import plot_map, plot_maps

__all__ = [
    "plot_bode",
    "plot_branch",
    "plot_identification",
    "plot_map",
    "plot_maps",
    "plot_ports",
    "plot_rings",
    "plot_sweep",
    "plot_traces",
    "plot_transmission",
    "plot_transmission_fit",
]

SIGNALS = {"W": "mW", "1": "of the input"}  # units of the axis for those of a signal
OF_CIRCUIT = "a Dataset of coupled.simulate of a circuit"
RUN = "a Dataset of coupled.simulate or coupled.cosimulate; plot_rings and plot_ports draw that of a circuit"
OTHERS = (GREEN, PURPLE, ORANGE)
RUN_OUTPUTS = {
    "drop": "drop power",
    "through": "through power",
    "absorbed": "absorbed power",
    "delta_T": "temperature rise",
}


def plot_identification(found: Identification, axes: Sequence[Axes] | None = None) -> np.ndarray:
    """Draw the measured mean cycle of every trace and that of the model; the titles have drive and both periods.

    found: from `identify`.
    axes: one for each trace; a new column of them by default.
    """
    cycles = found.cycles
    errors = found.residuals
    n = cycles.sizes["trace"]
    signal_unit = str(cycles["drop"].attrs.get("units", "W"))
    unit, label = OUTPUTS["drop"] if signal_unit == "W" else (1.0, f"drop signal ({signal_unit})")
    column = np.atleast_1d(new_axes(axes, (WIDTH, 2.2 * n + 0.4), n, sharey=signal_unit == "W"))
    for k, ax in enumerate(column):
        trace = cycles.isel(trace=k)
        fit = errors.isel(trace=k)
        first = int(trace["drop"].values.argmin())  # the cycle begins where the drop power is lowest
        phase = trace["phase"].values
        measured = np.roll(trace["drop"].values, -first) * unit
        model = np.roll(trace["drop_model"].values, -first) * unit
        ax.plot(phase, measured, color=INK, linewidth=2.4, alpha=0.45, label="measured")
        ax.plot(phase, model, color=HEAT, linewidth=1.3, label="model")
        drive = f"{dbm(fit['power'].values):.0f} dBm, {float(fit['detuning']) * 1e-9:.0f} GHz"
        periods = f"{float(fit['period']) * 1e9:.0f} ns, model {float(fit['period_model']) * 1e9:.0f} ns"
        ax.set_title(f"{drive}\n{periods}", fontsize="small")
        ax.set(xlabel="fraction of the period", xlim=(0, 1))
    column[0].set_ylabel(label)
    column[0].legend(**LEGEND)
    return column


def plot_transmission_fit(found: TransmissionFit, axes: Sequence[Axes] | None = None) -> np.ndarray:
    """Draw the samples of every sweep as dots and the fitted curve with its baseline through them.

    found: from `fit_transmission`.
    axes: one for each sweep; a new column of them by default.
    Returns: the Axes, shape (sweeps,).
    """
    count = len(found.samples)
    column = np.atleast_1d(new_axes(axes, (WIDTH, 2.0 * count + 0.4), count))
    for ax, sweep, curve in zip(column, found.samples, found.curves, strict=True):
        name = "power" if "power" in sweep.variables else "detuning"
        scale, label = LASER[name]
        unit = str(sweep["signal"].attrs["units"])
        factor = 1e3 if unit == "W" else 1.0
        shown = SIGNALS.get(unit, unit)
        x = curve[name].values * scale
        y = curve["signal"].values * factor
        ends = leaves(x, y)
        swept = sweep[name].values * scale
        ax.plot(swept, sweep["signal"] * factor, ".", color=INK, markersize=3, alpha=0.5, label="measured")
        ax.plot(np.insert(x, ends, np.nan), np.insert(y, ends, np.nan), color=HEAT, linewidth=1.2, label="fitted")
        margin = 0.02 * np.ptp(swept)
        ax.set(xlabel=label, ylabel=f"{sweep.attrs['port']} ({shown})")
        ax.set_xlim(swept.min() - margin, swept.max() + margin)
        drive = f"{dbm(np.asarray(sweep.attrs['power'])):.1f} dBm, " if name == "detuning" else ""
        residual = float(np.sqrt(np.mean(sweep["residual"].values ** 2)))
        ax.set_title(f"{drive}residual {residual:.2g} of noise and step", fontsize="small", loc="left")
    column[0].legend(**LEGEND)
    return column


def plot_rings(run: xr.Dataset, name: str = "delta_T", ax: Axes | None = None) -> Axes:
    """Draw one quantity of every ring of a circuit against time (us): a panel for each, or all in given Axes."""
    choice("name", name, [str(k) for k in run.data_vars if "ring" in run[k].dims])
    run = contents("run", run, ("time", "ring", name), what=OF_CIRCUIT)
    return _lines(ax, run[name], "ring", label(run[name], name))


def plot_ports(run: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the power (mW) at every port of a circuit against time (us): a panel for each, or all in given Axes."""
    run = contents("run", run, ("time", "port", "output"), what=OF_CIRCUIT)
    return _lines(ax, run["output"] * 1e3, "port", "power (mW)")


def _lines(ax: Axes | None, values: xr.DataArray, over: str, label: str) -> Axes:
    """Draw a line against time (us) for every ring or port, in panels with a common scale; return the first panel."""
    names = values[over].values
    if ax is None:
        every = np.atleast_1d(new_axes(None, (WIDTH, 0.9 + 1.1 * names.size), names.size, sharex=True, sharey=True))
        every[0].figure.supylabel(label, fontsize="medium")
    else:
        every = np.array([ax] * names.size)
        ax.set(ylabel=label)
    for k, (one, panel) in enumerate(zip(names, every, strict=True)):
        panel.plot(values["time"] * 1e6, values.sel({over: one}), color=CYCLE[k % len(CYCLE)], label=str(one), lw=1)
        panel.legend(**LEGEND, loc="upper left", bbox_to_anchor=(1.0, 1.0))
        panel.margins(x=0)
    every[-1].set(xlabel="time (µs)")
    return every[0]


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
        column = new_axes(None, (WIDTH, sum(heights)), len(heights), height_ratios=heights, sharex=True)
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
    choice("show", show, RUN_OUTPUTS)
    run = contents("run", run, ("time", "drop", show), what=RUN)
    swept = [name for name in ("detuning", "input_power") if name in run and np.ptp(run[name].values) > 0]
    if not swept:
        raise InputError("run has a constant laser; a sweep needs a detuning or power that varies")
    ax = new_axes(ax, (5.4, 3.6))
    x, x_unit = readable(run[swept[0]].values, "Hz" if swept[0] == "detuning" else "W")
    y, y_unit = readable(run[show].values, "K" if show == "delta_T" else "W")
    first = _switched(run["time"].values)  # before it the light follows no detuning yet
    x = x[first:]
    y = y[first:]
    rising = np.append(np.diff(x) >= 0, np.diff(x)[-1] >= 0)
    for direction, part, colour in (("upwards", rising, HEAT), ("downwards", ~rising, LIGHT)):
        if part.any():
            ax.plot(x, np.where(joined(part), y, np.nan), label=direction, color=colour, linewidth=1.1, alpha=0.9)
    ax.set(
        xlabel=f"{'detuning' if swept[0] == 'detuning' else 'power'} ({x_unit})",
        ylabel=f"{RUN_OUTPUTS[show]} ({y_unit})",
    )
    ax.set_xlim(x.min(), x.max())
    ax.set_ylim(0, 1.05 * y.max() or None)
    ax.legend(**LEGEND)
    ax.spines[["top", "right"]].set_visible(False)
    return ax
