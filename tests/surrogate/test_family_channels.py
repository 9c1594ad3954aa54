"""Studies of a family from one part to another, against static solves and derivatives of the finite elements."""

import json

import numpy as np
import pytest
from scipy import stats
from typer.testing import CliRunner

import surrogate
import thermofem as th
from thermofem.campaign import Variation
from thermofem_cli import app

BOX = "layer.box.thickness"
SPREAD = 20e-9  # m
WITHIN = 1e-2  # tolerance of the family
CHANNEL = {"heated": "heater", "read": "core"}


@pytest.fixture(scope="module")
def family():
    box = Variation("box", (BOX,), "m", low=1.6e-6, high=2.4e-6)
    geometry = th.heated_ring()
    return surrogate.train_family(th.Campaign(geometry.to_toml(), (box,), samples=1), tolerance=WITHIN, held_out=2)


@pytest.fixture(scope="module")
def heat(family):
    """A member on its own mesh."""
    return th.assemble(family.box.geometry(np.array([1.9e-6])))


@pytest.fixture(scope="module")
def files(family, heat, tmp_path_factory):
    folder = tmp_path_factory.mktemp("channels")
    family.save(folder / "family.npz")
    times = np.geomspace(1e-7, 1e-4, 50)
    th.save(th.solve(heat, th.Constant(1e-3), times=times, **CHANNEL), folder / "trace.nc")
    return folder


@pytest.mark.parametrize("channel", [CHANNEL, {"heated": "core", "read": "heater"}, {"heated": "heater"}, {}])
def test_uncertainty_of_a_channel(family, heat, channel):
    found = surrogate.uncertainty(family, {"box": stats.norm(1.9e-6, SPREAD)}, samples=64, **channel)
    heated = channel.get("heated", "core")
    read = channel.get("read", heated)
    assert (found.attrs["heated"], found.attrs["read"]) == (heated, read)
    assert found.attrs["mean"] == pytest.approx(heat.thermal_resistance(heated, read), rel=WITHIN)
    slope = th.derivatives(heat, [BOX], heated=heated, read=read)["thermal_resistance"].item()
    # 5e-2: of a slope of a basis for 1e-2 of the values
    assert found["per_deviation"].item() == pytest.approx(SPREAD * slope, rel=5e-2)


def test_a_function_gets_the_model_of_the_channel(family):
    seen = set()

    def ports(model):
        seen.add((model.inputs, model.outputs))
        return model.thermal_resistance

    surrogate.uncertainty(family, {"box": stats.norm(1.9e-6, SPREAD)}, ports, samples=2, **CHANNEL)
    assert seen == {(("heater",), ("core",))}


def test_design_of_a_channel(family, heat):
    wanted = heat.thermal_resistance("heater", "core")
    found = surrogate.design(family, target={"thermal_resistance": wanted}, **CHANNEL)
    slope = th.derivatives(heat, [BOX], **CHANNEL)["thermal_resistance"].item()
    # the family errs by less than WITHIN of R_th, which is that much of the box
    assert found.values["box"] == pytest.approx(1.9e-6, abs=WITHIN * wanted / slope)
    assert found.thermal_resistance == pytest.approx(wanted, rel=WITHIN)
    assert found.model.inputs + found.model.outputs == ("heater", "core")
    assert found.message.startswith("heater to core: ")


def test_calibrate_on_a_channel(family, files):
    data = th.load(files / "trace.nc")
    found = surrogate.calibrate(family, data, **CHANNEL)
    assert found.values["box"] == pytest.approx(1.9e-6, rel=WITHIN)
    assert found.channel.heated == "heater"
    with pytest.raises(th.InputError, match="data was heated in 'heater', and the members are in 'core'"):
        surrogate.calibrate(family, data)


@pytest.mark.parametrize("study", [surrogate.uncertainty, surrogate.design])
def test_unknown_parts(family, study):
    argument = {"box": stats.norm(1.9e-6, SPREAD)} if study is surrogate.uncertainty else None
    target = {} if study is surrogate.uncertainty else {"target": {"thermal_resistance": 4e3}}
    with pytest.raises(th.InputError, match="read = 'heatr' is unknown; did you mean 'heater'"):
        study(family, argument, read="heatr", **target)


@pytest.mark.parametrize(
    "command",
    [
        ["uncertainty", "family.npz", "--spread", "box=1.9 um,20 nm", "--samples", "16"],
        ["design", "family.npz", "--resistance", "2500 K/W"],
        pytest.param(
            ["design", "family.npz", "--resistance", "2500 K/W", "--rise-time", "1 ns"], marks=pytest.mark.slow
        ),  # a front of 1024 members
        ["calibrate", "family.npz", "trace.nc"],
    ],
)
def test_every_line_names_the_channel(files, command, monkeypatch):
    monkeypatch.chdir(files)
    options = ["--heated", "heater", "--read", "core"]
    done = CliRunner().invoke(app, [*command, *options, "-q"])
    assert done.exit_code == 0, (done.output, done.exception)
    lines = done.output.splitlines()
    assert lines
    assert [line for line in lines if not line.startswith("heater to core: ")] == []
    numbers = json.loads(CliRunner().invoke(app, [*command, *options, "-q", "--json"]).output)
    assert (numbers["heated"], numbers["read"]) == ("heater", "core")
