"""A model file that somebody changed says so when it is read; one that is whole says nothing."""

from __future__ import annotations

import json

import pytest

import surrogate
import thermofem as th
from thermofem_cli.show_command import show

WORDS = "changed after thermofem wrote it"


@pytest.fixture
def reduced(tmp_path):
    """A model file with a certificate."""
    provenance = {"method": "reduction", "error_bound": 1e-4, "residual_K": 0.1, "geometry": "", "content_hash": "old"}
    provenance |= {"assumed": ["a voltage: 1 V counts as 1 K"], "source": "scope.csv"}
    return surrogate.save_model(th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6]), tmp_path / "m.json", provenance=provenance)


@pytest.mark.parametrize(
    "change",
    [
        lambda tree: tree["poles"][0].update(tau=4e-8),
        lambda tree: tree["provenance"].update(error_bound=1e-9),
        lambda tree: tree["provenance"].update(content_hash={"hash": "x", "entries": 3}),
        lambda tree: tree["provenance"]["content_hash"]["entries"].remove("geometry"),
        lambda tree: tree["provenance"].pop("assumed"),
        lambda tree: tree.update(outputs=["shell"]),
    ],
)
def test_a_changed_model_keeps_no_certificate(change, reduced, caplog):
    """`show` calls no bound proven for time constants that somebody has written in."""
    tree = json.loads(reduced.read_text())
    change(tree)
    reduced.write_text(json.dumps(tree))
    model = surrogate.load_model(reduced)
    assert caplog.text.count(WORDS) == 1
    assert "error_bound" not in model.origin
    card = show(reduced)
    assert card["error_bound"] is card["residual"] is None
    assert "proven" not in card["trusted"]
    surrogate.save_model(model, reduced)  # nor once it is written again
    assert "error_bound" not in th.models.load_provenance(reduced)


def test_a_model_as_it_was_written_keeps_its_certificate(reduced, caplog):
    """Also with notes of its user, in another layout, with 5000.0 as 5000, and written again."""
    tree = json.loads(reduced.read_text())
    tree["provenance"]["mine"] = "chip 7"
    reduced.write_text(json.dumps(tree, sort_keys=True).replace("000.0", "000"))
    surrogate.save_model(surrogate.load_model(reduced), reduced)
    found = th.models.load_provenance(reduced)
    assert (found["error_bound"], found["mine"], "content_hash" in found) == (1e-4, "chip 7", False)
    assert "proven" in show(reduced)["trusted"]
    del tree["provenance"]["content_hash"]  # of an earlier version, or of another program
    reduced.write_text(json.dumps(tree))
    assert surrogate.load_model(reduced).origin["error_bound"] == 1e-4
    assert WORDS not in caplog.text
