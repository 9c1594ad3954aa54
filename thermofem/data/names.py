"""Names of parts, ports and drives, and text that fits into one line.

A name travels from a file into others: netCDF variables, comments and pins of a circuit, folders. One rule therefore
holds for every name, whichever file or call it comes from; `one_line` is what every writer does to other text.
"""

from __future__ import annotations

import os
import re
from enum import EnumType, StrEnum
from typing import Any

from ..checks import InputError, choice, exact, one_line, shown, unique

LONGEST = 100  # characters
MOST = 10_000  # names in one list
_NAME = re.compile(r"\w[\w .+-]*")
RULE = f"take letters, digits, spaces and _ . + -, at most {LONGEST}"

__all__ = [
    "LONGEST",
    "RULE",
    "Words",
    "ascii_lines",
    "check_name",
    "check_names",
    "check_one",
    "lines_of",
    "of_file",
    "one_line",
]


def check_name(what: str, name: Any) -> str:
    """Return a name that is valid in every file format, as a plain str; ``what`` names its owner in the error.

    Raises InputError: no text, empty, too long, or with characters other than letters, digits, spaces and ``_ . + -``.

    >>> check_name("part", "ring 1")
    'ring 1'
    """
    if not (isinstance(name, str) and len(name) <= LONGEST and _NAME.fullmatch(name)):
        raise InputError(f"{what} name = {shown(name)} is not usable; {RULE}")
    return exact(name)


def check_names(what: str, names: Any) -> tuple[str, ...]:
    """Return a list of names as a tuple, each checked by `check_name` and given once."""
    if not isinstance(names, list | tuple) or not 0 < len(names) <= MOST:
        raise InputError(f"{what} = {shown(names)} must be a list of names, 1 to {MOST}")
    found = tuple(check_name(what, name) for name in names)
    unique(what, found, hint="a name tells one from the other")
    return found


def check_one(what: str, names: Any) -> tuple[str, ...]:
    """Return a list of one name as a tuple, for a model with one input and one output."""
    found = check_names(what, names)
    if len(found) != 1:
        raise InputError(f"{what} = {shown(names)}; this kind of model has one of each, a StateSpace takes several")
    return found


def of_file(name: str) -> str:
    """The name of a file as text that every other file can hold: bytes that are not UTF-8 become escapes."""
    return os.fsencode(name).decode(errors="backslashreplace")


def lines_of(text: str, *, most: int = 4000) -> list[str]:
    """Text as printable lines without a backslash at the end, which some programs read as a line continuation.

    Every character at which some program ends a line splits it; other control characters are written as escapes.

    >>> lines_of("a\\r.include b\\x00")
    ['a', '.include b\\\\x00']
    """
    lines = [one_line(piece, most=most) for piece in str(text).splitlines() or [""]]
    return [f"{line} ." if line.endswith("\\") else line for line in lines]


def ascii_lines(text: str) -> list[str]:
    """`lines_of` in ASCII, fit for a comment in any program's file."""
    return [line.encode("ascii", "backslashreplace").decode() for line in lines_of(text)]


class _Closed(EnumType):
    """The class of an enumeration that nothing extends: a call with more than a value makes no other enumeration."""

    def __call__(cls, value: Any, *further: Any, **options: Any) -> Any:
        if cls.__members__ and (further or any(option is not None for option in options.values())):
            raise InputError(f"{cls.__name__.lower()} takes one value; known: {', '.join(map(str, cls))}")
        if cls.__members__ and not isinstance(value, str):  # an array would be compared with each
            choice(cls.__name__.lower(), value, map(str, cls))
        return super().__call__(value, *further, **options)


class Words(StrEnum, metaclass=_Closed):
    """Words of a choice. One that is none of them raises InputError."""

    @classmethod
    def _missing_(cls, value: object) -> Words:
        return cls(choice(cls.__name__.lower(), value, map(str, cls)))
