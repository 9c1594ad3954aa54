"""Sections 5 and 7: the ring in other stacks, which the paper does not state; a disc on a pedestal; k(T) and c_p(T)."""

from dataclasses import replace

import numpy as np

import coupled
import surrogate
import thermofem as th
from thermofem.plot import BLUE, INK, SKY, VERMILION

from .printed import CENTRE, HEATING, RING, at, heat, legend, panel
from .report.study import OTHER, Result, figure, study

HOT = 23e-3  # W, which heats the core by about 167 K
STACKS = {  # the reference ring but for one thickness, or in a far larger domain
    "top_0.5um": {"cladding": 0.5e-6},
    "top_1um": {"cladding": 1e-6},
    "top_4um": {"cladding": 4e-6},
    "box_1um": {"box": 1e-6},
    "box_3um": {"box": 3e-6},
    "large": {"substrate": 100e-6, "outer_radius": 150e-6},
}


def on_pedestal():
    """A disc in air on a pedestal of oxide half as wide."""
    base = th.disc(radius=5e-6, rim=1e-6)
    above = th.Part("air above", "void", 0.0, base.outer_radius, bottom=0.22e-6, height=2e-6)
    below = th.Part("air below", "void", 2.5e-6, base.outer_radius, bottom=-2e-6, height=2.22e-6)
    return replace(base, name="disc on a pedestal", parts=(above, below, *base.parts))


@study("the ring in other stacks", 1.5)
def stacks():
    """R_th of the ring in other stacks, and how near ring and disc come to Newton's law."""
    oxide = replace(th.materials.find("SiO2"), conductivity=1.0)
    geometries = {name: th.strip_ring(**options) for name, options in STACKS.items()}
    geometries |= {"oxide_1W": replace(th.strip_ring(), materials=(oxide,)), "disc": on_pedestal()}
    heats = {name: th.assemble(geometry, 1e-3) for name, geometry in geometries.items()}
    model = surrogate.reduce(heats["top_1um"].system, tolerance=1e-4).model
    run = coupled.simulate(RING, model, **at(CENTRE), duration=20e-6)
    numbers = {name: one.thermal_resistance() for name, one in heats.items()} | {"one_pole": {}}
    data, models = {}, {}
    for name, one in (("disc", heats["disc"]), ("strip", heat())):
        poles = surrogate.reduce(one.system, tolerance=1e-4).dynamics
        data[name] = th.solve_periodic(one, th.SquareWave(HEATING, 1e-6, 1 / 3))
        fit = surrogate.fit_newton(data[name])
        models |= {name: poles, f"{name}_newton": fit.model}
        misfit = fit.residual / np.ptp(data[name]["delta_T"].values)
        numbers["one_pole"][name] = {"share": np.max(poles.R) / np.sum(poles.R), "misfit": misfit}
    return Result(numbers | {"period_s": coupled.pulsing(run).period}, data, models)


@study("k(T) and c_p(T)", 1)
def hot():
    """The reference strip with k(T) and c_p(T): how far linear models and an output map go in the steady state."""
    film, oxide = th.materials.find("Si(T)"), th.materials.find("SiO2(T)")
    warm = replace(th.strip_ring(), materials=(replace(film, name="Si"), replace(oxide, name="SiO2")))
    system = th.assemble(warm, 1e-3).model("core", "core")
    powers, mapped = np.geomspace(0.03, 1, 10) * HOT, surrogate.output_map(system, HOT)
    rise = np.array([system.steady_rise(power)[0] for power in powers])
    off = np.abs(mapped.thermal_resistance * powers / rise - 1)  # grows with power
    numbers = {
        "rise_K": rise[-1], "linear_error": off[-1], "rise_within_1_percent_K": np.interp(0.01, off, rise),
        "map_error": np.max(np.abs([mapped.steady_rise(power) for power in powers] / rise - 1)),
    }
    return Result(numbers)


@figure
def pedestal(stacks):
    ax, times = panel(), np.linspace(0, 8e-6, 801)
    for name, colour, light in (("disc", BLUE, SKY), ("strip", INK, VERMILION)):
        model = stacks.models[name]
        left = np.exp(-times[:, None] / np.asarray(model.tau)) @ np.asarray(model.R) / model.thermal_resistance
        words = {"disc": "disc in air on a pedestal", "strip": "ring in oxide"}[name]
        ax.semilogy(times * 1e6, left, color=colour, linewidth=2, label=words)
        tau = stacks.models[f"{name}_newton"].tau[0]
        start = left[np.searchsorted(times, 1e-6)] * np.exp(1e-6 / tau)
        words = f"one exponential, {tau * 1e9:.0f} ns"
        ax.semilogy(times * 1e6, start * np.exp(-times / tau), "--", color=light, linewidth=1.2, label=words)
    ax.set(xlabel="time after the heat went off (µs)", ylabel="rise over its start", xlim=(0, 8), ylim=(1e-3, 1.2))
    return legend(ax)


OTHER.update({
    "stacks/large": (7.877e3, 7.893e3), "stacks/top_0.5um": (9.06e3, 9.08e3), "stacks/top_1um": (8.38e3, 8.4e3),
    "stacks/top_4um": (7.55e3, 7.57e3), "stacks/box_1um": (6.02e3, 6.04e3), "stacks/box_3um": (9.12e3, 9.14e3),
    "stacks/oxide_1W": (10.79e3, 10.81e3), "stacks/period_s": (726.8e-9, 731.2e-9),
})
