"""Figs. 4(a, b) and 6(a, b): where the ring pulses over power and detuning, with every temperature equation."""

import numpy as np
from matplotlib.patheffects import withStroke

import coupled
from coupled.maps.pulsing_map import overlap
from coupled.plot import plot_map
from thermofem.plot import BLUE, INK, VERMILION

from .printed import (
    COLOURS, DETUNINGS, EXPERIMENT_SET, MAP_RUN, MARKED, NEWTON_MAPS, POWERS, RING, legend, panel, slug
)
from .report.study import Result, figure, study

FAR = 0.4  # error of the frequency that a border makes, and nothing else does
NEWTON = "Newton, the paper's"


def models_of(elements, training, second_order_fit):
    """Every thermal model with the ring it belongs to, in the order of the report."""
    return {
        NEWTON: (RING.with_lumped_fcd(), NEWTON_MAPS), "second order, the paper's": (RING, EXPERIMENT_SET),
        "second order": (RING, second_order_fit.models["second_order"]), "SINDy": (RING, training.models["sindy"]),
        "reduction": (RING, elements.models["reduction"]),
    }


@study("maps: the FEM")
def reference(elements, periods):
    """The map of the FEM-coupled ring, which the maps of the models are held against."""
    found = drawn(RING, elements.models["elements"])
    low, high = periods.numbers["second order"]["within_10_percent_s"]
    period = found["period"].values[found["regime"].values == "self-pulsing"]
    numbers = compared(found, found) | {"in_range": np.mean((period >= low) & (period <= high))}
    return Result(numbers, {"map": found.assign_attrs(model="FEM")})


@study("Figs. 4 and 6: maps")
def maps(elements, training, second_order_fit, reference):
    """Figs. 4(a, b) and 6(a, b), and maps that the paper does not have: of SINDy and the reduction."""
    cases = models_of(elements, training, second_order_fit)
    found = {name: drawn(*case) for name, case in cases.items()}
    numbers = {name: compared(data, reference.data["map"]) for name, data in found.items()}
    for name in (NEWTON, "second order, the paper's"):
        numbers[name]["linear_agrees"] = overlap(found[name], coupled.stability_map(*cases[name], POWERS, DETUNINGS))
    return Result(numbers, {slug(name): data.assign_attrs(model=name) for name, data in found.items()})


def drawn(ring, model, powers=POWERS, detunings=DETUNINGS):
    """Where and how a ring with a model pulses, from cold, over the plane of the paper."""
    return coupled.pulsing_map(ring, model, powers, detunings, duration=MAP_RUN).drop_vars("reason")


def compared(data, fem):
    """The paper's statements about a map, and the agreement with the FEM's map."""
    pulses, blue, red = data["regime"] == "self-pulsing", data["detuning"] > 0, data["detuning"] < 0
    both, rate = pulses & (fem["regime"] == "self-pulsing"), 1 / data["period"]
    frequency = abs(fem["period"] / data["period"] - 1).where(both)
    duty = abs(data["duty"] / fem["duty"] - 1).where(both)

    def falling(over, sign):
        """Share of neighbouring pulsing points between which the frequency falls along an axis."""
        step = sign * rate.diff(over)
        return float((step < 0).sum() / max(int(np.isfinite(step).sum()), 1))

    found = {
        "overlap": overlap(data, fem), "points": pulses.size,
        "far_off": (frequency > FAR).sum(), "frequency_error_median": frequency.median(),
        "shorter_cycles": (data["duty"] < fem["duty"]).where(both).mean(), "duty_median": data["duty"].median(),
        "slow_transients": (data["regime"] == "slow transient").sum(), "frequency_median_Hz": rate.median(),
        "frequency_min_Hz": rate.min(), "frequency_max_Hz": rate.max(),
        "blue_share": pulses.where(blue, drop=True).mean(), "red_share": pulses.where(red, drop=True).mean(),
        "highest_detuning_Hz": data["detuning"].where(pulses).max(),
        "slower_to_the_blue": falling("detuning", 1), "faster_with_power": falling("power", -1),
    }
    pairs = {"frequency_error": frequency, "duty_error": duty}
    return {name: float(value) for name, value in found.items()} | {
        name: [float(error.mean()), float(error.std())] for name, error in pairs.items()
    }


def regime_map(data, fem=None, loop=None):
    """Where the ring pulses: with the border of the FEM's region, or the points with the FEM in the loop."""
    ax, over = plot_map(data, "regime", panel()), fem if loop is None else loop
    handles, words = ax.get_legend().legend_handles, [text.get_text() for text in ax.get_legend().get_texts()]
    ax.get_legend().remove()
    ghz, dbm = np.meshgrid(over["detuning"].values * 1e-9, 10 * np.log10(over["power"].values * 1e3))
    pulses = over["regime"].values == "self-pulsing"
    if loop is not None:
        for where, fill, text in ((pulses, "full", "FEM in the loop pulses"), (~pulses, "none", "it does not")):
            handles += ax.plot(ghz[where], dbm[where], "o", color=INK, markersize=4, fillstyle=fill)
            words.append(text)
    else:
        ax.contour(ghz, dbm, pulses, levels=[0.5], colors=[INK], linewidths=1.2)
        numbered(ax)
    ax.figure.legend(handles, words, loc="outside upper left", ncols=3, frameon=False, fontsize="small")
    return ax


def frequency_map(data):
    """How fast, on one colour scale for all models."""
    return numbered(plot_map(data, "frequency", panel(), limits=(0.4, 2.6)))


def numbered(ax):
    """The marked points (1), (2), (3)."""
    for k, (dbm, ghz) in enumerate(MARKED, 1):
        text = ax.annotate(f"({k})", (ghz, dbm), ha="center", va="center", fontsize="x-small", color=INK)
        text.set_path_effects([withStroke(linewidth=2, foreground="white")])
    return ax


def against(maps, reference, what, top):
    """A property at every point, model against FEM."""
    ax, words = panel(4.6, 3.4), {"frequency": "frequency (MHz)", "duty": "duty cycle"}[what]
    for name, colour, marker in (("second order", BLUE, "o"), (NEWTON, VERMILION, "x")):
        pair = (reference.data["map"], maps.data[slug(name)])
        x, y = ((1e-6 / data["period"] if what == "frequency" else data["duty"]).values.ravel() for data in pair)
        ax.plot(x, y, marker, color=colour, markersize=2.4, alpha=0.55, linestyle="none", label=name)
    ax.plot([0, top], [0, top], color=INK, linewidth=0.8)
    ax.set(xlim=(0, top), ylim=(0, top), xlabel=f"{words}, FEM-coupled", ylabel=f"{words}, model", aspect="equal")
    return legend(ax, "upper left")


figure(lambda maps, reference: regime_map(maps.data[slug(NEWTON)], reference.data["map"]), "fig4a")
figure(lambda maps: frequency_map(maps.data[slug(NEWTON)]), "fig4b")
figure(lambda maps, reference: regime_map(maps.data["second_order"], reference.data["map"]), "fig6a")
figure(lambda maps: frequency_map(maps.data["second_order"]), "fig6a_frequency")
figure(lambda reference, loop_map: regime_map(reference.data["map"], loop=loop_map.data["elements"]), "fem_map")
figure(lambda reference: frequency_map(reference.data["map"]), "fem_frequency")
figure(lambda maps, reference: regime_map(maps.data["reduction"], reference.data["map"]), "reduction_map")
figure(lambda maps: frequency_map(maps.data["reduction"]), "reduction_frequency")
figure(lambda maps, reference: against(maps, reference, "frequency", 2.7), "fig6b_frequency")
figure(lambda maps, reference: against(maps, reference, "duty", 0.85), "fig6b_duty")


@figure
def overlaps(maps):
    ax, share = panel(4.6, 3.0), {name: 100 * maps.numbers[name]["overlap"] for name in reversed(maps.numbers)}
    bars = ax.barh(list(share), list(share.values()), color=[COLOURS[name] for name in share], height=0.6)
    ax.bar_label(bars, fmt="%.1f %%", padding=-42, color="white", weight="bold", fontsize="small")
    for value, words in ((41, "41 % Newton"), (89, "89 % Eq. 3")):
        ax.axvline(value, color=INK, linewidth=0.9, linestyle=":")
        ax.annotate(words, (value, 1.01), xycoords=("data", "axes fraction"), ha="center", fontsize="x-small")
    ax.set(xlim=(0, 100), xlabel="points that agree (%); dotted: the paper")
    return ax
