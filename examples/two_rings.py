"""Two self-pulsing rings 20 um apart that heat each other: what the slow heat of a neighbour does to a ring.

python examples/two_rings.py [picture.png]
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

import coupled
import surrogate
import thermofem as th

DURATION, SETTLED = 80e-6, 60e-6
ring = coupled.borghi2021()
array = surrogate.reduce_array(th.assemble(th.strip_ring(outer_radius=120e-6)), [(0, 0), (20e-6, 0)], tolerance=1e-3)
alone = surrogate.reduce(th.assemble(th.strip_ring()).system, tolerance=1e-3).model
lasers = [coupled.LaserPort("one", "ring 1.in"), coupled.LaserPort("two", "ring 2.in")]
circuit = coupled.Circuit([ring, ring], lasers=lasers)

# Ring 1 pulses at 8 dBm. Ring 2, at 5 dBm, first has a dark neighbour, then the pulsing one.
inputs = {"one": 6.31e-3, "two": 3.16e-3}
together = coupled.simulate_circuit(circuit, array, inputs=inputs, duration=DURATION, rtol=1e-5)
apart = coupled.simulate_circuit(circuit, alone, inputs=inputs, duration=DURATION, rtol=1e-5)


def period(run, name):
    """Mean period of the settled pulses in s: rising crossings of the middle of the carrier density."""
    one = run.sel(ring=name).isel(time=run.time.values > SETTLED)
    level = one.carriers.values - one.carriers.values.min() - np.ptp(one.carriers.values) / 2
    up = np.flatnonzero((level[:-1] < 0) & (level[1:] >= 0))
    times = one.time.values[up]
    return float(np.diff(times).mean()) if times.size > 2 else np.nan


for name in circuit.names:
    own, beside = period(apart, name) * 1e9, period(together, name) * 1e9
    print(f"{name}: {own:.1f} ns alone, {beside:.1f} ns beside the other")
share = array.crosstalk[0, 1] / array.crosstalk[0, 0]
print(f"crosstalk {share:.3f}, half of it after {array.half_times[0, 1] * 1e6:.1f} us")

figure, axes = plt.subplots(2, 2, figsize=(11, 5.5), layout="constrained", sharex="col", sharey="row")
for row, name in enumerate(circuit.names):
    for column, window in enumerate(((0, 6e-6), (SETTLED, SETTLED + 6e-6))):
        ax = axes[row, column]
        for run, colour, label in (
            (apart, "#56B4E9", "far from the other"),
            (together, "#D55E00", "20 µm from the other"),
        ):
            inside = (run.time >= window[0]) & (run.time <= window[1])
            ax.plot(run.time[inside] * 1e6, run.delta_T.sel(ring=name)[inside], color=colour, label=label, lw=1)
        ax.set_title(f"{name}, {inputs['one' if row == 0 else 'two'] * 1e3:.2f} mW", fontsize="small", loc="left")
    axes[row, 0].set_ylabel("temperature rise (K)")
for ax in axes[1]:
    ax.set_xlabel("time (µs)")
axes[0, 0].legend(frameon=False, fontsize="small")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "two_rings.png", dpi=150)
