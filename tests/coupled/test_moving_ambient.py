"""A chip whose ambient moves under a ring: through the thermal model, or at once where that has no such input."""

from __future__ import annotations

import numpy as np
import pytest
from correctors import RING

import coupled
import surrogate
import thermofem as th

DARK = {"power": 1e-9, "detuning": 0.0, "duration": 40e-6, "rtol": 1e-9}  # 1 nW heats by 1e-5 K at most
TIMES = np.linspace(0, 40e-6, 9)


def two_rooms() -> th.StateSpace:
    """Core and oxide: the core exchanges heat with the oxide, the oxide with the ambient, 4e-4 W/K each."""
    E = np.diag([8e-12, 4e-9])  # J/K
    K = np.array([[4e-4, -4e-4], [-4e-4, 8e-4]])  # W/K
    B = np.array([[1.0, 0], [0, 4e-4]])
    return th.StateSpace(E, -K, B, B.T[:1], inputs=("core", "ambient"), outputs=("core",))


def by_hand(model, kelvin, times):
    """Response of the two rooms to a step of the ambient, by the eigenvectors of E^-1 A."""
    rate, modes = np.linalg.eig(np.linalg.solve(model.E, model.A))
    source = np.linalg.solve(modes, np.linalg.solve(model.E, model.B[:, 1] * kelvin))
    states = source * np.expm1(np.multiply.outer(times, rate)) / rate
    return (model.C @ modes @ states.T)[0]


def test_a_step_of_the_ambient_reaches_the_ring_through_the_chip():
    """2e-5 K: of the light, 1 nW times 5e3 K/W, and 1e-8 of the integration."""
    model = two_rooms()
    run = coupled.simulate(RING, model, ambient=3.0, times=TIMES, **DARK)
    expected = by_hand(model, 3.0, TIMES)
    assert 1.5 < expected[-1] < 2.95  # on its way
    assert run["delta_T"].values == pytest.approx(expected, rel=0, abs=2e-5)
    assert run["ambient"].values == pytest.approx(3.0)
    assert run["ambient"].attrs["units"] == "K"
    assert "ambient" not in run.attrs


def test_a_model_without_that_input_has_the_ring_follow_at_once():
    wave = coupled.Sweep([0, 20e-6, 40e-6], [0.0, -2.0, 1.0])
    run = coupled.simulate(RING, two_rooms().channel("core"), ambient=wave, times=TIMES, **DARK)
    # 1e-5 K by the light
    assert run["delta_T"].values == pytest.approx(wave(TIMES), rel=0, abs=2e-5)
    assert "at once" in run.attrs["ambient"]


def test_the_resonance_follows_the_ambient():
    """A settled ambient of 1 K is a detuning of thermal_shift/(2 pi): steady_states of the moved laser says where."""
    model = two_rooms()
    long = {"power": 0.5e-3, "rtol": 1e-8, "duration": 400e-6}
    warm = coupled.simulate(RING, model, ambient=1.0, detuning=-5e9, **long)
    moved = -5e9 + RING.thermal_shift / (2 * np.pi)
    rest = coupled.steady_states(RING, model.channel("core"), power=0.5e-3, detuning=moved)
    # 400 us are ten time constants of the oxide, of 20 us, at 1e-4 of a kelvin
    assert warm["delta_T"].values[-1] - 1.0 == pytest.approx(rest["delta_T"].values[0], rel=1e-4)


def test_a_run_goes_on_under_the_ambient():
    model = two_rooms()
    drive = {"power": 3e-3, "detuning": -10e9, "rtol": 1e-9, "ambient": 2.0}
    whole = coupled.simulate(RING, model, duration=6e-6, **drive)
    first = coupled.simulate(RING, model, duration=2e-6, **drive)
    second = coupled.simulate(RING, model, duration=4e-6, initial=first, **drive)
    assert second.attrs["final_state"] == pytest.approx(whole.attrs["final_state"], rel=1e-6, abs=0)


@pytest.mark.parametrize("port", [True, False])
def test_rings_of_a_circuit_feel_the_ambient(port):
    """Two rings in the dark: each follows as the single one does, a ramp and a number that has long been there."""
    model = two_rooms() if port else two_rooms().channel("core")
    ramp = coupled.Sweep([0, 40e-6], [0.0, 4.0])
    drive = {"duration": 40e-6, "rtol": 1e-9, "times": TIMES, "ambient": ramp}
    one = coupled.simulate(RING, model, power=1e-9, **drive)
    two = coupled.simulate(coupled.bus([RING, RING]), model, power={"in": 1e-9}, **drive)
    for ring in ("ring 1", "ring 2"):
        assert two["delta_T"].sel(ring=ring).values == pytest.approx(one["delta_T"].values, rel=0, abs=3e-5)
    assert two["ambient"].values == pytest.approx(ramp(TIMES))
    assert ("ambient" in two.attrs) is not port


def test_heater_and_ambient_of_a_reduction_add():
    """The FEM in the dark, each input alone and both: linear to the 1e-5 K of the light."""
    heat = th.assemble(th.heated_ring(), accuracy=1e-2)
    model = surrogate.reduce(heat.channels(("core", "heater", "ambient"), "core"), tolerance=1e-3)
    rises = [
        coupled.simulate(RING, model, times=TIMES, **drives, **DARK)["delta_T"].values
        for drives in ({"heaters": {"heater": 5e-3}}, {"ambient": 2.0}, {"heaters": {"heater": 5e-3}, "ambient": 2.0})
    ]
    assert rises[2] == pytest.approx(rises[0] + rises[1], rel=0, abs=3e-5)
    step = heat.channels("ambient", "core").step_response(TIMES)
    # 1e-3 of the reduction, of 2 K
    assert rises[1] == pytest.approx(2.0 * step, rel=0, abs=2e-3)
    assert 0.1 < rises[1][-1] < 2.0


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"ambient": 293.15}, ("ambient = 293.15", "above the ambient")),
        ({"heaters": {"ambient": 1.0}}, ("heaters", "ambient=")),
        ({"ambient": "warm"}, ("ambient",)),
    ],
)
def test_a_bad_ambient_is_named(settings, words):
    with pytest.raises(th.InputError) as error:
        coupled.simulate(RING, two_rooms(), **settings, **DARK)
    message = str(error.value)
    assert all(word in message for word in words), message
    assert "\n" not in message


def test_exports_keep_the_ambient_node(tmp_path):
    """The pins of the deck are those of the model without the input, whose node "ambient" it has anyway."""
    model = two_rooms()
    both = surrogate.export_model(model, tmp_path / "heat.cir").read_text()
    alone = surrogate.export_model(model.channel("core"), tmp_path / "heat.cir").read_text()
    pins = [line for line in both.splitlines() if line.startswith(".subckt")]
    assert pins == [line for line in alone.splitlines() if line.startswith(".subckt")]
    assert pins[0] == ".subckt heat core ambient"
