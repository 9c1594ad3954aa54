"""Output of the commands: text for people, numbers for programs; text from files and paths is never read as markup.

Words go to standard output, or to standard error under ``--json``; ``--quiet`` leaves them out. Numbers are what a
command returns: under ``--json`` one JSON object on standard output, with ``command`` and the version beside them.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
import json
import logging
import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from thermofem import checks
from thermofem.data import files

from .apart import check_apart
from .used import check_used

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.status import Status

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
JSON = "Print results as JSON on standard output and messages on standard error."
Numbers = Mapping[str, Any]


@dataclass
class Manner:
    """Settings of the output of this run."""

    json: bool = False
    quiet: bool = False


_manner = Manner()
_held: list[str] = []


def hold(text: str) -> None:
    """A `note` that is printed before the next words or at the end, and not at all before an error."""
    _held.append(text)


def _release() -> None:
    held, _held[:] = _held[:], []
    for text in held:
        note(text)


def say(text: str) -> None:
    """Print a line for people: on standard output, or on standard error with --json."""
    _release()
    if not _manner.quiet:
        print(checks.one_line(text, most=20_000))  # `speaking` sends it to standard error where numbers stand


def note(text: str) -> None:
    """A line of words on standard error."""
    _release()
    if not _manner.quiet:
        print(checks.one_line(text, most=20_000), file=sys.stderr)


def console(*, err: bool = True) -> Console:
    """The terminal; text is printed as it stands, brackets included."""
    from rich.console import Console

    return Console(stderr=err, markup=False, highlight=False, quiet=_manner.quiet, soft_wrap=False)


def show(table: RenderableType) -> None:
    """A table for people."""
    _release()
    console(err=False).print(table)


def watched() -> bool:
    """Whether bars are drawn: standard error is a terminal, and the command is not --quiet."""
    return sys.stderr.isatty() and not _manner.quiet


def working(what: str) -> Status | contextlib.nullcontext[None]:
    """Status line on the terminal while a block runs; nothing where standard error is not a terminal."""
    if not watched():
        return contextlib.nullcontext()
    from rich.text import Text

    return console().status(Text(what))


def speaking(function: Callable[..., Numbers | None]) -> Callable[..., None]:
    """A command with the options that all commands share: --json, --quiet, --verbose and --threads."""

    @functools.wraps(function)
    def command(*, json_: bool, quiet: bool, verbose: bool, threads: int | None, **options: Any) -> None:
        _manner.json, _manner.quiet = json_, quiet
        _held.clear()
        _check_empty(function, options)
        check_apart(options)
        check_used(function, options)
        _log(quiet, verbose)
        if threads is not None:
            _use_threads(threads)
        with contextlib.ExitStack() as stack:
            if quiet:
                nowhere = stack.enter_context(open(os.devnull, "w", encoding="utf-8"))
                stack.enter_context(contextlib.redirect_stdout(nowhere))
            elif json_:
                stack.enter_context(contextlib.redirect_stdout(sys.stderr))
            numbers = function(**options)
            _release()
        if json_:
            said = files.plain({"command": function.__name__.strip("_"), **(numbers or {})})
            print(json.dumps(said, allow_nan=False, default=str))
        if numbers and numbers.get("passed") is False:
            raise typer.Exit(1)

    shared = {
        "json_": Annotated[bool, typer.Option("--json", help=JSON)],
        "quiet": Annotated[bool, typer.Option("--quiet", "-q", help="Print no messages.")],
        "verbose": Annotated[bool, typer.Option("--verbose", "-v", help="Print details of each step.")],
        "threads": Annotated[int | None, typer.Option(help="Threads to use; default: one for each CPU.")],
    }
    hints = {**get_type_hints(function, include_extras=True), **shared, "return": None}
    keyword = inspect.Parameter.KEYWORD_ONLY
    own = [p.replace(annotation=hints[p.name], kind=keyword) for p in inspect.signature(function).parameters.values()]
    defaults: dict[str, Any] = {"json_": False, "quiet": False, "verbose": False, "threads": None}
    more = [inspect.Parameter(name, keyword, default=defaults[name], annotation=shared[name]) for name in shared]
    command.__annotations__ = hints
    command.__signature__ = inspect.Signature([*own, *more])  # type: ignore[attr-defined]
    del command.__wrapped__
    return command


def _check_empty(function: Callable[..., Any], options: Mapping[str, Any]) -> None:
    """InputError where an option or argument is '', as the shell makes it of a variable that is not set."""
    for name, value in options.items():
        for one in value if isinstance(value, list) else [value]:
            unset = one == Path() and "" in sys.argv[1:]  # what Path makes of ''
            if unset or (isinstance(one, str | Path) and not str(one).strip()):
                marks = get_type_hints(function, include_extras=True)[name].__metadata__
                word = name.strip("_").replace("_", "-")
                said = word.upper() if isinstance(marks[0], typer.models.ArgumentInfo) else f"--{word}"
                raise checks.InputError(f"{said} is empty", "leave it out, or is a variable of the shell not set?")


class _Notes(logging.Handler):
    """Warnings of the log as words that are `hold`."""

    def emit(self, record: logging.LogRecord) -> None:
        hold(record.getMessage())


_notes = _Notes()


def _log(quiet: bool, verbose: bool) -> None:
    """The project's log on standard error: warnings, or everything with --verbose, or errors alone with --quiet."""
    log = logging.getLogger("thermofem")
    log.setLevel(logging.ERROR if quiet else logging.DEBUG if verbose else logging.WARNING)
    if verbose:
        logging.basicConfig(stream=sys.stderr, format="%(name)s: %(message)s")
        log.removeHandler(_notes)
    else:
        log.addHandler(_notes)


def _use_threads(count: int) -> None:
    """Bound the threads of BLAS and of compiled code, here and in worker processes."""
    whole = int(checks.between("--threads", count, 1, 1024))
    os.environ.update(dict.fromkeys(THREADS, str(whole)))
    try:
        from threadpoolctl import threadpool_limits
    except ImportError:
        return
    threadpool_limits(whole)


def threads_wanted() -> int | None:
    """The number given with --threads, or None."""
    given = os.environ.get("NUMBA_NUM_THREADS", "")
    return int(given) if given.isdigit() else None


def written(value: float, unit: str, error: float | None = None) -> str:
    """A number for people; with a standard error to two digits of the same prefix, it ends where the error does.

    A number has four digits, or as many as an error that is smaller asks for, up to ten.
    """
    import math

    from thermofem.data import quantity

    text = quantity.rounded(value, unit, 4) if unit in quantity.SI else f"{value:.4g} {unit}"
    if error is None:
        return text
    number, _, prefixed = text.partition(" ")
    factor = quantity.parse(f"1 {prefixed}", unit) if unit in quantity.SI else 1.0
    size, off = value / factor, float(f"{error / factor:.2g}")
    said = f"{off:g}"
    if size and 0 < off < math.inf:
        places = 1 - math.floor(math.log10(off))
        if 4 <= places + math.floor(math.log10(abs(size))) + 1 <= 10:
            number, said = (f"{round(x, places):.{max(places, 0)}f}" for x in (size, off))
    return f"{number} ± {said} {prefixed}".rstrip()
