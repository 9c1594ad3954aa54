"""Plan of a campaign: base geometry, varied quantities, drives and probes."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.stats import qmc

from .. import checks, waveforms
from ..data import files
from ..data.variables import known
from ..errors import InputError
from ..geometry.parameter_paths import check_once, place
from ..mesh.element_sizes import sizes
from ..version import __version__
from . import campaign_file
from .campaign_file import Drive, Value, Variation

if TYPE_CHECKING:
    from .campaign_run import Summary

LARGEST = 1_000_000  # geometries of one campaign
# names of variables and dimensions of the index and of the training collection
INDEX = ("case", "key", "status", "reason", "probe", "thermal_resistance", "unknowns", "discretization_error",
         "domain_error", "feature", "features", "feature_unit")  # fmt: skip


@dataclass(frozen=True)
class Case:
    """One geometry: the values of the variations and the content hash that names its file."""

    key: str
    values: tuple[Value, ...]


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
        if len(self) > LARGEST:
            raise InputError(f"{len(self)} geometries are more than {LARGEST}", "take fewer values or draw from ranges")
        self.geometry_of(next(self._values()))  # a path that leads nowhere raises here

    def _check_names(self) -> None:
        """InputError where two names are equal, or one is that of a variable of the index."""
        taken = {*INDEX, *(f"{kind}_{d.name}" for d in self.drives for kind in ("time", "power", "delta_T"))}
        for what, items in (("drive", self.drives), ("vary", self.variations)):
            checks.unique(f"{what} names", [item.name for item in items])
        for variation in self.variations:
            own = known(variation.name)
            if variation.name in taken or (own and own.unit != variation.unit):
                raise InputError(f"vary: name = {variation.name!r} is taken by the index or by files", "choose another")

    @classmethod
    def from_toml(cls, path: str | Path) -> Campaign:
        """Read a campaign file; InputErrors begin with the name of the file."""
        folder = Path(path).parent
        return files.read_toml(path, "campaign", lambda text: cls(**campaign_file.fields(text, folder)))

    def __len__(self) -> int:
        return math.prod(len(v.values) for v in self.variations if v.values) * max(self.samples, 1)

    @cached_property
    def _table(self) -> dict[str, Any]:
        return files.from_toml(self.geometry)

    def _values(self) -> Iterator[tuple[Value, ...]]:
        """The values of every geometry, in order: lists crossed, the first one slowest, hypercube innermost."""
        drawn = [v for v in self.variations if not v.values]
        points = self._hypercube(drawn) if drawn else [[]]
        for listed in itertools.product(*(v.values for v in self.variations if v.values)):
            for point in points:
                grid, free = iter(listed), iter(point)
                yield tuple(next(grid) if v.values else next(free) for v in self.variations)

    def _hypercube(self, drawn: list[Variation]) -> list[list[float]]:
        """Points that fall once into each of ``samples`` equal slices of every range, to nine digits."""
        shares = qmc.LatinHypercube(len(drawn), rng=np.random.default_rng(self.seed)).random(self.samples)
        return [[float(f"{v.at(x):.9g}") for v, x in zip(drawn, row, strict=True)] for row in shares]

    def geometry_of(self, values: tuple[Value, ...]) -> str:
        """Text of the geometry file with these values."""
        table = json.loads(json.dumps(self._table))
        for variation, value in zip(self.variations, values, strict=True):
            for path in variation.paths:
                place(table, path, variation.text(value))
        return files.to_toml(table)

    def named(self, case: Case) -> dict[str, Value]:
        """The values of one geometry by name."""
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
            key = hashlib.sha256(content.encode()).hexdigest()[:16]
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
        """Compute every geometry that the folder does not hold yet; see `campaign_run.run`."""
        from .campaign_run import run

        return run(self, directory, executor, workers=workers, retry_failed=retry_failed, report=report)
