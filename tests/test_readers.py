"""Files of any origin (DESIGN's promises 1, 2, 4 and 5): every reader x every hostile generator, and whole writes."""

from __future__ import annotations

import json
import os
import signal
import stat
import time

import hostile
import numpy as np
import pytest
from commands import says_one_line
from fuzz.readers import fuzz
from reading import READERS, valid

import surrogate
import thermofem as th
from thermofem.data import files
from thermofem.data.quantity import parse

SECONDS = 20.0  # of one reader over one generator on a busy machine; a unit that is computed takes forever
GENERATORS = {
    "trees": hostile.trees(),
    "tomls": hostile.tomls(),
    "units": hostile.units(),
    "numbers": hostile.numbers(),
    "tables": hostile.tables(),
}


@pytest.mark.parametrize("generator", GENERATORS)
@pytest.mark.parametrize("reader", READERS)
def test_a_result_or_one_line(reader, generator, tmp_path):
    begin = time.process_time()
    for text in GENERATORS[generator]:
        says_one_line(lambda: READERS[reader](text, tmp_path))  # noqa: B023 - called at once
    assert time.process_time() - begin < SECONDS


def test_what_is_valid_is_read(tmp_path):
    for name, text in valid(tmp_path).items():
        assert READERS[name](text, tmp_path) is not None


@pytest.mark.parametrize("unit", ["m", "s", "W", "K", ""])
def test_no_quantity_hangs(unit):
    for text in hostile.units():
        with pytest.raises(th.InputError):
            parse(text, unit)


def test_names_are_identifiers_wherever_a_model_is_made_or_loaded(tmp_path):
    content = json.loads(surrogate.save_model(th.Foster(R=[5e3], tau=[1e-6]), tmp_path / "good.json").read_text())
    eye = np.eye(1)
    for name in hostile.names():
        for make in (
            lambda: th.Foster(R=[5e3], tau=[1e-6], inputs=(name,)),  # noqa: B023 - called at once
            lambda: th.StateSpace(eye, -eye, eye, eye, outputs=(name,)),  # noqa: B023
            lambda: th.models.cauer.Cauer([5e3], [2e-10], (name,)),  # noqa: B023
            lambda: th.Part(name, "Si", 1e-6, 2e-6, 0.0, 1e-7),  # noqa: B023
            lambda: th.Layer(name, "Si", 1e-6),  # noqa: B023
        ):
            with pytest.raises(th.InputError):
                make()
        path = tmp_path / "bad.json"
        path.write_text(json.dumps({**content, "inputs": [name]}))
        with pytest.raises(th.InputError) as error:
            surrogate.load_model(path)
        assert "\n" not in str(error.value)


def test_netcdf_that_points_elsewhere_or_declares_too_much(tmp_path):
    for path in hostile.netcdf(tmp_path):
        with pytest.raises(th.InputError) as error:
            th.load(path)
        assert str(error.value).startswith(str(path))


def test_damaged_netcdf_is_read_or_refused_in_one_line(tmp_path):
    data = th.dataset.build(np.linspace(0, 1e-6, 20), np.linspace(0, 5, 20), th.Constant(1e-3))
    content = th.save(data, tmp_path / "good.nc").read_bytes()
    for wrong in hostile.damaged(content, seed=1, count=60):
        (tmp_path / "bad.nc").write_bytes(wrong)
        says_one_line(lambda: th.load(tmp_path / "bad.nc"))


def test_a_file_is_written_whole_and_nothing_else_is_touched(tmp_path):
    """The file has the permissions that any new file has; umask and signal handlers stay as they are while it is
    written."""
    mask = os.umask(0o027)
    try:
        seen = []

        def write(path):
            seen.append([signal.getsignal(one) for one in (signal.SIGTERM, signal.SIGINT)])
            (tmp_path / "made meanwhile").touch()
            path.write_text("whole")

        before = [signal.getsignal(one) for one in (signal.SIGTERM, signal.SIGINT)]
        path = files.write_whole(tmp_path / "a.txt", write)
        assert seen == [before]
        modes = [stat.S_IMODE(one.stat().st_mode) for one in (path, tmp_path / "made meanwhile")]
        assert modes == [0o640, 0o640]
        path.chmod(0o600)
        files.write_whole(path, lambda p: p.write_text("again"))
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
    finally:
        os.umask(mask)


def test_a_write_that_fails_leaves_the_old_file(tmp_path):
    path = files.write_whole(tmp_path / "a.txt", lambda p: p.write_text("old"))

    def write(temporary):
        temporary.write_text("half")
        raise RuntimeError

    with pytest.raises(RuntimeError):
        files.write_whole(path, write)
    assert path.read_text() == "old"
    assert [one.name for one in tmp_path.iterdir()] == ["a.txt"]


def test_a_folder_has_one_owner(tmp_path):
    with (
        files.own_folder(tmp_path, ["inner"]),
        pytest.raises(th.InputError, match="in use by another run"),
        files.own_folder(tmp_path, ["inner"]),
    ):
        pass
    (tmp_path / "inner" / ".a-0123456789abcdef.nc").touch()  # as a killed run leaves it
    with files.own_folder(tmp_path, ["inner"]):
        assert [*(tmp_path / "inner").iterdir()] == []


@pytest.mark.slow
def test_random_edits_of_valid_files(tmp_path):
    """`make fuzz` goes on with other seeds for an hour."""
    assert fuzz(seconds=60, seed=1, folder=tmp_path) == []
