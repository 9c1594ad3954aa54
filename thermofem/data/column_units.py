"""Units in the headers of tables, as people and instruments write them: "(us)", "_mK", "deg C", "microseconds"."""

import math
import re
from functools import lru_cache
from typing import NamedTuple

from ..checks import InputError, shown
from .quantity import registry

SPELLED = {
    "volt": "V", "volts": "V", "second": "s", "seconds": "s", "sec": "s", "secs": "s", "kelvin": "K", "kelvins": "K",
    "millivolt": "mV", "millivolts": "mV", "microvolts": "uV", "microsecond": "us", "microseconds": "us", "usec": "us",
    "nanosecond": "ns", "nanoseconds": "ns", "nsec": "ns", "millisecond": "ms", "milliseconds": "ms", "msec": "ms",
    "picoseconds": "ps", "minutes": "min", "minute": "min", "hours": "h", "hour": "h", "hrs": "h", "hr": "h",
    "c": "degC", "deg c": "degC", "deg. c": "degC", "degc": "degC", "celsius": "degC", "degrees c": "degC",
    "degrees celsius": "degC", "f": "degF", "deg f": "degF", "degf": "degF", "fahrenheit": "degF", "watt": "W",
    "watts": "W", "ohms": "ohm", "c/w": "K/W", "degc/w": "K/W", "deg c/w": "K/W", "k/w": "K/W", "counts": "count",
    "ohm": "ohm", "kohm": "kohm", "s": "s", "ms": "ms", "us": "us", "ns": "ns", "ps": "ps", "k": "K", "v": "V",
    "mv": "mV", "uv": "uV",
}  # fmt: skip
_SYMBOL = r"(?:[fpnumckMG]?(?:s|K|W|V|A|Hz|rad|m|ohm|g|J)|deg[CF]?|min|h|hour|count|percent|%)"
_UNIT = re.compile(  # a number that may be left out, and a product of symbols
    rf"(?:((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*)?({_SYMBOL}(?:\s*[*/]\s*{_SYMBOL}){{0,3}})", re.ASCII
)
BRACKETS = re.compile(r"\s*[(\[{<]([^()\[\]{}<>]*)[)\]}>]")
_ENDING = re.compile(  # T_mK, T/mK, T in mK and T mK, but for "type K" and T_per_V
    r"(?<!per)(?:[_/]|,|\bin\b|\s(?=\S{2}))\s*(s|[munpµμ]s|K|[mu]K|degC|°C|V|[muµμ]V|W|[munµμ]W)\s*$"
)
_WORDS = re.compile(  # that look like a unit which is not SI
    r"t?(?:[munpµμ]s(?:ecs?)?|[munkµμ](?:[kvw]|volts?|watts?)|deg[cf]|°[cf]|celsius|fahrenheit|[pnuµμ]m|[kmg]hz|dbm?"
    r"|counts?|(?:milli|mi[ck]ro|nano|pico)(?:s|secs?|seconds?|sekunden?|kelvin|volts?|watts?))",
    re.IGNORECASE,
)
_FACTOR = re.compile(r"\b10\s*(?:\^|\*\*)\s*[-+]?\d+|[x×*·]\s*\d[\d.eE+-]*|\b[eE][-+]\d+\b")
VOLTS = "1 V counts as 1 K"
NO_UNITS = ("", "t", "T", "a", "A", "h", "x", "X", "P", "y", "R", "m")  # names of columns rather than units


class Scale(NamedTuple):
    """SI value = offset + factor * number; dimensions as pint writes those of the SI unit."""

    dimensions: str
    offset: float
    factor: float


TIME, TEMPERATURE, VOLTAGE = "second", "kelvin", "kilogram * meter ** 2 / ampere / second ** 3"
POWER, IMPEDANCE = "kilogram * meter ** 2 / second ** 3", "kelvin * second ** 3 / kilogram / meter ** 2"


@lru_cache(maxsize=256)
def scale_of(text: str) -> Scale | None:
    """The scale of a unit as a header writes it, a number before it included ("0.12 K"); None where it is no unit."""
    bare = (
        text.strip().strip("()[]").replace("°", "deg").replace("µ", "u").replace("μ", "u").replace("Ω", "ohm").strip()
    )
    match = _UNIT.fullmatch(SPELLED.get(bare.lower(), bare))
    if match is None:
        return None
    size, unit = float(match[1] or 1), SPELLED.get(match[2].lower(), match[2])
    zero, one = (registry().Quantity(k, registry().parse_units(unit)).to_base_units() for k in (0.0, 1.0))
    low, high = float(zero.magnitude), float(one.magnitude)
    factor = float(f"{size * (high - low):.15g}")
    return Scale(str(zero.units), low, factor) if math.isfinite(factor) else None


def is_unit(cell: str) -> bool:
    """Whether a cell is a bare unit such as "(us)", "mV" or "Volt"."""
    return cell.strip("()[] ") not in NO_UNITS and len(cell) <= 30 and scale_of(cell) is not None


def unit_in(name: str) -> str:
    """The unit in the name of a column, in brackets or at its end; else ""."""
    for found in BRACKETS.findall(name):
        if scale_of(found) is not None:
            return str(found).strip()
    match = _ENDING.search(name)
    compound = match and _ENDING.search(f"_{name[: match.start()].split(' ')[-1]}")  # mV/K
    return match[1].strip() if match and not compound else ""


def check_name(label: str, name: str, unit: str, hint: str) -> None:
    """InputError where the name of a column says more on its scale than its unit: a factor, another unit, a bracket."""
    bracketed = [found for found in BRACKETS.findall(name) if scale_of(found) is not None] if unit else []
    beside = BRACKETS.sub(" ", name) if bracketed else _ENDING.sub(" ", name) if unit else name
    factor = _FACTOR.search(re.sub(r"[(\[{<]" + re.escape(bracketed[0]) + r"[)\]}>]", " ", name) if bracketed else name)
    words = re.split(r"[^A-Za-zµμ°]+", re.sub(r"\d\s*[A-Za-zµμ°]+", " ", beside))  # "mean of 5 ms" is a remark
    other = (w for w in words if _WORDS.fullmatch(w) or (not unit and w in ("C", "F", "min", "h", "hr", "hours")))
    word = factor[0] if factor else next(other, "")
    brackets = "" if unit else next(iter(BRACKETS.findall(name)), "")
    if said := word or brackets:
        raise InputError(f"{label} says {shown(said)}, which leaves its unit open", hint)


def units_above(lines: tuple[str, ...]) -> list[tuple[str, str, bool]]:
    """Units that lines above a table name: the unit, the line, and whether the line says that it is about units.

    >>> units_above(("Time unit: ms", "Averages,1", "Trigger delay 10 us", "Coupling,DC"))
    [('ms', 'Time unit: ms', True)]
    """
    found = []
    for line in lines:
        about = bool(re.search(r"(?i)\bunits?\b|\bin\b", line))
        words = [word for word in re.split(r"[\s,;:=|()\[\]\"]+", line) if word]
        for before, word in zip(["", *words], words, strict=False):
            known = about or (len(word) > 1 and _WORDS.fullmatch(word))
            known = known and word not in ("in", "h", "g", "a", "A", "m", "J") and not re.match(r"[\d.%]", word)
            if known and not re.match(r"[+-]?[\d.]", before) and scale_of(word) is not None:
                found.append((word, line.strip(), about))
    return found


def unit_of(assumed: object) -> str:
    """The unit of a trace's temperatures: "V" where the words on its assumptions say that volts count as kelvin."""
    return "V" if VOLTS in str(assumed) else "K"
