"""Members solved on any Executor, and stored in a folder from which an interrupted training resumes."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from thermofem import CrossSection, assemble, checks
from thermofem.arrays import Array
from thermofem.data.files import make_folder, read_bytes, write_whole

from . import archive
from .affine import LineEngine
from .basis import Member, solved
from .certify import FINER, FINEST, own
from .moved import MovedEngine
from .reduced import MemberModes

Task = tuple[Any, ...]

log = logging.getLogger("thermofem")


def truth_of(geometry: str, ports: tuple[str, ...], tolerance: float) -> MemberModes:
    """A member on its own finer mesh, from the text of its geometry."""
    heat = assemble(CrossSection.from_toml_text(geometry), max(FINER * tolerance, FINEST))
    return own(heat, ports, tolerance)[0]


def member_of(engine: LineEngine | MovedEngine, row: Array, ports: tuple[str, ...], tolerance: float) -> Member:
    """A member on the reference mesh."""
    return solved(row, engine.heat(row), ports, tolerance)


@dataclass(frozen=True, eq=False)
class Solver:
    """Where members are solved and kept.

    key: of everything that the members share; others in the folder are left alone.
    executor: None solves in this process.
    """

    key: str
    executor: Executor | None = None
    folder: Path | None = None

    def __post_init__(self) -> None:
        """Make the folder; InputError where that fails."""
        if self.folder is not None:
            make_folder(self.folder)

    def __call__(
        self, function: Callable[..., Any], tasks: Sequence[Task], marks: Iterable[Array], shared: str = ""
    ) -> list[Any]:
        """Results in order; None for a task that failed, which a line in the log names.

        ``marks`` tell the tasks apart, and ``shared`` says what they have in common beside `key`.

        Raises InputError: of a task, or all of them failed; the executor broke.
        """
        paths = [self._path(function.__name__, shared, mark) for mark in marks]
        kept = [_read(path) if path and path.is_file() else None for path in paths]
        left = [k for k, one in enumerate(kept) if one is None]
        futures: dict[int, Future[Any]] = {}
        reason = ""
        try:
            for k in left:
                futures[k] = self._submit(function, tasks[k])
            for k, future in futures.items():
                try:
                    found = kept[k] = future.result()
                except (checks.InputError, BrokenExecutor):
                    raise
                except Exception as error:
                    reason = f"{type(error).__name__}: {error}"
                    log.warning("a member failed and is left out: %s", reason)
                    continue
                if (path := paths[k]) is not None:
                    _write(path, found)
        except BrokenExecutor as error:
            raise checks.InputError(
                f"the executor broke ({type(error).__name__}: {error})",
                "run again with a new one" + (f"; what {self.folder} holds is kept" if self.folder else ""),
            ) from None
        finally:
            for future in futures.values():
                future.cancel()
        if tasks and all(one is None for one in kept):
            raise checks.InputError(f"every member of a batch failed, the last one with {reason}")
        return kept

    def _submit(self, function: Callable[..., Any], task: Task) -> Future[Any]:
        if self.executor is not None:
            return self.executor.submit(function, *task)
        done: Future[Any] = Future()
        try:
            done.set_result(function(*task))
        except Exception as error:
            done.set_exception(error)
        return done

    def _path(self, name: str, shared: str, mark: Array) -> Path | None:
        if self.folder is None:
            return None
        content = f"{self.key} {name} {shared}".encode() + np.ascontiguousarray(mark).tobytes()
        return self.folder / f"{hashlib.sha256(content).hexdigest()[:24]}.npz"


def _write(path: Path, found: Member | MemberModes) -> None:
    modes = found if isinstance(found, MemberModes) else found.modes
    arrays: dict[str, Any] = {"key": np.array(path.stem), "tau": modes.tau, "ports": modes.ports}
    if isinstance(found, Member):
        arrays |= {"row": found.row, "static": found.static, "fields": found.fields}
    whole = archive.pack(arrays, deflated=False)
    write_whole(path, lambda p: p.write_bytes(whole))


def _read(path: Path) -> Member | MemberModes | None:
    """The stored member; None where the file is damaged, or that of another member under this name."""
    try:
        arrays = archive.unpack(read_bytes(path, "member"))
        if str(arrays["key"]) != path.stem:
            return None
        modes = MemberModes(arrays["tau"], arrays["ports"])
        return Member(arrays["row"], modes, arrays["static"], arrays["fields"]) if "row" in arrays else modes
    except (KeyError, ValueError):
        return None
