"""Units as text: a small grammar that bounds what is computed, and the everyday units without a library.

    unit    = factor {("*" | "/" | " ") factor}          at most `FACTORS`, in at most `DEPTH` brackets
    factor  = ("1" | name | "(" unit ")") [("^" | "**") integer]        |integer| <= `POWER`

A name is a symbol of `SYMBOLS` with a prefix of `PREFIXES`, read here, or any other name, which pint reads. Nothing
reaches pint that the grammar does not hold: pint computes powers of numbers, of any size.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from functools import cache, lru_cache
from typing import Any, NamedTuple

from .. import constants

LONGEST = 80  # characters of a unit
FACTORS, DEPTH, POWER, NAME = 12, 3, 9, 30
LETTERS = 4  # of a name whose unit is guessed by likeness
PREFIXES = {
    "f": -15, "p": -12, "n": -9, "u": -6, "µ": -6, "μ": -6, "m": -3, "c": -2, "": 0, "k": 3, "M": 6, "G": 9, "T": 12,
}  # fmt: skip
# symbol: power of ten, further factor, dimensions over m, kg, s, K, rad, A
SYMBOLS: dict[str, tuple[int, float, dict[str, int]]] = {
    "m": (0, 1.0, {"m": 1}),
    "s": (0, 1.0, {"s": 1}),
    "g": (-3, 1.0, {"kg": 1}),
    "K": (0, 1.0, {"K": 1}),
    "W": (0, 1.0, {"kg": 1, "m": 2, "s": -3}),
    "J": (0, 1.0, {"kg": 1, "m": 2, "s": -2}),
    "Hz": (0, 1.0, {"s": -1}),
    "eV": (0, constants.e, {"kg": 1, "m": 2, "s": -2}),
    "V": (0, 1.0, {"kg": 1, "m": 2, "s": -3, "A": -1}),
    "rad": (0, 1.0, {"rad": 1}),
    "deg": (0, math.pi / 180, {"rad": 1}),
}
_TOKEN = re.compile(r"\s*(\*\*|[*/^()]|[+-]?[0-9]+|%|[^\W\d_]+(?:_[^\W\d_]+)*|°[CF])")
_SUPERSCRIPTS = str.maketrans({"²": "^2", "³": "^3", "⁻": "^-", "¹": "1", "·": "*", "⋅": "*"})


class UnitError(ValueError):
    """Text that is no unit by the grammar of this module."""


class Scale(NamedTuple):
    """A product of everyday units: 10^exponent x factor of the SI unit with these dimensions."""

    exponent: int
    factor: float
    dimensions: tuple[tuple[str, int], ...]


@lru_cache(maxsize=1024)
def names_of(text: str) -> tuple[tuple[str, int], ...]:
    """The names in a unit, each with its power, in the order of the text.

    Raises UnitError: the text is not of the grammar.

    >>> names_of("W/(m K)")
    (('W', 1), ('m', -1), ('K', -1))
    """
    if len(text) > LONGEST:
        raise UnitError(f"a unit has at most {LONGEST} characters")
    tokens = _tokens(plain(text))
    found, rest = _product(tokens, DEPTH) if tokens else ((), ())
    if rest:
        raise UnitError(f"{rest[0]!r} is out of place")
    if len(found) > FACTORS:
        raise UnitError(f"a unit has at most {FACTORS} factors")
    if any(abs(power) > POWER for _, power in found):
        raise UnitError(f"a power is at most {POWER}")
    return found


def plain(text: str) -> str:
    """The unit with powers and products as ASCII writes them."""
    return text.translate(_SUPERSCRIPTS).strip()


@lru_cache(maxsize=1024)
def scale(text: str) -> Scale | None:
    """The scale of a unit whose every name is an everyday one; None where pint is needed.

    >>> scale("cm/GW")
    Scale(exponent=-11, factor=1.0, dimensions=(('kg', -1), ('m', -1), ('s', 3)))
    """
    exponent, factor = 0, 1.0
    dimensions: dict[str, int] = {}
    for name, power in names_of(text):
        symbol = _symbol(name)
        if symbol is None:
            return None
        ten, other, dims = symbol
        exponent += power * ten
        factor *= other**power
        for key, value in dims.items():
            dimensions[key] = dimensions.get(key, 0) + power * value
    return Scale(exponent, factor, tuple(sorted((k, v) for k, v in dimensions.items() if v)))


def nearest(name: str, wanted: Iterable[str]) -> str | None:
    """The unit that an unknown name was meant to be: another case ("mw"), swapped letters ("mn"), or one alike."""
    known = list(dict.fromkeys(wanted))
    for key in (str.casefold, lambda text: "".join(sorted(text.casefold()))):
        for unit in known:
            if key(unit) == key(name):
                return unit
    if len(name) < LETTERS:  # of three letters each unit is as near as the next
        return None
    import difflib

    return next(iter(difflib.get_close_matches(name, known, n=1, cutoff=0.5)), None)


def _symbol(name: str) -> tuple[int, float, dict[str, int]] | None:
    """Power of ten, further factor and dimensions of one everyday name."""
    if name in SYMBOLS:
        return SYMBOLS[name]
    ten, symbol = PREFIXES.get(name[:1]), name[1:]
    if ten is None or symbol not in SYMBOLS or symbol in ("deg", "rad"):
        return None
    shift, factor, dims = SYMBOLS[symbol]
    return ten + shift, factor, dims


def _tokens(text: str) -> tuple[str, ...]:
    found, at = [], 0
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            raise UnitError(f"{text[at:].strip()[:10]!r} is out of place")
        found.append(match[1])
        at = match.end()
    return tuple(found)


def _product(tokens: tuple[str, ...], depth: int) -> tuple[tuple[tuple[str, int], ...], tuple[str, ...]]:
    """Factors up to the end or a closing bracket, and the tokens that are left."""
    found: list[tuple[str, int]] = []
    sign, rest = 1, tokens
    while True:
        names, rest = _factor(rest, depth)
        found += [(name, sign * power) for name, power in names]
        if not rest or rest[0] == ")":
            return tuple(found), rest
        sign = -1 if rest[0] == "/" else 1
        rest = rest[1:] if rest[0] in "*/" else rest


def _factor(tokens: tuple[str, ...], depth: int) -> tuple[list[tuple[str, int]], tuple[str, ...]]:
    """One factor with its power."""
    if not tokens:
        raise UnitError("a unit ends with a name")
    head, rest = tokens[0], tokens[1:]
    if head == "(" and depth:
        names, rest = _product(rest, depth - 1)
        if not rest:
            raise UnitError("a bracket is not closed")
        rest = rest[1:]
    elif head == "1":
        names = ()
    elif (head[0].isalpha() or head[0] in "°%") and len(head) <= NAME:
        names = ((head, 1),)
    else:
        raise UnitError(f"{head[:10]!r} is out of place")
    if rest and rest[0] in ("^", "**"):
        if len(rest) < 2 or not re.fullmatch(r"[+-]?[0-9]", rest[1]):
            raise UnitError(f"a power is a whole number up to {POWER}")
        return [(name, power * int(rest[1])) for name, power in names], rest[2:]
    return list(names), rest


def foreign(value: Any) -> str:
    """The unit of a value of pint, or that one of xarray states, where it is not SI; else ""."""
    if not (hasattr(value, "magnitude") or hasattr(value, "attrs")):
        return ""
    held: tuple[Any, Any] = (value, getattr(value, "data", None))
    for each in held:
        if hasattr(each, "magnitude"):
            return str(each.units)
    stated = getattr(value, "attrs", None)
    unit = stated.get("units") if isinstance(stated, Mapping) else None
    return unit if isinstance(unit, str) and not _is_si(unit) else ""


@cache
def _is_si(unit: str) -> bool:
    """Whether a unit has the factor 1, so that numbers in it are in SI; words that are no unit count as one."""
    if unit in ("", "1", "s", "K", "W", "K/W", "m", "Hz", "J"):
        return True
    try:
        names_of(unit)
        return abs(float(registry().Quantity(1, registry().parse_units(unit)).to_base_units().magnitude) - 1) < 1e-9
    except Exception:  # no unit of the grammar; and pint's parser raises whatever its tokeniser meets
        return True


@cache
def registry() -> Any:
    """The units that pint knows."""
    import pint

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True, cache_folder=None)
