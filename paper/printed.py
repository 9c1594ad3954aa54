"""The paper's ring, its printed parameters, and the points that it names; the finite elements of all scripts."""

import functools
import re

import matplotlib.pyplot as plt
import numpy as np

import coupled
import surrogate
import thermofem as th
from thermofem.plot import BLUE, GREEN, INK, PURPLE, SKY, VERMILION

HEATING = 2e-3  # W, in Figs. 5 and 7
CENTRE = (8.0, 0.0)  # dBm and GHz, of Fig. 5(b)
MARKED = ((7.0, -10.0), CENTRE, (8.0, 20.0))  # dBm and GHz: (1), (2), (3), whose places the paper only draws
HEAT_CAPACITY = th.models.BORGHI2021_HEAT_CAPACITY  # J/K, 1.09e-14 kg of silicon at 700 J/(kg K), Table 2
SECOND_ORDER_FEM = {"kappa": 8.87e5, "tau_f": 55.8e-9, "tau_s": 1200e-9, "eta": 0.31}  # caption of Fig. 5
SECOND_ORDER_EXPERIMENT = {"kappa": 7.45e5, "tau_f": 71e-9, "tau_s": 1030e-9, "eta": 0.29}  # Section 5
POWERS, DETUNINGS = 1e-3 * 10 ** np.linspace(0.3, 1.0, 29), np.linspace(-30e9, 30e9, 36)  # W and Hz, of the maps
RUN, MAP_RUN = 20e-6, 60e-6  # s, of a run alone and of one of a map
RING = coupled.borghi2021()
NEWTON_MAPS = surrogate.newton(tau_th=275e-9, heat_capacity=HEAT_CAPACITY)  # Fig. 4(a, b); with the lumped dispersion
NEWTON_FIT = surrogate.newton(tau_th=417e-9, heat_capacity=6.9 * HEAT_CAPACITY)  # Model 2, caption of Fig. 5
FEM_SET = surrogate.second_order(**SECOND_ORDER_FEM)
EXPERIMENT_SET = surrogate.second_order(**SECOND_ORDER_EXPERIMENT)
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


def late(run):
    """The last five microseconds of a run, all a figure needs."""
    return run.isel(time=np.flatnonzero(run["time"].values >= run["time"].values[-1] - 5e-6))


def tiled(data, shift=1e6):
    """Three periods of a periodic state: times in µs."""
    time = data["time"].values
    return np.concatenate([k * time[-1] + time for k in range(3)]) * shift


def panel(width=4.6, height=3.3):
    """A new panel, which reads on a phone."""
    return plt.subplots(figsize=(width, height), layout="constrained")[1]


def legend_above(ax, columns=2):
    """Legend outside of the panel, above it."""
    ax.get_figure().legend(loc="outside upper left", ncols=columns, frameon=False, fontsize="small", columnspacing=1.0)
    return ax


def legend(ax, loc="best"):
    """Legend without a frame."""
    ax.legend(frameon=False, fontsize="small", loc=loc)
    return ax
