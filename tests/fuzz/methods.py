"""Valid calls of the public methods that are no business of `targets.py`: what results and pieces can do."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
from models import coarse_fem, quadratic

import coupled
import surrogate
import thermofem as th

Call = tuple[Callable[..., Any], dict[str, Any]]
PACKAGES = (th, surrogate, coupled)
TWINS = {  # methods that results pass on to their model, whose calls stand in `targets.py`
    "of every model": "channel impedance periodic_response response step_response from_json",
    "of every waveform": "before breakpoints mean check_samples",
}
LEFT = {  # `owner.method`
    "takes seconds": "Campaign.run Family.certify HeatProblem.audit HeatProblem.modal",
    "takes what only other code makes": """Campaign.task Optics.changes Optics.check Family.modal_derivative
        Corrector.advance FEM.begin FEM.revise FEM.background Boundary.exchange""",
    "reads a file; see `readers.py`": """Campaign.from_toml CrossSection.from_toml Circuit.from_toml
        RingResonator.from_text RingResonator.from_toml""",
}


def missing(known: set[str]) -> list[str]:
    """Public methods with an argument that no call in ``known`` has, as "owner.method"."""
    passed_on = set(" ".join(TWINS.values()).split())
    found = set()
    for owner in {one for package in PACKAGES for one in map(package.__dict__.get, package.__all__)}:
        for name in dir(owner) if inspect.isclass(owner) else ():
            method = inspect.unwrap(getattr(owner, name))
            ours = str(getattr(method, "__module__", "")).partition(".")[0] in ("thermofem", "surrogate", "coupled")
            if not name.startswith("_") and name not in passed_on and ours and inspect.isroutine(method):
                bound = inspect.ismethod(method)
                if len(inspect.signature(method).parameters) > (0 if bound else 1):
                    found.add(f"{owner.__name__}.{name}")
    return sorted(found - known - set(" ".join(LEFT.values()).split()))


def calls(heat: th.HeatProblem, family: surrogate.Family, ring: coupled.RingResonator) -> dict[str, Call]:
    """Name -> function, arguments by name."""
    wave, q = th.SquareWave(1e-3, 1e-6, 0.3), quadratic()
    geometry, output_map = heat.geometry, th.OutputMap(th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6]), -4e-4)
    laws = (th.PowerLaw(-1.3), th.Polynomial((1e-3,)), th.Table((200.0, 400.0), (1.0, 2.0)))
    found: dict[str, Call] = {}
    for law in laws:
        name = type(law).__name__
        found |= {
            f"{name}.factor": (law.factor, {"T": [300.0, 350.0]}),
            f"{name}.integral": (law.integral, {"start": 300.0, "rise": [0.0, 50.0]}),
        }
    rom = surrogate.reduce(coarse_fem(), 1e-2)
    cut = surrogate.balanced_truncation(coarse_fem(), 3)
    middle = dict(zip(family.names, map(float, family.box.middle), strict=True))
    return found | {
        "Table.value": (laws[2].value, {"T": [300.0, 350.0]}),
        "CrossSection.on_boundary": (geometry.on_boundary, {"side": "top", "r": [1e-6], "z": [1e-6]}),
        "CrossSection.with_": (geometry.with_, {"values": {"part.core.radius": 8e-6}}),
        "Discretization.state_space": (
            heat.discretization.state_space, {"heated": ("core",), "read": ("core",)}
        ),
        "HeatProblem.domain_error": (heat.domain_error, {"heated": "core", "read": "core"}),
        "HeatProblem.errors": (heat.errors, {"heated": "core", "read": "core"}),
        "HeatProblem.estimate": (lambda channel: heat.estimate(channel), {"channel": ("core", "core")}),
        "HeatProblem.mesh_error": (heat.mesh_error, {"heated": "core", "read": "core"}),
        "HeatProblem.model": (heat.model, {"heated": "core", "read": "core"}),
        "Mesh.save": (heat.mesh.save, {"path": "ring.msh"}),
        "OutputMap.of": (output_map.of, {"z": [0.0, 1.0]}),
        "OutputMap.steady_rise": (output_map.steady_rise, {"power": 1e-3}),
        "PiecewiseCubic.cubics": (th.PiecewiseCubic.of(wave, 0.0, 1e-6).cubics, {"start": 0.0, "stop": 1e-6}),
        "SquareWave.pieces": (wave.pieces, {"start": 0.0, "stop": 1e-6}),
        "Symbols.samples": (th.Symbols([0, 1, 1], 1e6, 1e-3).samples, {"per_node": 2}),
        "Quadratic.rate": (q.rate, {"x": np.zeros(3), "power": 1e-3}),
        "Quadratic.jacobian": (q.jacobian, {"x": np.zeros(3), "power": 1e-3}),
        "Quadratic.states": (q.states, {"wave": wave, "times": [1e-8, 1e-6]}),
        "Quadratic.periodic_states": (q.periodic_states, {"wave": wave, "samples": 11}),
        "Quadratic.steady_rise": (q.steady_rise, {"power": 1e-3}),
        "Quadratic.steady_state": (q.steady_state, {"power": 1e-3}),
        "StateSpace.channel": (heat.system.channel, {"heated": "core", "read": "core"}),
        "Reduction.lift": (rom.lift, {"states": np.zeros(rom.basis.shape[1])}),
        "Reduction.full_states": (rom.full_states, {"wave": wave, "times": [1e-8, 1e-6]}),
        "Truncation.lift": (cut.lift, {"states": np.zeros(3)}),
        "Family.held": (family.held, middle),
        "Family.save": (family.save, {"path": "family.json"}),
        "ConstantLifetime.lifetime": (coupled.ConstantLifetime(1e-9).lifetime, {"density": 1e22}),
        "ShockleyReadHall.lifetime": (ring.carriers.lifetime, {"density": 1e22}),
        "RingResonator.with_rates": (ring.with_rates, {"gamma_i": 1e10}),
        "State.cold": (coupled.State.cold, {"order": 2}),
    }  # fmt: skip
