"""The loop of a campaign: each geometry is solved in a worker, which writes its file; this process keeps the books."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from ..data import files, netcdf
from ..errors import InputError, MissingLibraryError
from ..fem import HeatProblem
from ..fem.assembly import assemble_like
from ..geometry import CrossSection
from ..geometry.guides import LIGHT
from ..solving import solve, solve_periodic
from .collection import NUMBERS, Folder, Row, write_collections
from .stored_tasks import completed

if TYPE_CHECKING:
    from .plan import Campaign, Case


@dataclass(frozen=True)
class Summary:
    """Progress of a campaign.

    Attributes
    ----------
    total, reused, finished, failed : int
        all geometries; with a result from earlier runs; with one from this run; without a result, now or earlier.
    seconds, cpu_seconds : float
        of this run: wall time of the solving, CPU time of the geometries in the workers.
    """

    total: int
    reused: int = 0
    finished: int = 0
    failed: int = 0
    seconds: float = 0.0
    cpu_seconds: float = 0.0

    @property
    def done(self) -> int:
        """Geometries that need no more work."""
        return self.reused + self.finished + self.failed


@dataclass(frozen=True)
class Outcome:
    """What a worker reports of one geometry: the reason of a failure, CPU seconds, and its row of the index."""

    reason: str
    cpu: float
    row: Row = field(default_factory=dict)


def run(
    campaign: Campaign,
    directory: str | Path,
    executor: Executor | None = None,
    *,
    workers: int | None = None,
    retry_failed: bool = False,
    report: Callable[[Summary], None] | None = None,
) -> Summary:
    """Solve every geometry of a campaign that has no result yet, and write index and training collection.

    Parameters
    ----------
    campaign : Campaign
    directory : str or Path
        of the results; another run continues there.
    executor : concurrent.futures.Executor
        whose workers reach the folder, such as Dask's or ``mpi4py.futures``; default processes of our own.
    workers : int
        number of these processes; default one for each CPU.
    retry_failed : bool
        take geometries that failed in an earlier run again.
    report : callable
        gets a `Summary` when the base geometry is checked, and after every geometry.

    Raises
    ------
    InputError
        no drive; the folder cannot be written or is in use; a base geometry that cannot be solved; an executor that
        breaks. Finished results are kept.
    MissingLibraryError
        meshes must be made and gmsh cannot be loaded.
    """
    if not campaign.drives:
        raise InputError(f"campaign {campaign.name!r} has no drive", "add a [[drive]] table (a family needs none)")
    report = report or (lambda summary: None)
    folder, cases = Folder(Path(directory).absolute()), campaign.cases()  # workers have other working folders
    with folder.opened():
        folder.write_plan(campaign, cases)
        there = folder.store.intact([case.key for case in cases])
        failed = set() if retry_failed else {case.key for case in cases if folder.reason(case.key)} - there
        waiting = [case for case in cases if case.key not in there | failed]
        summary = Summary(len(cases), reused=len(there), failed=len(failed))
        if waiting:
            _assembled(campaign, campaign.geometry)
        report(summary)
        rows, begin = {}, time.perf_counter()
        work = partial(compute, campaign, folder)
        for case, future in completed(work, waiting, executor=executor, workers=workers):
            error = future.exception()
            if isinstance(error, MissingLibraryError | BrokenExecutor):
                kept = summary.reused + summary.finished
                raise error if isinstance(error, MissingLibraryError) else InputError(
                    f"the executor broke ({error})", f"{kept} finished geometries are kept, run again with a new one"
                )  # fmt: skip
            outcome = future.result() if error is None else Outcome(str(error), 0.0)
            if outcome.reason:
                folder.write_failure(case.key, outcome.reason, campaign.named(case))
                summary = replace(summary, failed=summary.failed + 1)
            else:
                folder.store.enter(case.key)
                folder.failure(case.key).unlink(missing_ok=True)
                rows[case.key] = outcome.row
                summary = replace(summary, finished=summary.finished + 1)
            spent = summary.cpu_seconds + outcome.cpu
            summary = replace(summary, cpu_seconds=spent, seconds=time.perf_counter() - begin)
            report(summary)
        write_collections(folder, rows)
    return summary


def _assembled(campaign: Campaign, geometry: str) -> HeatProblem:
    """The heat problem of one geometry, on the moved mesh of the base where that keeps the accuracy."""
    base = campaign.geometry if campaign.variations else ""
    heat = assemble_like(base, CrossSection.from_toml_text(geometry), campaign.accuracy)
    if LIGHT in campaign.read:
        heat = heat.lit
    heat.channels(campaign.heated or heat.heated[0], campaign.read or None)
    return heat


def compute(campaign: Campaign, folder: Folder, case: Case) -> Outcome:
    """Solve one geometry under every drive and write its file; this runs in a worker.

    Raises MissingLibraryError: no other geometry would fare better.
    """
    start = time.thread_time()
    try:
        results = _solved(campaign, case)
        _write(results, folder.store.path(case.key))
    except MissingLibraryError:
        raise
    except Exception as error:  # whatever stops one geometry is recorded, and the others go on
        kind = "" if isinstance(error, InputError) else f"{type(error).__name__}: "
        return Outcome(f"{kind}{error}" or "no message", time.thread_time() - start)
    return Outcome("", time.thread_time() - start, _row(results))


def _solved(campaign: Campaign, case: Case) -> dict[str, xr.Dataset]:
    """One result for each drive, as `thermofem.solve` returns it."""
    heat = _assembled(campaign, campaign.geometry_of(case.values))
    heated = campaign.heated or heat.heated[0]
    names = campaign.read or (heated,)
    channels: dict[str, Any] = {"heated": heated, "read": names[0] if len(names) == 1 else names, "rtol": campaign.rtol}
    results = {}
    for drive in campaign.drives:
        if drive.times:
            found = solve(heat, drive.wave, drive.kept, **channels)
        else:
            found = solve_periodic(heat, drive.wave, drive.samples, **channels)
        found.attrs |= {
            "thermal_resistances": [heat.thermal_resistance(heated, name) for name in names],
            "drive": drive.name,
            "campaign_case": case.key,
            "campaign_values": json.dumps(campaign.named(case)),
        }
        results[drive.name] = found
    return results


def _write(results: dict[str, xr.Dataset], path: Path) -> None:
    """Write the results of one geometry: the first as `thermofem.load` reads it, each further one as a group."""

    def write(temporary: Path) -> None:
        for number, (name, data) in enumerate(results.items()):
            data.attrs = netcdf.signed(data.variables, data.attrs)
            data.to_netcdf(temporary, engine="h5netcdf", group=name if number else None, mode="a" if number else "w")

    files.write_whole(path, write)


def _row(results: dict[str, xr.Dataset]) -> Row:
    """Values of one geometry for the index, see `collection`."""
    first = next(iter(results.values())).attrs
    row = {name: np.asarray(first[name], dtype=float) for name in NUMBERS}
    row["thermal_resistance"] = np.asarray(first["thermal_resistances"], dtype=float)
    for name, data in results.items():
        rise = data["delta_T"].values
        row[f"delta_T_{name}"] = rise[:, None] if rise.ndim == 1 else rise
    return row
