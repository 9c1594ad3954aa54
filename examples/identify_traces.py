"""Train the paper's second-order equation on noisy drop traces, and Newton's law on each: Section 5 and Fig. 4(d).

No measured traces are published. The experiment here is the finite-element model of the ring itself, coupled to light
and carriers, with 2 % of noise on the photodiode.

python examples/identify_traces.py [picture.png]
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

import coupled
import surrogate
import thermofem as th
from coupled.parameters import HEAT_CAPACITY
from coupled.plot import plot_identification

ring = coupled.borghi2021()
heat = surrogate.reduce(th.assemble(th.strip_ring()).system, tolerance=1e-3).model
noise, times = np.random.default_rng(7), np.arange(0, 30e-6, 2e-9)


def experiment(dbm, ghz):
    """A trace of the ring as a photodiode would show it."""
    run = coupled.simulate(ring, heat, power=1e-3 * 10 ** (dbm / 10), detuning=ghz * 1e9, duration=30e-6, times=times)
    run["drop"] += 0.02 * float(run["drop"].max()) * noise.normal(size=times.size)
    return run


found = coupled.identify(
    ring,
    [experiment(7, -10), experiment(8, 0), experiment(10, 20)],
    free=["kappa", "tau_f", "tau_s", "eta"],
    show_bar=True,
)
for name, value in found.parameters.items():
    print(f"{name:>6} = {value:.4g} ± {found.standard_deviations[name]:.1g}")
places = [(dbm, ghz) for dbm in (6, 7, 8, 9, 10) for ghz in (-10, -5, 0, 5, 10, 15, 20)]
traces = [trace for trace in (experiment(*place) for place in places) if np.isfinite(coupled.pulsing(trace).period)]
newton = coupled.identification.newton_traces.fit_newton_per_trace(ring, traces, show_bar=True)
print(f"Newton's law a trace: {newton.sizes['trace']} traces, correlation {newton.attrs['correlation']:.3f}")

figure = plt.figure(figsize=(5.7, 12), layout="constrained")
top, bottom = figure.subfigures(2, 1, height_ratios=(1.3, 1))
plot_identification(found, top.subplots(3, 1, sharex=True, sharey=True))
above, below = bottom.subplots(2, 1)
dots = above.scatter(newton.tau_th * 1e9, newton.heat_capacity / HEAT_CAPACITY, c=newton.period * 1e9, s=22)
figure.colorbar(dots, ax=above, label="period (ns)")
above.set(xlabel="thermal lifetime (ns)", ylabel="heat capacity / (m c$_{p,ref}$)")
t = np.geomspace(1e-9, 20e-6, 300)
below.semilogx(
    t * 1e9, heat.step_response(t) / 1e3, color="#111111", linewidth=2.4, alpha=0.45, label="finite elements"
)
below.semilogx(t * 1e9, found.model.step_response(t) / 1e3, color="#D55E00", label="trained on the traces")
below.set(xlabel="time after a step of power (ns)", ylabel="temperature rise (K/mW)")
below.legend(frameon=False, fontsize="small")
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "identify_traces.png", dpi=220)
