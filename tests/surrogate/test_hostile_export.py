"""Every writer x every name and text: what somebody else's file says stays inside a comment of the export."""

from __future__ import annotations

import json
import shutil
import subprocess

import hostile
import numpy as np
import pytest

import surrogate
import thermofem as th

MODEL = th.Foster(R=[2e3, 5e3], tau=[5e-8, 1e-6])
MARKS = {"spice": "*", "verilog-a": "//", "csv": "#"}
PROVENANCE = [
    {key: value}
    for text in hostile.texts()
    for key, value in (("geometry", text), ("training", [text]), ("training", text), ("error_bound", text))
]


@pytest.mark.parametrize("to", MARKS)
def test_the_text_of_a_provenance_stays_in_comments(to, tmp_path):
    """Without its comments the export is that of a model without provenance."""
    path = tmp_path / "ring.txt"

    def body(provenance):
        lines = surrogate.export_model(MODEL, path, to=to, provenance=provenance).read_bytes().decode("ascii")
        for odd in "\r\x0b\x0c\x1c\x85\0\x1b":
            assert odd not in lines
        return [line for line in lines.split("\n") if not line.startswith(MARKS[to])]

    plain = body({})
    for provenance in PROVENANCE:
        assert body({"residual_K": 0.1, **provenance}) == plain


@pytest.mark.skipif(shutil.which("ngspice") is None, reason="ngspice is not installed")
def test_ngspice_runs_the_hostile_export_and_nothing_else(tmp_path):
    """A step of 1 mW through the subcircuit gives R_th x 1 mW; no command of the provenance is run."""
    for k, text in enumerate(hostile.texts()):
        provenance = {"residual_K": 0.1, "training": [text], "geometry": text}
        surrogate.export_model(MODEL, tmp_path / f"ring{k}.cir", to="spice", provenance=provenance)
        deck = f"hostile\n.include ring{k}.cir\nI1 0 core 1m\nX1 core 0 ring{k}\n.op\n.print op v(core)\n.end\n"
        (tmp_path / "deck.cir").write_text(deck)
        done = subprocess.run(
            ["ngspice", "-b", "deck.cir"], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
        )
        assert not (tmp_path / "hostile").exists(), repr(text)
        value = next(line.split()[-1] for line in done.stdout.splitlines() if line.strip().startswith("core"))
        assert float(value) == pytest.approx(7.0, rel=1e-6)  # K, R_th = 7 K/mW


def test_a_name_given_twice_is_refused_where_a_model_is_made_or_read(tmp_path):
    """Two pins of one name: exports merged or dropped a channel."""
    eye, one, two = np.eye(2), ("core", "heater"), ("core", "core")
    good = th.StateSpace(eye, -eye, eye, eye, inputs=one, outputs=one)
    path = surrogate.save_model(good, tmp_path / "two.json")
    content = json.loads(path.read_text())
    for which in ("inputs", "outputs"):
        with pytest.raises(th.InputError, match=f"{which} holds 'core' twice; give each once"):
            th.StateSpace(eye, -eye, eye, eye, **{"inputs": one, "outputs": one, which: two})
        path.write_text(json.dumps(content | {which: two}))
        with pytest.raises(th.InputError, match=f"{which} holds 'core' twice"):
            surrogate.load_model(path)
