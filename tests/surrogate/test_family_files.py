"""Family files of any origin: what is damaged or changed is refused when the file is read, in one line."""

from __future__ import annotations

import io
import json
from pathlib import Path

import hostile
import numpy as np
import pytest
from commands import says_one_line

import surrogate
import thermofem as th
from surrogate.family import members

K = "members.projection.K"  # of the matrices of a family
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
    surrogate.train_family(folder / "rings.toml", 5e-2).save(folder / "family.npz")
    return (folder / "family.npz").read_bytes()


def test_damaged_arrays_are_refused_or_make_members(content, tmp_path):
    """Arrays of another shape or type, and nan in K."""
    path, read = tmp_path / "family.npz", 0
    for what, damaged in list(hostile.archives(content))[::2]:
        path.write_bytes(damaged)
        family = says_one_line(lambda: surrogate.load_family(path))
        if family is not None:
            read += 1
            assert np.isfinite(family.model(box=1.95e-6).thermal_resistance), what
            says_one_line(lambda: family.derivatives([1e-6], box=2e-6))  # noqa: B023
    assert read < 40


def arrays_of(content: bytes) -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(content)) as file:
        return dict(file)


@pytest.mark.parametrize("change", [lambda a: a.update({K: a[K] * 1.01}), lambda a: a.pop("hash")])
def test_a_changed_number_and_a_missing_hash_are_refused(content, tmp_path, change):
    """1 % on the stiffness moves every R_th by 1 %."""
    arrays = arrays_of(content)
    change(arrays)
    np.savez(tmp_path / "family.npz", **arrays)
    with pytest.raises(th.InputError, match=r"family\.npz is not a family that thermofem wrote: it was changed after"):
        surrogate.load_family(tmp_path / "family.npz")


def rewritten(content: bytes, path: Path, header: dict) -> Path:
    """The family with another header, and its hash."""
    arrays = {name: values for name, values in arrays_of(content).items() if name != "hash"}
    path.write_bytes(members.pack(arrays | {"header": np.array(json.dumps(header))}))
    return path


def test_damaged_headers_are_refused_or_make_members(content, tmp_path):
    header = json.loads(str(arrays_of(content)["header"]))
    for tree in list(hostile.replaced_leaves(header))[::17]:
        path = rewritten(content, tmp_path / "family.npz", tree)
        says_one_line(lambda: surrogate.load_family(path))  # noqa: B023


@pytest.mark.parametrize(("name", "value"), [("tolerance", -1.0), ("factor", -1.0), ("floor", -1.0)])
def test_numbers_of_the_header_lie_in_their_range(content, tmp_path, name, value):
    header = json.loads(str(arrays_of(content)["header"]))
    header["family"][name] = value
    with pytest.raises(th.InputError, match=name):
        surrogate.load_family(rewritten(content, tmp_path / "family.npz", header))
