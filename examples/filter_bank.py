"""A bank of four tuned add-drop filters: what the heater of one channel does to the others, and its correction.

python examples/filter_bank.py [picture.png]
"""

import sys
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import coupled
import surrogate
import thermofem as th
from surrogate.plot import plot_crosstalk
from thermofem.plot import CYCLE

plt.rcParams["axes.prop_cycle"] = plt.cycler(color=CYCLE)  # the colours of all figures

N, PITCH, SPACING = 4, 25e-6, 120e9
geometry = replace(th.heated_ring(), outer_radius=200e-6).opened()
heat = th.assemble(geometry)
bank = surrogate.reduce_array(heat, [(k * PITCH, 0) for k in range(N)], tolerance=1e-3, heaters=("heater",))
ring = coupled.borghi2021()
by_heater = bank.crosstalk[:, N:]  # K/W, ring by heater

# Channel k is to lie k x 120 GHz below the cold resonance.
wanted = SPACING * np.arange(1, N + 1) * 2 * np.pi / ring.thermal_shift  # K
naive = wanted / np.diag(by_heater)
corrected = np.linalg.solve(by_heater, wanted)
print("heater powers in mW, crosstalk left out: ", (naive * 1e3).round(2))
print("heater powers in mW, crosstalk taken in: ", (corrected * 1e3).round(2))
print(
    "channels off by GHz where it is left out:",
    ((by_heater @ naive - wanted) * ring.thermal_shift / 2e9 / np.pi).round(1),
)

figure, axes = plt.subplots(3, 1, figsize=(5.7, 8.6), layout="constrained", height_ratios=(1.4, 1, 1))
plot_crosstalk(bank, axes[0])
detunings = np.linspace(-(N + 1) * SPACING, 0.0, 2001)
for power, style, name in ((naive, ":", "crosstalk left out"), (corrected, "-", "crosstalk taken in")):
    shift = ring.thermal_shift * (by_heater @ power) / (2 * np.pi)
    rings = [replace(ring, frequency=ring.frequency - float(df)) for df in shift]
    circuit = replace(coupled.bus(rings), frequency=ring.frequency)
    lines = coupled.transmission(circuit, detuning=detunings).transmission
    for k in range(N):
        label = name if k == 0 else None
        axes[1].plot(detunings * 1e-9, lines.sel(port=f"drop {k + 1}"), style, color=f"C{k}", lw=1, label=label)
axes[1].set(xlabel="detuning (GHz)", ylabel="drop transmission", ylim=(-0.02, 1.2))
axes[1].legend(frameon=False, fontsize="small", loc="upper right")

# Channel 1 is switched; a faint laser on the flank of channel 2 sees it.
switch = th.Pulse(power=float(corrected[0]), width=100e-6)
circuit = coupled.bus([ring] * N)
others = {f"heater {k + 1}": float(corrected[k]) for k in range(1, N)}
run = coupled.simulate(
    circuit, bank, power={"in": 1e-9}, heaters={"heater 1": switch, **others}, duration=200e-6,
    times=np.linspace(0, 200e-6, 401),
)  # fmt: skip
for k in range(1, N):
    rise = run.delta_T.isel(ring=k)
    axes[2].plot(
        run.time * 1e6, (rise - rise[0]) * ring.thermal_shift / 2e9 / np.pi, color=f"C{k}", label=f"ring {k + 1}"
    )
axes[2].set(xlabel="time (µs)", ylabel="shift by the heater of ring 1 (GHz)")
axes[2].legend(frameon=False, fontsize="small")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "filter_bank.png", dpi=200)
