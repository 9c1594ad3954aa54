"""Training data of ``fit``: netCDF, or tables with the heating that the options state."""

from pathlib import Path
from typing import Any

import typer
import xarray as xr

import thermofem as th
from thermofem import InputError
from thermofem.data import files
from thermofem.data.measured_trace import check_text

from .. import options
from ..console import note, working
from .command_files import expect, kind_of
from .drive_texts import heating

TABLE = "a table of numbers"
OF_TABLES = "columns", "units", "time", "temperature", "sensitivity", "start", "baseline", "fall", "readout"
DRIVE = "power", "pulse", "square", "duty"


def read_channel(path: Path, data: xr.Dataset, heated: str | None, read: str | None) -> xr.Dataset:
    """Return the data of the part that --heated and --read name; a table gets the names as attributes."""
    if kind_of(path) == "table":
        return data
    was = data.attrs.get("heated")
    if heated is not None and was is not None and heated != was:
        raise InputError(f"--heated = {heated!r}, but {path} says that {was!r} was heated")
    data = data if heated is None else data.assign_attrs(heated=heated)
    return data if read is None else th.dataset.at_probe(data, read)


def training_of(
    context: typer.Context, paths: list[Path], read_as: dict[str, Any]
) -> tuple[list[xr.Dataset], list[str]]:
    """Return the training data of every file, and the assumptions made for tables (read with ``read_as``)."""
    for path in paths:
        check_text(files.regular(path))
        expect(path, "data", "table")
    drive = [context.params[name] for name in DRIVE]
    tables = [path for path in paths if kind_of(path) == "table"]
    if not tables:
        why = f"is for {TABLE}; netCDF data say themselves what was applied"
        options.unused(context, why, *DRIVE, *OF_TABLES)
        return [th.load(path) for path in paths], []
    if drive[0] is None:
        raise InputError(
            f'{tables[0]} holds {TABLE}: say what was applied, --power "1.3 mW" with --pulse "4 us" or --square; '
            "with a column of power, thermofem.read_trace makes training data of it"
        )
    wave = heating(context, *drive)
    training: list[xr.Dataset] = []
    assumed: list[str] = []
    for path in paths:
        if path not in tables:
            training.append(th.load(path))
            continue
        with working(f"reading {path.name}"):
            trace = th.read_trace(path, wave, **read_as)
        lines = [f"{path.name}: {line}" for line in trace.attrs["assumed"].splitlines()]
        for line in lines:
            note(line)
        assumed += lines
        training.append(trace)
    return training, assumed
