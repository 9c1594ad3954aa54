"""A second process for the stages without inputs, since compilation is half of the time of a first run."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from .plan import stages_of
from .settings import Settings
from .stages import Run, Stage, run_stages
from .store import StageStore, key_of

if TYPE_CHECKING:
    from collections.abc import Iterator


def run_all(
    stages: Sequence[Stage], settings: Settings, store: StageStore, console: Console, processes: int = 1
) -> Run:
    """Run the stages; with two processes the second one computes those that stand alone, into the same store.

    What the second process leaves undone is computed here.
    """
    alone = [stage for stage in stages if stage.aside]
    missing = [s.name for s in alone if store.load(s.name, key_of(s.name, s.used(settings), ())) is None]
    if processes < 2 or not missing:
        return run_stages(stages, settings, store, console)
    with _second(settings, store.folder):
        first = run_stages([stage for stage in stages if not stage.aside], settings, store, console)
    found = {**first.results, **run_stages(alone, settings, store, Console(quiet=True)).results}
    return Run({stage.name: found[stage.name] for stage in stages}, (*first.computed, *missing))


@contextmanager
def _second(settings: Settings, folder: Path) -> Iterator[None]:
    """A process that computes the stages that stand alone; the end of the block waits for it, an exception ends it."""
    process = multiprocessing.get_context("spawn").Process(target=_compute, args=(settings, folder), daemon=True)
    process.start()
    try:
        yield
        process.join()
    finally:
        process.terminate()


def _compute(settings: Settings, folder: Path) -> None:
    """What the second process does, until the first one ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # only the first process handles Ctrl-C
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with quiet():
        alone = [stage for stage in stages_of(settings) if stage.aside]
        run_stages(alone, settings, StageStore(folder), Console(quiet=True))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress the warning on the finite domain: the reference stack ends where that of the paper does."""
    log = logging.getLogger("thermofem")
    before = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(before)
