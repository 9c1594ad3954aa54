"""Every function that takes light and a thermal model tells where the rise is beyond the training or the output map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rings import BENT, RING, SECOND_ORDER

import coupled
import surrogate
import thermofem as th
from coupled.cycles.cycle_folds import cycle_fold_curves
from coupled.cycles.derivatives import cycle_derivatives
from coupled.equilibria.transmission import power_for_drop, sweep

BUS = coupled.bus(RING)
ASKED = {
    "simulate": lambda m: coupled.simulate(RING, m, power=6.31e-3, duration=2e-6),
    "simulate, two lasers": lambda m: coupled.simulate(
        RING, m, power=6.31e-3, duration=2e-6, lasers=coupled.Laser(1e-6, -2e9)
    ),
    "limit_cycle": lambda m: coupled.limit_cycle(RING, m, power=6.31e-3),
    "steady_states": lambda m: coupled.steady_states(RING, m, power=6.31e-3),
    "pulsing_map": lambda m: coupled.pulsing_map(RING, m, [6.3e-3, 6.4e-3], [0.0, 1e9]),
    "simulate, few times": lambda m: coupled.simulate(
        RING, m, power=th.Pulse(6.31e-3, 2e-6, 2e-6), duration=20e-6, times=[0.0, 1e-6, 20e-6]
    ),
    "simulate a circuit, few times": lambda m: coupled.simulate(
        BUS, m, power={"in": th.Pulse(6.31e-3, 2e-6, 2e-6)}, duration=20e-6, times=[0.0, 1e-6, 20e-6]
    ),
    "transmission": lambda m: coupled.transmission(RING, m, power=6.31e-3, detuning=(-90e9, 10e9)),
    "sweep": lambda m: sweep(RING, m, power=6.31e-3, detuning=np.linspace(10e9, -90e9, 41)),
    "power_for_drop": lambda m: power_for_drop(RING, m, drop=2e-3, detuning=-60e9),
    "cycle_derivatives": lambda m: cycle_derivatives(RING, m, ["bus_rate"], power=6.31e-3),
    "continue_cycle": lambda m: coupled.continue_cycle(RING, m, "power", (6.31e-3, 6.4e-3), power=6.31e-3),
    "hopf_curves": lambda m: coupled.hopf_curves(RING, m, [1e-3, 6.4e-3], [-60e9, 20e9]),
    "fold_curves": lambda m: coupled.fold_curves(RING, m, [1e-3, 6.4e-3], [-60e9, 20e9]),
    "stability_map": lambda m: coupled.stability_map(RING, m, [6.3e-3, 6.4e-3], [0.0, 1e9]),
    "stability_map, at rest": lambda m: coupled.stability_map(RING, m, [6.3e-3, 6.4e-3], [-90e9, -89e9]),
    "pulsing_map, at rest": lambda m: coupled.pulsing_map(RING, m, [6.3e-3, 6.4e-3], [-90e9, -89e9]),
    "simulate a circuit": lambda m: coupled.simulate(BUS, m, power={"in": 6.31e-3}, duration=2e-6),
    "circuit_steady_states": lambda m: coupled.steady_states(BUS, m, power={"in": 6.31e-3}),
}
POLES = th.OutputMap(SECOND_ORDER, -1e-3, largest_rise=3.0)
NETWORK = th.models.Network(
    np.diag(-1 / SECOND_ORDER.tau), SECOND_ORDER.gain, ("core", "shell"), SECOND_ORDER, largest_rise=3.0
)
TRAINED = {"output map": POLES, "quadratic": replace(BENT, largest_rise=3.0), "network": NETWORK}


@pytest.mark.parametrize(
    ("name", "kind"),
    [(name, kind) for name in ASKED for kind in TRAINED if not ("circuit" in name and kind == "quadratic")],
)  # circuits take linear models and output maps
def test_a_rise_far_above_the_training_warns(name, kind):
    """The models warn alone and with light."""
    with pytest.warns(th.models.OutsideTrainingWarning, match="its training reached 3 K"):
        ASKED[name](TRAINED[kind])
    ASKED[name](replace(TRAINED[kind], largest_rise=30.0))


@pytest.mark.parametrize("name", [name for name in ASKED if "_map" not in name and "_curves" not in name])
def test_a_rise_at_the_top_of_an_output_map_is_refused(name):
    """More heat then meant less temperature: the rise of a run turned at the top, 2.5 K, without a word."""
    with pytest.raises(th.InputError, match=r"top of (the|an) output map"):
        ASKED[name](th.OutputMap(SECOND_ORDER, -0.1))


def test_folds_of_cycles_above_the_training_warn():
    """The cycles of this curve reach 14 to 20 K."""
    newton = surrogate.newton(tau_th=275e-9)
    trained = th.models.Network(np.diag(-1 / newton.tau), newton.gain, ("core",), newton, largest_rise=3.0)
    window = [4.9e-3, 5.1e-3], [-10e9, 10e9]
    with pytest.warns(th.models.OutsideTrainingWarning, match="its training reached 3 K") as told:
        (curve,) = cycle_fold_curves(RING.with_lumped_fcd(), trained, *window)
    assert f"asked for a rise of {curve.highest_rise.values.max():.3g} K" in str(told[0].message)
    assert np.all(curve.highest_rise > curve.swing)


@pytest.mark.parametrize("options", [{}, {"duration": 2e-6}])
def test_cells_of_a_map_at_the_top_of_an_output_map_say_so(options):
    found = coupled.pulsing_map(RING, th.OutputMap(SECOND_ORDER, -0.1), [6.3e-3, 6.4e-3], [0.0, 1e9], **options)
    assert set(found.regime.values.ravel()) <= {"failed", "slow transient"}
    assert "top of an output map" in str(found.reason.values[0, 0])


def test_the_hottest_cycle_of_a_map_need_not_swing_most():
    """13.3 K is the largest swing here, and 15.7 K the highest rise, which a training has to reach."""
    model = th.OutputMap(th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6]), 1e-4, largest_rise=11.3)
    with pytest.warns(th.models.OutsideTrainingWarning, match="its training reached 11.3 K"):
        coupled.pulsing_map(RING, model, [8e-3, 8.01e-3], np.linspace(-60e9, 20e9, 17)[5:])
