"""Figures of maps over power and detuning, with their curves."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap

from thermofem.checks import InputError, choice, mapping
from thermofem.data.variables import contents
from thermofem.plot import INK, WIDTH, axes as new_axes

from .curves import LIGHT, axis_of, curves_over, dbm, joined

REGIMES = {  # light to dark, so that the order survives in grey
    "stable": "#E8EEF4",
    "bistable": "#A9C8E3",
    "slow transient": "#F3D9A4",
    "self-pulsing": "#D8734A",
    "failed": "#222222",
}
_LINES: dict[str, dict[str, Any]] = {
    "Hopf, supercritical": {"color": INK, "linewidth": 1.3},
    "Hopf, subcritical": {"color": INK, "linewidth": 1.3, "linestyle": (0, (3.5, 1.8))},
    "Hopf, another mode grows": {"color": INK, "linewidth": 1.3, "linestyle": ":"},
    "fold": {"color": LIGHT, "linewidth": 1.3, "linestyle": (0, (1, 1.2))},
    "fold of cycles": {"color": "#7B2D8B", "linewidth": 1.5, "linestyle": (0, (5, 1.2, 1, 1.2))},
}
_SCALED = {
    "period": (1e9, "period (ns)"),
    "frequency": (1e-6, "pulsing frequency (MHz)"),
    "duty": (1.0, "duty cycle"),
    "swing": (1.0, "temperature swing (K)"),
    "growth_rate": (1e-6, "growth rate (1/µs)"),
}


def plot_map(
    data: xr.Dataset,
    show: str = "regime",
    ax: Axes | None = None,
    *,
    hopf: Sequence[xr.Dataset] = (),
    folds: Sequence[xr.Dataset] = (),
    limits: tuple[float, float] | None = None,
    key: bool = True,
) -> Axes:
    """Draw one variable of a map over detuning (GHz) and power (dBm), or its own axes, with curves over it.

    data: from `pulsing_map` or `stability_map`; the axes evenly spaced in GHz and dBm.
    show: "regime", "period", "duty", "swing", "growth_rate", or "frequency", which is 1/period where there is a period.
    ax: drawn into; a new figure by default.
    hopf, folds: from `hopf_curves` (solid where supercritical, dashed where subcritical, thinly dotted where another
        mode is already unstable), and `fold_curves` (blue, dotted) or `cycle_fold_curves` (purple, dash-dotted).
    limits [(float, float)]: ends of the colour scale, in the units that are drawn; by default those of the data.
    key: whether to draw the legend or the colour bar.
    Raises InputError: an unknown name, a curve of another kind, or curves over other axes than power and detuning.
    """
    dims = [str(dim) for dim in data["regime"].dims]
    data = contents("data", data, ("regime", *dims), what="a Dataset of coupled.pulsing_map or coupled.stability_map")
    hopf = curves_over(
        "hopf", hopf, ("power", "detuning", "leading", "lyapunov"), what="a Dataset of coupled.hopf_curves"
    )
    folds = curves_over("folds", folds, ("power", "detuning"), what="a Dataset of fold_curves or cycle_fold_curves")
    if (hopf or folds) and {*dims} != {"power", "detuning"}:
        rule = "hopf and folds are curves of power and detuning, and have no place there"
        raise InputError(f"data is a map over {' and '.join(dims)}; {rule}")
    choice("show", show, ["regime", *(name for name in _SCALED if name in data or name == "frequency")])
    ax = new_axes(ax, (5, 3.8))
    y_axis, y_label = _drawn_axis(data, dims[0])
    x_axis, x_label = _drawn_axis(data, dims[1])
    x = _edges(x_axis)
    y = _edges(y_axis)
    if show == "regime":
        _draw_regimes(data, ax, x, y)
        if key:
            key_entries = _regime_key([data])
            lines = list(key_entries.values())
            ax.legend(lines, list(key_entries), fontsize="small", loc="upper right", framealpha=0.9)
    else:
        low, high = limits or (None, None)
        cells = ax.pcolormesh(x, y, _shown(data, show), cmap="viridis", vmin=low, vmax=high, rasterized=True)
        if key:
            ax.figure.colorbar(cells, ax=ax, label=_SCALED[show][1])
        ax.set_facecolor("white")  # no colour of a regime: points without this number are of any
    for curve in hopf:
        nu = curve["detuning"].values * 1e-9
        power = dbm(curve["power"].values)
        leading = curve["leading"].values
        hard = curve["lyapunov"].values > 0
        for name, part in zip(_LINES, (leading & ~hard, leading & hard, ~leading), strict=False):
            if part.any():
                ax.plot(nu, np.where(joined(part), power, np.nan), label=name, **_LINES[name])
    for curve in folds:
        name = "fold of cycles" if curve.attrs.get("kind") == "fold-of-cycles curve" else "fold"
        ax.plot(curve["detuning"].values * 1e-9, dbm(curve["power"].values), label=name, **_LINES[name])
    ax.set(xlabel=x_label, ylabel=y_label, xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
    return ax


def plot_maps(
    maps: Mapping[str, xr.Dataset],
    *,
    show: Sequence[str] = ("regime", "frequency", "duty"),
    hopf: Mapping[str, Sequence[xr.Dataset]] | None = None,
    folds: Mapping[str, Sequence[xr.Dataset]] | None = None,
) -> np.ndarray:
    """Draw the maps of several models side by side, a row for each variable with one colour scale; return the Axes.

    maps [mapping from the model's name to a Dataset of `pulsing_map`]
    show: what to draw, as in `plot_map`.
    hopf, folds [mapping from the model's name to its curves]
    """
    lines = mapping("hopf", hopf)
    borders = mapping("folds", folds)
    for title in (*lines, *borders):
        choice("a name in hopf and folds", title, maps)
    rows = len(show)
    across = len(maps)
    width = max(WIDTH, 1.6 * across + 0.9)
    shared: dict[str, Any] = {"layout": "constrained", "sharex": True, "sharey": True, "squeeze": False}
    figure, axes = plt.subplots(rows, across, figsize=(width, 2.6 * rows + 0.6), **shared)
    for row, name in zip(axes, show, strict=True):
        limits = None
        if name != "regime":
            values = np.concatenate([_shown(data, name).ravel() for data in maps.values()])
            limits = (np.nanmin(values), np.nanmax(values)) if np.isfinite(values).any() else None
        for ax, (title, data) in zip(row, maps.items(), strict=True):
            last = ax is row[-1] and name != "regime"
            over = {"hopf": lines.get(title, []), "folds": borders.get(title, [])}
            plot_map(data, name, ax, limits=limits, key=last, **over)
            ax.label_outer()
    for ax, title in zip(axes[0], maps, strict=True):
        ax.set_title(textwrap.fill(title, int(11 * width / across)), fontsize="medium")  # letters an inch
    key = _regime_key([*maps.values()]) if "regime" in show else {}
    drawn = {line.get_label(): line for ax in axes.flat for line in ax.lines}
    key |= {name: drawn[name] for name in _LINES if name in drawn}
    if key:
        below: dict[str, Any] = {"loc": "outside lower center", "ncols": 3, "frameon": False, "borderpad": 0}
        figure.legend(list(key.values()), list(key), fontsize="small", **below)
    return axes


def _shown(data: xr.Dataset, name: str) -> np.ndarray:
    """Return a variable of a map in the drawn unit; "frequency" is 1/period where the map has a period."""
    values = 1 / data["period"] if name == "frequency" and "period" in data else data[name]
    return np.asarray(values) * _SCALED[name][0]


def _draw_regimes(data: xr.Dataset, ax: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """Draw the cells of a map, each in the colour of its regime."""
    names, regime = list(REGIMES), data["regime"].values
    index = np.select([regime == name for name in names], list(range(len(names))), default=len(names) - 1)
    colours = ListedColormap(list(REGIMES.values()))
    norm = BoundaryNorm(np.arange(len(names) + 1) - 0.5, len(names))
    ax.pcolormesh(x, y, index, cmap=colours, norm=norm, rasterized=True)


def _regime_key(maps: Sequence[xr.Dataset]) -> dict[str, Any]:
    """Return a patch in the colour of each regime that occurs, by the regime's name."""
    look: dict[str, Any] = {"edgecolor": "#555555", "linewidth": 0.5}
    seen = {str(name) for data in maps for name in np.unique(data["regime"].values)}
    return {name: plt.Rectangle((0, 0), 1, 1, facecolor=REGIMES[name], **look) for name in REGIMES if name in seen}


def _drawn_axis(data: xr.Dataset, name: str) -> tuple[np.ndarray, str]:
    """Return the values of an axis of a map in the drawn unit, and the axis label."""
    values = data[name].values
    if name == "power":
        return dbm(values), "power (dBm)"
    factor, words = axis_of(data, name)
    return values * factor, words


def _edges(centres: np.ndarray) -> np.ndarray:
    """Return the edges, shape (n + 1,), of n cells around increasing centres."""
    if centres.size == 1:
        return centres[0] + np.array([-0.5, 0.5])
    middle = (centres[1:] + centres[:-1]) / 2
    return np.concatenate([[2 * centres[0] - middle[0]], middle, [2 * centres[-1] - middle[-1]]])
