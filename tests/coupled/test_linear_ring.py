"""The linear ring: against ngspice, differences of steady states, small steps in time, Hopf points, a closed form."""

from __future__ import annotations

import logging
import shutil
import subprocess

import numpy as np
import pytest
from rings import BENT, FIVE, LINEAR, RING, SECOND_ORDER

import coupled
import surrogate
import thermofem as th

POWER, DETUNING = 1e-3, -5e9
# K/GHz of the strip reduced to 1e-3 at 1 mW and -5 GHz: complex steps of the equations typed in by hand, and ngspice
# ``.ac`` of the exported deck, by frequency in Hz
PRINTED = {
    1e2: 8.834060e-2 - 3.02439e-4j,
    1e4: 7.577502e-2 - 2.25579e-2j,
    1e5: 3.315833e-2 - 1.88886e-2j,
    1e6: 1.274971e-2 - 1.04735e-2j,
    1e7: 2.882350e-3 - 4.25934e-3j,
    1e9: -5.94941e-6 - 1.14502e-4j,
}


@pytest.fixture(scope="module")
def fem():
    """The ten-pole reduction of the reference strip."""
    return surrogate.reduce(th.assemble(th.strip_ring()).system, tolerance=1e-3).model


@pytest.fixture(scope="module")
def heated():
    """Two parts that are heated and read, with five poles: a core, a heater and a neighbour that is read."""
    rate = np.geomspace(1e5, 1e8, 5)
    draw = np.random.default_rng(2)
    core = draw.uniform(0.5, 1.0, 5) * np.sqrt(3000 * rate / 5)
    heater = core * draw.uniform(-0.2, 0.4, 5)
    neighbour = core * draw.uniform(0.0, 0.1, 5)
    B = np.column_stack([core, heater])
    C = np.vstack([core, heater, neighbour])
    return th.StateSpace(np.eye(5), -np.diag(rate), B, C, ("core", "heater"), ("core", "heater", "neighbour"))


def values(linear, output, given):
    """The static gain from one input to one output."""
    return linear.static[linear.outputs.index(output), linear.inputs.index(given)]


def test_the_response_is_that_of_the_printed_equations_and_of_ngspice(fem, validated):
    """Half a unit of the last digit of the printed moduli and of the temperature, one of R_eff."""
    linear = coupled.linearize(RING, fem, power=POWER, detuning=DETUNING)
    found = linear.response([*PRINTED])["response"].sel(input="detuning", output="delta_T").values * 1e9
    printed = np.array([*PRINTED.values()])
    assert np.abs(found / printed - 1).max() < 5e-6
    spice = {"source": "independent: ngspice .ac of the exported deck"}
    for f, ours, expected in zip(PRINTED, np.abs(found), np.abs(printed), strict=True):
        what = f"temperature per detuning of the strip at 1 mW, -5 GHz and {f:g} Hz"
        validated("Linear ring", what, ours, expected, rel=5e-6, unit="K/GHz", **spice)
    rise = linear.state["delta_T"]
    validated("Linear ring", "rise at 1 mW and -5 GHz", rise, 1.283449, within=5e-7, unit="K", **spice)
    resistance = linear.thermal_resistance
    validated("Linear ring", "R_eff at 1 mW and -5 GHz", resistance, 15016, within=1, unit="K/W", **spice)
    assert linear.eigenvalues[0] == pytest.approx(-94970.42, abs=0.01)
    assert linear.stable


AC = """* bench
.include {name}.cir
Vre in_re 0 DC {amplitude!r}
Vim in_im 0 0
Vdet det 0 DC {detuning!r} AC 1
X1 in_re in_im 0 0 tr_re tr_im dr_re dr_im det heat 0 {name}
.options reltol=1e-9 gmin=1e-18 vntol=1e-12 abstol=1e-15
.control
ac dec 1 1e3 1e9
set numdgt=12
set wr_singlescale
wrdata out.txt v(heat) v(dr_re) v(dr_im)
op
wrdata op.txt v(heat) v(dr_re) v(dr_im)
quit
.endc
.end
"""


@pytest.mark.parametrize(("power", "detuning"), [(2e-3, 4e9), (0.5e-3, -12e9), (3e-3, -16e9)])
def test_the_response_is_that_of_ngspice_on_the_exported_ring(tmp_path, fem, power, detuning):
    """On both sides of the resonance, delta_T and drop. ngspice's own operating point is good to 1e-6."""
    program = shutil.which("ngspice") or pytest.skip("ngspice is not installed")
    coupled.export_ring(RING, fem, tmp_path / "ring.cir")
    deck = AC.format(name="ring", amplitude=float(np.sqrt(power)), detuning=detuning / 1e9)
    (tmp_path / "bench.cir").write_text(deck)
    subprocess.run([program, "-b", "bench.cir"], cwd=tmp_path, capture_output=True, check=True, timeout=60)
    table = np.loadtxt(tmp_path / "out.txt")
    f = table[:, 0]
    waves = table[:, 1::2] + 1j * table[:, 2::2]
    op = np.loadtxt(tmp_path / "op.txt", ndmin=2)[0, 1:]
    linear = coupled.linearize(RING, fem, power=power, detuning=detuning)
    assert op[0] == pytest.approx(float(linear.state["delta_T"]), rel=1e-5, abs=0)
    found = linear.response(f)["response"].sel(input="detuning") * 1e9
    assert np.abs(found.sel(output="delta_T").values / waves[:, 0] - 1).max() < 1e-5
    drop = 2 * (op[1] * waves[:, 1] + op[2] * waves[:, 2])  # of |re + i im|^2 about real values
    assert np.abs(found.sel(output="drop").values / drop - 1).max() < 1e-5


def differences(run, base, name, size, outputs):
    """Central differences of the outputs of ``run(**values)`` in one value, Richardson's extrapolation of two."""

    def slope(h):
        ahead = run(**base | {name: base[name] + h})
        behind = run(**base | {name: base[name] - h})
        return np.array([float(ahead[one]) - float(behind[one]) for one in outputs]) / (2 * h)

    return (4 * slope(size / 2) - slope(size)) / 3


@pytest.mark.parametrize("model", [SECOND_ORDER, FIVE, LINEAR, BENT, th.OutputMap(FIVE, 2e-3)])
@pytest.mark.parametrize("detuning", [-8e9, 3e9])
def test_static_gains_are_differences_of_steady_states(model, detuning):
    """Steps of 1e-4: the extrapolation errs by their fourth power, round-off of the states by 1e-11/1e-4."""
    outputs = ("drop", "through", "delta_T")
    linear = coupled.linearize(RING, model, power=POWER, detuning=detuning)

    def run(power, detuning):
        return coupled.steady_states(RING, model, power=power, detuning=detuning).isel(branch=0)

    base = {"power": POWER, "detuning": detuning}
    for name, size in (("power", 1e-4 * POWER), ("detuning", 1e6)):
        found = [values(linear, output, name) for output in outputs]
        assert found == pytest.approx(differences(run, base, name, size, outputs), rel=1e-6, abs=0)
    # the ambient moves the resonance as a detuning does, and adds to the temperature itself
    turned = RING.thermal_shift / (2 * np.pi)
    assert values(linear, "drop", "ambient") == pytest.approx(
        values(linear, "drop", "detuning") * turned, rel=1e-12, abs=0
    )
    rise = 1 + values(linear, "delta_T", "detuning") * turned
    assert values(linear, "delta_T", "ambient") == pytest.approx(rise, rel=1e-12, abs=0)


@pytest.mark.parametrize("model", [FIVE, BENT, th.OutputMap(FIVE, 2e-3)], ids=["poles", "quadratic", "output map"])
def test_heat_raises_the_temperature_as_the_model_says_and_light_feeds_back(model):
    """With p = dP_abs/dT by the light, dT/dheat = r/(1 - r p) and dT/dambient = 1/(1 - r p): their ratio is r.

    r is the slope of the model's own steady rise at the absorbed power, by a central difference: 1e-4 squared.
    """
    linear = coupled.linearize(RING, model, power=POWER, detuning=-8e9)
    P = float(linear.state["absorbed"])
    h = 1e-4 * P
    rise = getattr(model, "steady_rise", lambda power: FIVE.thermal_resistance * power)
    slope = (rise(P + h) - rise(P - h)) / (2 * h)
    assert values(linear, "delta_T", "heat") / values(linear, "delta_T", "ambient") == pytest.approx(
        slope, rel=1e-7, abs=0
    )


def test_heaters_and_probes_are_differences_of_steady_states(heated):
    linear = coupled.linearize(RING, heated, power=POWER, detuning=DETUNING, heaters={"heater": 1e-3})
    assert linear.inputs == ("power", "detuning", "heat", "ambient", "heater")
    assert linear.outputs == ("drop", "through", "delta_T", "heater", "neighbour")
    assert len(linear.A) == 3 + heated.order

    def run(heater):
        powers = {"heater": heater}
        return coupled.steady_states(RING, heated, power=POWER, detuning=DETUNING, heaters=powers).isel(branch=0)

    outputs = ("drop", "through", "delta_T", "absorbed")
    by_heater = differences(run, {"heater": 1e-3}, "heater", 1e-6, outputs)
    found = [values(linear, output, "heater") for output in outputs[:3]]
    assert found == pytest.approx(by_heater[:3], rel=1e-6, abs=0)
    # the neighbour is warmed by the heater, and by what the ring then absorbs
    gain = heated.gain
    neighbour = gain[2, 1] + gain[2, 0] * by_heater[3]
    assert values(linear, "neighbour", "heater") == pytest.approx(neighbour, rel=1e-6, abs=0)


def test_the_thermal_resistance_with_light_is_a_difference_of_steady_states(fem):
    """A second input at the place of the light: its heat is ``heat``."""
    rate = 1 / np.asarray(fem.tau)
    root = np.sqrt(fem.gain)
    twin = th.StateSpace(np.eye(rate.size), -np.diag(rate), np.column_stack([root, root]), root[None], ("core", "more"))

    def run(more):
        powers = {"more": more}
        return coupled.steady_states(RING, twin, power=POWER, detuning=DETUNING, heaters=powers).isel(branch=0)

    (expected,) = differences(run, {"more": 2e-6}, "more", 1e-6, ("delta_T",))
    linear = coupled.linearize(RING, twin, power=POWER, detuning=DETUNING, heaters={"more": 2e-6})
    assert linear.thermal_resistance == pytest.approx(expected, rel=1e-6, abs=0)
    assert values(linear, "delta_T", "heat") == linear.thermal_resistance


def test_one_pole_and_fast_light_in_closed_form():
    """With light and carriers at rest, delta_T/heat = R/(1 + s tau - R dP_abs/dT): at 1 kHz off by 1 kHz/10 MHz."""
    tau = 1e-3
    model = th.Foster(R=[1000.0], tau=[tau])
    linear = coupled.linearize(RING, model, power=POWER, detuning=DETUNING)
    f = np.array([0.0, 100.0, 1000.0])
    found = linear.response(f)["response"].sel(input="heat", output="delta_T").values
    slope = (1 - 1000.0 / linear.thermal_resistance) / 1000.0  # W/K
    assert found == pytest.approx(1000.0 / (1 + 2j * np.pi * f * tau - 1000.0 * slope), rel=1e-4, abs=0)
    assert linear.eigenvalues[0].real == pytest.approx(-(1 - 1000.0 * slope) / tau, rel=1e-4, abs=0)


def test_a_small_step_is_that_of_simulate(fem):
    """A step of .01 % of the power from rest; the second order is 1e-4 of it, rtol 1e-11 leaves 1e-6."""
    linear = coupled.linearize(RING, fem, power=POWER, detuning=DETUNING)
    at_rest = coupled.simulate(RING, fem, power=POWER, detuning=DETUNING, duration=1e-3, rtol=1e-10)
    times = np.array([2e-11, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 4e-5])
    run = coupled.simulate(
        RING, fem, power=POWER * (1 + 1e-4), detuning=DETUNING, duration=5e-5, rtol=1e-11, initial=at_rest, times=times
    )
    step = linear.step(times)["step"].sel(input="power")
    for name in ("drop", "through", "delta_T"):
        change = run[name].values - float(linear.state[name])
        found = step.sel(output=name).values * 1e-4 * POWER
        assert change == pytest.approx(found, rel=3e-4, abs=1e-3 * np.abs(found).max()), name


def test_the_step_ends_at_the_static_gain_and_begins_with_d(fem):
    linear = coupled.linearize(RING, fem, power=POWER, detuning=DETUNING)
    step = linear.step([0.0, 1e-3])["step"].values
    assert step[0] == pytest.approx(linear.D, abs=0)
    assert step[1] == pytest.approx(linear.static, rel=1e-9, abs=0)  # the condition of the modes is 1e3


@pytest.mark.parametrize("balanced", [False, True])
def test_python_control_has_the_same_response(fem, balanced):
    import control

    linear = coupled.linearize(RING, fem, power=POWER, detuning=DETUNING)
    plant = linear.to_control(balanced=balanced)
    assert plant.input_labels == list(linear.inputs)
    assert plant.output_labels == list(linear.outputs)
    f = np.array([1e3, 1e6, 1e9])
    found = control.frequency_response(plant, 2 * np.pi * f).frdata
    expected = linear.response(f)["response"].values.transpose(1, 2, 0)
    assert found == pytest.approx(expected, rel=1e-6, abs=0)


def test_a_balanced_plant_can_be_sampled(fem):
    """The gain at z = 1 of the plant with a held input is the static one; its exponential loses 1e-16 |A| T = 1e-5."""
    import control

    linear = coupled.linearize(RING, fem, power=POWER, detuning=DETUNING)
    sampled = control.sample_system(linear.to_control(balanced=True), 1e-6)
    assert control.dcgain(sampled) == pytest.approx(linear.static, rel=1e-4, abs=0)


def test_the_leading_pair_lies_on_the_imaginary_axis_at_a_hopf_point():
    (curve, *_) = coupled.hopf_curves(RING, FIVE, [4e-3, 6e-3], [-30e9, 40e9])
    k = curve.sizes["point"] // 3
    point = curve.isel(point=k)
    power = float(point["power"])
    detuning = float(point["detuning"])
    states = coupled.steady_states(RING, FIVE, power=power, detuning=detuning)
    branch = int(np.abs(states["energy"].values - float(point["energy"])).argmin())
    linear = coupled.linearize(RING, FIVE, power=power, detuning=detuning, branch=branch)
    pair = linear.eigenvalues[:2]
    omega = 2 * np.pi * float(point["frequency"])
    assert np.abs(pair.imag) == pytest.approx([omega, omega], rel=1e-6, abs=0)
    assert np.abs(pair.real).max() < 1e-6 * omega


def test_the_ambient_reaches_the_ring_through_the_chip():
    """With the input of the model, a step of the ambient against `simulate`; at rest it is at once."""
    heat = th.assemble(th.strip_ring())
    model = surrogate.reduce(heat.channels(("core", "ambient"), "core"), tolerance=1e-4).model
    linear = coupled.linearize(RING, model, power=POWER, detuning=DETUNING, heated="core")
    assert linear.inputs == ("power", "detuning", "heat", "ambient")
    at_once = coupled.linearize(RING, model.channel("core", "core"), power=POWER, detuning=DETUNING)
    gain = values(at_once, "delta_T", "ambient")
    assert values(linear, "delta_T", "ambient") == pytest.approx(gain, rel=1e-4, abs=0)  # two reductions, each to 1e-4
    light = {"power": POWER, "detuning": DETUNING, "heated": "core", "read": "core"}
    rest = coupled.simulate(RING, model, duration=1e-3, rtol=1e-10, **light)
    times = np.array([1e-6, 1e-5, 5e-5])
    run = coupled.simulate(RING, model, ambient=1e-3, duration=6e-5, rtol=1e-10, initial=rest, times=times, **light)
    change = run["delta_T"].values - float(linear.state["delta_T"])
    step = linear.step(times)["step"].sel(input="ambient", output="delta_T").values * 1e-3
    assert change == pytest.approx(step, rel=2e-3, abs=1e-3 * step[-1])
    assert step[0] < 0.1 * step[-1]


# ---- circuits ---------------------------------------------------------------------------------


def crossed():
    """Two rings that warm each other, and a heater, as `surrogate.reduce_array` gives them."""
    rate = np.geomspace(3e5, 3e7, 4)
    draw = np.random.default_rng(5)
    own = draw.uniform(0.5, 1.0, 4) * np.sqrt(3000 * rate / 4)
    B = np.column_stack([own, 0.3 * own * draw.uniform(0.5, 1.0, 4), 0.1 * own])
    B = np.vstack([B, B[:, [1, 0, 2]]])
    E = np.eye(8)
    parts = ("ring 1", "ring 2", "heater")
    return th.StateSpace(E, -np.diag(np.tile(rate, 2)), B, B[:, :2].T, parts, parts[:2])


LOOP = coupled.Circuit(
    [RING, RING],
    waveguides=[
        coupled.Waveguide("ring 1.through", "ring 2.in", loss=1.0, phase=0.4),
        coupled.Waveguide("ring 2.drop", "ring 1.add", loss=3.0, phase=1.1),
    ],
    lasers=[coupled.LaserPort("in", "ring 1.in", phase=0.3)],
)


def test_a_circuit_of_one_ring_is_that_ring(fem):
    linear = coupled.linearize(RING, fem, power=POWER, detuning=DETUNING)
    circuit = coupled.linearize(coupled.bus([RING]), fem, power={"in": POWER}, detuning=DETUNING)
    assert circuit.inputs == ("power in", "detuning", "heat ring 1", "ambient")
    f = [0.0, 1e5, 1e7, 1e9]
    response = circuit.response(f)["response"].sel(output=["drop 1", "through", "delta_T ring 1"]).values
    expected = linear.response(f)["response"].values
    # columns and rows of one size; Newton's method ends at 1e-11
    size = np.abs(expected).max(axis=0)
    assert np.abs((response - expected) / size).max() < 1e-8
    assert circuit.thermal_resistance == pytest.approx(linear.thermal_resistance, rel=1e-8, abs=0)


@pytest.mark.parametrize("model", [FIVE, crossed()], ids=["alone", "crossed"])
@pytest.mark.parametrize("circuit", [coupled.bus([RING, RING]), LOOP], ids=["bus", "loop"])
def test_static_gains_of_two_rings_are_differences_of_steady_states(circuit, model):
    heaters = {"heater": 1e-3} if "heater" in model.inputs else {}
    settings = {"starts": 0, "heaters": heaters}
    linear = coupled.linearize(circuit, model, power={"in": POWER}, detuning=DETUNING, **settings)
    base = {"power": POWER, "detuning": DETUNING, **heaters}

    def run(power, detuning, heater=0.0):
        powers = {"heater": heater} if heaters else {}
        found = coupled.steady_states(circuit, model, power={"in": power}, detuning=detuning, starts=0, heaters=powers)
        state = found.isel(state=0)
        rises = {f"delta_T {name}": state["delta_T"].sel(ring=name) for name in circuit.names}
        return {port: state["output"].sel(port=port) for port in circuit.ports} | rises

    for name, size in (("power", 1e-4 * POWER), ("detuning", 1e6), ("heater", 1e-6)):
        if name not in base:
            continue
        given = "power in" if name == "power" else name
        expected = differences(run, base, name, size, linear.outputs)
        found = [values(linear, output, given) for output in linear.outputs]
        assert found == pytest.approx(expected, rel=1e-6, abs=1e-7 * np.abs(expected).max()), name


def test_a_small_step_of_two_rings_is_that_of_simulate():
    """A step of .01 % of the detuning's scale, 1 MHz of 10 GHz."""
    model = crossed()
    light = {"power": {"in": POWER}, "heaters": {"heater": 1e-3}}
    linear = coupled.linearize(LOOP, model, detuning=DETUNING, starts=0, **light)
    at_rest = coupled.simulate(LOOP, model, detuning=DETUNING, duration=1e-4, rtol=1e-10, **light)
    times = np.array([1e-11, 1e-9, 1e-7, 1e-6, 1e-5])
    settings = {"duration": 2e-5, "rtol": 1e-11, "initial": at_rest, "times": times}
    run = coupled.simulate(LOOP, model, detuning=DETUNING + 1e6, **light, **settings)
    step = linear.step(times)["step"].sel(input="detuning")
    for ring in LOOP.names:
        change = run["delta_T"].sel(ring=ring).values - float(linear.state["delta_T"].sel(ring=ring))
        found = step.sel(output=f"delta_T {ring}").values * 1e6
        assert change == pytest.approx(found, rel=1e-3, abs=1e-3 * np.abs(found).max())


# ---- what is refused, and what is said ---------------------------------------------------------


def test_several_steady_states_are_listed_and_branch_chooses(caplog):
    light = {"power": 5e-3, "detuning": -32e9}
    with caplog.at_level(logging.WARNING, "thermofem"):
        lowest = coupled.linearize(RING, SECOND_ORDER, **light)
    assert "0: 8.134 fJ" in caplog.text
    assert "branch= chooses" in caplog.text
    states = coupled.steady_states(RING, SECOND_ORDER, **light)
    assert states.sizes["branch"] == 3
    for branch in range(3):
        linear = coupled.linearize(RING, SECOND_ORDER, branch=branch, **light)
        growth = float(states["growth_rate"][branch])
        assert linear.eigenvalues[0].real == pytest.approx(growth, rel=1e-6, abs=0)
        assert linear.stable == (growth < 0)
    assert "unstable" in caplog.text
    assert lowest.stable
    with pytest.raises(th.InputError, match=r"branch = 3 must be .*2: 2.* branch= chooses"):
        coupled.linearize(RING, SECOND_ORDER, branch=3, **light)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"power": 0.0}, "power"),
        ({"detuning": np.nan}, "detuning"),
        ({"heaters": {"lamp": 1e-3}}, "lamp"),
        ({"branch": -1}, "branch"),
        ({"branch": 0.5}, "branch"),
    ],
)
def test_bad_input_of_a_ring_is_named(change, said, heated):
    with pytest.raises(th.InputError, match=said):
        coupled.linearize(RING, heated, **{"power": POWER, "detuning": DETUNING, "heated": "core"} | change)


def test_a_dark_circuit_and_frequencies_out_of_order_are_refused(fem):
    with pytest.raises(th.InputError, match="power"):
        coupled.linearize(coupled.bus([RING]), fem, power={"in": 0.0})
    linear = coupled.linearize(RING, fem, power=POWER)
    with pytest.raises(th.InputError, match="frequencies"):
        linear.response([1e6, 1e3])
    with pytest.raises(th.InputError, match="times"):
        linear.step([-1e-6, 0.0])
