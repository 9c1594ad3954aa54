"""What stands at the top of every exported file: which model, of what, how good, in which units."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

import thermofem
from thermofem import ThermalModel


def header(model: ThermalModel, provenance: Mapping[str, Any]) -> list[str]:
    """Lines of text: kind of model and size, heated and read parts, error, units, geometry."""
    name, order = type(model).__name__, getattr(model, "order", None)
    lines = [
        f"Thermal model of thermofem {thermofem.__version__}: {name}" + (f" with {order} poles" if order else ""),
        f"heated: {', '.join(model.inputs)}; read: {', '.join(model.outputs)}; thermal resistance {_gain(model)} K/W",
        f"error: {_error(provenance)}",
        "units: power in W, temperature rise above ambient in K, time in s",
    ]
    geometry = provenance.get("geometry")
    if not geometry:
        return [*lines, "geometry: not recorded"]
    return [*lines, "geometry:", *(f"    {line}" for line in str(geometry).splitlines() if line.strip())]


def _gain(model: Any) -> str:
    """Static gain, a row for each part that is read."""
    if (len(model.inputs), len(model.outputs)) == (1, 1):
        return f"{model.thermal_resistance:.6g}"
    return "; ".join(", ".join(f"{value:.6g}" for value in row) for row in np.asarray(model.gain))


def _error(provenance: Mapping[str, Any]) -> str:
    """The proven bound of a reduction, the misfit of a fit, or that nothing is known."""
    if "error_bound" in provenance:
        mesh = provenance.get("mesh_accuracy")
        of = f" of mesh accuracy {mesh:g}" if isinstance(mesh, (int, float)) else ""
        return f"below {provenance['error_bound']:.1e} of the thermal resistance at every frequency, from the FEM{of}"
    if "residual_K" in provenance:
        drives = ", ".join(map(str, provenance.get("training", ()))) or "its training data"
        return f"misfit {provenance['residual_K']:.3g} K rms over {drives}"
    return "not recorded"


def comment(lines: Iterable[str], mark: str) -> str:
    """The lines as comments in plain ASCII, which every simulator reads."""
    return "".join(f"{mark} {line}".rstrip() + "\n" for line in lines).encode("ascii", "backslashreplace").decode()


def identifiers(names: Iterable[str], *, taken: Iterable[str] = ()) -> list[str]:
    """Names that simulators accept: letters, digits and single underscores, no two alike even where case counts not.

    Double underscores are left to the exporters' own nodes.
    """
    used, result = {name.lower() for name in taken}, []
    for name in names:
        base = re.sub(r"[\W_]+", "_", name, flags=re.ASCII).strip("_")
        base = base if base[:1].isalpha() else f"n_{base}"
        word = next(w for k in range(10_000) if (w := base if not k else f"{base}_{k}").lower() not in used)
        used.add(word.lower())
        result.append(word)
    return result
