"""The folder of a campaign: what is finished, what failed and why, and the list of its geometries.

    plan.json             the geometries and their hashes, what is varied, the drives
    results/<hash>.nc     one geometry each
    failures/<hash>.json  why one has no result
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
from ..dataset import make_folder, write_whole

if TYPE_CHECKING:
    from .plan import Campaign, Case


@dataclass(frozen=True)
class Store:
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

    @contextlib.contextmanager
    def opened(self) -> Iterator[None]:
        """Make the folder, keep other runs out of it, and sweep up what a killed run left half-written.

        Raises
        ------
        InputError
            it cannot be made or written, or another run is using it.
        """
        for folder in (self.directory, self.results, self.failures):
            make_folder(folder)
        try:
            handle = os.open(self.directory / ".lock", os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as error:
            raise InputError(f"folder {self.directory} cannot be written: {error.strerror}") from None
        try:
            if not _lock(handle):
                raise InputError(f"folder {self.directory} is in use by another run; wait for it, or take another one")
            for folder in (self.directory, self.results, self.failures):
                for stray in (*folder.glob(".*-*.nc"), *folder.glob(".*-*.json")):
                    stray.unlink(missing_ok=True)
            yield
        finally:
            os.close(handle)  # a killed process gives its lock back, too

    def finished(self, key: str) -> bool:
        """Whether the result of one geometry is there and whole."""
        import h5py

        try:
            with h5py.File(self.result(key), "r") as file:
                return file.attrs.get("campaign_case") == key
        except OSError:
            return False

    def status(self, keys: list[str]) -> list[str]:
        """ "finished", "failed" or "waiting" for each geometry, from the names of the files."""
        done = {path.stem for path in self.results.glob("[!.]*.nc")}
        failed = {path.stem for path in self.failures.glob("*.json")}
        return ["finished" if key in done else "failed" if key in failed else "waiting" for key in keys]

    def write_result(self, key: str, content: bytes) -> None:
        """Store the netCDF file of one geometry; InputError when that is not possible."""
        write_file(self.result(key), content)
        self.failure(key).unlink(missing_ok=True)

    def write_failure(self, key: str, reason: str, values: dict[str, Any]) -> None:
        """Store why one geometry has no result."""
        write_file(self.failure(key), json.dumps({"reason": reason, "values": values}, indent=1).encode())

    def reason(self, key: str) -> str:
        """Why one geometry has no result; empty where there is no such file."""
        try:
            return str(json.loads(self.failure(key).read_text())["reason"])
        except (OSError, ValueError, KeyError):
            return ""

    def write_plan(self, campaign: Campaign, cases: list[Case]) -> None:
        """Store what this campaign consists of, so that the folder explains itself."""
        plan = {
            "name": campaign.name,
            "geometry": campaign.geometry,
            "variations": [{"name": v.name, "paths": v.paths, "unit": v.unit} for v in campaign.variations],
            "drives": [
                {"name": s.name, "waveform": waveforms.to_json(s.wave), "times": s.kept.tolist()}
                for s in campaign.schedules
            ],
            "cases": [[case.key, *case.values] for case in cases],
        }
        write_file(self.plan, json.dumps(plan).encode())

    def read_plan(self) -> dict[str, Any]:
        """What `write_plan` stored; InputError where the folder holds no campaign."""
        try:
            return dict(json.loads(self.plan.read_text()))
        except FileNotFoundError:
            raise InputError(f"{self.directory} holds no campaign; thermofem campaign makes one") from None
        except (OSError, ValueError) as error:
            raise InputError(f"{self.plan} cannot be read: {error}") from None


def write_file(path: Path, content: bytes) -> None:
    """Write and flush to the disk, then rename; InputError when that is not possible."""

    def write(temporary: Path) -> None:
        with temporary.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())

    write_whole(path, write)


def _lock(handle: int) -> bool:
    """Whether the lock could be taken; systems without file locks trust their user."""
    try:
        import fcntl
    except ImportError:
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
