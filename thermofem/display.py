"""HTML tables and pictures of models, fits and geometries, for notebooks."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from . import quantity

if TYPE_CHECKING:
    from .geometry.cross_section import CrossSection
    from .materials.library import Material
    from .models import ThermalModel

T = TypeVar("T")
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


def model_html(model: Any) -> str:
    """`model_card` of a model with one set of states, as its ``_repr_html_``."""
    return model_card(model, order=model.order, tau=getattr(model, "tau", None))


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


def materials_text(materials: Sequence[Material]) -> str:
    """A line for each material: name, conductivity, density, specific heat, and whether they follow temperature."""
    head = f"{'material':14}{'k (W/m/K)':>12}{'density (kg/m^3)':>18}{'c_p (J/kg/K)':>14}"
    return "\n".join([head, *("{:14}{:>12}{:>18}{:>14}{}".format(*_properties(m)).rstrip() for m in materials)])


def materials_card(materials: Sequence[Material]) -> str:
    """HTML table with the source of every material."""
    head = ("material", "k (W/m/K)", "density (kg/m³)", "c_p (J/kg/K)", "", "source")
    rows = [head, *((*_properties(m), m.source) for m in materials)]
    cells = ("".join(f'<td style="text-align:left">{escape(cell.strip())}</td>' for cell in row) for row in rows)
    return "<div><strong>materials</strong><table>" + "".join(f"<tr>{row}</tr>" for row in cells) + "</table></div>"


def _properties(m: Material) -> tuple[str, str, str, str, str]:
    k = f"{m.conductivity:g}" + ("" if m.conductivity_z is None else f" ({m.conductivity_z:g} along z)")
    return m.name, k, f"{m.density:g}", f"{m.specific_heat:g}", "  follows T" if m.varies else ""


LINES, WIDE = 3, 116  # of the text of an object


def shown(kind: type[T]) -> type[T]:
    """Class decorator: a text of at most three lines, and a table of the fields for notebooks.

    For dataclasses, above ``@dataclass``, and for named tuples. What the class has written itself stays.
    """
    own = getattr(kind, "__repr__", None)
    if own is None or hasattr(own, "__wrapped__") or own is object.__repr__:  # dataclasses wrap the one they make
        kind.__repr__ = _text  # type: ignore[method-assign]
    if not hasattr(kind, "_repr_html_"):
        kind._repr_html_ = _table  # type: ignore[attr-defined]
    return kind


def _text(self: Any) -> str:
    """Class and fields, the longest of them shortened until it fits."""
    for most in (10_000, 200, 60, 30, 16):
        words = ", ".join(f"{name}={_short(getattr(self, name), most)}" for name in _names(self))
        text = f"{type(self).__name__}({words})"
        if len(text) <= LINES * WIDE:
            return text
    return text[: LINES * WIDE - 5] + " ...)"


def _short(value: Any, most: int) -> str:
    """One value in at most about ``most`` characters on one line."""
    if isinstance(value, float):
        return repr(value) if most > 200 else f"{value:.6g}"
    if isinstance(value, np.ndarray) and value.size > (30 if most > 200 else 6):
        numeric = value.dtype.kind in "fiu"
        ends = f" {np.min(value):.4g} to {np.max(value):.4g}" if numeric else ""
        return f"<{' x '.join(map(str, value.shape))}{ends}>"
    if isinstance(value, tuple | list | dict) and len(repr(value)) > most:
        return f"<{len(value)} of {type(value).__name__}>"
    text = " ".join(repr(value).split())
    return text if len(text) <= most else text[: max(most - 3, 1)] + "..."


def _table(self: Any) -> str:
    """A card of the fields."""
    return card(type(self).__name__, [(name, _short(getattr(self, name), 400)) for name in _names(self)])


def _names(self: Any) -> Sequence[str]:
    """Fields of a dataclass that its text shows, or of a named tuple."""
    if isinstance(self, tuple):
        return self._fields  # type: ignore[attr-defined]
    return [f.name for f in dataclasses.fields(self) if f.repr]
