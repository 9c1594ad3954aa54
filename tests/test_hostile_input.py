"""What a search for hostile input found: each is one line of InputError, or one line on standard error."""

from __future__ import annotations

import json
import os
import sys
import tracemalloc
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest

import coupled
import surrogate
import thermofem as th
import thermofem_cli as cli
from coupled.maps.journal import Journal
from surrogate.family.archive import pack
from thermofem.data import files
from thermofem.mesh.triangles import load as load_mesh
from thermofem_cli.apart import check_apart
from thermofem_cli.files import check_outputs


def test_a_key_that_stands_twice_is_refused():
    """The last one would win in silence: of two R_th, nobody knows which one is meant."""
    with pytest.raises(th.InputError, match="the key 'R' twice"):
        files.from_json('{"poles": [{"R": 1, "tau": 1e-6, "R": 100}]}')


@pytest.mark.parametrize("line", ["{} = 1", "[{}]", "[[{}]]", "x = {{ {} = 1 }}"])
@pytest.mark.parametrize("word", ["a", '"a b\\""', "'c'", "d-1"])
@pytest.mark.parametrize("dot", [".", " . "])
def test_a_long_dotted_name_is_refused_before_it_takes_memory(line, word, dot):
    """tomllib keeps every prefix of a dotted name: 50 000 words of 100 kB took 10 GB."""
    tracemalloc.start()
    try:
        with pytest.raises(th.InputError, match="nested more than 40 deep"):
            files.from_toml(line.format(dot.join([word] * 1500)))
        assert tracemalloc.get_traced_memory()[1] < 1_000_000  # 1500**2 / 2 pointers are 9 MB
    finally:
        tracemalloc.stop()


def test_text_with_dots_and_quotes_is_still_read():
    assert files.from_toml('a.b."c.d".e = "1.5. One. Two. \\" 3."\nf = [1.0, 2.5]')["f"] == [1.0, 2.5]


@pytest.mark.parametrize("name", ["kind", "heated", "read", "geometry"])
def test_attributes_that_are_no_text_are_refused(name):
    times = np.linspace(0, 10e-6, 50)
    data = th.dataset.build(times, 10 * (1 - np.exp(-times / 1e-6)), th.Constant(1e-3))
    data.attrs[name] = np.array([1.0, 2.0])
    with pytest.raises(th.InputError, match=name):
        surrogate.fit_newton(data)


@pytest.mark.slow
def test_a_family_that_unpacks_to_gigabytes_is_refused(tmp_path):
    path = tmp_path / "family.json"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("header.npy", "w") as member:
        for _ in range(410):
            member.write(bytes(1_000_000))
    with pytest.raises(th.InputError, match="more than 400000000 bytes unpacked"):
        surrogate.load_family(path)


def test_a_family_whose_header_is_deep_is_refused(tmp_path):
    path = tmp_path / "family.json"
    path.write_bytes(pack({"header": np.array("[" * 100_000)}))
    with pytest.raises(th.InputError, match="nested more than 40 deep"):
        surrogate.load_family(path)


def test_a_lack_of_memory_is_one_line(monkeypatch, capsys):
    def hungry(**_):
        raise MemoryError("Unable to allocate 298. GiB")

    monkeypatch.setattr(cli, "app", hungry)
    with pytest.raises(SystemExit) as left:
        cli.main()
    assert left.value.code == 2
    assert capsys.readouterr().err.splitlines() == [
        "thermofem: error: it needs more memory than there is (Unable to allocate 298. GiB)"
    ]


def test_warnings_of_libraries_stay_off_the_screen(monkeypatch, capsys):
    def noisy(**_):
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            warnings.warn("overflow encountered in reduce", RuntimeWarning, stacklevel=1)
            warnings.warn("far above its training", th.OutsideTrainingWarning, stacklevel=1)

    def show(message, *_, **__):
        print(message, file=sys.stderr)

    monkeypatch.setattr(warnings, "showwarning", show)
    monkeypatch.setattr(sys, "warnoptions", [])
    monkeypatch.setattr(cli, "app", noisy)
    cli.main()
    assert capsys.readouterr().err.splitlines() == ["far above its training"]


STEP, SQUARE = th.Constant(2e-3), th.SquareWave(2e-3, 2e-6, 0.3)
POLES = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])
CHANGES = {
    "double": lambda rise: 2 * rise,
    "in mK": lambda rise: 1e3 * rise,
    "half": lambda rise: rise / 2,
    "shifted": lambda rise: rise + 3.0,
}


def stated(rise, times, wave, periodic=False):
    return th.dataset.build(times, rise, wave, periodic=periodic, attributes={"thermal_resistance": 7000.0})


@pytest.mark.parametrize("wave", [STEP, SQUARE], ids=["step", "square"])
@pytest.mark.parametrize("change", CHANGES)
def test_data_that_contradict_their_thermal_resistance_are_refused_or_noted(change, wave):
    """Of an exact response, with noise or without, nothing is said; of a changed one something is."""
    times = np.linspace(0, 20e-6, 400)
    rise = POLES.response(wave, times)
    noise = np.random.default_rng(0).normal(0, 0.1, times.size)
    for exact in (rise, rise + noise):
        assert not any("wrong?" in note for note in surrogate.fit_newton(stated(exact, times, wave)).notes)
    try:
        notes = surrogate.fit_newton(stated(CHANGES[change](rise), times, wave)).notes
    except th.InputError as error:
        notes = (str(error),)
    assert any("thermal_resistance" in note and note.endswith("wrong?") for note in notes)


@pytest.mark.parametrize("factor", [0.5, 0.95, 1.05, 2.0])
def test_a_periodic_state_has_the_mean_of_its_thermal_resistance(factor):
    times = th.waveforms.period_times(SQUARE, 301)
    rise = POLES.periodic_response(SQUARE, 301)
    surrogate.fit_newton(stated(rise, times, SQUARE, periodic=True))
    with pytest.raises(th.InputError, match="thermal_resistance = 7000 K/W"):
        surrogate.fit_newton(stated(factor * rise, times, SQUARE, periodic=True))


def test_a_rise_with_conductivity_of_temperature_is_no_contradiction():
    """k(T) makes more than R_th P at 500 mW; the same numbers without k(T) are refused."""
    hot = th.strip_ring().with_({"layer.box.material": "Si(T)", "layer.substrate.material": "Si(T)"})
    heat = th.assemble(hot, 1e-2)
    data = th.solve(heat, th.Constant(0.5), np.linspace(0, 400e-6, 60))
    assert float(data["delta_T"].max()) > 1.01 * data.attrs["thermal_resistance"] * 0.5
    surrogate.fit_newton(data)
    with pytest.raises(th.InputError, match="delta_T reaches"):
        surrogate.fit_newton(data.assign_attrs(geometry=hot.to_toml().replace("Si(T)", "Si")))


def test_a_probe_is_held_against_its_own_thermal_resistance():
    times = np.linspace(0, 20e-6, 400)
    rises = np.stack([POLES.response(STEP, times), 2 * POLES.response(STEP, times)], axis=1)
    attributes = {"thermal_resistance": 7000.0, "thermal_resistances": [7000.0, 14000.0]}
    data = th.dataset.build(times, rises, STEP, read=("core", "tip"), attributes=attributes)
    for probe, expected in (("core", 7000), ("tip", 14000)):
        fit = surrogate.fit_foster(data.sel(probe=probe), order=2)
        assert fit.model.thermal_resistance == pytest.approx(expected, rel=1e-6)
        assert not any("wrong?" in note for note in fit.notes)


def test_a_time_that_stands_twice_is_refused_unless_the_power_jumps():
    times = np.linspace(0, 8e-6, 41)
    rise = POLES.response(STEP, times)
    for second in (rise[20], rise[20] + 1.0):
        data = th.dataset.build(np.insert(times, 20, times[20]), np.insert(rise, 20, second), STEP)
        with pytest.raises(th.InputError, match="twice"):
            surrogate.fit_newton(data)
    pulse = th.Pulse(2e-3, 4e-6)
    rise, at = POLES.response(pulse, times), int(np.searchsorted(times, 4e-6))
    twice = np.insert(times, at, 4e-6)
    surrogate.fit_newton(th.dataset.build(twice, POLES.response(pulse, twice), pulse))
    wrong = POLES.response(pulse, twice)
    wrong[at] += 1.0
    with pytest.raises(th.InputError, match="twice"):
        surrogate.fit_newton(th.dataset.build(twice, wrong, pulse))


@pytest.mark.parametrize(("count", "slowest"), [(80, 1.01e-6), (300, 2e-6), (5000, 2e-6)])
def test_a_ladder_out_of_reach_is_said(count, slowest, tmp_path):
    """Poles near each other have ladders of 1e300 J/K; a SPICE file then holds the Foster network alone."""
    model = th.Foster(R=np.ones(count), tau=np.linspace(1e-6, slowest, count))
    with pytest.raises(th.InputError, match="ladder"):
        surrogate.cauer(model)
    text = surrogate.export_model(model, tmp_path / "x.cir", to="spice").read_text()
    assert "without a Cauer ladder" in text
    assert text.count(".subckt") == 1


@pytest.mark.parametrize(
    "change",
    [
        {"ambient": 300},
        {"poles": [{"R": 5e3, "tau": 1e-6, "C": 1}]},
        {"units": {"R": "K/W", "x": "y"}},
        {"thermal_resistance": 5001.0},
    ],
)
@pytest.mark.parametrize("kind", ["Foster", "Cauer"])
def test_a_field_that_would_be_ignored_is_refused(change, kind, tmp_path):
    model = th.Foster(R=[5e3], tau=[1e-6])
    path = surrogate.save_model(model if kind == "Foster" else surrogate.cauer(model), tmp_path / "m.json")
    content = json.loads(path.read_text())
    surrogate.load_model(path)
    if kind == "Cauer" and "poles" in change:
        change = {"ladder": [{**content["ladder"][0], "tau": 1}]}
    path.write_text(json.dumps({**content, **change}))
    with pytest.raises(th.InputError, match=r"is no field|edited or lost"):
        surrogate.load_model(path)


def test_a_byte_order_mark_is_no_obstacle(tmp_path):
    path = surrogate.save_model(th.Foster(R=[5e3], tau=[1e-6]), tmp_path / "m.json")
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert surrogate.load_model(path).thermal_resistance == 5e3
    toml = tmp_path / "ring.toml"
    toml.write_bytes(b"\xef\xbb\xbf" + th.strip_ring().to_toml().encode())
    assert th.CrossSection.from_toml(toml) == th.strip_ring()


FILE_READERS = {
    "model": surrogate.load_model,
    "provenance": surrogate.load_provenance,
    "family": surrogate.load_family,
    "geometry": th.CrossSection.from_toml,
    "ring": coupled.RingResonator.from_toml,
    "campaign": th.Campaign.from_toml,
    "data": th.load,
    "mesh": load_mesh,
    "table": lambda path: th.read_trace(path, 1e-3),
    "map": lambda path: Journal(path, {"a": 1}),
}


@pytest.mark.parametrize("reader", FILE_READERS)
def test_what_is_no_regular_file_is_refused_at_once(reader, tmp_path):
    """A pipe without a writer would be waited for, and a device has no end."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path / "link", tmp_path, Path("/dev/zero"), tmp_path / ("x" * 300)):
        with pytest.raises(th.InputError) as error:
            FILE_READERS[reader](path)
        assert "\n" not in str(error.value)


def test_no_guess_is_made_of_two_letters():
    with pytest.raises(th.InputError) as error:
        th.quantity.parse("1 mn", "s")
    assert "did you mean" not in str(error.value)
    with pytest.raises(th.InputError, match="did you mean 'nm'"):
        th.quantity.parse("1 mn", "m")


def test_a_loop_of_links_is_one_line(tmp_path):
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    check_outputs([tmp_path / "out.json"])
    check_apart({"model": loop, "output": tmp_path / "out.json"})
    for reader in FILE_READERS.values():
        with pytest.raises(th.InputError):
            reader(loop)
    check_apart({"model": loop, "output": loop})  # no file to write over


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["solve", "--pulse", ""], "--pulse is empty"),
        (["solve", "--read", "core", "--read", " "], "--read is empty"),
        (["solve", "-o", ""], "--output is empty"),
        (["solve", ""], "GEOMETRY is empty"),
        (["fit", "d.nc", "--order", "3"], "--order = 3 goes with --kind foster"),
        (["explore", "m.json", "--channel", "nope"], "--heated = 'nope' is unknown"),
    ],
)
def test_an_option_that_is_empty_or_without_use_is_refused(arguments, words, monkeypatch, capsys, tmp_path):
    """An empty --pulse made a step, and unknown parts were ignored, in silence."""
    monkeypatch.chdir(tmp_path)
    surrogate.save_model(POLES, "m.json")
    monkeypatch.setattr(sys, "argv", ["thermofem", *arguments])
    with pytest.raises(SystemExit) as left:
        cli.main()
    assert left.value.code == 2
    assert words in capsys.readouterr().err
