"""A heater above a ring: how fast and how strongly it tunes the core, and how hot it gets itself. Writes heater.png."""

import matplotlib.pyplot as plt
import numpy as np

import thermofem as th
from thermofem.plot import plot_field, plot_response

heat = th.assemble(th.heated_ring(heater_width=2e-6))
times = np.geomspace(10e-9, 100e-6, 120)
data = th.solve(heat, th.Constant(10e-3), times, heated="heater", read=("heater", "core"), field_times=[100e-6])

fig, (left, right) = plt.subplots(1, 2, figsize=(9.6, 3.8), layout="constrained", width_ratios=(1.25, 1))
plot_response(data, left)
for probe, color in (("heater", "#0072B2"), ("core", "#D55E00")):
    steady, rise = 10e-3 * heat.thermal_resistance("heater", probe), data.delta_T.sel(probe=probe)
    half = np.interp(steady / 2, rise, times) * 1e6
    left.plot(half, steady / 2, "o", color=color)
    left.annotate(f"half after {half:.2g} µs", (half, steady / 2), (-8, 4), textcoords="offset points", ha="right")
share = heat.thermal_resistance("heater", "core") / heat.thermal_resistance("heater")
left.set(xscale="log", xlim=(0.01, 100), title=f"10 mW in the heater: the core gets {share:.0%} of its rise")
left.xaxis.set_major_formatter("{x:g}")
left.grid(alpha=0.25)
plot_field(data, right, half_width=4.4e-6)
for name, at, text in (("heater", (8.6, 2.28), (9.6, 1.2)), ("core", (8.18, 0.11), (9.6, -0.4))):
    right.annotate(name, at, text, color="white", arrowprops={"arrowstyle": "-", "color": "white"})
right.set_title("steady state")
fig.savefig("heater.png", dpi=150)
