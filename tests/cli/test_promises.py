"""Promises that hold for every command: no input is written over, one line for an error, nothing lost in silence."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer
from commands import thermofem

import surrogate
import thermofem as th
import thermofem_cli as cli
from thermofem.campaign.collection import Folder
from thermofem_cli.apart import OUTPUTS, check_apart
from thermofem_cli.used import USED
from thermofem_cli.values import assigned

MODEL = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])
RING = 'base = "borghi2021"\n[carriers]\nlifetime = "10 ns"\n'
COMMANDS = typer.main.get_command(cli.app).commands


def run(arguments, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["thermofem", *arguments])
    try:
        cli.main()
    except SystemExit as left:
        return left.code, capsys.readouterr()
    return 0, capsys.readouterr()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    surrogate.save_model(MODEL, "model.json")
    Path("ring.toml").write_text(RING)
    Path("strip.toml").write_text(th.strip_ring().to_toml())
    Path("plan.toml").write_text('geometry = "ring.toml"\n')
    Path("circuit.toml").write_text('[[ring]]\nname = "a"\nfile = "../names.toml"\n')
    (tmp_path.parent / "names.toml").write_text(f'file = "{tmp_path.name}/plan.toml"\n')
    return tmp_path


@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_writes_over_a_file_that_it_is_given(command, folder):
    """`map --ring ring.toml -o ring.toml` replaced the ring by the map, `family` the geometry that its file names.

    Every option x every output of a command, for the file itself and for files that name it.
    """
    names = [p.name for p in COMMANDS[command].params]
    for target in OUTPUTS.intersection(names):
        for name in set(names) - OUTPUTS - {"help"}:
            for given in ("ring.toml", [Path("strip.toml"), Path("ring.toml")], "plan.toml", [Path("circuit.toml")]):
                with pytest.raises(th.InputError, match="read and written at once"):
                    check_apart({name: given, target: Path("../") / folder.name / "ring.toml"})


@pytest.mark.parametrize(
    "arguments",
    [
        ["map", "model.json", "--ring", "ring.toml", "-o", "ring.toml"],
        ["map", "model.json", "--ring", "ring.toml", "--resume", "ring.toml"],
        ["stability", "model.json", "--ring", "ring.toml", "-o", "ring.toml"],
        ["uncertainty", "f.json", "--spread", "box=2 um,1 nm", "--ring", "ring.toml", "--map", "ring.toml"],
        ["solve", "strip.toml", "--paraview", "strip.toml"],
        ["family", "plan.toml", "-o", "ring.toml"],
    ],
)
def test_the_commands_ask(arguments, folder, monkeypatch, capsys):
    code, said = run(arguments, monkeypatch, capsys)
    assert code == 2
    assert said.err.count("\n") == 1
    assert "read and written at once" in said.err
    assert Path("ring.toml").read_text() == RING


def test_every_output_is_an_option():
    """A name that no command has any more would hide a forgotten one."""
    assert {p.name for command in COMMANDS.values() for p in command.params} >= OUTPUTS


@pytest.mark.parametrize(
    "arguments",
    [
        ["explore", "model.json", "--heated", "nope"],
        ["simulate", "model.json", "--heater", "core=1 mW"],
        ["map", "model.json", "--points", "2,2", "--heater", "core=1 mW"],
        ["export", "", "--to", "csv"],
        ["export", "/", "--to", "csv"],
        ["family", "plan.toml", "--workers", str(2**62)],
    ],
)
def test_nothing_is_said_before_an_error(arguments, folder, monkeypatch, capsys):
    """ "light and carriers are those of ..." stood above the one line of an error."""
    code, said = run(arguments, monkeypatch, capsys)
    assert code == 2
    assert said.out == ""
    assert said.err.count("\n") == 1


def test_the_ring_is_named_where_there_is_no_error(folder, monkeypatch, capsys):
    code, said = run(["simulate", "model.json", "--duration", "100 ns"], monkeypatch, capsys)
    assert code == 0
    assert "light and carriers are those of the ring 'Borghi 2021'" in said.err


@pytest.mark.parametrize(
    ("texts", "words"),
    [
        (["box=1 um", "box = 2 um"], "--fix 'box' is given twice"),
        (["rate/box=1", "rate / box = 2"], "--fix 'rate/box' is given twice"),
        (["box"], "not of the form NAME=VALUE, such as 'a=1'"),
        (["=1 um"], "not of the form"),
        (["box="], "not of the form"),
    ],
)
def test_names_and_values(texts, words):
    """Of `--spread box=... --spread box=...` the last one won in silence, and so of --fix, --optics and --heater."""
    with pytest.raises(th.InputError, match="--fix") as error:
        assigned("--fix", texts, "a=1")
    assert words in str(error.value)
    assert assigned("--fix", ["a = 1 um", "b=c=d"], "a=1") == {"a": "1 um", "b": "c=d"}


def test_an_option_is_given_once(tmp_path):
    """Of `--power "1 mW" --power "2 mW"` the last one won in silence; flags may be repeated."""
    surrogate.save_model(MODEL, tmp_path / "m.json")
    short = ("simulate", "m.json", "--duration", "1 ns")
    done = thermofem(*short, "--power", "1 mW", "--power=2 mW", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (2, "thermofem: error: --power is given 2 times; give it once\n")
    done = thermofem(*short, "-o", "a.nc", "--output", "b.nc", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (2, "thermofem: error: --output is given 2 times; give it once\n")
    assert sorted(os.listdir(tmp_path)) == ["m.json"]
    assert thermofem(*short, "-q", "--quiet", cwd=tmp_path).returncode == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["solve", "--no-solve", "--preview", "a.png", "-o", "b.nc"], "--output b.nc has no effect with --no-solve"),
        (["solve", "--no-solve", "--preview", "a.png", "--power", "3 mW"], "--power 3 mW has no effect"),
        (["solve", "--square", "1 us", "--periodic", "--duration", "3 us"], "--duration 3 us has no effect"),
        (["design", "f.json", "--resistance", "9 K/mW", "--power", "3 dBm"], "--power 3 dBm goes with --period"),
        (
            ["design", "f.json", "--resistance", "9 K/mW", "--ring", "vanvaerenbergh2012"],
            "--ring vanvaerenbergh2012 goes",
        ),
        (["uncertainty", "f.json", "--spread", "box=2 um,1 nm", "--points", "3, 3"], "--points 3, 3 goes with --map"),
        (["uncertainty", "f.json", "--spread", "box=2 um,1 nm", "--detuning", "3 GHz"], "--detuning 3 GHz goes with"),
        (["uncertainty", "f.json", "--spread", "box=2 um,1 nm", "--period", "--map", "m.nc"], "--period and --map"),
        (
            ["simulate", "model.json", "--sweep", "1 GHz, 2 GHz", "--detuning", "3 GHz"],
            "--detuning 3 GHz has no effect",
        ),
        (["simulate", "model.json", "--sweep", "1 mW, 2 mW", "--power", "3 mW"], "--power 3 mW has no effect"),
        (["explore", "model.json", "--accuracy", "1e-2"], "--accuracy 0.01 is that of a geometry's mesh"),
        (["validate", "model.json", "--reference", "model.json", "--accuracy", "1e-2"], "--accuracy 0.01 is that of"),
    ],
)
def test_no_option_is_ignored(arguments, words, folder):
    """They changed nothing, without a word."""
    done = thermofem(*arguments, cwd=folder)
    assert done.returncode == 2
    assert words in done.stderr
    assert done.stderr.endswith("; leave it out\n")


@pytest.mark.parametrize(
    ("name", "words"), [("strip.toml", "read and written at once"), ("-o", "written twice"), ("--figure", "twice")]
)
def test_the_files_beside_a_pvd_are_outputs(name, words, folder):
    """--paraview heat.pvd wrote heat_0000.vtu over the geometry, or over the training data of that name."""
    shutil.copy(folder / "strip.toml", folder / "heat_0000.vtu")
    given = ["heat_0000.vtu"] if name == "strip.toml" else ["strip.toml", name, "heat_0000.vtu"]
    done = thermofem("solve", *given, "--field-times", "1 us", "--paraview", "heat.pvd", cwd=folder)
    assert (done.returncode, words in done.stderr) == (2, True), done.stderr
    assert (folder / "heat_0000.vtu").read_text() == (folder / "strip.toml").read_text()


def test_an_error_of_the_data_names_their_file(folder):
    """`data.delta_T[2] = nan is not finite` did not say which file."""
    data = th.dataset.build([0.0, 1e-7, 1e-6], [0.0, 1.0, 2.0], th.Constant(1e-3))
    data["delta_T"][2] = np.nan
    data.to_netcdf("data.nc", engine="h5netcdf")
    done = thermofem("fit", "data.nc", cwd=folder)
    assert done.stderr == "thermofem: error: data.nc: data.delta_T[2] = nan is not finite\n"


@pytest.mark.parametrize("name", USED)
def test_rules_of_options_are_about_options_there_are(name):
    known = {option.name for option in COMMANDS[name].params}
    assert not {option for names, _, _ in USED[name] for option in names} - known


def test_optics_are_those_of_the_ring(folder):
    """A slope of tau_n, for a ring with a constant lifetime, was an AttributeError."""
    from thermofem_cli.quantities import optics_of

    with pytest.raises(th.InputError, match="'tau_n' is unknown"):
        optics_of(None, ["tau_n/box=1"], "ring.toml")
    with pytest.raises(th.InputError, match="'1_0'"):
        optics_of(None, ["bus_rate/box=1_0"], "ring.toml")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
@pytest.mark.parametrize("arguments", [["show", "model.json"], ["show", "model.json", "--json"], ["--version"], ["-h"]])
def test_a_full_disk_behind_standard_output_is_an_error(arguments, folder):
    """The numbers were lost with a message of Python's own and exit code 120."""
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "thermofem", *arguments], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("thermofem: error: No space left on device")


def test_closed_streams_change_no_code(folder):
    command = f"{sys.executable} -m thermofem"
    assert os.waitstatus_to_exitcode(os.system(f"{command} show model.json >&- 2>&-")) == 0
    assert os.waitstatus_to_exitcode(os.system(f"{command} show none.json >&- 2>&-")) == 2
    assert json.loads(thermofem("show", "model.json", "--json", cwd=folder).stdout)["command"] == "show"


def test_of_several_files_the_one_at_fault_is_named(folder):
    """`data.delta_T[2] = nan is not finite` did not say which of the files."""
    for name, last in (("good.nc", 2.0), ("bad.nc", np.nan)):
        data = th.dataset.build(1e-7 * np.arange(10), np.arange(10.0), th.Constant(1e-3))
        data["delta_T"][2] = last
        data.to_netcdf(name, engine="h5netcdf")
    done = thermofem("fit", "good.nc", "bad.nc", cwd=folder)
    assert done.stderr == "thermofem: error: bad.nc: data.delta_T[2] = nan is not finite\n"


@pytest.mark.parametrize("name", ["plan.json", "index.nc", "training.nc", "results.sha256"])
def test_a_campaign_does_not_write_over_its_own_file(name, folder):
    """A file of that name in the folder of the campaign was replaced by the list of its geometries."""
    text = 'geometry = "../strip.toml"\n[[drive]]\npower = "1 mW"\n'
    (folder / "made").mkdir()
    (folder / "made" / name).write_text(text)
    done = thermofem("campaign", f"made/{name}", "-o", "made", cwd=folder)
    assert (done.returncode, done.stderr.count("\n"), "another name" in done.stderr) == (2, 1, True), done.stderr
    assert [path.read_text() for path in (folder / "made").iterdir()] == [text]


@pytest.mark.parametrize("name", ["plan.json", "index.nc", "training.nc", "results.sha256"])
def test_a_campaign_writes_over_no_file_of_others(name, folder):
    """The base geometry was called plan.json, in the folder of the results: the list of geometries replaced it."""
    (folder / "made").mkdir()
    text = (folder / "strip.toml").read_text()
    (folder / "made" / name).write_text(text)
    vary = '[[vary]]\npath = "layer.box.thickness"\nfrom = "1.9 um"\nto = "2 um"\ncount = 2\n'
    (folder / "plan.toml").write_text(f'geometry = "made/{name}"\n{vary}[[drive]]\npower = "1 mW"\n')
    done = thermofem("campaign", "plan.toml", "-o", "made", cwd=folder)
    assert done.returncode == 2
    assert done.stderr.endswith(f"made/{name} is no file of a campaign; move it, or take another folder\n"), done.stderr
    assert (folder / "made" / name).read_text() == text


def test_a_plan_that_was_damaged_is_written_again(folder):
    store = Folder(folder / "made")
    with store.opened():
        for content in (b"", b"\0\xff{", b'{"name": "x", "cas', b'{"cases": []}'):
            store.plan.write_bytes(content)
            store.check_ours()
        for content in (b'{"a": 1}', b"[1, 2]", b'a = "x"'):
            store.plan.write_bytes(content)
            with pytest.raises(th.InputError, match="is no file of a campaign"):
                store.check_ours()


@pytest.mark.parametrize("option", [["--pulse", "2 us"], ["--square", "9 us"]])
def test_a_drive_that_the_run_cuts_off_is_noted(option, folder):
    """A pulse that outlasts the run gave the data of a step without a word."""
    for duration, said in (("1 us", True), ("4 us", False)):
        done = thermofem("solve", *option, "--duration", duration, "--samples", "5", cwd=folder)
        assert done.returncode == 0, done.stderr
        assert ("is that of a step" in done.stdout + done.stderr) == said


@pytest.mark.parametrize(
    "option", [["--heater", "core=1 mW pulse 1 us at 20 ns"], ["--modulate", "1 mW pulse 1 us at 10 ns"],
               ["--laser", "1 mW pulse 1 us at 1 s, 0 GHz"]]
)  # fmt: skip
def test_a_pulse_after_the_run_is_refused(option, folder):
    surrogate.save_model(th.Foster(R=[5e3], tau=[1e-6]), folder / "model.json")
    done = thermofem("simulate", "model.json", "--duration", "10 ns", *option, cwd=folder)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "begins after the run of 10 ns" in done.stderr


def test_optics_without_light_are_refused(folder):
    for command, more in (("design", ["--resistance", "9000 K/W"]), ("uncertainty", ["--spread", "box=2 um,1 nm"])):
        done = thermofem(command, "ring.family", *more, "--optics", "bus_rate/box=-1e17", cwd=folder)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert "--optics bus_rate/box=-1e17 goes with --period" in done.stderr


def test_a_full_disk_is_named_where_the_hashes_are_written(folder):
    """The line was written when the file closed, after the result: "No space left on device: standard output"."""
    store = Folder(folder / "made")
    with store.opened():
        os.symlink("/dev/full", store.ledger)
        with pytest.raises(th.InputError, match=r"results\.sha256 cannot be written: No space left"):
            store.write_result("key", b"content")
        assert not store.result("key").exists()
