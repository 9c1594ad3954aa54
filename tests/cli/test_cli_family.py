"""thermofem family, design, uncertainty and calibrate, as a user types them."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

import surrogate
import thermofem as th
from thermofem_cli import app
from thermofem_cli.inputs.command_files import kind_of

CAMPAIGN = """
[[vary]]
name = "box"
path = "layer.box.thickness"
from = "1.5 um"
to = "2.5 um"
"""


def run(*arguments: str) -> str:
    done = CliRunner().invoke(app, list(arguments))
    assert done.exit_code == 0, (done.output, done.exception)
    return done.output


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("family")
    (folder / "strip.toml").write_text(th.strip_ring().to_toml())
    (folder / "rings.toml").write_text('geometry = "strip.toml"\n' + CAMPAIGN)
    run("family", str(folder / "rings.toml"), "-o", str(folder / "family.npz"), "--tolerance", "1e-2")
    return folder


def test_a_campaign_without_drives_becomes_a_family(folder):
    family = surrogate.load_family(folder / "family.npz")
    assert family.names == ("box",)
    assert family.error <= 1e-2


def test_design(folder):
    low, wanted, high = (
        surrogate.load_family(folder / "family.npz").model(box=box * 1e-6).thermal_resistance
        for box in (2.079, 2.1, 2.121)
    )
    geometry = folder / "designed.toml"
    text = run("design", str(folder / "family.npz"), "--resistance", f"{wanted!r} K/W", "-o", str(geometry))
    # the search ends within 2e-3 of the target, and R_th grows nearly as the thickness
    designed = th.CrossSection.from_toml(geometry)
    assert designed.layers[1].thickness == pytest.approx(2.1e-6, rel=3e-3, abs=0)
    assert "reached" in text
    assert "box = 2.1 um" in text
    assert " K/mW, wanted " in text
    (slope,) = re.findall(r"thermal_resistance changes by (\S+) % for 1 % of box", text)
    # a difference over 1 % either way errs by 1e-4, the text by half of its third digit
    assert float(slope) == pytest.approx((high - low) / (0.02 * wanted), rel=1e-2)


def test_a_family_is_no_model(folder):
    with pytest.raises(AssertionError, match="holds a family of rings, not a thermal model; thermofem show, design"):
        run("simulate", str(folder / "family.npz"))


def test_the_card_of_a_family_has_its_ranges_parts_and_errors(folder):
    """The range is that of the campaign file, in its unit; the errors are those of the file."""
    path = folder / "family.npz"
    family = surrogate.load_family(path)
    text = run("show", str(path))
    assert re.search(r"heated : core; read: core$", text, re.MULTILINE)
    assert re.search(r"box : 1.5 um \.\. 2.5 um$", text, re.MULTILINE)
    assert f"over {family.error.count} rings not seen: worst {family.error.worst:.1e}" in text
    numbers = json.loads(run("show", str(path), "--json", "--quiet"))
    assert numbers["ranges"]["box"] == pytest.approx([1.5e-6, 2.5e-6], rel=1e-12, abs=0)
    assert numbers["error"]["worst"] == family.error.worst
    assert "box 1.5 um .. 2.5 um;" in repr(family)


def test_training_names_a_domain_that_ends_too_near(folder):
    """The errors of a family are against its own meshes, whose domain moves R_th by more than the tolerance."""
    asked = ["family", str(folder / "rings.toml"), "-o", str(folder / "finer.npz"), "--tolerance", "2e-3", "--json"]
    done = CliRunner().invoke(app, asked)
    assert "domain_error of up to 3.4e-03, above tolerance = 0.002: the bottom or outer side is too near" in done.stderr
    # the middle of a range is its geometric mean
    middle = th.strip_ring(box=np.sqrt(1.5e-6 * 2.5e-6))
    here = th.assemble(middle, 1e-3).thermal_resistance()
    beyond = th.assemble(middle.opened(), 1e-3).thermal_resistance()
    # 3e-4: as of `thermofem reduce`, against the same stack with open sides
    assert json.loads(done.stdout)["domain_error"] == pytest.approx(beyond / here - 1, abs=3e-4)


def test_a_family_is_known_by_its_content_whatever_its_name(folder):
    named = folder / "mine.rings"
    named.write_bytes((folder / "family.npz").read_bytes())
    assert kind_of(named) == "family"
    np.savez(folder / "mesh.npz", points=np.zeros(3))
    assert kind_of(folder / "mesh.npz") is None


def test_uncertainty(folder):
    text = run("uncertainty", str(folder / "family.npz"), "--spread", "box=2 um,20 nm", "--samples", "64")
    said = re.search(r"box: first-order Sobol index (\S+) \((\S+) \.\. (\S+)\); total (\S+) \((\S+) \.\. (\S+)\)", text)
    index, low, high, *_ = map(float, said.groups())
    assert low <= 1 <= high  # one parameter explains everything
    assert abs(index - 1) < 0.1
    asked = ("uncertainty", str(folder / "family.npz"), "--spread", "box=2 um,20 nm", "--samples", "64")
    numbers = json.loads(run(*asked, "--json", "--quiet"))
    kinds = ["first_order", "first_order_low", "first_order_high", "total_order", "total_order_low", "total_order_high"]
    assert [f"{numbers[kind]['box']:.3f}" for kind in kinds] == list(said.groups())


def test_the_map_of_probabilities_and_the_settled_period(folder):
    spread = ("uncertainty", str(folder / "family.npz"), "--spread", "box=2 um,20 nm")
    drive = ("--power", "3 dBm, 10 dBm", "--detuning", "-20 GHz, 20 GHz", "--points", "3, 4", "--samples", "4")
    text = run(*spread, "--map", str(folder / "map.nc"), *drive)
    assert "of the points pulse" in text
    found = th.load(folder / "map.nc")
    assert found["mean"].dims == ("power", "detuning")
    # at 10 dBm and -6.7 GHz every member pulses, at 3 dBm and -20 GHz none (the map of the paper's ring)
    assert found["mean"].values[2, 1] == 1
    assert found["mean"].values[0, 0] == 0
    text = run(*spread, "--period", "--interpolate", "12", "--samples", "4")
    assert "interpolated between 12 members" in text
    assert "the optics stand still" in text
    assert 600 < float(text.split("mean ")[1].split(" ns")[0]) < 800  # 685 ns at 2 um


def test_targets_that_exclude_each_other(folder):
    text = run("design", str(folder / "family.npz"), "--resistance", "8000 K/W", "--rise-time", "1 us")
    assert "no member that was looked at does that" in text
    assert "that no other beats" in text


def test_the_resistance_of_its_own_mesh(folder):
    numbers = json.loads(run("design", str(folder / "family.npz"), "--rise-time", "1 us", "--json", "--quiet"))
    assert numbers["thermal_resistance"] > 1e3  # of its own mesh, which the text says


def test_calibrate(folder):
    times = np.append(0.0, np.geomspace(2e-9, 50e-6, 60))
    rise = 1e-3 * surrogate.load_family(folder / "family.npz").model(box=1.8e-6).step_response(times)
    th.save(th.dataset.build(times, rise, th.Constant(1e-3)), folder / "trace.nc")
    asked = ("calibrate", str(folder / "family.npz"), str(folder / "trace.nc"))
    assert "box = 1.8 ± " in run(*asked)
    assert run(*asked, "--noise", "10 mK") == run(*asked, "--noise", "0.01")
    assert "± contains the noise only; on its own mesh the family is off by " in run(*asked)
    numbers = json.loads(run(*asked, "--json", "--quiet"))
    assert -1 <= numbers["correlation"] <= 1
    assert 0 < numbers["error"] < 1e-2  # the tolerance of the training


def test_a_table_is_not_calibrated_but_how_to_convert_it_is_said(folder):
    (folder / "scope.csv").write_text("t (s),T (K)\n0,0\n1,1\n")
    done = CliRunner().invoke(app, ["calibrate", str(folder / "family.npz"), str(folder / "scope.csv")])
    with pytest.raises(th.InputError, match=r"thermofem.read_trace\(.*scope.csv', ...\), 'data.nc'"):
        raise done.exception


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("design", "{}/family.npz"), "nothing is wanted"),
        (("design", "{}/family.npz", "--resistance", "9000 K/W", "--fix", "radius=7 um"), "is unknown"),
        (
            ("uncertainty", "{}/family.npz", "--spread", "box=2 um"),
            "not of the form PARAMETER=MEAN, STANDARD DEVIATION",
        ),
        (("calibrate", "{}/family.npz", "{}/none.nc", "--noise", "1 degC"), "difference of temperatures"),
        (("calibrate", "{}/family.npz", "{}/none.nc", "--noise", "nan"), "does not begin with a number"),
        (("design", "{}/rings.toml", "--resistance", "9000 K/W"), "not a family of rings"),
    ],
)
def test_what_cannot_be_done_is_said(folder, arguments, message):
    done = CliRunner().invoke(app, [text.format(folder) for text in arguments])
    assert isinstance(done.exception, th.InputError)
    assert message in str(done.exception)
