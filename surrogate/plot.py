"""Pictures of compact models, their fits and errors, and of arrays of rings.

Every function draws into ``ax`` (a new figure by default), labels its axes with units, and returns the Axes.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import shapely
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from thermofem import checks
from thermofem.arrays import Array, rms
from thermofem.data.dataset import response_of
from thermofem.data.variables import contents, unit_of
from thermofem.plot import CYCLE, INK, SKY, VERMILION, WIDTH, axes as _axes, readable
from thermofem.waveforms import period_times

from .judging.validate import valid_range
from .reduction.array_reduction import ArrayReduction

CURVE = "Datasets of surrogate.period_error"


def plot_period_error(curves: Mapping[str, xr.Dataset], ax: Axes | None = None, *, within: float = 0.1) -> Axes:
    """Period error in % against period (us), the 10 % band shaded: the paper's Fig. 7.

    curves [mapping from the model's name to a Dataset of `surrogate.period_error`]
    within: half width of the band.
    """
    needed = ("period", "relative_error")
    curves = {name: contents("curve", curve, needed, what=CURVE) for name, curve in curves.items()}
    ax = _axes(ax)
    periods = np.concatenate([curve["period"].values for curve in curves.values()])
    periods = np.sort(periods) * 1e6
    band = np.full(periods.shape, 100 * within)
    ax.fill_between(periods, -band, band, color=SKY, alpha=0.18, linewidth=0)
    ax.axhline(0, color=INK, linewidth=0.6)
    for k, (name, curve) in enumerate(curves.items()):
        error = curve["relative_error"].values * 100
        ranges = sorted(valid_range(curve, within=within))
        words = ", ".join(f"{low * 1e6:.3g} to {high * 1e6:.3g}" for low, high in ranges)
        label = f"{name}: {words} µs" if ranges else name
        finite = np.where(np.isfinite(error), error, np.nan)
        style = ("-", "--", ":")[k // len(CYCLE) % 3]  # where colours repeat
        colour = CYCLE[k % len(CYCLE)]
        ax.plot(curve["period"].values * 1e6, finite, style, color=colour, label=label)
    bottom, top = ax.get_ylim()
    ax.set_ylim(max(bottom, -100), min(top, 100))
    ax.set(xscale="log", xlabel="period of the reference (µs)", ylabel="period error (%)")
    words = f"shaded: error within {100 * within:g} %; the legend gives the periods"
    ax.set_title(words, fontsize="small", loc="left", color=INK)
    ax.xaxis.set_major_formatter("{x:g}")
    ax.margins(x=0)
    place: dict[str, Any] = {}
    if len(curves) > len(CYCLE):  # below the axes
        place = {"loc": "upper center", "bbox_to_anchor": (0.45, -0.2), "ncols": 2}
    ax.legend(frameon=False, fontsize="small", **place)
    return ax


def plot_period_errors(
    curves: Mapping[str, xr.Dataset], *, points: Mapping[str, xr.Dataset] | None = None, title: str = ""
) -> np.ndarray:
    """Period error twice: in %, and below its magnitude on a logarithmic axis, where good models differ.

    curves: as in `plot_period_error`.
    points: for names of curves, period (s) and relative_error over point, such as those of a ring; as markers.
    title: of the figure.
    """
    figure, (left, right) = plt.subplots(2, 1, figsize=(WIDTH, 5.8 + 0.2 * len(curves)), layout="constrained")
    plot_period_error(curves, left)
    for line in left.lines[1:]:  # the first is zero
        error = np.abs(np.asarray(line.get_ydata(), dtype=float))
        right.loglog(line.get_xdata(), np.where(error > 0, error, np.nan), line.get_linestyle(), color=line.get_color())
    for name, ring in (points or {}).items():
        colour = left.lines[1 + list(curves).index(name)].get_color()
        periods = ring["period"].values * 1e6
        error = 100 * ring["relative_error"].values
        label = f"{name}, in the ring with Q = {ring.attrs['loaded_q']:.0f}"
        left.plot(periods, error, "o", color=colour, markersize=3.5, alpha=0.6, label=label)
        right.plot(periods, np.abs(error), "o", color=colour, markersize=3.5, alpha=0.6)
    right.axhline(10, color=INK, linewidth=0.8, linestyle=":")
    right.set_ylim(bottom=max(right.get_ylim()[0], 1e-4))  # %; below that is round-off
    right.set(xlabel=left.get_xlabel(), ylabel="magnitude of the period error (%)")
    right.xaxis.set_major_formatter("{x:g}")
    right.margins(x=0)
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", frameon=False, fontsize="small")
    left.legend().remove()
    if title:
        figure.suptitle(title, fontsize="medium", wrap=True)
    return np.array([left, right])


def plot_error_against_states(comparison: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Rms error over swing (%) of every model against its number of states: one dot a model, a line over the drives.

    comparison: from `surrogate.compare`.
    """
    needed = ("model", "states", "rms_relative")
    comparison = contents("comparison", comparison, needed, what="a Dataset of surrogate.compare")
    ax = _axes(ax)
    states = checks.numbers("comparison['states']", comparison["states"].values)
    error = 100 * checks.numbers("comparison['rms_relative']", comparison["rms_relative"].values)
    kinds = np.array([str(name).split(" (")[0] for name in comparison["model"].values])
    count = len(set(kinds))
    crowded = np.sum(states == states[:, None], axis=1) > 1
    beside = 0.08 * (np.arange(count) - (count - 1) / 2)  # bars of models with as many states stand side by side
    for k, kind in enumerate(dict.fromkeys(kinds)):
        models = kinds == kind
        x = states[models] + beside[k] * crowded[models]
        errors = error[models]
        typical = np.sqrt(np.mean(errors**2, axis=1))
        colour = CYCLE[k % len(CYCLE)]
        style = "o-" if models.sum() > 1 else "o"
        ax.vlines(x, errors.min(axis=1), errors.max(axis=1), color=colour, linewidth=1, alpha=0.5)
        ax.plot(x, typical, style, color=colour, markersize=5, label=str(kind))
    ax.set(yscale="log", xlabel="number of states", ylabel="rms error (% of swing)")
    ax.set_xlim(0, states.max() + 1)
    ax.legend(frameon=False, fontsize="small")
    return ax


FINE_SAMPLES = 4001  # samples of a period, between which a periodic state is a straight line


def plot_fit(fit: Any, data: xr.Dataset, ax: Any = None) -> np.ndarray:
    """Data and model against time above, their difference below; the time axis is logarithmic for log-spaced samples.

    fit [reduction or thermal model]
    data: the data of the fit, or any other of `thermofem.solve` or `thermofem.read_trace`.
    ax: for the traces and for the residual.
    """
    model = getattr(fit, "model", fit)
    response = response_of(data)
    if response.periodic:
        times = period_times(response.wave, FINE_SAMPLES)
        period = model.periodic_response(response.wave, FINE_SAMPLES)
        rise = np.interp(response.times, times, period)
    else:
        rise = np.asarray(model.response(response.wave, response.times))
    upper, lower = _axes(ax, (WIDTH, 4.2), 2, sharex=True, height_ratios=[3, 1])
    rise_unit = unit_of(data.attrs.get("assumed", ""))
    t, unit = readable(response.times, "s")
    residual = rise - response.rise
    upper.plot(t, response.rise, color=INK, linewidth=2.6, alpha=0.4, label="data")
    upper.plot(t, rise, color=VERMILION, linewidth=1.2, label="model")
    gaps = np.diff(t)
    # 5 times the median gap: the mean gap beyond which samples are in equal ratios
    logarithmic = not response.periodic and gaps.mean() > 5 * np.median(gaps)
    scale = "log" if logarithmic else "linear"
    first = t[t > 0][0] if logarithmic else t[0]
    quantity = "temperature rise" if rise_unit == "K" else "rise of the voltage"
    upper.set(xscale=scale, ylabel=f"{quantity} ({rise_unit})", xlim=(first, t[-1]))
    upper.legend(frameon=False, fontsize="small")
    misfit = rms(residual)
    drive = response.name.replace(" us", " µs")
    words = f"residual {misfit:.2g} {rise_unit} rms, {misfit / response.swing:.2%} of the swing"
    upper.set_title(f"{drive}\n{words}", fontsize="small", loc="left", wrap=True)
    lower.axhline(0, color=INK, linewidth=0.6)
    lower.plot(t, residual, color=VERMILION, linewidth=1)
    lower.set(xlabel=f"time ({unit})", ylabel=f"residual ({rise_unit})")
    return np.array([upper, lower])


def plot_crosstalk(array: ArrayReduction, ax: Axes | None = None) -> Axes:
    """Steady rise of every ring (rows) per watt in every input (columns), in K/mW, colours logarithmic."""
    ax = _axes(ax)
    matrix = array.crosstalk / 1e3
    norm = LogNorm(vmin=matrix.min() / 2, vmax=matrix.max())
    picture = ax.imshow(matrix, cmap="magma_r", norm=norm, aspect="equal")
    if matrix.size <= 64:
        luma = picture.to_rgba(matrix)[..., :3] @ (0.299, 0.587, 0.114)  # ITU-R BT.601
        for (i, j), value in np.ndenumerate(matrix):
            colour = "white" if luma[i, j] < 0.5 else INK
            ax.text(j, i, f"{value:.2g}", ha="center", va="center", fontsize="small", color=colour)
    ax.set_xticks(range(len(array.model.inputs)), array.model.inputs, rotation=60, ha="right", fontsize="small")
    ax.set_yticks(range(array.rings), array.model.outputs, fontsize="small")
    ax.set(xlabel="heated", ylabel="read")
    ax.figure.colorbar(picture, ax=ax, label="steady rise (K/mW)")
    return ax


def plot_layout(names: Sequence[str], outlines: Sequence[Any], gain: Array, ax: Axes | None = None) -> Axes:
    """Map of a chip: outlines coloured by R_th in K/mW, and a line from each shape to the neighbour that it heats most.

    outlines: as of `ArrayReduction.outlines`, in m. gain [shape (N, N), K/W]
    """
    ax = _axes(ax, (WIDTH, WIDTH))
    own = np.diag(gain) / 1e3
    colours = ScalarMappable(Normalize(own.min() * 0.9, own.max() * 1.1), "viridis")
    microns = [[np.asarray(ring) * 1e6 for ring in rings] for rings in outlines]
    middles = np.array([rings[0][:-1].mean(axis=0) for rings in microns])
    shapes = [Path.make_compound_path(*(Path(ring, closed=True) for ring in rings)) for rings in microns]
    labels: dict[tuple[float, float], list[Any]] = {}  # lowest y, and a line for each shape at one place
    for k in np.argsort([-shapely.Polygon(outer, holes).area for outer, *holes in outlines]):  # the largest below
        colour = colours.to_rgba(own[k])
        ax.add_patch(PathPatch(shapes[k], facecolor=colour, edgecolor=INK, linewidth=0.4))
        place = tuple(np.round(middles[k], 1).tolist())
        lines = labels.setdefault(place, [microns[k][0][:, 1].min()])
        lines.append(f"{names[k]}: {own[k]:.3g}")
    for (x, _), (lowest, *lines) in labels.items():
        ax.annotate("\n".join(lines), (x, lowest), ha="center", va="top", fontsize="xx-small")
    apart = np.linalg.norm(middles[:, None] - middles, axis=-1) > 1.0  # um; others lie above each other
    others = np.where(apart, gain, 0.0)
    for j in np.flatnonzero(apart.any(axis=0)):
        i = int(others[:, j].argmax())
        ends = middles[np.array([j, i])].T
        ax.plot(*ends, color=VERMILION, linewidth=0.8, alpha=0.6, zorder=0)
    ax.set(xlabel="x (µm)", ylabel="y (µm)", aspect="equal")
    ax.margins(0.1)  # for the words below the lowest shapes
    ax.autoscale_view()
    ax.figure.colorbar(colours, ax=ax, label="R_th (K/mW)", shrink=0.7)
    return ax
