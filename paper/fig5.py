"""Fig. 5, Section 5: temperature of the ring by finite elements, and the exponentials that follow it or do not."""

import time

import numpy as np
from scipy.optimize import minimize_scalar

import coupled
import surrogate
import thermofem as th
from thermofem.plot import BLUE, GREEN, INK, VERMILION, plot_field

from .printed import CENTRE, FEM_SET, HEATING, HEAT_CAPACITY, NEWTON_FIT, RING, at, heat, legend_above, panel, tiled
from .report.study import OTHER, PAPER, Result, figure, study

PULSE = 20e-6  # s, Fig. 5(a)
CYCLE = 151  # samples of the absorbed power


@study("finite elements and their reduction", 0.3, quick=True)
def elements():
    """The FEM and its certified reductions: "reduction" to 1e-4, and "elements" to 1e-6, which maps use."""
    core, begin = heat().geometry.parts[0], time.process_time()
    rom = surrogate.reduce(heat().system, tolerance=1e-4)
    seconds = time.process_time() - begin
    fine = surrogate.reduce(heat().system, tolerance=1e-6)
    numbers = {
        "perimeter_m": np.pi * (core.inner_radius + core.outer_radius),
        "thermal_resistance_K_per_W": heat().thermal_resistance(), "poles": rom.order, "bound": rom.error_bound,
        "reduction_seconds": seconds, "fine_poles": fine.order, "fine_bound": fine.error_bound,
        "shortest_tau_s": np.min(rom.dynamics.tau), "longest_tau_s": np.max(rom.dynamics.tau),
    }
    return Result(numbers, models={"reduction": rom.model, "elements": fine.model})


@study("Fig. 5(a): 20 µs pulse", 0.3, quick=True)
def pulse():
    """2 mW for 20 us, and exponentials through rise and fall, sampled so that no time counts more than another."""
    edge = np.geomspace(1e-9, 1e-6, 40)
    times = np.unique(np.concatenate([np.linspace(0, 2 * PULSE, 801), edge, PULSE + edge]))
    data = th.solve(heat(), th.Pulse(HEATING, width=PULSE), times, field_times=[21e-6])
    rise = data.drop_dims("field_time").sel(time=np.linspace(0, PULSE, 401), method="nearest")
    fall = data.sel(time=np.linspace(PULSE, 2 * PULSE, 401), method="nearest")
    single, double = surrogate.fit_newton(rise), surrogate.fit_decay(fall["time"] - PULSE, fall["delta_T"])
    numbers = {
        "rise_K": float(data["delta_T"].max()), "rise_tau_s": single.parameters["tau_th"],
        "rise_misfit_K": single.residual, "fall_tau_s": double.tau, "fall_amplitude_K": double.amplitude,
        "fall_misfit_K": double.residual,
    }
    return Result(numbers, {"pulse": data}, {"rise": single.model})


@study("square waves of 1 and 0.8 µs", 0.2, quick=True)
def squares():
    """Square waves of 1 and 0.8 us, 2 mW, 33 %: the FEM's periodic state."""
    data = {f"{T:g}us": th.solve_periodic(heat(), th.SquareWave(HEATING, T * 1e-6, 0.33)) for T in (1, 0.8)}
    return Result({f"swing_{name}_K": np.ptp(one["delta_T"].values) for name, one in data.items()}, data)


def heat_of_the_pair():
    """The absorbed power of a settled cycle of Newton's law with the pair of Fig. 5(b)."""
    run = coupled.simulate(RING, NEWTON_FIT, **at(CENTRE), duration=20e-6)
    period = coupled.pulsing(run).period
    times = np.linspace(0, period, CYCLE)
    power = np.interp(20e-6 - 1.5 * period + times, run["time"].values, run["absorbed"].values)
    power[-1] = power[0]
    return th.Sampled(times, power, repeat=True)


@study("Fig. 5(b): the heat of self-pulsing", 0.2)
def heating():
    """The heat of a settled self-pulsing cycle given to the FEM, and one and two poles fitted to its answer."""
    wave, n = heat_of_the_pair(), 2 * CYCLE
    data = th.solve_periodic(heat(), wave, n)
    seen = data["delta_T"].values
    second, free = surrogate.fit_second_order(data), surrogate.fit_newton(data)

    def cooled(log_tau):
        return surrogate.newton(tau_th=float(np.exp(log_tau)), heat_capacity=HEAT_CAPACITY)

    def misfit(log_tau):
        return float(np.mean((cooled(log_tau).periodic_response(wave, n) - seen) ** 2))

    one = cooled(minimize_scalar(misfit, bounds=(np.log(5e-9), np.log(2e-6)), method="bounded").x)
    models = {
        "one_pole": one, "paper_pair": NEWTON_FIT,
        "paper_caption": surrogate.newton(tau_th=417e-9, heat_capacity=HEAT_CAPACITY), "second_order": second.model,
        "paper_second_order": FEM_SET,
    }
    off = {name: model.periodic_response(wave, n) - seen for name, model in models.items()}
    numbers = {
        "one_pole_tau_s": np.max(one.tau), "second_order": dict(second.parameters), "newton": dict(free.parameters),
        "misfit_K": {name: np.std(error) for name, error in off.items()},
        "mean_off_K": {name: np.mean(error) for name, error in off.items()},
    }
    return Result(numbers, {"elements": data}, models)


@figure
def fig5a(pulse):
    ax, data, numbers = panel(4.6, 3.9), pulse.data["pulse"], pulse.numbers
    ax.plot(data["time"] * 1e6, data["delta_T"], color=INK, linewidth=2.2, label="finite elements")
    on, off = np.linspace(0, PULSE, 300), np.linspace(0, PULSE, 600)
    rise = pulse.models["rise"].response(th.Pulse(HEATING, width=PULSE), on)
    ax.plot(on * 1e6, rise, "--", color=VERMILION, label=f"one exponential: {numbers['rise_tau_s'] * 1e9:.0f} ns")
    tau, amplitude = np.array(numbers["fall_tau_s"]), np.array(numbers["fall_amplitude_K"])
    words = f"two: {tau[0] * 1e9:.0f} and {tau[1] * 1e9:.0f} ns"
    ax.plot((PULSE + off) * 1e6, np.exp(-off[:, None] / tau) @ amplitude, "-.", color=BLUE, label=words)
    ax.set(xlabel="time (µs)", ylabel="mean rise of the core (K)", xlim=(0, 40), ylim=(0, 17))
    inset = ax.inset_axes((0.62, 0.40, 0.27, 0.52))
    plot_field(data, inset, half_width=3.5e-6)
    for triangles in inset.collections:
        triangles.set_rasterized(True)  # thousands of them
    for one in (inset, *inset.child_axes):
        one.tick_params(labelsize="x-small")
        one.xaxis.label.set_fontsize("x-small")
        one.yaxis.label.set_fontsize("x-small")
    return legend_above(ax)


@figure
def fig5b(heating):
    ax, data = panel(4.6, 3.9), heating.data["elements"]
    wave, time = th.waveforms.from_json(data.attrs["waveform"]), tiled(data)
    ax.plot(time[::12], np.tile(data["delta_T"].values, 3)[::12], "s", color=INK, markersize=3.4, label="FEM")
    lines = {
        "one_pole": ("--", VERMILION, f"ODE1 (1): c$_p$, {heating.numbers['one_pole_tau_s'] * 1e9:.0f} ns"),
        "paper_pair": ("-", VERMILION, "ODE1 (2): 6.9 c$_p$, 417 ns"), "second_order": ("-", BLUE, "ODE2, fitted"),
        "paper_second_order": (":", GREEN, "ODE2, the paper's set"),
    }
    for name, (style, colour, words) in lines.items():
        rise = heating.models[name].periodic_response(wave, data["time"].size)
        ax.plot(time, np.tile(rise, 3), style, color=colour, label=words)
    ax.set(xlabel="time (µs)", ylabel="mean rise of the core (K)", xlim=(0, time[-1]), ylim=(0, None))
    return legend_above(ax)


PAPER.update({
    "pulse/rise_misfit_K": (0.5, 3), "pulse/fall_misfit_K": (0, 0.3), "squares/swing_0.8us_K": (5.5, 6.5),
    "elements/thermal_resistance_K_per_W": (7.775e3, 7.785e3),
    "heating/one_pole_tau_s": (35e-9, 45e-9), "heating/newton/tau_th": (416.5e-9, 417.5e-9),
    "heating/newton/heat_capacity_ratio": (6.85, 6.95), "heating/second_order/kappa": (8e5, 9.8e5),
    "heating/second_order/tau_f": (50e-9, 62e-9),
})
OTHER.update({
    "pulse/rise_K": (15.35, 15.45), "squares/swing_0.8us_K": (5.855, 5.885), "squares/swing_1us_K": (6.329, 6.342),
    "elements/thermal_resistance_K_per_W": (7859, 7875),
})
