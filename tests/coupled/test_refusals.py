"""Bad arguments end in one line that names the argument and the rule: every function, its own slips, and files."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from correctors import Exact
from models import coarse_fem
from rings import BENT, RING, SECOND_ORDER, delay_loop
from scipy.interpolate import BPoly
from test_circuit import pair
from test_heaters import chain
from test_real_rings import FULL
from test_ring_from import nitride

import coupled
import thermofem as th
from coupled.carriers import carrier_decay
from coupled.circuit.network import light_of
from coupled.cycles.cycle_folds import cycle_fold_curves
from coupled.cycles.derivatives import cycle_derivatives
from coupled.equilibria.transmission import sweep
from coupled.identification.identify import identify
from coupled.noise import frequency_noise, intensity_noise

NAN = float("nan")
BUS = coupled.bus(RING)
ACTIVE = th.Foster(R=[9e3, -1e3], tau=[1e-7, 1e-6])
LARGE = th.Quadratic(-np.eye(61), np.zeros((61, 61, 61)), np.zeros((61, 61)), np.ones(61), np.ones(61))
HOT = th.Quadratic(-1e6 * np.eye(2), np.zeros((2, 2, 2)), np.zeros((2, 2)), np.ones(2), np.array([-1e30, 1e30]))
UNEVEN = th.StateSpace(np.eye(2), -np.array([[1e6, -9e5], [0.0, 1e6]]), np.eye(2)[:, :1], np.eye(2)[:1])
FEM = th.StateSpace(np.eye(501), -np.eye(501), np.ones((501, 1)), np.ones((1, 501)))
TRACE = xr.Dataset({"drop": ("time", np.ones(99), {"units": "W"})}, {"time": np.arange(99) * 1e-7})
SWEEP = coupled.transmission(RING, SECOND_ORDER, power=1e-4, detuning=(-5e10, 3e10)).drop_vars("through")
RUN = xr.Dataset(
    {name: ("time", np.arange(20.0)) for name in ("carriers", "drop", "delta_T")}, {"time": np.arange(20.0)}
)


def hot_heater():
    """A heater of 1e22 K/W."""
    return replace(chain(), B=chain().B * [1, 1e19])


def refused(words, function, *arguments, **named):
    with pytest.raises(th.InputError, match=words) as caught:
        function(*arguments, **named)
    assert "\n" not in str(caught.value)


# ring, model, power and detuning in every function that takes them
def at(function, **more):
    return lambda ring, model, power, detuning: function(ring, model, power=power, detuning=detuning, **more)


def over(function):
    return lambda ring, model, power, detuning: function(ring, model, [power], [detuning])


LIT = {
    "simulate": at(coupled.simulate, duration=1e-8),
    "steady_states": at(coupled.steady_states),
    "limit_cycle": at(coupled.limit_cycle),
    "sweep": lambda ring, model, power, detuning: sweep(ring, model, power=power, detuning=[detuning, detuning + 1e9]),
    "stability_map": over(coupled.stability_map),
    "pulsing_map": over(coupled.pulsing_map),
    "hopf_curves": over(coupled.hopf_curves),
    "fold_curves": over(coupled.fold_curves),
}


@pytest.mark.parametrize("function", LIT)
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"power": 8}, "8 dBm is 6.31e-3"),
        ({"power": -1e-3}, "powers? .*= -0.001 must|powers are in W|positive"),
        ({"power": NAN}, "nan is not finite"),
        ({"detuning": -10}, "did you mean -10e9"),
        ({"detuning": 193e12}, "laser minus cold resonance"),
        ({"model": ACTIVE}, "passive"),
        ({"ring": SECOND_ORDER}, "RingResonator"),
    ],
    ids=str,
)
def test_slips_of_the_light_the_ring_and_its_heat(function, change, words):
    refused(words, LIT[function], **{"ring": RING, "model": SECOND_ORDER, "power": 5e-3, "detuning": 0.0} | change)


GIVEN = {
    coupled.simulate: {"ring": RING, "model": SECOND_ORDER, "power": 1e-3, "duration": 1e-6},
    coupled.steady_states: {"ring": RING, "model": SECOND_ORDER, "power": 1e-3},
    coupled.transmission: {"ring": RING, "model": SECOND_ORDER, "power": 1e-3, "detuning": (-1e9, 1e9)},
    sweep: {"ring": RING, "model": SECOND_ORDER, "power": 1e-3, "detuning": [0.0, 1e9]},
    coupled.pulsing_map: {"ring": RING, "model": SECOND_ORDER, "powers": [4e-3, 6e-3], "detunings": [-1e10, 0.0]},
    coupled.limit_cycle: {"ring": RING, "model": SECOND_ORDER, "power": 6.31e-3},
    coupled.continue_cycle: {
        "ring": RING, "model": SECOND_ORDER, "parameter": "detuning", "values": (0.0, 1e9), "power": 6e-3,
    },
    cycle_fold_curves: {"ring": RING, "model": SECOND_ORDER, "powers": [1e-3, 2e-3], "detunings": [0.0, 1e9]},
    cycle_derivatives: {"ring": RING, "model": SECOND_ORDER, "parameters": ["R1"], "power": 6e-3},
    coupled.cosimulate: {"ring": RING, "heat": coarse_fem(), "power": 6e-3, "duration": 1e-8},
    identify: {"ring": RING, "traces": [TRACE.assign_attrs(power=1e-3, detuning=0.0)], "free": ["kappa"]},
    coupled.fit_transmission: {"ring": RING, "sweeps": [SWEEP], "free": ["bus_rate"]},
    coupled.explore: {"ring": RING, "models": SECOND_ORDER},
    coupled.pulsing: {"run": RUN},
    intensity_noise: {"power": 1e-3, "rin": -130, "bandwidth": 1e9, "duration": 1e-6},
    frequency_noise: {"linewidth": 1e5, "bandwidth": 1e9, "duration": 1e-6},
    coupled.ring_from: {"geometry": th.strip_ring(), "wavelength": 1.555e-6, "loss": 161.0, "coupling": 0.05},
    carrier_decay: {"carriers": RING.carriers, "initial": 1e23, "times": [0.0, 1e-9]},
}  # fmt: skip
SLIPS = {
    coupled.simulate: [
        ({"power": None}, "power = None is not a number"),
        ({"power": "8 dBm"}, "not a number"),
        ({"power": [1e-3, NAN]}, r"power\[1\] = nan"),
        ({"power": th.Constant(2.0)}, "8 dBm is 6.31e-3"),
        ({"power": coupled.Sweep([0, 1e-6], [1e-3, -1e-3])}, "powers are in W"),
        ({"power": coupled.Sweep([0, 0.5e-6], [1e-3, 1e-3])}, "cover the run"),
        ({"power": BPoly.from_derivatives([0, 1e-6], [[0, 0], [1e-3, 0]])}, "power is a BPoly; a PPoly is needed"),
        ({"detuning": coupled.Sweep([0, 1e-6], [0, -10])}, "did you mean -10e9"),
        ({"duration": 0}, "duration = 0 must lie between"),
        ({"duration": 20}, "20e-6 for 20 us"),
        ({"rtol": 2.0}, "rtol"),
        ({"method": "Rodas5"}, "did you mean 'rodas5p'"),
        ({"times": [0, 30e-6]}, "between 0 and the duration"),
        ({"times": [5e-7, 1e-7]}, "increase"),
        ({"times": []}, "empty"),
        ({"model": FEM}, "reduce it first"),
        ({"model": LARGE}, "from 1 to 60; reduce it"),
        ({"model": th.OutputMap(ACTIVE, 1e-3)}, "passive"),
        ({"model": "Newton"}, "a thermal model is needed"),
        # a run of .1 ns took millions of steps
        ({"model": th.Foster(R=[2e3, 1e30], tau=[5e-8, 1e-6])}, r"between -1e\+09 and 1e\+09.*resistances are in K/W"),
        ({"model": HOT}, r"between -1e\+09 and 1e\+09"),
        ({"model": hot_heater(), "heaters": {"heater": 1e-3}}, r"between -1e\+09 and 1e\+09"),
        ({"initial": 3}, "final_state"),
        ({"initial": xr.Dataset(attrs={"final_state": [0.0]})}, "shape"),
        ({"event": "delta_T"}, "coupled.Event"),
        ({"event": coupled.Event("delta_T", NAN)}, "event.level"),
        ({"event": coupled.Event("heat", 3.0)}, "delta_T"),
        ({"event": coupled.Event("delta_T", 5.0, stop="no")}, "event.stop = 'no' must be True or False"),
        ({"lasers": 1e-3}, "list of Laser"),
        ({"lasers": coupled.Laser(-1e-3)}, "power"),
        ({"model": chain()}, "heated='core'.*heaters=.*model.channel"),
        ({"model": chain(), "heaters": {"stove": 1e-3}}, "stove"),
        ({"model": chain(), "heaters": {"core": 1e-3}, "heated": "core"}, "which the light heats"),
        ({"model": chain(), "heaters": {"heater": -1e-3}}, "heater.* = -0.001 must"),
        ({"model": chain(), "heaters": [1e-3]}, "heaters = .* must be a mapping"),
        ({"heaters": {"heater": 1e-3}}, "an input for each heater.*surrogate.reduce"),
    ],
    coupled.steady_states: [
        ({"power": 0.0}, "power = 0 must be positive"),
        ({"model": chain(), "heaters": {"heater": th.Pulse(1e-3, 1e-7)}}, "constant power"),
    ],
    coupled.transmission: [
        ({"detuning": 0.0}, "must be a pair"),
        ({"power": (1e-3, 2e-3)}, "must be a pair"),
        ({"power": (2e-3, 1e-3), "detuning": 0.0}, "first < last"),
    ],
    sweep: [({"detuning": 0.0}, "must be an array"), ({"power": [1e-3, 8.0], "detuning": 0.0}, r"power\[1\] = 8")],
    coupled.pulsing_map: [
        ({"powers": [1e-3, 1e-3]}, "not above"),
        ({"detunings": []}, "empty"),
        ({"duration": 20}, "20e-6 for 20 us"),
        ({"settled": True, "duration": 1e-6}, "settled=True goes with neither"),
        ({"follow": "upp"}, "did you mean 'up'"),
        ({"vary": {"bus_rate": [4e10, 5e10]}}, "it needs two"),
        ({"vary": {"buss_rate": [4e10]}}, "did you mean 'bus_rate'"),
        ({"vary": {"bus_rate": [5e10, 4e10]}, "powers": 1e-3}, "must increase"),
    ],
    coupled.limit_cycle: [
        ({"power": 1e-3}, "comes to rest at a stable fixed point"),
        ({"guess": "cold"}, "guess is a str"),
    ],
    coupled.continue_cycle: [
        ({"power": None}, "power is missing"),
        ({"values": (1e9, 1e9)}, "two different numbers"),
        ({"values": (1e9, 2e9)}, "do not hold"),
        ({"parameter": "tau9"}, "tau9"),
    ],
    cycle_fold_curves: [({"powers": [2e-3, 1e-3]}, "powers")],
    cycle_derivatives: [({"parameters": ["R9"]}, "R9")],
    coupled.cosimulate: [
        ({"power": 6.31}, "powers are in W"),
        ({"max_discrepancy": 0}, "max_discrepancy"),
        ({"duration": 20}, "times are in s"),
        ({"heat": SECOND_ORDER}, "give th.assemble"),
        ({"heat": Exact}, "give th.assemble"),
        ({"heat": UNEVEN}, "symmetric"),  # factors would take one triangle for both
        ({"predictor": coarse_fem()}, "cosimulate|reduce it first"),
        ({"heaters": {"heater": th.Constant(1e-3)}}, "heater"),
        ({"heaters": {"core": th.Constant(1e-3)}}, "which the light heats"),
        ({"heat": Exact(SECOND_ORDER), "heaters": {"heater": th.Constant(1e-3)}}, "takes care of its own"),
        ({"field_times": [2e-9, 1e-9]}, "increase"),
        ({"field_times": [1e-9]}, "HeatProblem"),
    ],
    identify: [
        ({"free": ["kapa"]}, "did you mean 'kappa'"),
        ({"free": "kappa"}, "list of names"),
        ({"free": ["kappa", "tau_th"]}, "another thermal law"),
        ({"free": ["bus_rate"]}, "model="),
        ({"bounds": {"kappa": (2.0, 1.0)}}, "0 < low < high"),
        ({"bounds": {"eta": (1.0, 2.0)}}, "name in bounds"),
        ({"runs": 0}, "runs = 0"),
        ({"traces": []}, "traces is empty"),
        ({"traces": [xr.Dataset()]}, "no variable 'time'"),
        ({"traces": TRACE}, r"traces\[0\]\.attrs\['power'\] = None is not a number"),
    ],
    coupled.fit_transmission: [
        ({"sweeps": SWEEP.drop_vars("detuning")}, "wavelength"),
        ({"free": ["thermal_resistence"]}, "thermal_resistance"),
        ({"sweeps": []}, "empty"),
        ({"bounds": {"bus_rate": (2e10, 1e10)}}, "bus_rate"),
    ],
    coupled.explore: [
        ({"models": th.Foster(R=np.ones(70), tau=np.geomspace(1e-9, 1e-5, 70))}, "70 poles, at most 60"),
        ({"models": BENT}, "is quadratic; the page runs"),
        ({"models": {}}, "give 1 to 6"),
        ({"heated": "zz"}, "heated = 'zz' is unknown; known: core"),
        ({"heat": np.zeros((0, 3))}, "heat is a ndarray"),
    ],
    coupled.pulsing: [
        ({"run": {"carriers": 1}}, "run is a dict; a Dataset"),
        ({"run": RUN.drop_vars("carriers")}, "'carriers'"),
        ({"run": RUN.drop_vars("time")}, "'time'"),
        ({"run": RUN.isel(time=slice(5))}, "at least 8"),
        ({"run": RUN.assign(carriers=RUN.carriers.where(RUN.time != 7))}, r"run.carriers\[7\]"),
    ],
    intensity_noise: [({"rin": -80}, "negative"), ({"rin": 130}, "rin")],
    frequency_noise: [
        ({"bandwidth": 1e6, "linewidth": 1e2, "duration": 1e-7}, "one period"),
        ({"linewidth": 1e9}, "below 5 times the linewidth"),
        ({"bandwidth": 1e12, "duration": 1e-3}, "samples"),
        ({"seed": -1}, "seed"),
    ],
    coupled.ring_from: [
        ({"gap": 250e-9}, "gap and coupling"),
        ({"coupling": None}, "gap and coupling"),
        ({"coupling": 0.6}, "coupling"),
        ({"coupling": None, "gap": 0.0}, "gap"),
        ({"coupling": None, "gap": 250.0}, "gap"),
        ({"coupling": None, "gap": 100e-9, "straight": 10e-6}, "gap"),
        ({"loss": -1.0}, "loss"),
        ({"loss": "7 dB"}, "loss"),
        ({"mode": "TE7"}, "mode"),
        ({"geometry": th.strip_ring(width=150e-9)}, "guides no mode"),
        ({"geometry": th.straight_guide()}, "straight"),
        ({"geometry": nitride(), "base": RING}, "silicon"),
    ],
    carrier_decay: [({"initial": -1}, "initial"), ({"times": [0, 50]}, r"times\[-1\] = 50")],
}


@pytest.mark.parametrize(
    ("function", "change", "words"),
    [pytest.param(f, *row, id=f"{f.__name__}, {row[1]}") for f, rows in SLIPS.items() for row in rows],
)
def test_slips_of_every_function(function, change, words):
    refused(words, function, **GIVEN[function] | change)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"frequency": 192.88}, "192.88e12"),
        ({"bus_rate": 43}, "43e9"),
        ({"bus_rate": NAN}, "not finite"),
        ({"drop_rate": -1.0}, "drop_rate"),
        ({"tpa_volume": 5.35}, "um"),
        ({"tpa_coefficient": 0.81}, "cm/GW"),
        ({"kerr_coefficient": 4.5e-14}, "4.5e-18"),
        ({"fca_cross_section": 1.5e-17}, "cm"),
        ({"refractive_index": 0.0}, "refractive_index"),
        ({"thermo_optic": 1.86}, "1/K"),
        ({"fcd": ()}, "empty"),
        ({"fcd": ((1e-27, 1.0),)}, "negative"),
        ({"fcd": ((-9.5e-21, 1.0),)}, "cm"),
        ({"fcd": ((-1e-27, 0.0),)}, "exponent"),
        ({"lumped_fcd": 9.5e-27}, "negative"),
        ({"rates": (("eta_tpaa", 1.0),)}, "did you mean 'eta_tpa'"),
        ({"rates": (("eta_tpa", -1.0),)}, "rates eta_tpa = -1 must"),
        ({"carriers": {"tau_n": 35}}, "35e-9"),
        ({"carriers": {"tau_p": 0.0}}, "tau_p"),
        ({"carriers": {"hole_density": 0}}, "cm"),
        ({"carriers": {"trap_energy": 660}}, "eV"),
        ({"carriers": {"thermal_energy": 293.15}}, "k_B T"),
    ],
    ids=str,
)
def test_slips_of_unit_in_a_ring(change, words):
    changed, given = (RING.carriers, change["carriers"]) if "carriers" in change else (RING, change)
    refused(words, replace, changed, **given)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("loaded_q = 12000\n", "", "loaded_q and intrinsic_q belong together"),
        ("buses = 2", "buses = 3", "known: 1, 2"),
        ("buses = 2", 'bus_rate = "43e9 1/s"', "bus_rate are both given"),
        ('"1551.2 nm"', '"1551.2"', "has no unit"),
        ("wavelength", "wavelenght", "did you mean 'wavelength'"),
        ("refractive_index = 3.485\n", "", "refractive_index missing"),
        ('name = "rib ring 3"', 'base = "borghi2020"', "did you mean 'borghi2021'"),
        ('"10 ns"', '"10 nm"', "wrong dimension"),
        ('"10 ns"', '"10 ns"\ntau_n = "3 ns"', "of ConstantLifetime: key"),
        ("exponent = 0.8", "", "exponent is missing"),
        ("-1.07e-27", "1.07e-27", "index change"),
        ("[carriers]", "[carriers", "TOML"),
    ],
)
def test_slips_in_a_ring_file(old, new, words):
    coupled.RingResonator.from_text(FULL)
    refused(words, coupled.RingResonator.from_text, FULL.replace(old, new))


def test_no_ring_has_these_quality_factors_or_this_lifetime():
    common = {"name": "ring", "frequency": 193e12}
    make, fixed = coupled.RingResonator.from_quality_factors, RING.with_rates(eta_tpa=1e22, eta_fca=1e-13)
    refused("is below intrinsic_q", make, RING, **common, loaded_q=1e5, intrinsic_q=1e4)
    common |= {"loaded_q": 6e3, "intrinsic_q": 1e5}
    assert make(fixed, **common).eta_tpa == 1e22
    refused("base has eta_tpa set", make, fixed, **common, perimeter=50e-6, mode_area=0.1e-12)
    refused("tau", coupled.ConstantLifetime, 10.0)
    one, read = 'base = "borghi2021"\nbuses = 1\n', coupled.RingResonator.from_text
    refused("absorbed_fraction goes with", read, one + "absorbed_fraction = 0.4\n")
    refused("a ring on one bus has none", read, one + 'drop_rate = "40e9 1/s"\n')
    refused("resonance is a float", coupled.Laser, 1e-3, resonance=194e12)


IN = coupled.LaserPort("in", "ring 1.in")


def wired(waveguides, detectors=()):
    return coupled.Circuit([RING, RING], waveguides, [IN], detectors)


def lit(circuit, power, **options):
    return coupled.simulate(circuit, options.pop("model", SECOND_ORDER), power=power, duration=1e-8, **options)


def at_rest(circuit, power):
    return coupled.steady_states(circuit, SECOND_ORDER, power=power)


BEATING = [coupled.LaserPort("a", "ring 1.in"), coupled.LaserPort("b", "ring 1.add", offset=1e9)]
# two splitters in a ring of their own without loss
LOOPED = ([coupled.Waveguide("s.out 1", "s.in 1")], [IN], (), [coupled.Splitter("s", cross=0.0)])


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: coupled.Circuit([RING]), "no laser"),
        (lambda: coupled.Circuit([3], (), [IN]), "is a int; it must be a RingResonator"),
        (lambda: coupled.Circuit([RING], (), [IN, replace(IN, name="b")]), "holds 'ring 1.in' twice"),
        (lambda: wired([coupled.Waveguide("ring 1.through", "ring 3.in")]), "enters by = 'ring 3.in' is unknown"),
        (lambda: wired([coupled.Waveguide("ring 1.thru", "ring 2.in")]), "leaves by = .*'ring 1.through'"),
        (lambda: wired([coupled.Waveguide("ring 1.through", "ring 1.in")]), "enters by holds 'ring 1.in' twice"),
        (
            lambda: wired((), [coupled.Detector("d", f"ring {k}.drop") for k in (1, 2)]),
            "detector names holds 'd' twice",
        ),
        (lambda: coupled.Waveguide("ring 1.through", "ring 2.in", loss=-1), "loss = -1 must lie.*no gain"),
        (lambda: coupled.Waveguide("a", "b", delay=1), "did you mean 1e-9"),
        (lambda: coupled.LaserPort("in", "ring 1.in", loss=-1), "laser 'in': loss = -1 must lie"),
        (lambda: BUS.scattered(1e9, seed=-1), "seed = -1 must be a whole number from 0"),
        (lambda: coupled.crow([replace(RING, drop_rate=0.0)] * 2), "drop_rate of ring 1 = 0 must be positive"),
        (lambda: light_of(coupled.Circuit([RING], *LOOPED)), "light piles up"),
        (lambda: lit(delay_loop(RING, 1e-15), {"in": 1e-3}), "= 1e-15 must lie .* no step would be longer"),
        (lambda: lit(BUS, {"inn": 1e-3}), "did you mean 'in'"),
        (lambda: lit(BUS, 1e-3), "power is a float"),
        (lambda: lit(coupled.bus([RING] * 3), {}, model=pair()), "2 inputs and 2 outputs, the circuit 3 rings"),
        (lambda: lit(BUS, {}, heaters={"heater": 1e-3}), "no heaters among its inputs"),
        (lambda: lit(delay_loop(RING, 1e-9), {}, detuning=coupled.Sweep([0, 1e-8], [0, 1e9])), "detuning varies"),
        (lambda: at_rest(BUS, {"in": th.Constant(1e-3)}), r"power\['in'\] = Constant.*is not a number.*belong to"),
        (lambda: at_rest(delay_loop(RING, 1e-9), {"in": 1e-3}), "the circuit has delays"),
        (lambda: at_rest(coupled.Circuit([RING], (), BEATING), {"a": 1e-3, "b": 1e-3}), "different frequency beat"),
        (lambda: at_rest(RING, {"in": 1e-3}), "power = "),
    ],
)
def test_slips_of_circuits(call, words):
    refused(words, call)


class Absolute(Exact):
    """Broken: temperatures over absolute zero instead of rises."""

    def advance(self, times, power):
        return super().advance(times, power) + 293.15


class Impatient(Exact):
    """Broken: every call moves the accepted state."""

    def advance(self, times, power):
        rise = super().advance(times, power)
        self.state = self.tried
        return rise


def later(rise):
    """0 at the first time, whose value is known, and 1 at the others."""
    return np.arange(rise.size) > 0


class Answer(Exact):
    """Broken: `answer` of the right rise and the number of the call."""

    def __init__(self, answer):
        super().__init__(SECOND_ORDER)
        self.answer, self.calls = answer, 0

    def advance(self, times, power):
        self.calls += 1
        return self.answer(super().advance(times, power), self.calls)


@pytest.mark.parametrize(
    ("broken", "duration", "words"),
    [
        (Absolute(SECOND_ORDER), 1e-6, r"returned 293.15 K at t = 0 s, .*0 K; .* rise over ambient"),
        (Impatient(SECOND_ORDER), 1e-6, r"start from what accept\(\) kept last"),
        (Answer(lambda rise, k: rise[1:]), 1e-9, "has shape"),
        (Answer(lambda rise, k: rise * NAN), 1e-9, "stops at t = 0 s: .*not finite"),
        (Answer(lambda rise, k: rise - 1e30 * later(rise)), 1e-9, r"stops at t = 0 s: .*says -1e\+30 K"),
        (
            Answer(lambda rise, k: rise + np.random.default_rng(k).normal() * later(rise)),
            1e-9,
            "stops at t = 0 s: .*discrepancy goes from",
        ),
    ],
    ids=["absolute", "impatient", "short", "nan", "unit", "noise"],
)
def test_a_corrector_that_breaks_its_contract_is_named(broken, duration, words):
    """Believed, they would give 293 K, and 7.38 K where 3.68 K is right."""
    with pytest.raises(th.InputError, match=words):
        coupled.cosimulate(RING, broken, power=6.31e-3, duration=duration)
