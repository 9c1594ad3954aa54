"""Old public names, which work for one release with a warning that gives the new one."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def warn(old: str, new: str, up: int = 2) -> None:
    """Issue the warning at the line that used the old name, ``up`` calls up."""
    warnings.warn(f"{old} is now {new}; the old name goes with 0.3", DeprecationWarning, stacklevel=up + 1)


def keywords(**names: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """A decorator by which keyword arguments also go by their old names: ``keywords(old="new")``."""

    def around(function: Callable[P, R]) -> Callable[P, R]:
        @functools.wraps(function)
        def call(*args: Any, **given: Any) -> R:
            for old in names.keys() & given.keys():
                warn(f"{function.__qualname__}: {old}", names[old])
                given.setdefault(names[old], given.pop(old))
            return function(*args, **given)

        return call

    return around
