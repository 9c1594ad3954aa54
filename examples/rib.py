"""The slab under a rib spreads the heat of its core: R_th and step response against its thickness. Writes rib.png."""

import matplotlib.pyplot as plt
import numpy as np

import thermofem as th

times = np.geomspace(1e-9, 50e-6, 100)
fig, ax = plt.subplots(figsize=(6, 4), layout="constrained")
rings = {"strip, no slab": th.strip_ring(width=500e-9)}
rings |= {f"rib, slab {slab} nm": th.rib_ring(width=500e-9, slab=slab * 1e-9) for slab in (50, 90, 150)}
for name, ring in rings.items():
    heat = th.assemble(ring)
    step = th.solve(heat, th.Constant(1e-3), times).delta_T
    ax.semilogx(times * 1e6, step, label=f"{name}: {heat.thermal_resistance() / 1e3:.2f} K/mW")
ax.set(xlabel="time (µs)", ylabel="rise of the core at 1 mW (K)", title="A rib runs cooler than a strip")
ax.legend()
ax.grid(alpha=0.3)
fig.savefig("rib.png", dpi=150)
