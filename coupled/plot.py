"""Figures of coupled runs; the only module of the package that imports matplotlib."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap

from thermofem.checks import choice

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

LIGHT, HEAT = "#0072B2", "#D55E00"  # blue and vermilion of Okabe and Ito, apart for every kind of colour vision


def plot_traces(run: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the drop power (left axis) and the temperature rise (right axis) against time.

    Parameters
    ----------
    run : xarray.Dataset
        from `simulate`.
    ax : matplotlib Axes, optional
        drawn into; a new figure by default.

    Returns
    -------
    matplotlib Axes
        the left one; the right one is its twin.
    """
    if ax is None:
        _, ax = plt.subplots(figsize=(7, 3.2), layout="constrained")
    t, time_unit = _readable(run["time"].values, "s")
    drop, power_unit = _readable(run["drop"].values, "W")
    ax.plot(t, drop, color=LIGHT, linewidth=1.2)
    ax.set_xlabel(f"time ({time_unit})")
    ax.set_ylabel(f"drop power ({power_unit})", color=LIGHT)
    ax.set_xlim(t[0], t[-1])
    ax.set_ylim(bottom=0)
    right = ax.twinx()
    right.plot(t, run["delta_T"].values, color=HEAT, linewidth=1.2, linestyle=(0, (5, 1)))
    right.set_ylabel("temperature rise (K)", color=HEAT)
    right.set_ylim(bottom=0)
    ax.spines["top"].set_visible(False)
    right.spines["top"].set_visible(False)
    return ax


REGIMES = {  # light to dark, so that the order survives in grey
    "stable": "#E8EEF4",
    "bistable": "#A9C8E3",
    "slow transient": "#F3D9A4",
    "self-pulsing": "#D8734A",
    "failed": "#222222",
}
_HOPF: dict[str, Any] = {"color": "#111111", "linewidth": 1.3}
_FOLD: dict[str, Any] = {"color": LIGHT, "linewidth": 1.3, "linestyle": (0, (4, 1.5))}
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
    """Draw one variable of a map over detuning (GHz) and power (dBm), with Hopf and fold curves over it.

    Parameters
    ----------
    data : xarray.Dataset
        from `pulsing_map` or `stability_map`; the axes evenly spaced in GHz and dBm.
    show : str
        "regime", "period", "duty", "swing", "growth_rate", or "frequency", which is 1/period where there is a period.
    ax : matplotlib Axes, optional
        drawn into; a new figure by default.
    hopf, folds : sequence of xarray.Dataset
        from `hopf_curves` (solid; dotted where another mode grows already) and `fold_curves` (dashed).
    limits : (float, float), optional
        ends of the colour scale, in the units that are drawn; by default those of the data.
    key : bool
        whether to draw the legend or the colour bar.

    Raises
    ------
    InputError
        an unknown name.
    """
    choice("show", show, ["regime", *(name for name in _SCALED if name in data or name == "frequency")])
    if ax is None:
        _, ax = plt.subplots(figsize=(5, 3.8), layout="constrained")
    x, y = _edges(data["detuning"].values * 1e-9), _edges(_dbm(data["power"].values))
    if show == "regime":
        _draw_regimes(data, ax, x, y)
        if key:
            ax.legend(*_regime_key([data]), fontsize="x-small", loc="upper right", framealpha=0.9)
    else:
        factor, label = _SCALED[show]
        values = 1 / data["period"] if show == "frequency" and "period" in data else data[show]
        low, high = limits or (None, None)
        cells = ax.pcolormesh(x, y, values.values * factor, cmap="viridis", vmin=low, vmax=high, rasterized=True)
        if key:
            ax.figure.colorbar(cells, ax=ax, label=label)
        ax.set_facecolor(REGIMES["stable"])
    for curve in hopf:
        nu, power = curve["detuning"].values * 1e-9, _dbm(curve["power"].values)
        leading = bool(np.all(curve["leading"].values))
        ax.plot(nu, power, linestyle="-" if leading else ":", **_HOPF)
    for curve in folds:
        nu, power = curve["detuning"].values * 1e-9, _dbm(curve["power"].values)
        ax.plot(nu, power, **_FOLD)
    ax.set(xlabel="detuning (GHz)", ylabel="power (dBm)", xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
    return ax


def plot_maps(
    maps: Mapping[str, xr.Dataset],
    *,
    show: Sequence[str] = ("regime", "frequency", "duty"),
    hopf: Mapping[str, Sequence[xr.Dataset]] | None = None,
    folds: Mapping[str, Sequence[xr.Dataset]] | None = None,
) -> np.ndarray:
    """Draw the maps of several models side by side, a row for each variable with one colour scale; return the Axes.

    Parameters
    ----------
    maps : mapping from the model's name to a Dataset of `pulsing_map`
    show : sequence of str
        what to draw, as in `plot_map`.
    hopf, folds : mapping from the model's name to its curves, optional
    """
    size = (3.4 * len(maps) + 0.9, 2.6 * len(show) + 0.4)
    _, axes = plt.subplots(
        len(show), len(maps), figsize=size, layout="constrained", sharex=True, sharey=True, squeeze=False
    )
    for row, name in zip(axes, show, strict=True):
        limits = _common_limits(maps, name)
        for ax, (title, data) in zip(row, maps.items(), strict=True):
            over = {"hopf": (hopf or {}).get(title, ()), "folds": (folds or {}).get(title, ())}
            last = ax is row[-1] and name != "regime"
            plot_map(data, name, ax, limits=limits, key=last, hopf=over["hopf"], folds=over["folds"])
            ax.label_outer()
    for ax, title in zip(axes[0], maps, strict=True):
        ax.set_title(title, fontsize="medium")
    handles, names = _regime_key(list(maps.values())) if "regime" in show else ([], [])
    for curves, name, style in ((hopf, "Hopf", _HOPF), (folds, "fold", _FOLD)):
        if curves and any(curves.values()):
            handles, names = [*handles, plt.Line2D([], [], **style)], [*names, name]
    if names:
        axes[0, 0].figure.legend(handles, names, loc="outside lower center", ncols=len(names), frameon=False)
    return axes


def _common_limits(maps: Mapping[str, xr.Dataset], name: str) -> tuple[float, float] | None:
    """Smallest and largest drawn value over several maps."""
    if name == "regime":
        return None
    factor = _SCALED[name][0]
    drawn = [1 / m["period"] if name == "frequency" and "period" in m else m[name] for m in maps.values()]
    values = factor * np.concatenate([v.values.ravel() for v in drawn])
    return (float(np.nanmin(values)), float(np.nanmax(values))) if np.any(np.isfinite(values)) else None


def _draw_regimes(data: xr.Dataset, ax: Axes, x: np.ndarray, y: np.ndarray) -> None:
    """Cells in the colour of their regime."""
    names, regime = list(REGIMES), data["regime"].values
    index = np.select([regime == name for name in names], list(range(len(names))), default=len(names) - 1)
    colours, norm = ListedColormap(list(REGIMES.values())), BoundaryNorm(np.arange(len(names) + 1) - 0.5, len(names))
    ax.pcolormesh(x, y, index, cmap=colours, norm=norm, rasterized=True)


def _regime_key(maps: Sequence[xr.Dataset]) -> tuple[list[Any], list[str]]:
    """Legend handles and names of the regimes that occur."""
    seen = [name for name in REGIMES if any(np.any(data["regime"].values == name) for data in maps)]
    handles = [
        plt.Rectangle((0, 0), 1, 1, facecolor=REGIMES[name], edgecolor="#555555", linewidth=0.5) for name in seen
    ]
    return handles, seen


def _dbm(power: np.ndarray) -> np.ndarray:
    """Power in W as dBm."""
    return 10 * np.log10(power * 1e3)


def _edges(centres: np.ndarray) -> np.ndarray:
    """Edges of cells around increasing centres."""
    if centres.size == 1:
        return centres[0] + np.array([-0.5, 0.5])
    middle = (centres[1:] + centres[:-1]) / 2
    return np.concatenate([[2 * centres[0] - middle[0]], middle, [2 * centres[-1] - middle[-1]]])


def _readable(values: np.ndarray, unit: str) -> tuple[np.ndarray, str]:
    """Scale values so that their largest reads well, and name the scaled unit."""
    largest = float(np.max(np.abs(values), initial=0.0))
    for factor, prefix in ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p")):
        if largest >= factor:
            return values / factor, prefix + unit
    return values, unit
