"""The paper's ring, its printed parameters, and the points that it names; the finite elements of all scripts."""

import functools
import re
from dataclasses import asdict

import matplotlib.pyplot as plt
import numpy as np

import coupled
import surrogate
import thermofem as th
from coupled import parameters as printed
from thermofem.plot import BLUE, GREEN, INK, PURPLE, SKY, VERMILION

HEATING = 2e-3  # W, in Figs. 5 and 7
CENTRE = (8.0, 0.0)  # dBm and GHz, of Fig. 5(b)
MARKED = ((7.0, -10.0), CENTRE, (8.0, 20.0))  # dBm and GHz: (1), (2), (3), whose places the paper only draws
HEAT_CAPACITY = printed.HEAT_CAPACITY  # J/K, 1.09e-14 kg of silicon at 700 J/(kg K), Table 2
POWERS, DETUNINGS = 1e-3 * 10 ** np.linspace(0.3, 1.0, 29), np.linspace(-30e9, 30e9, 36)  # W and Hz, of the maps
RUN, MAP_RUN = 20e-6, 60e-6  # s, of a run alone and of one of a map
RING = coupled.borghi2021()
NEWTON_MAPS = surrogate.newton(**asdict(printed.NEWTON_MAPS))  # Fig. 4(a, b); with the lumped dispersion
NEWTON_FIT = surrogate.newton(**asdict(printed.NEWTON_FIT))  # Model 2, caption of Fig. 5
FEM_SET = surrogate.second_order(**asdict(printed.SECOND_ORDER_FEM))  # caption of Fig. 5
EXPERIMENT_SET = surrogate.second_order(**asdict(printed.SECOND_ORDER_EXPERIMENT))  # Section 5
COLOURS = {
    "FEM": INK, "Newton": VERMILION, "Newton, the paper's": VERMILION, "second order": BLUE,
    "second order, the paper's": SKY, "SINDy": GREEN, "reduction": PURPLE,
}


@functools.cache
def heat():
    """The finite elements of a ring of the same perimeter as the paper's racetrack, under 2 µm of oxide."""
    return th.assemble(th.strip_ring(), accuracy=1e-3)


def at(point):
    """Laser of a point in dBm and GHz, as keywords."""
    return {"power": 1e-3 * 10 ** (point[0] / 10), "detuning": point[1] * 1e9}


def label(point):
    """Name of a point: '8dBm_-10GHz'."""
    return f"{point[0]:g}dBm_{point[1]:g}GHz"


def slug(name):
    """A name as part of a file name: 'second order, 1 µs' becomes 'second_order_1_µs'."""
    return re.sub(r"[^\w.+-]+", "_", name.replace("'", "")).strip("_")


def describe(run):
    """Regime, period (s), duty cycle, swing (K) and cycles of a run, for JSON."""
    found = coupled.pulsing(run)
    return {"regime": str(found.regime), "period_s": found.period, "duty": found.duty, "swing_K": found.swing}


def late(run, last=5e-6):
    """The end of a run, all that a figure needs."""
    return run.isel(time=np.flatnonzero(run["time"].values >= run["time"].values[-1] - last))


def panel(width=4.6, height=3.3):
    """A new panel, which reads on a phone."""
    return plt.subplots(figsize=(width, height), layout="constrained")[1]


def legend(ax, loc="best", columns=2):
    """Legend without a frame, or outside of the panel, "above" it."""
    place, where = (ax.get_figure(), "outside upper left") if loc == "above" else (ax, loc)
    place.legend(loc=where, ncols=columns if loc == "above" else 1, frameon=False, fontsize="small", columnspacing=1.0)
    return ax


def periods_of(data, models, lines, columns=2):
    """Three periods of the FEM's periodic state as dots, and of models as lines: style, colour and words by name."""
    ax, time, n = panel(4.6, 3.8), data["time"].values * 1e6, data["time"].size
    wave, time = th.waveforms.from_json(data.attrs["waveform"]), np.concatenate([k * time[-1] + time for k in range(3)])
    ax.plot(time[::9], np.tile(data["delta_T"].values, 3)[::9], "s", color=INK, markersize=3.2, label="FEM")
    for name, (style, colour, words) in lines.items():
        ax.plot(time, np.tile(models[name].periodic_response(wave, n), 3), style, color=colour, label=words)
    ax.set(xlabel="time (µs)", ylabel="mean rise of the core (K)", xlim=(0, time[-1]), ylim=(0, None))
    return legend(ax, "above", columns)
