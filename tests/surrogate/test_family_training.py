"""Training of families: members on Executors, kept in folders, and what goes wrong on the way."""

from __future__ import annotations

import importlib
import itertools
import logging
import multiprocessing
import os
import pickle
import shutil
import signal
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from test_family import BOX, campaign

import surrogate
import thermofem as th
from surrogate.family.affine_engine import AffineEngine
from surrogate.family.members import MemberModes, Solver
from surrogate.family.moved_mesh_engine import MovedMeshEngine
from surrogate.family.optical_numbers import train_optics
from surrogate.family.parameter_box import Box
from thermofem.campaign import Variation
from thermofem.campaign.stored_tasks import Store, processes

MARKS = [np.array([float(k)]) for k in range(4)]


def modes(number: float) -> MemberModes:
    if number == 2.0:
        raise ArithmeticError("singular")
    return MemberModes(np.array([1e-6, number]), np.array([[1.0, 2.0]]))


def refuse(number: float) -> MemberModes:
    raise AssertionError(f"member {number} was solved again")


@pytest.mark.parametrize("threads", [0, 2])
def test_a_failed_member_is_named_and_the_rest_goes_on(tmp_path, caplog, threads):
    pool = ThreadPoolExecutor(threads) if threads else None
    store = Store(tmp_path / "parts", ".npz")
    with store.opened():
        found = Solver("key", pool, store)(modes, [(float(k),) for k in range(4)], MARKS)
    assert [one is None for one in found] == [False, False, True, False]
    assert "ArithmeticError: singular" in caplog.text
    assert len(store.hashes()) == 3


def deadly(number: float, folder: str) -> MemberModes:
    """A member that takes its process with it: 1 the first time, 3 every time."""
    died = Path(folder, str(number))
    if number == 3.0 or (number == 1.0 and not died.exists()):
        died.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return MemberModes(np.array([1e-6, number]), np.array([[1.0, 2.0]]))


@pytest.mark.slow
def test_a_member_that_kills_its_process_is_tried_once_more(tmp_path, caplog):
    tasks = [(float(k), str(tmp_path)) for k in range(4)]
    with processes(2) as executor:
        solver = Solver("key", executor)
        assert None not in solver(deadly, tasks[:3], MARKS[:3])
        found = solver(deadly, tasks, MARKS)  # meets the broken executor
    assert [one is None for one in found] == [False, False, False, True]
    assert "left out: WorkerDiedError: its worker process was killed twice" in caplog.text


def test_training_goes_on_from_what_is_kept(tmp_path):
    tasks, marks, store = [(0.0,), (1.0,)], MARKS[:2], Store(tmp_path, ".npz")
    refuse.__name__ = "modes"
    with store.opened():
        first = Solver("key", None, store)(modes, tasks, marks)
        again = Solver("key", None, store)(refuse, tasks, marks)
        np.testing.assert_array_equal(again[1].tau, first[1].tau)
        next((tmp_path / "results").iterdir()).write_bytes(b"torn")
        with pytest.raises(th.InputError, match="every member of a batch failed, the last one with AssertionError"):
            Solver("another key", None, store)(refuse, tasks, marks)
        assert Solver("key", None, store)(modes, tasks, marks)[0].tau.size == 2


def test_a_mistake_of_the_user_is_not_a_failed_member():
    def wrong(number: float) -> MemberModes:
        raise th.InputError("the core leaves its cladding")

    with pytest.raises(th.InputError, match="leaves its cladding"):
        Solver("key")(wrong, [(1.0,)], MARKS[:1])


def test_engines_travel_to_other_processes():
    box = Box.of(campaign(BOX))
    for kind in (AffineEngine, MovedMeshEngine):
        engine = kind(box, 1e-2)
        engine.reference.thermal_resistance()  # makes factors, which stay behind
        here, there = (one.heat(box.low) for one in (engine, pickle.loads(pickle.dumps(engine))))
        np.testing.assert_array_equal(there.mesh.points, here.mesh.points)


@pytest.mark.slow
def test_a_kept_training_gives_the_same_family(tmp_path):
    plan = campaign(BOX)
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        first = surrogate.train_family(plan, 1e-2, held_out=2, executor=pool, folder=tmp_path)
    store = Store(tmp_path, ".npz")
    kept = store.hashes()
    assert len(kept) >= 2 + 5  # held out and first batch
    again = surrogate.train_family(plan, 1e-2, held_out=2, folder=tmp_path)
    assert store.hashes() == kept
    np.testing.assert_allclose(again.model(box=2e-6).R, first.model(box=2e-6).R, rtol=1e-12)
    # a file copied over another one's name was believed; a held-out ring in place of one to train on was a traceback
    files = sorted(map(store.path, kept), key=lambda path: path.stat().st_size)
    shutil.copy(files[0], files[-1])
    again = surrogate.train_family(plan, 1e-2, held_out=2, folder=tmp_path)
    np.testing.assert_allclose(again.model(box=2e-6).R, first.model(box=2e-6).R, rtol=1e-12)
    assert store.intact(list(kept)) == set(kept)


@pytest.mark.slow
def test_too_few_members_for_the_tolerance_are_said(caplog, monkeypatch):
    training = importlib.import_module("surrogate.family.train_family")
    monkeypatch.setattr(training, "MOST_BATCHES", 1)
    monkeypatch.setattr(training.Trainer, "_first", lambda self: self.box.middle[None])
    radius = Variation("radius", ("part.core.radius",), "m", low=3e-6, high=20e-6)
    with caplog.at_level(logging.WARNING):
        family = surrogate.train_family(campaign(radius, BOX), 1e-3, held_out=2)
    assert family.error > 1e-3
    assert "more than tolerance = 0.001" in caplog.text


def test_progress_counts_the_members():
    calls = []
    Solver("key", progress=lambda *now: calls.append(now))(modes, [(1.0,), (3.0,)], MARKS[:2], words="light")
    assert calls == [(0, 2, "light"), (1, 2, "light")]


def test_members_without_light_are_counted_by_reason():
    """One line with the most frequent reasons, not one for each of a hundred members."""
    reasons = itertools.cycle(["no mode at 60 nm", "no mode at 60 nm", "no index", "too tight"])

    def no_member(function, tasks, marks, **_):
        return list(itertools.islice(reasons, len(tasks)))

    engine = SimpleNamespace(box=Box.of(campaign(BOX)))
    with pytest.raises(th.InputError) as error:
        train_optics(engine, 0, no_member)
    # middle, two corners, two for each of 7 terms, and 8 that are left out
    count = 1 + 2 + 2 * 7 + 8
    assert f"{count} of {count} members are no rings; 13 said: no mode at 60 nm; 6 said: no index" in str(error.value)
