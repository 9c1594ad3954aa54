"""JSON and TOML text of any origin as a tree of bounded shape; every reader of either goes through here.

A tree holds objects, lists, text, finite numbers, true, false and null, nested at most `DEPTH` deep. What it cannot
hold is an InputError: nan and infinities, dates, integers of TOML beyond 64 bits, halves of Unicode pairs, a key that
an object has twice, text beyond `LONGEST` characters.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Mapping
from typing import Any

from ..checks import InputError, shown

DEPTH = 40  # of tables and lists in one another; our own files reach 8
LONGEST = 200_000_000  # characters of JSON: a StateSpace of 500 states has 30 million
LONGEST_TOML = 4_000_000  # characters
DIGITS = 18  # of an integer that stays one; more are a float
_WORD = r"""(?:[A-Za-z0-9_-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
_DOTTED = re.compile(rf"(?<![\w\\-]){_WORD}(?:[ \t]*+\.[ \t]*+{_WORD}){{{DEPTH}}}")  # tomllib's memory is its square


def from_json(text: str) -> Any:
    """The tree of a JSON text.

    Raises InputError: no JSON, or a tree that is too deep or holds what the module's docstring excludes.

    >>> from_json('{"R": [1e3, 2]}')
    {'R': [1000.0, 2]}
    """
    _check_length(text, LONGEST)
    try:
        tree = json.loads(text, parse_constant=_refuse, parse_int=_integer, parse_float=_float, object_pairs_hook=_once)
    except RecursionError:
        raise InputError(f"it is nested more than {DEPTH} deep") from None
    except json.JSONDecodeError as error:
        raise InputError(f"it is not JSON ({error})") from None
    return check(tree)


def from_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text; raises as `from_json`, with line and column where it is no TOML."""
    _check_length(text, LONGEST_TOML)
    if _DOTTED.search(text):
        raise InputError(f"not valid TOML: a dotted name is nested more than {DEPTH} deep")
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        raise InputError(f"not valid TOML: it is nested more than {DEPTH} deep") from None
    except ValueError as error:  # TOMLDecodeError, and an integer of more digits than Python reads
        raise InputError(f"not valid TOML: {error}") from None
    found: dict[str, Any] = check(tables)
    return found


def plain(value: Any) -> Any:
    """A value as JSON holds it: arrays as lists, keys as text; a number that is not finite becomes null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def check(tree: Any) -> Any:
    """The tree, unchanged; InputError where it is too deep or holds a forbidden value, see the module's docstring."""
    level, depth = [tree], 0
    while level:
        if depth > DEPTH:
            raise InputError(f"it is nested more than {DEPTH} deep")
        below: list[Any] = []
        for node in level:
            if isinstance(node, dict):
                for key in node:
                    _check_leaf(key)
                below.extend(node.values())
            elif isinstance(node, list | tuple):
                below.extend(node)
            else:
                try:
                    _check_leaf(node)
                except InputError as error:
                    raise InputError(f"{_place(tree, node)}{error.rule}", error.hint) from None
        level, depth = below, depth + 1
    return tree


def _place(tree: Any, leaf: Any) -> str:
    """Where a leaf stands, such as "ring[1].shift: "."""
    left = [("", tree)]
    while left:
        name, node = left.pop()
        if node is leaf:
            whole = name.removeprefix(".").encode("utf-8", "backslashreplace").decode()
            return f"{whole}: " if name else ""
        if isinstance(node, dict):
            left.extend((f"{name}.{key}", item) for key, item in reversed(node.items()))
        elif isinstance(node, list | tuple):
            left.extend((f"{name}[{k}]", item) for k, item in reversed([*enumerate(node)]))
    return ""


def _check_leaf(value: Any) -> None:
    if value is None or isinstance(value, bool):
        return
    if isinstance(value, str):
        if not value.isascii() and any("\ud800" <= c <= "\udfff" for c in value):
            raise InputError(f"{shown(value)} holds half of a Unicode pair, which is no text")
    elif isinstance(value, int):
        if value.bit_length() > 63:
            raise InputError(f"{shown(value, most=30)} is an integer beyond 64 bits; write it as 1e20")
    elif isinstance(value, float):
        if not math.isfinite(value):
            raise InputError(f"{value} is no number")
    else:
        raise InputError(f"{shown(value)} is neither text, number, true nor false; dates have no place here")


def _check_length(text: Any, most: int) -> None:
    if not isinstance(text, str):
        raise InputError(f"a {type(text).__name__} is no text")
    if len(text) > most:
        raise InputError(f"its {len(text)} characters are more than {most}")


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object; InputError where a key stands twice."""
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        raise InputError(f"an object has the key {shown(next(k for k in keys if keys.count(k) > 1))} twice")
    return found


def _refuse(name: str) -> float:
    raise InputError(f"it holds {name}, which is no number")


def _integer(digits: str) -> int | float:
    return int(digits) if len(digits) <= DIGITS else _float(digits)


def _float(digits: str) -> float:
    value = float(digits)
    if not math.isfinite(value):
        raise InputError(f"it holds {digits[:20]}..., which is larger than any number here")
    return value
