"""File of the finished rows of a map, from which an interrupted map resumes."""

from __future__ import annotations

import contextlib
import json
import math
import os
from pathlib import Path
from typing import Any

from thermofem import checks
from thermofem.data import files

VERSION = 2  # of the lines: [row, cells, hash]


class Journal:
    """One JSON line that identifies the map, then one for each finished row, in the order of completion.

    Each row carries a hash, so that a damaged one is refused. A line counts once its end has been written: what a kill
    leaves of a line is cut off, and its row computed again.

    Parameters
    ----------
    path : path or None
        nothing is kept without one.
    identity : dict
        what the rows depend on, as JSON; a file with another identity is refused.

    Raises
    ------
    InputError
        the file is of another map, or of something else, which is left as it was; or it cannot be read or written;
        another run is using it.
    """

    def __init__(self, path: str | Path | None, identity: dict[str, Any]) -> None:
        self.path = checks.path("file", path) if path is not None else None
        self.rows: dict[int, list[Any]] = {}
        self._lock = contextlib.ExitStack()
        if self.path is None:
            return
        head = json.dumps({"journal": VERSION, **identity}, sort_keys=True)
        if os.path.lexists(self.path):
            files.regular(self.path, "map")
        self._lock.enter_context(files.locked(self.path.with_name(f".{self.path.name}.lock"), str(self.path)))
        self.path.touch()
        try:
            self._read(head)
        except BaseException:
            self.close()
            raise

    def _read(self, head: str) -> None:
        """Read the finished rows of the file, and remove an incomplete last line, as a killed run leaves it."""
        content = files.read_bytes(self.path or "", "map")
        whole = content[: content.rfind(b"\n") + 1]
        lines = whole.decode(errors="replace").splitlines()
        if not lines and not head.encode().startswith(content):  # somebody else's file without a line's end
            raise checks.InputError(f"{self.path} is no map that can go on; give another file name")
        try:
            found = files.from_json(lines[0] if lines else head)
            rows = [files.from_json(line) for line in lines[1:]]
        except checks.InputError as error:
            raise checks.InputError(f"{self.path} is no map that can go on ({error}); give another file name") from None
        wanted = json.loads(head)
        if found != wanted:
            known = found if isinstance(found, dict) else {}
            other = sorted(k for k in {*known, *wanted} if known.get(k) != wanted.get(k))
            raise checks.InputError(
                f"{self.path} holds rows of another map (different: {', '.join(other)}); give another file name"
            )
        for row in rows:
            if not (isinstance(row, list) and len(row) == 3 and row[2] == files.digest_tree(row[:2])[:16]):
                raise checks.InputError(f"{self.path}: a damaged row (its hash differs); give another file name")
            self.rows[row[0]] = [[math.nan if value is None else value for value in cell] for cell in row[1]]
        if len(whole) < len(content) and self.path is not None:
            os.truncate(self.path, len(whole))
        if not lines:
            self._append(head)

    def close(self) -> None:
        """Give the file back; a killed process gives it back, too."""
        self._lock.close()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def add(self, row: int, cells: list[Any]) -> None:
        """Append one row."""
        self.rows[row] = cells
        if self.path is None:
            return
        kept = [row, files.plain(cells)]
        self._append(json.dumps([*kept, files.digest_tree(kept)[:16]], allow_nan=False))

    def _append(self, line: str) -> None:
        """Write one line and flush it to the disk."""
        try:
            with open(self.path or "", "a", encoding="utf-8") as file:
                file.write(line + "\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise checks.InputError(
                f"{self.path} cannot be written: {error.strerror}; what it holds so far is kept"
            ) from None
