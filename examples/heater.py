"""A heater above a ring: how fast and how strongly it tunes the core, and how hot it gets itself. Writes heater.png."""

import matplotlib.pyplot as plt
import numpy as np

import thermofem as th
from thermofem.plot import plot_field, plot_response

heat = th.assemble(th.heated_ring(heater_width=2e-6))
times = np.geomspace(10e-9, 100e-6, 120)
data = th.solve(heat, th.Constant(10e-3), times, heated="heater", read=("heater", "core"), field_times=[100e-6])

fig, (above, below) = plt.subplots(2, 1, figsize=(5.7, 6), layout="constrained", height_ratios=(1.25, 1))
plot_response(data, above)
for probe, color in (("heater", "#0072B2"), ("core", "#D55E00")):
    steady, rise = 10e-3 * heat.thermal_resistance("heater", probe), data.delta_T.sel(probe=probe)
    half = np.interp(steady / 2, rise, times) * 1e6
    above.plot(half, steady / 2, "o", color=color)
    above.annotate(f"half after {half:.2g} µs", (half, steady / 2), (-8, 4), textcoords="offset points", ha="right")
share = heat.thermal_resistance("heater", "core") / heat.thermal_resistance("heater")
above.set(xscale="log", xlim=(0.01, 100), title=f"10 mW in the heater: the core gets {share:.0%} of its rise")
above.xaxis.set_major_formatter("{x:g}")
above.grid(alpha=0.25)
plot_field(data, below, half_width=4.4e-6)
for name, at, text in (("heater", (8.6, 2.28), (9.6, 1.2)), ("core", (8.18, 0.11), (9.6, -0.4))):
    below.annotate(name, at, text, color="white", arrowprops={"arrowstyle": "-", "color": "white"})
below.set_title("steady state")
fig.savefig("heater.png", dpi=220)
