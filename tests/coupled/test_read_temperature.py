"""The temperature that a ring reads: the rise at rest is R_th of that output times the absorbed power, by every route.

R_th is a static solve of the finite elements, dT = c_read . K^-1 c_heated; the routes go through reductions, cycles and
co-simulation. Silicon under a polymer with dn/dT < 0: the mean over the core is a third of what light sees at first.
"""

import dataclasses
import json
import logging
import shutil
import subprocess

import numpy as np
import pytest
from sections import COVERED, LIGHT
from typer.testing import CliRunner

import coupled
import surrogate
import thermofem as th
from coupled import ring_toml
from coupled.cycles.derivatives import cycle_derivatives
from coupled.equilibria.transmission import sweep
from coupled.explore.contents import Parts, model_of
from coupled.ring_from import tuning
from coupled.unknowns import unknowns
from surrogate.fitting.fit import Training
from thermofem_cli import app

FAINT = {"power": 1e-6, "detuning": -1e9}  # W, Hz: the ring rests
STRONG = {"power": 1e-2, "detuning": 0.0}  # it pulses
ROUND_OFF = 1e-6  # the reduction has R_th exactly; at rest after 100 of the slowest time constants


@pytest.fixture(scope="module")
def heat():
    return th.assemble(th.CrossSection.from_toml_text(COVERED + LIGHT))


@pytest.fixture(scope="module")
def made(heat):
    return coupled.ring_from(heat, coupling=0.05)


@pytest.fixture(scope="module")
def model(heat):
    return surrogate.reduce(heat.system, tolerance=1e-4).model


@pytest.fixture(scope="module")
def core(heat):
    """The model that has the mean over the core only."""
    return surrogate.reduce(heat.channels("core", "core"), tolerance=1e-4).model


def ratio(run):
    """R_th in K/W from the end of a result: rise over absorbed power."""
    rise = np.ravel(run["delta_T"].values)[-1]
    return float(rise / np.ravel(run["absorbed"].values)[-1])


def mean_ratio(cycle):
    """R_th from the means over a period: exact for every linear model in its periodic state."""
    weight = cycle["weight"].values
    return float(weight @ cycle["delta_T"].values / (weight @ cycle["absorbed"].values))


def of_circuit(ring, model, **options):
    chain = coupled.bus([ring, ring])
    return coupled.simulate(chain, model, power={"in": FAINT["power"]}, detuning=0.0, duration=5e-3, rtol=1e-9)


ROUTES = {
    "simulate": lambda ring, model: ratio(coupled.simulate(ring, model, **FAINT, duration=5e-3, rtol=1e-9)),
    "steady states": lambda ring, model: ratio(coupled.steady_states(ring, model, **FAINT)),
    "transmission": lambda ring, model: ratio(coupled.transmission(ring, model, power=1e-6, detuning=(-5e9, 5e9))),
    "sweep": lambda ring, model: ratio(sweep(ring, model, power=1e-6, detuning=[-5e9, 5e9])),
    "cycle": lambda ring, model: mean_ratio(coupled.limit_cycle(ring, model, **STRONG)),
    "circuit": lambda ring, model: ratio(of_circuit(ring, model)),
    "circuit at rest": lambda ring, model: ratio(
        coupled.steady_states(coupled.bus([ring]), model, power={"in": FAINT["power"]}, detuning=-1e9)
    ),
    "page": lambda ring, model: sum(model_of("model", model, Parts(wanted=ring.read))["R"]),
    "identify": lambda ring, model: unknowns(ring, ["bus_rate"], model).model.thermal_resistance,
    "tuning": lambda ring, model: tuning(ring, model)["shift_per_watt"] / ring.shift_per_kelvin,
}


@pytest.mark.parametrize("read", ["core", "light"])
@pytest.mark.parametrize("route", ROUTES)
def test_every_route_reads_what_the_ring_asks_for(route, read, made, model, heat):
    ring = dataclasses.replace(made.ring, read=read)
    # a settled cycle and a trace of 5 ms are integrated to 1e-9, the quadrature of a cycle to 1e-6
    assert ROUTES[route](ring, model) == pytest.approx(heat.thermal_resistance("core", read), rel=2e-6)


def test_the_two_temperatures_differ_here(heat):
    """Otherwise the test above says nothing."""
    assert heat.thermal_resistance("core", "core") < 0.8 * heat.thermal_resistance("core", "light")


def test_cosimulation_reads_the_light(made, heat, model):
    """At rest the finite elements in the loop have their own static solve's ratio; 1e-3 K of a rise of some kelvins."""
    power = 3e-4
    run = coupled.cosimulate(made.ring, heat, power=power, detuning=0.0, duration=2e-6, max_discrepancy=1e-4)
    reduced = coupled.simulate(made.ring, model, power=power, detuning=0.0, duration=2e-6)
    assert run.attrs["read"] == "light"
    assert run.attrs["thermal_resistance"] == heat.thermal_resistance("core", "light")
    assert float(run.delta_T[-1]) == pytest.approx(float(reduced.delta_T[-1]), abs=3e-3 * float(reduced.delta_T.max()))


def test_the_period_of_the_issue(made, model):
    """0.262 us by the first hand-picked channel "light" (issue 50), 3.80 us with the mean over the core."""
    found = coupled.limit_cycle(made.ring, model, **STRONG)
    assert found.attrs["period"] == pytest.approx(0.262e-6, rel=2e-3)  # three digits are printed
    wrong = coupled.limit_cycle(made.ring, model, **STRONG, read="core")
    assert wrong.attrs["period"] == pytest.approx(3.80e-6, rel=2e-3)


def test_a_made_ring_reads_the_light_and_a_typed_one_the_core(made, tmp_path):
    assert made.ring.read == "light"
    assert coupled.borghi2021().read == "core"
    path = tmp_path / "ring.toml"
    path.write_text(made.to_toml())
    assert coupled.RingResonator.from_toml(path) == made.ring
    path.write_text(path.read_text().replace("read = ", "# read = "))
    assert coupled.RingResonator.from_toml(path).read == "core"
    with pytest.raises(th.InputError, match="read = 'middle' is unknown"):
        dataclasses.replace(made.ring, read="middle")


REFUSING = {
    "simulate": lambda ring, core: coupled.simulate(ring, core, **FAINT, duration=1e-6),
    "steady states": lambda ring, core: coupled.steady_states(ring, core, **FAINT),
    "transmission": lambda ring, core: coupled.transmission(ring, core, power=1e-6, detuning=(-5e9, 5e9)),
    "cycle": lambda ring, core: coupled.limit_cycle(ring, core, **STRONG),
    "branch": lambda ring, core: coupled.continue_cycle(ring, core, "power", (9e-3, 1e-2), **STRONG),
    "derivatives": lambda ring, core: cycle_derivatives(ring, core, ["power"], **STRONG),
    "stability map": lambda ring, core: coupled.stability_map(ring, core, [1e-3, 2e-3], [0.0, 1e9]),
    "pulsing map": lambda ring, core: coupled.pulsing_map(ring, core, [1e-3, 2e-3], [0.0, 1e9]),
    "Hopf curves": lambda ring, core: coupled.hopf_curves(ring, core, [1e-3, 2e-3], [0.0, 1e9]),
    "circuit": lambda ring, core: of_circuit(ring, core),
    "page": lambda ring, core: coupled.explore(ring, {"core": core}),
    "export": lambda ring, core: coupled.export_ring(ring, core, "ring.cir"),
}


@pytest.mark.parametrize("route", REFUSING)
def test_a_model_with_the_wrong_temperature_is_refused(route, made, core, tmp_path, monkeypatch):
    """Here the steps differ by more than 20 %."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(th.InputError, match="reads the temperature 'light', and the thermal model gives 'core'"):
        REFUSING[route](made.ring, core)


def test_a_small_difference_is_a_warning_with_its_size(caplog):
    """A strip in oxide: the ratio of both steps against the poles of both, over 1 ns to 1 ms."""
    section = th.strip_ring(substrate=5e-6, outer_radius=20e-6)
    ring = coupled.ring_from(section, wavelength=1.55e-6, loss=46.0, coupling=0.05).ring
    heat = th.assemble(section)
    core = surrogate.reduce(heat.system, tolerance=1e-5).model
    with caplog.at_level(logging.WARNING, logger="thermofem"):
        found = coupled.steady_states(ring, core, **FAINT)
    lit = heat.with_light(th.light(heat, wavelength=1.55e-6).mode())
    light = surrogate.reduce(lit.channels("core", "light"), tolerance=1e-5).model
    times = np.geomspace(1e-9, 1e-3, 200)
    expected = core.step_response(times) / light.step_response(times)
    # the ratio is that of a mesh for 1e-2 of the heat
    assert found.attrs["read_ratio"] == pytest.approx([expected.min(), expected.max()], abs=5e-3)
    assert found.attrs["read"] == "core"
    assert found.attrs["warning"] in caplog.text
    assert "times the wanted step, from 1 ns on" in found.attrs["warning"]


def test_a_model_without_its_geometry_says_that_it_does_not_know(made):
    run = coupled.steady_states(made.ring, th.Foster(R=[5e3], tau=[1e-6]), **FAINT)
    assert "how far they differ is not known" in run.attrs["warning"]
    named = coupled.steady_states(made.ring, th.Foster(R=[5e3], tau=[1e-6], outputs=("light",)), **FAINT)
    assert "warning" not in named.attrs


def test_a_chosen_output_is_used_and_compared(made, model, heat):
    found = coupled.steady_states(made.ring, model, **FAINT, read="core")
    assert ratio(found) == pytest.approx(heat.thermal_resistance("core", "core"), rel=ROUND_OFF)
    assert "'core'" in found.attrs["warning"]


def test_a_fit_of_the_light_keeps_its_name(heat):
    """The light in the guide that is heated is no delayed channel: gains stay positive."""
    data = th.solve(heat, th.Constant(1e-3), times=np.geomspace(1e-9, 1e-4, 60), read="light")
    training = Training.of(data)
    assert not training.transfer
    assert surrogate.fit_foster(data, order=5).model.outputs == ("light",)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ngspice") is None, reason="ngspice is not installed")
def test_spice_reads_the_light(made, model, heat, tmp_path):
    """ngspice at rest: P_drop = 2 gamma_d U of the fixed point with R_th of the light from the static solve."""
    power = 2e-4
    target = coupled.export_ring(made.ring, model, tmp_path / "ring.cir", power=power, detuning=-5e9)
    subprocess.run(["ngspice", "-b", "ring_demo.cir"], cwd=tmp_path, capture_output=True, check=True, timeout=300)
    drop = np.loadtxt(target.with_name("ring_demo.csv"), delimiter=",", skiprows=1)[-1, -1]
    static = th.Foster(R=[heat.thermal_resistance("core", "light")], tau=[1e-6], outputs=("light",))
    wanted = coupled.steady_states(made.ring, static, power=power, detuning=-5e9)
    # 100 us are some ten of the slowest time constant: 1e-3 is left
    assert drop == pytest.approx(float(wanted["drop"][0]), rel=2e-3)


@pytest.mark.slow
def test_files_from_geometry_to_runs(tmp_path, monkeypatch):
    """reduce and ring write files that belong together: simulate, map, stability and explore read the light."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lit.toml").write_text(COVERED + LIGHT)

    def run(*arguments):
        done = CliRunner().invoke(app, [*arguments, "--json", "-q"])
        assert done.exit_code == 0, (done.output, done.exception)
        return json.loads(done.output)

    reduced = run("reduce", "lit.toml", "-o", "fem.json")
    assert reduced["read"] == ["core", "light"]
    run("ring", "lit.toml", "--coupling", "0.05", "-o", "ring.toml")
    plane = ["--power", "0 dBm, 3 dBm", "--detuning", "-5 GHz, 5 GHz", "--points", "2, 2"]
    for command in (
        ["simulate", "fem.json", "--power", "0.1 uW", "--duration", "1 us", "-o", "run.nc"],
        ["map", "fem.json", *plane, "-o", "map.nc"],
        ["stability", "fem.json", *plane, "-o", "stability.nc"],
        ["explore", "fem.json", "-o", "page.html"],
        ["explore", "lit.toml", "-o", "lit.html"],
    ):
        run(*command, "--ring", "ring.toml")
    assert th.load("run.nc").attrs["read"] == "light"
    text = (tmp_path / "lit.html").read_text()
    page = json.loads(text.split('id="data">')[1].split("</script>")[0])
    static = reduced["thermal_resistance"][1][0]
    # the reduction, and five poles trained on its step, which keep R_th
    assert [sum(one["R"]) for one in page["models"][:2]] == pytest.approx([static] * 2, rel=1e-3)
    assert page["reference"]["rise"][-1] == pytest.approx(static, rel=2e-2)  # after 0.1 ms


def of_mode(name):
    """The heat problem of silicon under silica whose output "light" is one mode, and the ring of that mode."""
    heat = th.assemble(th.strip_ring(substrate=5e-6, outer_radius=20e-6))
    mode = th.light(heat, wavelength=1.55e-6).mode(name)
    ring = coupled.ring_from(heat, wavelength=1.55e-6, loss=46.0, coupling=0.05, mode=name).ring
    return heat.with_light(mode), ring


@pytest.fixture(scope="module")
def modes():
    return {name: of_mode(name) for name in ("TE0", "TM0")}


def fitted(heat):
    data = th.solve(heat, th.Constant(1e-3), times=np.geomspace(1e-9, 1e-4, 60), read="light")
    return surrogate.fit_foster(data, order=5)


def from_file(heat, folder):
    path = surrogate.save_model(surrogate.reduce(heat.system, tolerance=1e-3), folder / "fem.json")
    return surrogate.load_model(path)


MADE = {
    "system": lambda heat, folder: heat.system,
    "reduction": lambda heat, folder: surrogate.reduce(heat.system, tolerance=1e-3),
    "fit": lambda heat, folder: fitted(heat),
    "file": from_file,
}


@pytest.mark.parametrize("kind", MADE)
def test_the_light_of_another_mode_is_refused(kind, modes, tmp_path):
    """The ring of TM0 takes its own light and not that of TE0, and the other way round, from every kind of model."""
    for name, other in (("TE0", "TM0"), ("TM0", "TE0")):
        ring = modes[name][1]
        model = MADE[kind](modes[name][0], tmp_path)
        wrong = MADE[kind](modes[other][0], tmp_path)
        run = {"power": 1e-3, "detuning": 0.0, "duration": 1e-9}
        if kind == "system":
            assert "warning" not in coupled.cosimulate(ring, modes[name][0], **run).attrs
            with pytest.raises(th.InputError, match=f"'light' of {name} at 1.55 um, and .* is of {other} at 1.55 um"):
                coupled.cosimulate(ring, wrong, **run)
        else:
            assert "warning" not in coupled.simulate(ring, model, **run).attrs
            with pytest.raises(th.InputError, match=f"'light' of {name} at 1.55 um, and .* is of {other} at 1.55 um"):
                coupled.simulate(ring, wrong, **run)


def test_exports_ask_for_the_mode(modes, tmp_path):
    model = surrogate.reduce(modes["TE0"][0].system, tolerance=1e-3)
    coupled.export_ring(modes["TE0"][1], model, tmp_path / "ring.cir")
    with pytest.raises(th.InputError, match="'light' of TM0"):
        coupled.export_ring(modes["TM0"][1], model, tmp_path / "ring.cir")


def test_a_ring_file_names_the_mode(modes, tmp_path):
    path = tmp_path / "ring.toml"
    ring = modes["TM0"][1]
    path.write_text(ring_toml.write_text(ring, {}))
    assert ring.mode == ("TM0", 1.55e-6)
    assert coupled.RingResonator.from_toml(path) == ring
    path.write_text(path.read_text().replace("mode_wavelength = ", "# mode_wavelength = "))
    with pytest.raises(th.InputError, match="mode and mode_wavelength belong together"):
        coupled.RingResonator.from_toml(path)


def test_the_same_mode_at_another_wavelength_is_compared(heat):
    """At 1.56 um the step of the light is another one: the ratio of R_th by two static solves is within its range."""
    ring = coupled.ring_from(heat, coupling=0.05, wavelength=1.56e-6).ring
    model = surrogate.reduce(heat.system, tolerance=1e-4)
    found = coupled.steady_states(ring, model, **FAINT)
    own = heat.with_light(th.light(heat, wavelength=1.56e-6).mode())
    ratio = heat.thermal_resistance("core", "light") / own.thermal_resistance("core", "light")
    least, most = found.attrs["read_ratio"]
    # the last time is at rest; the mesh of the ratio is one for 1e-2
    assert min(abs(ratio / least - 1), abs(ratio / most - 1)) < 1e-2
    assert "'light' of TE0 at 1.56 um" in found.attrs["warning"]
