"""Campaigns: base geometry, varied quantities, drives and probes, and the loop over the geometries.

Each geometry is solved in a worker process, which writes its file (`compute`); the process that called `Campaign.run`
records which are finished and which failed. The way of a campaign: `campaign_file` reads it, `Campaign.cases` lists the
geometries, `stored_tasks` hands them to workers, `collection` joins their files.
"""

from __future__ import annotations

import itertools
import json
import math
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from .. import __version__, checks, waveforms
from ..data import files
from ..data.variables import known
from ..errors import InputError, MissingLibraryError
from ..fem import HeatProblem
from ..fem.assembly import assemble_like
from ..geometry import CrossSection
from ..geometry.parameter_paths import check_once, place
from ..geometry.section_parts import LIGHT
from ..mesh.element_sizes import sizes
from ..solving import solve, solve_periodic
from . import campaign_file
from .campaign_file import Drive, Value, Variation
from .collection import Folder, write_collections
from .stored_tasks import completed

# names of variables and dimensions of the index and of the training collection
INDEX = ("case", "key", "status", "reason", "probe", "thermal_resistance", "unknowns", "discretization_error",
         "domain_error", "feature", "features", "feature_unit")  # fmt: skip


@dataclass(frozen=True)
class Case:
    """One geometry: the values of the variations and the content hash that names its file."""

    key: str
    values: tuple[Value, ...]


@dataclass(frozen=True)
class Summary:
    """Progress of a campaign.

    Attributes
    ----------
    total, reused, finished, failed : int
        all geometries; with a result from earlier runs; with one from this run; without a result, now or earlier.
    seconds : float
        wall time of this run.
    """

    total: int
    reused: int = 0
    finished: int = 0
    failed: int = 0
    seconds: float = 0.0

    @property
    def done(self) -> int:
        """Geometries that need no more work."""
        return self.reused + self.finished + self.failed


@dataclass(frozen=True)
class Campaign:
    """A base geometry, what is varied, and how each geometry is driven and read.

    Parameters
    ----------
    geometry : str
        text of a geometry file.
    variations : tuple of Variation
        the listed ones are crossed; every combination meets every point of the Latin hypercube of the others.
    drives : tuple of Drive
        of every geometry; a family needs none.
    name : str
    heated : str
        default the first heated part.
    read : tuple of str
        parts and layers to read; default the heated part.
    accuracy, rtol : float
        of the mesh and of the time integration.
    samples, seed : int
        number of points of the Latin hypercube, and its seed.

    Raises
    ------
    InputError
        what contradicts itself, names what is not in the geometry, or makes more than a million geometries.
    """

    geometry: str
    variations: tuple[Variation, ...]
    drives: tuple[Drive, ...] = ()
    name: str = "campaign"
    heated: str | None = None
    read: tuple[str, ...] = ()
    accuracy: float = 1e-3
    rtol: float = 1e-4
    samples: int = 0
    seed: int = 0

    def __post_init__(self) -> None:
        sizes(self.accuracy)  # the rule of the meshes
        checks.between("rtol", self.rtol, 1e-10, 0.1)
        self._check_names()
        check_once(path for variation in self.variations for path in variation.paths)
        drawn = [v.name for v in self.variations if not v.values]
        if bool(drawn) != bool(self.samples):
            raise InputError(
                f"samples = {self.samples} with ranges to draw from: {', '.join(drawn) or 'none'}",
                "samples is the number of points drawn from ranges without count",
            )
        checks.integer("number of geometries", len(self), 1, 1_000_000, hint="take fewer values or draw from ranges")
        self.geometry_of(next(self._values()))  # a path that leads nowhere raises here

    def _check_names(self) -> None:
        """Raise InputError where two names are equal, or one is taken by a variable of the index."""
        taken = {*INDEX, *(f"{kind}_{d.name}" for d in self.drives for kind in ("time", "power", "delta_T"))}
        for what, items in (("drive", self.drives), ("vary", self.variations)):
            checks.unique(f"{what} names", [item.name for item in items])
        for variation in self.variations:
            variable = known(variation.name)
            other_unit = variable is not None and variable.unit != variation.unit
            if other_unit or variation.name in taken:
                raise InputError(f"vary: name = {variation.name!r} is taken by the index or by files", "choose another")

    @classmethod
    def from_toml(cls, path: str | Path) -> Campaign:
        """Read a campaign file; InputErrors begin with the name of the file."""
        folder = Path(path).parent
        return files.read_toml(path, "campaign", lambda text: cls(**campaign_file.fields(text, folder)))

    def __len__(self) -> int:
        listed = math.prod(len(v.values) for v in self.variations if v.values)
        return listed * max(self.samples, 1)

    @cached_property
    def _table(self) -> dict[str, Any]:
        return files.from_toml(self.geometry)

    def _values(self) -> Iterator[tuple[Value, ...]]:
        """The values of every geometry, in order: lists crossed, the first one slowest, hypercube innermost."""
        drawn = [v for v in self.variations if not v.values]
        points = self._hypercube(drawn) if drawn else [[]]
        for listed in itertools.product(*(v.values for v in self.variations if v.values)):
            for point in points:
                grid = iter(listed)
                free = iter(point)
                yield tuple(next(grid) if v.values else next(free) for v in self.variations)

    def _hypercube(self, drawn: list[Variation]) -> list[list[float]]:
        """Points of the Latin hypercube: one in each of ``samples`` equal slices of every range, to nine digits."""
        from scipy.stats import qmc

        cube = qmc.LatinHypercube(len(drawn), rng=np.random.default_rng(self.seed))
        points = []
        for shares in cube.random(self.samples):
            numbers = [variation.at(share) for variation, share in zip(drawn, shares, strict=True)]
            points.append([float(f"{number:.9g}") for number in numbers])
        return points

    def geometry_of(self, values: tuple[Value, ...]) -> str:
        """Text of the geometry file with these values."""
        table = json.loads(json.dumps(self._table))
        for variation, value in zip(self.variations, values, strict=True):
            for path in variation.paths:
                place(table, path, variation.text(value))
        return files.to_toml(table)

    def named(self, case: Case) -> dict[str, Value]:
        """Values of the varied quantities of one geometry, by name."""
        return {v.name: value for v, value in zip(self.variations, case.values, strict=True)}

    def cases(self) -> list[Case]:
        """Every geometry once, with the hash of all that determines its result."""
        drives = [(d.name, waveforms.to_json(d.wave), d.times or d.samples) for d in self.drives]
        base = files.to_toml(self._table) if self.variations else ""  # whose mesh is moved to fit each geometry
        names = [v.name for v in self.variations]  # which the results hold
        # version 2 of the result files; it enters the hash of every geometry
        shared = (2, __version__, base, names, drives, self.heated, self.read, self.accuracy, self.rtol)
        seen: dict[str, Case] = {}
        for values in self._values():
            content = json.dumps((self.geometry_of(values), *shared))
            key = files.digest(content.encode())[:16]
            seen.setdefault(key, Case(key, values))
        return list(seen.values())

    def run(
        self,
        directory: str | Path,
        executor: Executor | None = None,
        *,
        workers: int | None = None,
        retry_failed: bool = False,
        report: Callable[[Summary], None] | None = None,
    ) -> Summary:
        """Solve every geometry that has no result yet, and write index and training collection.

        Parameters
        ----------
        directory : str or Path
            of the results; another run continues there.
        executor : concurrent.futures.Executor
            whose workers reach the folder, such as Dask's or ``mpi4py.futures``; default worker processes.
        workers : int
            number of these processes; default one for each CPU.
        retry_failed : bool
            take geometries that failed in an earlier run again.
        report : callable
            gets a `Summary` when the base geometry is checked, and after every geometry.

        Raises
        ------
        InputError
            no drive; the folder cannot be written or is in use; a base geometry that cannot be solved. Finished results
            are kept.
        MissingLibraryError
            meshes must be made and gmsh cannot be loaded.
        """
        begin = time.perf_counter()
        hint = "add a [[drive]] table (a family needs none)"
        checks.enough(f"campaign {self.name!r}", len(self.drives), 1, "drives", hint=hint)
        report = report or (lambda summary: None)
        folder = Folder(Path(directory).absolute())
        cases = self.cases()  # workers have other working folders
        with folder.opened("failures"):
            folder.write_plan(self, cases)
            there = folder.intact([case.key for case in cases])
            failed = set() if retry_failed else {case.key for case in cases if folder.reason(case.key)} - there
            waiting = [case for case in cases if case.key not in there | failed]
            summary = Summary(len(cases), reused=len(there), failed=len(failed))
            if waiting:
                _assembled(self, self.geometry)
            report(summary)
            work = partial(compute, self, folder)
            for case, future in completed(work, waiting, executor=executor, workers=workers):
                error = future.exception()
                known = error is None or isinstance(error, MissingLibraryError)  # a library that every geometry needs
                reason = future.result() if known else str(error)
                if reason:
                    folder.write_failure(case.key, reason, self.named(case))
                    summary = replace(summary, failed=summary.failed + 1)
                else:
                    folder.enter(case.key)
                    folder.failure(case.key).unlink(missing_ok=True)
                    summary = replace(summary, finished=summary.finished + 1)
                summary = replace(summary, seconds=time.perf_counter() - begin)
                report(summary)
            write_collections(folder)
        return replace(summary, seconds=time.perf_counter() - begin)


def _assembled(campaign: Campaign, geometry: str) -> HeatProblem:
    """The heat problem of one geometry, on the moved mesh of the base where that keeps the accuracy."""
    base = campaign.geometry if campaign.variations else ""
    heat = assemble_like(base, CrossSection.from_toml_text(geometry), campaign.accuracy)
    if LIGHT in campaign.read:
        heat = heat.lit
    heat.channels(campaign.heated or heat.heated[0], campaign.read or None)
    return heat


def compute(campaign: Campaign, folder: Folder, case: Case) -> str:
    """Solve one geometry under every drive and write its file, in a worker; returns the reason of a failure, or "".

    Raises MissingLibraryError: a library is missing, which every other geometry needs as well.
    """
    try:
        _write(_solved(campaign, case), folder.path(case.key))
    except MissingLibraryError:
        raise
    except Exception as error:  # whatever stops one geometry is recorded, and the others go on
        kind = "" if isinstance(error, InputError) else f"{type(error).__name__}: "
        return f"{kind}{error}" or "no message"
    return ""


def _solved(campaign: Campaign, case: Case) -> dict[str, xr.Dataset]:
    """One result for each drive, as `thermofem.solve` returns it."""
    heat = _assembled(campaign, campaign.geometry_of(case.values))
    heated = campaign.heated or heat.heated[0]
    names = campaign.read or (heated,)
    read = names[0] if len(names) == 1 else names
    options: dict[str, Any] = {"heated": heated, "read": read, "rtol": campaign.rtol}
    resistances = [heat.thermal_resistance(heated, name) for name in names]
    results = {}
    for drive in campaign.drives:
        if drive.times:
            data = solve(heat, drive.wave, drive.kept, **options)
        else:
            data = solve_periodic(heat, drive.wave, drive.samples, **options)
        data.attrs["thermal_resistances"] = resistances
        data.attrs["drive"] = drive.name
        data.attrs["campaign_case"] = case.key
        data.attrs["campaign_values"] = json.dumps(campaign.named(case))
        results[drive.name] = data
    return results


def _write(results: dict[str, xr.Dataset], path: Path) -> None:
    """Write the results of one geometry: the first as `thermofem.load` reads it, each further one as a group."""

    def write(temporary: Path) -> None:
        for number, (name, data) in enumerate(results.items()):
            data.to_netcdf(temporary, engine="h5netcdf", group=name if number else None, mode="a" if number else "w")

    files.write_whole(path, write)
