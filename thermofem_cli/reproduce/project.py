"""The folder of a reproduction and the tasks on it: stages to compute, figures and a page to draw."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Literal, NamedTuple

from thermofem import checks
from thermofem.data import files

from .settings import Settings
from .stages import Job, Stage
from .store import Result, StageStore, key_of
from .written import TABLE, Written

Done = Callable[[float], None]


class WorkItem(NamedTuple):
    """A stage, a figure or the page that computes: what one process does at one go.

    kind: the method of `Project` that does it.
    name: of the stage or the file.
    words: what the bar says.
    weight [s]: about how long it takes.
    inputs: stages whose results it needs.
    """

    kind: Literal["compute", "draw", "explore"]
    name: str
    words: str
    weight: float
    inputs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Project:
    """The folder of a reproduction, its stages in order, and the results that this process knows."""

    out: Path
    settings: Settings
    stages: tuple[Stage, ...]
    results: dict[str, Result] = field(default_factory=dict)

    @cached_property
    def store(self) -> StageStore:
        """Results on disk."""
        return StageStore(self.out / "data", self.written.add)

    @cached_property
    def written(self) -> Written:
        """The files that reproductions wrote here."""
        return Written(self.out)

    @property
    def ring(self) -> Path:
        """The page that computes."""
        return self.out / "ring.html"

    @property
    def report(self) -> Path:
        """The report."""
        return self.out / "report.html"

    @property
    def table(self) -> Path:
        """The report's table, for programs."""
        return self.store.folder / TABLE

    def figure(self, name: str) -> Path:
        """A panel of the report."""
        return self.out / "figures" / name

    def check(self, figures: Iterable[str]) -> None:
        """InputError where files of others have the names of the figures, the pages, the table, or begin as a stage."""
        starts = tuple(f"{stage.name}." for stage in self.stages)
        data = [path for path in sorted(self.store.folder.glob("*.*")) if path.name.startswith(starts)]
        kept = [path for path in data if path.suffix in (".nc", ".json")]
        self.written.check([self.report, self.ring, self.table, *kept, *map(self.figure, figures)])

    @cached_property
    def keys(self) -> dict[str, str]:
        """Key of every stage."""
        keys: dict[str, str] = {}
        for stage in self.stages:
            keys[stage.name] = key_of(stage.name, stage.used(self.settings), (keys[name] for name in stage.inputs))
        return keys

    def missing(self) -> list[WorkItem]:
        """The stages that have no result on disk, in order."""
        left = [stage for stage in self.stages if self._find(stage.name) is None]
        return [WorkItem("compute", stage.name, stage.words, stage.weight, stage.inputs) for stage in left]

    def given(self, names: Iterable[str]) -> dict[str, Result]:
        """Results by stage.

        Raises InputError: a result is not on disk.
        """
        found = {name: self._find(name) for name in names}
        for name in (name for name, result in found.items() if result is None):
            raise checks.InputError(f"{self.store.manifest(name)} was changed during the run", "start it again")
        return {name: result for name, result in found.items() if result is not None}

    def compute(self, task: WorkItem, done: Done) -> None:
        """Compute and store the result of a stage."""
        stage = next(stage for stage in self.stages if stage.name == task.name)
        inputs, begin = self.given(stage.inputs), time.process_time()
        found = stage.compute(Job(self.settings, inputs, done))
        seconds = time.process_time() - begin
        self.results[stage.name] = self.store.save(stage.name, self.keys[stage.name], found, seconds)

    def draw(self, task: WorkItem, done: Done) -> None:
        """Draw a panel of the report into figures/."""
        from .plot_panels import draw

        path = self.figure(task.name)
        self.write(path, draw(path.stem, self.given(task.inputs)))

    def explore(self, task: WorkItem, done: Done) -> None:
        """Write the page that computes the reference ring."""
        import coupled

        from ..light.explore_command import models_of_geometry

        models, heat = models_of_geometry(None)
        self.written.add(self.ring)
        coupled.explore(coupled.borghi2021(), models, self.ring, heat=heat)

    def write(self, path: Path, content: bytes) -> Path:
        """Write a figure, the report or the table."""
        self.written.add(path)
        return files.write_whole(path, partial(Path.write_bytes, data=content))

    def _find(self, name: str) -> Result | None:
        if name not in self.results:
            found = self.store.load(name, self.keys[name])
            if found is None:
                return None
            self.results[name] = found
        return self.results[name]
