"""A second process for the stages that stand aside."""

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
    """Run the stages; with two processes the second one computes those that stand aside, into the same store.

    What the second process leaves undone is computed here.
    """
    aside, keys = [stage for stage in stages if stage.aside], _keys(stages, settings)
    missing = [stage.name for stage in aside if store.load(stage.name, keys[stage.name]) is None]
    if processes < 2 or not missing:
        return run_stages(stages, settings, store, console)
    with _second(settings, store.folder):
        first = run_stages([stage for stage in stages if not stage.aside], settings, store, console)
    found = {**run_stages(_with_inputs(stages), settings, store, Console(quiet=True)).results, **first.results}
    return Run({stage.name: found[stage.name] for stage in stages}, (*first.computed, *missing))


def _keys(stages: Sequence[Stage], settings: Settings) -> dict[str, str]:
    """Key of every stage."""
    keys: dict[str, str] = {}
    for stage in stages:
        keys[stage.name] = key_of(stage.name, stage.used(settings), (keys[name] for name in stage.inputs))
    return keys


def _with_inputs(stages: Sequence[Stage]) -> list[Stage]:
    """The stages aside: first those without inputs, then the inputs of the others, which are stored by then."""
    aside = [stage for stage in stages if stage.aside]
    needed = {name for stage in aside for name in stage.inputs}
    inputs = [stage for stage in stages if stage.name in needed]
    return [*(one for one in aside if not one.inputs), *inputs, *(one for one in aside if one.inputs)]


@contextmanager
def _second(settings: Settings, folder: Path) -> Iterator[None]:
    """A process that computes the stages that stand aside; the end of the block waits for it, an exception ends it."""
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
        run_stages(_with_inputs(stages_of(settings)), settings, StageStore(folder), Console(quiet=True))


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
