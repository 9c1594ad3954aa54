"""Maps over other axes, maps that go on from a file, maps of a stepped laser, and their command line."""

from __future__ import annotations

from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import replace
from importlib import import_module

import matplotlib.pyplot as plt
import numpy as np
import pytest
from rings import LUMPED, RING, SECOND_ORDER
from typer.testing import CliRunner

import coupled
import surrogate
import thermofem as th
from coupled.maps.pulsing_map import overlap, pulse
from coupled.plot import plot_map
from coupled.ring_toml import UNITS
from coupled.thermal import long_enough
from coupled.unknowns import optical_names
from thermofem.campaign.stored_tasks import WorkerDiedError
from thermofem_cli import app

SHORT = {"duration": 6e-6}
P, NU = [4e-3, 6.31e-3], [-10e9, 0.0, 10e9]


def test_two_parameters_of_the_ring_as_axes():
    axes = {"bus_rate": [40e9, 46e9], "tau0": [30e-9, 36e-9, 42e-9]}
    found = coupled.pulsing_map(RING, SECOND_ORDER, 6.31e-3, 0.0, vary=axes, **SHORT)
    linear = coupled.stability_map(RING, SECOND_ORDER, 6.31e-3, 0.0, vary=axes)
    assert found.regime.dims == linear.regime.dims == ("bus_rate", "tau0")
    assert found.tau0.attrs["units"] == "s"
    assert found.attrs["power"] == 6.31e-3
    for i, rate in enumerate(axes["bus_rate"]):
        for j, lifetime in enumerate(axes["tau0"]):
            factor = lifetime / RING.carriers.tau0
            carriers = replace(RING.carriers, tau_n=35e-9 * factor, tau_p=22.5e-9 * factor)
            ring = replace(RING, bus_rate=rate, carriers=carriers)
            run = coupled.simulate(ring, SECOND_ORDER, power=6.31e-3, **SHORT)
            # tau0 and its factor to round-off, which a pulsing ring of 10 cycles does not magnify
            assert float(found.period[i, j]) == pytest.approx(coupled.pulsing(run).period, rel=1e-9, abs=0)
            states = coupled.steady_states(ring, SECOND_ORDER, power=6.31e-3)
            assert float(linear.growth_rate[i, j]) == pytest.approx(float(states.growth_rate.min()), rel=1e-8)
    assert overlap(found, linear) == 1
    ax = plot_map(found, "period")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("tau0 (ns)", "bus rate (G1/s)")
    plt.close("all")


def test_an_interrupted_map_goes_on_and_is_the_same(tmp_path, monkeypatch):
    whole = coupled.pulsing_map(RING, SECOND_ORDER, P, NU, **SHORT)
    file = tmp_path / "map.jsonl"
    assert coupled.pulsing_map(RING, SECOND_ORDER, P, NU, file=file, **SHORT).identical(whole)
    lines = file.read_bytes().splitlines(keepends=True)
    assert len(lines) == 3
    runs = []
    monkeypatch.setattr(
        import_module("coupled.maps.pulsing_map"), "pulse", lambda *a, **k: runs.append(k["power"]) or pulse(*a, **k)
    )
    for end, again in ((len(lines[0]) - 4, 6), (len(lines[0]), 6), (len(b"".join(lines[:2])), 3), (-5, 3), (None, 0)):
        file.write_bytes(b"".join(lines)[:end])  # as a kill would leave it: within the head, a row, or whole
        runs.clear()
        assert coupled.pulsing_map(RING, SECOND_ORDER, P, NU, file=file, **SHORT).identical(whole)
        assert len(runs) == again
        assert len(file.read_bytes().splitlines()) == 3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rtol": 1e-5}, "different: rtol"),
        ({"follow": "up"}, "different: follow"),
        ({"detunings": NU[:2]}, "detuning"),
        ("my notes", "no rows of this map.*give another file name"),  # without a line's end, as a row that was cut off
        ("[1, {}]\n[0, []]\n", "give another file name"),
    ],
)
def test_a_file_of_another_map_or_of_none_is_refused_and_kept(tmp_path, change, message):
    arguments = {"ring": RING, "model": SECOND_ORDER, "powers": P[:1], "detunings": NU, "file": tmp_path / "a", **SHORT}
    coupled.pulsing_map(**arguments)
    if isinstance(change, str):
        (tmp_path / "a").write_text(change)
        change = {}
    before = (tmp_path / "a").read_bytes()
    with pytest.raises(th.InputError, match=message):
        coupled.pulsing_map(**arguments | change)
    assert (tmp_path / "a").read_bytes() == before


@pytest.mark.parametrize("edit", ["[0, []]", "[7, []]", "[0]", '[0, [["stable", "1 us", 0.5, 1.0, ""]]]', "\udcff{"])
def test_a_damaged_row_is_computed_again(tmp_path, edit):
    rows = tmp_path / "rows"
    arguments = (RING, SECOND_ORDER, P, NU[:2])
    whole = coupled.pulsing_map(*arguments, file=rows, **SHORT)
    before = rows.read_text().splitlines()
    rows.write_bytes("\n".join([before[0], edit, *before[2:], ""]).encode(errors="surrogateescape"))
    assert coupled.pulsing_map(*arguments, file=rows, **SHORT).identical(whole)
    assert sorted(rows.read_text().splitlines()) == sorted(before)


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(th.InputError, match="cannot be"):
        coupled.pulsing_map(RING, SECOND_ORDER, P[:1], NU[:2], file=tmp_path, **SHORT)


class Dying(Executor):
    """An executor whose worker dies with every task."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.set_exception(BrokenExecutor("the worker died"))
        return future


def test_a_row_whose_worker_dies_is_tried_once_more(tmp_path, monkeypatch):
    arguments = (RING, SECOND_ORDER, P, NU[:2])
    whole = coupled.pulsing_map(*arguments, **SHORT)
    assert coupled.pulsing_map(*arguments, executor=Dying(), **SHORT).identical(whole)

    def second_dies_again(function, tasks, **_):
        for k, task in enumerate(tasks):
            future = Future()
            if k:
                future.set_exception(WorkerDiedError("its worker process was killed twice"))
            else:
                future.set_result(function(task))
            yield task, future

    with monkeypatch.context() as patched:
        patched.setattr(import_module("coupled.maps.pulsing_map"), "completed", second_dies_again)
        found = coupled.pulsing_map(*arguments, file=tmp_path / "rows", **SHORT)
    assert np.array_equal(found.regime.values[0], whole.regime.values[0])
    assert found.regime.values[1].tolist() == ["failed", "failed"]
    assert "killed twice" in found.reason.values[1, 0]
    assert coupled.pulsing_map(*arguments, file=tmp_path / "rows", **SHORT).identical(whole)


@pytest.mark.parametrize("follow", ["up", "down"])
def test_a_stepped_laser_keeps_the_state(follow):
    found = coupled.pulsing_map(RING, SECOND_ORDER, [6.31e-3], NU, follow=follow, **SHORT)
    run = None
    for nu in NU if follow == "up" else NU[::-1]:
        run = coupled.simulate(RING, SECOND_ORDER, power=6.31e-3, detuning=nu, initial=run, **SHORT)
        assert float(found.period.sel(detuning=nu)[0]) == pytest.approx(coupled.pulsing(run).period, rel=1e-12, abs=0)


def test_a_stepped_laser_has_hysteresis_where_a_cycle_stands_beside_a_stable_point():
    """Newton's law is subcritical: a pulsing ring goes on pulsing, one at rest stays at rest."""
    ring, newton = RING.with_lumped_fcd(), surrogate.newton(tau_th=275e-9)
    detunings = np.linspace(-2e9, 6e9, 9)
    up, down = (
        coupled.pulsing_map(ring, newton, [5e-3], detunings, follow=f, duration=12e-6).regime.values[0]
        == "self-pulsing"
        for f in ("up", "down")
    )
    assert np.sum(up) > np.sum(down)
    assert np.all(up[down])
    stable = coupled.stability_map(ring, newton, [5e-3], detunings).stable_points.values[0] > 0
    assert np.all(stable[up & ~down])


def test_a_slow_ring_asks_for_longer_runs_and_then_shows_what_it_does(tmp_path):
    """Its heat is an exponential of ten times 1.2 us, 95 % of which have risen after ln 20 of those."""
    slow = th.Foster(R=[7784.0], tau=[12e-6])
    assert long_enough(slow) == pytest.approx(
        10 * np.log(20) * 12e-6, rel=0.015
    )  # half of the second digit, and a grid of .2 %
    assert long_enough(th.OutputMap(slow, 1e-3)) == long_enough(slow)
    short = coupled.pulsing_map(RING, slow, P, NU, settled=False)
    assert "slow transient" in short.regime
    assert short.attrs["suggested_duration"] == long_enough(slow)
    again = coupled.pulsing_map(RING, slow, P, NU, duration=short.attrs["suggested_duration"])
    assert "slow transient" not in again.regime
    assert "suggested_duration" not in again.attrs
    surrogate.save_model(slow, tmp_path / "slow.json")
    given = [str(tmp_path / "slow.json"), "-o", str(tmp_path / "out.nc")]
    for command, words in (
        (["map", "--points", "2, 3", "--duration", "20 us"], 'try --duration "360 us": ten times'),
        (["simulate", "--duration", "2 us"], "yet still moving: simulate 20 us"),
    ):
        done = CliRunner().invoke(app, [command[0], *given, *command[1:]])
        assert done.exit_code == 0, done.output
        assert words in done.output


@pytest.mark.slow
def test_commands(tmp_path):
    model = tmp_path / "model.json"
    surrogate.save_model(SECOND_ORDER, model)
    start = [str(model), "--power", "7 dBm, 9 dBm", "--detuning", "-10 GHz, 10 GHz", "--points", "2, 3"]
    for command, more, ring in (
        ("map", ["--duration", "6 us", "--resume", str(tmp_path / "rows")], "'Borghi 2021'; --ring RING.toml takes"),
        ("stability", ["--ring", "borghi2021-lumped"], "'Borghi 2021, lumped FCD'\n"),
    ):
        output, picture = tmp_path / f"{command}.nc", tmp_path / f"{command}.png"
        done = CliRunner().invoke(app, [command, *start, *more, "-o", str(output), "--figure", str(picture)])
        assert done.exit_code == 0, done.output
        assert ring in done.output
        found = th.load(output)
        assert found.regime.shape == (2, 3)
        assert found.power.values == pytest.approx(1e-3 * 10 ** np.array([0.7, 0.9]), rel=1e-12, abs=0)
        assert found.detuning.values == pytest.approx([-10e9, 0, 10e9])
        assert picture.stat().st_size > 10_000
        assert f"wrote {output}" in done.output.replace("\n", "")
    assert len((tmp_path / "rows").read_text().splitlines()) == 3


@pytest.mark.parametrize("ring", [coupled.borghi2021(), coupled.vanvaerenbergh2012()], ids=lambda ring: ring.name)
def test_every_number_that_may_be_varied_has_a_unit(ring):
    assert optical_names(ring) <= UNITS.keys()


def test_a_lumped_dispersion_follows_its_coefficient():
    """Maps and branches over lumped_fcd move with it, from -9.5e-27 to -1.2e-26 m^3."""
    newton = th.Foster(R=[275e-9 / 3.3e-11], tau=[275e-9])
    vary = {"lumped_fcd": [-1.2e-26, -9.5e-27]}
    found = coupled.stability_map(LUMPED, newton, P, 0.0, vary=vary)["growth_rate"].values
    for row, value in zip(found, vary["lumped_fcd"], strict=True):
        other = replace(LUMPED, lumped_fcd=value, fcd=((value, 1.0),))
        alone = coupled.stability_map(other, newton, P, [0.0])["growth_rate"].values[:, 0]
        np.testing.assert_allclose(row, alone, rtol=1e-9)
