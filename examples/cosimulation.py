"""FEM in the loop: a self-pulsing ring, and its cross-section heating, cooling, and before the next pulse.

Writes cosimulation.png; takes a few seconds.
"""

import matplotlib.pyplot as plt
import numpy as np

import coupled
import thermofem as th

heat = th.assemble(th.strip_ring())
ring, drive = coupled.borghi2021(), {"power": 6.31e-3, "detuning": 0.0, "duration": 20e-6}  # 8 dBm
found = coupled.pulsing(coupled.cosimulate(ring, heat, **drive))
end = drive["duration"]
times = end - found.period * np.array([0.9, 0.6, 0.3])
run = coupled.cosimulate(ring, heat, field_times=times, **drive)

fig = plt.figure(figsize=(5.7, 4.6), layout="constrained")
top, bottom = fig.subfigures(2, 1, height_ratios=[1, 1.15])
left = top.subplots()
last = run.sel(time=slice(end - 2 * found.period, None))
t = (last.time - end) * 1e9
left.plot(t, last["drop"] * 1e3, color="#0072B2")
left.set(xlabel="time before the end (ns)", xlim=(t[0], 0), title=f"period {found.period * 1e9:.1f} ns")
left.set_ylabel("drop power (mW)", color="#0072B2")
right = left.twinx()
right.plot(t, last.delta_T, color="#D55E00", linestyle=(0, (5, 1)))
right.set_ylabel("temperature rise (K)", color="#D55E00")
levels = np.arange(0, float(run.field.max()) + 0.5, 0.5)
axes = bottom.subplots(1, 3, sharey=True)
for k, (ax, time) in enumerate(zip(axes, times, strict=True)):
    left.axvline((time - end) * 1e9, color="0.4", linewidth=0.8)
    left.annotate(
        "abc"[k],
        ((time - end) * 1e9, 0.92),
        xycoords=("data", "axes fraction"),
        xytext=(4, 0),
        textcoords="offset points",
    )
    r, z = run.r * 1e6, run.z * 1e6
    image = ax.tricontourf(r, z, run.triangles, run.field[k], levels=levels, cmap="magma")
    ax.set(
        xlim=(6.6, 9.3),
        ylim=(-1.2, 1.4),
        aspect="equal",
        xlabel="r (µm)",
        title=f"{'abc'[k]}: {(time - end) * 1e9:.0f} ns",
    )
axes[0].set_ylabel("z (µm)")
bottom.colorbar(image, ax=axes, label="temperature rise (K)", ticks=levels[::2])
fig.savefig("cosimulation.png", dpi=220)
a = run.attrs
print(f"{a['windows']} windows, {a['passes']} passes, {a['largest_discrepancy'] * 1e3:.2f} mK between light and FEM")
