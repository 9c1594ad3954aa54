"""Types as a user's checker sees them: py.typed is there, public calls are typed, wrong calls are found."""

from __future__ import annotations

import subprocess
import sys

import pytest
from paths import ROOT

SCRIPT = """
import coupled
import surrogate
import thermofem as th
from surrogate.fitting.fit_result import Fit
from surrogate.reduction.reduce import Reduction

heat: th.fem.HeatProblem = th.assemble(th.strip_ring(radius=5e-6), accuracy=1e-3)
resistance: float = heat.thermal_resistance("core")
data = th.solve(heat, th.Pulse(power=2e-3, width=1e-6), [0.0, 1e-6])
fit: Fit = surrogate.fit_second_order(data)
model: th.models.ThermalModel = fit.model
kappa: float = fit.parameters["kappa"]
rom: Reduction = surrogate.reduce(heat.system, tolerance=1e-4)
found = coupled.pulsing(coupled.simulate(coupled.borghi2021(), model, power=6e-3, duration=1e-6))
surrogate.export_model(model, "ring.cir", to="spice")
"""
WRONG = {
    'th.strip_ring(radius="5 um")': "arg-type",
    "th.Pulse(power=2e-3, length=1e-6)": "call-arg",
    "surrogate.fit_second_order(th.strip_ring())": "arg-type",
    "surrogate.reduce(heat.system).no_such_thing": "attr-defined",
}


@pytest.mark.parametrize("package", ["thermofem", "surrogate", "coupled"])
def test_every_package_says_that_it_is_typed(package):
    assert (ROOT / package / "py.typed").exists()


@pytest.mark.slow
def test_a_user_s_script_is_checked(tmp_path):
    lines = [f"{line}  # expect {code}" for line, code in WRONG.items()]
    (tmp_path / "script.py").write_text(SCRIPT + "\n".join(lines) + "\n")
    # from the root, with the settings and so the cache of `make types`: seconds instead of half a minute
    command = [sys.executable, "-m", "mypy", "--config-file", "pyproject.toml", str(tmp_path / "script.py")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    ours = [line for line in done.stdout.splitlines() if "script.py:" in line and ": error:" in line]
    first = SCRIPT.count("\n") + 1
    expected = [(first + k, f"[{code}]") for k, code in enumerate(WRONG.values())]
    assert [(int(line.split("script.py:")[1].split(":")[0]), line.split()[-1]) for line in ours] == expected, (
        done.stdout + done.stderr
    )
