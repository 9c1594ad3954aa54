"""HTML tables and pictures of models, fits and geometries, for notebooks."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from . import quantity

if TYPE_CHECKING:
    from .geometry.cross_section import CrossSection
    from .models import ThermalModel

WIDTH, HEIGHT = 300, 120  # of a picture, in pixels
# colour-blind safe (Okabe and Ito), by material
COLOURS = {"Si": "#0072B2", "SiO2": "#cfe3f1", "TiN": "#D55E00", "Al": "#999999", "Si3N4": "#009E73", "void": "#ffffff"}


def card(title: str, rows: Iterable[tuple[str, str]], picture: str = "") -> str:
    """A titled table of names and values, with a picture below."""
    cells = "".join(
        f'<tr><td style="text-align:left">{escape(name)}</td><td style="text-align:left">{escape(value)}</td></tr>'
        for name, value in rows
    )
    return f"<div><strong>{escape(title)}</strong><table>{cells}</table>{picture}</div>"


def model_card(model: ThermalModel, *, order: int, tau: Any = None, notes: Iterable[tuple[str, str]] = ()) -> str:
    """Kind, parts, states, thermal resistance and, with time constants, the step response of a single channel."""
    rows = [("heated", ", ".join(model.inputs)), ("read", ", ".join(model.outputs))]
    rows.append(("states", str(order)))
    picture = ""
    if (len(model.inputs), len(model.outputs)) == (1, 1) and order <= 500:
        resistance = model.thermal_resistance
        rows.append(("thermal resistance", f"{resistance / 1e3:.4g} K/mW"))
        if tau is not None:
            ends = [quantity.write(float(f"{t:.3g}"), "s") for t in (np.min(tau), np.max(tau))]
            rows.append(("time constants", ends[0] if len(np.atleast_1d(tau)) == 1 else f"{ends[0]} to {ends[1]}"))
            times = np.geomspace(np.min(tau) / 10, 10 * np.max(tau), 80)
            picture = curve(np.log(times), model.step_response(times), "step response, logarithmic time")
    return card(type(model).__name__, [*rows, *notes], picture)


def curve(x: Any, y: Any, label: str) -> str:
    """A line through points as inline SVG."""
    x, y = np.asarray(x), np.asarray(y)
    across = (x - x.min()) / (np.ptp(x) or 1.0) * (WIDTH - 8) + 4
    up = HEIGHT - 20 - (y - y.min()) / (np.ptp(y) or 1.0) * (HEIGHT - 26)
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across, up, strict=True))
    line = f'<polyline points="{points}" fill="none" stroke="{COLOURS["Si"]}" stroke-width="2"/>'
    return svg(line + f'<text x="4" y="{HEIGHT - 5}" font-size="11" fill="#777777">{escape(label)}</text>')


def svg(content: str) -> str:
    """Inline SVG of the common size."""
    size = f'width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH} {HEIGHT}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{content}</svg>'


def section_card(section: CrossSection) -> str:
    """Layers and parts of a geometry, and its cross-section around the parts."""
    rows = [(f"layer {layer.name}", f"{layer.material}, {_length(layer.thickness)}") for layer in section.layers]
    for part in section.parts:
        size = f"r {_length(part.inner_radius)} to {_length(part.outer_radius)}, height {_length(part.height)}"
        rows.append((f"part {part.name}", f"{part.material}, {size}" + (", heated" if part.heated else "")))
    rows.append(("ends at", _length(section.outer_radius)))
    return card(section.name, rows, _section_svg(section))


def _length(value: float) -> str:
    return quantity.write(float(f"{value:.6g}"), "m")


def _section_svg(section: CrossSection) -> str:
    """Every region near the parts, to scale."""
    middle_r = float(np.mean([(p.inner_radius + p.outer_radius) / 2 for p in section.parts]))
    low, high = min(p.bottom for p in section.parts), max(p.top for p in section.parts)
    span = max(
        3 * (high - low), 3e-6, 1.2 * max(p.outer_radius - p.inner_radius for p in section.parts) * HEIGHT / WIDTH
    )
    scale = HEIGHT / span
    shapes = []
    for face in section.subdivision.faces:
        fill = COLOURS.get(section.material_of(face.owner).name.removesuffix("(T)"), "#F0E442")
        path = "".join(
            "M" + "L".join(_point(r, z, middle_r, (low + high) / 2, scale) for r, z in ring) + "Z"
            for ring in face.rings
        )
        shapes.append(f'<path d="{path}" fill="{fill}" fill-rule="evenodd" stroke="#555555" stroke-width="0.5"/>')
    width = f"{_length(float(f'{WIDTH / scale:.2g}'))} wide, around the parts"
    return svg("".join(shapes) + f'<text x="4" y="{HEIGHT - 5}" font-size="11" fill="#333333">{escape(width)}</text>')


def _point(r: float, z: float, middle_r: float, middle_z: float, scale: float) -> str:
    x = np.clip(WIDTH / 2 + (r - middle_r) * scale, -1e4, 1e4)
    y = np.clip(HEIGHT / 2 - (z - middle_z) * scale, -1e4, 1e4)
    return f"{x:.1f} {y:.1f}"
