"""Stages: pure functions from settings and earlier results to a result, run in order and resumed where they were."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from .settings import Settings
from .store import Result, StageStore, key_of

if TYPE_CHECKING:
    Compute = Callable[["Job"], Result]


@dataclass(frozen=True)
class Job:
    """Input of a stage: settings, the results it needs, and a function that moves the bar."""

    settings: Settings
    inputs: Mapping[str, Result]
    done: Callable[[float], None]


@dataclass(frozen=True)
class Stage:
    """One step of the reproduction.

    name: of its files.
    words: what the bar says.
    compute: of a Job; depends on nothing but the settings and inputs named here.
    inputs: earlier stages.
    uses: fields of Settings.
    weight [s]: about how long it takes.
    quick: whether it belongs to the one-minute version.
    aside: whether a second process may compute it: its inputs have no inputs, and no stage has it as an input.
    """

    name: str
    words: str
    compute: Compute
    inputs: tuple[str, ...] = ()
    uses: tuple[str, ...] = ("accuracy",)
    weight: float = 1.0
    quick: bool = False
    aside: bool = False

    def used(self, settings: Settings) -> dict[str, Any]:
        """Settings that decide the result, by name."""
        return {name: getattr(settings, name) for name in self.uses}


@dataclass(frozen=True)
class Run:
    """Results by stage, and the stages computed in this run; the other results were read from the store."""

    results: Mapping[str, Result]
    computed: tuple[str, ...]


def run_stages(stages: Sequence[Stage], settings: Settings, store: StageStore, console: Console) -> Run:
    """Run the stages in order; results that an earlier run stored under the same keys are read."""
    results: dict[str, Result] = {}
    computed: list[str] = []
    keys: dict[str, str] = {}
    columns = (TextColumn("{task.description:<44}", markup=False), BarColumn(), TimeElapsedColumn(), TextColumn("left"))
    with Progress(*columns, TimeRemainingColumn(), console=console) as progress:
        task = progress.add_task("", total=sum(stage.weight for stage in stages))
        before = 0.0
        for stage in stages:
            progress.update(task, description=stage.words, completed=before)
            key = keys[stage.name] = key_of(stage.name, stage.used(settings), (keys[name] for name in stage.inputs))
            known = store.load(stage.name, key)
            if known is None:
                begin = time.process_time()

                def done(share: float, start: float = before, weight: float = stage.weight) -> None:
                    progress.update(task, completed=start + share * weight)

                inputs = {name: results[name] for name in stage.inputs}
                found = stage.compute(Job(settings, inputs, done))
                known = store.save(stage.name, key, found, time.process_time() - begin)
                computed.append(stage.name)
            results[stage.name] = known
            before += stage.weight
        progress.update(task, description="done", completed=before)
    return Run(results, tuple(computed))
