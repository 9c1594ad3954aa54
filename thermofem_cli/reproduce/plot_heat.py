"""Panels on heat and carriers: Figs. 3, 5 and 7. Each is one small picture that reads on a phone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np

from thermofem import checks
from thermofem.plot import BLUE, GREEN, INK, ORANGE, PURPLE, SKY, VERMILION, plot_field
from thermofem.waveforms import from_json

from .carrier_stages import WINDOWS
from .heat_stages import PULSE
from .store import Result

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE = (4.6, 3.3)  # inches: at 390 px a letter is still 9 px high
COLOURS = {
    "FEM": INK,
    "Newton": VERMILION,
    "Newton, the paper's": VERMILION,
    "second order": BLUE,
    "second order, the paper's": SKY,
    "SINDy": GREEN,
    "reduction": PURPLE,
}
DASHES = {
    "Newton": "--",
    "Newton, the paper's": "--",
    "second order, the paper's": "-.",
    "SINDy": ":",
    "reduction": "-",
}


def panel(size: tuple[float, float] = SIZE) -> Axes:
    """A new panel."""
    _, ax = plt.subplots(figsize=size, layout="constrained")
    return ax


def figure_of(ax: Axes) -> Figure:
    """The figure of a panel."""
    figure = ax.get_figure(root=True)
    if figure is None:
        raise checks.InputError("a panel belongs to no figure")
    return figure


def decay(results: Mapping[str, Result]) -> Axes:
    """Fig. 3(a): carriers after a pulse, and the two slopes."""
    ax, result = panel(), results["carriers"]
    for name, words, style in (("printed", "as printed", "-"), ("exchanged", "exchanged", "--")):
        data = result.data[name]
        time, N = data["time"].values * 1e9, data["carriers"].values * 1e-6
        ax.semilogy(time, N, style, color=INK if style == "-" else VERMILION, label=f"lifetimes {words}")
        if name == "exchanged":
            for which, colour in (("slow", SKY), ("fast", ORANGE)):
                tau, window = result.numbers[name][f"{which}_s"] * 1e9, WINDOWS[which]
                middle = 1e9 * (window[0] + window[1]) / 2
                ax.semilogy(
                    time, np.interp(middle, time, N) * np.exp(-(time - middle) / tau), color=colour, linewidth=0.9,
                    label=f"τ = {tau:.0f} ns",
                )  # fmt: skip
            ax.set_ylim(N.min() / 2, 2 * N.max())
    ax.set(xlabel="time after the pump pulse (ns)", ylabel="excess carriers (cm$^{-3}$)", xlim=(0, 300))
    return _legend(ax)


def lifetime(results: Mapping[str, Result]) -> Axes:
    """Fig. 3(b): instantaneous lifetime against carrier density."""
    ax = panel()
    for name, words, style, colour in (
        ("printed", "lifetimes as printed", "-", INK),
        ("exchanged", "lifetimes exchanged", "--", VERMILION),
    ):
        data = results["carriers"].data[name]
        ax.semilogx(data["carriers"].values * 1e-6, data["lifetime"].values * 1e9, style, color=colour, label=words)
    ax.axhspan(20, 60, color=SKY, alpha=0.15, linewidth=0, label="the paper's bounds")
    ax.set(xlabel="excess carriers (cm$^{-3}$)", ylabel="carrier lifetime (ns)", ylim=(0, 70))
    return _legend(ax, loc="lower right")


def pulse(results: Mapping[str, Result]) -> Axes:
    """Fig. 5(a): 2 mW for 20 us, exponentials through rise and fall, the field at 21 us."""
    ax, numbers = panel((4.6, 3.9)), results["pulse"].numbers
    data, rise = results["pulse"].data["pulse"], results["pulse"].models["rise"]
    ax.plot(data["time"] * 1e6, data["delta_T"], color=INK, linewidth=2.2, label="finite elements")
    on, off = np.linspace(0, PULSE, 300), np.linspace(0, PULSE, 600)
    label = f"one exponential: {numbers['rise_tau_s'] * 1e9:.0f} ns"
    ax.plot(on * 1e6, rise.response(from_json(data.attrs["waveform"]), on), "--", color=VERMILION, label=label)
    tau, amplitude = np.array(numbers["fall_tau_s"]), np.array(numbers["fall_amplitude_K"])
    label = f"two: {tau[0] * 1e9:.0f} and {tau[1] * 1e9:.0f} ns"
    ax.plot((PULSE + off) * 1e6, np.exp(-off[:, None] / tau) @ amplitude, "-.", color=BLUE, label=label)
    ax.set(xlabel="time (µs)", ylabel="mean rise of the core (K)", xlim=(0, 40), ylim=(0, 17))
    inset = ax.inset_axes((0.62, 0.40, 0.27, 0.52))
    plot_field(data, inset, half_width=3.5e-6)
    for triangles in inset.collections:
        triangles.set_rasterized(True)  # thousands of them
    for axes in (inset, *inset.child_axes):
        axes.tick_params(labelsize="x-small")
        axes.xaxis.label.set_fontsize("x-small")
        axes.yaxis.label.set_fontsize("x-small")
    figure_of(ax).legend(loc="outside upper left", ncols=2, frameon=False, fontsize="small", columnspacing=1.0)
    return ax


def heating(results: Mapping[str, Result]) -> Axes:
    """Fig. 5(b): the FEM under the heat of self-pulsing, and one and two poles."""
    ax, result = panel((4.6, 3.9)), results["heating"]
    data, numbers = result.data["elements"], result.numbers
    wave, n = from_json(data.attrs["waveform"]), data["time"].size
    time = np.concatenate([k * data["time"].values[-1] + data["time"].values for k in range(3)]) * 1e6
    ax.plot(time[::12], np.tile(data["delta_T"].values, 3)[::12], "s", color=INK, markersize=3.4, label="FEM")
    lines = {
        "one_pole": ("--", VERMILION, f"ODE1 (1): c$_p$, {numbers['one_pole_tau_s'] * 1e9:.0f} ns"),
        "paper_pair": ("-", VERMILION, "ODE1 (2): 6.9 c$_p$, 417 ns"),
        "second_order": ("-", BLUE, "ODE2, fitted"),
        "paper_second_order": (":", GREEN, "ODE2, the paper's set"),
    }
    for name, (style, colour, label) in lines.items():
        ax.plot(time, np.tile(result.models[name].periodic_response(wave, n), 3), style, color=colour, label=label)
    ax.set(xlabel="time (µs)", ylabel="mean rise of the core (K)", xlim=(0, time[-1]), ylim=(0, None))
    figure_of(ax).legend(loc="outside upper left", ncols=2, frameon=False, fontsize="small", columnspacing=1.0)
    return ax


def square(results: Mapping[str, Result]) -> Axes:
    """The periodic state under a 1 us square wave, and the models trained on it."""
    ax, data, models = panel((4.6, 3.7)), results["squares"].data["1us"], results["training"].models
    wave, n = from_json(data.attrs["waveform"]), data["time"].size
    time = np.concatenate([k + data["time"].values * 1e6 for k in range(3)])
    ax.plot(time[::6], np.tile(data["delta_T"].values, 3)[::6], "s", color=INK, markersize=3, label="FEM")
    lines = {"newton_1us": ("--", VERMILION, "Newton"), "second_order_1us": ("-", BLUE, "second order"),
             "sindy": (":", GREEN, "SINDy")}  # fmt: skip
    for name, (style, colour, label) in lines.items():
        ax.plot(time, np.tile(models[name].periodic_response(wave, n), 3), style, color=colour, label=label)
    ax.set(xlabel="time (µs)", ylabel="mean rise of the core (K)", xlim=(0, 3), ylim=(0, None))
    figure_of(ax).legend(loc="outside upper left", ncols=4, frameon=False, fontsize="small", columnspacing=1.0)
    return ax


def period_points(results: Mapping[str, Result]) -> Axes:
    """Fig. 7: absolute and relative period error of the second-order equation, and the points of two rings."""
    ax, curve = panel((4.6, 3.6)), results["periods"].data["second_order"]
    time = curve["period"].values * 1e6
    ax.axhline(0, color=INK, linewidth=0.5)
    ax.plot(time, curve["error"].values * 1e6, color=VERMILION, label="trained at 1 µs, error in µs")
    ax.plot(time, curve["relative_error"], "--", color=VERMILION, linewidth=1, label="the same over the period")
    for name, marker, colour in (("low", "s", INK), ("high", "D", BLUE)):
        data = results["rings"].data[name]
        label = f"FEM-coupled ring, Q = {data.attrs['loaded_q']:.0f}"
        ax.plot(data["period"] * 1e6, data["error"] * 1e6, marker, color=colour, markersize=3.5, label=label)
    lowest = 1e6 * min(result["error"].values.min(initial=0) for result in results["rings"].data.values())
    bottom = min(-0.5, lowest - 0.1)
    ax.set(xlabel="period (µs)", ylabel="period error (µs, or share)", xlim=(0.2, 4.6), ylim=(bottom, 2.0))
    return _legend(ax)


def period_models(results: Mapping[str, Result]) -> Axes:
    """Period error of every model, 0.1 to 10 us."""
    ax = panel()
    ax.axhspan(-10, 10, color=SKY, alpha=0.15, linewidth=0)
    for curve in results["periods"].data.values():
        name = curve.attrs["model"]
        error = np.where(np.isfinite(curve["relative_error"]), 100 * curve["relative_error"], np.nan)
        style = DASHES.get(name, "-")
        ax.plot(curve["period"] * 1e6, error, style, color=COLOURS[name], linewidth=1.6, label=name)
    ax.set(xscale="log", xlabel="period of the FEM (µs)", ylabel="period error (%)", xlim=(0.1, 10), ylim=(-80, 80))
    ax.xaxis.set_major_formatter("{x:g}")
    ax.text(0.11, 11, "within 10 %", fontsize="x-small", color=INK)
    return _legend(ax, loc="lower right")


def _legend(ax: Axes, loc: Any = "best") -> Axes:
    ax.legend(frameon=False, fontsize="small", loc=loc)
    return ax
