"""A progress bar over simulated time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .output import console, watched

if TYPE_CHECKING:
    from rich.progress import Progress

PASSES = 7  # that a periodic state takes as a rule: six to eight


class Bar:
    """A bar on the terminal; called with the time in s that a run has reached.

    what: what is under way.
    duration [s]: of the run; of one period where the run is ``periodic``, which passes over it several times.
    first: what is said until the run has reached something.
    stays: whether the bar stays on the terminal when the run is done.
    """

    def __init__(
        self, what: str, duration: float, *, periodic: bool = False, first: str = "", stays: bool = False
    ) -> None:
        self.duration, self.periodic = duration, periodic
        self.progress: Progress | None = None
        if not stays and not watched():  # a bar that stays is a line of the log
            return
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

        text = TextColumn("{task.description}", markup=False), BarColumn(20), TextColumn("{task.fields[at]}")
        clocks = TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn()
        self.progress = Progress(*text, *clocks, console=console(), transient=not stays)
        self.task = self.progress.add_task(what, total=None, at=first)  # it moves to and fro until it is called

    def __enter__(self) -> Bar:
        if self.progress:
            self.progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self.progress:
            self.progress.stop()

    def __call__(self, time: float) -> None:
        """Show how far the run is."""
        if not self.progress:
            return
        if self.periodic:
            at = f"pass {1 + int(time / self.duration * (1 - 1e-9))} of {PASSES} or so"
        else:
            unit, size = ("ms", 1e-3) if self.duration >= 1e-3 else ("us", 1e-6)
            at = f"{time / size:.3g} of {self.duration / size:.3g} {unit}"
        whole = self.duration * (PASSES if self.periodic else 1)
        self.progress.update(self.task, completed=time, total=whole, at=at)
