"""Figs. 4(a, b) and 6(a, b): where the ring pulses over power and detuning, with every temperature equation."""

import numpy as np
from matplotlib.patheffects import withStroke

import coupled
from coupled.plot import plot_map
from thermofem.plot import BLUE, INK, VERMILION

from .printed import COLOURS, DETUNINGS, EXPERIMENT_SET, MAP_RUN, MARKED, NEWTON_MAPS, POWERS, RING, panel, slug
from .report.study import OTHER, PAPER, Result, figure, study

FAR = 0.4  # error of the frequency that a border or doubled cycles make, and nothing else does
NEWTON = "Newton, the paper's"


def models_of(elements, training, second_order_fit):
    """Every thermal model with the ring it belongs to, in the order of the report."""
    return {
        NEWTON: (RING.with_lumped_fcd(), NEWTON_MAPS), "second order, the paper's": (RING, EXPERIMENT_SET),
        "second order": (RING, second_order_fit.models["second_order"]), "SINDy": (RING, training.models["sindy"]),
        "reduction": (RING, elements.models["reduction"]),
    }


@study("maps: the FEM", 4)
def reference(elements, periods):
    """The map of the FEM-coupled ring, which the maps of the models are held against."""
    found = drawn(RING, elements.models["elements"])
    low, high = periods.numbers["second order"]["within_10_percent_s"]
    period = found["period"].values[found["regime"].values == "self-pulsing"]
    numbers = compared(found, found) | {"in_range": np.mean((period >= low) & (period <= high))}
    return Result(numbers, {"map": found.assign_attrs(model="FEM")})


@study("Figs. 4 and 6: maps", 20)
def maps(elements, training, second_order_fit, reference):
    """Figs. 4(a, b) and 6(a, b), and maps that the paper does not have: of SINDy and the reduction."""
    cases = models_of(elements, training, second_order_fit)
    found = {name: drawn(*case) for name, case in cases.items()}
    numbers = {name: compared(data, reference.data["map"]) for name, data in found.items()}
    for name in (NEWTON, "second order, the paper's"):
        linear = coupled.stability_map(*cases[name], POWERS, DETUNINGS)["regime"] == "self-pulsing"
        numbers[name]["linear_agrees"] = float((linear == (found[name]["regime"] == "self-pulsing")).mean())
    return Result(numbers, {slug(name): data.assign_attrs(model=name) for name, data in found.items()})


def drawn(ring, model):
    """Where and how a ring with a model pulses, over the plane of the paper."""
    return coupled.pulsing_map(ring, model, POWERS, DETUNINGS, duration=MAP_RUN).drop_vars("reason")


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

    return {
        "overlap": coupled.maps.pulsing_map.overlap(data, fem), "points": int(pulses.size),
        "frequency_error": [float(frequency.mean()), float(frequency.std())],
        "duty_error": [float(duty.mean()), float(duty.std())],
        "far_off": {"blue": int((frequency > FAR).where(blue).sum()), "red": int((frequency > FAR).where(red).sum())},
        "frequency_error_median": float(frequency.median()),
        "shorter_cycles": float((data["duty"] < fem["duty"]).where(both).mean()),
        "slow_transients": int((data["regime"] == "slow transient").sum()), "duty_median": float(data["duty"].median()),
        "frequency_median_Hz": float(rate.median()), "frequency_min_Hz": float(rate.min()),
        "frequency_max_Hz": float(rate.max()), "blue_share": float(pulses.where(blue, drop=True).mean()),
        "red_share": float(pulses.where(red, drop=True).mean()),
        "highest_detuning_Hz": float(data["detuning"].where(pulses).max()),
        "slower_to_the_blue": falling("detuning", 1), "faster_with_power": falling("power", -1),
    }


def regime_map(data, fem=None, loop=None):
    """Where the ring pulses: with the border of the FEM's region, or the points with the FEM in the loop."""
    ax = panel()
    plot_map(data, "regime", ax)
    handles, runs = ax.get_legend_handles_labels()[0], []
    key = ax.get_legend()
    if key is not None:
        handles = list(key.legend_handles)
        for handle, text in zip(handles, key.get_texts(), strict=True):
            handle.set_label(text.get_text())
        key.remove()
    if loop is not None:
        ghz, dbm = np.meshgrid(loop["detuning"].values * 1e-9, 10 * np.log10(loop["power"].values * 1e3))
        pulses = loop["regime"].values == "self-pulsing"
        style = {"color": INK, "markersize": 4, "linestyle": "none", "marker": "o"}
        runs = ax.plot(ghz[pulses], dbm[pulses], label="FEM in the loop pulses", **style)
        runs += ax.plot(ghz[~pulses], dbm[~pulses], label="it does not", fillstyle="none", **style)
    legend = {"loc": "outside upper left", "ncols": 3, "frameon": False, "fontsize": "small"}
    ax.figure.legend(handles=[*handles, *runs], **legend)  # beside the map, which has something to say in every corner
    if fem is not None:
        ghz, dbm = fem["detuning"].values * 1e-9, 10 * np.log10(fem["power"].values * 1e3)
        border = (fem["regime"].values == "self-pulsing").astype(float)
        ax.contour(ghz, dbm, border, levels=[0.5], colors=[INK], linewidths=1.2)
        ax.annotate("line: border of the FEM's", (0.02, 0.02), xycoords="axes fraction", fontsize="x-small", color=INK,
                    bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5})  # fmt: skip
        numbered(ax)
    return ax


def frequency_map(data):
    """How fast, on one colour scale for all models."""
    ax = panel()
    plot_map(data, "frequency", ax, limits=(0.4, 2.6))
    return numbered(ax)


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
    ax.legend(frameon=False, fontsize="small", loc="upper left", markerscale=2)
    return ax


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
    ax.barh(list(share), list(share.values()), color=[COLOURS[name] for name in share], height=0.6)
    for k, value in enumerate(share.values()):
        style = {"va": "center", "ha": "right", "fontsize": "small", "color": "white", "weight": "bold"}
        ax.text(value - 1.5, k, f"{value:.1f} %", **style)
    for value, words in ((41, "41 % Newton"), (89, "89 % Eq. 3")):
        ax.axvline(value, color=INK, linewidth=0.9, linestyle=":")
        ax.annotate(words, (value, 1.01), xycoords=("data", "axes fraction"), ha="center", fontsize="x-small")
    ax.set(xlim=(0, 100), xlabel="share of points that agree (%); dotted: the paper")
    ax.xaxis.label.set_fontsize("small")
    return ax


PAPER.update({
    "reference/frequency_median_Hz": (0.7e6, 1.4e6), "reference/frequency_min_Hz": (0.3e6, 0.5e6),
    "reference/slower_to_the_blue": (75e-2, 100e-2), "reference/faster_with_power": (75e-2, 100e-2),
    "reference/blue_share": (66e-2, 100e-2), "reference/red_share": (5e-2, 100e-2),
    "reference/duty_median": (0.2, 0.35), "reference/in_range": (100e-2, 100e-2),
    "maps/Newton, the paper's/overlap": (36e-2, 46e-2), "maps/Newton, the paper's/red_share": (60e-2, 100e-2),
    "maps/Newton, the paper's/blue_share": (0, 2e-2), "maps/Newton, the paper's/duty_median": (0.1, 0.18),
    "maps/second order/overlap": (86e-2, 92e-2), "maps/Newton, the paper's/frequency_error/0": (6e-2, 20e-2),
    "maps/second order/frequency_error/0": (0, 15e-2), "maps/Newton, the paper's/duty_error/0": (50e-2, 70e-2),
    "maps/second order/duty_error/0": (20e-2, 40e-2),
})
OTHER.update({
    "maps/second order, the paper's/linear_agrees": (98.6e-2, 100e-2),
    "maps/Newton, the paper's/linear_agrees": (93.2e-2, 95.2e-2),
    "maps/second order, the paper's/duty_median": (0.285, 0.295),
    "maps/Newton, the paper's/duty_median": (0.145, 0.155),
})
