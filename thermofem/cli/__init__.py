"""The command line: ``thermofem solve | campaign | fit | reduce | validate | simulate | cosimulate | map | ...``.

This package is the only place that knows thermofem, surrogate and coupled at once. Everything heavy is imported inside
the commands, so that ``thermofem --help`` answers at once.
"""

from __future__ import annotations

import gc
import io
import os
import sys
import warnings
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from ..checks import InputError, MissingLibraryError, one_line
from . import maps, models, output
from .cite import cite
from .cosimulate import cosimulate
from .explore import explore
from .export import export
from .family import calibrate, design, family, uncertainty
from .fit import fit
from .show import show
from .solve import solve

app = typer.Typer(
    help="Self-heating of silicon microring resonators: training data, compact models, self-pulsing.",
    epilog="Begin with: thermofem solve --pulse '20 us' --figure heat.png. "
    "Exit codes: 0 done, 1 doctor found something missing, 2 bad input, 130 interrupted.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

HEAT, MODELS, LIGHT, RESULTS = "Heat", "Compact models", "Ring and light", "Results"  # headings of --help

Folder = Annotated[Path, typer.Option("--output", "-o", help="Folder to write.")]


def main() -> None:
    """Run the command line; exit codes: 0 done, 1 doctor found something missing, 2 bad input, 130 interrupted.

    A user's error is one line on standard error.
    """
    gc.set_threshold(50_000)  # from 700: imports make objects that stay, and looking at each again takes .15 CPU s
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # a terminal that knows ASCII alone gets escapes, not a traceback
            stream.reconfigure(errors="backslashreplace")
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
    except OSError as error:  # a disk that is full, also behind standard output; a name that is too long
        named = f": {error.filename}" if error.filename is not None else ""
        _fail(f"{error.strerror or error}{named}", 2)
    except MemoryError as error:
        _fail(f"it needs more memory than there is ({error or type(error).__name__})", 2)
    except KeyboardInterrupt:
        _fail("interrupted", 130)
    except Exception as error:
        if not hasattr(error, "format_message"):  # what click raises for its own part; typer may bring another click
            raise
        _wrong_usage(error)
    if code == 130:
        _fail("interrupted", 130)
    if type(code) is int:
        sys.exit(code)


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


def _fail(text: str, code: int) -> NoReturn:
    """Leave with one line on standard error, and with this code where neither stream can be written."""
    for stream, last in (
        (sys.stdout, ""),
        (sys.stderr, f"thermofem: {'error: ' if code == 2 else ''}{one_line(text)}\n"),
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
        from ..version import __version__

        print(__version__)
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Options of the whole program."""


app.command(rich_help_panel=HEAT)(solve)


@app.command(rich_help_panel=HEAT)
def campaign(
    file: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Campaign file (TOML).")],
    output: Folder = Path("campaign"),
    workers: Annotated[int | None, typer.Option(help="Worker processes; default: one for each CPU.")] = None,
    scheduler: Annotated[str | None, typer.Option(help="Address of a Dask scheduler to compute on.")] = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Take geometries that failed again.")] = False,
) -> dict[str, Any]:
    """Solve many geometries: one netCDF file for each, one index, one training collection.

    Started again, it goes on where it was, however it ended.
    """
    from .campaign import run

    return run(file, output, workers=workers, scheduler=scheduler, retry_failed=retry_failed)


for command in (fit, models.reduce, models.validate, family, design, uncertainty, calibrate):
    app.command(rich_help_panel=MODELS)(command)
app.command(rich_help_panel=LIGHT)(models.simulate)
app.command("map", rich_help_panel=LIGHT)(maps.map_)
app.command(rich_help_panel=LIGHT)(maps.stability)
app.command(rich_help_panel=LIGHT)(cosimulate)
app.command(rich_help_panel=LIGHT)(explore)
app.command(rich_help_panel=RESULTS)(show)
app.command(rich_help_panel=RESULTS)(export)
app.command(rich_help_panel=RESULTS)(cite)


@app.command(rich_help_panel=RESULTS)
def reproduce(
    output: Folder = Path("out"),
    quick: Annotated[
        bool, typer.Option("--quick", help="The one-minute version: no maps, no FEM in the loop.")
    ] = False,
) -> dict[str, Any]:
    """Reproduce the paper from our own FEM: report.html with every figure and number, and the data behind it.

    Started again, it goes on where it was, however it ended.
    """
    from ..campaign.processes import cpus
    from .output import threads_wanted
    from .reproduce import Settings, run

    return run(output, Settings(quick=quick), processes=threads_wanted() or cpus())


@app.command(rich_help_panel=RESULTS)
def doctor() -> dict[str, Any]:
    """Say what works on this machine, and what is missing for what does not."""
    from .doctor import run

    return run()


for registered in app.registered_commands:  # every command takes --json, --quiet, --verbose and --threads
    if registered.callback is not None:
        registered.callback = output.speaking(registered.callback)
