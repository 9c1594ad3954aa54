"""Figures of fits and equilibria; those of maps are in `plot.maps`, of runs in `plot.runs`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np

from thermofem.checks import InputError, choice, finite, mapping, numbers
from thermofem.data.variables import contents
from thermofem.plot import GREEN, INK, PURPLE, WIDTH
from thermofem.plot import axes as new_axes

from .axes import HEAT, LIGHT, dbm, draw_stability
from .maps import plot_map, plot_maps
from .runs import plot_sweep, plot_traces

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

    from ..identification.identify import Identification

__all__ = [
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
    if axes is None:
        size = (WIDTH, 2.2 * n + 0.4)
        _, column = plt.subplots(n, 1, figsize=size, layout="constrained", sharey=given == "W", squeeze=False)
        axes = list(column[:, 0])
    for k, ax in enumerate(axes):
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
    axes[0].set_ylabel(label)
    axes[0].legend(frameon=False, fontsize="small")
    return np.array(axes)


def plot_newton_traces(found: xr.Dataset, ax: Axes | None = None, *, reference: float | None = None) -> Axes:
    """Draw heat capacity against lifetime of Newton's law, a dot for each trace, coloured by its period.

    found: from `fit_newton_per_trace`.
    reference [J/K]: heat capacity m c_p to divide by; without it the axis is in pJ/K.
    """
    what = "a Dataset of coupled.identification.newton_traces.fit_newton_per_trace"
    dims = ("tau_th", "heat_capacity", "period")
    found = contents("found", found, dims, what=what)
    slope, intercept, correlation = (_known(found, name) for name in ("slope", "intercept", "correlation"))
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


def _known(found: xr.Dataset, name: str) -> float:
    """An attribute that must be a number; nan where too few traces pulse for a line."""
    value = found.attrs.get(name)
    return float("nan") if isinstance(value, float) and np.isnan(value) else finite(f"found.attrs[{name!r}]", value)


def plot_carrier_decay(decay: xr.Dataset, axes: Sequence[Axes] | None = None) -> np.ndarray:
    """Draw a carrier decay with the exponentials of its first and last lifetime, and the lifetime against density.

    decay: from `carrier_decay`.
    """
    dims = ("time", "carriers", "lifetime")
    decay = contents("decay", decay, dims, what="a Dataset of coupled.carriers.carrier_decay")
    if axes is None:
        _, axes = plt.subplots(2, 1, figsize=(WIDTH, 5.6), layout="constrained")
    left, right = axes
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


def plot_transmission(
    curve: xr.Dataset,
    show: str = "drop",
    ax: Axes | None = None,
    *,
    sweeps: Mapping[str, xr.Dataset] | None = None,
) -> Axes:
    """Draw one output against detuning or power: stable stretches solid, unstable ones dotted, sweeps over them.

    curve: from `transmission`.
    show: "drop", "through", "absorbed", "delta_T" or "carriers".
    sweeps [mapping of a name to a Dataset of `sweep` or of `simulate` with a swept laser]: drawn over the curve, each
        in its colour.
    """
    labels = {
        "drop": (1e3, "drop power (mW)"),
        "through": (1e3, "through power (mW)"),
        "absorbed": (1e3, "absorbed power (mW)"),
        "delta_T": (1.0, "temperature rise (K)"),
        "carriers": (1e-6, "carrier density (cm$^{-3}$)"),
    }
    choice("show", show, labels)
    dims = ("detuning", "power", "regime", show)
    curve = contents("curve", curve, dims, what="a Dataset of coupled.transmission")
    for variable in ("detuning", "power", show):
        numbers(f"curve[{variable!r}]", curve[variable].values)
    if np.ptp(curve["detuning"].values) == 0 == np.ptp(curve["power"].values):
        raise InputError("curve has one detuning and one power; a curve against one of them is needed")
    ax = new_axes(ax, (5.0, 3.4))
    unit, label = labels[show]
    by_power = np.ptp(curve["detuning"].values) == 0
    name, scale = ("power", 1e3) if by_power else ("detuning", 1e-9)
    x, y = curve[name].values * scale, curve[show].values * unit
    stable = curve["regime"].values == "stable"
    ends = _leaves(x, y)
    x, y, stable = np.insert(x, ends, np.nan), np.insert(y, ends, np.nan), np.insert(stable, ends, False)
    draw_stability(ax, x, y, stable, color=INK, labels=("stable", "unstable"))
    for (title, run), colour in zip(mapping("sweeps", sweeps).items(), cycle((LIGHT, HEAT, GREEN, PURPLE))):
        at, seen = _swept(f"sweeps[{title!r}]", run, name, show)
        ax.plot(at * scale, seen * unit, color=colour, linewidth=1.1, alpha=0.85, label=title)
    ax.set(xlabel="power (mW)" if by_power else "detuning (GHz)", ylabel=label, xlim=(np.nanmin(x), np.nanmax(x)))
    ax.set_ylim(bottom=0)
    ax.legend(frameon=False, fontsize="small")
    return ax


def _swept(name: str, run: Any, by: str, show: str) -> tuple[np.ndarray, np.ndarray]:
    """Power or detuning (``by``) of a run and what is shown of it, in SI; `simulate` calls the power input_power."""
    what = f"a Dataset of `sweep` or `simulate` whose {by} varies, as that of the curve does"
    own = [one for one in (by, f"input_{by}") if one in run.variables]
    run = contents(name, run, ((own or [by])[0], show), what=what)
    return run[own[0]].values, run[show].values


def _leaves(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Where a curve leaves the range of x and comes back at the same edge: indices to break its line before.

    The points of a curve lie at equal distances along it; a step of ten times the usual height, at an edge, is no part
    of the curve.
    """
    steps, span = np.abs(np.diff(y)), np.ptp(x)
    middle = (x[1:] + x[:-1]) / 2
    edge = np.minimum(middle - x.min(), x.max() - middle) < 0.02 * span
    return np.flatnonzero(edge & (steps > 10 * np.quantile(steps, 0.95))) + 1
