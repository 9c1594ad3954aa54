"""No command writes over a file that it is given, whichever option names it."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ..checks import InputError

OUTPUTS = frozenset({"output", "figure", "preview", "paraview", "animation", "map_", "resume", "folder"})


def check_apart(options: Mapping[str, Any]) -> None:
    """InputError where a command would write over a file that another of its options names.

    Every option but those in `OUTPUTS` counts as an input, so that no command has to list its own.
    """
    given = [item for name, value in options.items() if name not in OUTPUTS for item in _each(value)]
    taken = {os.path.realpath(item) for item in given if isinstance(item, str | Path) and os.path.isfile(item)}
    for name in OUTPUTS & options.keys():
        for path in filter(None, _each(options[name])):
            if os.path.realpath(path) in taken:
                raise InputError(f"{path} would be read and written at once; give it another name")


def _each(value: Any) -> Iterable[Any]:
    return value if isinstance(value, list | tuple) else [value]
