"""Maps by integration: each point is its own run, failures are kept, and how far linear stability agrees."""

from __future__ import annotations

import pickle
from concurrent.futures import Executor, Future
from importlib import import_module

import matplotlib.pyplot as plt
import numpy as np
import pytest
from rings import LUMPED, NEWTON, RING, SECOND_ORDER

import coupled
import surrogate
import thermofem as th
from coupled.maps.pulsing_map import overlap, pulse
from coupled.plot import plot_map, plot_maps

POWERS = 1e-3 * 10 ** (np.array([4, 7, 8]) / 10)
DETUNINGS = np.array([-10e9, 0.0, 30e9])


@pytest.fixture(scope="module")
def small():
    return coupled.pulsing_map(RING, SECOND_ORDER, POWERS, DETUNINGS, settled=False)


def test_a_map_holds_settled_cycles(small):
    found = coupled.pulsing_map(RING, SECOND_ORDER, POWERS, DETUNINGS)
    assert found.attrs["settled"] == 1
    assert small.attrs["settled"] == 0
    assert overlap(found, small) == 1
    for power in POWERS[1:]:
        for detuning in DETUNINGS[:2]:
            cycle = coupled.limit_cycle(RING, SECOND_ORDER, power=power, detuning=detuning)
            at = found.sel(power=power, detuning=detuning)
            assert float(at.period) == pytest.approx(cycle.attrs["period"], rel=1e-6, abs=0)
            assert float(at.duty) == pytest.approx(cycle.attrs["duty"], abs=1e-4)  # error of the polynomials there
            assert float(at.swing) == pytest.approx(cycle.attrs["swing"], rel=1e-4)
    with pytest.raises(th.InputError, match="settled=True goes with neither"):
        coupled.pulsing_map(RING, SECOND_ORDER, POWERS, DETUNINGS, settled=True, duration=1e-6)


def test_neighbours_lead_to_the_cycle_of_a_cold_ring():
    """Rows of the plane of the paper with both borders of pulsing, doubled cycles and a weakly stable small one."""
    model = surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1200e-9, eta=0.31, heat_capacity=7.63e-12)
    powers, detunings = (1e-3 * 10 ** np.linspace(0.3, 1, 20))[[2, 5, 17]], np.linspace(-30e9, 30e9, 20)
    found = coupled.pulsing_map(RING, model, powers, detunings)
    assert sum("2 pulses" in str(reason) for reason in found["reason"].values.flat) > 0
    for i, j in np.ndindex(found["regime"].shape):
        at = found.isel(power=i, detuning=j)
        power, detuning = float(at["power"]), float(at["detuning"])
        if str(at["regime"].values) == "stable":
            with pytest.raises(th.InputError, match="comes to rest at a stable fixed point"):
                coupled.limit_cycle(RING, model, power=power, detuning=detuning)
            continue
        cycle = coupled.limit_cycle(RING, model, power=power, detuning=detuning)
        assert float(at["period"]) == pytest.approx(cycle.attrs["period"], rel=1e-6, abs=0)
        assert float(at["duty"]) == pytest.approx(cycle.attrs["duty"], rel=2e-4)
        # rtol of the map's traces over 1 - multiplier, 9e-4, of the small cycle
        assert float(at["swing"]) == pytest.approx(cycle.attrs["swing"], rel=3.3e-4)


def test_irregular_bursts_are_no_cycle():
    """Bursts every 30 to 31 us that never repeat, by runs of 3 ms; a return map alone calls one of 31.02 us stable."""
    model = th.Foster(R=[2935.14719619, 3837.96926313, 911.73022278], tau=[3.63842504e-7, 1.00100896e-6, 1.23350066e-5])
    found = coupled.pulsing_map(RING, model, [7.906274965120533e-3], [39362436532.33665])
    assert str(found.regime.values[0, 0]) == "slow transient"


def test_every_point_is_its_own_run(small):
    for i, power in enumerate(POWERS):
        for j, detuning in enumerate(DETUNINGS):
            run = coupled.simulate(RING, SECOND_ORDER, power=power, detuning=detuning, duration=20e-6)
            want, got = coupled.pulsing(run), small.isel(power=i, detuning=j)
            assert str(got.regime.values) == want.regime
            assert str(got.reason.values) == want.reason
            for name in ("period", "duty", "swing"):
                assert float(got[name]) == pytest.approx(getattr(want, name), rel=1e-14, abs=0, nan_ok=True)


def test_a_trace_counts_every_cycle():
    """At rtol = 1e-5 errors of the steps make every second cycle of this trace differ."""
    model = surrogate.reduce(th.assemble(th.strip_ring(), accuracy=1e-3).system, tolerance=1e-4).model
    light = {"power": 1e-3 * 10**0.46, "detuning": 8e9}
    found = coupled.pulsing_map(RING, model, [light["power"]], [light["detuning"]], duration=20e-6)
    # shooting; a trace of 20 us has not settled, by .5 %
    assert found.period.item() == pytest.approx(coupled.limit_cycle(RING, model, **light).attrs["period"], rel=1e-2)


class Pickling(Executor):
    """Runs at once, with everything pickled on the way in and out, as another process would have it."""

    def __init__(self):
        self.jobs = 0

    def submit(self, fn, /, *args, **kwargs):
        self.jobs += 1
        future = Future()
        function, given, named = pickle.loads(pickle.dumps((fn, args, kwargs)))
        future.set_result(pickle.loads(pickle.dumps(function(*given, **named))))
        return future


def test_any_executor_will_do_and_a_bar_may_be_drawn(small, capsys):
    executor = Pickling()
    assert coupled.pulsing_map(RING, SECOND_ORDER, POWERS, DETUNINGS, settled=False, executor=executor).identical(small)
    assert executor.jobs == POWERS.size
    assert capsys.readouterr().out == ""
    coupled.pulsing_map(RING, SECOND_ORDER, POWERS[:1], DETUNINGS[:1], duration=1e-7, show_bar=True)
    assert "100%" in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore")  # what Dask's own sockets warn of is not ours
def test_a_dask_cluster_is_an_executor(small):
    from distributed import LocalCluster

    with (
        LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None) as cluster,
        cluster.get_client() as client,
        client.get_executor() as executor,
    ):
        found = coupled.pulsing_map(RING, SECOND_ORDER, POWERS, DETUNINGS, settled=False, executor=executor)
    assert found.identical(small)


def test_a_failing_point_stores_its_reason_and_spares_the_others(small, monkeypatch):
    maps = import_module("coupled.maps.pulsing_map")

    def sometimes(*setting, power, detuning, **options):
        if power == POWERS[1] and detuning == 0:
            raise RuntimeError("the integration found no step small enough")
        return pulse(*setting, power=power, detuning=detuning, **options)

    monkeypatch.setattr(maps, "pulse", sometimes)
    found = coupled.pulsing_map(RING, SECOND_ORDER, POWERS, DETUNINGS, settled=False)
    failed = found.regime == "failed"
    assert int(failed.sum()) == 1
    assert str(found.reason.values[1, 1]) == "the integration found no step small enough"
    assert np.isnan(found.period.values[1, 1])
    assert found.where(~failed, drop=False).period.equals(small.where(~failed).period)
    assert overlap(found, small) == 1  # a failed point does not count
    assert overlap(small, found.assign(regime=small.regime)) == 1


def classes(integrated, linear):
    """Count the points where the two maps differ, by what explains them."""
    found = {"subcritical": 0, "ghost": 0, "slow": 0, "unexplained": 0}
    pulses, unstable = (m.regime.values == "self-pulsing" for m in (integrated, linear))
    for i, j in zip(*np.nonzero(pulses != unstable), strict=True):
        reason, growth = str(integrated.reason.values[i, j]), float(linear.growth_rate[i, j])
        if pulses[i, j] and "steady" in reason and int(linear.stable_points[i, j]) == 1:
            found["subcritical"] += 1  # a steady limit cycle beside a stable fixed point
        elif unstable[i, j] and str(integrated.regime.values[i, j]) == "slow transient":
            found["ghost"] += 1  # the first pulse is still to come
        elif abs(growth) * integrated.attrs["duration"] < 3:
            found["slow"] += 1  # an amplitude that changes by less than exp(3) in the whole run
        else:
            found["unexplained"] += 1
    return found


@pytest.mark.parametrize(
    ("ring", "model", "duration", "least", "kinds"),
    [
        (RING, SECOND_ORDER, 20e-6, 0.98, {"ghost", "slow"}),
        (LUMPED, NEWTON, 20e-6, 0.92, {"subcritical"}),
        (RING, "FEM", 60e-6, 0.98, {"ghost", "slow"}),
    ],
    ids=["second order", "newton", "fem"],
)
@pytest.mark.slow
def test_linear_stability_agrees_with_integration(ring, model, duration, least, kinds):
    """A subset of 29 powers x 36 detunings, of which 99.0 % (second order) and 93.1 % (Newton) agree after 20 us.

    The slow poles of the FEM let unstable points grow for longer: after 20 us 93 % agree, after 60 us 99 %.
    """
    if model == "FEM":
        model = surrogate.reduce(th.assemble(th.strip_ring()).system, tolerance=1e-3).model
    powers, detunings = 1e-3 * 10 ** (np.linspace(3, 10, 29)[::2] / 10), np.linspace(-30e9, 30e9, 36)[1::3]
    integrated = coupled.pulsing_map(ring, model, powers, detunings, duration=duration)
    linear = coupled.stability_map(ring, model, powers, detunings)
    # On 180 points the sampled share scatters by sqrt(p (1 - p)/180): 0.7 % and 1.9 %.
    share = overlap(integrated, linear)
    assert share >= least
    found = classes(integrated, linear)
    assert {kind for kind, count in found.items() if count} <= kinds
    assert sum(found.values()) == round((1 - share) * integrated.regime.size)


def test_overlap_counts_points(small):
    pulses = small.regime.values == "self-pulsing"
    assert pulses.any()
    assert not pulses.all()
    other = small.assign(regime=(small.regime.dims, np.where(pulses, "stable", "self-pulsing")))
    assert overlap(small, small) == 1
    assert overlap(small, other) == 0
    one = small.regime.values.copy()
    one[0, 0] = "stable" if pulses[0, 0] else "self-pulsing"
    assert overlap(small, small.assign(regime=(small.regime.dims, one))) == pytest.approx(8 / 9, rel=1e-15)
    quiet = np.where(pulses, "self-pulsing", "bistable")  # bistable, stable and slow are alike in not pulsing
    assert overlap(small, small.assign(regime=(small.regime.dims, quiet))) == 1


def test_figures_label_themselves(small):
    curves = [*coupled.hopf_curves(RING, SECOND_ORDER, POWERS, DETUNINGS)]
    folds = coupled.fold_curves(RING, SECOND_ORDER, POWERS, DETUNINGS)
    for name in ("regime", "period", "duty", "swing"):
        ax = plot_map(small, name, hopf=curves, folds=folds)
        assert (ax.get_xlabel(), ax.get_ylabel()) == ("detuning (GHz)", "power (dBm)")
        assert len(ax.lines) == len(curves) + len(folds)
        # the window is that of the map, cells and all: half a spacing beyond the outermost points
        assert ax.get_xlim() == pytest.approx((-15, 45))
    axes = plot_maps({"A": small, "B": small}, hopf={"A": curves}, folds={"B": folds})
    assert axes.shape == (3, 2)
    assert [ax.get_title() for ax in axes[0]] == ["A", "B"]
    long = "Borghi 2021, lumped FCD, Foster with 14 states, R_th = 7.864 K/mW"
    narrow = plot_maps({long: small}, show=("regime",))[0, 0].figure
    narrow.draw_without_rendering()
    for text in (narrow.axes[0].title, narrow.legends[0]):  # nothing is cut off by the edge
        box = text.get_window_extent()
        assert box.x0 >= 0
        assert box.x1 <= narrow.bbox.width
    with pytest.raises(th.InputError, match="perid"):
        plot_map(small, "perid")
    plt.close("all")
