"""Tables of numbers as instruments, simulators and people write them: columns with names and units.

The table is the longest run of lines whose cells are numbers in the same columns, two at least. Columns may be divided
by tabs, semicolons, commas or spaces, and stand beside columns of text; settings above the header, a row of units below
it and remarks after the last row are passed by. A comma is a decimal mark where tabs, semicolons or spaces divide.
Units stand in headers as people write them: "(us)", "_mK", "deg C", "microseconds".
"""

import csv
import io
import math
import re
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..checks import InputError, prefixed, shown
from .quantity import registry

DIVIDERS = ("\t", ";", ",", " ")
FEWEST = 3  # consecutive lines of numbers that begin the table: settings seldom stand in three such lines
LOOKED, MOSTLY = 60, 0.8  # rows that tell which columns are numbers: those with numbers in this share of them
MARKS = "%#!/\"' "  # that begin a remark or a header in some program
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?|[+-]?nan|[+-]?inf", re.ASCII | re.IGNORECASE)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+", re.ASCII)  # 1,234: or a decimal comma before three digits

SPELLED = {  # in lower case; spelled out, pint knows them
    "c": "degC", "deg c": "degC", "deg. c": "degC", "degc": "degC", "celsius": "degC", "degrees c": "degC",
    "degrees celsius": "degC", "f": "degF", "deg f": "degF", "degf": "degF", "fahrenheit": "degF",
    "c/w": "K/W", "degc/w": "K/W", "deg c/w": "K/W", "k/w": "K/W",
    **{unit.lower(): unit for unit in ("s", "ms", "us", "ns", "ps", "K", "V", "mV", "uV", "ohm", "kohm")},
}  # fmt: skip
_SPELLED_OUT = re.compile(
    r"(?:milli|micro|nano|pico)?(?:volt|second|kelvin|watt|ohm|minute|hour|count)s?|[mun]?secs?|hrs?"
)
_SYMBOL = r"(?:[fpnumckMG]?(?:s|K|W|V|A|Hz|rad|m|ohm|g|J)|deg[CF]?|min|h|hour|count|percent|%)"
_UNIT = re.compile(  # a number that may be left out, and a product of symbols
    rf"(?:((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*)?({_SYMBOL}(?:\s*[*/]\s*{_SYMBOL}){{0,3}}|{_SPELLED_OUT.pattern})",
    re.ASCII,
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
    """Scale of a unit as headers write it, also with a factor ("0.12 K"); None where it is no unit."""
    bare = (
        text.strip().strip("()[]").replace("°", "deg").replace("µ", "u").replace("μ", "u").replace("Ω", "ohm").strip()
    )
    word = bare.lower()
    match = _UNIT.fullmatch(word if _SPELLED_OUT.fullmatch(word) else SPELLED.get(word, bare))
    if match is None:
        return None
    size = float(match[1] or 1)
    unit = SPELLED.get(match[2].lower(), match[2])
    zero = registry().Quantity(0.0, registry().parse_units(unit)).to_base_units()
    one = registry().Quantity(1.0, registry().parse_units(unit)).to_base_units()
    low = float(zero.magnitude)
    high = float(one.magnitude)
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


@dataclass(frozen=True, eq=False)
class Column:
    """One column of numbers.

    number: in the file, from 1.
    name, unit: "" where the file states none.
    values [shape (rows,)]
    """

    number: int
    name: str
    unit: str
    values: Array

    @property
    def label(self) -> str:
        """The column as messages name it."""
        return f"column {self.name!r}" if self.name else f"column {self.number}"

    def check_name(self, hint: str) -> None:
        """Raise InputError where the name leaves the scale open: a factor, another unit or an unknown bracket."""
        name, unit = self.name, self.unit
        bracketed = [found for found in BRACKETS.findall(name) if scale_of(found) is not None] if unit else []
        beside = BRACKETS.sub(" ", name) if bracketed else _ENDING.sub(" ", name) if unit else name
        rest = re.sub(r"[(\[{<]" + re.escape(bracketed[0]) + r"[)\]}>]", " ", name) if bracketed else name
        factor = _FACTOR.search(rest)
        words = re.split(r"[^A-Za-zµμ°]+", re.sub(r"\d\s*[A-Za-zµμ°]+", " ", beside))  # "mean of 5 ms" is a remark
        other = (w for w in words if _WORDS.fullmatch(w) or (not unit and w in ("C", "F", "min", "h", "hr", "hours")))
        said = factor[0] if factor else next(other, "")
        if said := said or ("" if unit else next(iter(BRACKETS.findall(name)), "")):
            raise InputError(f"{self.label} says {shown(said)}, which leaves its unit open", hint)


@dataclass(frozen=True, eq=False)
class NumberTable:
    """Columns of numbers, and the text around them.

    above: the lines above the table and the cells beside its first rows, which may name units.
    line: of the first row, from 1; after: how many lines of text follow the last row.
    """

    columns: tuple[Column, ...]
    above: tuple[str, ...]
    line: int
    after: int


def number_table(content: bytes) -> NumberTable:
    """Find the table in a file.

    Raises InputError: no rows of two numbers, a row that breaks off, commas that may divide thousands.

    >>> [column.name for column in number_table(b"% Time (us)   T (K)\\n0   293.15\\n1   294.5\\n2   295").columns]
    ['Time (us)', 'T (K)']
    """
    lines = text_of(content).split("\n")
    begin, divider = _begin(lines)
    head, first = lines[:begin], begin + 1
    rows = [cells_of(line, divider) for line in lines[begin : begin + LOOKED]]
    width = len(rows[0])
    counts = [sum(len(row) == width and is_number(row[k], divider) for row in rows) for k in range(width)]
    places = [k for k in range(width) if counts[k] >= MOSTLY * max(counts)]
    if len(places) < 2:
        raise InputError(f"the rows from line {first} on have no two columns of numbers in common")
    stop, after = _stop(lines, divider, places)
    values = _values(lines[begin:stop], divider, places, first)
    above = [", ".join(cell for k, cell in enumerate(row) if k not in places and cell) for row in rows]
    counted = [cells_of(line, divider) for line in head[:2]]
    lower = [[cell.lower() for cell in cells] for cells in counted]
    if len(counted) == 2 and {"start", "increment"} <= set(lower[0]) and "sequence" in lower[1]:
        # the first column counts the samples (Rigol): "X,CH1,Start,Increment," above "Sequence,Volt,-3.0e-06,1.0e-08"
        with prefixed("line 2 has no numbers below Start and Increment", ValueError, IndexError):
            at = float(counted[1][lower[0].index("start")].replace(",", "."))
            step = float(counted[1][lower[0].index("increment")].replace(",", "."))
        values = np.column_stack([at + step * values[:, 0], values[:, 1:]])
        names = counted[0]
        units = ["s", *counted[1][1:]]
        above = []
    else:
        names, units, head = _header(head, divider, width, places)
        above = [*head, *filter(None, above)]
    columns = (Column(k + 1, names[k], units[k], values[:, n]) for n, k in enumerate(places))
    return NumberTable(tuple(columns), tuple(above), first, after)


def has_rows(content: bytes) -> bool:
    """Whether the beginning of a file has a line of two numbers, as every table has."""
    ways = ((line, divider) for line in text_of(content).split("\n") for divider in DIVIDERS)
    return any(sum(is_number(cell, divider) for cell in cells_of(line, divider)) > 1 for line, divider in ways)


def text_of(content: bytes) -> str:
    """The text of a file in UTF-8, UTF-16 with its mark, or Windows' western code page, lines ended by a line feed."""
    marked = content[:2] in (b"\xff\xfe", b"\xfe\xff")
    try:
        text = content.decode("utf-16" if marked else "utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def cells_of(line: str, divider: str) -> list[str]:
    """Cells of a line, unquoted."""
    if divider == " ":
        return line.split()
    if '"' in line:
        return [
            cell.strip() for cell in next(csv.reader([line[:131_072]], delimiter=divider, skipinitialspace=True), [])
        ]
    return [cell.strip() for cell in line.split(divider)]


def is_number(cell: str, divider: str = " ") -> bool:
    """Whether a cell is a number; a decimal comma is allowed unless commas divide the columns."""
    return bool(_NUMBER.fullmatch(cell if divider == "," else cell.replace(",", ".")))


def _begin(lines: list[str]) -> tuple[int, str]:
    """Index of the first line of the table, and the character that divides its columns."""
    runs: dict[str, list[tuple[int, int, set[int]]]] = {divider: [] for divider in DIVIDERS}
    for number, line in enumerate(lines):
        for divider, run in runs.items():
            cells = cells_of(line, divider) if line.strip(MARKS) == line.strip("\"' ") else []
            here = {k for k, cell in enumerate(cells) if is_number(cell, divider)}
            if not cells and run and not line.strip(MARKS + ",;\t"):
                continue  # an empty line
            if len(here) < 2:
                run.clear()
                continue
            while run and (run[-1][1] != len(cells) or len(here.intersection(*(row[2] for row in run))) < 2):
                run.pop(0)
            run.append((number, len(cells), here))
            if len(run) == FEWEST:
                return run[0][0], divider
    raise InputError(f"no {FEWEST} lines of at least two numbers; a table of time and temperature is needed")


def _stop(lines: list[str], divider: str, columns: list[int]) -> tuple[int, int]:
    """Index of the line after the last row, and the number of lines of text that follow it."""
    after = 0
    for stop in range(len(lines), 0, -1):
        line = lines[stop - 1]
        if line.strip("\t ,;"):
            if _is_row(cells_of(line, divider), divider, columns) or _looks_broken(line):
                break  # of a row that breaks off, which `_values` names
            after += 1
    return stop, after


def _values(lines: list[str], divider: str, columns: list[int], first: int) -> Array:
    """The numbers of the rows, shape (rows, columns); ``first`` is the number of the first line, for messages."""
    import pandas as pd  # type: ignore[import-untyped]

    text = "\n".join(lines)
    sample = text[:4000].lower()
    if divider != "," and "," in text:
        rows = (cells_of(line, divider) for line in lines)
        decimal = (k < len(row) and "," in row[k] and not _THOUSANDS.fullmatch(row[k]) for row in rows for k in columns)
        if "." in text or not any(decimal):
            rule = "the commas of its numbers may divide thousands, 1,234 as 1234"
            raise InputError(rule, "write a decimal point and no other mark")
    if re.search(r"\d[.]?d[+-]?\d", sample):  # exponents of Fortran
        text = re.sub(r"(?<=[\d.])[dD](?=[+-]?\d)", "e", text)
    options = {
        "sep": r"\s+" if divider == " " else divider,
        "decimal": "," if divider != "," and "," in sample else ".",
    }
    if divider == " " or re.search(r"^\s*[%#]", sample, re.MULTILINE):
        options["comment"] = "%" if "%" in sample else "#"
    try:
        frame = pd.read_csv(
            io.BytesIO(text.encode()), header=None, usecols=columns, dtype=dict.fromkeys(columns, float),
            skipinitialspace=True, na_values=["--"], **options,
        )  # fmt: skip
        values = frame.to_numpy()
        empty = np.isnan(values).all(axis=1)
        return values[~empty] if empty.any() else values
    except (ValueError, KeyError, pd.errors.ParserError):
        pass
    for number, line in enumerate(lines, first):
        cells = cells_of(line, divider)
        wrong = not _is_row(cells, divider, columns) or (number == first and not cells)
        if wrong and line.strip(MARKS + ",;\t"):
            break
    raise InputError(f"line {number} = {line.strip()[:40]!r} is no row of {len(columns)} numbers")


def _is_row(cells: list[str], divider: str, columns: list[int]) -> bool:
    """Whether the cells of these columns are there, each a number or empty."""
    return len(cells) > columns[-1] and all(is_number(cells[k], divider) or not cells[k] for k in columns)


def _looks_broken(line: str) -> bool:
    """Whether a line begins with a number, like a row, although it lacks numbers in some columns."""
    words = [word for word in re.split(r"[\s;,|\"]+", line) if word]
    return bool(words) and is_number(words[0])


def _header(head: list[str], divider: str, width: int, columns: list[int]) -> tuple[list[str], list[str], list[str]]:
    """Names and units of all columns, and the other lines above the table.

    Raises InputError: a line below the names begins with a number, like a damaged row.
    """
    names = [""] * width
    units = [""] * width
    for number in range(len(head), 0, -1):
        line = head[number - 1]
        cells = _titles(line.strip().lstrip(MARKS) if divider == " " else line.lstrip(MARKS), divider, width, columns)
        if not cells:
            own = cells_of(line, divider)
            held = [own[k] for k in columns if k < len(own) and is_number(own[k], divider)]
            if any(units) and held and not is_number(own[0], divider) and len(own) == width:
                names, head = own, [*head[: number - 1], *head[number:]]  # "x-axis,1" above "second,Volt"
                break
            if _looks_broken(line) or (held and len(own) > columns[-1]):
                raise InputError(f"line {number} = {line.strip()[:40]!r} is no row of {len(columns)} numbers")
            continue
        if all(is_unit(cell) for cell in cells if cell) and not any(units):
            units = [cell.strip("()[] ") for cell in cells]
            continue
        names, head = cells, [*head[: number - 1], *head[number:]]
        break
    for k, (name, below) in enumerate(zip(names, units, strict=True)):
        stated = unit_in(name)
        if stated and below and is_unit(stated) and scale_of(stated) != scale_of(below):
            raise InputError(f"{name!r} has the unit {below} in the row below", "take the wrong one out")
        units[k] = stated or below
    return names, units, head


def _titles(line: str, divider: str, width: int, columns: list[int]) -> list[str]:
    """Cells of a line that names the columns, one for each column; an empty list for any other line."""
    ways = [cells_of(line, divider)] if divider != " " else []
    if divider == " " or len(ways[0]) == 1:
        ways += [re.split(r"\s{2,}|\t", line), re.split(r"(?<=[)\]])\s+", line), *(cells_of(line, d) for d in ",;\t")]
        ways += [line.split()]
    for cells in ways:
        cells = [cell.strip() for cell in cells]
        if columns[-1] < len(cells) < width:
            cells += [""] * (width - len(cells))
        words = [cells[k] for k in columns] if len(cells) == width else []
        if sum(bool(word) for word in words) * 2 >= len(columns) and not any(is_number(w, divider) for w in words):
            return cells
    return []


def units_above(lines: tuple[str, ...]) -> list[tuple[str, str, bool]]:
    """Units named in lines above a table: each unit, its line, and whether the line is about units.

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
