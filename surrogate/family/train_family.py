"""Train a family from a campaign: choose the engine, solve members, and test it on members it has not seen.

The middle, corners and random members are solved, batch after batch, until new ones are predicted well enough. Every
batch is predicted before it is added, so its error is a fair test of the functions so far.
"""

import contextlib
import itertools
import json
import logging
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from thermofem import Campaign, __version__ as version, checks
from thermofem.arrays import Array
from thermofem.campaign import campaign_file
from thermofem.campaign.stored_tasks import Store
from thermofem.data.files import digest, from_toml, read_toml, to_toml
from thermofem.geometry.section_parts import LIGHT

from .affine_engine import AffineEngine
from .affine_grid import NotAffineError
from .family import Family
from .interpolation import interpolate_output_maps
from .members import (
    FINEST_MESH,
    HeldOut,
    Member,
    MemberModes,
    Solver,
    certified_modes,
    coarse_difference,
    difference,
    extend_basis,
    fine_member,
    snapshot_of,
)
from .moved_mesh_engine import MovedMeshEngine, projected
from .optical_numbers import Engine, Members, train_optics
from .parameter_box import Box

log = logging.getLogger("thermofem")

SHARE_OF_BASIS = 0.4  # of the tolerance, for what the functions leave on the reference mesh; the rest is the mesh's
# Energy of the weakest direction over the tolerance: of one that a batch adds; and in the end, the first of these that
# holds all members. With more than 0.5 corners are missed.
WEAKEST = 0.01
WEAKEST_IN_THE_END = 0.5, 0.1, WEAKEST
BATCH = 6
MOST_BATCHES = 60


@dataclass
class Trainer:
    """State of a training run: engine, solved members and basis functions V."""

    engine: Engine
    ports: tuple[str, ...]
    tolerance: float
    seed: int
    heated: int
    solver: Solver

    def __post_init__(self) -> None:
        self.box: Box = self.engine.box
        self.X = self.engine.reference.discretization.K
        self.V = np.empty((self.engine.reference.unknowns, 0))
        self.members: list[Member] = []

    def run(self) -> Members:
        """Solve batch after batch of members until a new batch is predicted to `SHARE_OF_BASIS` of the tolerance."""
        rows = self._first()
        for number in range(MOST_BATCHES):
            errors = []
            new = self._solved(rows)
            for member in new:
                if number:
                    predicted = projected(self.engine.heat(member.row), self.V, self.ports)
                    errors.append(difference(predicted.modes(), member, self.heated))
                self.members.append(member)
            log.info("%d members solved, %d functions", len(self.members), self.V.shape[1])
            if errors and max(errors) <= SHARE_OF_BASIS * self.tolerance:
                break
            fields = np.hstack([member.fields for member in new])
            self.V = extend_basis(self.V, self.X, fields, WEAKEST * self.tolerance)
            rows = self.box.draw(BATCH, self.seed + 1 + number)
        fields = np.hstack([member.fields for member in self.members])  # at once: fewer functions than batch by batch
        nothing = self.V[:, :0]
        for weakest in WEAKEST_IN_THE_END:
            basis = extend_basis(nothing, self.X, fields, weakest * self.tolerance)
            projection = self.engine.project(basis, self.ports)
            if self._holds(projection):
                break
        return projection

    def _holds(self, projection: Members) -> bool:
        """Whether every solved member is within `SHARE_OF_BASIS` of the tolerance."""
        for member in self.members:
            modes = projection.member(member.row).modes()
            if difference(modes, member, self.heated) > SHARE_OF_BASIS * self.tolerance:
                return False
        return True

    def _solved(self, rows: Array) -> list[Member]:
        """Solve the members with parameters ``rows`` on the reference mesh; those that fail are left out."""
        tasks = [(self.engine, row, self.ports, self.tolerance) for row in rows]
        reference = self.engine.reference
        mesh = f"{reference.unknowns} {reference.mesh.points.sum():.15g}"
        members = self.solver(snapshot_of, tasks, rows, mesh)
        return [member for member in members if member is not None]

    def _first(self) -> Array:
        """Parameters of the first batch, shape (n, p): the middle of the box, some corners and random points."""
        corners = self.box.corners(2 * BATCH)
        random = self.box.draw(BATCH, self.seed)
        return np.vstack([self.box.middle, corners, random])


NO_EFFECT = 1e-9  # relative change of a response over the range of a parameter that does nothing
SAFETY = 1.5  # on floor and factor of the predicted error


def train_family(
    campaign: Campaign | str | Path,
    tolerance: float = 1e-3,
    *,
    seed: int = 0,
    held_out: int = 8,  # 8 members
    executor: Executor | None = None,
    folder: str | Path | None = None,
    power: float | None = None,
    progress: Callable[[float, float, str], None] | None = None,
) -> Family:
    """Train one reduced basis for all members of a campaign's ranges.

    Parameters
    ----------
    campaign : Campaign, or the path of a campaign file
        its [[vary]] tables are the parameters; drives do not matter and may be left out.
    tolerance : float
        wanted relative error of R_th and of the step response from 1 ns on, 1e-4..0.05.
    seed : int
        of the members that are solved.
    held_out : int
        random members, never trained on, whose own finer meshes give ``family.error``.
    executor : Executor
        anything that keeps the contract of `concurrent.futures`; default this process alone.
    folder : str or Path
        keeps the members that are solved; training that was interrupted goes on from it.
    power : float, W
        with k(T) or c_p(T) the largest power of interest: members then have an output map (`surrogate.output_map`),
        interpolated between members that are solved with these laws; ``family.output_maps.error`` is its error.
    progress : function
        called as ``progress(done, total, words)`` for every member; ``words`` say what is solved, such as the light.

    Returns
    -------
    Family
        where ``family.error`` is above the tolerance the log says so. Where outlines lie along r and z a member takes
        about a millisecond (engine "affine"); leaning walls, shells and copies off the axis take some tens ("moved
        meshes"). Without ``power``, conductivities that depend on temperature are taken at the ambient one, and the
        log says so.

    Raises
    ------
    InputError
        a campaign that varies nothing or words; ranges that contradict each other; a mesh that cannot follow.
    """
    started = time.perf_counter()
    hint = "it is the wanted relative error of every member"
    tolerance = checks.between("tolerance", tolerance, 1e-4, 0.05, hint=hint)
    held_out = checks.integer("held_out", held_out, 1, 1000)
    seed = checks.seed(seed)
    box = Box.of(campaign if isinstance(campaign, Campaign) else read_campaign(campaign))
    inputs, outputs = _channels(box)
    ports = tuple(dict.fromkeys((*inputs, *outputs)))
    heated = len(inputs)
    key = f"{campaign_hash(box.campaign)} {box.low} {box.high} {ports} {tolerance:.17g} {version}"
    store = None if folder is None else Store(checks.path("folder", folder), ".npz")
    solver = Solver(key, executor, store, progress)
    with store.opened() if store else contextlib.nullcontext():
        rows, fine_members = _held_out(box, held_out, seed, ports, tolerance, solver)
        log.info("%d held-out members solved", len(fine_members))
        means = tuple(name for name in ports if name != LIGHT)
        dark = _engine(box, means, heated, tolerance, rows, fine_members)
        optics = light = None
        passing = replace(solver, store=None)
        if LIGHT in ports:
            optics, light = train_optics(dark, seed, passing)
        engine = Engine(dark, light)
        trainer = Trainer(engine, ports, tolerance, seed, heated, solver)
        members = trainer.run()
    references = [certified_modes(engine.heat(row), ports, tolerance)[0] for row in rows]
    errors = _errors(members, rows, references, fine_members, heated)
    family = Family(
        inputs=inputs,
        outputs=outputs,
        tolerance=tolerance,
        members=members,
        error=HeldOut(max(errors.total), float(np.median(errors.total)), len(errors.total)),
        floor=SAFETY * max(errors.mesh),
        factor=SAFETY * max(errors.ratio),
        optics=optics,
    )
    if power is not None:
        channel = family.channel()
        linear: Any = family.of_member
        maps = interpolate_output_maps(engine, (channel.heated, channel.read), power, linear, seed, passing)
        family = replace(family, output_maps=maps)
    elif engine.reference.nonlinear:
        log.warning("the materials depend on temperature; members hold at small power (power= trains them for more)")
    for name in _without_effect(box, members, heated):
        if optics is None or not optics.moves(box.names.index(name)):
            log.warning("parameter %r changes nothing in this geometry; leave it out", name)
    if family.error > tolerance:
        text = f"the family errs by up to {family.error:.1e} on members it has not seen, more than tolerance = "
        log.warning("%s%g; take smaller ranges or ask for a smaller tolerance", text, tolerance)
    provenance: dict[str, Any] = {
        "method": f"reduced basis, {members.projection.engine}",
        "version": version,
        "campaign": box.campaign.name,
        "campaign_hash": campaign_hash(box.campaign),
        "solved_members": len(trainer.members),
        "seconds": round(time.perf_counter() - started, 3),
        "unknowns": engine.reference.unknowns,
    }
    beyond = _beyond_laws(family)
    if beyond:
        log.warning(beyond)
        provenance["warning"] = beyond
    return replace(family, provenance=provenance)


def _beyond_laws(family: Family) -> str:
    """Warning of tables k(T), c_p(T) that a corner leaves, up to the power of the output maps; "" of none."""
    box = family.box
    # 16: corners of the box, where tables of k(T) and c_p(T) may be left
    for row in (box.middle, *box.corners(16)):
        rise = 0.0
        if family.output_maps is not None:
            hot: Any = family.of_member(row)
            rise = hot.largest_rise
        if text := box.geometry(row).beyond_laws(rise):
            return text
    return ""


def _held_out(
    box: Box, count: int, seed: int, ports: tuple[str, ...], tolerance: float, solver: Solver
) -> tuple[Array, list[MemberModes]]:
    """Draw test members that are never trained on, and solve each on its own finer mesh.

    Returns: parameters, shape (n, p), and modes of the members that did not fail.
    """
    rows = box.draw(count, seed, unseen=True)
    tasks = [(box.geometry(row).to_toml(), ports, tolerance) for row in rows]
    modes = solver(fine_member, tasks, rows, words="held-out members")
    solved = [of_member is not None for of_member in modes]
    return rows[solved], list(itertools.compress(modes, solved))


class Errors(NamedTuple):
    """Differences at held-out members, one number for each member.

    total: of the family from members on their own finer meshes.
    mesh: of members on the reference mesh from these.
    ratio: of the family from members on the reference mesh, over `coarse_difference`.
    """

    total: list[float]
    mesh: list[float]
    ratio: list[float]


def _errors(
    members: Members, rows: Array, references: list[MemberModes], fine_members: list[MemberModes], heated: int
) -> Errors:
    errors = Errors([], [], [])
    for row, reference, fine in zip(rows, references, fine_members, strict=True):
        small = members.member(row)
        modes = small.modes()
        projection = difference(modes, reference, heated)
        errors.total.append(difference(modes, fine, heated))
        errors.mesh.append(difference(reference, fine, heated))
        errors.ratio.append(projection / max(coarse_difference(small, heated), 1e-12))
    return errors


def _without_effect(box: Box, members: Members, heated: int) -> list[str]:
    """Names of parameters whose whole range changes every response by less than `NO_EFFECT`, relative."""
    names = []
    for k, name in enumerate(box.names):
        ends = []
        for end in (box.low, box.high):
            row = box.middle.copy()
            row[k] = end[k]
            ends.append(members.member(row).modes())
        low, high = ends
        if difference(low, high, heated) < NO_EFFECT:
            names.append(name)
    return names


def read_campaign(path: str | Path) -> Campaign:
    """Read a campaign file; one without drives or samples is good enough for a family.

    Raises InputError: as `Campaign.from_toml`.
    """

    def campaign(text: str) -> Campaign:
        table: dict[str, Any] = from_toml(text)
        ranges = any("count" not in item and "values" not in item for item in table.get("vary", []))
        table.setdefault("samples", int(ranges))
        fields = campaign_file.fields(to_toml(table), Path(path).parent)
        return Campaign(**fields)

    return read_toml(checks.path("campaign", path), "campaign", campaign)


def campaign_hash(campaign: Campaign) -> str:
    """Sixteen hexadecimal digits of geometry and variations."""
    variations = [(v.name, v.paths, v.values, v.low, v.high) for v in campaign.variations]
    content = json.dumps([campaign.geometry, variations]).encode()
    return digest(content)[:16]


def _engine(
    box: Box, ports: tuple[str, ...], heated: int, tolerance: float, rows: Array, fine_members: Sequence[MemberModes]
) -> AffineEngine | MovedMeshEngine:
    """Choose the engine, and refine its mesh until held-out members are within `SHARE_OF_BASIS` of the tolerance."""
    accuracy = 0.5 * tolerance  # 0.5: accuracy of the first reference mesh over the tolerance
    for _ in range(3):  # 3: reference meshes tried
        engine: AffineEngine | MovedMeshEngine
        try:
            engine = AffineEngine(box, accuracy)
        except NotAffineError as reason:
            log.info("the family moves its mesh for every member, because %s", reason)
            engine = MovedMeshEngine(box, accuracy)
        errors = []
        for row, fine in zip(rows, fine_members, strict=True):
            modes, _ = certified_modes(engine.heat(row), ports, tolerance)
            errors.append(difference(modes, fine, heated))
        error = max(errors)
        if error <= SHARE_OF_BASIS * tolerance or accuracy <= FINEST_MESH:
            break
        accuracy = max(FINEST_MESH, 0.7 * accuracy * SHARE_OF_BASIS * tolerance / error)
    return engine


def _channels(box: Box) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of the heated and of the read parts of a campaign, the light last where the geometry has [light]."""
    base = box.base
    heated = box.campaign.heated
    inputs = (checks.choice("heated", heated, base.heated),) if heated else base.heated
    light = () if base.light is None else (LIGHT,)
    readable = (*base.region_names, *(probe.name for probe in base.probes), *light)
    outputs = [checks.choice("read", name, readable) for name in box.campaign.read or inputs]
    means = [name for name in outputs if name not in light]
    return inputs, (*means, *light)
