"""Units in the headers of tables, as people and instruments write them."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ..checks import InputError
from . import quantity

SPELLED = {
    "volt": "V", "volts": "V", "second": "s", "seconds": "s", "sec": "s", "kelvin": "K", "millivolt": "mV",
    "microsecond": "us", "microseconds": "us", "nanosecond": "ns", "nanoseconds": "ns", "millisecond": "ms",
    "celsius": "degC", "watt": "W", "watts": "W",
}  # fmt: skip
IN_BRACKETS = re.compile(r"\s*[(\[{<]([^()\[\]{}<>]*)[)\]}>]")
SECONDS = re.compile(r"[(\[]?\s*(?:[munpµμ]?s|secs?|(?:milli|micro|nano)?seconds?)\s*[)\]]?", re.IGNORECASE)
_ENDING = re.compile(  # T_mK, T/mK, T in mK and T mK, but for "type K" and T_per_V
    r"(?<!per)(?:[_/]|,|\bin\b|\s(?=\S{2}))\s*(s|[munpµμ]s|K|[mu]K|degC|°C|V|[muµμ]V|W|[munµμ]W)\s*$"
)
_SCALED = re.compile(  # words that look like units which are not SI, in any case, also after a "T" or "t"
    r"t?(?:[munpµμ]s(?:ecs?)?|[munkµμ](?:[kvw]|volts?|watts?)|deg[cf]|°[cf]|celsius|fahrenheit|[mu]sek"
    r"|(?:milli|mi[ck]ro|nano|pico)(?:s|secs?|seconds?|sekunden?|kelvin|volts?|watts?))",
    re.IGNORECASE,
)
_NO_TEMPERATURE = re.compile(r"[pnuµμ]m|[kmg]hz|dbm?|counts?", re.IGNORECASE)  # of other quantities
VOLTS = "1 V counts as 1 K"
OF_TIMES, OF_TEMPERATURES = ("min", "h", "hr", "hrs", "hours", "minutes"), ("C", "F")
_FACTOR = re.compile(r"\b10\s*(?:\^|\*\*)\s*[-+]?\d+|[x×*·]\s*\d[\d.eE+-]*|\b[eE][-+]\d+\b")


def stated_unit(name: str) -> str:
    """The unit in the name of a column, in brackets or at its end; else ""."""
    if match := IN_BRACKETS.search(name):
        return match[1].strip()
    match = _ENDING.search(name)
    compound = match and _ENDING.search(f"_{name[: match.start()].split(' ')[-1]}")  # mV/K
    return match[1].strip() if match and not compound else ""


def hidden_unit(name: str) -> str:
    """A word of a name without unit that looks like one which is not SI, such as mK in "T_mK_avg"; else ""."""
    return next(filter(_SCALED.fullmatch, _words(name)), "")


def check_scale(name: str, unit: str, words: Sequence[str] = (), option: str = "") -> None:
    """InputError where a header says more on the scale of its column than the ``unit`` that is read from it.

    That is a factor, or another unit. ``words`` count as units, too, where the name has none.
    """
    beside = name
    if unit:
        match = IN_BRACKETS.search(name) or _ENDING.search(name)
        beside = f"{name[: match.start()]} {name[match.end() :]}" if match else name
    factor = _FACTOR.search(beside)
    if unit:  # a number before a unit makes a remark of both: "mean of 5 ms (K)"
        other = hidden_unit(re.sub(r"\d\s*[A-Za-zµμ°]+", " ", beside))
    else:
        suspects = (w for w in _words(name) if w in words or _NO_TEMPERATURE.fullmatch(w))
        other = hidden_unit(name) or next(suspects, "")
    said = factor[0] if factor else other
    if said and unit:
        raise InputError(f"column {name!r} states {said!r} beside its unit {unit}; leave one unit in its header")
    if said:
        hint = f"give its unit, such as {option} '{name} (unit)'" if option else "give its unit"
        raise InputError(f"column {name!r} may be in {said} or not; {hint}")


def _words(name: str) -> list[str]:
    return re.split(r"[^A-Za-zµμ°]+", name)


def is_unit(cell: str, of: tuple[str, ...] = ()) -> bool:
    """Whether a cell is a bare unit such as "(us)", "mV" or "Volt"; of one of these dimensions where any is given."""
    bare = cell.strip("()[] ")
    if bare in ("", "t", "T"):  # time and temperature, not tonne and tesla
        return False
    for text in (header_unit(bare), bare.lower()):  # scopes write "Volt"
        for unit in of or ("s",):
            try:
                quantity.parse(f"1 {text}", unit)
            except InputError as error:
                if of or "wrong dimension" not in str(error):
                    continue
            return True
    return False


def are_units(cells: list[str]) -> bool:
    """Whether all cells that hold anything are bare units."""
    return all(is_unit(cell) for cell in cells if cell)


def header_unit(text: str) -> str:
    """A unit as instruments write it in a header, as the unit layer reads it: "Volt" becomes "V"."""
    unit = text.strip().replace("°C", "degC").replace("µ", "u").replace("μ", "u")
    return SPELLED.get(unit.lower(), unit)


def unit_of(assumed: object) -> str:
    """The unit of a trace's temperatures: "V" where the words on its assumptions say that volts count as kelvin."""
    return "V" if VOLTS in str(assumed) else "K"
