"""Every kind of thermal model through every function that takes one: file, light, maps, curves, loop, export.

The full-order FEM is the one kind that has no form to be integrated with the optics: there every function raises the
same error, which names what to use instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from models import MODELS, coarse_fem, reduced_fem
from rings import RING

import coupled
import surrogate
import thermofem as th
from thermofem.models import HasModel
from thermofem.models.model_files import KINDS

POWER = 2e-3  # W
SHORT = {"power": POWER, "detuning": -2e9, "duration": 0.5e-6}
FULL_ORDER = ("fem", "fem, diagonalised", "fem, k(T) and c_p(T)")
COMPACT = [name for name in MODELS if name not in FULL_ORDER]


def drive_everything(model):
    """Name and call of every function that integrates a model with the optics or linearizes it."""
    powers, detunings = [2e-3, 6e-3], [-20e9, 0.0]
    return {
        "simulate": lambda: coupled.simulate(RING, model, **SHORT),
        "steady_states": lambda: coupled.steady_states(RING, model, power=POWER),
        "stability_map": lambda: coupled.stability_map(RING, model, powers, detunings),
        "pulsing_map": lambda: coupled.pulsing_map(RING, model, powers, detunings, duration=0.5e-6),
        "fold_curves": lambda: coupled.fold_curves(RING, model, powers, detunings),
        "hopf_curves": lambda: coupled.hopf_curves(RING, model, powers, detunings),
        "transmission": lambda: coupled.transmission(RING, model, power=POWER, detuning=np.array(detunings)),
        "cosimulate": lambda: coupled.cosimulate(RING, coarse_fem(), predictor=model, **SHORT),
        "identify": lambda: coupled.unknowns.unknowns(RING, ["bus_rate"], model),
    }


@pytest.mark.parametrize("name", COMPACT)
def test_a_model_from_its_file_gives_the_same_trace_and_map(name, tmp_path):
    model = MODELS[name]()
    loaded = surrogate.load_model(surrogate.save_model(model, tmp_path / "model.json"))
    times = np.linspace(1e-9, 20e-6, 40)
    assert loaded.step_response(times) == pytest.approx(model.step_response(times), rel=1e-9)  # written to 17 digits
    ours, theirs = (coupled.simulate(RING, m, **SHORT) for m in (model, loaded))
    assert float(theirs.delta_T[-1]) == pytest.approx(float(ours.delta_T[-1]), rel=1e-6)  # the rtol of the runs
    maps = [coupled.stability_map(RING, m, [2e-3, 6e-3], [-20e9, 0.0]) for m in (model, loaded)]
    assert (maps[0].regime == maps[1].regime).all()


@pytest.mark.parametrize("name", COMPACT)
def test_a_model_file_says_where_the_model_comes_from(name, tmp_path):
    """A model read from a file and written again without a word keeps its provenance, whatever its kind."""
    given = {"method": "by hand", "geometry": "name = 'a ring'", "poles": [1, 2.5]}
    once = surrogate.save_model(MODELS[name](), tmp_path / "once.json", provenance=given)
    twice = surrogate.save_model(surrogate.load_model(once), tmp_path / "twice.json")
    assert th.models.load_provenance(twice) == given


@dataclass(frozen=True)
class Scaled(HasModel):
    """The new kind of docs/adding.md without its origin."""

    base: th.Foster
    factor: float

    @property
    def model(self):
        return th.Foster(R=self.factor * self.base.R, tau=self.base.tau)

    def to_json(self):
        return {**self.base.to_json(), "factor": self.factor}

    @classmethod
    def from_json(cls, content):
        return cls(th.Foster.from_json(content), content["factor"])


def test_a_new_kind_needs_no_more_than_its_page_says(tmp_path, monkeypatch):
    monkeypatch.setitem(KINDS, "Scaled", Scaled)
    path = surrogate.save_model(Scaled(MODELS["newton"](), 0.9), tmp_path / "new.json", provenance={"by": "hand"})
    assert surrogate.load_model(path).factor == 0.9


@cache
def alone() -> float:
    """Last temperature of the loop's ring with the reduction of the same FEM."""
    return float(coupled.simulate(RING, reduced_fem(), **SHORT).delta_T[-1])


@pytest.mark.parametrize("name", COMPACT)
def test_every_function_takes_every_compact_model(name):
    model = MODELS[name]()
    found = {function: call() for function, call in drive_everything(model).items()}
    rest = found["steady_states"]
    if rest.regime.values.tolist() == ["stable"]:  # the run from cold ends there
        end = coupled.simulate(RING, model, power=POWER, duration=200e-6).isel(time=-1)
        assert float(end.delta_T) == pytest.approx(float(rest.delta_T[0]), rel=1e-5)
    assert (found["pulsing_map"].regime != "failed").all()
    loop = found["cosimulate"]
    # the predictor decides the work, not the answer: 1 mK of the loop and the reduction's 1e-4 of the rise
    assert float(loop.delta_T[-1]) == pytest.approx(alone(), abs=2e-3)


@pytest.mark.parametrize("name", FULL_ORDER)
def test_the_full_order_fem_is_refused_with_the_way_out(name):
    model = MODELS[name]()
    for function, call in drive_everything(model).items():
        with pytest.raises(th.InputError, match=r"reduce.*coupled\.cosimulate"):
            print(function, call())


@pytest.mark.parametrize("name", COMPACT)
@pytest.mark.parametrize("to", ["mat", "csv", "spice", "verilog-a"])
def test_every_model_is_exported_or_the_error_names_the_kinds_that_are(name, to, tmp_path):
    model = MODELS[name]()
    if to == "mat" or not isinstance(model.dynamics, th.Quadratic):
        assert surrogate.export_model(model, tmp_path / "model.out", to=to).stat().st_size > 0
        return
    with pytest.raises(th.InputError, match="the format mat takes it; the others take Foster, StateSpace"):
        surrogate.export_model(model, tmp_path / "model.out", to=to)


@pytest.mark.parametrize("name", COMPACT)
def test_the_dynamics_are_the_model_itself(name):
    """Exact, not fitted: the step response agrees to round-off,"""
    model, times = MODELS[name](), np.geomspace(1e-9, 1e-4, 50)
    want = model.step_response(times)
    assert model.dynamics.step_response(times) == pytest.approx(want, rel=1e-9)
