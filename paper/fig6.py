"""Figs. 4(c) and 6(c), Section 5: Eq. 3 trained on three traces, and the traces of every model."""

import matplotlib.pyplot as plt
import numpy as np

import coupled
from thermofem.plot import BLUE, GREEN, INK, ORANGE, PURPLE, VERMILION

from .maps import NEWTON, models_of
from .printed import CENTRE, EXPERIMENT_SET, FEM_SET, MARKED, NEWTON_FIT, RING, RUN, at, describe, label, late, slug
from .report.study import Result, figure, study

WINDOW = 2.6e-6  # s, of the traces
FITTED = "Newton, fitted to this trace"


@study("second order fitted to traces")
def second_order_fit(loop):
    """The training of Fig. 6: the second-order equation fitted to three traces at once."""
    traces = [loop.data[label(point)] for point in MARKED]
    found = coupled.identify(RING, traces, free=("kappa", "tau_f", "tau_s", "eta"), runs=4)
    numbers = {
        "parameters": found.parameters, "deviations": found.standard_deviations, "traces": len(traces),
        "shape_error": found.residuals["shape_error"].values.max(), "notes": found.notes,
    }
    return Result(numbers, models={"second_order": found.model})


@study("Figs. 4(c) and 6(c): traces")
def marked(elements, training, second_order_fit, newton_fits):
    """Traces at the marked points with every model, and with Newton's law fitted to each."""
    data, numbers = {}, {}
    for point in MARKED:
        models = models_of(elements, training, second_order_fit) | {FITTED: (RING, newton_fits.models[label(point)])}
        runs = {name: coupled.simulate(*case, **at(point), duration=RUN) for name, case in models.items()}
        numbers[label(point)] = {name: describe(run) for name, run in runs.items()}
        data |= {f"{label(point)}.{slug(name)}": late(run) for name, run in runs.items()}
    return Result(numbers, data)


@study("self-pulsing at (8 dBm, 0 GHz)", quick=True)
def traces(elements, training):
    """Every model at (8 dBm, 0 GHz) from a cold start, 20 us."""
    models = {
        "Newton, the paper's fit": NEWTON_FIT, "Newton, 0.8 µs square": training.models["newton_0.8us"],
        "second order, the paper's, FEM": FEM_SET, "second order, the paper's, experiment": EXPERIMENT_SET,
        "second order, 1 µs square": training.models["second_order_1us"], "SINDy": training.models["sindy"],
        "reduction": elements.models["reduction"],
    }
    runs = {name: coupled.simulate(RING, model, **at(CENTRE), duration=RUN) for name, model in models.items()}
    numbers = {name: describe(run) for name, run in runs.items()}
    swapped = coupled.simulate(RING.with_swapped_srh(), models["reduction"], **at(CENTRE), duration=RUN)
    change = coupled.pulsing(swapped).period / numbers["reduction"]["period_s"] - 1
    return Result(numbers | {"exchanged": {"period_change": change}})


def line(ax, run, style, colour, words=None, width=1.2):
    """The end of a run from a rise of the carriers on, over the drop power's maximum."""
    end = late(run, 2 * WINDOW)
    time, N, drop = (end[name].values for name in ("time", "carriers", "drop"))
    up = np.flatnonzero((N[:-1] < N.max() / 2) & (N[1:] >= N.max() / 2) & (time[1:] <= time[-1] - WINDOW))
    start = time[up[-1]] if up.size else time[-1] - WINDOW
    ax.plot((time - start) * 1e6, drop / drop.max(), style, color=colour, linewidth=width, label=words)
    ax.set(xlim=(0, WINDOW * 1e6), ylim=(0, 1.08), yticks=(0, 1))


def at_marked(loop, marked, *lines):
    """Drop traces at the marked points: the FEM in the loop in black, models over it."""
    axes = plt.subplots(3, 1, figsize=(4.6, 4.6), sharex=True, layout="constrained")[1]
    for k, (ax, point) in enumerate(zip(axes, MARKED, strict=True), 1):
        line(ax, loop.data[label(point)], "-", INK, "FEM in the loop", 2.0)
        for name, style, colour, words in lines:
            line(ax, marked.data[f"{label(point)}.{slug(name)}"], style, colour, words)
        ax.set_title(f"({k})  {point[0]:g} dBm, {point[1]:g} GHz", fontsize="small", loc="left")
    axes[1].set_ylabel("drop power over its maximum")
    axes[2].set_xlabel("time (µs)")
    handles = axes[0].get_legend_handles_labels()
    axes[0].figure.legend(*handles, loc="outside upper left", ncols=2, frameon=False, fontsize="small")
    return axes[0]


NEWTON_LINES = (
    (NEWTON, "--", VERMILION, "Model 1: c$_p$, 275 ns"), (FITTED, "-", ORANGE, "Model 2: fitted c$_p$, τ$_{th}$")
)
OTHER_LINES = ("SINDy", "-.", GREEN, "SINDy"), ("reduction", "--", PURPLE, "reduction")
figure(lambda loop, marked: at_marked(loop, marked, *NEWTON_LINES), "fig4c")
figure(lambda loop, marked: at_marked(loop, marked, ("second order", "-", BLUE, "second order")), "fig6c")
figure(lambda loop, marked: at_marked(loop, marked, *OTHER_LINES), "other_traces")
