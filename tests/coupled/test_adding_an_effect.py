"""What CONTRIBUTING lists is all that a new effect needs: one is added in a copy of the package, and runs there."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
import ring_ode
from paths import ROOT

import coupled
import thermofem as th
from coupled import carriers, resonator, ring_toml, unknowns

MOST_FILES = 17

# Auger recombination, dN/dt = -N/tau - C N^3: by file, what stands and what comes in its place
AUGER = {
    "coupled/kernel/cpp/equations.hpp": [
        ("struct Carriers { double tau0, a, b; };", "struct Carriers { double tau0, a, b, auger; };"),
        ("(c.tau0 * (c.a * N + 1.0));", "(c.tau0 * (c.a * N + 1.0)) - c.auger * (N * N * N);"),
    ],
    "coupled/carriers.py": [
        ("    tau: float\n    a: ClassVar", "    tau: float\n    auger: float = 0.0\n    a: ClassVar"),
        ("    thermal_energy: float\n\n", "    thermal_energy: float\n    auger: ClassVar[float] = 0.0\n\n"),
        ('    "tau": "s",', '    "tau": "s", "auger": "m^6/s",'),
    ],
    "thermofem/data/quantity.py": [
        ('    "m^3/s":', '    "m^6/s": ("an Auger coefficient", "1e-43 m^6/s", ()),\n    "m^3/s":'),
    ],
    "coupled/kernel/units.py": [
        ("    b: float  # m^3/1e23\n", "    b: float  # m^3/1e23\n    auger: float  # 1/ns per 1e46/m^6\n"),
        ("    a: Any\n    b: Any\n", "    a: Any\n    b: Any\n    auger: Any\n"),
        ("        b=ring.carriers.b * DENSITY,\n",
         "        b=ring.carriers.b * DENSITY,\n        auger=ring.carriers.auger * DENSITY**2 * NS,\n"),
        ("Carriers(first.tau0, first.a, first.b)", "Carriers(first.tau0, first.a, first.b, first.auger)"),
    ],
    "coupled/kernel/rates.py": [
        ("(law.tau0 * (1 + law.a * N))", "(law.tau0 * (1 + law.a * N)) + law.auger * N**3"),
    ],
    "coupled/explore/page/ring.mjs": [
        ("g, tau0, a, b, kerr", "g, tau0, a, b, auger, kerr"),
        ("g, tau0, a, b, shift", "g, tau0, a, b, auger, shift"),
        ("law: [tau0, a, b]", "law: [tau0, a, b, auger]"),
        ("{ tau0, a, b })", "{ tau0, a, b, auger })"),
        ("return quotient(", "return sum(product(affine(0, auger, n), product(n, n)), quotient("),
        ("affine(tau0, tau0 * a, n));", "affine(tau0, tau0 * a, n)));"),
        ("const affine =", "const sum = (x, y) => [x[0] + y[0], x[1] + y[1]];\nconst affine ="),
    ],
    "coupled/export/ring_spice.py": [
        ("/(1+{r.a!r}*V(n))\"", "/(1+{r.a!r}*V(n))+{r.auger!r}*V(n)*V(n)*V(n)\""),
    ],
    "coupled/export/ring_verilog_a.py": [
        ("({r.tau0!r} * (1.0 + {r.a!r} * n))\"", "({r.tau0!r} * (1.0 + {r.a!r} * n)) + {r.auger!r} * n * n * n\""),
    ],
    "tests/support/ring_ode.py": [
        ("dN = ring.g_tpa * U * U - N / tau", "dN = ring.g_tpa * U * U - N / tau - ring.carriers.auger * N**3"),
    ],
    "tests/coupled/test_rates.py": [
        ("RINGS = {", 'AUGER = coupled.ConstantLifetime(2e-8, 1e-39)\nRINGS = {'),
        ('"no carriers":', '"Auger": replace(coupled.borghi2021(), carriers=AUGER),\n    "no carriers":'),
    ],
}  # fmt: skip
COMPILED = "coupled/explore/page/kernel.wasm"

RUN = """
import shutil
import subprocess
from dataclasses import replace
import numpy as np
import coupled, ring_ode
import thermofem as th
from coupled.kernel import library
from coupled.ring_toml import write_text

library.build(library.HERE / library.NAME, ("-O0",))
tau, C, first = 20e-9, 1e-39, 4e23
ring = replace(coupled.borghi2021(), carriers=coupled.ConstantLifetime(tau, C))
assert coupled.RingResonator.from_text(write_text(ring, {})) == ring
heat = th.Foster(R=[7e3], tau=[1e-6])
start = coupled.State(field=0.0, carriers=first, thermal=[0.0])
run = coupled.simulate(ring, heat, power=0.0, detuning=0.0, duration=60e-9, initial=start, rtol=1e-8)
t = run["time"].values
decay = np.exp(-t / tau)
exact = first * decay / np.sqrt(1 + C * tau * first**2 * (1 - decay**2))  # Bernoulli's equation for 1/N^2
print("decay", np.max(np.abs(run["carriers"].values / exact - 1)))
light = {"power": 1e-3, "detuning": -5e9}
points = coupled.steady_states(ring, heat, **light)
for k in range(points.sizes["branch"]):
    y = ring_ode.state_at(points.isel(branch=k), ring, heat, **light)
    slopes = ring_ode.right_hand_side(y, ring, heat, **light)
    print("balance", np.max(np.abs(slopes[2:] / y[2:])) * tau)
strong = replace(ring, carriers=coupled.ConstantLifetime(tau, 1e-36))
light = {"power": 3e-3, "detuning": -30e9}
drops = [coupled.steady_states(one, heat, **light)["drop"].item() for one in (ring, strong)]
assert abs(drops[0] / drops[1] - 1) > 0.01  # 30 times the error of the simulator
coupled.export_ring(strong, heat, "strong.va")
coupled.export_ring(strong, heat, "strong.cir", **light)
if program := shutil.which("ngspice"):
    subprocess.run([program, "-b", "strong_demo.cir"], check=True, capture_output=True)
    print("spice", abs(np.loadtxt("strong_demo.csv", delimiter=",", skiprows=1)[-1, 1] / drops[1] - 1))
"""


def numbered(heading: str) -> set[str]:
    """Files in backticks that begin the items of the numbered list below a line of CONTRIBUTING.md."""
    text = (ROOT / "CONTRIBUTING.md").read_text().partition(heading)[2].partition("\n\n")[2]
    items = text.partition("\n\n")[0]
    return set(re.findall(r"^\d+\. `([^`]+)`", items, re.MULTILINE))


def test_the_list_of_files_is_that_of_the_effect():
    """Each place that the effect changes stands once in its file; with the compiled kernel of the page there are 11."""
    assert numbered("A new effect of light or carriers") == {*AUGER, COMPILED}
    assert len(AUGER) + 1 <= MOST_FILES
    for name, changes in AUGER.items():
        text = (ROOT / name).read_text()
        for before, _ in changes:
            assert text.count(before) == 1, (name, before)


@pytest.mark.slow
def test_an_effect_is_added_in_those_files(tmp_path):
    """Auger recombination: the decay of carriers is exact, and each derivative is that of the compiled equations."""
    for folder in ("coupled", "thermofem"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    for name in ("tests/support/ring_ode.py", "tests/coupled/test_rates.py"):
        target = tmp_path / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, target)
    for name, changes in AUGER.items():
        text = (tmp_path / name).read_text()
        for before, after in changes:
            text = text.replace(before, after)
        (tmp_path / name).write_text(text)
    paths = [tmp_path, tmp_path / "tests/support", ROOT]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, paths))}
    run = [sys.executable, "-c", RUN]
    rates = [sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", "tests/coupled/test_rates.py"]
    done = subprocess.run(run, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    lines = [line.split() for line in done.stdout.splitlines()]
    assert {name for name, _ in lines} >= {"decay", "balance"}
    for name, error in lines:
        # steps of rtol 1e-8 add up to some of it; a fixed point is one of rates to round-off, in shares of N/tau;
        # ngspice runs at reltol 1e-4
        assert float(error) < {"decay": 1e-6, "balance": 1e-9, "spice": 3e-4}[name]
    done = subprocess.run(rates, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


@dataclass(frozen=True)
class SurfaceRecombination:
    """A law of today's form: a constant tau0 = w/(2 S), of a width over twice a surface velocity."""

    velocity: float
    tau_width: float
    a: ClassVar[float] = 0.0
    b: ClassVar[float] = 0.0

    @property
    def tau0(self) -> float:
        return self.tau_width / self.velocity


def test_a_law_of_todays_form_is_one_class(monkeypatch):
    """Three files: its class with `LAWS` and `UNITS` in carriers.py, and its name in two lists of public names."""
    assert numbered("A law of recombination") == {
        "coupled/carriers.py", "coupled/__init__.py", "docs/api_groups.toml",
    }  # fmt: skip
    laws = (*carriers.LAWS, SurfaceRecombination)
    for module in (carriers, resonator):
        monkeypatch.setattr(module, "LAWS", laws)
    for name, unit in (("velocity", ""), ("tau_width", "s")):
        monkeypatch.setitem(carriers.UNITS, name, unit)
    law = SurfaceRecombination(velocity=2.0, tau_width=10e-9)
    made = replace(coupled.borghi2021(), carriers=law)
    again = coupled.RingResonator.from_text(ring_toml.write_text(made, {}))
    assert again == made
    assert unknowns.varied(made, {"tau0": 8e-9}).carriers == SurfaceRecombination(2.0, 16e-9)
    heat = th.Foster(R=[7e3], tau=[1e-6])
    light = {"power": 2e-3, "detuning": -1e10}
    points = coupled.steady_states(made, heat, **light)
    y = ring_ode.state_at(points.isel(branch=0), made, heat, **light)
    slopes = ring_ode.right_hand_side(y, made, heat, **light)
    assert np.abs(slopes[2] * law.tau0 / y[2]) < 1e-10  # a fixed point, to round-off
