"""The command line: ``thermofem solve | campaign | fit | reduce | validate | simulate | cosimulate | map | ...``.

This package is the only place that knows thermofem, surrogate and coupled at once. A command is imported when it is
asked for (`group`), and everything heavy inside it, so that ``thermofem --help`` answers at once.
"""

from __future__ import annotations

import errno
import gc
import io
import os
import sys
import warnings
from typing import Annotated, Any, NoReturn

import typer

from thermofem.checks import InputError, MissingLibraryError, one_line

from .group import Commands, Entry, take_over_imports

UNFORESEEN = 70  # what sysexits.h calls an error of the software
PIPE = 141  # what a shell makes of SIGPIPE, by which other programs end
HEAT, MODELS, LIGHT, RESULTS = "Heat", "Compact models", "Ring and light", "Results"  # headings of --help


class App(Commands):
    """The commands in the order of --help."""

    table = {  # noqa: RUF012
        "solve": Entry(HEAT, "solve", "solve"),
        "campaign": Entry(HEAT, "runs", "campaign"),
        "fit": Entry(MODELS, "fit", "fit"),
        "reduce": Entry(MODELS, "models", "reduce"),
        "validate": Entry(MODELS, "models", "validate"),
        "family": Entry(MODELS, "family", "family"),
        "design": Entry(MODELS, "family", "design"),
        "uncertainty": Entry(MODELS, "family", "uncertainty"),
        "calibrate": Entry(MODELS, "family", "calibrate"),
        "simulate": Entry(LIGHT, "models", "simulate"),
        "map": Entry(LIGHT, "maps", "map_"),
        "stability": Entry(LIGHT, "maps", "stability"),
        "cosimulate": Entry(LIGHT, "cosimulate", "cosimulate"),
        "explore": Entry(LIGHT, "explore", "explore"),
        "show": Entry(RESULTS, "show", "show"),
        "export": Entry(RESULTS, "export", "export"),
        "cite": Entry(RESULTS, "cite", "cite"),
        "reproduce": Entry(RESULTS, "runs", "reproduce"),
        "doctor": Entry(RESULTS, "runs", "doctor"),
    }


app = typer.Typer(
    cls=App,
    rich_markup_mode=None,
    help="Self-heating of silicon microring resonators: training data, compact models, self-pulsing.",
    epilog="Begin with: thermofem solve --pulse '20 us' --figure heat.png. "
    "Exit codes: 0 done, 1 doctor found something missing, 2 bad input, 70 unforeseen error, "
    "130 interrupted, 141 nobody reads the output any more.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main() -> None:
    """Run the command line; exit codes: 0 done, 1 doctor found something missing, 2 bad input, 70 unforeseen error,
    130 interrupted, 141 nobody reads standard output any more.

    A user's error is one line on standard error.
    """
    gc.set_threshold(50_000)  # from 700: imports make objects that stay, and looking at each again takes .15 CPU s
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal that knows ASCII alone gets escapes, not a traceback
            stream.reconfigure(errors="backslashreplace")
    take_over_imports()
    try:
        with warnings.catch_warnings():
            if not sys.warnoptions:
                _show_ours_alone()
            code = app(prog_name="thermofem", standalone_mode=False)
        _flush()
    except InputError as error:
        _fail(error.for_text(), 2)
    except MissingLibraryError as error:
        _fail(str(error), 2)
    except BrokenPipeError:
        _leave_pipe()
    except SystemExit:
        if not hasattr(sys.stdout, "wrapped"):  # typer's word for a pipe that nobody reads
            raise
        _leave_pipe()
    except OSError as error:  # a disk that is full, also behind standard output; a name that is too long
        _fail(f"{error.strerror or error}: {_place(error)}".removesuffix(": "), 2)
    except MemoryError as error:
        _fail(f"it needs more memory than there is ({error or type(error).__name__})", 2)
    except KeyboardInterrupt:
        _fail("interrupted", 130)
    except Exception as error:
        if hasattr(error, "format_message"):  # what click raises for its own part; typer may bring another click
            _wrong_usage(error)
        if {"-v", "--verbose"} & set(sys.argv):
            raise
        _fail(_unforeseen(error), UNFORESEEN)
    if code == 130:
        _fail("interrupted", 130)
    if type(code) is int:
        sys.exit(code)


def _unforeseen(error: BaseException) -> str:
    """One line for an error of another library or of ours; its cause, not what it led to.

    What Python calls its context may be an error that was dealt with, or one that a library met on its way to another.
    """
    while error.__cause__ is not None:
        error = error.__cause__
    if "start new thread" in str(error):
        return "the system allows this user no more threads; raise the limit (ulimit -u, or that of the container)"
    return f"unforeseen {type(error).__name__}: {error}; --verbose shows where; please report it"


def _place(error: OSError) -> str:
    """Subject of an operating-system error: errors of files carry a name or are InputErrors already."""
    if error.filename is not None:
        return str(error.filename)
    return "standard output" if error.errno == errno.ENOSPC else ""


def _show_ours_alone() -> None:
    """Hide warnings of NumPy, xarray and Matplotlib; those of this project have their own category."""
    show = warnings.showwarning

    def show_ours(message: Any, category: type[Warning], *where: Any, **more: Any) -> None:
        if category.__module__.split(".")[0] in ("thermofem", "surrogate", "coupled"):
            show(message, category, *where, **more)

    warnings.showwarning = show_ours


def _wrong_usage(error: Any) -> NoReturn:
    """Exit with one line about the wrong option, or with the help where no command is given."""
    context: Any = getattr(error, "ctx", None)
    if type(error).__name__ == "NoArgsIsHelpError":
        print(context.get_help())
        sys.exit(2)
    where = context.command_path if context else "thermofem"
    _fail(f"{error.format_message().rstrip('.')}; `{where} --help` lists what there is", 2)


def _flush() -> None:
    """Write what standard output still holds, so that a full disk behind it is an error and not lost numbers."""
    try:
        if sys.stdout is not None:  # None: the caller closed it
            sys.stdout.flush()
    except OSError as error:
        raise OSError(error.errno, error.strerror, "standard output") from None


def _leave_pipe() -> NoReturn:
    """Exit without a word, as other programs do whose output nobody reads any more."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what is left in the buffer goes there
    sys.exit(PIPE)


def _fail(text: str, code: int) -> NoReturn:
    """Leave with one line on standard error, and with this code where neither stream can be written."""
    for stream, last in (
        (sys.stdout, ""),
        (sys.stderr, f"thermofem: {'error: ' if code in (2, UNFORESEEN) else ''}{one_line(text)}\n"),
    ):
        if stream is None:
            continue
        try:
            stream.write(last)
            stream.flush()
        except OSError:  # what is left in the buffer: Python would try again at its end and take a code of its own
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    sys.exit(code)


def _version(wanted: bool) -> None:
    if wanted:
        from thermofem.version import __version__

        print(__version__)
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Options of the whole program."""
