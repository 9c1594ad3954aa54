"""A SCISSOR of three rings: its transmission at low power against the detuning, and its pulses at high power.

python examples/scissor.py [picture.png]
"""

import sys
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import coupled
import surrogate
import thermofem as th
from coupled.plot import plot_ports, plot_rings

one = coupled.borghi2021()
array = surrogate.reduce_array(
    th.assemble(th.strip_ring(outer_radius=150e-6).opened()), [(k * 25e-6, 0) for k in range(3)], tolerance=1e-3
)
figure, axes = plt.subplots(3, 1, figsize=(5.7, 8), layout="constrained")
detunings = np.linspace(-40e9, 40e9, 801)
for sigma, style in ((0.0, "-"), (8e9, "--")):
    circuit = coupled.scissor([one] * 3, phase=0.5, loss=0.05).scattered(sigma, seed=2)
    lines = coupled.transmission(circuit, detuning=detunings).transmission
    for port, colour in (("through", "#D55E00"), ("drop", "#0072B2")):
        label = port if sigma == 0 else f"{port}, resonances scattered by 8 GHz"
        axes[0].plot(detunings * 1e-9, lines.sel(port=port), style, color=colour, label=label, lw=1)
axes[0].set(xlabel="detuning (GHz)", ylabel="transmission at low power", ylim=(-0.03, 1.3))
axes[0].legend(frameon=False, fontsize="small", ncols=2, loc="upper center")

circuit = coupled.scissor([one, replace(one, frequency=one.frequency - 3e9), one], phase=0.5, loss=0.05)
run = coupled.simulate(circuit, array, power={"in": 8e-3}, duration=6e-6, rtol=1e-5)
plot_rings(run, ax=axes[1])
plot_ports(run, axes[2])
print(f"{run.attrs['steps']} steps; hottest {float(run.delta_T.max()):.2f} K")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "scissor.png", dpi=220)
