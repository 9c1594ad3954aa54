"""The folder of a campaign: what is finished, what failed and why, and the list of its geometries.

    plan.json             the geometries and their hashes, what is varied, the drives
    results/<key>.nc      one geometry each
    results.sha256        a line for each result: hash of its content, and its key; a result without it is not believed
    failures/<key>.json   why one has no result
    index.nc              all of them as one Dataset; training.nc: the finished ones, ready for machine learning

Only the process that runs the campaign writes here, and every file appears under its name when it is complete.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import waveforms
from ..checks import InputError
from ..data import files
from ..data.files import write_whole
from .plan_file import check_plan

if TYPE_CHECKING:
    from .plan import Campaign, Case

HASH = "content_hash"  # of plan.json
OWNER = "a campaign"
WRITTEN = ("plan.json", "index.nc", "training.nc", "results.sha256", ".lock")


@dataclass(frozen=True)
class ResultStore:
    """The files of one campaign.

    Parameters
    ----------
    directory : Path
    """

    directory: Path

    @property
    def results(self) -> Path:
        """Folder of the finished geometries."""
        return self.directory / "results"

    @property
    def failures(self) -> Path:
        """Folder of the reasons."""
        return self.directory / "failures"

    @property
    def plan(self) -> Path:
        """File that lists the geometries."""
        return self.directory / "plan.json"

    def result(self, key: str) -> Path:
        """File of one geometry."""
        return self.results / f"{key}.nc"

    def failure(self, key: str) -> Path:
        """File of the reason why one geometry has no result."""
        return self.failures / f"{key}.json"

    def check_apart(self, path: Path) -> None:
        """InputError where a file that is read is one of this folder that a campaign writes."""
        here, given = os.path.realpath(self.directory), os.path.realpath(path)
        if os.path.dirname(given) == here and os.path.basename(given) in WRITTEN:
            raise InputError(f"{path} would be written over by the campaign of its folder; give it another name")

    @contextlib.contextmanager
    def opened(self) -> Iterator[None]:
        """Make the folder, lock it against other runs, and delete half-written files of a killed run.

        Raises
        ------
        InputError
            it cannot be made or written, another run is using it, or it holds files of others.
        """
        with files.own_folder(self.directory, (self.results.name, self.failures.name), self.check_ours):
            yield

    @property
    def ledger(self) -> Path:
        """File with the hash of every result."""
        return self.directory / "results.sha256"

    def hashes(self) -> dict[str, str]:
        """Hash of each result by key, as it was written. Damaged lines are ignored; the last line of a key counts."""
        try:
            lines = self.ledger.read_text(encoding="ascii", errors="replace").splitlines()
        except OSError:
            return {}
        pairs = (line.split() for line in lines)
        return {pair[1]: pair[0] for pair in pairs if len(pair) == 2}

    def finished(self, key: str, hashes: dict[str, str]) -> bool:
        """Whether the result file of a geometry exists and has its hash in ``hashes``, as `hashes` returns them."""
        try:
            return key in hashes and files.digest(self.result(key)) == hashes[key]
        except OSError:
            return False

    def status(self, keys: list[str]) -> list[str]:
        """ "finished", "failed" or "waiting" for each geometry, from the names of the files."""
        done = {path.stem for path in self.results.glob("[!.]*.nc")}
        failed = {path.stem for path in self.failures.glob("*.json")}
        return ["finished" if key in done else "failed" if key in failed else "waiting" for key in keys]

    def write_result(self, key: str, content: bytes) -> None:
        """Store the netCDF file of one geometry; InputError when that is not possible."""
        try:  # first the hash: a kill in between leaves a hash without a result, which is computed again
            # (not synced to the disk: a power cut may lose the line, and the result is then computed again, too)
            with self.ledger.open("a", encoding="ascii") as file:
                file.write(f"\n{files.digest(content)} {key}\n")
        except OSError as error:  # also when it is closed: only then the line is written
            raise InputError(f"{self.ledger} cannot be written: {error.strerror}") from None
        write_file(self.result(key), content)
        self.failure(key).unlink(missing_ok=True)

    def write_failure(self, key: str, reason: str, values: dict[str, Any]) -> None:
        """Store why one geometry has no result."""
        write_file(self.failure(key), json.dumps({"reason": reason, "values": values}, indent=1).encode())

    def reason(self, key: str) -> str:
        """Reason why a geometry has no result; empty where none was written."""
        try:
            return str(files.read_json(self.failure(key), "reason")["reason"])
        except (InputError, KeyError, TypeError):
            return ""

    def check_ours(self) -> None:
        """InputError where a file of the folder has a name that a campaign writes and no campaign wrote it."""
        ours = {".lock"}
        with contextlib.suppress(FileNotFoundError):
            ours = {*WRITTEN} - ({self.plan.name} if _of_others(self.plan.read_bytes()) else set())
        paths = [self.directory / name for name in WRITTEN]
        files.check_own(paths, [path for path in paths if path.name in ours], OWNER)

    def write_plan(self, campaign: Campaign, cases: list[Case]) -> None:
        """Write the plan of the campaign into its folder."""
        plan = {
            "name": campaign.name,
            "geometry": campaign.geometry,
            "variations": [{"name": v.name, "paths": v.paths, "unit": v.unit} for v in campaign.variations],
            "drives": [
                {"name": s.name, "waveform": waveforms.to_json(s.wave), "times": s.kept.tolist()}
                for s in campaign.drives
            ],
            "cases": [[case.key, *case.values] for case in cases],
        }
        write_file(self.plan, json.dumps({**plan, HASH: files.digest_tree(plan)}).encode())

    def read_plan(self) -> dict[str, Any]:
        """The plan as `write_plan` stored it; InputError where the folder holds none, or one that was changed."""
        if not os.path.exists(self.plan):  # a name too long for the disk does not exist, either
            raise InputError(f"{self.directory} holds no campaign; thermofem campaign makes one")
        try:
            plan = check_plan(files.read_json(self.plan, "plan"))
            if HASH in plan and plan.pop(HASH) != files.digest_tree(plan):  # version 0.1 wrote none
                hint = "run the campaign again, which takes over its results"
                raise InputError("it was changed after thermofem wrote it", hint)
            return plan
        except InputError as error:
            raise InputError(f"{self.plan} cannot be read: {error.rule}", error.hint) from None


def _of_others(content: bytes) -> bool:
    """Whether a plan.json is another file, such as a geometry; a plan that was damaged is written again."""
    for read in (files.from_json, files.from_toml):
        with contextlib.suppress(InputError):
            tree = read(content.decode("utf-8", "replace"))
            return bool(content.strip()) and not (isinstance(tree, dict) and "cases" in tree)
    return False


def write_file(path: Path, content: bytes) -> None:
    """Write and flush to the disk, then rename; InputError when that is not possible."""

    def write(temporary: Path) -> None:
        with temporary.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())

    write_whole(path, write)
