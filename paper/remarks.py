"""Sections 5 and 7: where one exponential suffices, what may be enlarged in place of c_p, and other stacks."""

from dataclasses import replace

import numpy as np

import coupled
import surrogate
import thermofem as th
from thermofem.plot import BLUE, INK, SKY, VERMILION

from .printed import CENTRE, HEATING, HEAT_CAPACITY, NEWTON_MAPS, RING, RUN, at, describe, heat, legend, panel
from .report.study import Result, figure, study

BITS = 2047
FACTORS = np.linspace(1, 8, 29)
STACKS = {  # the reference ring but for one thickness, or in a far larger domain; the paper states none
    "top_0.5um": {"cladding": 0.5e-6}, "top_1um": {"cladding": 1e-6}, "top_4um": {"cladding": 4e-6},
    "box_1um": {"box": 1e-6}, "box_3um": {"box": 3e-6}, "large": {"substrate": 100e-6, "outer_radius": 150e-6},
}


@study("Section 7: on-off keying", quick=True)
def keying(elements):
    """One exponential, silicon's c_p and tau_th = R_th m c_p so that the steady rise is the FEM's, under random bits.

    "off": rms difference from the FEM over the mean rise, in the periodic state; "ripple" of the FEM's own rise.
    """
    fem = elements.models["elements"]
    numbers = {"tau_th_s": fem.thermal_resistance * HEAT_CAPACITY}
    newton = surrogate.newton(tau_th=numbers["tau_th_s"], heat_capacity=HEAT_CAPACITY)
    bits = np.repeat(np.random.default_rng(7).integers(0, 2, BITS), 2) * 2.0 * HEATING
    for rate in (1e6, 1e9, 10e9, 25e9):
        edges = (np.arange(BITS)[:, None] + (0.05, 0.95)).ravel() / rate
        wave = th.Sampled(np.append(edges, BITS / rate), np.append(bits, bits[0]), repeat=True)
        rise, other = (model.periodic_response(wave, 32 * BITS + 1) for model in (fem, newton))
        off, ripple = np.std(other - rise) / rise.mean(), np.std(rise) / rise.mean()
        numbers[f"{rate * 1e-9:g}Gbps"] = {"off": off, "ripple": ripple}
    return Result(numbers)


@study("Section 7: c_p of silicon kept", quick=True)
def kept(elements):
    """Newton's law with silicon's c_p and 275 ns at (8 dBm, 0 GHz): sigma_FCD, or tau_fc, times a factor.

    "least": from which factor on it pulses; "factor": where its period is nearest to the FEM-coupled ring's.
    """

    def pulses(ring, model=NEWTON_MAPS):
        return describe(coupled.simulate(ring, model, **at(CENTRE), duration=RUN))

    law, fem = RING.carriers, pulses(RING, elements.models["reduction"])
    numbers = {"fem": fem, "tried": FACTORS.size, "most": FACTORS[-1]}
    changes = {
        "sigma": lambda f: {"fcd": tuple((f * sigma, exponent) for sigma, exponent in RING.fcd)},
        "lifetime": lambda f: {"carriers": replace(law, tau_n=f * law.tau_n, tau_p=f * law.tau_p)},
    }
    for name, change in changes.items():
        found = {f: one for f in FACTORS if np.isfinite((one := pulses(replace(RING, **change(f))))["period_s"])}
        numbers[name] = {"count": len(found), "least": min(found, default=None)}
        if found:
            near = min(found, key=lambda f: abs(found[f]["period_s"] - fem["period_s"]))
            numbers[name] |= {"factor": near, **found[near]}
    return Result(numbers)


@study("the ring in other stacks")
def stacks():
    """R_th of the ring in other stacks, and how near ring and disc come to Newton's law."""
    oxide, base = replace(th.materials.find("SiO2"), conductivity=1.0), th.disc(radius=5e-6, rim=1e-6)
    above = th.Part("air above", "void", 0.0, base.outer_radius, bottom=0.22e-6, height=2e-6)
    below = th.Part("air below", "void", 2.5e-6, base.outer_radius, bottom=-2e-6, height=2.22e-6)
    geometries = {name: th.strip_ring(**options) for name, options in STACKS.items()} | {
        "oxide_1W": replace(th.strip_ring(), materials=(oxide,)),
        "disc": replace(base, parts=(above, below, *base.parts)),  # in air, on a pedestal of oxide half as wide
    }
    heats = {name: th.assemble(geometry, 1e-3) for name, geometry in geometries.items()}
    numbers = {name: one.thermal_resistance() for name, one in heats.items()} | {"one_pole": {}}
    model = surrogate.reduce(heats["top_1um"].system, tolerance=1e-4).model
    numbers["period_s"] = describe(coupled.simulate(RING, model, **at(CENTRE), duration=RUN))["period_s"]
    data, models = {}, {}
    for name, one in (("disc", heats["disc"]), ("strip", heat())):
        poles = surrogate.reduce(one.system, tolerance=1e-4).dynamics
        data[name] = th.solve_periodic(one, th.SquareWave(HEATING, 1e-6, 1 / 3))
        fit = surrogate.fit_newton(data[name])
        models |= {name: poles, f"{name}_newton": fit.model}
        share = np.max(poles.R) / np.sum(poles.R)
        numbers["one_pole"][name] = {"share": share, "misfit": fit.relative_residual}
    return Result(numbers, data, models)


@figure
def pedestal(stacks):
    ax, times = panel(), np.linspace(0, 8e-6, 801)
    lines = {"disc": (BLUE, SKY, "disc in air on a pedestal"), "strip": (INK, VERMILION, "ring in oxide")}
    for name, (colour, light, words) in lines.items():
        model, tau = stacks.models[name], stacks.models[f"{name}_newton"].tau[0]
        left = np.exp(-times[:, None] / np.asarray(model.tau)) @ np.asarray(model.R) / model.thermal_resistance
        ax.semilogy(times * 1e6, left, color=colour, linewidth=2, label=words)
        words = f"one exponential, {tau * 1e9:.0f} ns"
        ax.semilogy(times * 1e6, np.exp(-times / tau), "--", color=light, linewidth=1.2, label=words)
    ax.set(xlabel="time after the heat went off (µs)", ylabel="rise over its start", xlim=(0, 8), ylim=(1e-3, 1.2))
    return legend(ax)
