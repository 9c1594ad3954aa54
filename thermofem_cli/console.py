"""Output of the commands: results and messages as text, numbers as JSON, progress bars.

Results are printed on standard output; messages, warnings and bars on standard error, where ``--quiet`` drops them.
Under ``--json`` standard output holds one JSON object alone, and results in words follow the messages.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import logging
import math
import os
import re
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

LINE = 20_000  # characters of a line of output, such as the equations of a network
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass
class Settings:
    """Options --json, --quiet, --verbose and --threads of the running command, its name, and its warnings by kind."""

    command: str = ""
    json: bool = False
    quiet: bool = False
    verbose: bool = False
    threads: int | None = None
    warned: dict[str, list[str]] = field(default_factory=dict)


settings = Settings()


def say(text: str) -> None:
    """Print one line of results."""
    from thermofem.errors import one_line

    if not (settings.json and settings.quiet):
        print(one_line(text, most=LINE), file=sys.stderr if settings.json else sys.stdout)


def say_row(name: str, text: str, sign: str = "=") -> None:
    """Print a result and its name, the names of several one below the other."""
    say(f"{name:>22} {sign} {text}")


def say_fitted(result: Any) -> None:
    """Print the parameters of a fit, each with its standard deviation."""
    for name, value in result.parameters.items():
        say_row(name, written(value, parameter_unit(name), result.standard_deviations[name]))


def note(text: str) -> None:
    """Print one message for people on standard error."""
    from thermofem.errors import one_line

    if not settings.quiet:
        print(one_line(text, most=LINE), file=sys.stderr)


def wrote(numbers: Mapping[str, Any]) -> None:
    """Print the names of the files that a command wrote: every path among its numbers, or in a list of them."""
    values = [value if isinstance(value, list) else [value] for value in numbers.values()]
    paths = [str(value) for value in itertools.chain(*values) if isinstance(value, Path)]
    if paths and not settings.quiet:
        say("wrote " + " and ".join(paths))


def terminal(*, err: bool = True) -> Console:
    """Return a console of rich that prints text unchanged, brackets included."""
    from rich.console import Console

    return Console(stderr=err, markup=False, highlight=False, soft_wrap=False)


def show(table: RenderableType) -> None:
    """Print a table of results."""
    if not (settings.json and settings.quiet):
        terminal(err=settings.json).print(table)


def print_numbers(numbers: Mapping[str, Any]) -> None:
    """Print what a command returns, in SI, as one JSON object."""
    from thermofem.data import files

    print(json.dumps(files.plain({"command": settings.command, **numbers}), allow_nan=False, default=str))


def watched() -> bool:
    """Whether bars are drawn: standard error is a terminal, and the command is not --quiet."""
    return sys.stderr.isatty() and not settings.quiet


def working(what: str) -> contextlib.AbstractContextManager[Any]:
    """Show a status line while a block of unknown duration runs."""
    from rich.text import Text

    return terminal().status(Text(what)) if watched() else contextlib.nullcontext()


@contextlib.contextmanager
def bar(what: str) -> Iterator[Callable[..., None]]:
    """Yield ``progress(done, total, words)``, which advances a progress bar labelled with ``words``."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = TextColumn("{task.description}", markup=False), BarColumn(20), TextColumn("{task.fields[words]}")
    clocks = TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn()
    with Progress(*columns, *clocks, console=terminal(), transient=True, disable=not watched()) as drawn:
        task = drawn.add_task(what, total=None, words="")

        def progress(done: float, total: float, words: str = "") -> None:
            drawn.update(task, completed=done, total=total, words=words)

        yield progress


@contextlib.contextmanager
def time_bar(what: str, duration: float) -> Iterator[Callable[[float], None]]:
    """Yield ``progress(time)``, which advances the bar of a run; ``time`` and ``duration`` in s."""
    unit, size = ("ms", 1e-3) if duration >= 1e-3 else ("us", 1e-6)
    with bar(what) as progress:

        def at(time: float) -> None:
            progress(time, duration, f"{time / size:.3g} of {duration / size:.3g} {unit}")

        yield at


class Messages(logging.Handler):
    """Log handler that prints each record by `note`, warnings by `warn`."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one record."""
        printed = note if record.levelno < logging.WARNING or settings.verbose else warn
        printed(record.getMessage())


def warn(text: str) -> None:
    """Print a warning once for a command; those that differ by numbers alone are counted, see `note_repeated`."""
    alike = settings.warned.setdefault(re.sub(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?", "#", text), [])
    alike.append(text)
    if len(alike) == 1:
        note(text)


def note_repeated() -> None:
    """Print how often each warning came, where it was more than once."""
    for first, *others in settings.warned.values():
        if others:
            words = "the same" if set(others) == {first} else "alike but for numbers (--verbose prints them)"
            note(f"{len(others)} more warnings, {words}: {textwrap.shorten(first, 80, placeholder=' ...')}")


logging.getLogger("thermofem").addHandler(Messages())


def configure(*, json: bool, quiet: bool, verbose: bool, threads: int | None) -> None:
    """Apply the options of every command: what is printed of the log, and the threads of BLAS and compiled code."""
    settings.warned = {}
    settings.json, settings.quiet, settings.verbose, settings.threads = json, quiet, verbose, threads
    level = logging.DEBUG if verbose else logging.ERROR if quiet else logging.WARNING
    logging.getLogger("thermofem").setLevel(level)
    if threads is not None:
        from threadpoolctl import threadpool_limits

        os.environ.update(dict.fromkeys(THREADS, str(threads)))  # of worker processes
        threadpool_limits(threads)


def written(value: float, unit: str, error: float | None = None) -> str:
    """Return a number with its unit as text: four digits, or up to the second digit of its standard error."""
    from thermofem.data import quantity

    text = quantity.rounded(value, unit, 4) if unit in quantity.SI else f"{value:.4g} {unit}"
    if error is None or math.isnan(error):
        return text
    number, _, prefixed = text.partition(" ")
    factor = quantity.parse(f"1 {prefixed}", unit) if unit in quantity.SI else 1.0
    size = value / factor
    off = float(f"{error / factor:.2g}")
    said = f"{off:g}"
    if size and 0 < off < math.inf:
        places = 1 - math.floor(math.log10(off))
        if 4 <= places + math.floor(math.log10(abs(size))) + 1 <= 10:
            number = f"{round(size, places):.{max(places, 0)}f}"
            said = f"{round(off, places):.{max(places, 0)}f}"
    return f"{number} ± {said} {prefixed}".rstrip()


def parameter_unit(name: str) -> str:
    """Return the SI unit of a fitted parameter, empty for a ratio."""
    units = {"kappa": "1/s", "heat_capacity": "J/K", "tau": "s", "tau0": "s", "lifetime": "s", "R": "K/W"}
    units |= {"frequency": "Hz", "thermal_resistance": "K/W", "heating": "K/W", "late": "s"}
    return units.get(name, "1/s" if name.endswith("_rate") else units.get(name.partition("_")[0], ""))
