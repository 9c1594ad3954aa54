"""Fig. 4, Section 4: what Newton's law of cooling needs to follow each trace, and whether any draws the map."""

from dataclasses import replace
from itertools import product

import numpy as np

import coupled
import surrogate
from thermofem.plot import INK, VERMILION

from .maps import compared
from .printed import CENTRE, HEAT_CAPACITY, MARKED, NEWTON_MAPS, RING, label, legend, panel
from .report.study import Result, figure, study

LIFETIMES = (150e-9, 600e-9)  # s, searched for Newton's law with silicon's c_p; a second basin lies at 80 ns
LITERATURE = (1 / 3, 0.4, 0.5, 0.6, 0.7, 1.0)  # shares of sigma_FCD; the paper's is two to three times the literature's
FITTED_LIFETIME = 270e-9  # s, of Section 4
OTHER_THERMAL, OTHER_CARRIER = (80e-9, 150e-9), (1e-9, 3e-9, 10e-9)  # s, of the rings that the paper cites
CLOSE = 0.2  # mean error of the frequency up to which a map counts as one of the right frequency


@study("Fig. 4(d): Newton's law fitted to traces")
def newton_fits(loop):
    """Newton's law fitted to every trace that pulses; and to one of them with silicon's own c_p."""
    pulsing = {name: run for name, run in loop.data.items() if run.attrs["regime"] == "self-pulsing"}
    single = coupled.identification.newton_traces.fit_newton_per_trace(RING, list(pulsing.values()))
    lumped = coupled.identify(
        RING.with_lumped_fcd(), [loop.data[label(MARKED[0])]], free=["tau_th"], model=NEWTON_MAPS,
        bounds={"tau_th": LIFETIMES}, runs=1,
    )
    tau, capacity = single["tau_th"].values, single["heat_capacity"].values
    ratio, period, power = capacity / HEAT_CAPACITY, single["period"].values, single["power"].values
    slower = 800e-9 / loop.numbers[label(CENTRE)]["period_s"]  # the paper's period at that point over ours
    lifetime_of_period = np.polynomial.Polynomial.fit(period, tau, 1)
    pairs = zip(pulsing, tau, capacity, strict=True)
    models = {name: surrogate.newton(tau_th=float(t), heat_capacity=float(c)) for name, t, c in pairs}
    numbers = {
        "count": len(pulsing), "tau_th_s": [tau.min(), tau.max()], "heat_capacity_ratio": [ratio.min(), ratio.max()],
        "heat_capacity_ratio_mean": ratio.mean(), "correlation": single.attrs["correlation"], "tau_mean_s": tau.mean(),
        "correlation_ratio_power": np.corrcoef(ratio, power)[0, 1],
        "correlation_tau_period": np.corrcoef(tau, period)[0, 1],
        "tau_th_slower_s": lifetime_of_period(slower * np.array([period.min(), period.max()])),
        "q_over_q0": np.mean(ratio) * NEWTON_MAPS.tau[0] / np.mean(tau),
        "lumped": {**lumped.parameters, "shape_error": lumped.residuals["shape_error"].values[0]},
    }
    return Result(numbers, {"newton": single}, models)


@study("Fig. 4: would any Newton's law do?")
def scan(reference):
    """Could any Newton's law draw the FEM's map? Dispersion and time constant scanned, c_p as tabulated.

    Every second power and detuning of the maps, by integration, so that frequencies count as well.
    """
    ring, fem = RING.with_lumped_fcd(), reference.data["map"].isel(power=slice(0, None, 2), detuning=slice(0, None, 2))
    tried = []
    for sigma, tau in product(ring.fcd[0][0] * np.geomspace(0.3, 2, 6), np.geomspace(50e-9, 800e-9, 6)):
        model, own = surrogate.newton(tau_th=tau, heat_capacity=HEAT_CAPACITY), replace(ring, fcd=((sigma, 1.0),))
        seen = compared(coupled.pulsing_map(own, model, fem["power"], fem["detuning"], duration=10e-6), fem)
        errors = {name: seen[name][0] for name in ("frequency_error", "duty_error")}
        tried.append({"sigma_m3": sigma, "tau_th_s": tau, "overlap": seen["overlap"], **errors})
    near = [one for one in tried if one["frequency_error"] <= CLOSE]
    best, right = (max(some, key=lambda one: one["overlap"]) for some in (tried, near))
    return Result({"best": best, "best_of_right_frequency": right, "close": CLOSE, "pairs": len(tried)})


@study("Section 4: the dispersion that self-pulsing needs")
def dispersion():
    """Points that pulse with Newton's law, 270 ns and silicon's c_p, over shares of the paper's lumped sigma_FCD."""
    lumped = RING.with_lumped_fcd()
    model = surrogate.newton(tau_th=FITTED_LIFETIME, heat_capacity=HEAT_CAPACITY)
    powers = 1e-3 * 10 ** np.linspace(0.3, 1, 8)
    detunings = np.linspace(-30e9, 30e9, 13)
    numbers = {"points": powers.size * detunings.size}
    for share in LITERATURE:
        weaker = replace(lumped, fcd=tuple((share * sigma, exponent) for sigma, exponent in lumped.fcd))
        regimes = coupled.pulsing_map(weaker, model, powers, detunings, duration=10e-6)["regime"]
        numbers[f"share_{share:.2f}"] = (regimes == "self-pulsing").sum().item()
    return Result(numbers)


@study("Section 2: rings with faster heat and carriers")
def fast_rings():
    """Periods of rings with one thermal and one carrier lifetime, each the median of a map, beside the sum of both."""
    lumped = RING.with_lumped_fcd()
    powers = 1e-3 * 10 ** np.linspace(0.3, 2.3, 9)
    detunings = np.linspace(-60e9, 20e9, 17)
    medians, ratios = [], []
    for thermal, carrier in product(OTHER_THERMAL, OTHER_CARRIER):
        ring = replace(lumped, carriers=coupled.ConstantLifetime(carrier))
        model = surrogate.newton(tau_th=thermal, heat_capacity=HEAT_CAPACITY)
        periods = coupled.pulsing_map(ring, model, powers, detunings, duration=5e-6)["period"]
        if np.isfinite(periods).any():
            medians.append(float(periods.median()))
            ratios.append(medians[-1] / (thermal + carrier))
    return Result({
        "count": len(medians), "tried": len(OTHER_THERMAL) * len(OTHER_CARRIER),
        "period_s": [min(medians), max(medians)], "over_sum": [min(ratios), max(ratios)],
    })


@figure
def fig4d(newton_fits):
    ax, data = panel(), newton_fits.data["newton"]
    tau, ratio = data["tau_th"].values * 1e9, data["heat_capacity"].values / HEAT_CAPACITY
    dots = ax.scatter(tau, ratio, c=data["period"].values * 1e9, s=36, cmap="viridis", edgecolor=INK, linewidth=0.4)
    ax.figure.colorbar(dots, ax=ax, label="period (ns)")
    ax.plot(417, 6.9, "*", color=VERMILION, markersize=11, label="the paper, (8 dBm, 0 GHz)")
    ax.set(xlabel="thermal lifetime τ$_{th}$ (ns)", ylabel="c$_p$ over silicon's", ylim=(0, None))
    return legend(ax, "lower right")
