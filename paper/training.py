"""Section 5: models trained on the FEM's answer to square waves, as the paper trains Eq. 3, and to other drives."""

import time

import numpy as np

import surrogate
import thermofem as th
from thermofem.plot import BLUE, GREEN, VERMILION

from .printed import HEATING, HEAT_CAPACITY, heat, periods_of, printed
from .report.study import Result, figure, study

ORDERS = (2, 3, 4, 5, 6, 8)  # of Foster networks


@study("finite elements and their reduction", quick=True)
def elements():
    """The FEM and its certified reductions: "reduction" to 1e-4, and "elements" to 1e-6, which maps use."""
    core, begin = heat().geometry.parts[0], time.process_time()
    rom = surrogate.reduce(heat().system, tolerance=1e-4)
    numbers = {"reduction_seconds": time.process_time() - begin, "poles": rom.order, "bound": rom.error_bound}
    fine = surrogate.reduce(heat().system, tolerance=1e-6)
    numbers |= {
        "perimeter_m": np.pi * (core.inner_radius + core.outer_radius), "fine_poles": fine.order,
        "thermal_resistance_K_per_W": heat().thermal_resistance(), "fine_bound": fine.error_bound,
        "shortest_tau_s": np.min(rom.dynamics.tau), "longest_tau_s": np.max(rom.dynamics.tau),
    }
    return Result(numbers, models={"reduction": rom.model, "elements": fine.model})


@study("square waves of 1 and 0.8 µs", quick=True)
def squares():
    """Square waves of 1 and 0.8 us, 2 mW, 33 %: the FEM's periodic state."""
    data = {f"{T:g}us": th.solve_periodic(heat(), th.SquareWave(HEATING, T * 1e-6, 0.33)) for T in (1, 0.8)}
    return Result({f"swing_{name}_K": np.ptp(one["delta_T"].values) for name, one in data.items()}, data)


@study("training on the FEM", quick=True)
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


@study("training on other drives")
def drives(elements):
    """Dependence of the trained numbers on the drive, and the error left by every order of model.

    Drives go through the FEM's reduction to 1e-6 of R_th, in closed form.
    """
    model, fem = elements.models["elements"], elements.models["elements"].thermal_resistance

    def periodic(period, n=301):
        wave = th.SquareWave(HEATING, period, 0.33)
        return th.dataset.build(np.linspace(0, period, n), model.periodic_response(wave, n), wave, periodic=True)

    def cold(wave, times):
        return th.dataset.build(times, model.response(wave, times), wave)

    cases = {
        "joint": [periodic(period) for period in (0.5e-6, 1e-6, 2e-6)],
        "cold": cold(th.SquareWave(HEATING, 1e-6, 0.33), np.linspace(0, 20e-6, 4001)),
        "pulse": cold(th.Pulse(HEATING, width=20e-6), np.linspace(0, 40e-6, 8001)),
    }
    numbers = {}
    for name, data in cases.items():
        two, one = surrogate.fit_second_order(data).parameters, surrogate.fit_newton(data).parameters
        numbers[name] = {**two, "newton_tau_s": one["tau_th"], "newton_ratio": one["heat_capacity_ratio"]}
    eq3 = printed.SECOND_ORDER_FEM
    fast = surrogate.fit_newton(periodic(eq3.tau_f))
    numbers["fast"] = {"misfit": fast.relative_residual, "newton_ratio": fast.parameters["heat_capacity_ratio"]}
    # Eq. 3 as printed: dP/dt is not divided by m c_p, and so has no effect
    k = np.array([1 / eq3.tau_f, 1 / eq3.tau_s])
    gain = eq3.kappa / HEAT_CAPACITY / (k[0] - k[1])
    literal = th.StateSpace(np.eye(2), -np.diag(k), np.array([[-gain], [gain]]), np.ones((1, 2)))
    numbers["literal_swing_K"] = np.ptp(literal.periodic_response(th.SquareWave(HEATING, 0.8e-6, 0.33), 301))
    times = np.geomspace(1e-9, 100e-6, 200)
    step = cold(th.Constant(HEATING), times)
    orders = {f"{n} poles": surrogate.fit_foster(step, n, thermal_resistance=fem).model for n in ORDERS}
    judged = surrogate.compare(orders, model, surrogate.square_waves(HEATING))
    numbers["orders"] = np.sqrt(np.mean(judged["rms_relative"].values ** 2, axis=1))
    decay = 1 - step["delta_T"].values / (HEATING * fem)
    fits = [surrogate.fit_decay(times, decay, order=n)(times) for n in range(1, 6)]
    numbers["exponentials"] = [np.max(np.abs(fit - decay)) for fit in fits]
    return Result(numbers)


@figure
def square(squares, training):
    return periods_of(squares.data["1us"], training.models, {
        "newton_1us": ("--", VERMILION, "Newton"), "second_order_1us": ("-", BLUE, "second order"),
        "sindy": (":", GREEN, "SINDy"),
    }, columns=4)
