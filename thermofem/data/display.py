"""HTML tables of models, fits and geometries, for notebooks."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from ..checks import InputError
from . import quantity

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection
    from ..materials.material_library import Material


def card(title: str, rows: Iterable[tuple[str, str]], below: str = "") -> str:
    """HTML of a titled table of names and values, followed by the HTML ``below``."""
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
    """Table of the layers and parts of a geometry; `thermofem.plot.plot_preview` draws them."""
    rows = [(f"layer {layer.name}", f"{layer.material}, {_length(layer.thickness)}") for layer in section.layers]
    for part in section.parts:
        edges = f"{'x' if part.straight else 'r'} {_length(part.inner_radius)} to {_length(part.outer_radius)}"
        size = f"{edges}, height {_length(part.height)}"
        rows.append((f"part {part.name}", f"{part.material}, {size}" + (", heated" if part.heated else "")))
    rows.append(("ends at", _length(section.outer_radius)))
    return card(section.name, rows)


def _length(value: float) -> str:
    return quantity.rounded(value, "m", 6)


def materials_text(materials: Iterable[Material], *, html: bool = False) -> str:
    """Text with a line for each material: name, conductivity, density, specific heat, dependence on temperature.

    html: a table for notebooks, with the sources.
    """
    import pandas as pd  # type: ignore[import-untyped]

    head = ["", "k (W/m/K)", "density (kg/m^3)", "c_p (J/kg/K)", " ", "source"]
    rows = [
        (m.name, m.conductivity, m.density, m.specific_heat, "follows T" if m.varies else "", m.source)
        for m in materials
    ]
    frame, write = pd.DataFrame(rows, columns=head).set_index(""), "{:g}".format
    if not html:
        return str(frame.drop(columns="source").to_string(float_format=write, index_names=False))
    with pd.option_context("display.max_colwidth", None):
        return str(frame.to_html(float_format=write, index_names=False))
