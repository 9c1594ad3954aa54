"""A thing of the wrong kind where a function wants another: the error says what came and what is needed."""

from __future__ import annotations

import dataclasses
from decimal import Decimal

import numpy as np
import pytest

import coupled
import surrogate
import thermofem as th
from thermofem.campaign import Variation

MODEL = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])
TIMES = np.geomspace(1e-9, 1e-5, 30)
DATA = th.dataset.build(TIMES, 1e-3 * MODEL.step_response(TIMES), th.Constant(1e-3), read=("core",))
RING = coupled.borghi2021()
STRIP = th.strip_ring()
LIGHT = {"power": 1e-3, "detuning": 0.0, "duration": 1e-7}


@pytest.fixture(scope="module")
def heat():
    return th.assemble(th.strip_ring(), accuracy=1e-3)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda fit, heat: surrogate.period_error(DATA, MODEL, [1e-6], power=1e-3), "model is a Dataset; .* a fit"),
        (lambda fit, heat: surrogate.period_error(MODEL, DATA, [1e-6], power=1e-3), "reference is a Dataset"),
        (lambda fit, heat: surrogate.export_model(DATA, "ring.cir", to="spice"), "model is a Dataset; .* or a fit"),
        (lambda fit, heat: surrogate.save_model(DATA, "ring.json"), "a Dataset has no JSON form; .* Foster, Network"),
        (lambda fit, heat: coupled.simulate(RING, heat, **LIGHT), "model is a HeatProblem; .* coupled.cosimulate"),
        (lambda fit, heat: surrogate.train_all(heat, hot=-1.0), "hot = -1 must lie between 0 and 10"),
        (lambda fit, heat: surrogate.reduce(heat), "a HeatProblem cannot be reduced: .* .heat.system."),
        (lambda fit, heat: surrogate.fit_foster(DATA, order=2.5), "order = 2.5 must be a whole number"),
        (lambda fit, heat: th.save(MODEL, "ring.nc"), "data is a Foster; .* surrogate.save_model"),
        (lambda fit, heat: coupled.cosimulate(RING, heat, progress=3, **LIGHT), "progress = 3 must be a function"),
        (
            lambda fit, heat: coupled.pulsing_map(RING, MODEL, [1e-3], [0.0], duration=1e-7, show_bar=3),
            "show_bar = 3 must be True or False",
        ),
    ],
)
def test_the_wrong_kind_of_thing(call, words, heat, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(th.InputError, match=words):
        call(surrogate.fit_newton(DATA), heat)
    assert not list(tmp_path.iterdir())


WAVE = th.SquareWave(power=1e-3, period=1e-6, duty=0.3)
TRACE = coupled.simulate(RING, MODEL, **LIGHT)
EYE, ONES = np.eye(2), np.ones((2, 1))
PATH = "no name of a file; give a text or a pathlib.Path"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda heat: th.CrossSection.from_toml(None), f"path = None is {PATH}"),
        (lambda heat: th.Campaign.from_toml(3), f"path = 3 is {PATH}"),
        (lambda heat: th.open_campaign(None), f"directory = None is {PATH}"),
        (lambda heat: th.open_campaign("x" * 300), "x* holds no campaign"),
        (lambda heat: th.save(DATA, None), f"path = None is {PATH}"),
        (lambda heat: th.load(None), f"path = None is {PATH}"),
        (lambda heat: th.read_trace(None, 1e-3), f"path = None is {PATH}"),
        (lambda heat: surrogate.save_model(MODEL, None), f"path = None is {PATH}"),
        (lambda heat: surrogate.export_model(MODEL, None, to="spice"), f"path = None is {PATH}"),
        (lambda heat: surrogate.load_model(MODEL), f"path = Foster.* is {PATH}"),
        (lambda heat: coupled.RingResonator.from_toml(None), f"path = None is {PATH}"),
        (
            lambda heat: coupled.pulsing_map(RING, MODEL, [1e-3], [0.0], duration=1e-7, file=3),
            f"file = 3 is {PATH}",
        ),
        (lambda heat: heat.mesh.save(None), f"path = None is {PATH}"),
        (lambda heat: heat.thermal_resistance(3), "heated = 3 is unknown; known: core"),
        (lambda heat: heat.thermal_resistance(["core"]), "heated = .* is unknown; did you mean 'core'"),
        (lambda heat: heat.thermal_resistance("core", 3), "read = 3 is no name; give one or several of substrate"),
        (lambda heat: th.solve(heat, WAVE, [1e-6], read=("core", "core")), "holds 'core' twice; give each once"),
        (lambda heat: heat.steady_rise(1e9), "power = 1e.09 must lie between -10 and 10"),
        (lambda heat: MODEL.periodic_response(None, 10), "wave is a NoneType; a waveform is needed"),
        (lambda heat: MODEL.periodic_response(WAVE, "a"), "samples = 'a' must be a whole number"),
        (lambda heat: MODEL.periodic_response(WAVE, 10.5), "samples = 10.5 must be a whole number"),
        (lambda heat: th.solve_periodic(heat, WAVE, samples=10**10), "samples = 10000000000 must .* to 10,000,000"),
        (lambda heat: th.StateSpace(None, -EYE, ONES, ONES.T), "E is a NoneType; an array or a sparse"),
        (lambda heat: th.StateSpace([[1]], [[-1]], [[1]], [[1]]), "E is a list; an array or a sparse"),
        (lambda heat: th.StateSpace(EYE, -EYE * np.nan, ONES, ONES.T), "A holds nan, which is not finite"),
        (
            lambda heat: th.StateSpace(EYE[:0, :0], EYE[:0, :0], ONES[:0], ONES.T[:, :0]),
            "E has shape .0, 0.; two non-empty",
        ),
        (lambda heat: th.dataset.build(TIMES, TIMES, None), "wave is a NoneType; a waveform is needed"),
        (lambda heat: th.dataset.build(TIMES, TIMES[:3], WAVE), r"delta_T has shape \(3,\); a value for each of 30"),
        (lambda heat: th.dataset.build(TIMES, TIMES * np.nan, WAVE), "delta_T holds nan"),
        (lambda heat: th.dataset.build(TIMES[::-1], TIMES, WAVE), "times must increase"),
    ],
)
def test_what_names_no_file_no_part_and_no_numbers(call, words, heat, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(th.InputError, match=words):
        call(heat)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: surrogate.compare({"a": None}, MODEL), "a is a NoneType; a thermal model is needed"),
        (lambda: surrogate.compare({"a": MODEL}, None), "reference is a NoneType; a thermal model is needed"),
        (lambda: surrogate.compare(MODEL, MODEL), "models is a Foster; a mapping from names is needed"),
        (lambda: surrogate.compare({"a": MODEL}, MODEL, [None]), "drives is a NoneType; waveforms are needed"),
        (lambda: surrogate.judge(MODEL, MODEL), "models is a Foster; a mapping from names is needed"),
        (lambda: surrogate.judge({"a": MODEL}, 3), "reference is a int; a thermal model is needed"),
        (lambda: surrogate.verdict(DATA), "judged is a Dataset without period errors; judge makes one"),
        (lambda: surrogate.train_all(None), "heat is a NoneType; th.assemble"),
        (lambda: surrogate.valid_range(DATA), "curve is a Dataset without period errors; period_error makes one"),
        (lambda: surrogate.validity(None), "curve is a NoneType without period errors"),
        (lambda: surrogate.period_error(MODEL, MODEL, [0.3, 3]), r"periods\[-1\] = 3 is larger than 0.1 .* 1e-6"),
        (lambda: surrogate.cauer(None), "model is a NoneType; a thermal model is needed"),
        (lambda: surrogate.structure_function(DATA), "model is a Dataset; a thermal model is needed"),
        (lambda: surrogate.foster_of(MODEL), "ladder is a Foster; surrogate.cauer"),
        (lambda: surrogate.fit_sindy(None), "data is a NoneType; a Dataset is needed"),
        (lambda: surrogate.save_model(MODEL, "m.json", provenance=3), "provenance is a int; a mapping"),
        (lambda: surrogate.export_model(MODEL, "m.cir", to="spice", provenance=3), "provenance is a int; a mapping"),
        (lambda: coupled.power_for_drop(RING, MODEL, drop="a", detuning=0.0), "drop is not an array of numbers"),
        (lambda: coupled.power_for_drop(RING, MODEL, drop=1e-3, detuning="a"), "detuning is not an array of numbers"),
        (lambda: coupled.power_for_drop(RING, MODEL, drop=[], detuning=0.0), r"shape \(0,\) hold 0 values"),
        (lambda: coupled.power_for_drop(RING, MODEL, drop=[1e-3] * 2, detuning=[0.0] * 3), "do not go together"),
        (lambda: coupled.power_for_drop(RING, MODEL, drop=1e-3, detuning=[0, -8]), "did you mean -8e9?"),
        (lambda: coupled.power_for_drop(RING, MODEL, drop=1e-3, detuning=1e30), "detuning = 1e.30 must lie between"),
        (lambda: surrogate.compare({"a": MODEL}, MODEL, wavelength="a"), "wavelength = 'a' is not a number"),
        (lambda: surrogate.compare({"a": MODEL}, MODEL, shift=np.nan), "shift = nan is not finite"),
        (lambda: surrogate.square_waves(periods=2.5), "periods = 2.5 must be a whole number"),
        (lambda: surrogate.fit_decay([0, 1e-6], [1, 0], order=1.5), "order = 1.5 must be a whole number from 1 to 5"),
        (
            lambda: coupled.circuit_limit_cycle(coupled.bus(RING), MODEL, inputs={"in": 1e-3}, samples=10.5),
            "samples = 10.5 must be a whole number",
        ),
        (lambda: coupled.fit_carrier_decay(DATA, 3), "material is a int; coupled.borghi2021"),
        (lambda: th.Campaign(STRIP, ()), "geometry = CrossSection.* must be text"),
        (lambda: th.Campaign("a", ()), "geometry is not valid TOML.*to_toml"),
        (lambda: th.Campaign(STRIP.to_toml(), (3,)), "variations holds 3, which is no Variation"),
        (lambda: th.Campaign(STRIP.to_toml(), (), (th.Constant(1.0),)), "drives holds Constant.* no Drive"),
        (lambda: th.Campaign(STRIP.to_toml(), (), read="core"), "read = 'core' must be a list of str"),
        (lambda: th.Campaign(STRIP.to_toml(), (), seed="a"), "seed = 'a' must be a whole number"),
        (lambda: Variation("r", (3,)), "paths holds 3, which is no str"),
        (lambda: Variation("r", ("outer_radius",), "m", values=3), "values = 3 must be a list of str or int or float"),
        (lambda: Variation("r", ("outer_radius",), "nm", values=(1.0,)), "unit = 'nm' is unknown"),
        (lambda: surrogate.gate([[-1e6, 0]], [1e9], 1e3), r"A has shape \(1, 2\); \(1, 1\) goes with b"),
        (lambda: surrogate.gate([[np.nan]], [1e9], 1e3), "A holds nan"),
        (lambda: surrogate.gate([[-1e6]], [1e9], np.nan), "static = nan is not finite"),
        (lambda: coupled.carrier_decay(RING, 1e23, [0, 1e-9]), "carriers is a RingResonator; the .carriers of a ring"),
        (lambda: coupled.stability_map(RING, MODEL, [1e-3], [0.0], vary=3), "vary is a int; a mapping is needed"),
        (
            lambda: coupled.pulsing_map(RING, MODEL, [1e-3], [0.0], duration=1e-7, executor=3),
            "executor is a int; a concurrent.futures.Executor",
        ),
        (
            lambda: coupled.identify(RING, [TRACE], free=["kappa"], bounds=3),
            "bounds is a int; a mapping is needed",
        ),
        (lambda: dataclasses.replace(STRIP, layers=[3]), "layers holds 3, which is no Layer"),
        (lambda: dataclasses.replace(STRIP, parts=STRIP.parts[0]), "parts = Part.* must be a list of Part"),
        (lambda: dataclasses.replace(STRIP, top="x"), "the boundary holds 'x', which is no Boundary"),
        (lambda: th.Layer("a", np.zeros(2), 1e-6), "material = .* must be text"),
        (lambda: th.Telegraph(Decimal("1e-3"), 1e-6, 1e-5), "power = Decimal.* is not a number"),
        (lambda: coupled.Circuit(range(10**12)), "holds 1000000000000 rings; 1 to 1000"),
        (
            lambda: coupled.Circuit([RING], splitters=[coupled.Splitter("s")] * 1001),
            "holds 1001 splitters; at most 1000",
        ),
        (lambda: surrogate.fit_foster(DATA, transfer="x"), "transfer = 'x' must be True or False"),
        (lambda: coupled.bus(range(10**12)), "rings holds 0, which is no RingResonator"),
        (lambda: coupled.bus(np.array(3.0)), r"rings = array.* must be a list of RingResonator"),
        (lambda: coupled.pulsing(dataclasses), "run is a module; a Dataset from coupled.simulate"),
        (lambda: MODEL.periodic_response(DATA, 100), "wave is a Dataset; a waveform is needed"),
        (lambda: th.save(DATA.assign(note=("time", [object()] * 30)), "heat.nc"), "data cannot be written as netCDF"),
        (lambda: th.Sampled([0, 1], np.broadcast_to(0.0, 2 * 10**9)), "holds 2000000000 numbers; at most 20,000,000"),
        (lambda: coupled.Circuit([RING], lasers=3), "lasers = 3 must be a list of LaserPort"),
        (lambda: coupled.delay_loop(object(), 1e-9), "ring = <object .* must be one RingResonator"),
        (lambda: th.discretize(3, 1.0, 1.0, held=np.arange(2)), "mesh .* thermofem.Mesh"),
        (lambda: surrogate.square_waves(periods=np.timedelta64(5)), "periods = .* must be a whole number"),
        (lambda: surrogate.square_waves(periods=10**400), "periods = .* must be a whole number from 1 to 10,000"),
        (lambda: coupled.spectrum(3, [0.0]), "circuit is a int; a coupled.Circuit is needed"),
        (lambda: surrogate.fit_newton(range(10**12)), "data has no variable 'time'"),
        (lambda: surrogate.fit_newton(DATA, method=np.zeros(2)), "method = array"),
        (lambda: coupled.stability_map(RING, MODEL, [1e-3], [0.0], heaters=np.ones(2)), "heaters is a ndarray; a map"),
        (lambda: coupled.steady_states(RING, MODEL, power=1e-3, detuning=0.0, heated=np.ones(2)), "heated = array"),
        (lambda: th.load("\ud800.nc"), "half of a Unicode pair"),
        (lambda: coupled.State("a", 0.0, [0.0]), "field = 'a' is not a complex number"),
        (lambda: dataclasses.replace(RING, carriers=None), "carriers is a NoneType; ShockleyReadHall"),
        (lambda: dataclasses.replace(RING, loss_rate=None), "loss_rate = None is not a number"),
        (lambda: dataclasses.replace(RING, fcd=1.0), "fcd = 1.0 is no sequence of pairs"),
        (lambda: dataclasses.replace(RING, rates="ab c"), "rates = 'ab c' is no sequence of pairs"),
    ],
)
def test_what_is_no_model_no_ring_and_no_light(call, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(th.InputError, match=words):
        call()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("target", [None, np.nan, range(10**12), [], {}, {"thermal_resistance": "x", "rise_time": 1}])
@pytest.mark.parametrize("study", [surrogate.design, surrogate.pareto_front])
def test_targets_are_looked_at_before_a_family_is_trained(study, target):
    """`pareto_front` raised TypeError and AttributeError; both trained a family first, which takes seconds."""
    with pytest.raises(th.InputError, match=r"target|word"):
        study(th.strip_ring(), {"part.core.width": (400e-9, 401e-9)}, target=target)


def test_a_class_is_no_model():
    with pytest.raises(th.InputError, match="model is the class Foster"):
        coupled.stability_map(RING, th.Foster, [1e-3], [0.0, 1e9])


def test_a_field_beyond_all_numbers_is_refused():
    with pytest.raises(th.InputError, match="field energy = inf"):
        coupled.State(1e300, 0.0, [0.0])


def test_the_arrays_of_a_model_are_read_only():
    for kept in (MODEL.R, MODEL.tau, surrogate.cauer(MODEL).R):
        with pytest.raises(ValueError, match="read-only"):
            kept[0] = 1.0


@pytest.mark.filterwarnings("error")
def test_a_step_long_ago_has_settled_without_a_warning():
    assert MODEL.step_response(1e308) == pytest.approx(7e3)


PLAN = th.Campaign(
    STRIP.to_toml(), (Variation("box", ("layer.box.thickness",), "m", low=1.9e-6, high=2e-6),), samples=1
)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: coupled.pulsing_map(RING, MODEL, [1e-3], [0.0], settled="no"), "settled = 'no' must be True or False"),
        (lambda: coupled.cycle_derivatives(RING, MODEL, 3, power=6e-3), "parameters = 3 must be a list of str"),
        (lambda: surrogate.train_all(th.assemble(STRIP, 0.05), names=th.Foster), "names = .* must be a list of str"),
        (lambda: surrogate.train_all(th.assemble(STRIP, 0.05), read=TIMES), "read = .* must be text"),
        (lambda: surrogate.train_family(PLAN, seed=0.5), "seed = 0.5 must be a whole number"),
        (lambda: surrogate.train_family(PLAN, held_out=2.5), "held_out = 2.5 must be a whole number"),
        (lambda: surrogate.train_family(PLAN, report=3), "report = 3 must be a function"),
        (lambda: surrogate.train_family(PLAN, executor=3), "executor is a int"),
        (lambda: surrogate.train_family(PLAN, folder="file"), "folder file cannot be made: File exists"),
    ],
)
def test_studies_that_take_seconds_look_at_their_arguments_first(call, words, tmp_path, monkeypatch):
    """They raised TypeError, ValueError or FileExistsError, the last after the first members were solved."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(th.InputError, match=words):
        call()
