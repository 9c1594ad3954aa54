"""Old public names, which work for one release with a warning that gives the new one."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from typing import Any, TypeVar, cast

from .errors import InputError

F = TypeVar("F", bound=Callable[..., Any])


def warn(old: str, new: str, up: int = 2) -> None:
    """Issue the warning at the line that used the old name, ``up`` calls up."""
    warnings.warn(f"{old} is now {new}; the old name goes with 0.3", DeprecationWarning, stacklevel=up + 1)


def keywords(**names: str) -> Callable[[F], F]:
    """A decorator by which keyword arguments also go by their old names: ``keywords(old="new")``."""

    def around(function: F) -> F:
        @functools.wraps(function)
        def call(*args: Any, **given: Any) -> Any:
            for old in names.keys() & given.keys():
                warn(f"{function.__qualname__.removesuffix('.__init__')}: {old}", names[old])
                if names[old] in given:
                    raise InputError(f"{old} and {names[old]} are both given; {old} is the old name, leave it out")
                given[names[old]] = given.pop(old)
            return function(*args, **given)

        return cast("F", call)

    return around


def objects(module: str, **names: Any) -> Callable[[str], Any]:
    """The ``__getattr__`` of a module whose objects also go by their old names: ``objects(__name__, Old=New)``."""

    def find(name: str) -> Any:
        if name not in names:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        warn(f"{module}.{name}", f"{module}.{names[name].__name__}")
        return names[name]

    return find
