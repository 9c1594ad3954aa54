"""The files of a command: none that it writes is one that it reads."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from thermofem.checks import InputError
from thermofem.data import files

from .values import each

OUTPUTS = frozenset({"output", "figure", "preview", "paraview", "animation", "map_", "resume", "folder"})
_taken: list[Path] = []  # files that the command of this moment reads


def check_apart(options: Mapping[str, Any]) -> None:
    """InputError where a command would write over a file that another of its options names, or that such a file names.

    Every option but those in `OUTPUTS` counts as an input, so that no command has to list its own. Names that the
    command makes itself, such as that of an export, are checked by `check_unread`.
    """
    _taken.clear()
    if not OUTPUTS & options.keys():
        return
    given = [item for name, value in options.items() if name not in OUTPUTS for item in each(value)]
    _taken.extend(path for item in given if isinstance(item, str | Path) for path in _read_with(item))
    for name in OUTPUTS & options.keys():
        for path in filter(None, each(options[name])):
            check_unread(path)


def check_unread(path: Path) -> None:
    """InputError where the command would write over a file that it reads."""
    for other in _taken:
        if written := both(path, other):
            raise InputError(f"{written} would be read and written at once; give it another name")


def _read_with(path: str | Path) -> list[Path]:
    """A file and every file that its TOML text names, such as the geometry of a campaign; none where it is no file."""
    found: dict[str, Path] = {}
    waiting = [Path(path)]
    while waiting:
        path = waiting.pop()
        if os.path.isfile(path) and os.path.realpath(path) not in found:
            found[os.path.realpath(path)] = path
            waiting += [path.parent / word for word in _words(path)]
    return list(found.values())


def _words(path: Path) -> list[str]:
    """Texts in a file of TOML; none in any other."""
    try:
        level: list[Any] = [files.from_toml(files.read_text(path, "TOML"))]
    except InputError:
        return []
    words = []
    while level:
        node = level.pop()
        if isinstance(node, dict | list):
            level += node.values() if isinstance(node, dict) else node
        elif isinstance(node, str):
            words.append(node)
    return words


def both(output: Path, other: Path) -> Path | None:
    """What is written at two names, of which the second may be read; None where they are apart.

    The .vtu files beside a .pvd are written with it.
    """
    first, second = Path(os.path.realpath(output)), Path(os.path.realpath(other))
    if first == second:
        return output
    step = re.fullmatch(rf"{re.escape(first.stem)}_\d{{4,}}\.vtu", second.name)
    return other if first.suffix == ".pvd" and first.parent == second.parent and step else None
