"""The program ``thermofem``: its commands, and the one place where errors become lines and exit codes.

This package is the only one that imports thermofem, surrogate and coupled at once. A command is a function in a file
``NAME_command.py``; those on rings are in `rings`. To add one:

1. Write the function. Its parameters are the arguments and options, its docstring is the text of --help, where the
   section Options says what each of its own options does. What several commands share is declared in `options`, and so
   are the five options that every command has (--json .. --threads; a command declares ``seed`` where it draws at
   random). The function imports what it needs in its body, so that --help and --version load no numerical library.
   Options that exclude each other go through `options.unused`; whether files can be written is checked before it runs
   (`options.WRITTEN`). Results are printed by `console.say`, hints by `console.note`; all numbers are returned in
   SI as a dict, which --json prints, and the paths in it are the files that were written. An InputError names the
   option, the value and the rule.
2. Add one line to `COMMANDS`, and run ``python docs/generate.py``, which writes docs/commands.md.
"""

import os
import re
import sys
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from .cite_command import cite, reproduce
from .console import note_repeated, print_numbers, settings, warn
from .design_command import design, uncertainty
from .doctor_command import doctor
from .export_command import export
from .family_command import calibrate, family
from .fit_command import fit
from .noise_command import noise
from .options import with_common
from .reduce_command import reduce
from .rings.explore_command import explore
from .rings.identify_command import identify
from .rings.linearize_command import linearize
from .rings.map_command import map_, stability
from .rings.modes_command import modes, ring
from .rings.simulate_command import cosimulate, simulate
from .rings.sweep_command import sweep
from .show_command import show
from .solve_command import campaign, solve
from .validate_command import validate

__all__ = ["app", "main"]

INTERRUPTED = 130  # exit code of shells after Ctrl-C
COMMANDS: dict[str, Callable[..., Any]] = {
    "solve": solve,
    "campaign": campaign,
    "fit": fit,
    "reduce": reduce,
    "validate": validate,
    "family": family,
    "design": design,
    "uncertainty": uncertainty,
    "calibrate": calibrate,
    "simulate": simulate,
    "map": map_,
    "stability": stability,
    "identify": identify,
    "sweep": sweep,
    "linearize": linearize,
    "noise": noise,
    "cosimulate": cosimulate,
    "explore": explore,
    "modes": modes,
    "ring": ring,
    "show": show,
    "export": export,
    "cite": cite,
    "reproduce": reproduce,
    "doctor": doctor,
}


def finish(numbers: Mapping[str, Any] | None, **_: Any) -> None:
    """Print the numbers of a command under --json; exit with code 1 where a check did not pass."""
    if settings.json and numbers is not None:
        print_numbers(numbers)
    if numbers and numbers.get("passed") is False:
        raise typer.Exit(1)


app = typer.Typer(
    help="Self-heating of silicon microring resonators: training data, compact models, self-pulsing.",
    epilog="Begin with: thermofem solve --pulse '20 us' --figure heat.png. "
    "Exit codes: 0 done, 1 doctor or identify failed, 2 bad input, 70 unforeseen error, 130 interrupted.",
    context_settings={"help_option_names": ["-h", "--help"]},
    invoke_without_command=True,
    pretty_exceptions_enable=False,
    result_callback=finish,
    rich_markup_mode=None,
)
for name, command in COMMANDS.items():
    app.command(name, short_help=(command.__doc__ or "").partition("\n\n")[0])(with_common(command))


@app.callback()
def begin(
    context: typer.Context, version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False
) -> None:
    """Options of the whole program."""
    settings.command = context.invoked_subcommand or ""
    if version:
        source = (Path(__file__).parents[1] / "thermofem" / "__init__.py").read_text(encoding="utf-8")
        print(*re.findall(r'^__version__ = "(.+?)"', source, re.MULTILINE))  # importing it would take seconds
        raise typer.Exit
    if not settings.command:
        print(context.get_help())
        raise typer.Exit(2)


def main() -> None:
    """Run the command line; an error of the user is one line on standard error.

    Exit codes: 0 done, 1 doctor or identify failed, 2 bad input, 70 unforeseen error, 130 interrupted.
    """
    os.environ.setdefault("MPLBACKEND", "agg")  # figures are files
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("ignore")
        code, error = _run()
    for warning in caught:
        warn(f"warning: {warning.message}")
    note_repeated()
    if error:
        print(f"thermofem: {error}", file=sys.stderr)
    sys.exit(code)


def _run() -> tuple[int, str]:
    """Run the app; return the exit code and the message of an error, empty without one."""
    try:
        code = app(prog_name="thermofem", standalone_mode=False)
    except KeyboardInterrupt:
        code = INTERRUPTED
    except Exception as error:
        return _explained(error)
    if code == INTERRUPTED:
        return code, "interrupted"
    return (code, "") if isinstance(code, int) else (0, "")


def _explained(error: Exception) -> tuple[int, str]:
    """Return the exit code and the message, one line, of an error; raises an unforeseen one under --verbose."""
    from thermofem.errors import InputError, MissingLibraryError, one_line

    code = 2
    if isinstance(error, InputError):
        text = error.for_text()
    elif isinstance(error, MissingLibraryError):
        text = str(error)
    elif isinstance(error, OSError):
        text = str(error.strerror or error) + (f": {error.filename}" if error.filename else "")
    elif isinstance(error, MemoryError):
        text = f"it needs more memory than there is ({error or 'MemoryError'})"
    elif hasattr(error, "format_message"):  # wrong usage; typer does not export this class of click
        context: Any = getattr(error, "ctx", None)
        command = context.command_path if context else "thermofem"
        text = f"{error.format_message().rstrip('.')}; `{command} --help` lists what there is"
    elif settings.verbose:
        raise error
    else:
        code = 70  # sysexits.h: an error of the software
        text = f"unforeseen {type(error).__name__}: {error}; --verbose shows where; please report it"
    return code, one_line(f"error: {text}")
