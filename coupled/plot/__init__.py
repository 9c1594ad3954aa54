"""Figures of fits and circuits; those of curves, maps and runs have files of their own."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from thermofem.checks import choice
from thermofem.data.variables import contents, label
from thermofem.plot import CYCLE, INK, WIDTH, axes as new_axes

from ..identification.identify import Identification
from ..sweeps.fit_transmission import TransmissionFit
from .curves import HEAT, LEGEND, dbm, leaves, plot_bode, plot_branch, plot_transmission
from .maps import plot_map, plot_maps
from .runs import plot_sweep, plot_traces

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
RUN = "a Dataset of coupled.simulate of a circuit"


def plot_identification(found: Identification, axes: Sequence[Axes] | None = None) -> np.ndarray:
    """Draw the measured mean cycle of every trace and that of the model; the titles have drive and both periods.

    found: from `identify`.
    axes: one for each trace; a new column of them by default.
    """
    cycles = found.cycles
    errors = found.residuals
    n = cycles.sizes["trace"]
    signal_unit = str(cycles["drop"].attrs.get("units", "W"))
    unit, label = (1e3, "drop power (mW)") if signal_unit == "W" else (1.0, f"drop signal ({signal_unit})")
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
        by_power = "power" in sweep.variables
        name, scale, label = ("power", 1e3, "power (mW)") if by_power else ("detuning", 1e-9, "detuning (GHz)")
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
        drive = "" if by_power else f"{dbm(np.asarray(sweep.attrs['power'])):.1f} dBm, "
        residual = float(np.sqrt(np.mean(sweep["residual"].values ** 2)))
        ax.set_title(f"{drive}residual {residual:.2g} of noise and step", fontsize="small", loc="left")
    column[0].legend(**LEGEND)
    return column


def plot_rings(run: xr.Dataset, name: str = "delta_T", ax: Axes | None = None) -> Axes:
    """Draw one quantity of every ring of a circuit against time (us): a panel for each, or all in given Axes."""
    choice("name", name, [str(k) for k in run.data_vars if "ring" in run[k].dims])
    run = contents("run", run, ("time", "ring", name), what=RUN)
    return _lines(ax, run[name], "ring", label(run[name], name))


def plot_ports(run: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the power (mW) at every port of a circuit against time (us): a panel for each, or all in given Axes."""
    run = contents("run", run, ("time", "port", "output"), what=RUN)
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
