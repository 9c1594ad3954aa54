"""Matrices of a thermal model for SciPy, MATLAB and pyMOR, and a table of its poles.

Matrices are in SI: E dx/dt = A x + B P, dT = C x. A Quadratic adds H and G as `thermofem.Quadratic` has them; an output
map adds its coefficient.
"""

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat

from thermofem import Quadratic, StateSpace
from thermofem.data.files import write_whole
from thermofem.export.export_header import Target, comment
from thermofem.export.poles import poles_of


def write_mat(model: Any, target: Target) -> Path:
    """Write A, B, C, E and the names of inputs and outputs; see `surrogate.export_model`."""
    if isinstance(model, StateSpace):
        matrices = {"E": model.E, "A": model.A, "B": model.B, "C": model.C}
    elif isinstance(model, Quadratic):
        matrices = {"E": np.eye(model.order), "A": model.A, "B": model.B[:, None], "C": model.C[None]}
        matrices |= {"H": model.H, "G": model.G}
    else:
        found = poles_of(model)
        matrices = {"E": np.eye(found.rate.size), "A": -np.diag(found.rate), "B": found.B, "C": found.C}
        if found.coefficient:
            matrices["coefficient"] = found.coefficient
    words = {"inputs": list(model.inputs), "outputs": list(model.outputs), "header": "\n".join(target.header)}
    return write_whole(
        target.path, lambda p: savemat(str(p), {**matrices, **words}, appendmat=False, do_compression=True)
    )


def write_csv(model: Any, target: Target) -> Path:
    """Write the columns ``tau (s)`` and ``R READ from HEATED (K/W)``; see `surrogate.export_model`."""
    found = poles_of(model)
    text = io.StringIO()
    text.write(comment(target.header, "#"))
    if found.coefficient:
        text.write(f"# rise: z + ({found.coefficient!r} /K) z^2, where z is what the poles add up to\n")
    rows = csv.writer(text, lineterminator="\n")
    pairs = [(j, i) for j in range(len(found.outputs)) for i in range(len(found.inputs))]
    rows.writerow(["tau (s)", *(f"R {found.outputs[j]} from {found.inputs[i]} (K/W)" for j, i in pairs)])
    for k, rate in enumerate(found.rate):
        rows.writerow([repr(float(1 / rate)), *(repr(float(found.C[j, k] * found.B[k, i] / rate)) for j, i in pairs)])
    return write_whole(target.path, lambda p: p.write_text(text.getvalue(), encoding="utf-8"))
