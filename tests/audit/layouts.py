"""Audit of layouts: random racetracks, heaters, strips and pads; reciprocity, passivity and the bound of each.

    python tests/audit/layouts.py 200

Passivity is the definition, no negative eigenvalue of Re Z(i w), at 33 frequencies from 1e3 to 1e11 1/s. There must be
no failure.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from layouts import random_layout

import surrogate

failures = 0
bounds = []
skews = []  # largest |H_ij - H_ji| at rest, over the largest R_th
eigenvalues = []  # least of Re Z(i w), over the same
count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
for seed in range(count):
    layout = surrogate.reduce_layout(random_layout(1000 + seed))
    model = layout.model
    rate = -model.A.diagonal()
    least = np.inf
    for omega in np.geomspace(1e3, 1e11, 33):
        Z = (model.C / (1j * omega + rate)) @ model.B
        least = min(least, float(np.linalg.eigvalsh((Z + Z.conj().T).real / 2)[0]))
    highest = float(model.gain.max())
    skew = float(np.abs(model.gain - model.gain.T).max())
    # 1e-12 of R_th: round-off
    failed = not layout.passive or max(-least, skew) > 1e-12 * highest
    failures += failed
    bounds.append(layout.error_bound)
    skews.append(skew / highest)
    eigenvalues.append(least / highest)
    print(f"{seed}: {layout.rings} shapes, {layout.order} states, bound {layout.error_bound:.1e}", "FAILED" * failed)
print(f"{count} layouts, {failures} failures, largest bound {max(bounds):.1e}")
print(f"in units of the largest R_th: asymmetry {max(skews):.1e}, least eigenvalue {min(eigenvalues):.1e}")
