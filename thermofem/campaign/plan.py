"""Plan of a campaign: base geometry, varied quantities, drives and probes."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import tomllib
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks, waveforms
from ..checks import InputError
from ..data import files
from ..data.files import to_toml
from ..geometry.paths import check_once, place
from ..mesh.sizes import sizes
from ..version import __version__
from . import schema
from .vary import LARGEST, Drive, Value, Variation, check_number, check_taken

if TYPE_CHECKING:
    from .run import Summary
    from .work import Task

FORMAT = 1  # of what enters the content hash, and of the files


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
        checks.plain(self)
        checks.text("geometry", self.geometry)
        checks.text("name", self.name)
        if self.heated is not None:
            checks.text("heated", self.heated)
        checks.seed(self.seed)
        checks.integer("samples", self.samples, 0, np.inf)
        for field, kind in (("variations", Variation), ("drives", Drive), ("read", str)):
            object.__setattr__(self, field, checks.instances(field, getattr(self, field), kind))
        sizes(self.accuracy)  # the rule of the meshes
        checks.between("rtol", self.rtol, 1e-10, 0.1)
        for what, names in (("drive", self.drives), ("vary", self.variations)):
            check_number(what, len(names))
            checks.unique(f"list of {what} names", [item.name for item in names])
        check_taken(self.variations, self.drives)
        check_once(path for variation in self.variations for path in variation.paths)
        drawn = [v.name for v in self.variations if not v.values]
        if bool(drawn) != bool(self.samples):
            raise InputError(
                f"{', '.join(drawn)} has a range without count: give samples, the number of points to draw from it"
                if drawn
                else f"samples = {self.samples} but nothing has a range to draw from; leave it out"
            )
        checks.integer("samples", self.samples, 0, LARGEST)
        if len(self) > LARGEST:
            raise InputError(f"{len(self)} geometries are more than {LARGEST}; take fewer values or draw from ranges")
        first = next(self._values())
        self.geometry_of(first)  # a path that leads nowhere raises here

    @classmethod
    def from_toml(cls, path: str | Path) -> Campaign:
        """Read a campaign file; InputErrors begin with the name of the file."""
        return files.read_toml(path, "campaign", lambda text: cls(**schema.fields(text, Path(path).parent)))

    def __len__(self) -> int:
        return math.prod(len(v.values) for v in self.variations if v.values) * max(self.samples, 1)

    @cached_property
    def _table(self) -> dict[str, Any]:
        try:
            return tomllib.loads(self.geometry)
        except (tomllib.TOMLDecodeError, RecursionError) as error:
            hint = "give the text of a geometry file, e.g. th.strip_ring().to_toml()"
            raise InputError(f"geometry is not valid TOML: {error}", hint) from None

    def _values(self) -> Iterator[tuple[Value, ...]]:
        """The values of every geometry, in order: lists crossed, the first one slowest, hypercube innermost."""
        drawn = [v for v in self.variations if not v.values]
        points = [[]] if not drawn else self._hypercube(drawn)
        for listed in itertools.product(*(v.values for v in self.variations if v.values)):
            for point in points:
                grid, free = iter(listed), iter(point)
                yield tuple(next(grid) if v.values else next(free) for v in self.variations)

    def _hypercube(self, drawn: list[Variation]) -> list[list[float]]:
        """Points that fall once into each of ``samples`` equal slices of every range, as SciPy draws them.

        SciPy's own function would import more than all of a campaign's main process.
        """
        draw, count = np.random.default_rng(self.seed).spawn(1)[0], self.samples
        inside = draw.uniform(size=(count, len(drawn)))
        slices = np.tile(np.arange(1, count + 1), (len(drawn), 1))
        for row in slices:
            draw.shuffle(row)
        points = (slices.T - inside) / count
        # nine digits: geometry file and index agree to the last one
        return [[float(f"{v.at(x):.9g}") for v, x in zip(drawn, row, strict=True)] for row in points]

    def geometry_of(self, values: tuple[Value, ...]) -> str:
        """Text of the geometry file with these values."""
        checks.instance("values", values, tuple, list, hint="a value for each variation is needed")
        values = checks.instances("values", values, str, float, int, np.number)
        values = tuple(v if isinstance(v, str) else checks.finite("values", v) for v in values)
        if len(values) != len(self.variations):
            raise InputError(f"values holds {len(values)} values; {len(self.variations)} vary")
        table = json.loads(json.dumps(self._table))
        for variation, value in zip(self.variations, values, strict=True):
            for path in variation.paths:
                place(table, path, variation.text(value))
        return to_toml(table)

    def check_channels(self) -> None:
        """InputError where the base geometry has no such heated part, or nothing of these names to read."""
        from ..geometry import CrossSection

        try:
            base = CrossSection.from_toml_text(self.geometry)
        except InputError:  # the first worker says why
            return
        if self.heated is not None:
            checks.choice("heated", self.heated, base.heated)
        readable = [one.name for some in (base.layers, base.parts, base.probes) for one in some]
        checks.unique("read", [checks.choice("read", name, readable) for name in self.read])

    def cases(self) -> list[Case]:
        """Every geometry once, with the hash of all that determines its result."""
        seen: dict[str, Case] = {}
        for values in self._values():
            key = self._key(self.geometry_of(values))
            seen.setdefault(key, Case(key, values))
        return list(seen.values())

    def _key(self, geometry: str) -> str:
        drives = [(d.name, waveforms.to_json(d.wave), d.times or d.samples) for d in self.drives]
        base = to_toml(self._table) if self.variations else ""  # whose mesh is moved to fit each geometry
        names = [v.name for v in self.variations]  # which the results hold
        content = (FORMAT, __version__, geometry, base, names, drives, self.heated, self.read, self.accuracy, self.rtol)
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]

    def task(self, case: Case) -> Task:
        """Everything a worker needs to compute one geometry."""
        values = {v.name: value for v, value in zip(self.variations, case.values, strict=True)}
        return self._task(case.key, self.geometry_of(case.values), json.dumps(values))

    def base_task(self) -> Task:
        """The task of the base geometry, with nothing varied."""
        return self._task("base", self.geometry, "{}")

    def _task(self, key: str, geometry: str, values: str) -> Task:
        from .work import Task

        return Task(
            key=key,
            geometry=geometry,
            values=values,
            drives=self.drives,
            heated=self.heated,
            read=self.read,
            accuracy=self.accuracy,
            rtol=self.rtol,
            base=self.geometry if self.variations else "",
        )

    def run(
        self,
        directory: str | Path,
        executor: Executor | None = None,
        *,
        workers: int | None = None,
        retry_failed: bool = False,
        report: Callable[[Summary], None] | None = None,
    ) -> Summary:
        """Compute every geometry that the folder does not hold yet; see `run.run`."""
        from .run import run

        return run(self, directory, executor, workers=workers, retry_failed=retry_failed, report=report)
