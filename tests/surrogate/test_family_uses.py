"""Design, uncertainty and calibration on one family of three parameters."""

from __future__ import annotations

import os
import signal

import numpy as np
import pytest
from scipy import stats
from surrogate_systems import autoregressive
from test_family import rings

import coupled
import surrogate
import thermofem as th
from coupled.unknowns import ThermalFamily, unknowns
from surrogate.studies.inverse_search import Property
from thermofem.campaign.stored_tasks import processes


@pytest.fixture(scope="module")
def family() -> surrogate.family.Family:
    return rings()


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


def test_of_many_solutions_the_nearest_is_taken(family):
    """One target over three parameters: at the nearest solution the way from the nominal member is along the slope."""
    nominal = family.box.nominal
    R = 1.05 * family.model(**nominal).thermal_resistance
    found = [surrogate.design(family, target={"thermal_resistance": R}, seed=seed) for seed in (0, 1)]
    span = {name: high - low for name, (low, high) in family.ranges.items()}
    way = np.array([(found[0].values[name] - nominal[name]) / span[name] for name in span])
    slope = np.array([found[0].sensitivity["thermal_resistance"][name] * span[name] for name in span])
    # the target is missed by at most 2e-4, and the search ends where its distance changes by 1e-8
    assert way @ slope / np.linalg.norm(way) / np.linalg.norm(slope) == pytest.approx(1, abs=1e-3)
    assert found[1].values == pytest.approx(found[0].values, rel=1e-3)  # whatever is drawn at random
    assert "1 wanted and 3 free: one solution of many, the nearest to radius" in found[0].message


def test_a_target_out_of_reach_gives_the_nearest_member(family):
    found = surrogate.design(family, target={"thermal_resistance": 1e6})
    assert not found.reached
    assert "no member that was looked at does that" in found.message
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
    with pytest.raises(th.InputError, match="must be positive"):
        surrogate.design(family, target={"thermal_resistance": -9e3})
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
    with pytest.raises(th.InputError, match=r"lie outside the family's \d+ nm to \d+ nm; train one"):
        surrogate.uncertainty(family, {"width": stats.norm(500e-9, 100e-9)}, samples=64)
    for samples in (100, 2**62):  # NumPy raised ValueError
        with pytest.raises(th.InputError, match="power of two"):
            surrogate.uncertainty(family, {"width": stats.norm(500e-9, 5e-9)}, samples=samples)
    with pytest.raises(th.InputError, match="a distribution of scipy"):
        surrogate.uncertainty(family, {"width": 500e-9}, samples=64)


def synthetic(family: surrogate.family.Family, truth: dict[str, float], noise: float, seed: int, rho: float = 0.0):
    times = np.append(0.0, np.geomspace(2e-9, 50e-6, 1500 if rho else 150))
    rise = 1e-3 * family.model(**truth).step_response(times)
    rise = rise + noise * autoregressive(np.random.default_rng(seed), rho, times.size)
    return th.dataset.build(times, rise, th.Constant(1e-3))


@pytest.mark.slow
@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_calibration_recovers_the_truth_with_honest_errors(family, rho):
    truth = {"radius": 6.2e-6, "width": 470e-9, "box": 2.2e-6}
    pulls, chi = [], []
    for seed in range(12):
        found = surrogate.calibrate(family, synthetic(family, truth, 0.01, seed, rho), noise=0.01)
        pulls += [(found.values[name] - truth[name]) / found.standard_errors[name] for name in truth]
        chi.append(found.reduced_chi_square)
    # 36 pulls of unit variance, 12 independent triples: their mean square within 1 +- 3 sqrt(2/36)
    assert 0.3 < np.mean(np.square(pulls)) < 1.7
    # of 148 degrees of freedom; 1500 samples of correlation .9 count as 1500 (1 - .9^2)/(1 + .9^2) = 157
    assert abs(np.mean(chi) - 1) < 4 * np.sqrt(2 / 148 / 12)


def test_periodic_data_count_at_their_own_times(family):
    """Rows that are not spread evenly, counted as if they were, are off by 20 to 500 standard errors."""
    truth, wave = {"radius": 6.2e-6, "width": 470e-9, "box": 2.2e-6}, th.SquareWave(2e-3, 1e-6, 1 / 3)
    times, exact = th.waveforms.period_times(wave, 3001), family.model(**truth).periodic_response(wave, 3001)
    kept = np.unique(np.geomspace(1, 2900, 120).astype(int))
    data = th.dataset.build(times[kept], exact[kept], wave, periodic=True)
    found = surrogate.calibrate(family, data, noise=1e-3)
    assert found.reduced_chi_square < 1e-3
    for name, value in truth.items():
        assert abs(found.values[name] - value) < 0.1 * found.standard_errors[name]


def test_what_the_data_cannot_tell_apart_is_named(family):
    truth = {"radius": 6.2e-6, "width": 470e-9, "box": 2.2e-6}
    found = surrogate.calibrate(family, synthetic(family, truth, 2.0, 0), noise=2.0)
    assert found.unseen
    assert "shares of the ranges" in found.unseen[-1]


def test_calibration_needs_data(family):
    with pytest.raises(th.InputError, match="data has 0 Datasets"):
        surrogate.calibrate(family, [])


def test_calibration_refuses_data_of_another_part(family):
    """The members of the core do not fit the rise of the oxide."""
    heat = th.assemble(family.box.base, accuracy=1e-2)
    data = th.solve(heat, th.Constant(1e-3), np.append(0.0, np.geomspace(1e-9, 1e-5, 20)), read="box")
    with pytest.raises(th.InputError, match="data was read in 'box', and the members are in 'core'"):
        surrogate.calibrate(family, data)
    data.attrs |= {"heated": "heater", "read": "heater"}  # a part that the family does not have
    with pytest.raises(th.InputError, match="data was heated in 'heater', and the members are in 'core'"):
        surrogate.calibrate(family, data)


def test_calibration_takes_a_table_whatever_its_column_is_called(family, tmp_path):
    """The name of a column need not be a part of the members."""
    truth, times = {"radius": 6.2e-6, "width": 470e-9, "box": 2.2e-6}, np.append(0.0, np.geomspace(2e-9, 50e-6, 150))
    rise = family.model(**truth).response(th.Constant(1e-3), times)
    table = tmp_path / "scope.csv"
    for column, refused in (("T (K)", False), ("core", False), ("box", True)):
        columns = np.column_stack([times, rise])
        np.savetxt(table, columns, delimiter=",", header=f"t (s),{column}", comments="", fmt="%.12e")
        data = th.read_trace(table, 1e-3, temperature=column, units={"temperature": "K"}, start=0.0, baseline=0.0)
        if refused:
            with pytest.raises(th.InputError, match="data was read in 'box', and the members are in 'core'"):
                surrogate.calibrate(family, data)
        else:
            assert surrogate.calibrate(family, data).values == pytest.approx(truth, rel=1e-6, abs=0)


def test_ishigami_has_its_known_indices(family, monkeypatch):
    # y = sin x1 + 7 sin^2 x2 + 0.1 x3^4 sin x1 over (-pi, pi)^3; I. M. Sobol and Y. L. Levitan (1999)
    monkeypatch.setattr(surrogate.family.Family, "at", lambda self, values: None)
    spread, slopes = {}, {}
    for name, low, high in zip(family.names, family.box.low, family.box.high, strict=True):
        spread[name] = stats.uniform(low, high - low)
        slopes[name] = {name: 2 * np.pi / (high - low)}
    centre = {name: one.mean() for name, one in spread.items()}

    def ishigami(model, changes):
        x = [changes[name] for name in family.names]
        return np.sin(x[0]) + 7 * np.sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * np.sin(x[0])

    data = surrogate.uncertainty(family, spread, ishigami, samples=2048, optics=surrogate.Optics(slopes, centre))
    # the estimators err by about 1/sqrt(2048)
    np.testing.assert_allclose(data.first_order, [0.3139, 0.4424, 0.0], atol=0.05)
    np.testing.assert_allclose(data.total_order, [0.5576, 0.4424, 0.2437], atol=0.05)


def test_the_probability_of_a_map_is_the_share_of_the_members(family):
    import xarray as xr

    limits = family.thermal_resistance(radius=7e-6, width=500e-9, box=np.linspace(1.9e-6, 2.1e-6, 5))

    def above(model):
        return xr.DataArray(model.thermal_resistance > limits, dims="limit", coords={"limit": limits})

    spread = {"box": stats.norm(2e-6, 50e-9)}
    data = surrogate.uncertainty(family, spread, above, samples=64, fixed={"radius": 7e-6, "width": 500e-9})
    # R_th rises with the box: the probability that it exceeds that of a box is the tail of the distribution;
    # 128 quasi-random members give it to a few hundredths
    tail = 1 - spread["box"].cdf(np.linspace(1.9e-6, 2.1e-6, 5))
    np.testing.assert_allclose(data["mean"], tail, atol=0.05)
    assert data["mean"].attrs["long_name"] == "probability"
    np.testing.assert_array_equal(data.limit, limits)


def test_optics_follow_the_geometry(family):
    optics = surrogate.Optics({"bus_rate": {"width": 2e17}, "loss_rate": {"width": 3e16}}, at={"width": 500e-9})
    changes = optics.changes(family, {"radius": 7e-6, "width": 550e-9, "box": 2e-6})
    assert changes == pytest.approx({"bus_rate": 1e10, "loss_rate": 1.5e9})

    def rate(model, changes):
        return 40e9 + changes["bus_rate"]

    found = surrogate.design(family, {"width": (400e-9, 600e-9)}, target={rate: 45e9}, optics=optics)
    assert found.values["width"] == pytest.approx(525e-9, rel=1e-3)
    assert found.sensitivity["rate"]["width"] == pytest.approx(2e17)
    with pytest.raises(th.InputError, match="did you mean 'width'"):
        surrogate.uncertainty(
            family, {"box": stats.norm(2e-6, 1e-9)}, rate, optics=surrogate.Optics({"a": {"widht": 1.0}})
        )
    with pytest.raises(th.InputError, match="at width = '500 nm' is not a number"):
        surrogate.Optics({}, at={"width": "500 nm"}).check(family)


def test_an_interpolated_property_states_its_error(family):
    def slow(model):
        return 1.0 / model.thermal_resistance

    spread = {"width": stats.norm(500e-9, 5e-9), "box": stats.norm(2e-6, 50e-9)}
    data = surrogate.uncertainty(family, spread, slow, samples=256, fixed={"radius": 7e-6}, interpolate=40)
    exact = surrogate.uncertainty(family, spread, samples=256, fixed={"radius": 7e-6})
    # the interpolation is made from all functions, the resistance of arrays from the static ones: 1e-4 apart
    np.testing.assert_allclose(1 / data["value"], exact["value"], rtol=3e-4)
    assert 0 < data.attrs["interpolation_error"] < 1e-4
    with pytest.raises(th.InputError, match="24 at least"):
        surrogate.uncertainty(family, spread, slow, samples=256, interpolate=10)

    def none(model):
        raise th.InputError("it comes to rest")

    with pytest.raises(th.InputError, match=r"40 of 40 members do not have the property.*it comes to rest"):
        surrogate.uncertainty(family, spread, none, samples=256, interpolate=40)


@pytest.mark.slow
def test_a_member_that_kills_its_process_has_no_value_and_the_others_do(family, caplog):
    members = [{"radius": radius, "width": 450e-9, "box": 2e-6} for radius in (7e-6, 8e-6, 9e-6)]
    R = [family.at(member).thermal_resistance for member in members]

    def deadly(model):
        if model.thermal_resistance == R[1]:
            os.kill(os.getpid(), signal.SIGKILL)
        return 2 * model.thermal_resistance

    one = Property(family, deadly)
    with processes(2) as executor:
        found = one.many(members, executor)
    np.testing.assert_array_equal(found, [2 * R[0], np.nan, 2 * R[2]])
    assert "killed twice" in one.reason
    assert "members without deadly (1): its worker process was killed twice" in caplog.text


@pytest.mark.slow
def test_targets_that_exclude_each_other_come_with_a_front(family):
    found = surrogate.design(
        family, {"box": (1e-6, 3e-6)}, target={"thermal_resistance": 6e3, "rise_time": 1e-5}, fixed={"radius": 8e-6}
    )
    assert not found.reached
    front = found.front.sortby("thermal_resistance")
    assert front.sizes["member"] > 3
    misfits = abs(front.thermal_resistance / 6e3 - 1), abs(front.rise_time / 1e-5 - 1)
    order = np.argsort(misfits[0].values)
    assert np.all(np.diff(misfits[1].values[order]) < 0)  # less of one is more of the other


@pytest.mark.parametrize("periodic", [False, True])
def test_derivatives_of_responses_are_those_of_the_members(family, periodic):
    row = np.array([7e-6, 500e-9, 2e-6])
    wave = th.SquareWave(power=2e-3, period=1e-6, duty=1 / 3)
    times = th.waveforms.period_times(wave, 40)
    exact = family.modal_derivative(row).response(wave, times, periodic=periodic)
    for k, size in enumerate(family.box.high - family.box.low):
        rises = []
        for sign in (1, -1):
            moved = row + sign * 1e-4 * size * (np.arange(3) == k)
            model = family.at(dict(zip(family.names, map(float, moved), strict=True)))
            rises.append(model.periodic_response(wave, 40) if periodic else model.response(wave, times))
        slope = (rises[0] - rises[1]) / (2e-4 * size)
        # the difference errs by some 1e-8, the derivative by the square of its step in a rate, 1e-8
        np.testing.assert_allclose(exact[k], slope, atol=1e-6 * np.abs(slope).max())


def test_correlated_residuals_say_that_the_geometry_cannot_explain_the_data(family):
    truth = {"radius": 6.2e-6, "width": 470e-9, "box": 2.2e-6}
    data = synthetic(family, truth, 0.01, 0)
    assert abs(surrogate.calibrate(family, data, noise=0.01).correlation) < 4 / np.sqrt(151)
    times = data["time"].values
    wrong = th.dataset.build(
        times, data["delta_T"].values * (1 + 0.1 * np.sin(np.log(times + 1e-9))), th.Constant(1e-3)
    )
    found = surrogate.calibrate(family, wrong, noise=0.01)
    assert found.correlation > 0.5
    assert found.reduced_chi_square > 10


def test_a_family_and_a_held_one_are_what_identify_takes(family):
    held = family.held(radius=7e-6)
    assert isinstance(family, ThermalFamily)
    assert isinstance(held, ThermalFamily)
    assert held.names == ("width", "box")
    assert held.ranges["box"] == (1e-6, 3e-6)
    there = {"width": 500e-9, "box": 2e-6}
    np.testing.assert_array_equal(held.at(there).R, family.model(radius=7e-6, **there).R)
    ring, model = unknowns(coupled.borghi2021(), ["width", "box", "loss_rate"], held).build(np.log([5e-7, 2e-6, 6e9]))
    assert ring.loss_rate == pytest.approx(6e9)
    assert model.thermal_resistance == pytest.approx(held.at(there).thermal_resistance, rel=1e-9)
    with pytest.raises(th.InputError, match="radius = 1e-05 must lie between 5e-06 and 9e-06"):
        family.held(radius=1e-5)
