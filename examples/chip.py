"""A chip of 16 racetracks with a heater along each: one thermal model, its map, and one ring in a lock.

The heater of the neighbouring ring is switched on. It moves ring 6 by the crosstalk, which the lock takes back: the
full equations of ring 6 run in windows, and its drop power at the end of one sets its heater in the next.

python examples/chip.py [picture.png]
"""

import sys
from dataclasses import replace

import numpy as np

import coupled
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

# ---- ring 6 in a lock: an integrator on its drop power sets its heater every window -------------------------------
WINDOW, WINDOWS, CROSSOVER = 5e-6, 120, 5e3  # s, number, Hz
POWER, DETUNING, BIAS, NEIGHBOUR = 0.5e-3, -12e9, 2e-3, 4e-3  # W, Hz from the warm resonance, W in heaters 6 and 7
names = ["ring 6", "heater 6", "heater 7"]
columns = [layout.model.inputs.index(name) for name in names]
row = layout.model.outputs.index("ring 6")
own, crosstalk = layout.crosstalk[row, columns[1:]]  # rise of ring 6 per watt in heaters 6 and 7
driven = layout.model.B[:, columns].any(axis=1)
rate = -layout.model.A.diagonal()[driven]
B = layout.model.B[driven][:, columns]
C = layout.model.C[[row]][:, driven]
model = th.StateSpace(np.eye(rate.size), np.diag(-rate), B, C, inputs=tuple(names), outputs=("ring 6",))
ring = coupled.borghi2021()
warm = ring.thermal_shift / (2 * np.pi) * own * BIAS
light = {"power": POWER, "detuning": DETUNING - warm, "heated": "ring 6", "read": "ring 6"}
plant = coupled.linearize(ring, model, heaters={"heater 6": BIAS}, **light)
setpoint = float(plant.state["drop"])
gain = 2 * np.pi * CROSSOVER * WINDOW / plant.static[plant.outputs.index("drop"), plant.inputs.index("heater 6")]


def drops(feedback, start):
    """Drop power (W) at the end of every window, and the last power of heater 6; heater 7 is on from the start."""
    watts, state, found = BIAS, start, []
    for _ in range(WINDOWS):
        heaters = {"heater 6": watts, "heater 7": NEIGHBOUR}
        run = coupled.simulate(ring, model, heaters=heaters, duration=WINDOW, times=[WINDOW], initial=state, **light)
        state = coupled.State.end_of(run)
        found.append(float(run["drop"][-1]))
        watts += feedback * (setpoint - found[-1])
    return np.array(found), watts


idle = {"heater 6": BIAS, "heater 7": 0.0}
rest = coupled.simulate(ring, model, heaters=idle, duration=500e-6, times=[500e-6], **light)
rest = coupled.State.end_of(rest)
free, _ = drops(0.0, rest)
locked, watts = drops(gain, rest)
print(f"{NEIGHBOUR * 1e3:g} mW in heater 7 move ring 6 by {crosstalk * NEIGHBOUR * 1e3:.0f} mK")
print(f"drop power of ring 6 without a lock: {free[-1] / setpoint - 1:+.1%}")
print(f"in the lock: {abs(locked / setpoint - 1).max():.1%} at most, {abs(locked[-1] / setpoint - 1):.2%} at the end")
print(
    f"heater 6 takes back {(BIAS - watts) * 1e6:.1f} uW, by the static gains {crosstalk / own * NEIGHBOUR * 1e6:.1f} uW"
)

# ---- all other rings locked: what 1 mW in heater 6 makes them take back -------------------------------------------
by_heaters = layout.crosstalk[::2, 1::2]  # rise of each ring per watt in each heater
step = np.zeros(16)
step[5] = by_heaters[5, 5] * 1e-3  # K
power = np.linalg.solve(by_heaters, step)
print(f"1 mW in heater 6 alone moves ring 6 by {step[5]:.2f} K; with all others locked {power[5] * 1e3:.4f} mW do")
axes = plot_layout(layout.model.outputs, layout.outlines, layout.crosstalk)
save_figure(axes, sys.argv[1] if len(sys.argv) > 1 else "chip.png")
