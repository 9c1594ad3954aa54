"""Files of TOML text, read with errors that name the file."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from . import checks
from .checks import InputError

T = TypeVar("T")


def text_of(path: Path, kind: str) -> str:
    """Text of a file of a kind such as "geometry"; InputError where there is none."""
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(f"{kind} file {str(path)!r} does not exist") from None
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise InputError(f"{kind} file {str(path)!r} cannot be read: {reason}") from None


def read(path: str | Path, kind: str, read_text: Callable[[str], T]) -> T:
    """What ``read_text`` makes of the text of a file; its InputError then begins with the file."""
    text = text_of(checks.path("path", path), kind)
    try:
        return read_text(text)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def parse(text: str) -> dict[str, Any]:
    """The tables of TOML text; InputError with line and column where it is none."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"not valid TOML: {error}") from None
