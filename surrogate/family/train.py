"""Train a family from a campaign: choose the engine, solve members, and test it on members it has not seen."""

from __future__ import annotations

import hashlib
import json
import logging
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from thermofem import Campaign, Foster, checks
from thermofem import __version__ as version
from thermofem.arrays import Array
from thermofem.campaign import schema
from thermofem.data.files import read_toml

from .affine import LineEngine
from .bend import Bend, bend_of
from .box import Box
from .certify import FINEST, own
from .family import Family, HeldOut, coarse_difference
from .lines import NotAlongLinesError
from .moved import MovedEngine, MovedMembers
from .reduced import LineTerms, MemberModes, difference
from .solving import Solver, truth_of
from .training import SHARE, Trainer

log = logging.getLogger("thermofem")

MESH = 0.5  # accuracy of the first reference mesh over the tolerance
MESHES = 3  # reference meshes tried
HELD_OUT = 8  # members
NOTHING = 1e-9  # relative change of a response over the range of a parameter that does nothing
SAFETY = 1.5  # on floor and factor of the predicted error


def train_family(
    campaign: Campaign | str | Path,
    tolerance: float = 1e-3,
    *,
    seed: int = 0,
    held_out: int = HELD_OUT,
    report: Callable[[str], None] | None = None,
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
    report : callable
        gets a line of text after every batch of members.
    executor : Executor
        anything that keeps the contract of `concurrent.futures`; default this process alone.
    folder : str or Path
        keeps the members that are solved; training that was interrupted goes on from it.
    power : float, W
        with k(T) or c_p(T) the largest power of interest: members then have an output map (`surrogate.output_map`),
        interpolated between members that are solved with these laws; ``family.bend.error`` is its error over others.

    Returns
    -------
    Family
        where ``family.error`` is above the tolerance the log says so. Where outlines lie along r and z a member takes
        about a millisecond (engine "lines"); leaning walls, shells and copies off the axis take some tens ("moved
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
    held_out, seed = checks.integer("held_out", held_out, 1, 1000), checks.seed(seed)
    box = Box.of(campaign if isinstance(campaign, Campaign) else read_campaign(campaign))
    report = (lambda line: None) if report is None else report
    inputs, outputs = _channels(box)
    ports, heated = tuple(dict.fromkeys((*inputs, *outputs))), len(inputs)
    key = f"{campaign_hash(box.campaign)} {box.low} {box.high} {ports} {tolerance:.17g} {version}"
    solver = Solver(key, executor, None if folder is None else checks.path("folder", folder))
    rows, truths = _held_out(box, held_out, seed, ports, tolerance, solver)
    report(f"{len(truths)} held-out members solved")
    engine, references = _engine(box, ports, heated, tolerance, rows, truths)
    found = Trainer(engine, ports, tolerance, seed, heated, report, solver).run()
    members: LineTerms | MovedMembers
    if found.terms is not None:
        members = found.terms
    elif isinstance(engine, MovedEngine):
        members = MovedMembers(engine, found.basis, ports)
    else:
        raise TypeError("the engine on lines gives terms")
    small = [members.member(row) for row in rows]
    modes = [one.modes() for one in small]
    errors = [difference(one, truth, heated) for one, truth in zip(modes, truths, strict=True)]
    meshes = [difference(one, truth, heated) for one, truth in zip(references, truths, strict=True)]
    rest = [difference(one, reference, heated) for one, reference in zip(modes, references, strict=True)]
    ratios = [each / max(coarse_difference(one, heated), 1e-12) for each, one in zip(rest, small, strict=True)]
    error = HeldOut(errors)
    a, b = inputs[0], inputs[0] if inputs[0] in outputs else outputs[0]

    def foster(row: Array) -> Foster:
        one = members.member(row).modes()
        return Foster(R=one.R(ports.index(a), ports.index(b)), tau=np.maximum(one.tau, 1e-30))

    bend: Bend | None = None
    if power is not None:
        report("members with conductivities that depend on temperature")
        bend = bend_of(engine, (a, b), power, foster, seed, replace(solver, folder=None))
    elif engine.reference.nonlinear:
        log.warning("the materials depend on temperature; members hold at small power (power= trains them for more)")
    for name in _idle(box, members, heated):
        log.warning("parameter %r changes nothing in this geometry; leave it out", name)
    if error.worst > tolerance:
        log.warning(
            "the family errs by up to %.1e on members it has not seen, more than tolerance = %g; take smaller ranges "
            "or ask for a smaller tolerance",
            error.worst,
            tolerance,
        )
    return Family(
        box=box,
        inputs=inputs,
        outputs=outputs,
        tolerance=tolerance,
        members=members,
        error=error,
        floor=SAFETY * max(meshes),
        factor=SAFETY * max(ratios),
        bend=bend,
        provenance={
            "method": f"reduced basis, {members.engine}",
            "version": version,
            "campaign": box.campaign.name,
            "campaign_hash": campaign_hash(box.campaign),
            "solved_members": len(found.members),
            "seconds": round(time.perf_counter() - started, 3),
            "unknowns": engine.unknowns,
        },
    )


def _held_out(
    box: Box, count: int, seed: int, ports: tuple[str, ...], tolerance: float, solver: Solver
) -> tuple[Array, list[MemberModes]]:
    """Random members on their own finer meshes; those that fail are left out."""
    rows = box.draw(count, seed + 7919)
    tasks = [(box.geometry(row).to_toml(), ports, tolerance) for row in rows]
    found = solver(truth_of, tasks, rows)
    there = [k for k, one in enumerate(found) if one is not None]
    return rows[there], [found[k] for k in there]


def _idle(box: Box, members: LineTerms | MovedMembers, heated: int) -> list[str]:
    """Parameters whose whole range moves no response by more than `NOTHING`."""
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
        from thermofem.data import files
        from thermofem.data.files import to_toml

        table: dict[str, Any] = files.from_toml(text)
        ranges = any("count" not in item and "values" not in item for item in table.get("vary", []))
        table.setdefault("samples", 1 if ranges else 0)
        return Campaign(**schema.fields(to_toml(table), Path(path).parent))

    return read_toml(checks.path("campaign", path), "campaign", campaign)


def campaign_hash(campaign: Campaign) -> str:
    """Sixteen hexadecimal digits of geometry and variations."""
    content = [campaign.geometry, [(v.name, v.paths, v.values, v.low, v.high) for v in campaign.variations]]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]


def _engine(
    box: Box, ports: tuple[str, ...], heated: int, tolerance: float, rows: Array, truths: Sequence[MemberModes]
) -> tuple[LineEngine | MovedEngine, list[MemberModes]]:
    """Choose the engine, and a mesh whose error at held-out members is below `SHARE`; and these members on it."""
    accuracy = MESH * tolerance
    for _ in range(MESHES):
        engine: LineEngine | MovedEngine
        try:
            engine = LineEngine(box, accuracy)
        except NotAlongLinesError as reason:
            log.info("the family moves its mesh for every member, because %s", reason)
            engine = MovedEngine(box, accuracy)
        references = [own(engine.heat(row), ports, tolerance)[0] for row in rows]
        error = max(difference(one, truth, heated) for one, truth in zip(references, truths, strict=True))
        if error <= SHARE * tolerance or accuracy <= FINEST:
            break
        accuracy = max(FINEST, 0.7 * accuracy * SHARE * tolerance / error)
    return engine, references


def _channels(box: Box) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of the heated and of the read parts of a campaign."""
    base, campaign = box.base, box.campaign
    inputs = (campaign.heated,) if campaign.heated else base.heated
    readable = (*base.region_names, *(probe.name for probe in base.probes))
    for name in inputs:
        checks.choice("heated", str(name), base.heated)
    outputs = campaign.read or tuple(map(str, inputs))
    for name in outputs:
        checks.choice("read", name, readable)
    return tuple(map(str, inputs)), tuple(outputs)
