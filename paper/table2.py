"""Table 2 and Appendix A: what follows from the printed parameters alone, and other readings of the print."""

from dataclasses import asdict, replace

import numpy as np
from scipy.constants import c

import coupled
import surrogate
import thermofem as th
from thermofem.plot import BLUE, GREEN, INK, ORANGE

from .printed import (
    CENTRE, DETUNINGS, EXPERIMENT_SET, FEM_SET, HEAT_CAPACITY, NEWTON_FIT, NEWTON_MAPS, POWERS, RING, RUN, at,
    describe, label, legend, panel, printed
)
from .report.study import Result, figure, study

KAPPA_SQUARED = 0.063  # power coupling into each bus, Section 2
FAINT = 1e-7  # W: -40 dBm, too little for anything nonlinear
BISTABLE = (7.0, -28.0)  # dBm and GHz, at which the second-order equation has three fixed points
WEAK = 0.02  # of the bus rate: a ring that keeps its total loss, of which all but this share of the couplers' is heat
RULED = (CENTRE, (8.0, -20.0), (10.0, 10.0))  # dBm and GHz, at which the printed rules are judged
LUMPED, LAWS = RING.with_lumped_fcd(), {"printed": RING.carriers, "exchanged": RING.with_swapped_srh().carriers}
OWN = {  # ring and thermal model of each of the paper's parameter sets, and where it is run
    "second order, experiment": (RING, EXPERIMENT_SET, ((7.0, -10.0), CENTRE, (10.0, 20.0))),
    "second order, FEM": (RING, FEM_SET, (CENTRE,)),
    "Newton, maps": (LUMPED, NEWTON_MAPS, ((7.0, -10.0),)),
    "Newton, fit": (RING, NEWTON_FIT, (CENTRE,)),
}


@study("the ring's own numbers", quick=True)
def ring(elements):
    """Rates, coefficients and lifetimes; power balance at -40 dBm; c_f and c_s of Eq. 3."""
    run = coupled.simulate(RING, elements.models["reduction"], power=FAINT, detuning=0.0, duration=40e-6).isel(time=-1)
    names = ("loaded_q", "intrinsic_q", "bus_rate", "thermal_shift", "eta_fca", "eta_tpa", "g_tpa")
    return Result({name: getattr(RING, name) for name in names} | {
        "bus_rate_from_kappa": KAPPA_SQUARED * c / (RING.group_index * elements.numbers["perimeter_m"]) / 2,
        "heat_capacity": HEAT_CAPACITY,
        "lifetimes": {name: {"tau0": law.tau0, "a": law.a, "b": law.b} for name, law in LAWS.items()},
        "shares": {name: np.asarray(model.R) / model.tau * HEAT_CAPACITY for name, (_, model, _) in OWN.items()},
        "faint": {name: float(run[name]) / FAINT for name in ("drop", "through", "absorbed")},
    })


@study("Table 2: its FEM column, and its rules", quick=True)
def light(training):
    """Volumes and confinements of the guided mode; the period with the mode's shift by heat, by carriers, by both.

        printed: d ln(omega)/dT = -(dn/dT)/n0, d ln(omega)/dN = -sigma/n0;  of the mode: K and -G sigma/n_g
    """
    mode = th.light(th.strip_ring(), wavelength=1.555e-6).mode("TE0")
    share = mode.confinement["core"] / mode.n_g * RING.refractive_index
    carriers = replace(RING, fcd=tuple((share * sigma, exponent) for sigma, exponent in RING.fcd))
    shift = RING.omega * mode.thermo_optic
    rings = {
        "printed": RING, "heat": RING.with_rates(thermal_shift=shift), "carriers": carriers,
        "both": carriers.with_rates(thermal_shift=shift),
    }
    model = training.models["second_order_1us"]
    periods = {rule: [settled(own, model, point)["period_s"] for point in RULED] for rule, own in rings.items()}
    changes = {rule: np.divide(found, periods["printed"]) - 1 for rule, found in periods.items()}
    return Result({
        "tpa_volume": mode.volume(2), "fca_volume": mode.volume(3), "n_g": mode.n_g,
        "tpa_confinement": mode.core_fraction(2), "fca_confinement": mode.core_fraction(3),
        "heat_over_printed": mode.thermo_optic / (RING.thermo_optic / RING.refractive_index),
        "carriers_over_printed": share, "periods": periods, "changes": changes,
    })


@study("the paper's own models")
def runs():
    """Single runs and fixed points of the paper's own models, which an independent code has run as well."""
    numbers, eta = {}, printed.SECOND_ORDER_EXPERIMENT.eta
    for name, (own, model, points) in OWN.items():
        numbers |= {f"{name}, {label(point)}": settled(own, model, point) for point in points}
    sets = [asdict(printed.SECOND_ORDER_EXPERIMENT) | {"eta": factor * eta} for factor in (1.02, 0.98)]
    more, less = (settled(RING, surrogate.second_order(**one))["period_s"] for one in sets)
    numbers["period_to_eta"] = np.log(more / less) / np.log(1.02 / 0.98)
    numbers["half_drive"] = settled(RING, NEWTON_FIT, factor=0.5)
    for name, point in (("centre", CENTRE), ("bistable", BISTABLE)):
        found = coupled.steady_states(RING, EXPERIMENT_SET, **at(point))
        kept = ("energy", "carriers", "delta_T", "growth_rate", "frequency", "regime")
        numbers[name] = {key: found[key].values.tolist() for key in kept}
    return Result(numbers)


def settled(own, model, point=CENTRE, factor=1.0):
    """The last cycle of a run of 20 us from a cold start, at ``factor`` times the power of the point."""
    laser = at(point) | {"power": factor * at(point)["power"]}
    run = coupled.simulate(own, model, **laser, duration=RUN, rtol=1e-8)
    half = run.sel(time=slice(RUN / 2, None))
    return describe(run) | {"highest_K": float(half["delta_T"].max()), "absorbed_W": float(half["absorbed"].max())}


@study("the print at its word")
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
        numbers[name] = (found["regime"] == "self-pulsing").sum().item()
    return Result(numbers)


@figure
def rules(light):
    ax, periods = panel(), light.numbers["periods"]
    lines = {"printed": (INK, "printed rules"), "heat": (ORANGE, "heat of the mode"),
             "carriers": (BLUE, "carriers of the mode"), "both": (GREEN, "both")}
    for k, (rule, (colour, words)) in enumerate(lines.items()):
        bars = ax.bar(np.arange(3) + 0.2 * (k - 1.5), np.array(periods[rule]) * 1e9, 0.18, color=colour, label=words)
        ax.bar_label(bars, fmt="%.0f", fontsize="x-small")
    ax.set_xticks(range(3), [f"{dbm:g} dBm, {ghz:g} GHz" for dbm, ghz in RULED])
    ax.set(ylabel="period (ns)")
    return legend(ax, "above")
