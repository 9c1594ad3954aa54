"""Files of TOML text: read with errors that name the file, by tables that list each key and its unit; and written."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from .. import checks
from ..checks import InputError
from . import files, quantity, trees

T = TypeVar("T")

LARGEST = 16_000_000  # bytes
TEXT, FLAG, NUMBER, TABLE, TABLES, ANY = "text", "true or false", "a number", "a table", "tables", "anything"
_TYPES: dict[str, type] = {TEXT: str, FLAG: bool, TABLE: dict}

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


def read_table(table: Any, keys: Mapping[str, str], where: str, *, required: Sequence[str] = ()) -> dict[str, Any]:
    """The values of one table, quantities in SI; ``keys`` gives the SI unit of each, or one of the kinds above.

    Raises InputError: no table, a key that is unknown or missing, a value of another kind or unit.
    """
    if not isinstance(table, dict):
        raise InputError(f"{where} = {table!r} must be a table")
    for key in table:
        checks.choice(f"{where}: key", key, keys)
    for key in required:
        if key not in table:
            raise InputError(f"{where}: {key} is missing" + (f"; add [[{key}]] tables" if keys[key] == TABLES else ""))
    return {key: _value(value, keys[key], key, where) for key, value in table.items()}


def _value(value: Any, kind: str, key: str, where: str) -> Any:
    if kind == ANY:
        return value
    if kind in _TYPES:
        if not isinstance(value, _TYPES[kind]):
            raise InputError(f"{where}: {key} = {value!r} must be {kind}")
        return value
    if kind == TABLES:
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise InputError(f"{where}: {key} must be tables, each opened by a line [[{key}]]")
        return value
    if kind == NUMBER:
        return checks.finite(f"{where}: {key}", value)
    return quantity.parse(value, kind, name=f"{where}: {key}")


def write_tables(table: Mapping[str, Any]) -> str:
    """TOML text with a heading for each table and for each table of a list; deeper tables are written inline."""
    blocks = [("", {key: value for key, value in table.items() if not isinstance(value, dict | list)})]
    for key, value in table.items():
        if isinstance(value, list):
            blocks += [(f"[[{key}]]\n", item) for item in value]
        elif isinstance(value, dict) and all(isinstance(item, dict) for item in value.values()):
            blocks += [(f"[{key}.{_key(name)}]\n", item) for name, item in value.items()]
        elif isinstance(value, dict):
            blocks.append((f"[{key}]\n", value))
    return "\n".join(head + write_table(values) for head, values in blocks)


def write_table(table: Mapping[str, Any]) -> str:
    """TOML text of a table: one line for each key; a table inside it is written inline."""
    return "".join(f"{_key(key)} = {_inline(value)}\n" for key, value in table.items())


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{_key(key)} = {_inline(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    try:
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    except TypeError:
        raise InputError(f"{checks.shown(value)} is neither a text nor a number") from None


def _key(key: str) -> str:
    if not isinstance(key, str):
        raise InputError(f"the key {checks.shown(key)} is no text")
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else json.dumps(key, ensure_ascii=False)
