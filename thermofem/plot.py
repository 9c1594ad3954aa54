"""Pictures of cross-sections, fields, responses and models.

Every function draws into ``ax`` (a new figure by default), labels its axes with units, and returns the Axes.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.tri import Triangulation

from . import checks
from .data.fields import check_field
from .data.files import check_image, write_whole
from .data.variables import contents
from .fluctuations import one_pole
from .geometry import CrossSection

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

    from .mesh import Mesh
    from .optics import Mode

DATA = "a Dataset of th.solve, with time and delta_T"
_MATERIALS = {
    "Si": "#7d8ea3",
    "SiO2": "#e6edf3",
    "Si3N4": "#b8d8b0",
    "TiN": "#d9a441",
    "Al": "#c0c0c8",
    "air": "#ffffff",
}
_UNMESHED: dict[str, Any] = {"facecolor": "white", "edgecolor": "#c3c8ce", "hatch": "///", "linewidth": 0}
LINE = 0.08  # of the height of an axes: a line of small text
_OTHER = ("#d4b9da", "#fdd0a2", "#c7e9c0")

# Okabe and Ito: apart for every kind of colour vision, and in grey
INK, BLUE, VERMILION, GREEN, ORANGE, SKY, PURPLE = (
    "#222222", "#0072B2", "#D55E00", "#009E73", "#E69F00", "#56B4E9", "#CC79A7",
)  # fmt: skip
CYCLE = (VERMILION, BLUE, GREEN, ORANGE, PURPLE, SKY)  # of several lines in one panel
WIDTH = 5.7  # inches at most: in half a column of 88 mm "small", the smallest text, is then 5 pt high
SIZE = (WIDTH, 3.5)  # of a figure by default


def axes(ax: Any, size: tuple[float, float] = SIZE, rows: int = 1, **more: Any) -> Any:
    """``ax``, or the Axes of a new figure; of several ``rows`` an array of them."""
    if ax is None:
        _, ax = plt.subplots(rows, 1, figsize=size, layout="constrained", **more)
    return ax


def readable(values: np.ndarray, unit: str) -> tuple[np.ndarray, str]:
    """Values scaled so that their largest reads well, and the scaled unit.

    >>> readable(np.array([0.0, 2e-5]), "s")
    (array([ 0., 20.]), 'µs')
    """
    prefixes = {9: "G", 6: "M", 3: "k", 0: "", -3: "m", -6: "µ", -9: "n", -12: "p"}
    largest = float(np.max(np.abs(values), initial=0.0))
    power = next((k for k in prefixes if largest >= 10.0**k), 0)
    return values / 10.0**power, prefixes[power] + unit


def plot_response(data: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Temperature rise (K) against time (us); several probes give one line each."""
    data = contents("data", data, ("time", "delta_T"), what=DATA)
    ax = axes(ax)
    time = data["time"].values * 1e6
    rise = data["delta_T"]
    if "probe" in rise.dims:
        ax.set_prop_cycle(color=[BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY, INK])
        for name in rise["probe"].values:
            ax.plot(time, rise.sel(probe=name), label=str(name))
        ax.legend(frameon=False)
    else:
        ax.plot(time, rise, color=INK)
    ax.set(xlabel="time (µs)", ylabel="temperature rise (K)")
    ax.margins(x=0)
    return ax


def plot_field(data: xr.Dataset, ax: Axes | None = None, *, at: int = 0, half_width: float = 4e-6) -> Axes:
    """Temperature field on the cross-section around the hottest place.

    data: from `solve` with ``field_times``.
    at: which of the kept times.
    half_width [m]: of the window drawn.
    """
    data = check_field(data)
    ax = axes(ax, size=(4.2, 3.4))
    field = data["field"].isel(field_time=at).values
    r = data["r"].values * 1e6
    z = data["z"].values * 1e6
    hottest = int(np.argmax(field))
    half = half_width * 1e6
    r0 = r[hottest]
    z0 = z[hottest]
    window = (np.abs(r - r0) < 1.6 * half) & (np.abs(z - z0) < 1.6 * half)
    grid = Triangulation(r, z, data["triangles"].values)
    hot = float(field[window].max())
    picture = ax.tripcolor(grid, field, shading="gouraud", cmap="inferno", vmin=0, vmax=hot)
    ax.set(xlabel="r (µm)", ylabel="z (µm)", aspect="equal")
    ax.set_xlim(max(0, r0 - half), r0 + half)
    ax.set_ylim(max(z.min(), z0 - half), min(z.max(), z0 + half))
    time = float(data["field_time"][at]) * 1e6
    ax.set_title(f"t = {time:.4g} µs", fontsize="small")
    if "geometry" in data.attrs:
        text = checks.text("data.attrs['geometry']", data.attrs["geometry"])
        for face in CrossSection.from_toml_text(text).subdivision.faces:
            for ring in face.rings:
                x, y = np.vstack([ring, ring[:1]]).T * 1e6
                ax.plot(x, y, color="white", linewidth=0.5, alpha=0.7)
    bar = ax.inset_axes((1.03, 0, 0.05, 1))
    ax.figure.colorbar(picture, cax=bar, label="rise (K)")
    return ax


def plot_preview(geometry: CrossSection, mesh: Mesh) -> Axes:
    """Draw all parts with their names, and below the mesh around the first heated part; returns the upper Axes."""
    figure, (above, below) = plt.subplots(2, 1, figsize=(WIDTH, 7.6), layout="constrained")
    for ax in (above, below):
        colours = _draw_materials(geometry, ax)
    low = min(p.bottom for p in geometry.parts)
    high = max(geometry.top_z, *(p.top for p in geometry.parts))
    inner = min(p.inner_radius for p in geometry.parts)
    outer = max(p.outer_radius for p in geometry.parts)
    room = max(0.3 * (high - low), 0.3 * (outer - inner), 1.5e-6)
    above.set_xlim(max(inner - room, geometry.inner_end) * 1e6, (outer + room) * 1e6)
    above.set_ylim(max(low - room, geometry.bottom_z) * 1e6, (high + 0.8 * room) * 1e6)
    heated = geometry.first_heated
    r = heated.centre * 1e6
    z = heated.middle * 1e6
    size = max(heated.breadth, heated.height)
    half = np.clip(2.5e6 * size, 1, 10)
    x, y = mesh.points.T * 1e6
    below.triplot(x, y, mesh.triangles, color=INK, linewidth=0.15)
    below.set_xlim(max(geometry.inner_end * 1e6, r - half), r + half)
    below.set_ylim(z - 0.75 * half, z + 0.75 * half)
    _name_parts(geometry, above)
    handles = []
    for colour in colours.values():
        handles.append(plt.Rectangle((0, 0), 1, 1, facecolor=colour, edgecolor=INK, linewidth=0.6))
    handles.append(plt.Rectangle((0, 0), 1, 1, **_UNMESHED))
    names = [*colours, "air or void, not meshed"]
    figure.legend(handles, names, loc="outside lower center", ncols=8, frameon=False, fontsize="small")
    figure.suptitle(geometry.name)
    below.set_title(f"{len(mesh.triangles)} triangles", fontsize="small")
    return above


def _draw_materials(geometry: CrossSection, ax: Axes) -> dict[str, str]:
    """Draw layers and parts in the colours of their materials; returns the colour of each material by name."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    colours: dict[str, str] = {}
    ax.add_patch(plt.Rectangle((0, 0), 1, 1, transform=ax.transAxes, zorder=0, **_UNMESHED))
    for face in geometry.subdivision.faces:
        name = geometry.material_of(face.owner).name
        other = _OTHER[len(colours) % len(_OTHER)]
        colour = colours.setdefault(name, _MATERIALS.get(name, other))
        paths = []
        for ring in face.rings:
            corners = np.vstack([ring, ring[:1]]) * 1e6
            paths.append(Path(corners, closed=True))
        path = Path.make_compound_path(*paths)
        ax.add_patch(PathPatch(path, facecolor=colour, edgecolor=INK, linewidth=0.6))
    ax.set(xlabel="r (µm)" if geometry.kind == "ring" else "x (µm)", ylabel="z (µm)", aspect="equal")
    return colours


def _name_parts(geometry: CrossSection, ax: Axes) -> None:
    """Write the name of every part beside the axes, heated ones marked, from top to bottom, with a line to it."""
    low, high = np.array(ax.get_ylim()) * 1e-6
    count = len(geometry.parts)
    numbers = sorted(range(count), key=lambda number: -geometry.parts[number].middle)
    step = min(LINE, 1 / count)
    beside = 1.0 + LINE / 2
    for rank, number in enumerate(numbers):
        part = geometry.parts[number]
        z = part.middle
        room = step * (count - 1 - rank)  # what the names below need
        level = (z - low) / (high - low)
        beside = max(min(level, beside - step), room + step / 2)
        r = part.centre
        for later in geometry.parts[number + 1 :]:
            if later.inner_radius < r < later.outer_radius and 0 < z - later.bottom < later.height:
                r = part.outer_radius - part.breadth / 8  # a later part lies over its middle
                break
        ax.annotate(
            f"{part.name} (heated)" if part.heated else part.name,
            (r * 1e6, z * 1e6),
            xytext=(1.04, beside),
            textcoords="axes fraction",
            verticalalignment="center",
            fontsize="small",
            arrowprops={"arrowstyle": "-", "color": INK, "linewidth": 0.7},
        )


def plot_noise(data: xr.Dataset, static: float | None = None, ax: Axes | None = None) -> Axes:
    """Density of thermal noise over frequency: of the resonance (Hz^2/Hz) where it is known, else of the temperature.

    data: from `thermal_noise`.
    static [K^2/Hz]: S_T at f = 0; draws the noise of one pole of the same R and C beside it.
    """
    data = contents("data", data, ("frequency", "S_T"), what="a Dataset of th.thermal_noise")
    ax = axes(ax)
    f = data["frequency"].values
    lit = "S_nu" in data
    scale = data.attrs["thermal_shift"] ** 2 if lit else 1.0
    ax.loglog(f, data["S_T"] * scale, color=INK, label="heat of the cross-section")
    if static is not None:
        S_T = one_pole(f, static, data.attrs["variance"])
        ax.loglog(f, S_T * scale, color=VERMILION, linestyle="--", label="one pole of the same R and C")
        ax.legend(frameon=False, fontsize="small")
    quantity = "$S_\\nu$ (Hz²/Hz)" if lit else "$S_T$ (K²/Hz)"
    ax.set(xlabel="frequency (Hz)", ylabel=quantity, xlim=(f[0], f[-1]))
    title = f"thermal noise of {data.attrs['read']} at {data.attrs['temperature']:g} K"
    ax.set_title(title, fontsize="small", loc="left")
    return ax


def save_figure(ax: Axes, path: Any) -> None:
    """Write the figure of ``ax`` as an image at 200 dots per inch, whole or not at all, and close it."""
    check_image(path)
    figure: Any = ax.get_figure(root=True)
    image = io.BytesIO()  # matplotlib's writers of files trip over a full disk
    figure.savefig(image, dpi=200, format=checks.path("path", path).suffix[1:])
    write_whole(path, lambda p: p.write_bytes(image.getvalue()))
    plt.close(figure)


def plot_mode(mode: Mode, ax: Axes | None = None) -> Axes:
    """|E| of a mode of `thermofem.light`, with the outlines of the materials (µm about the core's centre)."""
    grid = mode.space.mesh
    ax = axes(ax, (WIDTH, 4.0))
    dx = mode.space.dx
    square = (mode.intensity * dx).sum(axis=1) / dx.sum(axis=1)
    vertices = grid.t.ravel()
    sums = np.bincount(vertices, np.tile(np.sqrt(square), 3))
    field = sums / np.bincount(vertices)  # mean of the triangles about a vertex
    triangles = Triangulation(grid.p[0], grid.p[1], grid.t.T)
    filled = ax.tripcolor(triangles, field / field.max(), shading="gouraud", cmap="magma", rasterized=True)
    inner = grid.f2t[1] >= 0
    first, second = mode.window.region[grid.f2t[:, inner]]
    facets = grid.facets[:, inner]
    x, y = grid.p[:, facets[:, first != second]]
    ax.plot(x, y, color="white", linewidth=0.6, alpha=0.8)
    in_core = mode.window.inside(mode.core)[:, 0]
    x, y = grid.p[:, grid.t[:, in_core]]
    ax.set_xlim(x.min() - 0.8, x.max() + 0.8)
    ax.set_ylim(y.min() - 0.8, y.max() + 0.8)
    ax.set(aspect="equal", xlabel="r - R (µm)", ylabel="z (µm)")
    ax.set_title(f"{mode.name}: n_eff {mode.n_eff:.4f}, n_g {mode.n_g:.4f}", fontsize="small", loc="left")
    ax.figure.colorbar(filled, ax=ax, label="|E| / largest", shrink=0.8)
    return ax
