"""A file that fills up with the rows of a map, and from which a map that was interrupted goes on."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from thermofem import checks


class Journal:
    """One JSON line that says what the map is, then one for each row that is done, in the order in which they ended.

    A line counts once its end has been written: what a kill leaves of a line is cut off, and its row computed again.

    Parameters
    ----------
    path : path or None
        nothing is kept without one.
    identity : dict
        what the rows depend on, as JSON; a file with another identity is refused.

    valid : function of row and cells
        whether a row that was read can be one of this map.

    Raises
    ------
    InputError
        the file is of another map, or of something else, which is left as it was; or it cannot be read or written.
    """

    def __init__(
        self,
        path: str | Path | None,
        identity: dict[str, Any],
        valid: Callable[[int, list[Any]], bool] = lambda row, cells: True,
    ) -> None:
        self.valid = valid
        self.path = checks.path("file", path) if path is not None else None
        self.rows: dict[int, list[Any]] = {}
        if self.path is None:
            return
        head = json.dumps(identity, sort_keys=True)
        try:
            content = self.path.read_bytes() if self.path.exists() else b""
        except OSError as error:
            raise checks.InputError(f"{self.path} cannot be read: {error.strerror}; give another file name") from None
        whole = content[: content.rfind(b"\n") + 1]
        lines = whole.decode(errors="replace").splitlines()
        if not lines and not head.encode().startswith(content):  # somebody else's file without a line's end
            raise checks.InputError(f"{self.path} is no map that can go on; give another file name")
        try:
            found = dict(json.loads(lines[0])) if lines else identity
            self.rows = dict(self._row(*json.loads(line)) for line in lines[1:])
        except (ValueError, TypeError) as error:
            raise checks.InputError(f"{self.path} is no map that can go on; give another file name") from error
        if json.dumps(found, sort_keys=True) != head:
            other = sorted(k for k in {*found, *identity} if found.get(k) != identity.get(k))
            raise checks.InputError(
                f"{self.path} holds rows of another map (different: {', '.join(other)}); give another file name"
            )
        bad = [k for k, cells in self.rows.items() if not self.valid(k, cells)]
        if bad:
            raise checks.InputError(f"{self.path}: row {bad[0]} is none of this map; give another file name")
        if len(whole) < len(content):
            with open(self.path, "r+b") as file:
                file.truncate(len(whole))
        if not lines:
            self._append(head)

    @staticmethod
    def _row(k: int, cells: list[Any]) -> tuple[int, list[Any]]:
        return int(k), list(cells)

    def add(self, row: int, cells: list[Any]) -> None:
        """Keep one row."""
        self.rows[row] = cells
        self._append(json.dumps([row, cells]))

    def _append(self, line: str) -> None:
        """Write one line and see it on the disk."""
        if self.path is None:
            return
        try:
            with open(self.path, "a", encoding="utf-8") as file:
                file.write(line + "\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise checks.InputError(
                f"{self.path} cannot be written: {error.strerror}; what it holds so far is kept"
            ) from None
