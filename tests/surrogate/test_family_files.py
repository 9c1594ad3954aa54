"""Family files of any origin: what is damaged or changed is refused when the file is read, in one line."""

from __future__ import annotations

import io
import json

import hostile
import numpy as np
import pytest
from commands import says_one_line

import surrogate
import thermofem as th
from surrogate.family import members

CAMPAIGN = """
[[vary]]
name = "box"
path = "layer.box.thickness"
from = "1.9 um"
to = "2.1 um"
"""


@pytest.fixture(scope="module")
def content(tmp_path_factory):
    folder = tmp_path_factory.mktemp("family")
    (folder / "strip.toml").write_text(th.strip_ring(outer_radius=30e-6, substrate=10e-6).to_toml())
    (folder / "rings.toml").write_text('geometry = "strip.toml"\n' + CAMPAIGN)
    surrogate.train_family(folder / "rings.toml", 5e-2).save(folder / "family.json")
    return (folder / "family.json").read_bytes()


def test_damaged_arrays_are_refused_or_make_members(content, tmp_path):
    """Arrays of another shape or type were believed and ended in tracebacks of NumPy; nan in K in those of LAPACK."""
    path, read = tmp_path / "family.json", 0
    for what, damaged in list(hostile.archives(content))[::2]:
        path.write_bytes(damaged)
        family = says_one_line(lambda: surrogate.load_family(path))
        if family is not None:
            read += 1
            assert np.isfinite(family.model(box=1.95e-6).thermal_resistance), what
            says_one_line(lambda: family.derivatives([1e-6], box=2e-6))  # noqa: B023
    assert read < 40


def test_a_changed_number_is_refused(content, tmp_path):
    """1 % on the stiffness moved every R_th by 1 % without a word."""
    with np.load(io.BytesIO(content)) as file:
        arrays = dict(file)
    arrays["K"] = arrays["K"] * 1.01
    np.savez(tmp_path / "family.npz", **arrays)
    with pytest.raises(th.InputError, match="changed after it was written"):
        surrogate.load_family(tmp_path / "family.npz")


def test_damaged_headers_are_refused_or_make_members(content, tmp_path):
    with np.load(io.BytesIO(content)) as file:
        arrays = {name: file[name] for name in file.files if name != members.HASH}
    header = json.loads(str(arrays.pop("header")))
    for tree in list(hostile.replaced_leaves(header))[::17]:
        (tmp_path / "family.npz").write_bytes(members.pack({"header": np.array(json.dumps(tree)), **arrays}))
        says_one_line(lambda: surrogate.load_family(tmp_path / "family.npz"))


@pytest.mark.parametrize(
    ("name", "value"),
    [("statics", 0), ("statics", -1), ("statics", 10**9), ("tolerance", -1.0), ("factor", -1.0), ("floor", -1.0)],
)
def test_numbers_of_the_header_lie_in_their_range(content, tmp_path, name, value):
    """With no static functions, `uncertainty` printed a mean of 0 K/mW; with -1 and 1e9, a traceback."""
    with np.load(io.BytesIO(content)) as file:
        arrays = {key: file[key] for key in file.files if key != "hash"}
    arrays["header"] = np.array(json.dumps({**json.loads(str(arrays["header"])), name: value}))
    path = tmp_path / "family.json"
    path.write_bytes(members.pack(arrays))
    with pytest.raises(th.InputError, match=name):
        surrogate.load_family(path)


def test_a_family_without_its_hash_is_refused(content, tmp_path):
    """It was believed: a rise of 4e-8 K/mW, or an error of another library."""
    with np.load(io.BytesIO(content)) as file:
        arrays = dict(file)
    del arrays[members.HASH]
    memory = io.BytesIO()
    np.savez_compressed(memory, **arrays)
    path = tmp_path / "family.json"
    path.write_bytes(memory.getvalue())
    with pytest.raises(th.InputError, match=r"family\.json is not a family that thermofem wrote \(it was changed"):
        surrogate.load_family(path)
