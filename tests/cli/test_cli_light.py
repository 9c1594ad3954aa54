"""thermofem modes and ring, as a user types them."""

import json
import math

import pytest
from typer.testing import CliRunner

import coupled
import thermofem as th
from thermofem_cli import app

LIGHT = '[light]\nwavelength = "1555 nm"\nloss = "7 dB/cm"\n[[bus]]\ngap = "250 nm"\nstraight = "3 um"\n'
BUS = '[[bus]]\ngap = "250 nm"\nwidth = "400 nm"\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("light")
    strip = th.strip_ring().to_toml()
    rib = th.rib_ring(radius=20e-6).to_toml()
    texts = {
        "strip": strip,
        "lit": strip + LIGHT,
        "unlike": strip + '[light]\nwavelength = "1555 nm"\n' + BUS,
        "wide": th.strip_ring(width=500e-9, radius=20e-6).to_toml(),
        "tight": th.strip_ring(radius=1e-6).to_toml(),
        "near": th.heated_ring(cladding=0.3e-6).to_toml(),
        "thin": th.strip_ring(box=0.7e-6).to_toml(),
        "rib": rib,
        "disc": th.disc().to_toml(),
        "film": strip.replace('material = "SiO2"', 'material = "TiN"', 1),
    }
    for name, text in texts.items():
        (folder / f"{name}.toml").write_text(text)
    return folder


def run(*arguments):
    done = CliRunner().invoke(app, list(map(str, arguments)))
    assert done.exit_code == 0, (done.output, done.exception)
    return done.output


def refused(*arguments):
    done = CliRunner().invoke(app, list(map(str, arguments)))
    assert isinstance(done.exception, th.InputError), (done.output, done.exception)
    return done.exception.for_text()


def test_modes_of_a_file(folder):
    """The wavelength of the file is taken: at 1550 nm n_eff is 2.3555."""
    text = run("modes", folder / "lit.toml", "--figure", folder / "modes.png")
    assert "TE0: n_eff 2.349" in text
    assert "TM0" in text
    assert "the centre of the core" in text
    assert (folder / "modes.png").stat().st_size > 1e4
    numbers = json.loads(run("modes", folder / "strip.toml", "--wavelength", "1555 nm", "--json", "-q"))
    first = numbers["modes"][0]
    assert first["n_eff"] == pytest.approx(2.3487555 + 5e-4, abs=2e-4)  # NGSolve, straight; the bend adds 5e-4
    assert first["volume_3"] == pytest.approx(4.8696e-18, rel=2e-3, abs=0)
    assert numbers["radius"] == pytest.approx(7.955e-6)


def test_a_ring_of_one_file_and_its_map(folder):
    ring = folder / "ring.toml"
    text = run("ring", folder / "lit.toml", "-o", ring)
    assert "the guide holds TE0, TM0; TE0 is taken" in text
    assert "% per nm of gap" in text
    made = coupled.RingResonator.from_toml(ring)
    assert made.drop_rate == 0.0
    kappa = 1 - math.exp(-2 * made.bus_rate * 2 * math.pi * 7.955e-6 * made.group_index / 299792458)
    assert kappa == pytest.approx(0.0523, rel=0.02)  # an independent code
    shown = run("show", ring)
    assert "computed: kappa^2 = 0.052" in shown
    assert "base borghi2021" in shown
    run("reduce", folder / "lit.toml", "--read", "light", "-o", folder / "light.json")
    drive = ("--power", "2 dBm, 8 dBm", "--detuning", "-10 GHz, 10 GHz", "--points", "2, 2")
    run("map", folder / "light.json", "--ring", ring, *drive, "-o", folder / "map.nc")
    assert set(th.load(folder / "map.nc").sizes) >= {"power", "detuning"}


def test_the_order_example(folder):
    given = ("--wavelength", "1555 nm", "--loss", "7 dB/cm", "--gap", "250 nm", "--straight", "3 um")
    numbers = json.loads(run("ring", folder / "strip.toml", *given, "-o", folder / "two.toml", "--json", "-q"))
    origins = numbers["origins"]
    assert origins["drop_rate"]["value"] == origins["bus_rate"]["value"]
    assert origins["bus_rate"]["error"] == 0.2
    assert origins["loss_rate"]["origin"].startswith("given")
    # by hand: kappa^2 0.0523, n_g 4.2914, L 49.98 um, 7 dB/cm at 1549.5 nm; 2 % of kappa^2 between two codes
    assert numbers["loaded_q"] == pytest.approx(7530, rel=0.02)


@pytest.mark.parametrize(
    ("name", "more", "words"),
    [
        ("strip", (), "gap and coupling are missing"),
        ("strip", ("--coupling", "0.7"), "above 0.5"),
        ("strip", ("--gap", "250 nm", "--mode", "TE3"), "TE3"),
        ("strip", ("--gap", "250 nm", "--wavelength", "1.2 um"), "index of 'Si'"),
        ("near", ("--gap", "250 nm"), "'heater' (TiN) lies"),
        ("film", ("--gap", "250 nm"), "'TiN' has no refractive index"),
        ("tight", ("--gap", "250 nm", "--wavelength", "1555 nm", "--mode", "TM0"), "radius"),
        ("unlike", (), "unlike guides"),
    ],
)
def test_what_makes_no_ring_is_said_in_one_line(folder, name, more, words):
    text = refused("ring", folder / f"{name}.toml", *more, "-o", folder / "none.toml")
    assert words in text
    assert "\n" not in text
    assert not (folder / "none.toml").exists()


def test_what_is_in_reach_and_what_the_core_is_are_said(folder):
    assert "dB/cm" in run("modes", folder / "thin.toml")
    assert "'light'" in run("modes", folder / "rib.toml")
    assert "the edge" in run("modes", folder / "disc.toml")
    assert "the guide holds TE0, TM0; TE0" in run(  # not TE1, which leaves the core in the bend
        "ring", folder / "wide.toml", "--gap", "250 nm", "-o", folder / "wide_ring.toml"
    )


def test_tables_that_contradict_the_file(folder):
    strip = th.strip_ring().to_toml()
    for text, words in (
        ('[light]\nwavelength = "1555 nm"\npart = "cor"\n', "did you mean 'core'"),
        ('[light]\nwavelength = "1555"\n', "wavelength"),
        ('[light]\npart = "core"\n', "wavelength is missing"),
        ('[[bus]]\nstraight = "3 um"\n', "gap is missing"),
        ('[[bus]]\ngap = "250 nm"\n' * 3, "one or two"),
        ('[[bus]]\ngap = "250 nm"\nlength = "3 um"\n', "length"),
    ):
        with pytest.raises(th.InputError, match=words):
            th.CrossSection.from_toml_text(strip + text)
