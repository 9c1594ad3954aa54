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
    cells = ""
    for texts in rows:
        columns = "".join(f'<td style="text-align:left">{escape(text)}</td>' for text in texts)
        cells += f"<tr>{columns}</tr>"
    return f"<div><strong>{escape(title)}</strong><table>{cells}</table>{below}</div>"


def model_html(model: Any) -> str:
    """Table of a thermal model: kind, parts, states and, of a single channel, R_th and the range of time constants."""
    rows = [("heated", ", ".join(model.inputs)), ("read", ", ".join(model.outputs)), ("states", str(model.order))]
    single = len(model.inputs) == len(model.outputs) == 1
    if single and model.order <= 500:
        with contextlib.suppress(InputError):  # matrices that are not those of heat flow are shown without it
            rows.append(("thermal resistance", f"{model.thermal_resistance / 1e3:.4g} K/mW"))
    tau = getattr(getattr(model, "linear", model), "tau", None)
    if tau is not None:
        shortest = quantity.rounded(np.min(tau), "s")
        longest = quantity.rounded(np.max(tau), "s")
        span = shortest if shortest == longest else f"{shortest} to {longest}"
        rows.append(("time constants", span))
    if hasattr(model, "coefficient"):
        rows.append(("output map", f"z + ({model.coefficient:.3g} /K) z²"))
    return card(type(model).__name__, rows)


def section_card(section: CrossSection) -> str:
    """Table of the layers and parts of a geometry; `thermofem.plot.plot_preview` draws them."""
    rows = [(f"layer {layer.name}", f"{layer.material}, {_length(layer.thickness)}") for layer in section.layers]
    for part in section.parts:
        axis = "x" if part.straight else "r"
        edges = f"{axis} {_length(part.inner_radius)} to {_length(part.outer_radius)}"
        words = f"{part.material}, {edges}, height {_length(part.height)}"
        if part.heated:
            words += ", heated"
        rows.append((f"part {part.name}", words))
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
    rows = []
    for m in materials:
        varies = "follows T" if m.varies else ""
        rows.append((m.name, m.conductivity, m.density, m.specific_heat, varies, m.source))
    frame = pd.DataFrame(rows, columns=head).set_index("")
    write = "{:g}".format
    if not html:
        return str(frame.drop(columns="source").to_string(float_format=write, index_names=False))
    with pd.option_context("display.max_colwidth", None):
        return str(frame.to_html(float_format=write, index_names=False))
