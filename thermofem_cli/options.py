"""Arguments and options that several commands take, each declared once; processes and clusters of --workers."""

from __future__ import annotations

import contextlib
import functools
import inspect
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from . import console

if TYPE_CHECKING:
    from concurrent.futures import Executor

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
Mesh = Annotated[
    Path | None, typer.Option(help="Your own mesh (.msh, in m): triangles in groups named after layers and parts.")
]
Accuracy = Annotated[float, typer.Option(help="Wanted relative error of the mesh.")]

Model = Annotated[Path, typer.Argument(help="Thermal model (JSON).")]
Heated = Annotated[str | None, typer.Option(help="Part that takes the heat, of a model of several parts.")]
Read = Annotated[str | None, typer.Option(help="Part that is read, of a model of several parts; default: the heated.")]
CONSTANT_HEATER = "Constant power, voltage or current of another part: 'heater=5 mW' or '1.2 V'."
Heater = Annotated[list[str] | None, typer.Option("--heater", help=CONSTANT_HEATER)]
HEATER = (
    "Power, voltage or current of another part (heater where it has no name): 'heater=5 mW', '1.2 V', "
    "'heater=5 mW square 1 us duty 0.3' or 'heater=5 mW pulse 1 us at 2 us'."
)
VaryingHeater = Annotated[list[str] | None, typer.Option("--heater", help=HEATER)]

REFERENCE_RING = "borghi2021"
RING = "Ring file (TOML), or one of borghi2021, borghi2021-lumped, vanvaerenbergh2012"
Ring = Annotated[str, typer.Option(help=f"{RING}; a lumped one goes with Newton's law.")]
Power = Annotated[str, typer.Option(help="Power in the bus waveguide.")]
Detuning = Annotated[
    str, typer.Option(help="Laser minus cold resonance: '-10 GHz', or in wavelength '80 pm' (to the red).")
]
Powers = Annotated[str, typer.Option("--power", help="First and last power in the bus waveguide.")]
Detunings = Annotated[str, typer.Option("--detuning", help="First and last laser minus cold resonance.")]


class PlaneTexts(NamedTuple):
    """First and last power and detuning of a plane, as the options take them."""

    power: str
    detuning: str


PAPER_PLANE = PlaneTexts("3 dBm, 10 dBm", "-30 GHz, 30 GHz")
PowersAbout = Annotated[
    str | None,
    typer.Option(
        "--power", help="First and last power; default: from half the lowest one of the Hopf curve to 5 times."
    ),
]
DetuningsAbout = Annotated[
    str | None,
    typer.Option("--detuning", help="First and last laser minus cold resonance; default: those of the Hopf curve."),
]
Points = Annotated[str, typer.Option(help="Number of powers and of detunings.")]
Duration = Annotated[str, typer.Option(help="Length of the run, from a cold start.")]
Rtol = Annotated[float, typer.Option(help="Relative error of the integration.")]
Wavelength = Annotated[
    str | None,
    typer.Option(help="Vacuum wavelength; a ring has the resonance next to it. Default: that of [light], or 1550 nm."),
]
HELD = "Standard deviation of a number that is held, as a share of it: 'fca_cross_section=5 %'. Repeatable."
Held = Annotated[list[str] | None, typer.Option(help=HELD)]
Pulse = Annotated[str | None, typer.Option(help="Heat for this long, e.g. '20 us'; default: a step.")]
Square = Annotated[str | None, typer.Option(help="Heat in a square wave of this period, from rest, e.g. '1 us'.")]
Duty = Annotated[float | None, typer.Option(help="Duty cycle of the square wave; default 1/3.")]

Family = Annotated[Path, typer.Argument(metavar="FAMILY", help="Family file of thermofem family.")]
Fix = Annotated[list[str] | None, typer.Option(help="Keep a parameter, e.g. 'radius=7 um'; may be repeated.")]

Workers = Annotated[int | None, typer.Option(min=1, max=1024, help="Worker processes; default: one for each CPU.")]
Processes = Annotated[int, typer.Option("--workers", min=1, max=1024, help="Worker processes.")]
Scheduler = Annotated[str | None, typer.Option(help="Address of a Dask scheduler to compute on.")]

FieldTimes = Annotated[list[str] | None, typer.Option(help="Keep the field at '1 us, 5 us, ...'.")]
Paraview = Annotated[Path | None, typer.Option(help="Write the fields for ParaView: .xdmf, or .vtu of one time.")]
Figure = Annotated[Path | None, typer.Option(help="Also draw into this image.")]
Table = Annotated[Path | None, typer.Option("--csv", help="Also write a table (CSV), in SI.")]
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
            raise InputError(f"--{name.strip('_').replace('_', '-')}{said} {why}; leave it out")


def with_common(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return the command with the options of all commands (`EVERYWHERE`: --json, --quiet, --verbose, --threads) added.

    They set up the console; ``command`` itself gets only those of them that are among its own arguments.
    """
    arguments = inspect.signature(command, eval_str=True).parameters
    common = {
        name: inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=kind, default=default)
        for name, (kind, default) in EVERYWHERE.items()
    }
    others = [value for name, value in arguments.items() if name not in common]

    @functools.wraps(command)
    def run(json: bool, quiet: bool, verbose: bool, threads: int | None, **values: Any) -> Any:
        from thermofem.models import OutsideTrainingWarning

        warnings.simplefilter("default", OutsideTrainingWarning)  # `main` ignores the others
        console.configure(json=json, quiet=quiet, verbose=verbose, threads=threads)
        return command(**{name: value for name, value in values.items() if name in arguments})

    parameters = [*others, *(arguments.get(name, parameter) for name, parameter in common.items())]
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
