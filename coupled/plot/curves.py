"""Figures of curves of fixed points, of cycles and of linear rings; units of axes and styles that all figures share."""

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from thermofem.checks import choice, mapping, text
from thermofem.data import quantity
from thermofem.data.variables import contents
from thermofem.plot import (
    BLUE as LIGHT,
    CYCLE,
    GREEN,
    INK,
    PURPLE,
    VERMILION as HEAT,
    WIDTH,
    axes,
    axes as new_axes,
    readable,
)

MARKS = {"fold": ("s", "fold of cycles"), "period doubling": ("D", "period doubling"), "torus": ("^", "torus"),
         "Hopf": ("o", "Hopf point")}  # fmt: skip
BRANCH = "a Dataset of coupled.continue_cycle"
LEGEND: dict[str, Any] = {"frameon": False, "fontsize": "small"}
LASER = {"power": (1e3, "power (mW)"), "detuning": (1e-9, "detuning (GHz)")}  # from SI to what is drawn, and its label
OUTPUTS = {
    "drop": (1e3, "drop power (mW)"),
    "through": (1e3, "through power (mW)"),
    "absorbed": (1e3, "absorbed power (mW)"),
    "delta_T": (1.0, "temperature rise (K)"),
    "carriers": (1e-6, "carrier density (cm$^{-3}$)"),
}


def dbm(power: np.ndarray) -> np.ndarray:
    """Return a power in W as dBm."""
    return 10 * np.log10(power * 1e3)


def curves_over(name: str, given: Any, needed: Sequence[str], *, what: str) -> list[Any]:
    """Return the curves drawn over a figure as a list, in SI, with the needed variables; one alone is accepted."""
    several = [given] if hasattr(given, "variables") else given
    return [contents(f"{name}[{k}]", curve, needed, what=what) for k, curve in enumerate(several)]


def joined(part: np.ndarray) -> np.ndarray:
    """Extend each True stretch of a mask by one point, so that lines of different styles meet."""
    return part | np.concatenate([part[:1], part[:-1]])


def draw_stability(
    ax: Axes, x: np.ndarray, y: np.ndarray, stable: np.ndarray, *, color: str, labels: tuple[str, str]
) -> None:
    """Draw a line, solid where stable and dotted elsewhere; ``labels`` name the two styles in the legend."""
    if stable.any():
        ax.plot(x, np.where(joined(stable), y, np.nan), color=color, linewidth=1.4, label=labels[0])
    if not stable.all():
        dots = (0, (1, 1.5))
        ax.plot(x, np.where(stable, np.nan, y), color=color, linewidth=1.2, linestyle=dots, label=labels[1])


def lit_port(run: Any) -> str:
    """Return "drop", or "through" for the Dataset of a ring on one bus, at whose drop port there is no light."""
    variables = getattr(run, "variables", ())
    dark = "drop" not in variables or not np.any(run["drop"].values)
    return "through" if dark and "through" in variables else "drop"


def plot_transmission(
    curve: xr.Dataset,
    show: str | None = None,
    ax: Axes | None = None,
    *,
    sweeps: Mapping[str, xr.Dataset] | None = None,
) -> Axes:
    """Draw one output against detuning or power: stable stretches solid, unstable ones dotted, sweeps over them.

    curve: from `transmission`.
    show: "drop", "through", "absorbed", "delta_T" or "carriers"; by default "drop", "through" on one bus.
    sweeps [mapping of a name to a Dataset of `sweep` or of `simulate` with a swept laser]: drawn over the curve, each
        in its colour.
    """
    show = show or lit_port(curve)
    choice("show", show, OUTPUTS)
    dims = ("detuning", "power", "regime", show)
    curve = contents("curve", curve, dims, what="a Dataset of coupled.transmission")
    ax = axes(ax, (5.0, 3.4))
    unit, label = OUTPUTS[show]
    name = "detuning" if np.ptp(curve["detuning"].values) else "power"
    scale, swept_label = LASER[name]
    x = curve[name].values * scale
    y = curve[show].values * unit
    stable = curve["regime"].values == "stable"
    ends = leaves(x, y)
    x = np.insert(x, ends, np.nan)
    y = np.insert(y, ends, np.nan)
    stable = np.insert(stable, ends, False)
    draw_stability(ax, x, y, stable, color=INK, labels=("stable", "unstable"))
    for (title, run), colour in zip(mapping("sweeps", sweeps).items(), cycle((LIGHT, HEAT, GREEN, PURPLE))):
        swept, output = _swept(f"sweeps[{title!r}]", run, name, show)
        ax.plot(swept * scale, output * unit, color=colour, linewidth=1.1, alpha=0.85, label=title)
    ax.set(xlabel=swept_label, ylabel=label, xlim=(np.nanmin(x), np.nanmax(x)))
    ax.set_ylim(bottom=0)
    ax.legend(**LEGEND)
    return ax


def _swept(name: str, run: Any, by: str, show: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the swept power (W) or detuning (Hz), ``by``, of a run and its output ``show`` in SI, over time."""
    what = f"a Dataset of `sweep` or `simulate` whose {by} varies, as that of the curve does"
    own = [one for one in (by, f"input_{by}") if one in run.variables]
    run = contents(name, run, ((own or [by])[0], show), what=what)
    return run[own[0]].values, run[show].values


def leaves(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the indices before which a line is broken: a curve leaves the range of x and re-enters at the same edge.

    The points of a curve have equal distances along it; a step in y of ten times the usual height, at an edge, is not
    part of the curve.
    """
    steps = np.abs(np.diff(y))
    span = np.ptp(x)
    middle = (x[1:] + x[:-1]) / 2
    edge = np.minimum(middle - x.min(), x.max() - middle) < 0.02 * span
    return np.flatnonzero(edge & (steps > 10 * np.quantile(steps, 0.95))) + 1


def plot_branch(branch: xr.Dataset, ax: Axes | None = None, *, fixed: xr.Dataset | None = None) -> Axes:
    """Draw the lowest and highest drop power of a branch of cycles: stable stretches solid, others dotted.

    branch: from `continue_cycle`.
    ax: drawn into; a new figure by default.
    fixed: from `transmission` over the same parameter: the fixed points, drawn below the cycles.
    """
    name = text("branch.attrs['parameter']", branch.attrs.get("parameter"))
    dims = (name, "drop_high", "drop_low", "stability", "special")
    branch = contents("branch", branch, dims, what=BRANCH)
    ax = axes(ax, (5.6, 3.6))
    factor, label = axis_of(branch, name)
    if fixed is not None:
        shape = (name, "drop", "regime")
        fixed = contents("fixed", fixed, shape, what=f"a Dataset of coupled.transmission over {name}")
        stable = fixed["regime"].values == "stable"
        labels = ("fixed point, stable", "fixed point, unstable")
        draw_stability(ax, fixed[name].values * factor, fixed["drop"].values * 1e3, stable, color=INK, labels=labels)
    stable = branch["stability"].values == "stable"
    x = branch[name].values * factor
    for k, edge in enumerate(("drop_high", "drop_low")):
        labels = ("", "") if k else ("cycle, highest and lowest, stable", "cycle, highest and lowest, unstable")
        draw_stability(ax, x, branch[edge].values * 1e3, stable, color=HEAT, labels=labels)
    for kind, (marker, words) in MARKS.items():
        at = branch["special"].values == kind
        style: dict[str, Any] = {"marker": marker, "linestyle": "", "markersize": 5.5, "zorder": 4}
        for k, edge in enumerate(("drop_high", "drop_low")):
            if at.any():
                ax.plot(x[at], branch[edge].values[at] * 1e3, color="#7B2D8B", label="" if k else words, **style)
    ax.set(xlabel=label, ylabel="drop power (mW)")
    ax.set_ylim(bottom=0)
    ax.legend(**LEGEND)
    return ax


def axis_of(data: xr.Dataset, name: str) -> tuple[float, str]:
    """Return the factor from SI to the drawn unit, and the axis label, of power, detuning or a parameter."""
    if name in LASER:
        return LASER[name]
    about = data[name].attrs
    stated = str(about.get("units", "1"))
    values, unit = readable(data[name].values, stated if stated != "1" else "")
    largest = np.argmax(np.abs(values))
    words = str(about.get("long_name", name))
    return float(values[largest] / data[name].values[largest]), f"{words} ({unit})" if unit else words


RESPONSE = "a Dataset of Linear.response"


def plot_bode(
    data: xr.Dataset, given: str = "detuning", seen: Sequence[str] = ("drop", "delta_T"), axes: np.ndarray | None = None
) -> np.ndarray:
    """Draw magnitude and phase from one input to some outputs; the legend has the gain that counts as 0 dB.

    data: from `Linear.response`; its lowest frequency gives 0 dB.
    """
    response = contents("data", data, ("frequency", "response"), what=RESPONSE)["response"].sel(input=given)
    above, below = new_axes(axes, (WIDTH, 4.6), 2, sharex=True)
    f = response["frequency"].values
    per = str(response["input_unit"].values)
    for colour, name in zip(CYCLE, seen, strict=False):
        H = response.sel(output=name)
        values = H.values
        gain = quantity.gain(abs(values[0]), str(H["output_unit"].values), per)
        decibels = 20 * np.log10(np.abs(values) / np.abs(values[0]))
        phase = np.degrees(np.unwrap(np.angle(values)))
        above.semilogx(f, decibels, color=colour, label=f"{name}, 0 dB = {gain}")
        below.semilogx(f, phase, color=colour)
    above.axhline(-3, color=INK, linewidth=0.6, linestyle=":")
    above.set(ylabel="magnitude (dB)", xlim=(f[0], f[-1]))
    above.set_ylim(bottom=max(above.get_ylim()[0], -80))
    above.legend(**LEGEND)
    above.set_title(f"from {given}", fontsize="small", loc="left")
    below.set(xlabel="frequency (Hz)", ylabel="phase (degrees)")
    for panel in (above, below):
        panel.grid(True, which="major", linewidth=0.3, color="#c3c8ce")
    return np.array([above, below])
