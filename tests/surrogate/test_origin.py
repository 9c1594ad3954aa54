"""Models made in Python keep their geometry and how they were made, in model files and exports."""

from __future__ import annotations

import numpy as np
import pytest

import coupled
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


COLD = th.strip_ring(outer_radius=30e-6, substrate=10e-6).with_({"ambient": 77.0}).to_toml().replace('"Si"', '"Si(T)"')
WORDS = "at 77 K the tables of Si(T) (200 to 800 K) are left"


@pytest.fixture(scope="module")
def cold(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cold")
    (folder / "cold.toml").write_text(COLD)
    (folder / "rings.toml").write_text(
        'geometry = "cold.toml"\n[[vary]]\nname = "box"\npath = "layer.box.thickness"\nfrom = "1.9 um"\nto = "2.1 um"\n'
    )
    return folder


def test_a_model_beyond_the_tables_says_so_wherever_it_goes(cold, tmp_path, caplog):
    """At 77 K the laws of k(T) are those at 200 K, the end of their tables: model files and runs on them say so."""
    heat = th.assemble(th.CrossSection.from_toml(cold / "cold.toml"), 1e-2)
    surrogate.save_model(surrogate.reduce(heat.system, 1e-2), tmp_path / "model.json")
    assert WORDS in th.models.load_provenance(tmp_path / "model.json")["warning"]
    caplog.clear()
    model = surrogate.load_model(tmp_path / "model.json")
    run = coupled.simulate(coupled.borghi2021(), model, power=1e-6, detuning=-1e9, duration=1e-8)
    assert WORDS in run.attrs["warning"]
    assert WORDS in caplog.text
    warm = surrogate.reduce(th.assemble(th.strip_ring(outer_radius=30e-6), 1e-2).system, 1e-2)
    assert "warning" not in warm.provenance


def test_members_of_a_family_beyond_the_tables_say_so(cold, tmp_path, caplog):
    trained = surrogate.train_family(cold / "rings.toml", 5e-2)
    assert WORDS in caplog.text
    family = surrogate.load_family(trained.save(tmp_path / "family.npz"))
    for model in (family.model(box=2e-6), family.reduced(box=2e-6)):
        run = coupled.simulate(coupled.borghi2021(), model, power=1e-6, detuning=-1e9, duration=1e-8)
        assert WORDS in run.attrs["warning"]
