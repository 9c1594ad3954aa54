"""Every function that takes a Dataset takes one that xarray changed, or says in one line what is wrong with it.

Users select, reverse, join, rename and rescale. A cycle with every third row was "cannot reshape array of size 440 into
shape (53,5,5)", and a map without attributes a KeyError.
"""

from __future__ import annotations

import warnings

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr
from rings import RING, SECOND_ORDER

import coupled
import coupled.plot
import coupled.plot.circuit
import coupled.plot.cycles
import surrogate
import surrogate.plot
import thermofem as th
import thermofem.plot

PROBES = {"fit_spectrum", "fit_sindy", "fit_second_order"}  # refuse the Dataset of two probes, or of few samples


def first(data):
    """Name of the first dimension."""
    return next(iter(data.sizes))


def numbers(data, change):
    """The Dataset with all variables of numbers changed."""
    return data.assign({name: change(v) for name, v in data.data_vars.items() if v.dtype.kind == "f"})


def of_time(data, change):
    return data.assign_coords(time=change(data["time"])) if "time" in data.coords else data


CHANGES = {
    "nothing": lambda d: d,
    "reversed": lambda d: d.isel({first(d): slice(None, None, -1)}),
    "thinned": lambda d: d.isel({first(d): slice(None, None, 3)}),
    "one": lambda d: d.isel({first(d): 0}),
    "two": lambda d: d.isel({first(d): slice(0, 2)}),
    "empty": lambda d: d.isel({first(d): slice(0, 0)}),
    "shuffled": lambda d: d.isel({first(d): np.random.default_rng(0).permutation(d.sizes[first(d)])}),
    "joined": lambda d: xr.concat([d, d], first(d), data_vars="all"),
    "expanded": lambda d: d.expand_dims("extra"),
    "transposed": lambda d: d.transpose(*reversed(list(d.sizes))),
    "renamed": lambda d: d.rename({first(d): "zz"}),
    "without laser": lambda d: d.drop_vars([name for name in ("power", "detuning") if name in d.variables]),
    "doubled": lambda d: numbers(d, lambda v: 2 * v),
    "constant": lambda d: numbers(d, lambda v: 0 * v + 1),
    "holes": lambda d: numbers(d, lambda v: v.where(v > v.median())),
    "infinite": lambda d: numbers(d, lambda v: v.where(v != v.max(), np.inf)),
    "complex": lambda d: numbers(d, lambda v: v + 0j),
    "whole": lambda d: numbers(d, lambda v: v.fillna(0).clip(-1e15, 1e15).astype(int)),
    "single": lambda d: numbers(d, lambda v: v.astype("float32")),
    "objects": lambda d: numbers(d, lambda v: v.astype(object)),
    "text": lambda d: numbers(d, lambda v: v.astype(str)),
    "before": lambda d: of_time(d, lambda t: -t),
    "timedelta": lambda d: of_time(d, lambda t: (t * 1e9).astype("timedelta64[ns]")),
    "furlongs": lambda d: d.assign({name: v.assign_attrs(units="furlong") for name, v in d.data_vars.items()}),
    "unit 5": lambda d: d.assign({name: v.assign_attrs(units=5) for name, v in d.data_vars.items()}),
    "no attributes": lambda d: d.drop_attrs(),
    "attributes None": lambda d: d.assign_attrs(dict.fromkeys(d.attrs)),
    "attributes x": lambda d: d.assign_attrs(dict.fromkeys(d.attrs, "x")),
    "attributes nan": lambda d: d.assign_attrs(dict.fromkeys(d.attrs, float("nan"))),
    "attributes arrays": lambda d: d.assign_attrs(dict.fromkeys(d.attrs, np.arange(3.0))),
    "array": lambda d: d.to_dataarray(),
    "dict": lambda d: d.to_dict(),
    "frame": lambda d: d.to_dataframe(),
}


@pytest.fixture(scope="module")
def takers(tmp_path_factory):
    """(name, Dataset, function of it) of all functions that take a Dataset."""
    folder, power = tmp_path_factory.mktemp("changed"), 6.31e-3
    heat, times, lumped = th.assemble(th.strip_ring()), np.geomspace(1e-9, 3e-5, 120), surrogate.newton(tau_th=1e-6)
    step = th.solve(heat, th.Constant(2e-3), times)
    both = th.solve(heat, th.Constant(2e-3), times, read=["core", "box"])
    square = th.solve_periodic(heat, th.SquareWave(2e-3, 1e-6, 0.33))
    fields = th.solve(heat, th.Constant(2e-3), [1e-7, 1e-6], field_times=[1e-7, 1e-6])
    run = coupled.simulate(RING, SECOND_ORDER, power=power, duration=5e-6)
    swept = coupled.simulate(
        RING, SECOND_ORDER, power=power, detuning=coupled.Sweep([0, 2e-6], [9e10, -9e10]), duration=2e-6
    )
    cycle = coupled.limit_cycle(RING, SECOND_ORDER, power=power)
    branch = coupled.continue_cycle(RING, SECOND_ORDER, "power", (6.3e-3, 6.4e-3), power=power)
    powers, detunings = np.array([3e-3, 6e-3, 9e-3]), np.linspace(-10e9, 20e9, 3)
    quick = coupled.pulsing_map(RING, SECOND_ORDER, powers, detunings, duration=2e-6)
    stability = coupled.stability_map(RING, SECOND_ORDER, powers, detunings)
    (hopf, *_) = coupled.hopf_curves(RING, SECOND_ORDER, np.geomspace(1e-3, 1e-2, 5), np.linspace(-20e9, 20e9, 5))
    curve = coupled.transmission(RING, SECOND_ORDER, power=5e-3, detuning=(-120e9, 20e9))
    decay = coupled.carrier_decay(RING.carriers, 1e23, np.linspace(0, 3e-7, 40))
    pair = coupled.bus([RING, RING])
    two = coupled.simulate(pair, SECOND_ORDER, power={"in": power}, duration=2e-7)
    periods = np.geomspace(1e-7, 1e-5, 7)
    error = surrogate.period_error(lumped, SECOND_ORDER, periods)
    judged = surrogate.judge({"Newton": lumped}, SECOND_ORDER, periods=periods)
    compared = surrogate.compare({"Newton": lumped}, SECOND_ORDER, periods=())
    trained = surrogate.fit_foster(step, 2)
    own = coupled.plot
    again = {"power": power, "duration": 1e-8}
    several = (
        [(f.__name__, data, f) for data in (step, both, square) for f in (surrogate.fit_newton, surrogate.fit_foster)]
        + [(f.__name__, both, f) for f in (surrogate.fit_spectrum, surrogate.fit_sindy, surrogate.fit_second_order)]
        + [("th.save", d, lambda d: th.load(th.save(d, folder / "x.nc"))) for d in (step, both, square, run, cycle)]
        + [(f.__name__, d, f) for d in (run, swept, cycle) for f in (coupled.pulsing, own.plot_traces, own.plot_sweep)]
        + [("plot_map", d, own.plot_map) for d in (quick, stability)]
        + [("plot_maps", d, lambda d: own.plot_maps({"a": d}, show=["regime"])) for d in (quick, stability)]
    )
    return [
        *several,
        ("plot_fit", step, lambda d: surrogate.plot.plot_fit(trained, d)),
        ("plot_response", both, thermofem.plot.plot_response),
        ("plot_field", fields, thermofem.plot.plot_field),
        ("write_fields", fields, lambda d: th.write_fields(d, folder / "x.xdmf")),
        ("simulate", run, lambda d: coupled.simulate(RING, SECOND_ORDER, initial=d, **again)),
        ("limit_cycle, a run", run, lambda d: coupled.limit_cycle(RING, SECOND_ORDER, power=power, guess=d)),
        ("limit_cycle, a cycle", cycle, lambda d: coupled.limit_cycle(RING, SECOND_ORDER, power=power, guess=d)),
        ("cycle_derivatives", cycle,
         lambda d: coupled.cycle_derivatives(RING, SECOND_ORDER, ["power"], power=power, cycle=d)),
        ("continue_cycle, a cycle", cycle,
         lambda d: coupled.continue_cycle(RING, SECOND_ORDER, "power", (6.3e-3, 6.32e-3), power=power, guess=d)),
        ("continue_cycle, a Hopf point", hopf.isel(point=[3]),
         lambda d: coupled.continue_cycle(
             RING, SECOND_ORDER, "power", (float(hopf["power"][3]), 6.4e-3),
             guess=d.isel(point=0) if "point" in getattr(d, "dims", ()) and d.sizes["point"] else d)),
        ("overlap", quick, lambda d: coupled.overlap(d, stability)),
        ("plot_transmission", curve, own.plot_transmission),
        ("plot_branch", branch, coupled.plot.cycles.plot_branch),
        ("plot_carrier_decay", decay, own.plot_carrier_decay),
        ("fit_carrier_decay", decay, lambda d: coupled.fit_carrier_decay(d, RING.carriers)),
        ("simulate", two,
         lambda d: coupled.simulate(pair, SECOND_ORDER, power={"in": power}, duration=1e-9, initial=d)),
        ("plot_rings", two, coupled.plot.circuit.plot_rings),
        ("plot_ports", two, coupled.plot.circuit.plot_ports),
        ("valid_range", error, surrogate.valid_range),
        ("plot_period_error", error, lambda d: surrogate.plot.plot_period_error({"Newton": d})),
        ("verdict", judged, surrogate.verdict),
        ("plot_error_against_states", compared, surrogate.plot.plot_error_against_states),
        ("identify", run, lambda d: coupled.identify(RING, d, free=["loss_rate"], model=SECOND_ORDER, runs=1)),
    ]  # fmt: skip


@pytest.mark.parametrize("change", CHANGES)
def test_a_changed_dataset_is_taken_or_named(takers, change):
    wrong, taken = [], []
    for name, data, function in takers:
        if name == "identify" and change in ("nothing", "doubled", "single", "objects", "furlongs", "unit 5"):
            continue  # it takes seconds
        try:
            changed = CHANGES[change](data.copy())
        except (ValueError, KeyError, TypeError):  # xarray's own
            continue
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", RuntimeWarning)
                warnings.simplefilter("error", np.exceptions.ComplexWarning)
                function(changed)
            taken.append(name)
        except th.InputError as error:
            if "\n" in str(error):
                wrong.append((name, str(error)))
        except Exception as error:
            wrong.append((name, f"{type(error).__name__}: {error}"))
        finally:
            plt.close("all")
    assert not wrong
    assert taken or change in ("array", "dict", "frame")
    if change == "nothing":
        assert {name for name, *_ in takers} - {*taken} == PROBES | {"identify"}


def in_other_units(data, **units):
    """The Dataset with variables in other units, as their attributes say."""
    for name, (factor, unit) in units.items():
        values = (data[name].dims, data[name].values * factor, {"units": unit})
        data = data.assign_coords({name: values}) if name in data.coords else data.assign({name: values})
    return data


def test_the_units_of_a_dataset_in_memory_count():
    """Of a run whose time was in us, as its attribute said, `pulsing` gave a period of 0.686 s."""
    run = coupled.simulate(RING, SECOND_ORDER, power=6.31e-3, duration=5e-6)
    drawn = {"time": (1e6, "us"), "delta_T": (1e3, "mK"), "drop": (1e6, "uW"), "carriers": (1e-6, "1/cm^3")}
    other = in_other_units(run, **drawn)
    one, two = coupled.pulsing(run), coupled.pulsing(other)
    assert (one.period, one.swing, one.duty) == pytest.approx((two.period, two.swing, two.duty), rel=1e-9)
    lines = [coupled.plot.plot_traces(data).lines[0].get_xydata() for data in (run, other)]
    np.testing.assert_allclose(*lines, rtol=1e-9)
    decay = coupled.carrier_decay(RING.carriers, 1e23, np.linspace(0, 3e-7, 40))
    again = in_other_units(decay, time=(1e9, "ns"), carriers=(1e-6, "1/cm^3"))
    found = [coupled.fit_carrier_decay(data, RING.carriers).carriers.tau_n for data in (decay, again)]
    assert found[0] == pytest.approx(found[1], rel=1e-9)
    chart = coupled.stability_map(RING, SECOND_ORDER, np.array([3e-3, 6e-3]), np.linspace(-10e9, 20e9, 3))
    assert coupled.overlap(chart, in_other_units(chart, power=(1e3, "mW"), detuning=(1e-9, "GHz"))) == 1.0
    plt.close("all")
