"""What all commands share: numbers as JSON, exit codes, detunings in GHz or pm, seeds, completion in the shell."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from typing import get_type_hints

import pytest
from scipy.constants import c as C  # noqa: N812
from typer.main import get_command
from typer.testing import CliRunner

import coupled
import surrogate
import thermofem as th
from coupled.bar import bar
from thermofem_cli import app
from thermofem_cli.detuning import detuning_of
from thermofem_cli.output import written
from thermofem_cli.runs import doctor

RING = coupled.borghi2021()
COMMANDS = get_command(app).commands
MODEL = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])


def test_doctor_gives_its_checks_as_numbers_and_its_exit_code(monkeypatch):
    done = CliRunner().invoke(app, ["doctor", "--json"])
    numbers = json.loads(done.stdout)
    assert numbers["command"] == "doctor"
    assert set(numbers["checks"]["python"]) == {"ok", "found"}
    assert numbers["checks"]["optional"]["ok"]  # nothing fails without these
    assert all(name in numbers["checks"]["optional"]["found"] for name in ("ffmpeg", "gdsfactory"))
    assert done.exit_code == (0 if numbers["passed"] else 1)
    monkeypatch.setattr("thermofem_cli.doctor.CHECKS", {"python": lambda: ("", "3.11 or newer is needed")})
    done = CliRunner().invoke(app, ["doctor", "--json"])
    assert (json.loads(done.stdout)["passed"], done.exit_code) == (False, 1)


def test_explore_gives_numbers(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    surrogate.save_model(MODEL, "model.json")
    done = CliRunner().invoke(app, ["explore", "model.json", "--detuning", "80 pm", "--json"])
    numbers = json.loads(done.stdout)
    assert numbers["page"] == "ring.html"
    assert numbers["models"] == ["model"]
    assert numbers["detuning"] == pytest.approx(-9.93e9, rel=1e-3, abs=0)  # 80 pm at 1554.3 nm
    assert "wrote ring.html" in done.stderr


def test_every_command_returns_numbers():
    hints = {name: get_type_hints(c.callback).get("return") for name, c in COMMANDS.items()}
    assert len(hints) > 15
    assert get_type_hints(doctor)  # the commands themselves return a dict; what typer calls prints it
    for name, command in COMMANDS.items():
        assert {"--json", "--quiet", "--verbose", "--threads"} <= {o for p in command.params for o in p.opts}, name


@pytest.mark.parametrize(
    ("value", "unit", "error", "text"),
    [
        (2000.5, "K/W", 2.5, "2.0005 ± 0.0025 K/mW"),
        (2000.0, "K/W", 2.04, "2.0000 ± 0.0020 K/mW"),
        (887123.0, "1/s", 23000.0, "887100 ± 23000 1/s"),  # never fewer than four digits
        (558663.0, "1/s", 4200.0, "558700 ± 4200 1/s"),
        (1.2e-6, "s", 3.1e-9, "1.2000 ± 0.0031 us"),
        (1.8e-6, "m", 1e-20, "1.8 ± 1e-14 um"),  # round-off: no row of zeros
        (3.4e-13, "J/K", 0.0, "3.4e-13 ± 0 J/K"),
        (5.0, "", float("inf"), "5 ± inf"),
    ],
)
def test_a_number_ends_where_its_error_does(value, unit, error, text):
    assert written(value, unit, error) == text


def test_results_are_on_standard_output_and_bars_on_standard_error(tmp_path, monkeypatch, capfd):
    """solve, campaign and family printed their results on standard error, map its bar on standard output."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "strip.toml").write_text(th.strip_ring().to_toml())
    done = CliRunner().invoke(app, ["solve", "--duration", "1 us", "--samples", "11"])
    assert done.stderr == ""
    assert [line.split()[0] for line in done.stdout.splitlines()] == ["R_th", "wrote"]
    with bar("map", 2, wanted=True) as advance:
        advance()
    said = capfd.readouterr()
    assert (said.out, "map" in said.err) == ("", True)


def test_titles_say_what_was_heated_and_how(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    titles = []
    monkeypatch.setattr(
        "thermofem.plot.save_figure", lambda ax, path: titles.append(ax.get_title() or ax.get_title("left"))
    )
    (tmp_path / "ring.toml").write_text(th.heated_ring().to_toml())
    surrogate.save_model(
        surrogate.reduce(th.assemble(th.heated_ring(), 1e-2).channels(["core", "heater"]), 1e-2), "m.json"
    )
    solve = ["solve", "ring.toml", "--accuracy", "1e-2", "--figure", "a.png"]
    map_ = ["m.json", "--points", "2,2", "--channel", "core", "--heater", "heater=5 mW", "--figure", "a.png"]
    for arguments in (
        [*solve, "--square", "1 us", "--periodic", "--heated", "core"],
        [*solve, "--heated", "heater", "--read", "core"],
        [*solve, "--heated", "heater", "--read", "core", "--read", "heater", "--pulse", "1 us"],
        ["stability", *map_],
    ):
        done = CliRunner().invoke(app, arguments)
        assert done.exit_code == 0, done.exception
    assert titles[:3] == [
        "core: square wave 2 mW, 1 µs, duty 0.333, one period of the periodic state",
        "core, heater heated: step 2 mW, from rest",
        "heater heated: pulse 2 mW, 1 µs, from rest",
    ]
    assert titles[3].replace("\n", " ").endswith("K/mW, heater at 5 mW")


@pytest.mark.parametrize(
    ("arguments", "former", "name"),
    [
        (["uncertainty", "none.json", "--spread", "box=2 um,1 nm"], "--layer=x", "--interpolate"),
        (["cosimulate"], "--tolerance=x", "--max-discrepancy"),
    ],
)
def test_former_names_of_options_work_and_are_not_listed(arguments, former, name):
    done = CliRunner().invoke(app, [*arguments, former])
    assert name in done.output + str(done.exception)
    assert former[:-2] not in CliRunner().invoke(app, [arguments[0], "--help"]).output


@pytest.mark.parametrize("name", ["design", "uncertainty"])
def test_commands_that_draw_at_random_take_a_seed(name):
    assert "--seed" in {option for p in COMMANDS[name].params for option in p.opts}


@pytest.mark.parametrize(("text", "distance"), [("80 pm", 80e-12), ("-80pm", -80e-12), ("0.1 nm", 1e-10), ("0 pm", 0)])
def test_a_detuning_in_wavelength(text, distance):
    wavelength = C / RING.frequency
    exact = C / (wavelength + distance) - C / wavelength
    assert detuning_of(text, RING) == pytest.approx(exact, rel=1e-4, abs=1.0)  # round-off of f: 2e14 Hz * 1e-16
    # to first order: the next term is distance/wavelength = 6e-5 of it
    assert detuning_of(text, RING) == pytest.approx(-C * distance / wavelength**2, rel=1e-4, abs=1.0)


@pytest.mark.parametrize(("text", "hertz"), [("-10 GHz", -10e9), ("2.5e9 Hz", 2.5e9), ("0 GHz", 0.0)])
def test_a_detuning_in_frequency(text, hertz):
    assert detuning_of(text, RING) == hertz


@pytest.mark.parametrize("text", ["10", "10 mW", "1 um", "-2 um", "far"])
def test_what_is_no_detuning(text):
    with pytest.raises(th.InputError, match="--detuning"):
        detuning_of(text, RING)


COMPLETE = (
    "source <(thermofem --show-completion bash); COMP_WORDS=({}); COMP_CWORD={}; _thermofem_completion thermofem; "
)
BEGUN = {
    "thermofem so": {"solve"},
    "thermofem f": {"fit", "family"},
    "thermofem simulate --de": {"--detuning"},
}


@pytest.fixture
def shell(tmp_path):
    """Environment of a shell that knows the command by its name."""
    start = "import sys; sys.argv[0] = 'thermofem'; from thermofem_cli import main; main()"
    (tmp_path / "thermofem").write_text(f'#!/bin/sh\nexec "{sys.executable}" -c "{start}" "$@"\n')
    (tmp_path / "thermofem").chmod(0o755)
    return {**os.environ, "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
@pytest.mark.parametrize("begun", BEGUN)
def test_bash_completes(begun, shell):
    script = COMPLETE.format(begun, len(begun.split()) - 1) + 'echo "${COMPREPLY[@]}"'
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, env=shell, check=True)
    assert set(done.stdout.split()) == BEGUN[begun], done.stderr


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="a shell script")
@pytest.mark.parametrize("begun", BEGUN)
def test_what_zsh_is_told(begun, shell):
    """The answer to zsh's completion script, without zsh."""
    asked = {"_THERMOFEM_COMPLETE": "complete_zsh", "_TYPER_COMPLETE_ARGS": begun}
    done = subprocess.run(["thermofem"], capture_output=True, text=True, env={**shell, **asked}, check=True)
    assert all(f'"{word}"' in done.stdout for word in BEGUN[begun]), done.stdout
    assert '"map"' not in done.stdout
