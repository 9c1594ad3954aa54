"""What all commands share: numbers as JSON, exit codes, quiet output, detunings, completion in the shell."""

from __future__ import annotations

import json
import logging

import pytest
from commands import thermofem
from scipy.constants import c as C  # noqa: N812
from typer.testing import CliRunner

import coupled
import surrogate
import thermofem as th
from thermofem_cli import COMMANDS, app, console
from thermofem_cli.console import written
from thermofem_cli.inputs.ring_drives import detuning_of

RING = coupled.borghi2021()
MODEL = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])


def test_doctor_gives_its_checks_as_numbers_and_its_exit_code(monkeypatch):
    done = CliRunner().invoke(app, ["doctor", "--json"])
    numbers = json.loads(done.stdout)
    assert numbers["command"] == "doctor"
    assert set(numbers["checks"]["python"]) == {"ok", "found"}
    assert done.exit_code == (0 if numbers["passed"] else 1)
    monkeypatch.setattr("thermofem_cli.doctor_command.CHECKS", {"python": lambda: ("", "3.11 or newer is needed")})
    done = CliRunner().invoke(app, ["doctor", "--json"])
    assert (json.loads(done.stdout)["passed"], done.exit_code) == (False, 1)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_takes_the_shared_options(name):
    text = CliRunner().invoke(app, [name, "--help"], env={"COLUMNS": "200"}).output
    assert all(option in text for option in ("--json", "--quiet", "-q", "--verbose", "-v", "--seed", "--threads"))


def test_a_warning_that_is_repeated_is_printed_once_and_counted(capsys):
    """27 warnings that differ by a number, two of another kind, and a single one."""
    console.configure(json=False, quiet=False, verbose=False, threads=None)
    log = logging.getLogger("thermofem.of_a_test")
    for k in range(27):
        log.warning("member %d: the domain error is %.1e", k, 1e-2 / (k + 1))
    for _ in range(2):
        log.warning("the mesh is coarse")
    log.warning("alone")
    console.note_repeated()
    assert capsys.readouterr().err.splitlines() == [
        "member 0: the domain error is 1.0e-02",
        "the mesh is coarse",
        "alone",
        "26 more warnings, alike but for numbers (--verbose prints them): member 0: the domain error is 1.0e-02",
        "1 more warnings, the same: the mesh is coarse",
    ]
    console.configure(json=False, quiet=False, verbose=True, threads=None)
    for k in range(3):
        log.warning("member %d", k)
    console.note_repeated()
    assert capsys.readouterr().err.splitlines() == ["member 0", "member 1", "member 2"]
    console.configure(json=False, quiet=False, verbose=False, threads=None)


def test_json_is_alone_on_standard_output(tmp_path):
    resting = th.Foster(R=[2e3, 2e3], tau=[1e-7, 15e-6])  # has no folds of cycles, which a page takes seconds for
    surrogate.save_model(resting, tmp_path / "model.json")
    done = thermofem("explore", "model.json", "--detuning", "80 pm", "--json", cwd=tmp_path)
    numbers = json.loads(done.stdout)
    assert (numbers["command"], numbers["page"], numbers["models"]) == ("explore", "ring.html", ["model"])
    assert numbers["detuning"] == pytest.approx(-9.93e9, rel=1e-3, abs=0)  # 80 pm at 1554.3 nm
    assert "wrote ring.html" in done.stderr
    quiet = thermofem("explore", "model.json", "--json", "-q", cwd=tmp_path)
    assert (json.loads(quiet.stdout)["command"], quiet.stderr) == ("explore", "")


def test_quiet_hides_messages_and_no_results(tmp_path):
    """-q hides progress and notes; the numbers that are asked for are printed."""
    loud = thermofem("solve", "--duration", "1 us", "--samples", "11", cwd=tmp_path)
    assert [line.split()[0] for line in loud.stdout.splitlines()] == ["R_th", "largest", "wrote"]
    assert "domain_error of up to 3.4e-03, above accuracy = 0.001: the bottom or outer side is too near" in loud.stderr
    quiet = thermofem("solve", "--duration", "1 us", "--samples", "11", "-q", cwd=tmp_path)
    assert (quiet.stdout, quiet.stderr) == (loud.stdout.split("wrote")[0], "")
    surrogate.save_model(MODEL, tmp_path / "model.json")
    run = "simulate", "model.json", "--duration", "0.1 us"
    loud, quiet = thermofem(*run, cwd=tmp_path), thermofem(*run, "-q", cwd=tmp_path)
    assert "light and carriers are those of the ring 'Borghi 2021'" in loud.stderr
    assert (quiet.stdout, quiet.stderr) == (loud.stdout.split("wrote")[0], "")


def test_reduce_names_a_domain_that_ends_too_near(tmp_path):
    """The proven bound is against the FEM, whose finite domain moves R_th by forty times as much."""
    done = thermofem("reduce", "--json", cwd=tmp_path)
    numbers = json.loads(done.stdout)
    assert "domain_error of up to 3.4e-03, above accuracy = 0.001: the bottom or outer side is too near" in done.stderr
    # 3.4e-3: of the same stack with open sides, against the sides at 30 um and 60 um
    here = th.assemble(th.strip_ring()).thermal_resistance()
    beyond = th.assemble(th.strip_ring().opened()).thermal_resistance()
    # 3e-4: each mesh promises 1e-3, and both are of one kind; the difference of the routes is far below
    assert numbers["domain_error"] == pytest.approx(beyond / here - 1, abs=3e-4)


def test_a_number_outside_the_training_is_a_warning(tmp_path):
    """Promise 8."""
    two = th.Quadratic([[-1e6]], [[[0.0]]], [[0.0]], [7e9], [1.0], largest_rise=1.0)
    surrogate.save_model(two, tmp_path / "model.json")
    done = thermofem("simulate", "model.json", "--power", "10 dBm", "--duration", "1 us", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "warning: " in done.stderr


@pytest.mark.parametrize(
    ("value", "unit", "error", "text"),
    [
        (2000.5, "K/W", 2.5, "2.0005 ± 0.0025 K/mW"),
        (2000.0, "K/W", 2.04, "2.0000 ± 0.0020 K/mW"),
        (887123.0, "1/s", 23000.0, "887100 ± 23000 1/s"),  # never fewer than four digits
        (1.8e-6, "m", 1e-20, "1.8 ± 1e-14 um"),  # round-off: no row of zeros
        (5.0, "", float("inf"), "5 ± inf"),
    ],
)
def test_a_number_ends_where_its_error_does(value, unit, error, text):
    assert written(value, unit, error) == text


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
