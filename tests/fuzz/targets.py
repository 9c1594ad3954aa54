"""Valid calls of every public function, class and main method that takes milliseconds; `calls.py` spoils them."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

import coupled
import surrogate
import thermofem as th
from thermofem.campaign import Variation

sys.path.insert(0, str(Path(__file__).parents[1]))  # the lists of the other tests

import methods
from models import coarse, coarse_fem, coarse_warm_fem, identified_network, quadratic

Call = tuple[Callable[..., Any], dict[str, Any]]
LEFT = {
    "takes seconds, see `long_calls`": """train_all train_family explore identify pulsing_map continue_cycle hopf_curves
        fold_curves cycle_derivatives circuit_limit_cycle""",
    "takes a minute": "cycle_fold_curves",
    "made by a function, or no call": """Calibration Certified Decay Design Fit Ladder QuadraticReduction Reduction
        SindyFit Truncation CarrierFit Identification Pulsing ArrayReduction Family HeatProblem Mesh Discretization
        InputError MissingLibraryError OutsideTrainingWarning ThermalModel Waveform Corrector checks dataset materials
        model waveforms BORGHI2021_HEAT_CAPACITY NO_PREDICTOR""",
    "judged where it is used": "Optics",
    "without an argument": "borghi2021 vanvaerenbergh2012",
    "needs another library": "from_gdsfactory",
}
MODEL = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])
RING = coupled.borghi2021()
OXIDE = "material.SiO2.conductivity"
WAVE = th.SquareWave(1e-3, 1e-6, 0.3)


@cache
def strip() -> th.CrossSection:
    return th.strip_ring(outer_radius=30e-6, substrate=10e-6)


@cache
def heat() -> th.fem.HeatProblem:
    return th.assemble(strip(), 0.05)


@cache
def data() -> Any:
    t = np.linspace(0, 1e-5, 60)
    return th.dataset.build(t, MODEL.response(th.Constant(1e-3), t), th.Constant(1e-3))


def missing(table: dict[str, Call]) -> list[str]:
    """Public names and methods that neither the table nor `LEFT` has."""
    known = {name.partition(".")[0] for name in table} | set(" ".join(LEFT.values()).split())
    names = {name for package in (th, surrogate, coupled) for name in package.__all__}
    return [*sorted(names - known), *methods.missing(set(table))]


def calls() -> dict[str, Call]:
    """Name -> function, arguments by name."""
    own = {**_heat(), **_waves(), **_models(), **_training(), **_light(), **_circuits(), **_studies(), **_files()}
    return {**own, **methods.calls(heat(), small_family(), RING)}


def long_calls() -> dict[str, Call]:
    """The same of functions that take seconds, which the tests leave out."""
    light = {"ring": RING, "model": MODEL, "detuning": 0.0}
    plane = {"ring": RING, "model": MODEL, "powers": [1e-3, 2e-3], "detunings": [0.0, 1e9]}
    trace = coupled.simulate(RING, MODEL, power=1e-3, duration=3e-7, times=np.linspace(0, 3e-7, 300))
    vary = Variation("box", ("layer.box.thickness",), "m", low=1.9e-6, high=2e-6)
    plan = th.Campaign(strip().to_toml(), (vary,), samples=1)
    wave = {"circuit": coupled.bus([RING, RING]), "thermal": MODEL, "inputs": {"in": 6e-3}}
    return {
        "pulsing_map": (coupled.pulsing_map, {**plane, "duration": 1e-8}),
        "fold_curves": (coupled.fold_curves, plane),
        "hopf_curves": (coupled.hopf_curves, plane),
        "cycle_derivatives": (coupled.cycles.derivatives.cycle_derivatives, {**light, "power": 6e-3}),
        "continue_cycle": (
            coupled.continue_cycle, {**light, "parameter": "power", "values": (6e-3, 6.1e-3), "points": 5}
        ),
        "circuit_limit_cycle": (coupled.circuit.circuit_limit_cycle, wave),
        "explore": (coupled.explore, {"ring": RING, "models": MODEL, "path": "page.html"}),
        "identify": (coupled.identify, {"ring": RING, "traces": [trace], "free": ["kappa"], "runs": 1}),
        "train_family": (surrogate.train_family, {"campaign": plan, "tolerance": 5e-2}),
        "train_all": (surrogate.train_all, {"heat": heat()}),
    }  # fmt: skip


def _heat() -> dict[str, Call]:
    lists = {
        name: getattr(strip(), name)
        for name in ("layers", "parts", "interfaces", "materials", "probes", "bottom", "top")
    }
    mesh = coarse()[0]
    cells, held = np.ones(len(mesh.triangles)), np.array([0])
    part = {"name": "c", "material": "Si", "inner_radius": 7e-6, "outer_radius": 8e-6, "bottom": 0.0, "height": 2e-7}
    vary = Variation("box", ("layer.box.thickness",), "m", low=1.9e-6, high=2e-6)
    plan = th.Campaign(strip().to_toml(), (vary,), samples=1)
    return {
        "Boundary": (th.Boundary, {"kind": "convection", "coefficient": 10.0}),
        "Interface": (th.Interface, {"part": "core", "resistance": 1e-8}),
        "Layer": (th.Layer, {"name": "c", "material": "Si", "thickness": 1e-6, "datum": True}),
        "Part": (th.Part, part),
        "Probe": (th.Probe, {"name": "far", "part": "core", "distance": 2e-5}),
        "Material": (th.Material, {"name": "x", "conductivity": 1.4, "density": 2200.0, "specific_heat": 700.0}),
        "PowerLaw": (th.materials.PowerLaw, {"exponent": -1.3, "reference": 300.0}),
        "Polynomial": (th.materials.Polynomial, {"coefficients": (1e-3,), "reference": 300.0}),
        "Table": (th.materials.Table, {"temperatures": (200.0, 400.0), "values": (1.0, 2.0), "reference": 300.0}),
        "silicon_film": (th.materials.silicon_film, {"thickness": 2e-7}),
        "CrossSection": (th.CrossSection, {"name": "x", "outer_radius": 30e-6, "ambient": 293.0, **lists}),
        "CrossSection.from_toml_text": (th.CrossSection.from_toml_text, {"text": strip().to_toml()}),
        "CrossSection.material_of": (strip().material_of, {"region": "core"}),
        "strip_ring": (th.strip_ring, {}),
        "rib_ring": (th.rib_ring, {"radius": 8e-6, "slab_width": 3e-6, "slab": 9e-8}),
        "heated_ring": (th.heated_ring, {}),
        "disc": (th.disc, {}),
        "assemble": (th.assemble, {"geometry": strip(), "accuracy": 0.05}),
        "discretize": (th.fem.discretize, {"mesh": mesh, "conductivity": cells, "heat_capacity": cells, "held": held}),
        "HeatProblem.thermal_resistance": (heat().thermal_resistance, {"heated": "core", "read": "core"}),
        "HeatProblem.steady_rise": (heat().steady_rise, {"power": 1e-3}),
        "HeatProblem.channels": (heat().channels, {"heated": "core", "read": ("core",)}),
        "HeatProblem.field": (heat().field, {"state": np.zeros(heat().unknowns)}),
        "solve": (th.solve, {"heat": heat(), "wave": th.Constant(1e-3), "times": [1e-8, 1e-7], "rtol": 1e-2}),
        "solve_periodic": (th.solve_periodic, {"heat": heat(), "wave": WAVE, "samples": 11, "rtol": 1e-2}),
        "derivatives": (th.derivatives, {"heat": heat(), "parameters": [OXIDE], "times": [1e-7]}),
        "Campaign": (th.Campaign, {"geometry": strip().to_toml(), "variations": (vary,), "samples": 1}),
        "Campaign.geometry_of": (plan.geometry_of, {"values": (1.95e-6,)}),
    }  # fmt: skip


def _waves() -> dict[str, Call]:
    makers: dict[str, Call] = {
        "Constant": (th.Constant, {"power": 1e-3}),
        "Pulse": (th.Pulse, {"power": 1e-3, "width": 1e-7, "start": 1e-6}),
        "SquareWave": (th.SquareWave, {"power": 1e-3, "period": 1e-6, "duty": 0.3}),
        "Chirp": (th.Chirp, {"power": 1e-3, "first": 1e-7, "last": 1e-6, "duration": 1e-5}),
        "Telegraph": (th.Telegraph, {"power": 1e-3, "dwell": 1e-6, "duration": 1e-5, "seed": 1}),
        "Symbols": (th.Symbols, {"values": [0, 1, 1], "rate": 1e6, "power": 1e-3, "bias": 1e-4}),
        "Sampled": (th.Sampled, {"times": [0, 1e-6, 2e-6], "power": [0, 1e-3, 0], "repeat": True}),
        "PiecewiseCubic": (
            th.waveforms.PiecewiseCubic,
            {"edges": [0, 1e-6], "coefficients": [[1e-3, 0, 0, 0]], "repeat": True},
        ),
        "Function": (th.Function, {"f": lambda t: 1e-3 + 0 * t, "breakpoints": (1e-7,), "period": 1e-6}),
        "Sweep": (coupled.Sweep, {"times": [0, 1e-6], "values": [0, 1e9]}),
    }
    found = dict(makers)
    for name, (kind, given) in makers.items():
        wave = kind(**given)
        found |= {
            f"{name}.__call__": (wave.__call__, {"t": 1e-7}),
            f"{name}.before": (wave.before, {"t": 1e-7}),
            f"{name}.breakpoints": (wave.breakpoints, {"start": 0.0, "stop": 1e-6}),
            f"{name}.mean": (wave.mean, {"start": 0.0, "stop": 1e-6}),
        }
    return found | {
        "PiecewiseCubic.of": (th.waveforms.PiecewiseCubic.of, {"wave": th.Constant(1e-3), "start": 0.0, "stop": 1e-6}),
        "waveforms.from_json": (th.waveforms.from_json, {"text": th.waveforms.to_json(WAVE)}),
        "waveforms.to_json": (th.waveforms.to_json, {"wave": WAVE}),
        "frequency_noise": (coupled.noise.frequency_noise, {"linewidth": 1e5, "bandwidth": 1e9, "duration": 1e-7}),
        "intensity_noise": (coupled.noise.intensity_noise,
                            {"power": 1e-3, "rin": -130.0, "bandwidth": 1e9, "duration": 1e-7}),
        "square_waves": (surrogate.square_waves, {"power": 1e-3, "periods": 2, "duties": (0.1,)}),
        "held_out_drives": (surrogate.judging.validate.held_out_drives, {"power": 1e-3}),
    }  # fmt: skip


def _models() -> dict[str, Call]:
    E, A, one = np.diag([1e-12, 1e-11]), -np.diag([1e-4, 1e-5]), np.ones((2, 1))
    q, network = quadratic(), identified_network()
    made = {
        "Foster": (MODEL, {"R": [1e3, 2e3], "tau": [1e-8, 1e-6], "inputs": ("a",)}),
        "StateSpace": (th.StateSpace(E, A, one, one.T), {"E": E, "A": A, "B": one, "C": one.T}),
        "Cauer": (th.models.cauer.Cauer([1e3, 2e3], [1e-12, 1e-11]), {"R": [1e3, 2e3], "C": [1e-12, 1e-11]}),
        "OutputMap": (th.OutputMap(MODEL, -4e-4), {"linear": MODEL, "coefficient": -4e-4}),
        "Quadratic": (q, {name: getattr(q, name) for name in "AHGBC"}),
        "Network": (network, {name: getattr(network, name) for name in ("A", "b", "names", "poles", "largest_rise")}),
    }
    found: dict[str, Call] = {}
    for name, (model, given) in made.items():
        found |= {
            name: (type(model), given),
            f"{name}.response": (model.response, {"wave": WAVE, "times": [1e-8, 1e-6]}),
            f"{name}.periodic_response": (model.periodic_response, {"wave": WAVE, "samples": 11}),
            f"{name}.step_response": (model.step_response, {"times": [1e-8, 1e-6]}),
            f"{name}.impedance": (model.impedance, {"frequency": [1e3, 1e6]}),
        }
    small, warm = coarse_fem(), coarse_warm_fem()
    return found | {
        "newton": (surrogate.newton, {"tau_th": 2.75e-7}),
        "second_order": (surrogate.second_order, {"kappa": 8.87e5, "tau_f": 5.58e-8, "tau_s": 1.2e-6, "eta": 0.31}),
        "cauer": (surrogate.cauer, {"model": MODEL}),
        "foster_of": (th.models.cauer.foster_of, {"ladder": surrogate.cauer(MODEL)}),
        "structure_function": (th.models.cauer.structure_function, {"model": MODEL}),
        "gate": (th.models.network.gate, {"A": network.A, "b": network.b, "static": network.thermal_resistance}),
        "reduce": (surrogate.reduce, {"system": small, "tolerance": 1e-2}),
        "balanced_truncation": (surrogate.balanced_truncation, {"system": small, "order": 3}),
        "reduce_array": (surrogate.reduce_array, {"heat": heat(), "positions": [[0, 0], [2e-5, 0]], "tolerance": 1e-2}),
        "reduce_quadratic": (surrogate.reduce_quadratic, {"system": warm, "power": 1e-2, "tolerance": 2e-2}),
        "output_map": (surrogate.output_map, {"system": warm, "power": 1e-2}),
        "pole_derivatives": (surrogate.reduction.pole_derivatives.pole_derivatives, {
            "heat": heat(), "parameters": OXIDE,
                                                          "reduction": surrogate.reduce(heat().system, 1e-2)}),
        "compare": (surrogate.compare, {"models": {"a": MODEL}, "reference": MODEL, "periods": [1e-6]}),
        "judge": (surrogate.judge, {"models": {"a": MODEL}, "reference": MODEL, "periods": [1e-6]}),
        "period_error": (surrogate.period_error, {"model": MODEL, "reference": MODEL, "periods": [1e-7, 1e-6]}),
    }  # fmt: skip


def _training() -> dict[str, Call]:
    times = np.linspace(0, 1e-5, 60)
    curve = surrogate.period_error(MODEL, surrogate.newton(tau_th=1e-6), np.geomspace(1e-7, 1e-5, 5))
    judged = surrogate.judge({"a": MODEL}, MODEL, periods=[1e-7, 1e-6])
    from chain import WAVES, dataset, known

    chain = dataset(WAVES[0])
    return {
        "dataset.build": (th.dataset.build, {"times": [0, 1e-6], "delta_T": [0, 1.0], "wave": th.Constant(1e-3)}),
        "fit_newton": (surrogate.fit_newton, {"data": data(), "method": "variable projection"}),
        "fit_second_order": (surrogate.fit_second_order, {"data": data()}),
        "fit_foster": (surrogate.fit_foster, {"data": data(), "order": 2, "method": "variable projection"}),
        "fit_spectrum": (surrogate.fit_spectrum, {"data": data(), "per_decade": 3}),
        "fit_decay": (surrogate.fit_decay, {"times": times, "rise": np.exp(-times / 1e-6), "order": 1}),
        "fit_output_map": (surrogate.reduction.output_map.fit_output_map, {"linear": MODEL, "data": data()}),
        "fit_sindy": (surrogate.fit_sindy, {"data": chain, "static": known()["static"]}),
        "fit_sindy_quadratic": (surrogate.fitting.sindy_quadratic.fit_sindy_quadratic, {"data": chain, **known()}),
        "valid_range": (surrogate.judging.validate.valid_range, {"curve": curve, "within": 0.1}),
        "validity": (surrogate.judging.validate.validity, {"curve": curve, "within": 0.1}),
        "verdict": (surrogate.judging.ladder.verdict, {"judged": judged, "within": 0.1}),
    }


def _light() -> dict[str, Call]:
    light: dict[str, Any] = {"ring": RING, "model": MODEL, "power": 1e-3, "detuning": 0.0}
    plane: dict[str, Any] = {"ring": RING, "model": MODEL, "powers": [1e-3, 2e-3], "detunings": [0.0, 1e9]}
    lifetimes = RING.carriers
    decay = coupled.carriers.pump_probe.carrier_decay(lifetimes, 2e23, np.linspace(0, 4e-7, 81))
    run = coupled.simulate(RING, MODEL, power=1e-3, duration=2e-7)
    regimes = coupled.stability_map(**plane)
    fem = coupled.FEM(heat())
    return {
        "RingResonator": (coupled.RingResonator, {n: getattr(RING, n) for n in RING.__dataclass_fields__}),
        "RingResonator.from_quality_factors": (
            coupled.RingResonator.from_quality_factors,
            {"base": RING, "name": "x", "frequency": 193e12, "loaded_q": 1e4, "intrinsic_q": 1e5},
        ),
        "ConstantLifetime": (coupled.ConstantLifetime, {"tau": 1e-9}),
        "ShockleyReadHall": (coupled.ShockleyReadHall,
                             {n: getattr(lifetimes, n) for n in lifetimes.__dataclass_fields__}),
        "carrier_decay": (coupled.carriers.pump_probe.carrier_decay, {
            "carriers": lifetimes, "initial": 2e23, "times": [0.0, 1e-7]}),
        "fit_carrier_decay": (coupled.carriers.pump_probe.fit_carrier_decay, {"data": decay, "material": lifetimes}),
        "Laser": (coupled.Laser, {"power": 1e-3, "detuning": 1e9, "phase": 0.1}),
        "State": (coupled.State, {"field": 0j, "carriers": 0.0, "thermal": [0.0, 0.0]}),
        "State.from_array": (coupled.State.from_array, {"values": np.zeros(5)}),
        "State.end_of": (coupled.State.end_of, {"run": run}),
        "Event": (coupled.Event, {"quantity": "delta_T", "level": 1.0}),
        "Method": (coupled.kernel.tableaus.Method, {"value": "rodas4"}),
        "Regime": (coupled.runs.pulsing.Regime, {"value": "stable"}),
        "simulate": (coupled.simulate, {**light, "duration": 2e-9}),
        "pulsing": (coupled.pulsing, {"run": run}),
        "overlap": (coupled.maps.pulsing_map.overlap, {"first": regimes, "second": regimes}),
        "steady_states": (coupled.steady_states, light),
        "limit_cycle": (coupled.limit_cycle, {**light, "power": 6e-3}),
        "stability_map": (coupled.stability_map, plane),
        "transmission": (coupled.transmission, {**light, "detuning": [0.0, 1e9]}),
        "sweep": (coupled.equilibria.transmission.sweep, {**light, "detuning": [0.0, 1e9]}),
        "power_for_drop": (coupled.equilibria.transmission.power_for_drop, {
            "ring": RING, "model": MODEL, "drop": 1e-4, "detuning": 0.0}),
        "van_vaerenbergh_q": (coupled.equilibria.van_vaerenbergh.van_vaerenbergh_q, {"ring": RING, "model": MODEL}),
        "FEM": (coupled.FEM, {"heat": heat()}),
        "FEM.advance": (fem.advance, {"times": np.array([0, 1e-9]), "power": th.Constant(1e-3)}),
        "cosimulate": (coupled.cosimulate, {"ring": RING, "heat": heat(), "power": 1e-3, "duration": 1e-9}),
        "identify": (coupled.identify, {"ring": RING, "traces": None, "free": ["kappa"]}),  # no valid call is short
        "fit_newton_per_trace": (coupled.identification.newton_traces.fit_newton_per_trace, {
            "ring": RING, "traces": None}),
    }  # fmt: skip


def _circuits() -> dict[str, Call]:
    circuit = coupled.bus([RING, RING])
    given = {"circuit": circuit, "thermal": MODEL, "inputs": {"in": 1e-3}}
    guide = {"start": "ring 1.through", "stop": "ring 2.in", "loss": 0.1, "phase": 0.1, "delay": 1e-12}
    return {
        "Circuit": (coupled.Circuit, {"rings": [RING], "lasers": [coupled.LaserPort("in", "ring 1.in")]}),
        "Circuit.scattered": (circuit.scattered, {"sigma": 1e9, "seed": 1}),
        "Waveguide": (coupled.Waveguide, guide),
        "LaserPort": (coupled.LaserPort, {"name": "in", "stop": "ring 1.in", "loss": 3.0}),
        "Detector": (coupled.Detector, {"name": "out", "start": "ring 1.drop", "bandwidth": 1e10}),
        "Splitter": (coupled.Splitter, {"name": "half", "cross": 0.5}),
        "bus": (coupled.bus, {"rings": [RING]}),
        "crow": (coupled.crow, {"rings": [RING, RING]}),
        "scissor": (coupled.scissor, {"rings": [RING, RING]}),
        "delay_loop": (coupled.circuit.delay_loop, {"ring": RING, "delay": 1e-10}),
        "spectrum": (coupled.spectrum, {"circuit": circuit, "detunings": [0.0, 1e9]}),
        "simulate_circuit": (partial(coupled.simulate_circuit, duration=2e-9), given),
        "circuit_steady_states": (coupled.circuit_steady_states, {**given, "starts": 2}),
    }


def _files() -> dict[str, Call]:
    frames = th.solve(heat(), th.Constant(1e-3), [0, 1e-7], rtol=1e-2, field_times=[1e-7])
    table = "rows.csv"
    columns = {"path": table, "time": "t", "power": 1e-3, "temperature": "T", "units": {"time": "s"}}
    return {
        "save": (th.save, {"data": data(), "path": "data.nc"}),
        "load": (th.load, {"path": "kept.nc"}),
        "read_csv": (th.read_csv, columns),
        "open_campaign": (th.campaign.open_campaign, {"directory": "."}),
        "write_fields": (th.data.fields.write_fields, {"data": frames, "path": "fields.vtu"}),
        "save_model": (surrogate.save_model, {"model": MODEL, "path": "model.json", "provenance": {}}),
        "load_model": (surrogate.load_model, {"path": "kept.json"}),
        "load_provenance": (th.models.files.load_provenance, {"path": "kept.json"}),
        "load_family": (surrogate.load_family, {"path": "kept.json"}),
        "export_model": (surrogate.export_model, {"model": MODEL, "path": "model.cir", "to": "spice"}),
    }


def prepare() -> None:
    """The files that some calls read, in the working directory."""
    th.save(data(), "kept.nc")
    surrogate.save_model(MODEL, "kept.json")
    rows = "".join(f"{k}e-7,{1 - np.exp(-k / 10):.6f}\n" for k in range(60))
    Path("rows.csv").write_text(f"t,T\n{rows}", encoding="utf-8")


@cache
def small_family() -> surrogate.family.Family:
    """A family of one parameter over a small range, trained in seconds."""
    box = Variation("box", ("layer.box.thickness",), "m", low=1.9e-6, high=2e-6)
    return surrogate.train_family(th.Campaign(th.strip_ring().to_toml(), (box,), samples=1), 5e-2)


def _studies() -> dict[str, Call]:
    """Calls of a family with one parameter."""
    family = small_family()
    (name,) = family.names
    middle = float(family.box.middle[0])
    given = {name: middle}
    spread = {name: stats.norm(middle, 1e-3 * middle)}
    R = float(family.thermal_resistance(**given))
    t = np.linspace(0, 1e-5, 60)
    trace = th.dataset.build(t, family.at(given).response(th.Constant(1e-3), t), th.Constant(1e-3))
    aim: dict[str, Any] = {"family": family, "target": {"thermal_resistance": R}}
    return {
        "design": (surrogate.design, aim),
        "pareto_front": (
            surrogate.studies.pareto.pareto_front,
            {**aim, "target": {"thermal_resistance": R, "rise_time": 1e-6}, "generations": 1},
        ),
        "calibrate": (surrogate.calibrate, {"geometry": family, "data": trace, "noise": 1e-2}),
        "uncertainty": (surrogate.uncertainty, {"family": family, "distributions": spread, "samples": 2}),
        "Family.at": (family.at, {"values": given}),
        "Family.model": (family.model, given),
        "Family.system": (family.system, given),
        "Family.reduced": (family.reduced, {"tolerance": 1e-2, **given}),
        "Family.derivatives": (family.derivatives, {"times": [1e-7], **given}),
        "Family.predicted_error": (family.predicted_error, given),
        "Family.step_response": (family.step_response, {"times": [1e-7], **given}),
        "Family.thermal_resistance": (family.thermal_resistance, given),
    }
