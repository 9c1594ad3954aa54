"""Checks of arguments; their errors name argument, value, rule and hint in one line."""

import contextlib
import difflib
import math
import os
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Any, Self

import numpy as np

from .arrays import Array, ArrayLike
from .errors import Hint, InputError, MissingLibraryError, one_line, prefixed, shown  # noqa: F401 - as checks.InputError

SMALLEST = 1e-150  # of a positive number: its square and the inverse of it are floats
LARGEST_NUMBER = 1e100  # of any number: products of three are floats
LONGEST_NAME = 100  # characters
POWER_HINT = Hint("powers are in W (did you mean 2e-3 for 2 mW?)")
MOST_POWER = 10.0  # W
_NAME = re.compile(r"\w[\w .+-]*")


def finite(name: str, value: Any, *, unit: str = "", hint: str = "") -> float:
    """Return ``value`` as a float, or raise InputError unless it is one finite number."""
    number: float | None = None
    if not isinstance(value, str | bytes | bool | np.bool_):  # float() would take them
        with contextlib.suppress(TypeError, ValueError, OverflowError):
            number = float(value)
    if number is None or not abs(number) <= LARGEST_NUMBER:
        rule = f"{shown(value)} is not a number" if number is None else f"{number:g} is not finite"
        raise InputError(_rule(f"{name} = {rule}", unit), hint)
    return number


def positive(name: str, value: Any, *, unit: str = "", at_most: float = math.inf, hint: str = "") -> float:
    """Return ``value`` as a float, or raise InputError unless `SMALLEST` <= value <= at_most."""
    number = finite(name, value, unit=unit, hint=hint)
    if not SMALLEST <= number <= at_most:
        rule = "must be positive" if number < SMALLEST else f"is larger than {at_most:g}"
        raise InputError(_rule(f"{name} = {number:g} {rule}", unit), hint)
    return number


def between(name: str, value: Any, low: float, high: float, *, unit: str = "", hint: str = "") -> float:
    """Return ``value`` as a float, or raise InputError unless low <= value <= high."""
    number = finite(name, value, unit=unit, hint=hint)
    if not low <= number <= high:
        raise InputError(_rule(f"{name} = {number:.9g} must lie between {low:g} and {high:g}", unit), hint)
    return number


def power(name: str, value: Any, *, zero: bool = False) -> float:
    """Return a power in W as a float, or raise InputError unless it is positive (or zero) and at most `MOST_POWER`."""
    if zero:
        return between(name, value, 0, MOST_POWER, unit="W", hint=POWER_HINT)
    return positive(name, value, unit="W", at_most=MOST_POWER, hint=POWER_HINT)


def integer(name: str, value: Any, low: int, high: float, *, hint: str = "") -> int:
    """Return ``value`` as an int, or raise InputError unless it is a whole number in [low, high]; 3.0 is refused."""
    if not isinstance(value, int | np.integer) or isinstance(value, bool) or not low <= value <= high:
        end = "" if high == math.inf else f" to {high:,}"
        raise InputError(f"{name} = {shown(value)} must be a whole number from {low}{end}", hint)
    return int(value)


def seed(value: Any) -> int:
    """Return a seed of random numbers, or raise InputError."""
    return integer("seed", value, 0, math.inf)


def array(
    name: str,
    value: ArrayLike,
    *,
    increasing: bool = False,
    empty: bool = False,
    hint: str = "",
    most: float = LARGEST_NUMBER,
) -> Array:
    """Return ``value`` as a 1-D float array, or raise InputError if it is not finite or not increasing.

    An empty array is refused, too, unless ``empty``.
    """
    result = np.atleast_1d(numbers(name, value, hint=hint, most=most))
    if empty and result.size == 0:
        return np.empty(0)
    if result.ndim != 1 or result.size == 0:
        raise InputError(f"{name} has shape {result.shape}; one non-empty dimension is needed", hint)
    if not increasing:
        return result
    falls = np.diff(result) < 0
    if falls.any():
        k = int(np.argmax(falls)) + 1
        raise InputError(f"{name}[{k}] = {result[k]:g} is before {name}[{k - 1}]; times must increase", hint)
    return result


def numbers(name: str, value: ArrayLike, *, hint: str = "", most: float = LARGEST_NUMBER) -> Array:
    """Return a copy of ``value`` as a float array of its own shape.

    Raises InputError: text, complex or Boolean values, one that is not finite or beyond ``most``.
    """
    result = None
    with contextlib.suppress(TypeError, ValueError, OverflowError):
        found = np.asarray(value)
        if found.dtype.kind in "fiuO":  # float() would take others, too
            result = np.array(found, dtype=float)
    if result is None:
        raise InputError(f"{name} is not an array of real numbers", hint)
    usable = np.isfinite(result) & (np.abs(result) <= most)
    if not usable.all():
        first = int(np.argmin(usable))
        where = f"[{first}]" if result.ndim == 1 else ""
        raise InputError(f"{name}{where} = {result.ravel()[first]:g} is not finite", hint)
    return result


def shape(name: str, value: Any, wanted: tuple[int, ...]) -> None:
    """Raise InputError unless an array has the shape ``wanted``."""
    if value.shape != wanted:
        raise InputError(f"{name} has shape {value.shape}; {wanted} is needed")


def plain(one: Any) -> None:
    """Replace NumPy scalars in the fields of a frozen dataclass by Python numbers, which files and reprs can show."""
    for name, value in vars(one).items():
        if isinstance(value, np.generic):
            object.__setattr__(one, name, value.item())


def keep(one: Any, **arrays: Any) -> None:
    """Set arrays, dense or sparse, as read-only fields of a frozen dataclass, so that checked values cannot change."""
    for name, kept in arrays.items():
        for array in (kept.data, kept.indices, kept.indptr) if hasattr(kept, "indptr") else (kept,):
            array.flags.writeable = False
        object.__setattr__(one, name, kept)


def has(name: str, value: Any, *attributes: str, hint: str) -> None:
    """Raise InputError unless ``value`` has the attributes and is an object, not a class."""
    if isinstance(value, type) or not all(hasattr(value, attribute) for attribute in attributes):
        raise InputError(f"{name} is a {type(value).__name__}; {hint}")


def ordered(first: str, low: float, second: str, high: float, *, unit: str = "", hint: str = "") -> None:
    """Raise InputError unless ``low``, the value of ``first``, is below ``high``, that of ``second``."""
    if not low < high:
        raise InputError(_rule(f"{first} = {low:g} must be below {second} = {high:g}", unit), hint)


def enough(name: str, count: int, least: int, what: str = "samples", *, hint: str = "") -> None:
    """Raise InputError unless ``count`` is at least ``least``."""
    if count < least:
        raise InputError(f"{name} has {count} {what}; at least {least} are needed", hint)


def instance(name: str, value: Any, *kinds: type, hint: str) -> None:
    """Raise InputError unless ``value`` is of one of the kinds."""
    if not isinstance(value, kinds):
        raise InputError(f"{name} is a {type(value).__name__}; {hint}")


def instances(name: str, values: Any, *kinds: type) -> tuple[Any, ...]:
    """Return a list as a tuple, or raise InputError unless all that it holds is of these kinds."""
    found = (values,) if isinstance(values, str) or not isinstance(values, Iterable) else tuple(values)
    wrong = found if isinstance(values, str) else [item for item in found if not isinstance(item, kinds)]
    if wrong:
        needed = " or ".join(kind.__name__ for kind in kinds)
        raise InputError(f"{name} holds {shown(wrong[0])}; a list of {needed} is needed")
    return found


def mapping(name: str, value: Any, *, hint: str = "") -> dict[str, Any]:
    """Return a mapping from text as a dict, empty for None, or raise InputError."""
    if value is None:
        return {}
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise InputError(f"{name} = {shown(value)} must be a mapping from names", hint)
    return dict(value)


def unique(name: str, values: Sequence[Any], *, hint: str = "") -> None:
    """Raise InputError where a value occurs twice in a list."""
    for value, count in Counter(values).items():
        if count > 1:
            raise InputError(f"{name} holds {shown(value)} twice; give each once", hint)


def text(name: str, value: Any) -> str:
    """Return ``value``, or raise InputError if it is no text."""
    if not isinstance(value, str):
        raise InputError(f"{name} = {shown(value)} must be text")
    return value


def flag(name: str, value: Any) -> bool:
    """Return ``value`` as a bool, or raise InputError for anything else, such as the text "no"."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{name} = {shown(value)} must be True or False")
    return bool(value)


def choice(name: str, value: Any, choices: Iterable[str], *, default: str | None = None, hint: str = "") -> str:
    """Return ``value``, ``default`` for None, or raise InputError naming the nearest of ``choices``."""
    known = sorted(choices)
    value = default if value is None else value
    if isinstance(value, str) and value in known:
        return value
    near = difflib.get_close_matches(shown(value).strip("'"), known, n=1, cutoff=0.5)
    guess = f"did you mean {near[0]!r}{'' if hint else '?'}" if near else f"known: {', '.join(known)}"
    raise InputError(f"{name} = {shown(value)} is unknown; {guess}", hint)


class Words(StrEnum):
    """Base class of a choice of words; any other word raises InputError."""

    @classmethod
    def _missing_(cls, value: object) -> Self:
        return cls(choice(cls.__name__.lower(), value, map(str, cls)))


def path(name: str, value: Any) -> Path:
    """Return ``value`` as a Path, or raise InputError if it is not the name of a file or folder."""
    if not isinstance(value, str | os.PathLike) or "\0" in os.fspath(value):
        raise InputError(f"{name} = {shown(value)} is no name of a file; give a text or a pathlib.Path")
    return Path(value)


def check_name(what: str, name: Any) -> str:
    """Return a name that every file format holds: an identifier, also with spaces and ``. + -`` inside.

    Raises InputError: no text, empty, too long, or with other characters; ``what`` names its owner.

    >>> check_name("part", "ring 1")
    'ring 1'
    """
    usable = isinstance(name, str) and len(name) <= LONGEST_NAME and _NAME.fullmatch(name)
    if not usable:
        rule = f"take letters, digits, spaces and _ . + -, at most {LONGEST_NAME}"
        raise InputError(f"{what} name = {shown(name)} is not usable; {rule}")
    return str(name)  # of an array, too: np.str_ has another repr


def check_names(what: str, names: Any, *, single: bool = False) -> tuple[str, ...]:
    """Return a list of names as a tuple, each checked by `check_name` and given once; ``single``: a list of one."""
    number = len(names) if isinstance(names, list | tuple) else 0
    if not number or (single and number > 1):
        needed = "one name" if single else "names"
        rule = "this kind of model has one of each, a StateSpace takes several" if single else ""
        raise InputError(f"{what} = {shown(names)} must be a list of {needed}", rule)
    unique(what, names, hint="a name tells one from the other")
    return tuple(check_name(what, name) for name in names)


def _rule(rule: str, unit: str) -> str:
    return rule + (f" (in {unit})" if unit else "")
