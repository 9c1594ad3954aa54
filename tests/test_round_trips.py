"""Every Dataset that a public function returns is saved, read again, and is the same."""

import numpy as np
import pytest

import coupled
import surrogate
import thermofem as th

RING = coupled.borghi2021()
MODEL = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
P, POWERS, DETUNINGS = 6.31e-3, np.array([3e-3, 6e-3, 9e-3]), np.linspace(-1e10, 2e10, 3)
PULSE, SQUARE, DRIVE = th.Pulse(2e-3, 1e-6), th.SquareWave(2e-3, 1e-6, 0.3), {"power": P}


@pytest.fixture(scope="module")
def heat():
    return th.assemble(th.strip_ring())


def pole_derivatives(heat):
    return surrogate.reduction.reduce.pole_derivatives(heat, surrogate.reduce(heat.system), "part.core.radius")


def chirped(heat):
    sweep = coupled.Sweep([0, 1e-6], [9e9, -9e9])
    return coupled.simulate(RING, MODEL, power=P, detuning=sweep, duration=1e-6)


def circuit(heat):
    rings = coupled.bus([RING, RING])
    return coupled.simulate(rings, MODEL, power={"in": P}, duration=2e-7)


RESULTS = {
    "solve": lambda heat: th.solve(heat, PULSE, [1e-7, 1e-6], read=["core", "box"], field_times=[1e-6]),
    "solve_periodic": lambda heat: th.solve_periodic(heat, SQUARE),
    "derivatives": lambda heat: th.derivatives(heat, ["part.core.radius"], times=[1e-7, 1e-6], frequencies=[1e3, 1e6]),
    "pole_derivatives": pole_derivatives,
    "period_error": lambda heat: surrogate.period_error(MODEL, heat.system, [1e-7, 1e-6]),
    "judge": lambda heat: surrogate.judge({"one": MODEL}, surrogate.reduce(heat.system)),
    "compare": lambda heat: surrogate.compare({"one": MODEL}, surrogate.reduce(heat.system)),
    "structure_function": lambda heat: th.models.cauer.structure_function(MODEL),
    "simulate": lambda heat: coupled.simulate(RING, MODEL, **DRIVE, duration=3e-6),
    "sweep of a laser": chirped,
    "cosimulate": lambda heat: coupled.cosimulate(RING, heat, **DRIVE, duration=1e-7),
    "limit_cycle": lambda heat: coupled.limit_cycle(RING, MODEL, **DRIVE),
    "cycle_derivatives": lambda heat: coupled.cycles.derivatives.cycle_derivatives(RING, MODEL, **DRIVE),
    "continue_cycle, power": lambda heat: coupled.continue_cycle(RING, MODEL, "power", (6.3e-3, 6.4e-3), **DRIVE),
    "continue_cycle, detuning": lambda heat: coupled.continue_cycle(RING, MODEL, "detuning", (0, 1e8), **DRIVE),
    "continue_cycle, tau1": lambda heat: coupled.continue_cycle(RING, MODEL, "tau1", (55.8e-9, 56e-9), **DRIVE),
    "steady_states": lambda heat: coupled.steady_states(RING, MODEL, **DRIVE, detuning=0.0),
    "transmission": lambda heat: coupled.transmission(RING, MODEL, **DRIVE, detuning=(-3e10, 3e10)),
    "sweep": lambda heat: coupled.equilibria.transmission.sweep(RING, MODEL, **DRIVE, detuning=DETUNINGS),
    "pulsing_map": lambda heat: coupled.pulsing_map(RING, MODEL, POWERS, DETUNINGS),
    "stability_map": lambda heat: coupled.stability_map(RING, MODEL, POWERS, DETUNINGS),
    "fold_curves": lambda heat: coupled.fold_curves(RING, MODEL, POWERS, np.linspace(-5e10, 2e10, 20))[0],
    "hopf_curves": lambda heat: coupled.hopf_curves(RING, MODEL, POWERS, np.linspace(-5e10, 2e10, 20))[0],
    "carrier_decay": lambda heat: coupled.carriers.carrier_decay(RING.carriers, 1e23, np.linspace(0, 1e-7, 9)),
    "simulate a circuit": circuit,
    "spectrum": lambda heat: coupled.transmission(coupled.bus([RING, RING]), detuning=DETUNINGS),
    "circuit_steady_states": lambda heat: coupled.steady_states(
        coupled.bus([RING, RING]), MODEL, power={"in": 1e-4}, starts=3
    ),
}


def same(one, other):
    if one.dtype.kind in "OSU":
        return one.tolist() == other.tolist()
    return np.array_equal(one.astype(complex), other.astype(complex), equal_nan=True)


@pytest.mark.parametrize("name", RESULTS)
def test_a_result_is_read_as_it_was_saved(name, heat, tmp_path):
    """Units of a branch of cycles over power, and of derivatives of the period, are read."""
    data = RESULTS[name](heat)
    th.save(data, tmp_path / "result.nc")
    again = th.load(tmp_path / "result.nc")
    assert {*again.variables} == {*data.variables}
    assert [key for key in data.variables if not same(data[key].values, again[key].values)] == []


def test_power_says_which_power_it_is():
    """Absorbed in thermal data; in the bus waveguide in results of `coupled`; there the absorbed one is `absorbed`."""
    model, ring = surrogate.newton(tau_th=60e-9, heat_capacity=7e-12), coupled.borghi2021()
    times, step = np.linspace(0, 1e-6, 41), th.Constant(1e-3)
    absorbed = [
        th.dataset.build(times, model.response(step, times), step),
        surrogate.judge({"Newton": model}, model, periods=[1e-6], powers=[1e-3]),
    ]
    assert {data["power"].long_name for data in absorbed} == {"absorbed power"}
    plane = [3e-3, 6e-3], [-10e9, 0.0]
    in_bus = [
        coupled.stability_map(ring, model, *plane),
        coupled.transmission(ring, model, power=6e-3, detuning=(-10e9, 10e9)),
        *coupled.fold_curves(ring, model, [1e-3, 20e-3], [-80e9, 0.0]),
    ]
    assert len(in_bus) > 2
    assert {data["power"].long_name for data in in_bus} == {"power in the bus waveguide"}
