"""A chip of 32 racetracks with a heater along each, reduced to one model: time, memory and error.

    python benchmarks/bench_layout.py [columns] [rows]

Without arguments 8 x 4 rings, 64 shapes. The error is the largest difference of K/W between two shapes from those of a
reduction to a tenth of the tolerance, as a share of the shape's own R_th; beside it stands the certified bound.
Reciprocity is the largest difference of K/W from shape a to b and from b to a. The limits are 60 s on two cores and
2 GB.
"""

from __future__ import annotations

import resource
import sys
import time
from dataclasses import replace

import numpy as np

import surrogate
import thermofem as th


def chip(columns: int, rows: int) -> list[th.Shape]:
    """Racetracks of 5 um and 8 um on a pitch of 28 by 34 um, and heaters of 2 um above them."""
    guide = th.straight_guide()
    metal = th.Part("heater", "TiN", bottom=guide.top_z, height=100e-9, heated=True, x=0.0, width=2e-6)
    section = replace(guide, parts=(*guide.parts, metal))
    shapes = []
    for number in range(columns * rows):
        place = (28e-6 * (number % columns), 34e-6 * (number // columns))
        outline = {"radius": 5e-6, "straight": 8e-6, "at": place}
        shapes.append(th.racetrack(f"ring {number + 1}", section, **outline))
        shapes.append(th.racetrack(f"heater {number + 1}", section, part="heater", **outline))
    return shapes


def main(columns: int, rows: int) -> None:
    shapes = chip(columns, rows)
    began = time.perf_counter()
    used = time.process_time()
    layout = surrogate.reduce_layout(shapes, tolerance=1e-3)
    wall = time.perf_counter() - began
    cpu = time.process_time() - used
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    finer = surrogate.reduce_layout(shapes, tolerance=1e-4)
    own = np.diag(finer.crosstalk)
    error = np.abs(layout.crosstalk - finer.crosstalk).max() / own.min()
    reciprocity = np.abs(layout.crosstalk - layout.crosstalk.T).max() / own.min()
    print(f"{len(shapes)} shapes, {layout.order} states: {wall:.1f} s, {cpu:.1f} s of CPU, {memory:.2f} GB")
    print(f"error {error:.1e} of R_th, bound {layout.error_bound:.1e}, reciprocity {reciprocity:.0e}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3] or ("8", "4")))
