"""Models made in Python keep their geometry and how they were made, in model files and exports."""

from __future__ import annotations

import numpy as np
import pytest

import surrogate
import thermofem as th


@pytest.fixture(scope="module")
def heat():
    return th.assemble(th.strip_ring().with_({"outer_radius": 61e-6}))


def models(heat):
    times = np.geomspace(1e-9, 1e-4, 40)
    data = th.solve(heat, th.Constant(1e-3), times)
    return {
        "the FEM's system, reduced": surrogate.reduce(heat.system, 1e-2),
        "the model of that": surrogate.reduce(heat.system, 1e-2).model,
        "one channel": surrogate.reduce(heat.channels("core", ("core", "box")).channel("core", "box"), 1e-2).model,
        "a truncation": surrogate.balanced_truncation(heat.system, 4).model,
        "the model of a fit": surrogate.fit_foster(data, 3).model,
    }


def test_files_and_exports_know_the_geometry_and_the_method(heat, tmp_path):
    geometry = heat.geometry.to_toml()
    for name, model in models(heat).items():
        surrogate.save_model(model, tmp_path / "model.json")
        provenance = th.models.load_provenance(tmp_path / "model.json")
        assert provenance["geometry"] == geometry, name
        assert provenance["method"], name
        surrogate.export_model(model, tmp_path / "model.cir", to="spice")
        text = (tmp_path / "model.cir").read_text()
        assert 'outer_radius = "61 um"' in text, name
        assert ("misfit" if "fit" in name else "below") in text, name
        again = surrogate.load_model(tmp_path / "model.json")  # and on from the file
        surrogate.export_model(again, tmp_path / "again.cir", to="spice")
        assert 'outer_radius = "61 um"' in (tmp_path / "again.cir").read_text(), name


def test_a_model_by_hand_says_that_nothing_is_recorded(tmp_path):
    surrogate.export_model(th.Foster(R=[1e3], tau=[1e-6]), tmp_path / "model.cir", to="spice")
    assert "geometry: not recorded" in (tmp_path / "model.cir").read_text()
