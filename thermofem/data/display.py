"""HTML tables of models, fits and geometries, for notebooks."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from ..checks import InputError
from . import quantity

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection
    from ..materials.material_library import Material


def card(title: str, rows: Iterable[tuple[str, str]], below: str = "") -> str:
    """A titled table of names and values, with another one ``below``."""
    cells = "".join(
        f'<tr><td style="text-align:left">{escape(name)}</td><td style="text-align:left">{escape(value)}</td></tr>'
        for name, value in rows
    )
    return f"<div><strong>{escape(title)}</strong><table>{cells}</table>{below}</div>"


def model_html(model: Any) -> str:
    """Table of a thermal model: kind, parts, states and, of a single channel, R_th and the range of time constants."""
    rows = [("heated", ", ".join(model.inputs)), ("read", ", ".join(model.outputs)), ("states", str(model.order))]
    if (len(model.inputs), len(model.outputs)) == (1, 1) and model.order <= 500:
        with contextlib.suppress(InputError):  # matrices that are not those of heat flow are shown without it
            rows.append(("thermal resistance", f"{model.thermal_resistance / 1e3:.4g} K/mW"))
    tau = getattr(getattr(model, "linear", model), "tau", None)
    if tau is not None:
        ends = [quantity.rounded(t, "s") for t in (np.min(tau), np.max(tau))]
        rows.append(("time constants", " to ".join(dict.fromkeys(ends))))
    if hasattr(model, "coefficient"):
        rows.append(("output map", f"z + ({model.coefficient:.3g} /K) z²"))
    return card(type(model).__name__, rows)


def section_card(section: CrossSection) -> str:
    """Table of the layers and parts of a geometry; `thermofem.plot.plot_cross_section` draws them."""
    rows = [(f"layer {layer.name}", f"{layer.material}, {_length(layer.thickness)}") for layer in section.layers]
    for part in section.parts:
        edges = f"{'x' if part.straight else 'r'} {_length(part.inner_radius)} to {_length(part.outer_radius)}"
        size = f"{edges}, height {_length(part.height)}"
        rows.append((f"part {part.name}", f"{part.material}, {size}" + (", heated" if part.heated else "")))
    rows.append(("ends at", _length(section.outer_radius)))
    return card(section.name, rows)


def _length(value: float) -> str:
    return quantity.rounded(value, "m", 6)


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
