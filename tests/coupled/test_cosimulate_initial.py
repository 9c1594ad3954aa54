"""Co-simulations that begin on a settled cycle or where another one ended."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from correctors import MW, NETWORK, RING, Exact
from models import coarse_fem, coarse_warm_fem

import coupled
import surrogate
import thermofem as th
from coupled.runs.pulsing import crossings


@cache
def strip():
    heat = th.assemble(th.strip_ring(), accuracy=1e-2)
    return heat, surrogate.reduce(heat.system, tolerance=1e-6)


def periods(run):
    t, N = run["time"].values, run["carriers"].values
    return np.diff(crossings(t, N, (N.min() + N.max()) / 2))


def test_the_fem_is_settled_from_the_first_period():
    """The settled period, 684.9 ns, after one period; the certificate is 1e-6, left are 1e-4 K of 6 K of tolerance."""
    heat, reduction = strip()
    cycle = coupled.limit_cycle(RING, reduction, power=MW)
    run = coupled.cosimulate(
        RING, heat, power=MW, duration=2.3 * cycle.attrs["period"], initial=cycle, max_discrepancy=1e-4, rtol=1e-8
    )
    found = periods(run)
    assert found == pytest.approx(np.full(found.size, cycle.attrs["period"]), rel=2e-5)
    assert found.size >= 1
    assert cycle.attrs["period"] == pytest.approx(684.9e-9, rel=5e-3)  # the mesh of accuracy 1e-2
    assert abs(run.attrs["heat_imbalance"]) < 1e-7
    cold = coupled.cosimulate(RING, heat, power=MW, duration=3e-6)
    assert abs(periods(cold)[-1] / cycle.attrs["period"] - 1) > 1e-2  # so that beginning there is seen


@pytest.mark.parametrize("system", [coarse_fem, coarse_warm_fem])
def test_a_run_goes_on_where_another_ended(system):
    """Two halves and the whole differ by less than their tolerances, with constant and with varying conductivity."""
    heat, drive = system(), {"power": 20e-3, "max_discrepancy": 1e-4, "rtol": 1e-8}
    whole = coupled.cosimulate(RING, heat, duration=60e-9, **drive)
    first = coupled.cosimulate(RING, heat, duration=30e-9, **drive)
    second = coupled.cosimulate(RING, heat, duration=30e-9, initial=first, **drive)
    rise = np.interp(second["time"].values + 30e-9, whole["time"].values, whole["delta_T"].values)
    assert second["delta_T"].values[0] == pytest.approx(first["delta_T"].values[-1], rel=0, abs=1e-12)
    assert second["delta_T"].values == pytest.approx(rise, rel=0, abs=1e-3)
    assert second["delta_T"].values[-1] > 0.5
    assert second.attrs["final_light"] == pytest.approx(whole.attrs["final_light"], rel=1e-3)


def test_a_run_goes_on_after_it_was_written(tmp_path):
    first = coupled.cosimulate(RING, coarse_fem(), power=20e-3, duration=5e-9)
    th.save(first, tmp_path / "run.nc")
    a, b = (
        coupled.cosimulate(RING, coarse_fem(), power=20e-3, duration=5e-9, initial=one)
        for one in (first, th.load(tmp_path / "run.nc"))
    )
    assert a["delta_T"].values == pytest.approx(b["delta_T"].values, rel=1e-12)


def test_a_beginning_in_other_units_is_the_same():
    """mK counted as K: 6209 K instead of 6.2 K; a cycle without some rows began 15 K too hot."""
    heat, network = coarse_fem(), surrogate.reduce(coarse_fem(), tolerance=1e-4)
    run = coupled.cosimulate(RING, heat, power=20e-3, duration=5e-9)
    cycle = coupled.limit_cycle(RING, NETWORK, power=MW)
    scaled = run.assign(final_rise=(run["final_rise"].dims, 1e3 * run["final_rise"].values, {"units": "mK"}))
    milli = cycle.assign(absorbed=("time", 1e3 * cycle["absorbed"].values, {"units": "mW"}))
    drive = {"power": MW, "duration": 1e-9, "predictor": network}
    for one, other in ((run, scaled), (cycle, milli)):
        a, b = (coupled.cosimulate(RING, heat, initial=given, **drive) for given in (one, other))
        assert float(b["delta_T"][0]) == pytest.approx(float(a["delta_T"][0]), rel=1e-9)
    for bad, words in (
        (cycle.isel(time=slice(0, -5)), "a whole cycle has"),
        (run.assign_attrs(final_light="x"), "final_light"),
        (cycle.drop_vars("absorbed"), "has no 'absorbed'"),
    ):
        with pytest.raises(th.InputError, match=words):
            coupled.cosimulate(RING, heat, initial=bad, **drive)


def test_what_cannot_be_a_beginning():
    drive = {"power": 1e-3, "duration": 5e-9}
    run = coupled.cosimulate(RING, coarse_fem(), **drive)
    for heat, initial, words in (
        (coarse_fem(), coupled.simulate(RING, NETWORK, **drive), "has no 'final_rise'; a run of coupled.cosimulate"),
        (strip()[0], run, "on another mesh"),
        (Exact(NETWORK), run, "keeps its own state"),
    ):
        with pytest.raises(th.InputError, match=words):
            coupled.cosimulate(RING, heat, initial=initial, **drive)


def test_finite_elements_that_made_a_run_begin_another_with_its_end_alone():
    """The second run ended in "times run from 0 to 5e-09 s, the field is at 5e-09 s"."""
    fem = coupled.FEM(strip()[0])
    run = coupled.cosimulate(RING, fem, power=MW, duration=5e-9)
    with pytest.raises(th.InputError, match=r"heat is a coupled\.FEM that made a run before"):
        coupled.cosimulate(RING, fem, power=MW, duration=5e-9)
    on = coupled.cosimulate(RING, fem, power=MW, duration=5e-9, initial=run)
    assert float(on.delta_T[0]) == pytest.approx(float(run.delta_T[-1]), rel=1e-9)
