"""A heater above a ring: how fast and how strongly it tunes the core, and how hot it gets itself. Writes heater.png."""

import matplotlib.pyplot as plt
import numpy as np

import thermofem as th

heat = th.assemble(th.heated_ring(heater_width=2e-6))
times = np.geomspace(10e-9, 100e-6, 120)
data = th.solve(heat, th.Constant(10e-3), times, heated="heater", read=("heater", "core", "substrate"))

fig, ax = plt.subplots(figsize=(6, 4), layout="constrained")
for probe, style in zip(data.probe.values, ("-", "--", ":"), strict=True):
    ax.semilogx(times * 1e6, data.delta_T.sel(probe=probe), label=str(probe), linestyle=style)
share = heat.thermal_resistance("heater", "core") / heat.thermal_resistance("heater")
ax.set(
    xlabel="time (µs)",
    ylabel="mean temperature rise (K)",
    title=f"10 mW in the heater: the core gets {share:.0%} of the heater's rise",
)
ax.legend()
ax.grid(alpha=0.3)
fig.savefig("heater.png", dpi=150)
