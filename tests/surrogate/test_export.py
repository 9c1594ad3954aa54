"""Exported models, run by the programs they are for: ngspice, OpenVAF, fmpy, SciPy and pyMOR."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
import scipy.io
from commands import thermofem

import surrogate
import thermofem as th
from surrogate.export import FORMATS
from thermofem.export.export_header import Format

POWER = 2e-3
PULSE, SQUARE = th.Pulse(POWER, 20e-6), th.SquareWave(POWER, 1e-6, 0.3)
PROVENANCE = {"error_bound": 6.4e-5, "mesh_accuracy": 1e-3, "geometry": 'name = "µring"\nouter_radius = "60 um"'}
ONE = th.Foster(R=[75.0, 880.0, 3000.0, 3900.0], tau=[3.4e-9, 1.6e-7, 9e-7, 9e-6])
BENT = th.OutputMap(ONE, 2e-3)  # adds .16 K to 9 K
TRANSFER = th.Foster(R=[-400.0, 1400.0], tau=[2e-7, 5e-6], inputs=("heater",), outputs=("core",))


def two_parts() -> th.StateSpace:
    """A heater over a core over the substrate: heat flows from one to the next."""
    E = np.diag([7.6e-12, 2e-10, 4e-11])
    G = np.array([[9e-4, -5e-4, -1e-4], [-5e-4, 8e-4, -2e-4], [-1e-4, -2e-4, 4e-4]])
    ports = np.eye(3)[:, [0, 2]]
    return th.StateSpace(E, -G, ports, ports.T, inputs=("core", "heater"), outputs=("core", "heater"))


def heat_and_read(model: th.StateSpace, heated: str, read: str) -> th.Foster:
    from thermofem.models import foster

    return foster(model.channel(heated, read))


SOURCES = {
    "pulse": (PULSE, f"PULSE(0 {POWER} 0 1e-13 1e-13 20u 1)", 40e-6),
    "square": (SQUARE, f"PULSE(0 {POWER} 0 1e-13 1e-13 0.3u 1u)", 5e-6),
}


@pytest.fixture
def ngspice():
    program = shutil.which("ngspice")
    if program is None:
        pytest.skip("ngspice is not installed (Debian, Ubuntu: apt-get install ngspice)")
    return program


def simulated(ngspice, folder, wires, read, duration):
    """Times and voltages that ngspice finds."""
    deck = ["* bench", ".include ring.cir", *wires, ".options reltol=1e-6 trtol=1", ".control", f"tran 20n {duration}"]
    deck += [f"wrdata out.txt {' '.join(f'v({node})' for node in read)}", "quit", ".endc", ".end"]
    (folder / "bench.cir").write_text("\n".join(deck) + "\n")
    done = subprocess.run([ngspice, "-b", "bench.cir"], cwd=folder, capture_output=True, text=True, check=False)
    assert (folder / "out.txt").exists(), done.stdout + done.stderr
    table = np.loadtxt(folder / "out.txt")
    return table[:, 0], table[:, 1::2].T


def close(found, exact, error):
    assert np.abs(exact).max() > 0.5  # K: something was heated
    assert np.abs(found - exact).max() < error * np.abs(exact).max()


@pytest.mark.parametrize("drive", SOURCES)
@pytest.mark.parametrize("circuit", ["ring", "ring_cauer"])
def test_ngspice_finds_the_rise_of_the_model(ngspice, tmp_path, drive, circuit):
    wave, source, duration = SOURCES[drive]
    surrogate.export_model(ONE, tmp_path / "ring.cir", to="spice", provenance=PROVENANCE)
    wires = [f"Iheat 0 core {source}", f"Xring core 0 {circuit}"]
    times, (rise,) = simulated(ngspice, tmp_path, wires, ["core"], duration)
    close(rise, ONE.response(wave, times), 1e-4)  # what the header promises


@pytest.mark.parametrize("heated", ["core", "heater"])
def test_ngspice_finds_both_rises_of_a_heater_and_a_core(ngspice, tmp_path, heated):
    model = two_parts()
    surrogate.export_model(model, tmp_path / "ring.cir", to="spice")
    wires = [f"Iheat 0 {heated} {SOURCES['pulse'][1]}", "Xring core heater 0 ring"]
    times, rises = simulated(ngspice, tmp_path, wires, ["core", "heater"], 40e-6)
    for read, rise in zip(("core", "heater"), rises, strict=True):
        close(rise, heat_and_read(model, heated, read).response(PULSE, times), 1e-4)


def test_ngspice_finds_a_transfer_between_two_parts(ngspice, tmp_path):
    surrogate.export_model(TRANSFER, tmp_path / "ring.cir", to="spice")
    wires = [f"Iheat 0 heater {SOURCES['pulse'][1]}", "Xring heater core 0 ring"]
    times, (hot, cold) = simulated(ngspice, tmp_path, wires, ["core", "heater"], 40e-6)
    close(hot, TRANSFER.response(PULSE, times), 1e-4)
    assert np.all(cold == 0)  # heated but not read


def test_ngspice_finds_the_rise_of_an_output_map(ngspice, tmp_path):
    surrogate.export_model(BENT, tmp_path / "ring.cir", to="spice")
    times, (rise,) = simulated(
        ngspice, tmp_path, [f"Iheat 0 core {SOURCES['pulse'][1]}", "Xring core 0 ring"], ["core"], 40e-6
    )
    close(rise, BENT.response(PULSE, times), 1e-4)


@pytest.mark.parametrize("word", ["null", "gnd", "temper", "ac"])
def test_a_part_or_file_named_like_a_word_of_ngspice(ngspice, tmp_path, word):
    """A part called "null" is no ground: 7800 K/W, not 1."""
    named = th.OutputMap(th.Foster(ONE.R, ONE.tau, inputs=(word,), outputs=(word,)), 1e-9)
    for model, path in ((ONE, tmp_path / f"{word}.cir"), (named, tmp_path / "ring.cir")):
        surrogate.export_model(model, path, to="spice")
        name = re.search(r"\.subckt (\w+)", path.read_text())[1]
        path.rename(tmp_path / "ring.cir")
        times, (rise,) = simulated(
            ngspice, tmp_path, [f"Iheat 0 hot {SOURCES['pulse'][1]}", f"Xring hot 0 {name}"], ["hot"], 40e-6
        )
        close(rise, ONE.response(PULSE, times), 1e-4)
        (tmp_path / "out.txt").unlink()


def test_an_output_that_no_pole_reaches_stays_cold(ngspice, tmp_path):
    """Its node reads 0 in SPICE, and its sum is 0 in Verilog-A."""
    model = th.StateSpace(
        np.eye(1),
        -1e6 * np.eye(1),
        np.array([[5e9]]),
        np.array([[1.0], [0.0]]),
        inputs=("core",),
        outputs=("core", "far"),
    )
    surrogate.export_model(model, tmp_path / "ring.cir", to="spice")
    wires = [f"Iheat 0 core {SOURCES['pulse'][1]}", "Xring core far 0 ring"]
    times, (hot, cold) = simulated(ngspice, tmp_path, wires, ["core", "far"], 40e-6)
    close(hot, th.Foster([5e3], [1e-6]).response(PULSE, times), 1e-4)
    assert np.all(cold == 0)
    surrogate.export_model(model, tmp_path / "ring.va", to="verilog-a")
    assert "z__1 = 0;" in (tmp_path / "ring.va").read_text()


def conductances(path, **potentials):
    """Node names, G and C of a compiled Verilog-A module: currents are G v + C dv/dt, linearised at ``potentials``."""
    (module,) = pytest.importorskip("openvaf_py", reason="openvaf-py has no wheel here").compile_va(str(path))
    nodes = [n["name"] if isinstance(n, dict) else str(n) for n in module.get_osdi_descriptor()["nodes"]]
    _, entries = module.run_init_eval({"mfactor": 1.0} | potentials)
    G, C = np.zeros((2, len(nodes), len(nodes)))
    for row, column, resist, react in entries:
        G[row, column] += resist
        C[row, column] += react
    return nodes, G, C


def compiled_impedance(path, pins, frequency):
    """Z(f) between pins of a compiled module, the pin ambient grounded, shape (frequency, read, heated)."""
    nodes, G, C = conductances(path)
    free = [k for k, name in enumerate(nodes) if name != "ambient"]
    at = [[nodes[k] for k in free].index(pin) for pin in pins]
    unit = np.eye(len(free))[:, at]
    part = np.ix_(free, free)
    return np.array([np.linalg.solve(G[part] + 2j * np.pi * f * C[part], unit)[at] for f in frequency])


FREQUENCY = np.geomspace(1e3, 1e9, 13)


def test_the_compiled_verilog_a_module_has_the_impedance_of_the_model(tmp_path):
    path = surrogate.export_model(ONE, tmp_path / "ring.va", to="verilog-a", provenance=PROVENANCE)
    found = compiled_impedance(path, ["core"], FREQUENCY)[:, 0, 0]
    assert found == pytest.approx(ONE.impedance(FREQUENCY), rel=1e-9, abs=0)  # round-off of a 4 by 4 solve


def test_the_compiled_module_of_two_parts_has_all_four_impedances(tmp_path):
    model = two_parts()
    path = surrogate.export_model(model, tmp_path / "ring.va", to="verilog-a")
    found = compiled_impedance(path, ["core", "heater"], FREQUENCY)
    for i, heated in enumerate(model.inputs):
        for j, read in enumerate(model.outputs):
            exact = heat_and_read(model, heated, read).impedance(FREQUENCY)
            assert np.abs(found[:, j, i] - exact).max() < 1e-9 * np.abs(exact).max()


def test_the_compiled_output_map_has_the_slope_of_the_model(tmp_path):
    path = surrogate.export_model(BENT, tmp_path / "ring.va", to="verilog-a")
    rises = {f"V(node__{k},ambient)": float(k) for k in range(1, 5)}
    nodes, G, _ = conductances(path, **rises)
    slope = (BENT.of(10 + 1e-6) - BENT.of(10 - 1e-6)) / 2e-6  # the poles add up to 10 K
    row = [G[nodes.index("flow(pin__0)"), nodes.index(f"node__{k}")] for k in range(1, 5)]
    assert np.abs(row) == pytest.approx(np.full(4, slope), rel=1e-8)  # of the difference quotient


def test_part_names_that_a_simulator_reserves_are_changed(tmp_path):
    model = th.Foster(R=[-1.0, 3e3], tau=[1e-9, 1e-6], inputs=("input",), outputs=("3rd ring+x",))
    text = surrogate.export_model(model, tmp_path / "a module.va", to="verilog-a").read_text()
    assert "module a_module(input_1, n_3rd_ring_x, ambient);" in text


RUN_FMU = """
import json, sys
import numpy as np
from fmpy import read_model_description, simulate_fmu
from fmpy.validation import validate_fmu
problems = validate_fmu("ring.fmu")
about = read_model_description("ring.fmu")
units = {v.name: v.unit for v in about.modelVariables if v.causality in ("input", "output")}
t, p = np.load("drive.npy")
signals = np.array(list(zip(t, p)), dtype=[("time", float), (sys.argv[1], float)])
result = simulate_fmu("ring.fmu", stop_time=8e-6, step_size=5e-8, output_interval=5e-8, input=signals)
table = {name: result[name].tolist() for name in result.dtype.names}
print("RESULT", json.dumps([problems, about.fmiVersion, about.description, units, table]))
"""


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(
    ("model", "heated"),
    [(ONE, "core"), (BENT, "core"), (two_parts(), "heater")],
    ids=["one part", "output map", "two parts"],
)
def test_fmpy_runs_the_unit_and_finds_the_rise_of_the_model(tmp_path, model, heated, fmi):
    surrogate.export_model(model, tmp_path / "ring.fmu", to="fmu", provenance=PROVENANCE, fmi=fmi)
    edges = np.arange(17) * 5e-7
    power = POWER * (np.arange(17) % 3 == 0)
    np.save(tmp_path / "drive.npy", [np.repeat(edges, 2)[1:], np.repeat(power, 2)[:-1]])  # an event at every edge
    done = subprocess.run(
        [sys.executable, "-c", RUN_FMU, f"power_{heated}"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert "RESULT" in done.stdout, done.stdout + done.stderr
    problems, version, description, units, table = json.loads(done.stdout.split("RESULT")[1])
    assert problems == []
    assert "6.4e-05 of the thermal resistance at every frequency" in description
    assert 'ring"' in description
    assert version == f"{fmi}.0"
    assert units == {f"power_{p}": "W" for p in model.inputs} | {f"delta_T_{p}": "K" for p in model.outputs}
    wave = th.Sampled(np.repeat(edges, 2)[1:-1], np.repeat(power[:-1], 2))
    times = np.clip(table["time"], 0, 8e-6)
    for read in model.outputs:
        channel = heat_and_read(model, heated, read) if isinstance(model, th.StateSpace) else model
        close(np.array(table[f"delta_T_{read}"]), channel.response(wave, times), 1e-9)  # exact: round-off of 160 steps


RUN_TWO = """
import json
from fmpy import simulate_fmu
power = {"power_core": 1e-3}
rises = [simulate_fmu(f, stop_time=1e-6, step_size=1e-7, start_values=power)["delta_T_core"][-1] for f in %s]
print("RESULT", json.dumps(rises))
"""


@pytest.mark.parametrize("fmi", [2, 3])
def test_two_units_of_one_name_in_one_host_are_two_models(tmp_path, fmi):
    """Words of C are names like any other, and so are long ones."""
    paths = [tmp_path / "a" / "class.fmu", tmp_path / "b" / "class.fmu", tmp_path / f"{'n' * 240}.fmu"]
    for path, R in zip(paths, (1e3, 5e3, 7e3), strict=True):
        path.parent.mkdir(exist_ok=True)
        surrogate.export_model(th.Foster(R=[R], tau=[1e-8]), path, to="fmu", fmi=fmi)
    code = RUN_TWO % [str(path) for path in paths]
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "RESULT" in done.stdout, done.stdout + done.stderr
    assert json.loads(done.stdout.split("RESULT")[1]) == pytest.approx([1.0, 5.0, 7.0], rel=1e-9)  # round-off


@pytest.mark.parametrize("model", [ONE, two_parts(), TRANSFER], ids=["one part", "two parts", "transfer"])
def test_matrices_in_a_mat_file_are_the_model(tmp_path, model):
    content = scipy.io.loadmat(surrogate.export_model(model, tmp_path / "m.mat", to="mat", provenance=PROVENANCE))
    A, B, C, E = (content[name] for name in "ABCE")
    for i, heated in enumerate(model.inputs):
        for j, read in enumerate(model.outputs):
            exact = (model.channel(heated, read) if isinstance(model, th.StateSpace) else model).impedance(FREQUENCY)
            found = [C[j] @ np.linalg.solve(2j * np.pi * f * E - A, B[:, i]) for f in FREQUENCY]
            assert np.abs(found - exact).max() < 1e-9 * np.abs(exact).max()  # round-off
    assert "6.4e-05" in str(content["header"])


def test_a_mat_file_holds_what_is_not_linear(tmp_path):
    H = np.zeros((2, 2, 2))
    H[0, 1, 1] = 3e3
    model = th.Quadratic(np.diag([-1e6, -1e7]), H, np.full((2, 2), 5.0), np.array([1e9, 2e9]), np.ones(2))
    content = scipy.io.loadmat(surrogate.export_model(model, tmp_path / "q.mat", to="mat"))
    for name, value in {"A": model.A, "H": H, "G": model.G, "B": model.B[:, None], "C": model.C[None]}.items():
        assert np.array_equal(content[name], value)
    assert scipy.io.loadmat(surrogate.export_model(BENT, tmp_path / "o.mat", to="mat"))["coefficient"] == 2e-3
    with pytest.raises(th.InputError, match="a Quadratic is not a set of independent poles"):
        surrogate.export_model(model, tmp_path / "q.cir", to="spice")


def test_pymor_reads_the_mat_file(tmp_path):
    code = "from pymor.models.iosys import LTIModel; m = LTIModel.from_mat_file('m.mat'); f = m.transfer_function"
    code += "; print(abs(f.eval_tf(2j * 3.141592653589793 * 1e6)[0, 0]))"
    surrogate.export_model(ONE, tmp_path / "m.mat", to="mat")
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split()[-1]) == pytest.approx(abs(ONE.impedance(1e6)), rel=1e-9)


def test_the_table_of_poles_adds_up_to_the_gain(tmp_path):
    model = two_parts()
    path = surrogate.export_model(model, tmp_path / "m.csv", to="csv", provenance=PROVENANCE)
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    for i, heated in enumerate(model.inputs):
        for j, read in enumerate(model.outputs):
            total = sum(float(row[f"R {read} from {heated} (K/W)"]) for row in rows)
            assert total == pytest.approx(model.gain[j, i], rel=1e-9)
    assert float(rows[-1]["tau (s)"]) == pytest.approx(heat_and_read(model, "core", "core").tau[-1], rel=1e-9, abs=0)


@pytest.mark.parametrize("to", ["spice", "verilog-a", "csv"])
def test_every_text_says_what_it_is(tmp_path, to):
    text = surrogate.export_model(ONE, tmp_path / "m.txt", to=to, provenance=PROVENANCE).read_text(encoding="utf-8")
    for words in ("4 poles", "7855 K/W", "6.4e-05", "power in W", 'outer_radius = "60 um"', "heated: core"):
        assert words in text


def test_what_a_format_cannot_hold_is_refused(tmp_path):
    with pytest.raises(th.InputError, match="did you mean 'spice'"):
        surrogate.export_model(ONE, tmp_path / "m", to="spicy")
    with pytest.raises(th.InputError, match="fmi = 1 must be a whole number from 2 to 3"):
        surrogate.export_model(ONE, tmp_path / "ring.fmu", to="fmu", fmi=1)
    with pytest.raises(th.InputError, match="not a folder"):
        surrogate.export_model(ONE, tmp_path / "none" / "m.cir", to="spice")
    large = th.StateSpace(np.eye(501), -np.eye(501), np.ones((501, 1)), np.ones((1, 501)))
    with pytest.raises(th.InputError, match="too large for this format, which takes 500"):
        surrogate.export_model(large, tmp_path / "m.cir", to="spice")
    assert not list(tmp_path.iterdir())


def test_the_command_names_the_file_after_the_model(tmp_path):
    surrogate.save_model(ONE, tmp_path / "ring.json", provenance=PROVENANCE)
    done = thermofem("export", "ring.json", "--to", "spice", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, "wrote ring.cir\n"), done.stderr
    assert ".subckt ring_cauer core ambient" in (tmp_path / "ring.cir").read_text()
    assert "6.4e-05" in (tmp_path / "ring.cir").read_text()
    wrong = thermofem("export", "ring.json", "--to", "spcie", cwd=tmp_path)
    assert wrong.returncode == 2
    assert "did you mean 'spice'" in wrong.stderr


def test_an_exporter_is_one_entry_of_the_formats(tmp_path, monkeypatch):
    """Python, the command, its checks and the default name take the format from there."""

    def write(model, target):
        target.path.write_text("\n".join([*target.header, *map(repr, model.tau.tolist())]))
        return target.path

    monkeypatch.setitem(FORMATS, "times", Format(".tau", write))
    surrogate.save_model(ONE, tmp_path / "ring.json", provenance=PROVENANCE)
    path = surrogate.export_model(ONE, tmp_path / "own.tau")
    assert [float(line) for line in path.read_text().splitlines()[-4:]] == ONE.tau.tolist()
    done = thermofem("export", "ring.json", "--to", "times", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, "wrote ring.tau\n"), done.stderr


def test_every_resistor_of_the_verilog_a_module_has_its_thermal_noise(tmp_path):
    """4 k_B T^2/R of a thermal resistor: at 300 K the sum of R_k^2 times it is S_T at rest, by the text of the file."""
    text = surrogate.export_model(ONE, tmp_path / "ring.va", to="verilog-a").read_text()
    found = re.findall(r"white_noise\((.*) \* \$temperature \* \$temperature / (.*), \"heat\"\);", text)
    assert [float(R) for _, R in found] == pytest.approx(sorted(map(float, ONE.R)), rel=1e-12) or len(
        found
    ) == ONE.order
    static = sum(float(unit) * 300.0**2 / float(R) * float(R) ** 2 for unit, R in found)
    expected = float(th.thermal_noise(ONE, [0.0], temperature=300.0)["S_T"][0])
    assert static == pytest.approx(expected, rel=1e-12, abs=0)
