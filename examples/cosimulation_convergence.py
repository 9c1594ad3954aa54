"""How waveform relaxation converges: pass by pass in one window, for predictors from none to a Krylov reduction.

The window holds the rise of a self-pulse at (8 dBm, 0 GHz). Writes convergence.png.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.interpolate import CubicHermiteSpline

import coupled
import surrogate
import thermofem as th
from coupled.runs.window import advance
from thermofem.waveforms import PiecewiseCubic

RING, POWER = coupled.borghi2021(), 6.31e-3
heat = th.assemble(th.strip_ring())
second = surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1200e-9, eta=0.31)
newton = surrogate.newton(tau_th=275e-9)


def absorbed(run):
    """The absorbed power of a run as a waveform."""
    spline = CubicHermiteSpline(run.time, run.absorbed, run.absorbed_slope)
    return PiecewiseCubic.of_spline(spline)


def relax(model, length, passes=12):
    """Largest discrepancy in K after each pass over a window that begins 20 ns before the first pulse."""
    fem = coupled.FEM(heat, max_discrepancy=1e-7)
    own, start = fem.predictor, 0.0
    state = coupled.State.cold(own.order)
    cold = advance(RING, own, state, 0.0, 1e-6, power=POWER, rtol=1e-8)
    start = cold.time[np.argmax(cold.absorbed)] - 20e-9
    before = advance(RING, own, state, 0.0, start, power=POWER, rtol=1e-8, slopes=True)
    rise = fem.advance(before.time, absorbed(before))
    fem.accept()
    same = model is own or model is None
    model = own if model is None else model
    begin = before.final if same else coupled.State(before.final.field, before.final.carriers, np.zeros(model.order))
    offset, sizes = (0.0 if same else rise[-1]), []
    for _ in range(passes):
        run = advance(RING, model, begin, start, start + length, power=POWER, offset=offset, rtol=1e-9, slopes=True)
        change = fem.advance(run.time, absorbed(run)) - run.delta_T
        sizes.append(np.abs(change).max())
        new = (offset(run.time) if callable(offset) else offset) + change
        offset = CubicHermiteSpline(run.time, new, np.gradient(new, run.time, edge_order=2))
    return np.array(sizes)


fig, axes = plt.subplots(2, 1, figsize=(5.7, 6.4), layout="constrained", sharex=True, sharey=True)
cases = {
    "none": coupled.loop.cosimulate.NO_PREDICTOR,
    "Newton": newton,
    "second order": second,
    "Krylov reduction (default)": None,
}
marks = zip(cases.items(), "ovs^", ("#000000", "#D55E00", "#0072B2", "#009E73"), strict=True)
for (name, model), mark, color in marks:
    axes[0].semilogy(np.arange(1, 13), relax(model, 40e-9), color=color, marker=mark, markersize=4, label=name)
for length, mark, color in zip((10e-9, 20e-9, 40e-9, 80e-9), "ovs^", plt.cm.cividis([0, 0.3, 0.6, 0.85]), strict=True):
    sizes = relax(newton, length)
    axes[1].semilogy(np.arange(1, 13), sizes, color=color, marker=mark, markersize=4, label=f"{length * 1e9:.0f} ns")
axes[0].set(ylabel="largest discrepancy (K)", title="predictors, window of 40 ns", ylim=(1e-8, 100))
axes[1].set(xlabel="pass", ylabel="largest discrepancy (K)", title="Newton's law, length of the window")
for ax in axes:
    ax.axhline(1e-3, color="0.5", linewidth=0.8, linestyle=":")
    ax.legend(frameon=False)
    ax.grid(alpha=0.3)
fig.savefig("convergence.png", dpi=220)
