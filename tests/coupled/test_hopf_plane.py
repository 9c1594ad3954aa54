"""The plane about the lowest Hopf point, and the periods of a ring in it: Fig. 7 for any Q."""

from dataclasses import replace

import numpy as np
import pytest

import coupled
import surrogate
from coupled.maps.hopf_plane import Window, hopf_plane, lowest_hopf
from coupled.maps.period_points import period_points

RING = coupled.borghi2021()
MODEL = surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1200e-9, eta=0.31, heat_capacity=7.63e-12)
HIGH_Q = 20_000  # the second ring of the paper's Fig. 7
HIGH = replace(RING, bus_rate=(RING.omega / (2 * HIGH_Q) - RING.loss_rate) / 2)


@pytest.mark.parametrize("ring", [RING, HIGH], ids=["low Q", "high Q"])
def test_no_laser_below_the_lowest_hopf_point_makes_a_fixed_point_oscillate(ring):
    """The eigenvalues of the fixed points know nothing of the curve."""
    lowest = lowest_hopf(ring, MODEL)
    window = hopf_plane(ring, MODEL)
    detunings = np.sort(np.append(np.linspace(*window.detunings, 200), lowest.detuning))
    # 1e-3: the growth of a pair changes sign on the curve, linearly in the power
    below, above = coupled.stability_map(ring, MODEL, lowest.power * np.array([0.999, 1.001]), detunings).regime.values
    assert "self-pulsing" not in below
    assert above[detunings == lowest.detuning] == "self-pulsing"
    assert window.powers == (lowest.power, 5 * lowest.power)
    assert window.detunings[0] < lowest.detuning < window.detunings[1]


def test_a_ring_with_newtons_law_of_65_ns_has_no_curve_and_no_points():
    quiet = surrogate.newton(tau_th=65e-9, heat_capacity=7.63e-12)
    assert lowest_hopf(RING, quiet) is None
    assert hopf_plane(RING, quiet) is None
    with pytest.raises(ValueError, match="has no Hopf curve"):
        period_points(RING, quiet, MODEL)


def test_points_are_the_periods_of_limit_cycles():
    slower = surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1300e-9, eta=0.31, heat_capacity=7.63e-12)
    plane = Window((4e-3, 6e-3), (-10e9, 10e9))
    points = period_points(RING, MODEL, slower, plane)
    assert points.sizes["point"] > 0
    assert points.attrs["loaded_q"] == RING.loaded_q
    assert ((points["duty"] >= 0.2) & (points["duty"] <= 0.3)).all()
    for k in (0, points.sizes["point"] - 1):
        point = points.isel(point=k)
        light = {"power": float(point["power"]), "detuning": float(point["detuning"])}
        period = coupled.limit_cycle(RING, MODEL, **light).attrs["period"]
        other = coupled.limit_cycle(RING, slower, **light).attrs["period"]
        # 1e-5: the map closes its cycles to 1e-6 of their states
        assert float(point["period"]) == pytest.approx(period, rel=1e-5)
        assert float(point["error"]) == pytest.approx(period - other, abs=1e-5 * period)
        assert float(point["relative_error"]) == pytest.approx(1 - other / period, abs=1e-5)
