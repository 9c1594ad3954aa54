"""Fig. 5, Section 5: temperature of the ring by finite elements, and the exponentials that follow it or do not."""

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.sparse.linalg import spsolve

import coupled
import surrogate
import thermofem as th
from thermofem.plot import BLUE, GREEN, INK, VERMILION, plot_field

from .printed import (
    CENTRE, FEM_SET, HEATING, HEAT_CAPACITY, NEWTON_FIT, RING, at, heat, legend, panel, periods_of, printed
)
from .report.study import Result, figure, study

PULSE = 20e-6  # s, Fig. 5(a)
CYCLE = 151  # samples of the absorbed power


@study("Fig. 5(a): 20 µs pulse", quick=True)
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


@study("Section 5: jump of the slope", quick=True)
def jump(elements):
    """Fall of dT/dt in the moment in which 2 mW end: of the FEM, -P c.(E^-1 b), and of Eq. 3, -eta P/(m c_p)."""
    system, model = heat().system, elements.models["elements"]
    core = heat().geometry.parts[0]
    fem = HEATING * (system.C @ spsolve(system.E.tocsc(), system.B)).item()
    eta = printed.SECOND_ORDER_FEM.eta
    equation = HEATING * eta / HEAT_CAPACITY
    times = np.geomspace(1e-10, 1e-7, 301)
    slopes = HEATING * np.exp(-times[:, None] / model.tau) @ (np.asarray(model.R) / model.tau)
    capacity = th.materials.find("Si").heat_capacity * core.height * elements.numbers["perimeter_m"]
    return Result({
        "eta": eta, "fem_K_per_s": fem, "equation_K_per_s": equation,
        "core_K_per_s": HEATING / (capacity * (core.outer_radius - core.inner_radius)),
        "equal_after_s": times[np.argmax(slopes < equation)],
    })


def heat_of_the_pair():
    """The absorbed power of a settled cycle of Newton's law with the pair of Fig. 5(b)."""
    run = coupled.simulate(RING, NEWTON_FIT, **at(CENTRE), duration=20e-6)
    period = coupled.pulsing(run).period
    times = np.linspace(0, period, CYCLE)
    power = np.interp(20e-6 - 1.5 * period + times, run["time"].values, run["absorbed"].values)
    power[-1] = power[0]
    return th.Sampled(times, power, repeat=True)


@study("Fig. 5(b): the heat of self-pulsing")
def heating():
    """The heat of a settled self-pulsing cycle given to the FEM, and one and two poles fitted to its answer."""
    wave, n = heat_of_the_pair(), 2 * CYCLE
    data = th.solve_periodic(heat(), wave, n)
    seen = data["delta_T"].values
    second, free = surrogate.fit_second_order(data), surrogate.fit_newton(data)

    def cooled(tau):
        return surrogate.newton(tau_th=float(tau), heat_capacity=HEAT_CAPACITY)

    def misfit(log_tau):
        return float(np.mean((cooled(np.exp(log_tau)).periodic_response(wave, n) - seen) ** 2))

    best = minimize_scalar(misfit, bounds=np.log([5e-9, 2e-6]), method="bounded").x
    models = {
        "one_pole": cooled(np.exp(best)), "paper_pair": NEWTON_FIT, "paper_caption": cooled(417e-9),
        "second_order": second.model, "paper_second_order": FEM_SET,
    }
    off = {name: model.periodic_response(wave, n) - seen for name, model in models.items()}
    numbers = {
        "one_pole_tau_s": np.max(models["one_pole"].tau), "second_order": dict(second.parameters),
        "newton": dict(free.parameters), "misfit_K": {name: np.std(error) for name, error in off.items()},
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
    inset.collections[0].set_rasterized(True)  # thousands of triangles
    for axis in (axis for one in (inset, *inset.child_axes) for axis in (one.xaxis, one.yaxis)):
        axis.set_tick_params(labelsize="x-small")
        axis.label.set_fontsize("x-small")
    return legend(ax, "above")


@figure
def fig5b(heating):
    return periods_of(heating.data["elements"], heating.models, {
        "one_pole": ("--", VERMILION, f"ODE1 (1): c$_p$, {heating.numbers['one_pole_tau_s'] * 1e9:.0f} ns"),
        "paper_pair": ("-", VERMILION, "ODE1 (2): 6.9 c$_p$, 417 ns"), "second_order": ("-", BLUE, "ODE2, fitted"),
        "paper_second_order": (":", GREEN, "ODE2, the paper's set"),
    })
