"""Matrices for SciPy, MATLAB and pyMOR, in SI: E dx/dt = A x + B P, dT = C x.

A Quadratic adds H and G as `thermofem.Quadratic` has them; an output map adds its coefficient:
dT = C x + coefficient (C x)^2.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from thermofem import Quadratic, StateSpace
from thermofem.data.files import write_whole

from .modes import modes


def write(model: Any, path: Path, header: list[str]) -> Path:
    """Write A, B, C, E and the names of inputs and outputs; see `surrogate.export_model`."""
    from scipy.io import savemat

    if isinstance(model, StateSpace):
        matrices = {"E": model.E, "A": model.A, "B": model.B, "C": model.C}
    elif isinstance(model, Quadratic):
        matrices = {"E": np.eye(model.order), "A": model.A, "B": model.B[:, None], "C": model.C[None]}
        matrices |= {"H": model.H, "G": model.G}
    else:
        found = modes(model)
        matrices = {"E": np.eye(found.rate.size), "A": -np.diag(found.rate), "B": found.B, "C": found.C}
        if found.coefficient:
            matrices["coefficient"] = found.coefficient
    words = {"inputs": list(model.inputs), "outputs": list(model.outputs), "header": "\n".join(header)}
    return write_whole(path, lambda p: savemat(str(p), {**matrices, **words}, appendmat=False, do_compression=True))
