"""A chip of 16 racetracks with a heater along each: one thermal model, its map, and how hard a lock must work.

One heater is switched by 1 mW; the others' rings move by the crosstalk, which their own heaters must take back.

python examples/chip.py [picture.png]
"""

import sys
from dataclasses import replace

import numpy as np

import surrogate
import thermofem as th
from surrogate.plot import plot_layout
from thermofem.plot import save_figure

guide = th.straight_guide()
metal = th.Part("heater", "TiN", bottom=guide.top_z, height=100e-9, heated=True, x=0.0, width=2e-6)
section = replace(guide, parts=(*guide.parts, metal))
shapes = []
for number in range(16):
    place = {"radius": 5e-6, "straight": 8e-6, "at": (28e-6 * (number % 4), 34e-6 * (number // 4))}
    shapes.append(th.racetrack(f"ring {number + 1}", section, **place))
    shapes.append(th.racetrack(f"heater {number + 1}", section, part="heater", **place))
layout = surrogate.reduce_layout(shapes)
print(f"{len(shapes)} shapes, {layout.order} states, passive: {layout.passive}, bound {layout.error_bound:.1%}")

by_heaters = layout.crosstalk[::2, 1::2]  # rise of each ring per watt in each heater
step = np.zeros(16)
step[5] = by_heaters[5, 5] * 1e-3  # K: ring 6 is to move by what 1 mW does alone, all others are locked
power = np.linalg.solve(by_heaters, step)
print(f"1 mW in heater 6 moves ring 6 by {step[5]:.2f} K and ring 7 by {by_heaters[6, 5] * 1e3:.1f} mK")
print(f"with all other rings locked: {power[5] * 1e3:.4f} mW, and {power[6] * 1e6:.1f} uW in heater 7")
axes = plot_layout(layout.model.outputs, layout.outlines, layout.crosstalk)
save_figure(axes, sys.argv[1] if len(sys.argv) > 1 else "chip.png")
