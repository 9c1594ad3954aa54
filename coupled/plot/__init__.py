"""Figures of fits; those of curves, maps, runs and circuits have files of their own."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from thermofem.data.variables import contents
from thermofem.plot import INK, WIDTH
from thermofem.plot import axes as new_axes

from ..identification.identify import Identification
from .curves import HEAT, dbm, plot_branch, plot_transmission
from .maps import plot_map, plot_maps
from .runs import plot_sweep, plot_traces

__all__ = [
    "plot_branch",
    "plot_carrier_decay",
    "plot_identification",
    "plot_map",
    "plot_maps",
    "plot_newton_traces",
    "plot_sweep",
    "plot_traces",
    "plot_transmission",
]


def plot_identification(found: Identification, axes: Sequence[Axes] | None = None) -> np.ndarray:
    """Draw the measured mean cycle of every trace and the model's over it, each with its drive and the two periods.

    found: from `identify`.
    axes: one for each trace; a new column of them by default.
    """
    cycles, errors = found.cycles, found.residuals
    n, given = cycles.sizes["trace"], str(cycles["drop"].attrs.get("units", "W"))
    unit, label = (1e3, "drop power (mW)") if given == "W" else (1.0, f"drop signal ({given})")
    column = np.atleast_1d(new_axes(axes, (WIDTH, 2.2 * n + 0.4), n, sharey=given == "W"))
    for k, ax in enumerate(column):
        one, at = cycles.isel(trace=k), errors.isel(trace=k)
        first = int(one["drop"].values.argmin())  # the cycle begins where the drop power is lowest
        phase = one["phase"].values
        measured, model = (np.roll(one[name].values, -first) * unit for name in ("drop", "drop_model"))
        ax.plot(phase, measured, color=INK, linewidth=2.4, alpha=0.45, label="measured")
        ax.plot(phase, model, color=HEAT, linewidth=1.3, label="model")
        drive = f"{dbm(at['power'].values):.0f} dBm, {float(at['detuning']) * 1e-9:.0f} GHz"
        periods = f"{float(at['period']) * 1e9:.0f} ns, model {float(at['period_model']) * 1e9:.0f} ns"
        ax.set_title(f"{drive}\n{periods}", fontsize="small")
        ax.set(xlabel="fraction of the period", xlim=(0, 1))
    column[0].set_ylabel(label)
    column[0].legend(frameon=False, fontsize="small")
    return column


def plot_newton_traces(found: xr.Dataset, ax: Axes | None = None, *, reference: float | None = None) -> Axes:
    """Draw heat capacity against lifetime of Newton's law, a dot for each trace, coloured by its period.

    found: from `fit_newton_per_trace`.
    reference [J/K]: heat capacity m c_p to divide by; without it the axis is in pJ/K.
    """
    what = "a Dataset of coupled.identification.newton_traces.fit_newton_per_trace"
    dims = ("tau_th", "heat_capacity", "period")
    found = contents("found", found, dims, what=what)
    slope, intercept, correlation = (found.attrs[name] for name in ("slope", "intercept", "correlation"))
    ax = new_axes(ax, (4.6, 3.4))
    unit = reference or 1e-12
    tau, capacity = found["tau_th"].values * 1e9, found["heat_capacity"].values / unit
    ends = np.array([np.nanmin(tau), np.nanmax(tau)])
    line = (slope * ends * 1e-9 + intercept) / unit
    ax.plot(ends, line, color="#777777", linewidth=1, zorder=1)
    dots = ax.scatter(tau, capacity, c=found["period"].values * 1e9, cmap="viridis", s=22, edgecolor="white", lw=0.4)
    ax.figure.colorbar(dots, ax=ax, label="period (ns)")
    label = "heat capacity / (m c$_{p,ref}$)" if reference else "heat capacity (pJ/K)"
    ax.set(xlabel="thermal lifetime (ns)", ylabel=label)
    if np.isfinite(correlation):
        ax.set_title(f"correlation {correlation:.2f}", fontsize="small", loc="left")
    return ax


def plot_carrier_decay(decay: xr.Dataset, axes: Sequence[Axes] | None = None) -> np.ndarray:
    """Draw a carrier decay with the exponentials of its first and last lifetime, and the lifetime against density.

    decay: from `carrier_decay`.
    """
    dims = ("time", "carriers", "lifetime")
    decay = contents("decay", decay, dims, what="a Dataset of coupled.carriers.carrier_decay")
    left, right = new_axes(axes, (WIDTH, 5.6), 2)
    t, N, tau = (decay[name].values for name in ("time", "carriers", "lifetime"))
    left.semilogy(t * 1e9, N * 1e-6, color=INK, linewidth=1.6)
    for at, where, dash in ((0, "first", "--"), (-1, "last", ":")):
        line = N[at] * np.exp(-(t - t[at]) / tau[at]) * 1e-6
        label = f"{where} lifetime, {tau[at] * 1e9:.0f} ns"
        left.semilogy(t * 1e9, line, color=HEAT, linestyle=dash, linewidth=1.2, label=label)
    left.legend(frameon=False, fontsize="small", loc="lower left")
    left.set(xlabel="time (ns)", ylabel="carrier density (cm$^{-3}$)", xlim=(t[0] * 1e9, t[-1] * 1e9))
    left.set_ylim(0.6 * N[-1] * 1e-6, 1.6 * N[0] * 1e-6)
    right.semilogx(N * 1e-6, tau * 1e9, color=INK, linewidth=1.6)
    right.set(xlabel="carrier density (cm$^{-3}$)", ylabel="lifetime (ns)")
    return np.array([left, right])
