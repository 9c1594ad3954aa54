"""Figures that need more than one package."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np

from ..plot import BLUE, GREEN, INK, VERMILION, plot_field, save_figure
from ..waveforms import SquareWave, from_json

if TYPE_CHECKING:
    from .reproduce import Results


def pulse_figure(results: Results, path: Path) -> None:
    """Fig. 5(a): 2 mW for 20 us, one exponential through the rise, two through the fall, the field at 21 us."""
    data, rise, fall = results.data["pulse"], results.fits["rise"], results.fits["fall"]
    _, ax = plt.subplots(figsize=(7.2, 4.2), layout="constrained")
    time = data["time"].values
    ax.plot(time * 1e6, data["delta_T"], color=INK, linewidth=2.2, label="finite elements")
    on, off = np.linspace(0, 20e-6, 300), np.linspace(0, 20e-6, 600)
    wave = from_json(data.attrs["waveform"])
    tau = f"{rise.parameters['tau_th'] * 1e9:.0f} ns"
    ax.plot(
        on * 1e6, rise.model.response(wave, on), color=VERMILION, linestyle="--", label=f"one exponential, τ = {tau}"
    )
    names = f"τ = {fall.tau[0] * 1e9:.0f} and {fall.tau[1] * 1e9:.0f} ns"
    ax.plot(20 + off * 1e6, fall(off), color=BLUE, linestyle="-.", label=f"two exponentials, {names}")
    ax.set(xlabel="time (µs)", ylabel="mean rise of the core (K)", xlim=(0, 40), ylim=(0, None))
    ax.legend(loc="upper left", bbox_to_anchor=(0.0, 1.16), ncols=3, frameon=False, fontsize="small", columnspacing=1.2)
    inset = ax.inset_axes((0.60, 0.42, 0.30, 0.48))
    plot_field(data, inset, half_width=3.5e-6)
    for axes in (inset, *inset.child_axes):
        axes.tick_params(labelsize="x-small")
    save_figure(ax, path)


def square_figure(results: Results, path: Path) -> None:
    """Fig. 5(b): the periodic state under a 1 us square wave, and what Newton's law and Eq. 3 make of it."""
    data = results.data["square_1us"]
    wave: SquareWave = from_json(data.attrs["waveform"])
    _, ax = plt.subplots(figsize=(7.2, 4.0), layout="constrained")
    time, rise = data["time"].values * 1e6, data["delta_T"].values
    n = rise.size

    def three(y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[:-1], y[:-1], y])

    cycles = np.concatenate([time[:-1], 1 + time[:-1], 2 + time])
    for k in range(3):
        ax.axvspan(
            k,
            k + wave.on_time * 1e6,
            color="#f2f2f2",
            zorder=0,
            edgecolor="#bbbbbb",
            linewidth=0.5,
            label="heated" if k == 0 else None,
        )
    ax.plot(cycles[::6], three(rise)[::6], "s", color=INK, markersize=3.6, label="finite elements")
    newton, second = results.fits["newton"], results.fits["second_order"]
    p = newton.parameters
    values = f"{p['tau_th'] * 1e9:.0f} ns, {p['heat_capacity_ratio']:.1f} c$_p$"
    label = f"Newton, fitted: {values} ({newton.residual:.2f} K rms)"
    ax.plot(cycles, three(newton.model.periodic_response(wave, n)), color=VERMILION, linestyle="--", label=label)
    label = f"second order, fitted ({second.residual:.2f} K rms)"
    ax.plot(cycles, three(second.model.periodic_response(wave, n)), color=BLUE, label=label)
    published = results.models["second order, paper, FEM"]
    ax.plot(
        cycles,
        three(published.periodic_response(wave, n)),
        color=GREEN,
        linestyle=":",
        label="second order, the paper's set",
    )
    ax.set(xlabel="time (µs)", ylabel="mean rise of the core (K)", xlim=(0, 3), ylim=(0, 13))
    ax.legend(loc="upper center", ncols=2, framealpha=1, edgecolor="none", fontsize="small")
    save_figure(ax, path)


def traces_figure(results: Results, path: Path) -> None:
    """Drop power and temperature of every model over three microseconds of the settled state, one row a model."""
    n = len(results.runs)
    _, axes = plt.subplots(n, 2, figsize=(8.4, 1.35 * n + 0.7), sharex=True, sharey="col", layout="constrained")
    for (name, run), row in zip(results.runs.items(), axes, strict=True):
        window, found = _last_cycles(run["carriers"].values, run["time"].values, 3e-6), results.pulsing[name]
        time = (run["time"].values[window] - run["time"].values[window][0]) * 1e6
        row[0].plot(time, run["drop"].values[window] * 1e3, color=BLUE, linewidth=1.2)
        row[1].plot(time, run["delta_T"].values[window], color=VERMILION, linewidth=1.2)
        period = f"period {found.period * 1e9:.0f} ns" if np.isfinite(found.period) else str(found.regime)
        row[0].set_title(f"{name}: {period}", fontsize="small", loc="left")
    axes[0, 0].set(xlim=(0, 3), ylim=(0, None))
    for column, label in enumerate(("drop power (mW)", "temperature rise (K)")):
        axes[-1, column].set_xlabel("time since a pulse of the settled state (µs)")
        axes[n // 2, column].set_ylabel(label)
    save_figure(axes[0, 0], path)


def period_figure(results: Results, path: Path) -> None:
    """Fig. 7: period error of the models trained at 1 us against the FEM."""
    from surrogate.plot import plot_period_error

    _, ax = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    plot_period_error(results.curves, ax)
    save_figure(ax, path)


def _last_cycles(carriers: np.ndarray, time: np.ndarray, length: float) -> slice:
    """The last ``length`` seconds that begin where the carriers rise through their middle."""
    late = time > time[-1] / 2
    middle = (carriers[late].max() + carriers[late].min()) / 2
    begin = int(np.searchsorted(time, time[-1] - length - 1.6e-6))
    up = np.flatnonzero((carriers[begin:-1] < middle) & (carriers[begin + 1 :] >= middle))
    start = begin + (int(up[0]) if up.size else 0)
    return slice(start, int(np.searchsorted(time, time[start] + length)) + 1)
