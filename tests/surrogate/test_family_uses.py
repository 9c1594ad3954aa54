"""Design, uncertainty and calibration on one family of three parameters."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from test_family import BOX, RADIUS, WIDTH, campaign

import surrogate
import thermofem as th


@pytest.fixture(scope="module")
def family() -> surrogate.Family:
    return surrogate.train_family(campaign(RADIUS, WIDTH, BOX), tolerance=2e-3, held_out=4)


def test_a_wanted_resistance_is_found_and_certified(family):
    found = surrogate.design(family, {"radius": (5e-6, 9e-6)}, target={"thermal_resistance": 9e3})
    assert found.reached
    assert found.achieved["thermal_resistance"] == pytest.approx(9e3, rel=1e-3)
    assert set(found.sensitivity["thermal_resistance"]) == {"radius"}
    d = family.derivatives(**found.values).thermal_resistance.sel(parameter="radius").item()
    # a central difference over 2e-3 of the range errs by 1e-6
    assert found.sensitivity["thermal_resistance"]["radius"] == pytest.approx(d, rel=1e-4)
    assert found.certified.thermal_resistance == pytest.approx(9e3, rel=3e-3)
    assert found.active == ()


def test_a_target_out_of_reach_gives_the_nearest_member(family):
    found = surrogate.design(family, target={"thermal_resistance": 1e6})
    assert not found.reached
    assert "no member of this family does that" in found.message
    # the hottest ring is the smallest one on the thickest oxide
    assert {"radius", "box"} <= set(found.active)
    assert found.values["radius"] == pytest.approx(5e-6, rel=1e-3)


def test_a_property_of_ones_own_and_two_targets(family):
    def slow_share(model: th.Foster) -> float:
        return float(np.asarray(model.R)[np.asarray(model.tau) > 1e-6].sum() / model.thermal_resistance)

    wanted = family.model(radius=6.1e-6, width=450e-9, box=2.3e-6)
    target = {slow_share: slow_share(wanted), "thermal_resistance": wanted.thermal_resistance, "rise_time": 0.0}
    with pytest.raises(th.InputError, match="target of 0"):
        surrogate.design(family, target=target)
    with pytest.raises(th.InputError, match="unknown"):
        surrogate.design(family, target={"resistance": 1.0})
    found = surrogate.design(
        family, target={slow_share: slow_share(wanted), "thermal_resistance": wanted.thermal_resistance}
    )
    assert found.reached


def test_sobol_indices_agree_with_brute_force(family):
    spread = {"width": stats.uniform(440e-9, 20e-9), "box": stats.uniform(1.95e-6, 1e-7)}
    data = surrogate.uncertainty(family, spread, samples=512, fixed={"radius": 7e-6})
    draws = {name: one.rvs(20000, random_state=k) for k, (name, one) in enumerate(spread.items())}
    R = family.thermal_resistance(radius=7e-6, **draws)
    assert data.attrs["mean"] == pytest.approx(R.mean(), rel=2e-4)
    assert data.attrs["standard_deviation"] == pytest.approx(R.std(), rel=0.05)  # 1/sqrt(2 1024) of it
    for name in spread:  # correlation squared is the index of a function that is almost linear over the spread
        index = np.corrcoef(draws[name], R)[0, 1] ** 2
        assert data.first_order.sel(parameter=name).item() == pytest.approx(index, abs=0.05)
        assert data.total_order_low.sel(parameter=name) <= data.total_order.sel(parameter=name)


def test_uncertainty_says_what_leaves_the_box(family):
    with pytest.raises(th.InputError, match="lie outside the family's"):
        surrogate.uncertainty(family, {"width": stats.norm(500e-9, 100e-9)}, samples=64)
    with pytest.raises(th.InputError, match="power of two"):
        surrogate.uncertainty(family, {"width": stats.norm(500e-9, 5e-9)}, samples=100)
    with pytest.raises(th.InputError, match="a distribution of scipy"):
        surrogate.uncertainty(family, {"width": 500e-9}, samples=64)


def synthetic(family: surrogate.Family, truth: dict[str, float], noise: float, seed: int):
    times = np.append(0.0, np.geomspace(2e-9, 50e-6, 150))
    rise = 1e-3 * family.model(**truth).step_response(times)
    rise = rise + noise * np.random.default_rng(seed).standard_normal(times.size)
    return th.dataset.build(times, rise, th.Constant(1e-3))


@pytest.mark.slow
def test_calibration_recovers_the_truth_with_honest_errors(family):
    truth = {"radius": 6.2e-6, "width": 470e-9, "box": 2.2e-6}
    pulls, chi = [], []
    for seed in range(12):
        found = surrogate.calibrate(family, synthetic(family, truth, 0.01, seed), noise=0.01)
        pulls += [(found.values[name] - truth[name]) / found.standard_errors[name] for name in truth]
        chi.append(found.reduced_chi_square)
    # 36 pulls of unit variance, 12 independent triples: their mean square within 1 +- 3 sqrt(2/36)
    assert 0.3 < np.mean(np.square(pulls)) < 1.7
    assert abs(np.mean(chi) - 1) < 4 * np.sqrt(2 / 148 / 12)


def test_what_the_data_cannot_tell_apart_is_named(family):
    truth = {"radius": 6.2e-6, "width": 470e-9, "box": 2.2e-6}
    found = surrogate.calibrate(family, synthetic(family, truth, 2.0, 0), noise=2.0)
    assert found.unseen
    assert "shares of the ranges" in found.unseen[-1]


def test_calibration_needs_data(family):
    with pytest.raises(th.InputError, match="data is empty"):
        surrogate.calibrate(family, [])
