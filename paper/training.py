"""Section 5: models trained on the FEM's answer to square waves, as the paper trains Eq. 3, and to other drives."""

import numpy as np

import surrogate
import thermofem as th
from thermofem.plot import BLUE, GREEN, INK, VERMILION

from .fig5 import PULSE
from .printed import HEATING, HEAT_CAPACITY, SECOND_ORDER_FEM, heat, legend_above, panel, tiled
from .report.study import OTHER, PAPER, Result, figure, study

ORDERS = (2, 3, 4, 5, 6, 8)  # of Foster networks


@study("training on the FEM", 2, quick=True)
def training(elements, squares):
    """Newton's law, the second-order equation and SINDy, trained on the FEM."""
    numbers, models = {}, {}
    for name, data in squares.data.items():
        for kind, fit in (("newton", surrogate.fit_newton(data)), ("second_order", surrogate.fit_second_order(data))):
            models[f"{kind}_{name}"] = fit.model
            numbers[f"{kind}_{name}"] = {**fit.parameters, "misfit_K": fit.residual}
    sindy = surrogate.train_all(heat(), power=HEATING, names=["SINDy"]).models["SINDy"]
    models["sindy"] = sindy.poles
    trained = {name: models[name] for name in ("newton_1us", "second_order_1us", "sindy")}
    judged = surrogate.compare(trained, elements.models["elements"], surrogate.square_waves(HEATING))
    rms = np.sqrt(np.mean(judged["rms_relative"].values ** 2, axis=1))
    numbers |= {"sindy": {"states": sindy.order}, "rms_over_swing": dict(zip(trained, rms, strict=True))}
    return Result(numbers, models=models)


@study("training on other drives", 0.5)
def drives(elements):
    """Dependence of the trained numbers on the drive, and the error left by every order of model.

    Drives go through the FEM's reduction to 1e-6 of R_th, in closed form.
    """
    model = elements.models["elements"]

    def periodic(period):
        wave = th.SquareWave(HEATING, period, 0.33)
        rise = model.periodic_response(wave, 301)
        return th.dataset.build(np.linspace(0, period, 301), rise, wave, periodic=True)

    def cold(wave, times):
        return th.dataset.build(times, model.response(wave, times), wave)

    cases = {
        "joint": [periodic(period) for period in (0.5e-6, 1e-6, 2e-6)],
        "cold": cold(th.SquareWave(HEATING, 1e-6, 0.33), np.linspace(0, 20e-6, 4001)),
        "pulse": cold(th.Pulse(HEATING, width=PULSE), np.linspace(0, 2 * PULSE, 8001)),
    }
    numbers = {}
    for name, data in cases.items():
        newton = surrogate.fit_newton(data).parameters
        pair = {"newton_tau_s": newton["tau_th"], "newton_ratio": newton["heat_capacity_ratio"]}
        numbers[name] = {**surrogate.fit_second_order(data).parameters, **pair}
    fast = periodic(SECOND_ORDER_FEM["tau_f"])
    newton = surrogate.fit_newton(fast)
    misfit = newton.residual / np.ptp(fast["delta_T"].values)
    numbers["fast"] = {"misfit": misfit, "newton_ratio": newton.parameters["heat_capacity_ratio"]}
    numbers["literal_swing_K"] = np.ptp(literal().periodic_response(th.SquareWave(HEATING, 0.8e-6, 0.33), 301))
    times, steady = np.geomspace(1e-9, 100e-6, 200), model.thermal_resistance
    step = cold(th.Constant(HEATING), times)
    orders = {f"{n} poles": surrogate.fit_foster(step, n, thermal_resistance=steady).model for n in ORDERS}
    judged = surrogate.compare(orders, model, surrogate.square_waves(HEATING))
    numbers["orders"] = np.sqrt(np.mean(judged["rms_relative"].values ** 2, axis=1))
    decay = 1 - step["delta_T"].values / (HEATING * steady)
    fits = [surrogate.fit_decay(times, decay, order=n)(times) for n in range(1, 6)]
    numbers["exponentials"] = [np.max(np.abs(fit - decay)) for fit in fits]
    return Result(numbers)


def literal():
    """Eq. 3 as printed, with the paper's FEM parameters: dP/dt is not divided by m c_p, and so has no effect."""
    kappa, fast, slow = SECOND_ORDER_FEM["kappa"], 1 / SECOND_ORDER_FEM["tau_f"], 1 / SECOND_ORDER_FEM["tau_s"]
    gain = kappa / HEAT_CAPACITY / (fast - slow)
    return th.StateSpace(np.eye(2), -np.diag([fast, slow]), np.array([[-gain], [gain]]), np.ones((1, 2)))


@figure
def square(squares, training):
    ax, data, time = panel(4.6, 3.7), squares.data["1us"], tiled(squares.data["1us"])
    wave = th.waveforms.from_json(data.attrs["waveform"])
    ax.plot(time[::6], np.tile(data["delta_T"].values, 3)[::6], "s", color=INK, markersize=3, label="FEM")
    for name, style, colour, words in (
        ("newton_1us", "--", VERMILION, "Newton"), ("second_order_1us", "-", BLUE, "second order"),
        ("sindy", ":", GREEN, "SINDy"),
    ):
        rise = training.models[name].periodic_response(wave, data["time"].size)
        ax.plot(time, np.tile(rise, 3), style, color=colour, label=words)
    ax.set(xlabel="time (µs)", ylabel="mean rise of the core (K)", xlim=(0, 3), ylim=(0, None))
    return legend_above(ax, 4)


PAPER.update({"drives/literal_swing_K": (5.5, 6.5), "drives/fast/misfit": (0, 5e-2)})
OTHER.update({
    "training/second_order_1us/kappa": (1.25e6, 1.31e6), "training/second_order_1us/tau_f": (44.5e-9, 46e-9),
    "training/second_order_1us/tau_s": (1020e-9, 1065e-9), "training/second_order_1us/eta": (0.371, 0.387),
    "training/newton_1us/tau_th": (436e-9, 454e-9), "training/newton_1us/heat_capacity_ratio": (7.5, 7.8),
    "training/second_order_0.8us/kappa": (1.627e6, 1.693e6),
    "training/second_order_0.8us/tau_f": (38.7e-9, 40.3e-9), "training/second_order_0.8us/tau_s": (897e-9, 935e-9),
    "training/second_order_0.8us/eta": (0.393, 0.409), "training/newton_0.8us/tau_th": (400e-9, 418e-9),
    "training/newton_0.8us/heat_capacity_ratio": (6.81, 7.09), "training/rms_over_swing/sindy": (0.33e-2, 0.75e-2),
    "drives/joint/kappa": (8.7e5, 9.06e5), "drives/joint/tau_f": (51.2e-9, 53.4e-9),
    "drives/joint/tau_s": (1268e-9, 1320e-9), "drives/joint/eta": (0.335, 0.349),
    "drives/cold/kappa": (2.51e5, 2.61e5), "drives/cold/tau_f": (80.6e-9, 84e-9),
    "drives/cold/tau_s": (2651e-9, 2759e-9), "drives/cold/eta": (0.249, 0.259),
    "drives/cold/newton_tau_s": (354e-9, 368e-9), "drives/cold/newton_ratio": (7, 7.2),
    "drives/pulse/kappa": (4.5e4, 4.7e4), "drives/pulse/tau_f": (230e-9, 240e-9),
    "drives/pulse/tau_s": (5390e-9, 5610e-9), "drives/pulse/eta": (0.141, 0.147),
    "drives/pulse/newton_tau_s": (1665e-9, 1733e-9), "drives/pulse/newton_ratio": (29.4, 30.6),
    "drives/exponentials/0": (19.5e-2, 20.5e-2), "drives/exponentials/1": (4.15e-2, 4.25e-2),
    "drives/exponentials/2": (1.035e-2, 1.045e-2), "drives/exponentials/3": (0.345e-2, 0.355e-2),
    "drives/exponentials/4": (0.135e-2, 0.145e-2), "drives/orders/0": (11.5e-2, 12.5e-2),
    "drives/orders/1": (3.45e-2, 3.55e-2), "drives/orders/2": (1.35e-2, 1.45e-2),
    "drives/orders/3": (0.535e-2, 0.545e-2), "drives/orders/4": (0.215e-2, 0.225e-2),
    "drives/orders/5": (0.045e-2, 0.055e-2),
})
