"""Stages over the plane of power and detuning: maps, Newton's laws tried on them, and the points of two rings."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

import coupled
import surrogate
from coupled.parameters import borghi2021 as paper
from thermofem.models import ThermalModel

from .pulsing_stages import models_of
from .stages import Job
from .store import Result, slug

if TYPE_CHECKING:
    import xarray as xr

    from coupled import RingResonator

CLOSE = 0.2  # mean error of the frequency up to which a map counts as one of the right frequency
FAR = 0.4  # error of the frequency that a border or doubled cycles make, and nothing else does
HIGH_Q = 20_000  # the second ring of Fig. 7
LESS_POWER, LESS_DETUNING = 10**-0.65, 0.45  # of its map: it pulses from less power, within a narrower resonance
DUTIES = (0.2, 0.3)  # of the points that Fig. 7 shows


def reference(job: Job) -> Result:
    """The map of the FEM-coupled ring, which the maps of the models are held against."""
    found = _map(job, coupled.borghi2021(), job.inputs["elements"].models["elements"])
    low, high = job.inputs["periods"].numbers["second order"]["within_10_percent_s"]
    period = found["period"].values[found["regime"].values == "self-pulsing"]
    numbers = _describe_map(found, found) | {"in_range": float(np.mean((period >= low) & (period <= high)))}
    return Result(numbers, {"map": found.assign_attrs(model="FEM")})


def maps(job: Job) -> Result:
    """Figs. 4(a, b) and 6(a, b), and maps that the paper does not have: of SINDy and the reduction."""
    s, cases = job.settings, models_of(job.inputs)
    found: dict[str, xr.Dataset] = {}
    for k, (name, (own, model)) in enumerate(cases.items()):
        job.done(k / len(cases))
        found[name] = _map(job, own, model)
    fem = job.inputs["reference"].data["map"]
    numbers = {name: _describe_map(data, fem) for name, data in found.items()}
    for name in ("Newton, the paper's", "second order, the paper's"):
        linear = coupled.stability_map(*cases[name], s.powers, s.detunings)["regime"] == "self-pulsing"
        numbers[name]["linear_agrees"] = float((linear == (found[name]["regime"] == "self-pulsing")).mean())
    return Result(numbers, {slug(name): data.assign_attrs(model=name) for name, data in found.items()})


def _map(job: Job, ring: RingResonator, model: ThermalModel) -> xr.Dataset:
    """Where and how a ring with a model pulses, over the plane of the paper."""
    s = job.settings
    return coupled.pulsing_map(ring, model, s.powers, s.detunings, duration=s.duration).drop_vars("reason")


def _describe_map(data: xr.Dataset, reference: xr.Dataset) -> dict[str, Any]:
    """The paper's statements about a map, and the agreement with the FEM's map."""
    pulses = data["regime"] == "self-pulsing"
    both = pulses & (reference["regime"] == "self-pulsing")
    frequency = abs(reference["period"] / data["period"] - 1).where(both)
    shorter = (data["duty"] < reference["duty"]).where(both)
    duty = abs(data["duty"] / reference["duty"] - 1).where(both)
    blue, red = data["detuning"] > 0, data["detuning"] < 0
    rate = 1 / data["period"]
    return {
        "overlap": coupled.maps.pulsing_map.overlap(data, reference),
        "points": int(pulses.size),
        "pulsing": int(pulses.sum()),
        "frequency_error": [float(frequency.mean()), float(frequency.std())],
        "duty_error": [float(duty.mean()), float(duty.std())],
        "far_off": {"blue": int((frequency > FAR).where(blue).sum()), "red": int((frequency > FAR).where(red).sum())},
        "frequency_error_median": float(frequency.median()),
        "shorter_cycles": float(shorter.mean()),
        "slow_transients": int((data["regime"] == "slow transient").sum()),
        "duty_median": float(data["duty"].median()),
        "frequency_median_Hz": float(rate.median()),
        "frequency_min_Hz": float(rate.min()),
        "frequency_max_Hz": float(rate.max()),
        "blue_share": float(pulses.where(blue, drop=True).mean()),
        "red_share": float(pulses.where(red, drop=True).mean()),
        "highest_detuning_Hz": float(data["detuning"].where(pulses).max()),
        "slower_to_the_blue": _trend(rate, "detuning"),
        "faster_with_power": _trend(-rate, "power"),
    }


def _trend(rate: xr.DataArray, over: str) -> float:
    """Share of neighbouring pulsing points between which the frequency falls along an axis."""
    step = rate.diff(over)
    known = np.isfinite(step.values)
    return float(np.mean(step.values[known] < 0)) if known.any() else float("nan")


def scan(job: Job) -> Result:
    """Could any Newton's law draw the FEM's map? Dispersion and time constant scanned, c_p as tabulated.

    Every second power and detuning of the maps, by integration, so that frequencies count as well.
    """
    s, ring = job.settings, coupled.borghi2021().with_lumped_fcd()
    reference = job.inputs["reference"].data["map"].isel(power=slice(0, None, 2), detuning=slice(0, None, 2))
    sigmas, taus = paper.FCD_LUMPED * np.geomspace(0.3, 2, s.scan), np.geomspace(50e-9, 800e-9, s.scan)
    tried: list[dict[str, float]] = []
    for k, sigma in enumerate(sigmas):
        job.done(k / sigmas.size)
        for tau in taus:
            model = surrogate.newton(tau_th=float(tau), heat_capacity=paper.HEAT_CAPACITY)
            own = replace(ring, fcd=((float(sigma), 1.0),))
            data = coupled.pulsing_map(own, model, reference["power"], reference["detuning"], duration=10e-6)
            seen = _describe_map(data, reference)
            tried.append(
                {
                    "sigma_m3": float(sigma),
                    "tau_th_s": float(tau),
                    "overlap": seen["overlap"],
                    "frequency_error": seen["frequency_error"][0],
                    "duty_error": seen["duty_error"][0],
                }
            )
    near = [t for t in tried if t["frequency_error"] <= CLOSE]
    return Result(
        {
            "best": max(tried, key=lambda t: t["overlap"]),
            "best_of_right_frequency": max(near, key=lambda t: t["overlap"]) if near else None,
            "close": CLOSE,
            "pairs": len(tried),
        }
    )


def rings(job: Job) -> Result:
    """The points of Fig. 7: period of the FEM-coupled ring minus that of the second-order model, for two Q."""
    import xarray as xr

    s, low = job.settings, coupled.borghi2021()
    loss = low.omega / (2 * HIGH_Q)
    high = replace(low, name=f"{low.name}, Q = {HIGH_Q}", bus_rate=(loss - low.loss_rate) / 2)
    second, numbers, data = job.inputs["second_order_fit"].models["second_order"], {}, {}
    for name, own, less, narrower in (("low", low, 1.0, 1.0), ("high", high, LESS_POWER, LESS_DETUNING)):
        powers, detunings = s.powers[::2] * less, s.detunings[::2] * narrower
        grids = [
            coupled.pulsing_map(own, model, powers, detunings, duration=s.duration)
            for model in (job.inputs["elements"].models["elements"], second)
        ]
        reference, model = grids
        shown = (reference["duty"] >= DUTIES[0]) & (reference["duty"] <= DUTIES[1]) & np.isfinite(model["period"])
        period = reference["period"].values[shown.values]
        error = period - model["period"].values[shown.values]
        data[name] = xr.Dataset(
            {"error": ("point", error, {"units": "s", "long_name": "period error"})},
            coords={"period": ("point", period, {"units": "s", "long_name": "period, FEM"})},
            attrs={"loaded_q": own.loaded_q},
        )
        relative = np.abs(error / period)
        numbers[name] = {
            "loaded_q": own.loaded_q,
            "points": int(period.size),
            "period_s": [period.min(), period.max()] if period.size else [],
            "relative_error": float(relative.mean()) if period.size else None,
            "largest_relative_error": float(relative.max()) if period.size else None,
        }
    return Result(numbers, data)
