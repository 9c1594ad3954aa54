"""Two rings 20 um apart, each with a laser of its own: what the slow heat of a neighbour does to a self-pulsing ring.

Shift: the neighbour's mean heat moves the resonance, hence the period. Silence: near an edge of its pulsing range a
ring falls silent beside a pulsing one. Lock: two rings of slightly different power, whose pulses drift apart or not.

python examples/two_rings.py [picture.png]
"""

import sys
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import coupled
import surrogate
import thermofem as th

SKY, VERMILION = "#56B4E9", "#D55E00"
ring = coupled.borghi2021()
array = surrogate.reduce_array(
    th.assemble(th.strip_ring(outer_radius=120e-6).opened()), [(0, 0), (20e-6, 0)], tolerance=1e-3
)
laws = {"far from the other": (array.channel(0, 0), SKY), "20 µm from the other": (array, VERMILION)}
lasers = [coupled.LaserPort("one", "ring 1.in"), coupled.LaserPort("two", "ring 2.in")]


def pair(df=0.0):
    """Two rings; the laser of the second is ``df`` Hz from its cold resonance, that of the first on it."""
    second = replace(ring, frequency=ring.frequency - df)
    return coupled.Circuit([ring, second], lasers=lasers)


def pulses(run, name):
    """Times in s at which the carriers rise through the middle of their range."""
    one = run.carriers.sel(ring=name).values
    level = one - (one.max() + one.min()) / 2
    return run.time.values[1:][(level[:-1] < 0) & (level[1:] >= 0)]


def simulate(circuit, heat, powers, duration):
    """A run with the powers of the two lasers in W."""
    inputs = dict(zip(("one", "two"), powers, strict=True))
    return coupled.simulate(circuit, heat, power=inputs, duration=duration, rtol=1e-5)


figure, column = plt.subplots(4, 1, figsize=(5.7, 9.4), layout="constrained")
axes = column.reshape(2, 2, order="F")
for label, (heat, colour) in laws.items():
    run = simulate(pair(), heat, (6.31e-3, 3.16e-3), 80e-6)
    late = run.isel(time=run.time.values > 60e-6)
    for k, name in enumerate(("ring 1", "ring 2")):
        period = np.diff(pulses(late, name)).mean()
        print(f"{name}, {label}: period {period * 1e9:.1f} ns, mean rise {float(late.delta_T[k].mean()):.2f} K")
        axes[k, 0].plot(late.time * 1e6, late.delta_T[k], color=colour, label=label, lw=1)
        axes[k, 0].set(xlim=(60, 66), ylabel="temperature rise (K)")
        axes[k, 0].set_title(f"{name}, {(6.31, 3.16)[k]} mW", fontsize="small", loc="left")

    detunings, swings = np.arange(-16e9, 26e9, 0.5e9), []
    for df in detunings:
        run = simulate(pair(df), heat, (6.31e-3, 3.16e-3), 60e-6)
        swings.append(float(np.ptp(run.delta_T.values[1, run.time.values > 45e-6])))
    pulsing = detunings[np.array(swings) > 1.0]
    print(f"ring 2, {label}: pulses from {pulsing.min() / 1e9:.1f} to {pulsing.max() / 1e9:.1f} GHz")
    axes[0, 1].plot(detunings / 1e9, swings, ".-", color=colour, lw=1, ms=4)

    run = simulate(pair(), heat, (6.31e-3, 6.30e-3), 200e-6)
    one, two = (pulses(run, name) for name in ("ring 1", "ring 2"))
    t = np.linspace(5e-6, 195e-6, 400)
    phase = np.interp(t, one, np.arange(one.size)) - np.interp(t, two, np.arange(two.size))
    print(f"powers 0.16 % apart, {label}: {phase[-1] - phase[0]:+.2f} pulses of difference in 190 us")
    axes[1, 1].plot(t * 1e6, phase - phase[0], color=colour, lw=1)
axes[1, 0].set_xlabel("time (µs)")
axes[0, 1].legend([axes[0, 1].lines[k] for k in (0, 1)], list(laws), frameon=False, fontsize="small", loc="lower left")
axes[0, 1].set(xlabel="detuning of ring 2 (GHz)", ylabel="swing of ring 2 (K)")
axes[1, 1].set(xlabel="time (µs)", ylabel="lead of ring 1 (pulses)")
share = array.crosstalk[0, 1] / array.crosstalk[0, 0]
print(f"crosstalk {share:.3f}, half of it after {array.half_times[0, 1] * 1e6:.1f} us")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "two_rings.png", dpi=220)
