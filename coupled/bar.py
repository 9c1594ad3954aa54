"""One progress bar for everything that takes a while."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from thermofem.checks import InputError


@contextmanager
def bar(name: str, total: int, wanted: bool) -> Iterator[Callable[[], None]]:
    """A function to call after each of ``total`` pieces, which moves a bar on standard error where one is wanted."""
    if not isinstance(wanted, bool):
        raise InputError(f"show_bar = {wanted!r} must be True or False: whether to draw a bar on the terminal")
    if not wanted:
        yield lambda: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True)) as drawn:
        task = drawn.add_task(name, total=total)
        yield lambda: drawn.advance(task)
