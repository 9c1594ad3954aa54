"""Files of TOML text, read with errors that name the file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from . import files, trees
from .checks import InputError

T = TypeVar("T")

LARGEST = 16_000_000  # bytes

parse = trees.from_toml


def text_of(path: str | Path, kind: str) -> str:
    """Text of a file of a kind such as "geometry"; InputError where there is none."""
    return files.read_text(path, kind, most=LARGEST)


def read(path: str | Path, kind: str, read_text: Callable[[str], T]) -> T:
    """Return ``read_text`` of the text of a file; an InputError names the file first."""
    text = text_of(path, kind)
    try:
        return read_text(text)
    except InputError as error:
        raise InputError(f"{path}: {error.for_text()}") from None
