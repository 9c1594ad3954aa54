"""One geometry of a campaign, from its text to the bytes of its netCDF file; this is what runs in a worker."""

from __future__ import annotations

import logging
import os
import signal
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from ..checks import MissingLibraryError
from ..data import netcdf
from .collect import NUMBERS, Row

if TYPE_CHECKING:
    from ..fem import HeatProblem
    from .vary import Drive


@dataclass(frozen=True)
class Task:
    """Everything that determines the result of one geometry.

    Attributes
    ----------
    key : str
        content hash, the name of its file.
    geometry : str
        text of a geometry file.
    values : str
        the varied quantities as JSON.
    drives, heated, read, accuracy, rtol
        as in `Campaign`.
    base : str
        text of the geometry file whose mesh is moved to this geometry where that keeps the accuracy; "" for none.
    """

    key: str
    geometry: str
    values: str
    drives: tuple[Drive, ...]
    heated: str | None
    read: tuple[str, ...]
    accuracy: float
    rtol: float
    base: str = ""


@dataclass(frozen=True)
class Outcome:
    """Result of a worker: the content of the file, or the reason of the failure; CPU seconds; and the index's row."""

    key: str
    content: bytes
    reason: str
    cpu: float
    row: Row = field(default_factory=dict)


def prepare() -> None:
    """Set up a worker process; warnings about the domain stay silent: the index holds ``domain_error`` of each case."""
    logging.getLogger("thermofem").setLevel(logging.ERROR)
    follow_parent()


def follow_parent() -> None:
    """In a worker process: the parent alone hears Ctrl-C, and a worker never outlives its parent."""
    import multiprocessing

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:

        def follow() -> None:
            parent.join()
            os._exit(1)

        threading.Thread(target=follow, daemon=True).start()


def ready(task: Task | None) -> None:
    """Load the libraries; with a task, check that its geometry meshes and that its names exist."""
    if task is None:
        from . import libraries  # noqa: F401
    else:
        _assemble(task)


def compute(task: Task) -> Outcome:
    """Solve one geometry under every drive.

    A geometry that cannot be solved comes back with its reason.

    Raises
    ------
    MissingLibraryError
        no other geometry would fare better.
    """
    start = time.thread_time()
    try:
        results = _solve(task)
        content, row = filled(results), _row(results)
    except MissingLibraryError:
        raise
    except Exception as error:  # whatever stops one geometry is recorded, and the others go on
        text = " ".join(str(error).split()) or "no message"
        reason = text if isinstance(error, ValueError) else f"{type(error).__name__}: {text}"
        return Outcome(task.key, b"", reason, time.thread_time() - start)
    return Outcome(task.key, content, "", time.thread_time() - start, row)


def _assemble(task: Task) -> HeatProblem:
    from ..fem.assembly import assemble_like
    from ..geometry import CrossSection

    heat = assemble_like(task.base, CrossSection.from_toml_text(task.geometry), task.accuracy)
    heat.channels(task.heated or heat.heated[0], task.read or None)
    return heat


def filled(results: dict[str, xr.Dataset]) -> bytes:
    """Content of a netCDF file: the first result is its root, each further one a group; each has its hash."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "result.nc"
        for number, (name, data) in enumerate(results.items()):
            signed = data.assign_attrs(netcdf.signed(data.variables, data.attrs))
            signed.to_netcdf(path, mode="a" if number else "w", group=name if number else None, engine="h5netcdf")
        return path.read_bytes()


def _solve(task: Task) -> dict[str, xr.Dataset]:
    """One result for each drive, in the schema of `thermofem.dataset`."""
    from ..solving import solve, solve_periodic

    heat = _assemble(task)
    heated = task.heated or heat.heated[0]
    names = task.read or (heated,)
    wanted = names[0] if len(names) == 1 else names
    resistances = [heat.thermal_resistance(heated, name) for name in names]
    results = {}
    for drive in task.drives:
        if drive.times:
            found = solve(heat, drive.wave, drive.kept, heated=heated, read=wanted, rtol=task.rtol)
        else:
            samples = drive.samples
            found = solve_periodic(heat, drive.wave, samples, heated=heated, read=wanted, rtol=task.rtol)
        provenance = {"drive": drive.name, "campaign_case": task.key, "campaign_values": task.values}
        attrs = {**found.attrs, "thermal_resistances": resistances, **provenance}
        results[drive.name] = found.assign_attrs(attrs)
    return results


def _row(results: dict[str, xr.Dataset]) -> Row:
    """Values of one geometry for the index, see `collect`."""
    first = next(iter(results.values())).attrs
    row = {name: np.asarray(first[name], dtype=float) for name in NUMBERS}
    row["thermal_resistance"] = np.asarray(first["thermal_resistances"], dtype=float)
    for name, record in results.items():
        rise = record["delta_T"].values
        row[f"delta_T_{name}"] = rise[:, None] if rise.ndim == 1 else rise
    return row
