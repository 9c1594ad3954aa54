"""The slab under a rib spreads the heat of its core: R_th, step response and field. Writes rib.png."""

import matplotlib.pyplot as plt
import numpy as np

import thermofem as th
from thermofem.plot import plot_field

times = np.geomspace(1e-9, 50e-6, 100)
rings = {"strip, no slab": th.strip_ring(width=500e-9)}
rings |= {f"rib, slab {slab} nm": th.rib_ring(width=500e-9, slab=slab * 1e-9) for slab in (50, 90, 150)}
fig, axes = plt.subplot_mosaic("ll;ub", figsize=(5.7, 5.2), layout="constrained", height_ratios=(1.3, 1))
left, upper, lower = axes.values()
below = {"strip, no slab": upper, "rib, slab 90 nm": lower}
for (name, ring), color in zip(rings.items(), ("#222222", "#56B4E9", "#0072B2", "#D55E00"), strict=True):
    heat = th.assemble(ring)
    data = th.solve(heat, th.Constant(1e-3), times, field_times=[1e-6])
    label = f"{name}: {heat.thermal_resistance() / 1e3:.2f} K/mW"
    left.semilogx(times * 1e6, data.delta_T, color=color, label=label)
    if name in below:
        plot_field(data, below[name], half_width=1.3e-6)
        below[name].set(ylim=(-0.8, 0.8), title=f"{name}, after 1 µs")
left.set(
    xlabel="time (µs)", ylabel="rise of the core at 1 mW (K)", title="A rib runs cooler than a strip", xlim=(1e-3, 50)
)
left.legend(frameon=False)
left.xaxis.set_major_formatter("{x:g}")
left.grid(alpha=0.25)
upper.set_xlabel("")
fig.savefig("rib.png", dpi=220)
