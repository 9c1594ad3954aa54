"""Names of parts, ports and drives, and text that fits into one line.

A name travels from a file into others: netCDF variables, comments and pins of a circuit, folders. One rule therefore
holds for every name, whichever file or call it comes from; `one_line` is what every writer does to other text.
"""

from __future__ import annotations

import re
from typing import Any

from .checks import InputError, one_line, shown

LONGEST = 100  # characters
MOST = 10_000  # names in one list
_NAME = re.compile(r"\w[\w .+-]*")
RULE = f"take letters, digits, spaces and _ . + -, at most {LONGEST}"

__all__ = ["LONGEST", "RULE", "ascii_lines", "check_name", "check_names", "one_line"]


def check_name(what: str, name: Any) -> str:
    """Return a name that may stand in every file; ``what`` says in the error whose it is.

    Raises
    ------
    InputError
        no text, empty, too long, or with characters other than letters, digits, spaces and ``_ . + -``.

    >>> check_name("part", "ring 1")
    'ring 1'
    """
    if not (isinstance(name, str) and len(name) <= LONGEST and _NAME.fullmatch(name)):
        raise InputError(f"{what} name = {shown(name)} is not usable; {RULE}")
    return name


def check_names(what: str, names: Any) -> tuple[str, ...]:
    """Return a list of names as a tuple, each checked by `check_name`."""
    if not isinstance(names, list | tuple) or not 0 < len(names) <= MOST:
        raise InputError(f"{what} = {shown(names)} must be a list of 1 to {MOST} names")
    return tuple(check_name(what, name) for name in names)


def ascii_lines(text: str, *, most: int = 400) -> list[str]:
    """Text of any origin as lines of printable ASCII without a trailing backslash, fit for a comment.

    Every character at which some program ends a line splits it; other control characters are written as escapes.

    >>> ascii_lines("a\\r.include b\\x00")
    ['a', '.include b\\\\x00']
    """
    lines = []
    for piece in str(text).splitlines() or [""]:
        line = one_line(piece, most=most).encode("ascii", "backslashreplace").decode()
        lines.append(f"{line} ." if line.endswith("\\") else line)
    return lines
