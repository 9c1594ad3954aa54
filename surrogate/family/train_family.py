"""Train a family from a campaign: choose the engine, solve members, and test it on members it has not seen.

The middle, corners and random members are solved, batch after batch, until new ones are predicted well enough. Every
batch is predicted before it is added, so its error is a fair test of the functions so far.
"""

import contextlib
import json
import logging
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from thermofem import Campaign, __version__ as version, checks
from thermofem.arrays import Array
from thermofem.campaign import campaign_file
from thermofem.campaign.stored_tasks import Store
from thermofem.data.files import digest, from_toml, read_toml, to_toml

from .affine_engine import AffineEngine, AffineMembers
from .affine_grid import NotAffineError
from .family import Family, HeldOut
from .interpolation import interpolate_output_maps, train_optics
from .members import (
    FINEST,
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
from .moved_mesh_engine import MovedMeshEngine, MovedMeshMembers, projected
from .parameter_box import Box

log = logging.getLogger("thermofem")

SHARE = 0.4  # of the tolerance, for what the functions leave of members on the reference mesh; the rest is the mesh's
KEPT = 0.01  # of the tolerance: energy of the weakest direction that a batch adds
LEAST = 0.5, 0.1, 0.01  # the same in the end: the first that holds all members; with more than 0.5 corners are missed
BATCH = 6
MOST_BATCHES = 60

Engine = AffineEngine | MovedMeshEngine
Members = AffineMembers | MovedMeshMembers


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
        """Solve batch after batch of members until a new batch is predicted to `SHARE` of the tolerance."""
        rows = self._first()
        for number in range(MOST_BATCHES):
            errors = []
            new = self._solved(rows)
            for member in new:
                if number:
                    here = projected(self.engine.heat(member.row), self.V, self.ports).modes()
                    errors.append(difference(here, member.modes, self.heated))
                self.members.append(member)
            log.info("%d members solved, %d functions", len(self.members), self.V.shape[1])
            if errors and max(errors) <= SHARE * self.tolerance:
                break
            fields = np.hstack([member.fields for member in new])
            self.V = extend_basis(self.V, self.X, fields, KEPT * self.tolerance)
            rows = self.box.draw(BATCH, self.seed + 1 + number)
        fields = np.hstack([member.fields for member in self.members])  # at once: fewer functions than batch by batch
        for least in LEAST:
            basis = extend_basis(self.V[:, :0], self.X, fields, least * self.tolerance)
            found: Members = self.engine.project(basis, self.ports)
            off = (difference(found.member(one.row).modes(), one.modes, self.heated) for one in self.members)
            if all(error <= SHARE * self.tolerance for error in off):
                break
        return found

    def _solved(self, rows: Array) -> list[Member]:
        """Solve the members with parameters ``rows`` on the reference mesh; those that fail are left out."""
        tasks = [(self.engine, row, self.ports, self.tolerance) for row in rows]
        mesh = f"{self.engine.reference.unknowns} {self.engine.reference.mesh.points.sum():.15g}"
        found = self.solver(snapshot_of, tasks, rows, mesh)
        return [member for member in found if member is not None]

    def _first(self) -> Array:
        """Parameters of the first batch, shape (n, p): the middle of the box, some corners and random points."""
        return np.vstack([self.box.middle[None], self.box.corners(2 * BATCH), self.box.draw(BATCH, self.seed)])


NOTHING = 1e-9  # relative change of a response over the range of a parameter that does nothing
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
    tolerance = checks.between(
        "tolerance", tolerance, 1e-4, 0.05, hint="it is the wanted relative error of every member"
    )
    held_out = checks.integer("held_out", held_out, 1, 1000)
    seed = checks.seed(seed)
    box = Box.of(campaign if isinstance(campaign, Campaign) else read_campaign(campaign))
    inputs, outputs = _channels(box)
    ports = tuple(dict.fromkeys((*inputs, *outputs)))
    heated = len(inputs)
    key = f"{campaign_hash(box.campaign)} {box.low} {box.high} {ports} {tolerance:.17g} {version}"
    store = None if folder is None else Store(checks.path("folder", folder), ".npz")
    solver = Solver(key, executor, store)
    with store.opened() if store else contextlib.nullcontext():
        rows, fine_members = _held_out(box, held_out, seed, ports, tolerance, solver)
        log.info("%d held-out members solved", len(fine_members))
        engine, references = _engine(box, ports, heated, tolerance, rows, fine_members)
        trainer = Trainer(engine, ports, tolerance, seed, heated, solver)
        members = trainer.run()
    small = [members.member(row) for row in rows]
    modes = [one.modes() for one in small]
    each = zip(modes, references, fine_members, strict=True)
    errors, meshes, rest = zip(
        *((difference(a, c, heated), difference(b, c, heated), difference(a, b, heated)) for a, b, c in each),
        strict=True,
    )
    ratios = [off / max(coarse_difference(one, heated), 1e-12) for off, one in zip(rest, small, strict=True)]
    error = HeldOut(max(errors), float(np.median(errors)), len(errors))
    family = Family(
        box=box,
        inputs=inputs,
        outputs=outputs,
        tolerance=tolerance,
        members=members,
        error=error,
        floor=SAFETY * max(meshes),
        factor=SAFETY * max(ratios),
    )
    passing = replace(solver, store=None)
    if power is not None:
        channel = inputs[0], inputs[0] if inputs[0] in outputs else outputs[0]

        def linear(row: Array) -> Any:
            return family.at(dict(zip(box.names, row, strict=True)))

        maps = interpolate_output_maps(engine, channel, power, linear, seed, passing)
        family = replace(family, output_maps=maps)
    elif engine.reference.nonlinear:
        log.warning("the materials depend on temperature; members hold at small power (power= trains them for more)")
    if box.base.light is not None:
        family = replace(family, optics=train_optics(box, seed, passing))
    for name in _without_effect(box, members, heated):
        if family.optics is None or not family.optics.moves(box.names.index(name)):
            log.warning("parameter %r changes nothing in this geometry; leave it out", name)
    if error.worst > tolerance:
        log.warning(
            "the family errs by up to %.1e on members it has not seen, more than tolerance = %g; take smaller ranges "
            "or ask for a smaller tolerance",
            error.worst,
            tolerance,
        )
    provenance = {
        "method": f"reduced basis, {members.engine}",
        "version": version,
        "campaign": box.campaign.name,
        "campaign_hash": campaign_hash(box.campaign),
        "solved_members": len(trainer.members),
        "seconds": round(time.perf_counter() - started, 3),
        "unknowns": engine.reference.unknowns,
    }
    return replace(family, provenance=provenance)


def _held_out(
    box: Box, count: int, seed: int, ports: tuple[str, ...], tolerance: float, solver: Solver
) -> tuple[Array, list[MemberModes]]:
    """Draw test members that are never trained on, and solve each on its own finer mesh.

    Returns: parameters, shape (n, p), and modes of the members that did not fail.
    """
    rows = box.draw(count, seed, unseen=True)
    tasks = [(box.geometry(row).to_toml(), ports, tolerance) for row in rows]
    found = solver(fine_member, tasks, rows)
    there = [k for k, one in enumerate(found) if one is not None]
    return rows[there], [found[k] for k in there]


def _without_effect(box: Box, members: Members, heated: int) -> list[str]:
    """Names of parameters whose whole range changes every response by less than `NOTHING`, relative."""
    found = []
    for k, name in enumerate(box.names):
        rows = np.tile(box.middle, (2, 1))
        rows[:, k] = box.low[k], box.high[k]
        low, high = (members.member(row).modes() for row in rows)
        if difference(low, high, heated) < NOTHING:
            found.append(name)
    return found


def read_campaign(path: str | Path) -> Campaign:
    """Read a campaign file; one without drives or samples is good enough for a family.

    Raises InputError: as `Campaign.from_toml`.
    """

    def campaign(text: str) -> Campaign:
        table: dict[str, Any] = from_toml(text)
        ranges = any("count" not in item and "values" not in item for item in table.get("vary", []))
        table.setdefault("samples", 1 if ranges else 0)
        return Campaign(**campaign_file.fields(to_toml(table), Path(path).parent))

    return read_toml(checks.path("campaign", path), "campaign", campaign)


def campaign_hash(campaign: Campaign) -> str:
    """Sixteen hexadecimal digits of geometry and variations."""
    content = [campaign.geometry, [(v.name, v.paths, v.values, v.low, v.high) for v in campaign.variations]]
    return digest(json.dumps(content).encode())[:16]


def _engine(
    box: Box, ports: tuple[str, ...], heated: int, tolerance: float, rows: Array, fine_members: Sequence[MemberModes]
) -> tuple[Engine, list[MemberModes]]:
    """Choose the engine, and refine its mesh until its error at held-out members is below `SHARE` of the tolerance.

    Returns: the engine, and the modes of these members on its mesh.
    """
    accuracy = 0.5 * tolerance  # 0.5: accuracy of the first reference mesh over the tolerance
    for _ in range(3):  # 3: reference meshes tried
        engine: Engine
        try:
            engine = AffineEngine(box, accuracy)
        except NotAffineError as reason:
            log.info("the family moves its mesh for every member, because %s", reason)
            engine = MovedMeshEngine(box, accuracy)
        references = [certified_modes(engine.heat(row), ports, tolerance)[0] for row in rows]
        error = max(difference(one, truth, heated) for one, truth in zip(references, fine_members, strict=True))
        if error <= SHARE * tolerance or accuracy <= FINEST:
            break
        accuracy = max(FINEST, 0.7 * accuracy * SHARE * tolerance / error)
    return engine, references


def _channels(box: Box) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of the heated and of the read parts of a campaign."""
    base, campaign = box.base, box.campaign
    inputs = (checks.choice("heated", campaign.heated, base.heated),) if campaign.heated else base.heated
    readable = (*base.region_names, *(probe.name for probe in base.probes))
    return inputs, tuple(checks.choice("read", name, readable) for name in campaign.read or inputs)
