"""The plane about the lowest Hopf point, and the periods of a ring in it: Fig. 7 for any Q."""

import json
from dataclasses import replace

import numpy as np
import pytest
from commands import thermofem

import coupled
import surrogate
import thermofem as th
from coupled.maps.hopf_plane import Window, hopf_plane, period_points, threshold_plane
from coupled.ring_toml import write_text

RING = coupled.borghi2021()
MODEL = surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1200e-9, eta=0.31, heat_capacity=7.63e-12)
HIGH_Q = 20_000  # the second ring of the paper's Fig. 7
HIGH = replace(RING, bus_rate=(RING.omega / (2 * HIGH_Q) - RING.loss_rate) / 2)


@pytest.mark.parametrize("ring", [RING, HIGH], ids=["low Q", "high Q"])
def test_no_laser_below_the_lowest_hopf_point_makes_a_fixed_point_oscillate(ring):
    """The eigenvalues of the fixed points know nothing of the curve."""
    lowest = threshold_plane(ring, MODEL).lowest
    window = hopf_plane(ring, MODEL)
    detunings = np.sort(np.append(np.linspace(*window.detunings, 200), lowest.detuning))
    # 1e-3: the growth of a pair changes sign on the curve, linearly in the power
    below, above = coupled.stability_map(ring, MODEL, lowest.power * np.array([0.999, 1.001]), detunings).regime.values
    assert "self-pulsing" not in below
    assert above[detunings == lowest.detuning] == "self-pulsing"
    assert window.powers == (lowest.power, 5 * lowest.power)
    assert window.detunings[0] < lowest.detuning < window.detunings[1]


def _power(point):
    return float(point["power"])


@pytest.mark.parametrize("quality", [2e4, 2e6])
def test_the_default_plane_of_stability_has_the_threshold_inside(quality, tmp_path):
    """They are at -6.8 and -34.6 dBm; the paper's plane, 3 to 10 dBm and -30 to 30 GHz, holds neither."""
    share = RING.omega / (2 * quality) / RING.linear_rate
    ring = replace(RING, bus_rate=share * RING.bus_rate, loss_rate=share * RING.loss_rate)
    wide = coupled.hopf_curves(ring, MODEL, [1e-8, 1.0], [-20e9, 20e9])
    leading = [curve.isel(point=curve["leading"].values) for curve in wide]
    lowest = min(
        (curve.isel(point=int(np.argmin(curve["power"].values))) for curve in leading if curve.sizes["point"]),
        key=_power,
    )
    (tmp_path / "ring.toml").write_text(write_text(ring, {}))
    surrogate.save_model(MODEL, tmp_path / "model.json")
    options = "--ring", "ring.toml", "--points", "60, 100", "--json", "-o", "plane.nc"
    done = thermofem("stability", "model.json", *options, cwd=tmp_path)
    found = th.load(tmp_path / "plane.nc")
    first = json.loads(done.stdout)["thresholds"]["self-pulsing"]
    assert float(found["power"][0]) == pytest.approx(_power(lowest) / 2, rel=0.01, abs=0)  # three digits are printed
    assert _power(lowest) < float(found["power"][-1])
    assert float(found["detuning"][0]) < float(lowest["detuning"]) < float(found["detuning"][-1])
    if quality == 2e4:
        step = float(found["power"][1] / found["power"][0])
        # the first row above the curve or the next: detunings are 1 % of the plane apart, and the curve is flat
        assert 1 < first / _power(lowest) < step**2
    else:  # another fixed point is stable beside the one that the curve makes unstable: nothing pulses alone
        assert first is None
        assert "bistable" in found["regime"].values
    assert "the Hopf curve begins at" in done.stderr


def test_a_ring_with_newtons_law_of_65_ns_has_no_curve_and_no_points():
    quiet = surrogate.newton(tau_th=65e-9, heat_capacity=7.63e-12)
    assert threshold_plane(RING, quiet) is None
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
        assert float(point["period"]) == pytest.approx(period, rel=1e-5, abs=0)
        assert float(point["error"]) == pytest.approx(period - other, abs=1e-5 * period)
        assert float(point["relative_error"]) == pytest.approx(1 - other / period, abs=1e-5)
