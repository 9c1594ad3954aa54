"""A store: the finished results of a long job in one folder, a file for each key and its hash in ``results.sha256``.

Campaigns, maps, families and the paper keep their results so. A file appears under its name when it is complete, its
hash afterwards; a killed job goes on with what has both, and a damaged file is computed again.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ..checks import InputError
from ..data import files


@dataclass(frozen=True)
class Store:
    """Results by key.

    folder: holds ``results/KEY.ending`` and ``results.sha256``.
    ending: of the files, such as ".nc".
    """

    folder: Path
    ending: str

    @property
    def ledger(self) -> Path:
        """File with a line for each result: hash of its content, and its key."""
        return self.folder / "results.sha256"

    def path(self, key: str) -> Path:
        """File of one result."""
        return self.folder / "results" / f"{key}{self.ending}"

    @contextlib.contextmanager
    def opened(self, *inner: str) -> Iterator[None]:
        """Make the folder (and folders in it), lock it, and delete half-written files of a killed run.

        Raises InputError: it cannot be made or written, or another run is using it.
        """
        with files.own_folder(self.folder, ("results", *inner)):
            yield

    def hashes(self) -> dict[str, str]:
        """Hash of each result by key; the last line of a key counts, a damaged line counts for nothing."""
        if not self.ledger.is_file():
            return {}
        pairs = (line.split() for line in self.ledger.read_text(encoding="ascii", errors="replace").splitlines())
        return {pair[1]: pair[0] for pair in pairs if len(pair) == 2}

    def intact(self, keys: list[str]) -> set[str]:
        """The keys whose file is there with the content that was written."""
        hashes = self.hashes()
        return {k for k in keys if k in hashes and self.path(k).is_file() and files.digest(self.path(k)) == hashes[k]}

    def read(self, key: str) -> bytes | None:
        """Content of a result, or None where it is missing or damaged."""
        return files.read_bytes(self.path(key), "result") if self.intact([key]) else None

    def write(self, key: str, content: bytes) -> None:
        """Store a result."""
        files.write_whole(self.path(key), lambda temporary: temporary.write_bytes(content))
        self.enter(key)

    def enter(self, key: str) -> None:
        """Enter a result, whose file is complete, into the ledger; InputError where that cannot be written."""
        try:
            with self.ledger.open("a", encoding="ascii") as file:
                file.write(f"{files.digest(self.path(key))} {key}\n")
        except OSError as error:
            raise InputError(f"{self.ledger} cannot be written: {error.strerror}") from None
