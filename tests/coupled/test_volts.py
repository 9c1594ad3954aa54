"""Heaters driven in volts and amperes: against SciPy, exact limits and the power in watts."""

from __future__ import annotations

import numpy as np
import pytest
from correctors import RING
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import coupled
import surrogate
import thermofem as th

OHM = 120.0
ALPHA = 1.5e-3  # 1/K
PLAIN = th.heated_ring().with_({"part.heater.resistance": OHM})
WARM = PLAIN.with_({"part.heater.tcr": ALPHA})


def pair(section=WARM, read=("core", "heater")) -> th.StateSpace:
    """Two heat capacities in a row, core and heater; both are heated, and read where ``read`` says so."""
    E = np.diag([8e-12, 60e-12])  # J/K
    K = np.array([[5e-4, -1e-4], [-1e-4, 3e-4]])  # W/K
    B = np.eye(2)
    C = np.array([B[("core", "heater").index(name)] for name in read])
    names = {"inputs": ("core", "heater"), "outputs": tuple(read)}
    return th.StateSpace(E, -K, B, C, origin={"geometry": section.to_toml()}, **names)


def scipy_run(model, power, detuning, square, exponent, times):
    """The ring and both temperatures in SI by SciPy: light, carriers, heat and P_h = V^2/R(dT_h) or I^2 R(dT_h)."""
    A = np.linalg.solve(model.E, model.A)
    B = np.linalg.solve(model.E, model.B)
    fast = RING.carriers
    size = np.array([1e-7, 1e-7, 1e23, 1, 1])

    def watts(t, rise):
        return square(t) * (OHM * (1 + ALPHA * rise)) ** exponent

    def right(t, scaled):
        re, im, N, *x = scaled * size
        a = re + 1j * im
        U = re * re + im * im
        index = RING.thermo_optic * x[0] + sum(c * N * (N * N + 1e30) ** ((p - 1) / 2) for c, p in RING.fcd)
        D = -RING.index_rate * index - 2 * np.pi * detuning
        own = RING.loss_rate + RING.eta_fca * N + RING.eta_tpa * U
        da = (1j * D - own - 2 * RING.bus_rate) * a + 1j * np.sqrt(2 * RING.bus_rate * power)
        dN = RING.g_tpa * U * U - N * (1 + fast.b * N) / (fast.tau0 * (1 + fast.a * N))
        dx = A @ x + B @ [2 * own * U, watts(t, x[1])]
        return np.array([da.real, da.imag, dN, *dx]) / size

    found = solve_ivp(right, (0, times[-1]), np.zeros(5), "Radau", times, rtol=1e-9, atol=1e-11)
    return found.y[3], watts(times, found.y[4])


DRIVES = {
    "a step of the voltage": (coupled.Volts(2.0), lambda t: 4.0 + 0 * t, -1),
    "a step of the current": (coupled.Amperes(12e-3), lambda t: 144e-6 + 0 * t, 1),
    "a ramp of the voltage": (coupled.Volts(coupled.Sweep([0, 2e-6], [0, 3.0])), lambda t: (1.5e6 * t) ** 2, -1),
}


@pytest.mark.parametrize("kind", DRIVES)
def test_scipy_agrees_on_a_heater_whose_resistance_follows_its_temperature(kind, validated):
    """1e-5, as rtol of 1e-8 and cubics of the absorbed light leave; the light alone heats the heater by .1 K."""
    drive, square, exponent = DRIVES[kind]
    times = np.linspace(0, 2e-6, 41)
    model = pair()
    light = {"power": 1e-3, "detuning": -20e9, "duration": 2e-6}
    run = coupled.simulate(RING, model, heaters={"heater": drive}, times=times, rtol=1e-8, **light)
    rise, watts = scipy_run(model, 1e-3, -20e9, square, exponent, times)
    assert run["delta_T"].values == pytest.approx(rise, rel=1e-5, abs=1e-5 * rise.max())
    assert run["heater_power"].values[0] == pytest.approx(watts, rel=1e-5, abs=1e-5 * watts.max())
    scipy = {"rel": 1e-5, "source": "independent: SciPy Radau"}
    validated("Heaters", f"power after 2 us of {kind}", run["heater_power"][0, -1], watts[-1], unit="W", **scipy)
    validated("Heaters", f"rise of the ring after 2 us of {kind}", run["delta_T"][-1], rise[-1], unit="K", **scipy)
    cold = square(times) * OHM**exponent
    assert np.abs(watts / np.maximum(cold, 1e-9) - 1).max() > 0.05  # so that alpha is seen
    # V I = P at every time
    both = run["heater_voltage"] * run["heater_current"]
    assert both.values == pytest.approx(run["heater_power"].values, rel=1e-12, abs=0)
    assert run.attrs["heater_change"] <= 1e-8


def test_a_constant_resistance_turns_volts_and_amperes_into_watts():
    """tcr = 0: the run with V^2/R is the same run, bit for bit; a sine of the voltage heats as its square."""
    model = pair(PLAIN, read=("core",))
    light = {"power": 1e-3, "detuning": -20e9, "duration": 1e-6}
    run = coupled.simulate(RING, model, heaters={"heater": coupled.Volts(1.2)}, **light)
    same = coupled.simulate(RING, model, heaters={"heater": 1.2**2 / OHM}, **light)
    assert (run["delta_T"].values == same["delta_T"].values).all()
    assert run["heater_current"].values == pytest.approx(1.2 / OHM, rel=1e-12, abs=0)
    wave = th.Function(lambda t: 1.2 * np.sin(2e7 * t))
    squared = th.Function(lambda t: (1.2 * np.sin(2e7 * t)) ** 2 / OHM)
    times = np.linspace(0, 1e-6, 50)
    run = coupled.simulate(RING, model, heaters={"heater": coupled.Volts(wave)}, times=times, **light)
    same = coupled.simulate(RING, model, heaters={"heater": squared}, times=times, **light)
    # both are fits of cubics to 1e-9, and the runs have rtol 1e-6
    assert run["delta_T"].values == pytest.approx(same["delta_T"].values, rel=1e-6, abs=1e-7)


def at_rest_by_hand(drive, light):
    """Power (W) of the heater: the root of P = p(R_hh P + R_hc light), by bracketing."""
    model = pair()
    gain = np.linalg.inv(-model.A)

    def excess(power):
        resistance = OHM * (1 + ALPHA * (gain[1, 1] * power + gain[1, 0] * light))
        square = drive.wave**2
        return power - (square / resistance if isinstance(drive, coupled.Volts) else square * resistance)

    return brentq(excess, 0, 0.1, xtol=1e-16, rtol=1e-13)


@pytest.mark.parametrize("drive", [coupled.Volts(2.0), coupled.Amperes(12e-3)])
def test_steady_states_under_a_voltage(drive):
    """In the dark the power is the root of one equation; lit, delta_T is that of both equations at once.

    The light's share of the power is linearised: what is left is the square of alpha times .3 K in the heater, 2e-7.
    """
    model = pair()
    gain = np.linalg.inv(-model.A)
    moved = RING.thermal_shift / (2 * np.pi) * gain[0, 1] * at_rest_by_hand(drive, 0.0)
    states = coupled.steady_states(RING, model, power=5e-3, detuning=-moved - 10e9, heaters={"heater": drive})
    assert states.attrs["power_in_heater"] == pytest.approx(at_rest_by_hand(drive, 0.0), rel=1e-10, abs=0)
    watts = states.attrs["voltage_of_heater"] * states.attrs["current_of_heater"]
    assert watts == pytest.approx(states.attrs["power_in_heater"], rel=1e-12, abs=0)
    for absorbed, rise in zip(states["absorbed"].values, states["delta_T"].values, strict=True):
        power = at_rest_by_hand(drive, absorbed)
        assert power != pytest.approx(states.attrs["power_in_heater"], rel=1e-5)  # so that the feedback is seen
        assert rise == pytest.approx(gain[0, 0] * absorbed + gain[0, 1] * power, rel=1e-6)


def test_a_linear_ring_has_the_feedback_of_the_resistance():
    """A of all states of the matrices has the growth rate of steady_states, whose model is a Foster network.

    A hundredth of a kelvin in the heater, by light that differs by 1 %, changes the core as two steady states say.
    """
    drive = coupled.Volts(2.0)
    gain = np.linalg.inv(-pair().A)
    moved = RING.thermal_shift / (2 * np.pi) * gain[0, 1] * at_rest_by_hand(drive, 0.0)
    settings = {"detuning": -moved - 10e9, "heaters": {"heater": drive}}
    linear = coupled.linearize(RING, pair(), power=5e-3, **settings)
    states = coupled.steady_states(RING, pair(), power=5e-3, **settings)
    leading = np.linalg.eigvals(linear.A).real.max()
    # both by the same kernel, in other coordinates
    assert leading == pytest.approx(float(states["growth_rate"][0]), rel=1e-6)
    near = [coupled.steady_states(RING, pair(), power=p, **settings)["delta_T"].values[0] for p in (4.999e-3, 5.001e-3)]
    slope = (near[1] - near[0]) / 2e-6
    static = linear.response([1e-3])["response"].sel(input="power", output="delta_T").values[0]
    # 1e-5: the square of the difference, 2e-4 of the power, and the third derivative
    assert static.real == pytest.approx(slope, rel=1e-5)


def test_a_long_run_ends_on_the_steady_state():
    """Both ways of the feedback, by iteration in time and linearised at rest, on a stable state."""
    drive = {"power": 1e-3, "detuning": -30e9, "heaters": {"heater": coupled.Volts(2.0)}}
    run = coupled.simulate(RING, pair(), duration=10e-6, **drive)
    states = coupled.steady_states(RING, pair(), **drive)
    assert states.sizes["branch"] == 1
    # rtol of 1e-6, and 10 us are thirty time constants
    assert run["delta_T"].values[-1] == pytest.approx(float(states["delta_T"][0]), rel=1e-5)
    curve = coupled.transmission(
        RING, pair(), power=1e-3, detuning=(-31e9, -29e9), heaters={"heater": coupled.Volts(2.0)}
    )
    rises = np.interp(-30e9, curve["detuning"].values, curve["delta_T"].values)
    # between points of the curve, 1e-4 of the rise apart
    assert rises == pytest.approx(float(states["delta_T"][0]), rel=1e-4)


def test_a_run_goes_on_under_a_voltage():
    """The temperature of the heater, and so its resistance, goes on where the first run ended."""
    drive = {"power": 1e-3, "detuning": -20e9, "rtol": 1e-9, "heaters": {"heater": coupled.Volts(2.0)}}
    whole = coupled.simulate(RING, pair(), duration=2e-6, **drive)
    first = coupled.simulate(RING, pair(), duration=0.5e-6, **drive)
    second = coupled.simulate(RING, pair(), duration=1.5e-6, initial=first, **drive)
    assert second["heater_power"].values[0, 0] == pytest.approx(first["heater_power"].values[0, -1], rel=1e-7, abs=0)
    assert second.attrs["final_state"] == pytest.approx(whole.attrs["final_state"], rel=1e-6, abs=0)


def test_rings_of_a_circuit_have_volts_on_their_heaters():
    """Two rings and their heaters, "heater 1" and "heater 2": both have the resistance of the part "heater"."""
    heat = th.assemble(PLAIN.with_(outer_radius=120e-6).opened(), accuracy=1e-2)
    pair_of_rings = surrogate.reduce_array(heat, [(0, 0), (25e-6, 0)], heaters=("heater",), tolerance=1e-2)
    circuit = coupled.bus([RING, RING])
    drive = {"power": {"in": 1e-4}, "detuning": -20e9}
    volts = {"heater 2": coupled.Volts(1.2)}
    watts = {"heater 2": 1.2**2 / OHM}
    run = coupled.simulate(circuit, pair_of_rings, heaters=volts, duration=1e-6, **drive)
    same = coupled.simulate(circuit, pair_of_rings, heaters=watts, duration=1e-6, **drive)
    assert (run["delta_T"].values == same["delta_T"].values).all()
    assert run["heater_voltage"].values == pytest.approx(1.2, rel=1e-12)
    states = coupled.steady_states(circuit, pair_of_rings, heaters=volts, starts=0, **drive)
    again = coupled.steady_states(circuit, pair_of_rings, heaters=watts, starts=0, **drive)
    assert (states["delta_T"].values == again["delta_T"].values).all()


@pytest.mark.parametrize("section", [PLAIN, WARM], ids=["tcr = 0", "tcr > 0"])
def test_the_fem_in_the_loop_under_a_voltage(section):
    """As with a certified reduction; the energy that V I brings, with that of the light, is stored or leaves."""
    heat = th.assemble(section, accuracy=1e-2)
    drive = {"power": 6.31e-3, "duration": 0.6e-6, "heaters": {"heater": coupled.Volts(2.0)}}
    fem = coupled.cosimulate(RING, heat, **drive)
    both = ("core", "heater")
    model = surrogate.reduce(heat.channels(both, both), tolerance=1e-4)
    run = coupled.simulate(RING, model, times=fem["time"].values, **drive)
    # 1e-3 K of the co-simulation; 1e-4 of R_th of the reduction, which a first pulse may magnify by ten
    assert run["delta_T"].values == pytest.approx(fem["delta_T"].values, rel=0, abs=1e-2)
    assert run["heater_power"].values == pytest.approx(fem["heater_power"].values, rel=1e-3)
    assert fem.attrs["heater_change"] < 1e-5
    time = fem["time"].values
    electric = np.trapezoid((fem["heater_voltage"] * fem["heater_current"]).values[0], time)
    light = np.trapezoid(fem["absorbed"].values, time)
    # the trapezoidal rule on the accepted steps; the balance itself closes to 1e-6
    assert electric + light == pytest.approx(fem.attrs["heat_in"], rel=1e-3)
    assert abs(fem.attrs["heat_imbalance"]) < 1e-6


def test_the_fem_in_the_loop_goes_on_under_a_voltage():
    """A run in two halves is that run: the resistance goes on with the temperature that the FEM ended with."""
    heat = th.assemble(WARM, accuracy=1e-2)
    drive = {"power": 1e-3, "detuning": -20e9, "heaters": {"heater": coupled.Volts(2.0)}}
    whole = coupled.cosimulate(RING, heat, duration=0.4e-6, **drive)
    first = coupled.cosimulate(RING, heat, duration=0.2e-6, **drive)
    second = coupled.cosimulate(RING, heat, duration=0.2e-6, initial=first, **drive)
    ends = [run["heater_power"].values[0, -1] for run in (whole, first, second)]
    assert second["heater_power"].values[0, 0] == pytest.approx(ends[1], rel=1e-5)
    assert ends[2] == pytest.approx(ends[0], rel=1e-5)
    assert ends[0] != pytest.approx(ends[1], rel=1e-3)  # so that a cold start is seen
    # 1e-3 K of each co-simulation
    assert second["delta_T"].values[-1] == pytest.approx(whole["delta_T"].values[-1], abs=3e-3)


def test_the_end_of_a_run_is_read_in_its_unit_and_on_its_mesh():
    """mK are no K, which would raise the resistance thirtyfold; a field on another mesh is refused in words."""
    heat = th.assemble(WARM, accuracy=5e-2)
    drive = {"power": 1e-3, "detuning": -20e9, "duration": 20e-9, "heaters": {"heater": coupled.Volts(2.0)}}
    first = coupled.cosimulate(RING, heat, **drive)
    field = first["final_rise"]
    milli = first.assign(final_rise=(field.dims, 1e3 * field.values, {"units": "mK"}))
    one, other = (coupled.cosimulate(RING, heat, initial=run, **drive) for run in (first, milli))
    # the same numbers, but for the rounding of the factor 1e3
    assert other["heater_power"].values == pytest.approx(one["heater_power"].values, rel=1e-9)
    smaller = first.drop_vars("final_rise").assign(final_rise=("dof", field.values[:-1], field.attrs))
    with pytest.raises(th.InputError, match="on another mesh"):
        coupled.cosimulate(RING, heat, initial=smaller, **drive)


BAD = {
    "no resistance": (pair(th.heated_ring()), {"heater": coupled.Volts(1.0)}, ("'heater' has no resistance",)),
    "no geometry": (
        th.StateSpace(np.eye(2), -np.eye(2), np.eye(2), np.eye(2), ("core", "heater"), ("core", "heater")),
        {"heater": coupled.Volts(1.0)},
        ("records no geometry",),
    ),
    "not heated": (pair(), {"box": coupled.Volts(1.0)}, ("box", "unknown")),
    "not read": (pair(read=("core",)), {"heater": coupled.Volts(1.0)}, ("does not read 'heater'", "tcr = 0")),
    "R below zero": (
        pair(PLAIN.with_({"part.heater.tcr": -20e-3})),
        {"heater": coupled.Volts(4.0)},
        ("resistance of 'heater'", "tcr"),
    ),
    "too much": (pair(), {"heater": coupled.Volts(5e3)}, ("heaters['heater']", "5000")),
    "no number": (pair(), {"heater": coupled.Volts("1.2 V")}, ("heaters['heater']",)),
}


@pytest.mark.parametrize("fault", BAD)
@pytest.mark.parametrize("function", [coupled.simulate, coupled.steady_states])
def test_bad_drives_are_named_in_one_line(fault, function):
    model, heaters, words = BAD[fault]
    settings = {"duration": 2e-6} if function is coupled.simulate else {}
    with pytest.raises(th.InputError) as error:
        function(RING, model, power=1e-3, heaters=heaters, **settings)
    message = str(error.value)
    assert all(word in message for word in words), message
    assert "\n" not in message


def test_an_array_that_does_not_read_its_heaters_is_named():
    heat = th.assemble(WARM.with_(outer_radius=120e-6).opened(), accuracy=1e-2)
    array = surrogate.reduce_array(heat, [(0, 0), (25e-6, 0)], heaters=("heater",), tolerance=1e-2)
    drive = {"power": {"in": 1e-4}, "heaters": {"heater 1": coupled.Volts(1.0)}}
    for function in (coupled.simulate, coupled.steady_states):
        with pytest.raises(th.InputError, match=r"does not read 'heater 1'.*reduce_layout"):
            function(coupled.bus([RING, RING]), array, **drive)


def test_the_noise_of_a_heater_under_feedback_is_not_computed():
    """Under a tcr the states hold the feedback of the heater, and their rates are no dissipation."""
    for section, known in ((PLAIN, True), (WARM, False)):
        drive = {"heater": coupled.Volts(0.5)}
        linear = coupled.linearize(RING, pair(section), power=1e-4, heaters=drive, heated="core", read="core")
        assert (linear.thermal_forces is not None) == known
    with pytest.raises(th.InputError, match="moves the resistance of a heater"):
        th.thermal_noise(linear, [1e5])
