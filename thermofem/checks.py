"""Checks of arguments; their errors name argument, value, rule and hint in one line."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from enum import Enum
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .data import units
from .errors import Hint, InputError, MissingLibraryError, one_line, shown  # noqa: F401 - as checks.InputError

if TYPE_CHECKING:  # NumPy is imported where it is used: --help and errors of usage do without it
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

SMALLEST = 1e-150  # of a positive number: its square and the inverse of it are floats
LARGEST = 1e100  # of any number: products of three are floats
MOST = 100_000_000  # numbers of an array of any shape: 0.8 GB, a full matrix of 10,000 rows
LONGEST = 20_000_000  # numbers of a list such as times: what is worked out for each takes several times its room
POWER_HINT = Hint("powers are in W (did you mean 2e-3 for 2 mW?)")
MOST_POWER = 10.0  # W


def finite(name: str, value: Any, *, unit: str = "", hint: str = "") -> float:
    """Return ``value`` as a float, or raise InputError unless it is one finite number."""
    bare(name, value)
    try:
        if type(value) is not float and isinstance(value, _no_numbers()):
            raise TypeError
        number = float(value)
    except OverflowError:
        raise InputError(_rule(f"{name} = {shown(value)} is larger than any number here", unit), hint) from None
    except (TypeError, ValueError):
        raise InputError(_rule(f"{name} = {shown(value)} is not a number", unit), hint) from None
    if not math.isfinite(number):
        raise InputError(_rule(f"{name} = {number} is not finite", unit), hint)
    if abs(number) > LARGEST:
        raise InputError(_rule(f"{name} = {number:g} is beyond {LARGEST:g}, which is no quantity", unit), hint)
    return number + 0.0  # -0 is 0


def plain(one: Any) -> None:
    """Replace NumPy's numbers and text in the fields of a frozen dataclass by those of Python.

    float32 and uint8 keep their precision and range in arithmetic: 3 dB as uint8 became 253 dB where it was negated.
    """
    annotated(one)
    for name, value in vars(one).items():
        if (python := _plain(bare(name, value))) is not value:
            object.__setattr__(one, name, python)


def annotated(one: Any) -> None:
    """Raise InputError for a field of text or of a mapping, as it is annotated, that is none; text becomes `exact`."""
    for name, kind in type(one).__annotations__.items():
        value, needed = getattr(one, name), kind.removesuffix(" | None")
        if value is None and needed != kind:
            continue
        if needed == "str":
            object.__setattr__(one, name, text(name, value))
        elif needed.startswith("Mapping[") and not isinstance(value, Mapping):
            raise InputError(f"{name} = {shown(value)} must be a mapping")


def _plain(value: Any) -> Any:
    """A number or text of Python for one of NumPy, xarray or pandas, also in tuples; everything else as it is."""
    if isinstance(value, tuple):
        items = tuple(map(_plain, value))
        return value if all(a is b for a, b in zip(items, value, strict=True)) else items
    if isinstance(value, str) and not isinstance(value, Enum):
        return exact(value)
    if isinstance(value, float) or getattr(value, "shape", None) != () or hasattr(value, "mask"):
        return value
    kind = getattr(getattr(value, "dtype", None), "kind", "")
    return float(value) if kind == "f" else int(value) if kind in ("i", "u") else value


@cache
def _no_numbers() -> tuple[type, ...]:
    """Types whose values float() takes and that are no real numbers here: "1e-3" would be kept as text."""
    from decimal import Decimal
    from fractions import Fraction

    import numpy as np

    masked = np.ma.core.MaskedConstant
    return str, bytes, bool, np.bool_, complex, np.complexfloating, masked, Decimal, Fraction


def positive(name: str, value: Any, *, unit: str = "", at_most: float = math.inf, hint: str = "") -> float:
    """Return ``value`` as a float, or raise InputError unless 0 < value <= at_most; below `SMALLEST` it is nothing."""
    number = finite(name, value, unit=unit, hint=hint)
    if number <= 0:
        raise InputError(_rule(f"{name} = {number:g} must be positive", unit), hint)
    if number < SMALLEST:
        raise InputError(_rule(f"{name} = {number:g} is below {SMALLEST:g}, which is no quantity", unit), hint)
    if number > at_most:
        raise InputError(_rule(f"{name} = {number:g} is larger than {at_most:g}", unit), hint)
    return number


def between(name: str, value: Any, low: float, high: float, *, unit: str = "", hint: str = "") -> float:
    """Return ``value`` as a float, or raise InputError unless low <= value <= high."""
    number = finite(name, value, unit=unit, hint=hint)
    if not low <= number <= high:
        said = f"{number:g}" if not low <= float(f"{number:g}") <= high else repr(number)
        raise InputError(_rule(f"{name} = {said} must lie between {low:g} and {high:g}", unit), hint)
    return number


def power(name: str, value: Any, *, zero: bool = False) -> float:
    """Return a power in W as a float, or raise InputError unless it is positive (or zero) and at most `MOST_POWER`."""
    if zero:
        return between(name, value, 0, MOST_POWER, unit="W", hint=POWER_HINT)
    return positive(name, value, unit="W", at_most=MOST_POWER, hint=POWER_HINT)


def array(
    name: str,
    value: ArrayLike,
    *,
    increasing: bool = False,
    empty: bool = False,
    hint: str = "",
    most: float = LARGEST,
    longest: int = LONGEST,
) -> NDArray[np.float64]:
    """Return ``value`` as a 1-D float array, or raise InputError if it is not finite, too large or not increasing.

    Nothing, such as (), is refused, too, unless ``empty``, and so are more than ``longest`` numbers.
    """
    import numpy as np

    result = np.atleast_1d(_floats(name, value, hint, longest))
    if empty and result.size == 0:
        return np.empty(0)
    if result.ndim != 1 or result.size == 0:
        raise InputError(f"{name} has shape {result.shape}; one non-empty dimension is needed", hint)
    bad = np.flatnonzero(~np.isfinite(result))
    if bad.size:
        raise InputError(f"{name}[{bad[0]}] = {result[bad[0]]} is not finite", hint)
    if np.abs(result).max() > most:
        raise InputError(f"{name} holds a number beyond {most:g}, which is no quantity", hint)
    if increasing and np.any(np.diff(result) < 0):
        at = int(np.argmax(np.diff(result) < 0)) + 1
        raise InputError(f"{name}[{at}] = {result[at]:g} is before {name}[{at - 1}]; times must increase", hint)
    return result


def numbers(
    name: str, value: ArrayLike, *, hint: str = "", most: float = LARGEST, longest: int = MOST
) -> NDArray[np.float64]:
    """Return ``value`` as a float array of its own shape, or raise InputError where one is not finite or too large."""
    import numpy as np

    result = _floats(name, value, hint, longest)
    if not np.all(np.isfinite(result)):
        raise InputError(f"{name} holds {result[~np.isfinite(result)][0]}, which is not finite", hint)
    if np.abs(result).max(initial=0.0) > most:
        raise InputError(f"{name} holds a number beyond {most:g}, which is no quantity", hint)
    return result


def bare(name: str, value: Any) -> Any:
    """The value; InputError for one of pint, or of xarray in another unit than SI: NumPy would take its numbers."""
    if unit := units.foreign(value):
        raise InputError(f"{name} is in {unit}", "plain numbers in SI are needed, which pint's .m_as('s') gives")
    return value


def _floats(name: str, value: ArrayLike, hint: str, longest: int = MOST) -> NDArray[np.float64]:
    """A copy as a float array, so that no object changes with the caller's array.

    InputError for text, which NumPy would convert, and for complex or Boolean values.
    """
    import numpy as np

    try:
        if isinstance(value, range) and len(value) > longest:
            raise InputError(f"{name} holds {len(value)} numbers; at most {longest:,} are taken at one go", hint)
        if np.ma.is_masked(value):
            raise InputError(f"{name} holds masked values; leave them out", hint)
        found = np.asarray(bare(name, value))
        if found.size > longest:  # a view may repeat one number without end
            raise InputError(f"{name} holds {found.size} numbers; at most {longest:,} are taken at one go", hint)
        if found.dtype.kind in "USmM":
            raise TypeError
        if found.dtype.kind in "bc":
            kind = "complex" if found.dtype.kind == "c" else "true or false"
            raise InputError(f"{name} holds values that are {kind}; real numbers are needed", hint)
        with np.errstate(over="ignore", invalid="ignore"):  # what float64 cannot hold is inf, and refused as such
            return np.array(found, dtype=float)
    except InputError:
        raise
    except MemoryError:
        raise InputError(f"{name} holds more numbers than fit into memory", hint) from None
    except (TypeError, ValueError, OverflowError, RecursionError):
        raise InputError(f"{name} is not an array of numbers", hint) from None


def has(name: str, value: Any, *attributes: str, hint: str) -> None:
    """Raise InputError unless ``value`` has the attributes; a class has those of its objects, and is refused."""
    if isinstance(value, type):
        raise InputError(f"{name} is the class {value.__name__} and no object of it; {hint}")
    if not all(hasattr(value, attribute) for attribute in attributes):
        raise InputError(f"{name} is a {type(value).__name__}; {hint}")


def keep(one: Any, **arrays: Any) -> None:
    """Set arrays, dense or sparse, as fields of a frozen dataclass, read-only: what is written later is not checked."""
    for name, kept in arrays.items():
        for array in (kept.data, kept.indices, kept.indptr) if hasattr(kept, "indptr") else (kept,):
            array.flags.writeable = False
        object.__setattr__(one, name, kept)


def instance(name: str, value: Any, *kinds: type, hint: str) -> None:
    """Raise InputError unless ``value`` is of one of the kinds."""
    if not isinstance(value, kinds):
        raise InputError(f"{name} is a {type(value).__name__}; {hint}")


def exact(value: str) -> str:
    """The same text as a str and none of its subclasses, such as numpy.str_, whose repr is no literal of Python."""
    return value if type(value) is str else str.__str__(value)


def text(name: str, value: Any) -> str:
    """Return ``value`` as an `exact` str, or raise InputError if it is no text."""
    if not isinstance(value, str):
        raise InputError(f"{name} = {shown(value)} must be text")
    return exact(value)


def utf8(name: str, value: str) -> str:
    """Return a text, or raise InputError where no file can hold it: half of a pair of surrogates."""
    try:
        text(name, value).encode()
    except UnicodeEncodeError:
        raise InputError(f"{name} = {shown(value)} is no text that a file can hold; take letters and digits") from None
    return value


def flag(name: str, value: Any) -> bool:
    """Return ``value`` as a bool, or raise InputError: an array has no truth, and the text "no" is true."""
    if not isinstance(value, bool) and type(value).__name__ not in ("bool", "bool_"):  # the second are NumPy's
        raise InputError(f"{name} = {shown(value)} must be True or False")
    return bool(value)


def instances(name: str, values: Any, *kinds: type) -> tuple[Any, ...]:
    """Return a list as a tuple, or raise InputError unless all that it holds is of these kinds."""
    words = " or ".join(kind.__name__ for kind in kinds)
    try:
        if isinstance(values, str):
            raise TypeError
        items = iter(values)
    except TypeError:
        raise InputError(f"{name} = {shown(values)} must be a list of {words}") from None
    found = []
    for item in items:
        if not isinstance(item, kinds):
            raise InputError(f"{name} holds {shown(item)}, which is no {words}")
        found.append(exact(item) if str in kinds and isinstance(item, str) else item)
    return tuple(found)


def unique(name: str, values: Sequence[Any], *, hint: str = "") -> None:
    """Raise InputError where a value stands twice in a list."""
    for value, count in Counter(values).items():
        if count > 1:
            raise InputError(f"{name} holds {shown(value)} twice; give each once", hint)


def mapping(name: str, value: Any, *, hint: str = "") -> dict[str, Any]:
    """Return a mapping from text as a dict, empty for None, or raise InputError."""
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise InputError(f"{name} is a {type(value).__name__}; a mapping is needed", hint)
    if not all(isinstance(key, str) for key in value):
        raise InputError(f"{name} = {shown(value)} holds a key that is no name", hint)
    return {exact(key): item for key, item in value.items()}


def path(name: str, value: Any) -> Path:
    """Return ``value`` as a Path, or raise InputError if it is not the name of a file or folder."""
    try:
        found = Path(value)
    except TypeError:
        raise InputError(f"{name} = {shown(value)} is no name of a file; give a text or a pathlib.Path") from None
    try:
        if b"\0" in os.fsencode(found):
            raise InputError(f"{name} = {shown(value)} is no name of a file; it holds a NUL character")
    except UnicodeEncodeError:
        raise InputError(f"{name} = {shown(value)} is no name of a file; it holds half of a Unicode pair") from None
    return found


def progress(value: Any, name: str = "progress", given: str = "the time in s") -> None:
    """Raise InputError unless ``value`` is a function or None."""
    if value is not None and not callable(value):
        raise InputError(f"{name} = {shown(value)} must be a function; it is called with {given}")


def executor(value: Any) -> None:
    """Raise InputError unless ``value`` runs functions elsewhere, or is None."""
    if value is not None:
        has("executor", value, "submit", hint="a concurrent.futures.Executor is needed")


def whole(value: Any) -> bool:
    """Whether it is an int of Python or NumPy; NumPy's time steps, a kind of its integers, are none."""
    import numpy as np

    return isinstance(value, int | np.integer) and not isinstance(value, np.timedelta64)


def integer(name: str, value: Any, low: int, high: float, *, hint: str = "") -> int:
    """Return ``value`` as an int, or raise InputError unless it is a whole number in [low, high]; 3.0 is none."""
    if not whole(value) or isinstance(value, bool) or not low <= value <= high:
        end = "" if high == math.inf else f" to {high:,}"
        raise InputError(f"{name} = {shown(value)} must be a whole number from {low}{end}", hint)
    return int(value)


def seed(value: Any) -> int:
    """Return a seed of random numbers, or raise InputError."""
    return integer("seed", value, 0, math.inf)


def choice(name: str, value: Any, choices: Iterable[str], *, default: str | None = None, hint: str = "") -> str:
    """Return ``value``, ``default`` for None, or raise InputError naming the nearest of ``choices``."""
    known, value = sorted(choices), default if value is None else value
    if isinstance(value, str) and value in known:
        return exact(value)
    import difflib

    near = difflib.get_close_matches(shown(value).strip("'"), known, n=1, cutoff=0.5)
    guess = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}"
    raise InputError(f"{name} = {shown(value)} is unknown; {guess}", hint)


def _rule(rule: str, unit: str) -> str:
    return rule + (f" (in {unit})" if unit else "")
