"""The files that a reproduction wrote into its folder, the only ones there that it replaces.

    .reproduced     a name a line, such as data/training.json; the line is written before the file

A file of such a name that was damaged or edited since is made again. A folder of an earlier version has no such list;
there the file of a stage's numbers shows that the folder is a reproduction.
"""

from __future__ import annotations

import os
from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from thermofem.checks import InputError
from thermofem.data import files

OWNER = "a reproduction"
TABLE = "table.json"


@dataclass(frozen=True)
class Written:
    """The list of a folder ``out``."""

    out: Path

    @property
    def file(self) -> Path:
        """File that holds it."""
        return self.out / ".reproduced"

    @cached_property
    def paths(self) -> set[Path]:
        """Files that were written, whether they are still there or not. Damaged lines name no file."""
        if not self.file.exists():
            return set()
        lines = files.read_bytes(self.file, "list").decode("utf-8", "replace").splitlines()
        return {self.out / line for line in lines if line}

    def check(self, paths: Collection[Path]) -> None:
        """InputError where one of the files that will be written is there and no reproduction wrote it."""
        if not self.paths:
            self.add(*self._of_earlier_version())
        files.check_own(paths, self.paths, OWNER)

    def _of_earlier_version(self) -> list[Path]:
        """The files in a folder of a version that kept no list; none where the numbers of no stage are there."""
        patterns = ("*.html", "data/*.json", "data/*.nc", "figures/*.svg")
        inside = [path for pattern in patterns for path in sorted(self.out.glob(pattern)) if path.is_file()]
        found = [path for path in inside if not (mark := _mark(path)) or mark in path.read_bytes()]
        return found if any(path.suffix == ".json" and path.name != TABLE for path in found) else []

    def add(self, *paths: Path) -> None:
        """Note files that will be written now; processes may do so at the same time."""
        new = [path for path in paths if path not in self.paths]
        if not new:
            return
        text = "".join(f"\n{path.relative_to(self.out).as_posix()}" for path in new) + "\n"
        try:
            with self.file.open("ab", buffering=0) as opened:
                opened.write(text.encode())
                os.fsync(opened.fileno())
        except OSError as error:
            raise InputError(f"{self.file} cannot be written: {error.strerror}") from None
        self.paths.update(new)


def _mark(path: Path) -> bytes:
    """Bytes that a file of an earlier version holds; data and figures hold none that others cannot hold."""
    if path.suffix == ".html":
        return b"thermofem"
    if path.name == TABLE:
        return b'"paper": '
    return f'"stage": "{path.name.partition(".")[0]}"'.encode() if path.suffix == ".json" else b""
