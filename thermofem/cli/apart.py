"""The files of a command: none that it writes is one that it reads."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..checks import InputError
from .values import each

OUTPUTS = frozenset({"output", "figure", "preview", "paraview", "animation", "map_", "resume", "folder"})


def check_apart(options: Mapping[str, Any]) -> None:
    """InputError where a command would write over a file that another of its options names.

    Every option but those in `OUTPUTS` counts as an input, so that no command has to list its own.
    """
    given = [item for name, value in options.items() if name not in OUTPUTS for item in each(value)]
    taken = [item for item in given if isinstance(item, str | Path) and os.path.isfile(item)]
    for name in OUTPUTS & options.keys():
        for path in filter(None, each(options[name])):
            if any(writes(path, item) for item in taken):
                raise InputError(f"{path} would be read and written at once; give it another name")


def writes(output: str | Path, other: str | Path) -> bool:
    """Whether a command that writes one file writes the other: the .vtu files beside a .pvd are written with it."""
    first, second = Path(os.path.realpath(output)), Path(os.path.realpath(other))
    step = re.fullmatch(rf"{re.escape(first.stem)}_\d{{4,}}\.vtu", second.name)
    return first == second or (first.suffix == ".pvd" and first.parent == second.parent and step is not None)
