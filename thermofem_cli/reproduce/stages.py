"""Stages: pure functions from settings and earlier results to a result."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from .settings import Settings
from .store import Result

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
    """

    name: str
    words: str
    compute: Compute
    inputs: tuple[str, ...] = ()
    uses: tuple[str, ...] = ("accuracy",)
    weight: float = 1.0
    quick: bool = False

    def used(self, settings: Settings) -> dict[str, Any]:
        """Settings that decide the result, by name."""
        return {name: getattr(settings, name) for name in self.uses}
