"""Stages on heat alone: the FEM, its reduction, its answers to the paper's drives, and other stacks."""

from __future__ import annotations

import functools
import time
from dataclasses import replace

import numpy as np

import coupled
import surrogate
from thermofem import checks, materials
from thermofem.fem import HeatProblem, assemble
from thermofem.geometry import CrossSection, strip_ring
from thermofem.geometry.parts import Part
from thermofem.geometry.rings import disc
from thermofem.models import NonlinearSystem
from thermofem.solving import solve, solve_periodic
from thermofem.waveforms import Pulse, SquareWave

from .settings import CENTRE, HEATING, watts
from .stages import Job
from .store import Result

PULSE = 20e-6  # s, Fig. 5(a)
HOT = 23e-3  # W, which heats the core by about 167 K
STACKS = {  # R_th of the reference ring but for one thickness, or in a far larger domain
    "top_0.5um": {"cladding": 0.5e-6},
    "top_1um": {"cladding": 1e-6},
    "top_4um": {"cladding": 4e-6},
    "box_1um": {"box": 1e-6},
    "box_3um": {"box": 3e-6},
    "large": {"substrate": 100e-6, "outer_radius": 150e-6},
}


@functools.lru_cache(2)
def elements_of(accuracy: float) -> HeatProblem:
    """The FEM of the reference strip: a ring of the same perimeter as the paper's racetrack."""
    return assemble(strip_ring(), accuracy)


def elements(job: Job) -> Result:
    """The FEM and its certified reductions: "reduction" to 1e-4, and "elements" to 1e-6, which maps use."""
    heat = elements_of(job.settings.accuracy)
    begin = time.process_time()
    rom = surrogate.reduce(heat.system, tolerance=1e-4)
    seconds = time.process_time() - begin
    fine = surrogate.reduce(heat.system, tolerance=1e-6)
    perimeter = 2 * np.pi * (heat.geometry.parts[0].inner_radius + heat.geometry.parts[0].outer_radius) / 2
    tau = rom.dynamics.tau
    numbers = {
        "unknowns": heat.unknowns,
        "perimeter_m": perimeter,
        "thermal_resistance_K_per_W": heat.thermal_resistance(),
        "poles": rom.order,
        "bound": rom.error_bound,
        "reduction_seconds": seconds,
        "fine_poles": fine.order,
        "fine_bound": fine.error_bound,
        "shortest_tau_s": float(np.min(tau)),
        "longest_tau_s": float(np.max(tau)),
    }
    return Result(numbers, models={"reduction": rom.model, "elements": fine.model})


def stacks(job: Job) -> Result:
    """R_th of the ring in other stacks (the paper does not state their thicknesses), and Newton's law in air.

    Without gmsh, which must mesh them, there are no numbers, and no rows in the table.
    """
    oxide = replace(materials.find("SiO2"), conductivity=1.0)
    geometries = {name: strip_ring(**options) for name, options in STACKS.items()}
    geometries |= {"oxide_1W": replace(strip_ring(), materials=(oxide,)), "disc": _on_pedestal()}
    try:
        heats = {name: assemble(geometry, job.settings.accuracy) for name, geometry in geometries.items()}
    except checks.MissingLibraryError as error:
        return Result({**dict.fromkeys([*geometries, "period_s", "one_pole"]), "reason": str(error)})
    numbers = {name: heat.thermal_resistance() for name, heat in heats.items()}
    model = surrogate.reduce(heats["top_1um"].system, tolerance=1e-4).model
    run = coupled.simulate(
        coupled.borghi2021(), model, power=watts(CENTRE[0]), detuning=CENTRE[1] * 1e9, duration=20e-6
    )
    one_pole = {
        name: _one_pole(heat) for name, heat in (("disc", heats["disc"]), ("strip", elements_of(job.settings.accuracy)))
    }
    return Result({**numbers, "period_s": coupled.pulsing(run).period, "one_pole": one_pole})


def _on_pedestal() -> CrossSection:
    """A disc in air on a pedestal of oxide half as wide."""
    base = disc(radius=5e-6, rim=1e-6)
    air = (
        Part("air above", "void", 0.0, base.outer_radius, bottom=0.22e-6, height=2e-6),
        Part("air below", "void", 2.5e-6, base.outer_radius, bottom=-2e-6, height=2.22e-6),
    )
    return replace(base, name="disc on a pedestal", parts=(*air, *base.parts))


def _one_pole(heat: HeatProblem) -> dict[str, float]:
    """Distance from Newton's law: share of the largest pole, and error of one exponential in a square wave."""
    poles = surrogate.reduce(heat.system, tolerance=1e-4).dynamics
    R, tau = np.asarray(poles.R), np.asarray(poles.tau)
    data = solve_periodic(heat, SquareWave(HEATING, 1e-6, 1 / 3))
    return {
        "share": float(R.max() / R.sum()),
        "tau_s": float(tau[R.argmax()]),
        "misfit": surrogate.fit_newton(data).residual / float(np.ptp(data["delta_T"].values)),
    }


def pulse(job: Job) -> Result:
    """Fig. 5(a): 2 mW for 20 us, and exponentials through its rise and fall, uniform samples so that no time counts
    more than another."""
    edge = np.geomspace(1e-9, 1e-6, 40)
    times = np.unique(np.concatenate([np.linspace(0, 2 * PULSE, 801), edge, PULSE + edge]))
    data = solve(elements_of(job.settings.accuracy), Pulse(HEATING, width=PULSE), times, field_times=[21e-6])
    rise = data.drop_dims("field_time").sel(time=np.linspace(0, PULSE, 401), method="nearest")
    fall = data.sel(time=np.linspace(PULSE, 2 * PULSE, 401), method="nearest")
    single = surrogate.fit_newton(rise)
    double = surrogate.fit_decay(fall["time"] - PULSE, fall["delta_T"])
    numbers = {
        "rise_K": float(data["delta_T"].max()),
        "rise_tau_s": single.parameters["tau_th"],
        "rise_misfit_K": single.residual,
        "fall_tau_s": double.tau,
        "fall_amplitude_K": double.amplitude,
        "fall_misfit_K": double.residual,
    }
    return Result(numbers, {"pulse": data}, {"rise": single.model})


def squares(job: Job) -> Result:
    """Square waves of 1 and 0.8 us, 2 mW, 33 %: the FEM's periodic state."""
    data, numbers = {}, {}
    for name, period in (("1us", 1e-6), ("0.8us", 0.8e-6)):
        data[name] = solve_periodic(elements_of(job.settings.accuracy), SquareWave(HEATING, period, 0.33))
        numbers[f"swing_{name}_K"] = float(np.ptp(data[name]["delta_T"].values))
    return Result(numbers, data)


def hot(job: Job) -> Result:
    """The reference strip with k(T) and c_p(T): how far linear models and an output map go in the steady state."""
    film, oxide = materials.find("Si(T)"), materials.find("SiO2(T)")
    warm = replace(strip_ring(), materials=(replace(film, name="Si"), replace(oxide, name="SiO2")))
    heat = assemble(warm, job.settings.accuracy)
    system = heat.model("core", "core")
    if not isinstance(system, NonlinearSystem):
        raise checks.InputError("Si(T) and SiO2(T) follow no law of temperature")
    powers = np.geomspace(0.03, 1, 10) * HOT
    rise = np.array([system.steady_rise(power)[0] for power in powers])
    mapped = surrogate.output_map(system, HOT)
    off = np.abs(heat.thermal_resistance() * powers / rise - 1)  # grows with power
    numbers = {
        "rise_K": rise[-1],
        "linear_error": off[-1],
        "rise_within_1_percent_K": np.interp(0.01, off, rise),
        "map_error": np.max(np.abs([mapped.steady_rise(power) for power in powers] / rise - 1)),
    }
    return Result(numbers)
