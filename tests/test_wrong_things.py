"""A thing of the wrong kind where a function wants another: the error says what came and what is needed."""

from __future__ import annotations

import numpy as np
import pytest

import coupled
import surrogate
import thermofem as th

MODEL = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])
TIMES = np.geomspace(1e-9, 1e-5, 30)
DATA = th.dataset.build(TIMES, 1e-3 * MODEL.step_response(TIMES), th.Constant(1e-3), read=("core",))
RING = coupled.borghi2021()
LIGHT = {"power": 1e-3, "detuning": 0.0, "duration": 1e-7}


@pytest.fixture(scope="module")
def heat():
    return th.assemble(th.strip_ring(), accuracy=1e-3)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda fit, heat: surrogate.period_error(fit, MODEL, [1e-6], power=1e-3), "model is a Fit; .* the .model"),
        (lambda fit, heat: surrogate.period_error(MODEL, DATA, [1e-6], power=1e-3), "reference is a Dataset"),
        (lambda fit, heat: surrogate.export_model(fit, "ring.cir", to="spice"), "model is a Fit; .* the .model"),
        (lambda fit, heat: surrogate.save_model(fit, "ring.json"), "a Fit has no JSON form; .* save its .model"),
        (lambda fit, heat: surrogate.reduce(heat), "system is a HeatProblem; .* such as heat.system"),
        (lambda fit, heat: surrogate.fit_foster(DATA, order=2.5), "order = 2.5 must be a whole number"),
        (lambda fit, heat: th.save(MODEL, "ring.nc"), "data is a Foster; .* surrogate.save_model"),
        (lambda fit, heat: coupled.cosimulate(RING, heat, progress=3, **LIGHT), "progress = 3 must be a function"),
        (
            lambda fit, heat: coupled.pulsing_map(RING, MODEL, [1e-3], [0.0], duration=1e-7, progress=3),
            "progress = 3 must be True or False",
        ),
    ],
)
def test_the_wrong_kind_of_thing(call, words, heat, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(th.InputError, match=words):
        call(surrogate.fit_newton(DATA), heat)
    assert not list(tmp_path.iterdir())
