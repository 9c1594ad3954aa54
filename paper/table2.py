"""Table 2 and Appendix A: what follows from the printed parameters alone, and other readings of the print."""

from dataclasses import replace

import numpy as np
from scipy.constants import c

import coupled
import surrogate
import thermofem as th

from .printed import (
    CENTRE, DETUNINGS, EXPERIMENT_SET, FEM_SET, HEAT_CAPACITY, NEWTON_FIT, NEWTON_MAPS, POWERS, RING,
    SECOND_ORDER_EXPERIMENT, at, describe, label
)
from .report.study import OTHER, PAPER, Result, study

KAPPA_SQUARED = 0.063  # power coupling into each bus, Section 2
FAINT = 1e-7  # W: -40 dBm, too little for anything nonlinear
BISTABLE = (7.0, -28.0)  # dBm and GHz, at which the second-order equation has three fixed points
WEAK = 0.02  # of the bus rate: a ring that keeps its total loss, of which all but this share of the couplers' is heat
LUMPED = RING.with_lumped_fcd()
OWN = {  # ring and thermal model of each of the paper's parameter sets, and where it is run
    "second order, experiment": (RING, EXPERIMENT_SET, ((7.0, -10.0), CENTRE, (10.0, 20.0))),
    "second order, FEM": (RING, FEM_SET, (CENTRE,)),
    "Newton, maps": (LUMPED, NEWTON_MAPS, ((7.0, -10.0),)),
    "Newton, fit": (RING, NEWTON_FIT, (CENTRE,)),
}


@study("the ring's own numbers", 0.2, quick=True)
def ring(elements):
    """Rates, coefficients and lifetimes; power balance at -40 dBm; c_f and c_s of Eq. 3."""
    run = coupled.simulate(RING, elements.models["reduction"], power=FAINT, detuning=0.0, duration=40e-6).isel(time=-1)
    laws = {"printed": RING.carriers, "exchanged": RING.with_swapped_srh().carriers}
    shares = {name: np.asarray(model.R) / model.tau * HEAT_CAPACITY for name, (_, model, _) in OWN.items()}
    names = ("loaded_q", "intrinsic_q", "bus_rate", "thermal_shift", "eta_fca", "eta_tpa", "g_tpa")
    return Result({
        **{name: getattr(RING, name) for name in names},
        "bus_rate_from_kappa": KAPPA_SQUARED * c / (RING.group_index * elements.numbers["perimeter_m"]) / 2,
        "heat_capacity": HEAT_CAPACITY,
        "lifetimes": {name: {"tau0": law.tau0, "a": law.a, "b": law.b} for name, law in laws.items()}, "shares": shares,
        "faint": {name: float(run[name]) / FAINT for name in ("drop", "through", "absorbed")},
    })


@study("Table 2: its FEM column", 1, quick=True)
def light():
    """Volumes and confinements of the guided mode, full vector, over all space."""
    mode = th.light(th.strip_ring(), wavelength=1.555e-6).mode("TE0")
    return Result({
        "tpa_volume": mode.volume(2), "fca_volume": mode.volume(3),
        "tpa_confinement": mode.core_fraction(2), "fca_confinement": mode.core_fraction(3),
        "n_g": mode.n_g, "shift_over_printed": mode.thermo_optic / (RING.thermo_optic / RING.refractive_index),
    })


@study("the paper's own models", 4)
def runs():
    """Single runs and fixed points of the paper's own models, which an independent code has run as well."""
    numbers = {}
    for name, (own, model, points) in OWN.items():
        numbers |= {f"{name}, {label(point)}": settled(own, model, point) for point in points}
    eta = SECOND_ORDER_EXPERIMENT["eta"]
    more, less = (surrogate.second_order(**SECOND_ORDER_EXPERIMENT | {"eta": f * eta}) for f in (1.02, 0.98))
    periods = [settled(RING, model)["period_s"] for model in (more, less)]
    numbers["period_to_eta"] = np.log(periods[0] / periods[1]) / np.log(1.02 / 0.98)
    numbers["half_drive"] = settled(RING, NEWTON_FIT, factor=0.5)
    for name, point in (("centre", CENTRE), ("bistable", BISTABLE)):
        found = coupled.steady_states(RING, EXPERIMENT_SET, **at(point))
        kept = ("energy", "carriers", "delta_T", "growth_rate", "frequency")
        numbers[name] = {key: found[key].values for key in kept} | {"regime": found["regime"].values.tolist()}
    return Result(numbers)


def settled(own, model, point=CENTRE, factor=1.0):
    """The last cycle of a run of 20 us from a cold start, at ``factor`` times the power of the point."""
    laser = at(point) | {"power": factor * at(point)["power"]}
    run = coupled.simulate(own, model, **laser, duration=20e-6, rtol=1e-8)
    half = run.isel(time=run["time"].values > 10e-6)
    return describe(run) | {"highest_K": float(half["delta_T"].max()), "absorbed_W": float(half["absorbed"].max())}


@study("the print at its word", 0.5)
def readings():
    """Pulsing points under other readings of the printed equations."""
    kept = 2 * RING.bus_rate * (1 - WEAK)  # of the amplitude, by both couplers, that becomes heat
    hot = replace(RING, bus_rate=2 * WEAK * RING.bus_rate, drop_rate=0.0, loss_rate=RING.loss_rate + kept)
    cases = {
        "all_heat_second_order": (hot, EXPERIMENT_SET, 1 / (2 * WEAK)),
        "all_heat_newton": (hot.with_lumped_fcd(), NEWTON_MAPS, 1 / (2 * WEAK)),
        "second_order_lumped": (LUMPED, EXPERIMENT_SET, 1.0), "newton_two_terms": (RING, NEWTON_MAPS, 1.0),
    }
    numbers = {"points": POWERS[::3].size * DETUNINGS[::3].size, "coupling_share": 1 - WEAK}
    for name, (own, model, factor) in cases.items():
        found = coupled.pulsing_map(own, model, POWERS[::3] * factor, DETUNINGS[::3], duration=10e-6)
        numbers[name] = int((found["regime"] == "self-pulsing").sum())
    return Result(numbers)


PAPER.update({
    "light/tpa_volume": (0.99 * 5.35e-18, 1.01 * 5.35e-18), "light/fca_volume": (0.99 * 4.87e-18, 1.01 * 4.87e-18),
    "light/tpa_confinement": (0.99, 0.994), "light/fca_confinement": (0.9985, 0.9995),
    "ring/loaded_q": (6300, 6700), "ring/intrinsic_q": (1.03e5, 1.19e5), "ring/bus_rate_from_kappa": (42e9, 44e9),
    "runs/half_drive/absorbed_W": (1.5e-3, 2.5e-3), "runs/half_drive/swing_K": (5.5, 6.5),
})
OTHER.update({
    "ring/thermal_shift": (6.468105e10, 6.468115e10), "ring/eta_fca": (1.0220195e-13, 1.0220205e-13),
    "ring/eta_tpa": (5.557105e21, 5.557115e21), "ring/g_tpa": (9.877685e57, 9.877695e57),
    "ring/lifetimes/printed/tau0": (35.591615e-9, 35.591625e-9),
    "ring/lifetimes/printed/a": (1.61554855e-21, 1.61554865e-21),
    "ring/lifetimes/printed/b": (0.999999745e-21, 0.999999755e-21),
    "ring/lifetimes/exchanged/tau0": (23.419985e-9, 23.419995e-9),
    "ring/lifetimes/exchanged/a": (2.45516635e-21, 2.45516645e-21),
    "ring/shares/second order, FEM/0": (0.2732095, 0.2732105),
    "ring/shares/second order, FEM/1": (0.03679035, 0.03679045),
    "ring/shares/second order, experiment/0": (0.2546585, 0.2546595),
    "ring/shares/second order, experiment/1": (0.03534075, 0.03534085),
    "ring/heat_capacity": (7.625e-12, 7.635e-12), "ring/faint/drop": (0.883385, 0.883395),
    "ring/faint/through": (0.003605, 0.003615), "ring/faint/absorbed": (0.112985, 0.112995),
    "runs/period_to_eta": (-1.55, -1.45), "runs/bistable/energy/0": (10.100035e-15, 10.100045e-15),
    "runs/bistable/energy/1": (15.548317e-15, 15.548327e-15), "runs/bistable/energy/2": (21.760985e-15, 21.760995e-15),
    "runs/centre/energy/0": (18.740008e-15, 18.740018e-15), "runs/centre/carriers/0": (1.9908335e23, 1.9908345e23),
    "runs/centre/delta_T/0": (6.9451055, 6.9451065), "runs/centre/growth_rate/0": (0.01518553e9, 0.01518555e9),
    "runs/centre/frequency/0": (1065144.457, 1065303.612),
})
RUNS = {  # period (s), duty cycle, swing (K) and highest rise (K) by an independent code
    "second order, experiment, 7dBm_-10GHz": (499.334e-9, 0.4117, 4.6393, 9.8403),
    "second order, experiment, 8dBm_0GHz": (535.939e-9, 0.2819, 5.9956, 10.5484),
    "second order, experiment, 10dBm_20GHz": (725.112e-9, 0.1271, 8.6442, 12.3597),
    "second order, FEM, 8dBm_0GHz": (686.002e-9, 0.2396, 5.8995, 10.5034),
    "Newton, maps, 7dBm_-10GHz": (588.395e-9, 0.1562, 13.5693, 18.7454),
    "Newton, fit, 8dBm_0GHz": (762.696e-9, 0.3549, 6.6477, 10.7682),
}
for name, values in RUNS.items():
    off = (1e-4 * values[0], 3e-4, 5e-4, 5e-4)
    for key, value, one in zip(("period_s", "duty", "swing_K", "highest_K"), values, off, strict=True):
        OTHER[f"runs/{name}/{key}"] = (value - one, value + one)
