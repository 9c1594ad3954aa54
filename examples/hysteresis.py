"""The tilted resonance of a silicon ring, the loop of a slow laser, and what a laser of finite speed does.

python examples/hysteresis.py [picture.png]
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

import coupled
import surrogate
import thermofem as th
from coupled.plot import plot_transmission

ring = coupled.borghi2021()
model = surrogate.reduce(th.assemble(th.strip_ring()).system, tolerance=1e-3).model
first, last, duration = 30e9, -130e9, 400e-6
steps = np.linspace(first, last, 400)
figure, axes = plt.subplots(3, 1, figsize=(5.7, 8.6), layout="constrained")
for ax, power in zip(axes, (0.5e-3, 2.5e-3, 6.3e-3), strict=True):
    curve = coupled.transmission(ring, model, power=power, detuning=(last, first))
    sweeps = {
        "slow, towards the red": coupled.equilibria.transmission.sweep(ring, model, power=power, detuning=steps),
        "slow, towards the blue": coupled.equilibria.transmission.sweep(ring, model, power=power, detuning=steps[::-1]),
    }
    plot_transmission(curve, ax=ax, sweeps=sweeps)
    # A laser that crosses the window in 400 us, each way: at 2.5 mW and above it finds the ring pulsing.
    for name, start, stop, colour in (("red", first, last, "#56B4E9"), ("blue", last, first, "#E69F00")):
        laser = coupled.Sweep([0, duration], [start, stop])
        settled = coupled.simulate(ring, model, power=power, detuning=start, duration=40e-6)
        run = coupled.simulate(ring, model, power=power, detuning=laser, duration=duration, rtol=1e-5, initial=settled)
        label = f"400 µs, towards the {name}"
        line = {"color": colour, "linewidth": 0.35, "alpha": 0.8, "zorder": 0, "rasterized": True, "label": label}
        ax.plot(run["detuning"].values * 1e-9, run["drop"].values * 1e3, **line)
    ax.set_title(f"{power * 1e3:g} mW", fontsize="small")
    ax.set_ylim(0, 1.15 * float(run["drop"].max()) * 1e3)
for ax in axes[:-1]:
    ax.get_legend().remove()
handles, labels = axes[-1].get_legend_handles_labels()
axes[-1].get_legend().remove()
key = figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False, fontsize="small")
for line in key.get_lines():
    line.set_linewidth(1.4)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "hysteresis.png", dpi=220)
