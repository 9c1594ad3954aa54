"""Poles as a table: time constants, and the thermal resistance of each between every heated and every read part."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

from thermofem.data.files import write_whole

from .header import comment
from .modes import modes


def write(model: Any, path: Path, header: list[str]) -> Path:
    """Write ``tau (s)`` and ``R READ from HEATED (K/W)`` columns; see `surrogate.export_model`."""
    found = modes(model)
    text = io.StringIO()
    text.write(comment(header, "#"))
    if found.coefficient:
        text.write(f"# rise: z + ({found.coefficient!r} /K) z^2, where z is what the poles add up to\n")
    rows = csv.writer(text, lineterminator="\n")
    pairs = [(j, i) for j in range(len(found.outputs)) for i in range(len(found.inputs))]
    rows.writerow(["tau (s)", *(f"R {found.outputs[j]} from {found.inputs[i]} (K/W)" for j, i in pairs)])
    for k, rate in enumerate(found.rate):
        rows.writerow([repr(float(1 / rate)), *(repr(float(found.C[j, k] * found.B[k, i] / rate)) for j, i in pairs)])
    return write_whole(path, lambda p: p.write_text(text.getvalue(), encoding="utf-8"))
