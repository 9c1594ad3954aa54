"""Arguments and options that several commands take, each declared once; processes and clusters of --workers."""

from __future__ import annotations

import contextlib
import functools
import inspect
import os
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, get_origin

import typer

from . import console

if TYPE_CHECKING:
    from concurrent.futures import Executor

Quantity = Any  # text with a unit on the command line, a number in SI in the command: its help begins with the unit
Seed = Annotated[int, typer.Option(min=0, help="Seed of what is drawn at random.")]
JSON = "Print results as JSON on standard output and messages on standard error."
THREADS = "Threads to use; default: one for each CPU."
# of every command; one that reads ``seed`` declares it
EVERYWHERE: dict[str, tuple[Any, Any]] = {
    "json": (Annotated[bool, typer.Option("--json", help=JSON)], False),
    "quiet": (Annotated[bool, typer.Option("--quiet", "-q", help="Print results alone, no messages.")], False),
    "verbose": (Annotated[bool, typer.Option("--verbose", "-v", help="Print details of each step.")], False),
    "seed": (Seed, 0),
    "threads": (Annotated[int | None, typer.Option(min=1, max=1024, help=THREADS)], None),
}

Geometry = Annotated[Path | None, typer.Argument(help="Geometry file (TOML); default: the reference strip.")]

Model = Annotated[Path, typer.Argument(help="Thermal model (JSON).")]

REFERENCE_RING = "borghi2021"
RING = "Ring file (TOML), or one of borghi2021, borghi2021-lumped, vanvaerenbergh2012"


class PlaneTexts(NamedTuple):
    """First and last power and detuning of a plane, as the options take them."""

    power: str
    detuning: str


PAPER_PLANE = PlaneTexts("3 dBm, 10 dBm", "-30 GHz, 30 GHz")

# help of options that several commands take; one that says more of its own stands in the command's docstring
HELP = {
    "mesh": "Your own mesh (.msh, in m): triangles in groups named after layers and parts.",
    "accuracy": "Wanted relative error of the mesh.",
    "heated": "Part that takes the heat, of a model of several parts.",
    "read": "Part that is read, of a model of several parts; default: the heated.",
    "heater": "Constant power, voltage or current of another part: 'heater=5 mW' or '1.2 V'.",
    "ring": f"{RING}; a lumped one goes with Newton's law.",
    "power": "Power in the bus waveguide.",
    "detuning": "Laser minus cold resonance: '-10 GHz', or in wavelength '80 pm' (to the red).",
    "points": "Number of powers and of detunings.",
    "duration": "[s > 0] Length of the run, from a cold start.",
    "rtol": "Relative error of the integration.",
    "wavelength": "Vacuum wavelength; a ring has the resonance next to it. Default: that of [light], or 1550 nm.",
    "held": "Standard deviation of a number that is held, as a share of it: 'fca_cross_section=5 %'. Repeatable.",
    "pulse": "Heat for this long, e.g. '20 us'; default: a step.",
    "square": "Heat in a square wave of this period, from rest, e.g. '1 us'.",
    "duty": "Duty cycle of the square wave; default 1/3.",
    "fix": "Keep a parameter, e.g. 'radius=7 um'; may be repeated.",
    "scheduler": "Address of a Dask scheduler to compute on.",
    "field_times": "Keep the field at '1 us, 5 us, ...'.",
    "paraview": "Write the fields for ParaView: .xdmf, or .vtu of one time.",
    "figure": "Also draw into this image.",
    "csv": "Also write a table (CSV), in SI.",
}

Family = Annotated[Path, typer.Argument(metavar="FAMILY", help="Family file of thermofem family.")]

Workers = Annotated[int | None, typer.Option(min=1, max=1024, help="Worker processes; default: one for each CPU.")]
Processes = Annotated[int, typer.Option("--workers", min=1, max=1024, help="Worker processes.")]

Output = Annotated[Path, typer.Option("--output", "-o", help="File to write.")]
Folder = Annotated[Path, typer.Option("--output", "-o", help="Folder to write.")]


def listed(text: str | None) -> list[str]:
    """Return the texts between commas; none of None."""
    return [part.strip() for part in text.split(",")] if text else []


def unused(context: typer.Context, why: str, *names: str) -> None:
    """Raise InputError where one of these options is given although it has no effect; ``why`` is the reason."""
    from thermofem.errors import InputError

    for name in names:
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            value = context.params[name]
            values = [value] if not isinstance(value, list | tuple) else value
            said = "" if value is True else " " + ", ".join(map(str, values))
            raise InputError(f"{_flag(name)}{said} {why}; leave it out")


def _flag(name: str) -> str:
    """The option of a parameter of a command."""
    return f"--{name.strip('_').replace('_', '-')}"


WRITTEN = "output", "figure", "preview", "paraview", "csv", "map_", "resume"  # options of files that a command writes
PICTURES = "figure", "preview"


def check_files(values: Mapping[str, Any]) -> None:
    """`check_outputs` of a command by the names of its options and their values; a figure needs the ending of one."""
    from thermofem.data.files import check_image

    inputs: list[Any] = [values.get("ring")]
    for name, value in values.items():
        paths = value if isinstance(value, list) else [value]
        if name not in WRITTEN:
            inputs += [path for path in paths if isinstance(path, Path)]
    check_outputs([values.get(name) for name in WRITTEN], inputs)
    for name in PICTURES:
        if values.get(name):
            check_image(values[name])


def check_outputs(outputs: Iterable[Path | None], inputs: Iterable[Path | str | None]) -> None:
    """Raise InputError if an output cannot be written, or is an input or another output."""
    from thermofem.data.files import check_target
    from thermofem.errors import InputError

    taken = {os.path.realpath(path): "read and written at once" for path in inputs if path}
    for path in filter(None, outputs):
        check_target(path)
        where = os.path.realpath(path)
        if where in taken:
            raise InputError(f"{path} would be {taken[where]}; give it another name")
        taken[where] = "written twice"


OPTIONS = "\n\nOptions\n-------\n"  # heading, in the docstring of a command, of its own options: "NAME: help"


def with_common(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return the command with the options of all commands (`EVERYWHERE`: --json, --quiet, --verbose, --threads) added.

    They set up the console; ``command`` itself gets only those of them that are among its own arguments. The section
    `OPTIONS` of its docstring is the help of its own options; one that begins with a unit, as "[s > 0]", makes a number
    of the text, in SI. Its files are checked before it runs, and those that it returns are named after it.
    """
    arguments = dict(inspect.signature(command, eval_str=True).parameters)
    text, _, section = (inspect.getdoc(command) or "").partition(OPTIONS)
    words = HELP | dict(re.findall(r"^(\w+): (.+(?:\n .+)*)", section, re.MULTILINE))
    quantities = {}
    for name, parameter in arguments.items():
        if get_origin(parameter.annotation) is Annotated or parameter.annotation is typer.Context:
            continue
        kind = parameter.annotation
        said = " ".join(words[name].split())
        if begin := re.match(r"\[(\S+?)( >=? 0)?\] ", said):
            quantities[name] = begin.groups()
            kind = str | None
            said = said[begin.end() :]
        option: Any = Annotated[kind, typer.Option(_flag(name), help=said)]
        arguments[name] = parameter.replace(annotation=option)
    common = {
        name: inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=kind, default=default)
        for name, (kind, default) in EVERYWHERE.items()
    }
    others = [value for name, value in arguments.items() if name not in common]

    @functools.wraps(command)
    def run(json: bool, quiet: bool, verbose: bool, threads: int | None, **values: Any) -> Any:
        from thermofem.data import quantity
        from thermofem.models import OutsideTrainingWarning

        warnings.simplefilter("default", OutsideTrainingWarning)  # `main` ignores the others
        console.configure(json=json, quiet=quiet, verbose=verbose, threads=threads)
        check_files(values)
        rules = {None: quantity.parse, " > 0": quantity.positive, " >= 0": quantity.not_negative}
        for name, (unit, rule) in quantities.items():
            if values[name] is not None:
                values[name] = rules[rule](values[name], unit, name=_flag(name))
        numbers = command(**{name: value for name, value in values.items() if name in arguments})
        console.wrote(numbers)
        return numbers

    parameters = [*others, *(arguments.get(name, parameter) for name, parameter in common.items())]
    run.__doc__ = text
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]  # typer reads it
    return run


@contextlib.contextmanager
def executor_of(context: typer.Context, scheduler: str | None, workers: int = 1) -> Iterator[Executor | None]:
    """Yield an Executor: a Dask cluster at the address ``scheduler``, or several worker processes; None for one worker.

    Raises InputError: --workers beside --scheduler, or one that does not answer. Raises MissingLibraryError: no Dask.
    """
    from thermofem.campaign.stored_tasks import processes
    from thermofem.errors import InputError, MissingLibraryError

    if not scheduler:
        with processes(workers) if workers > 1 else contextlib.nullcontext() as pool:
            yield pool
        return
    unused(context, "and --scheduler exclude each other; the cluster has its own", "workers")
    try:
        from distributed import Client

        client = Client(scheduler, timeout="10s", set_as_default=False)
    except ImportError:
        raise MissingLibraryError('--scheduler needs Dask: pip install "thermofem[dask]"') from None
    except Exception as error:  # TypeError, too, of protocols that are not set up
        raise InputError(f"--scheduler = {scheduler!r} does not answer: {' '.join(str(error).split())}") from None
    with client:
        yield client.get_executor(pure=False)
