"""Tables of numbers as instruments, simulators and people write them: columns with names and units.

The table begins at the first three lines whose cells are numbers in the same columns, two at least; pandas splits and
converts its rows. Columns may be divided by tabs, semicolons, commas or spaces, and stand beside columns of text;
settings above the header and remarks after the last row are passed by. A comma is a decimal mark where tabs, semicolons
or spaces divide. The header is the line above the first row, ``name (unit)`` or ``name [unit]`` for each column, or
names above a line of units; any other header leaves the unit of a column open.
"""

import csv
import io
import re
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..checks import InputError, shown
from .column_units import FREQUENCY, IMPEDANCE, LENGTH, POWER, TEMPERATURE, TIME, VOLTAGE, Scale, scale_of

DIVIDERS = ("\t", ";", ",", " ")
FIRST_ROWS = 3  # consecutive lines of numbers that begin the table: settings seldom stand in three such lines
LOOKED, MOSTLY = 60, 0.8  # rows that tell which columns are numbers: those with numbers in this share of them
MARKS = "%#!/\"' "  # that begin a remark or a header in some program
COLUMNS_OF_UNITS = (TIME, TEMPERATURE, VOLTAGE, POWER, IMPEDANCE, LENGTH, FREQUENCY)  # what a line of units may measure
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?|[+-]?nan|[+-]?inf", re.ASCII | re.IGNORECASE)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+", re.ASCII)  # 1,234: or a decimal comma before three digits
_HEADER = re.compile(r"(?P<name>[^()\[\]]*)[(\[](?P<unit>[^()\[\]]+)[)\]]\s*(?:,.*)?")  # COMSOL: a remark after a comma
_FACTOR = re.compile(r"[*^×·]|\d\s*x\b|\bx\s*\d")  # "10^3 T" and "T x 1000": the scale of the column is open


@dataclass(frozen=True, eq=False)
class Column:
    """One column of numbers.

    number: in the file, from 1.
    header: the cell above it, "" where there is none.
    unit: "" where the file states none.
    values [shape (rows,)]: as the file has them.
    """

    number: int
    header: str
    unit: str
    values: Array

    @property
    def name(self) -> str:
        """The header without its unit."""
        match = _HEADER.fullmatch(self.header)
        return match["name"].strip() if match else self.header

    @property
    def label(self) -> str:
        """The column as messages name it."""
        return f"column {self.header!r}" if self.header else f"column {self.number}"

    @property
    def scale(self) -> Scale | None:
        """What the column measures; None where it states no unit."""
        return scale_of(self.unit) if self.unit else None

    def in_si(self, unit: str = "") -> Array:
        """The values in SI, by a ``unit`` that goes before that of the file.

        Raises InputError: no unit, or one that is unknown.
        """
        unit = unit or self.unit
        scale = scale_of(unit)
        if scale is None:
            what = f"is in {shown(unit)}, no known unit" if unit else "states no unit"
            raise InputError(f"{self.label} {what}", 'give the units of both columns, such as --units "us,mV"')
        return scale.in_si(self.values)


@dataclass(frozen=True, eq=False)
class NumberTable:
    """Columns of numbers, and the text around them.

    above: the lines above the table and the cells beside its first rows.
    after: how many lines of text follow the last row.
    """

    columns: tuple[Column, ...]
    above: tuple[str, ...] = ()
    after: int = 0

    @property
    def listed(self) -> str:
        """The columns as messages list them."""
        return ", ".join(f"{column.number} {column.header!r}" for column in self.columns)

    def units_above(self, dimensions: tuple[str, ...]) -> list[tuple[str, str]]:
        """Units of these dimensions in lines above the table, each with its line."""
        units = []
        for line in self.above:
            words = re.split(r"[\s,;:=()\[\]\"]+", line)
            for word in dict.fromkeys(words):
                scale = scale_of(word) if len(word) > 1 or word in "sKV" else None
                if scale and scale.dimensions in dimensions:
                    units.append((word, line.strip()))
        return units


def is_about_units(line: str) -> bool:
    """Whether a line above a table speaks of units: "Time unit: ms", "Time is in ms"."""
    return bool(re.search(r"\b(?:units?|in)\b", line, re.IGNORECASE))


def number_table(content: bytes) -> NumberTable:
    """Find the table in a file.

    Raises InputError: no rows of two numbers, a row that breaks off, commas that may divide thousands.

    >>> table = number_table(b"% Time (us)   T (K)\\n0   293.15\\n1   294.5\\n2   295")
    >>> [(column.name, column.unit) for column in table.columns]
    [('Time', 'us'), ('T', 'K')]
    """
    lines = text_of(content).split("\n")
    begin, divider = _first_row(lines)
    rows = [cells_of(line, divider) for line in lines[begin : begin + LOOKED]]
    places = _number_places(rows, divider)
    if len(places) < 2:
        raise InputError(f"the rows from line {begin + 1} on have no two columns of numbers in common")
    stop = _last_row(lines, divider, places) + 1
    values = _values(lines[begin:stop], divider, places, begin + 1)
    headers, units, above = _header(lines[:begin], divider, len(rows[0]), places)
    columns = [Column(place + 1, headers[place], units[place], values[:, k]) for k, place in enumerate(places)]
    beside = []
    for row in rows:
        texts = (cell for k, cell in enumerate(row) if k not in places)
        beside.append(", ".join(texts))
    after = sum(bool(line.strip("\t ,;")) for line in lines[stop:])
    return NumberTable(tuple(columns), (*above, *beside), after)


def has_rows(content: bytes) -> bool:
    """Whether the beginning of a file has a line of two numbers, as every table has."""
    lines = text_of(content).split("\n")
    return any(len(_numbers(line, divider)) > 1 for line in lines for divider in DIVIDERS)


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
        reader = csv.reader([line[:131_072]], delimiter=divider, skipinitialspace=True)
        return [cell.strip() for cell in next(reader, [])]
    return [cell.strip() for cell in line.split(divider)]


def is_number(cell: str, divider: str = " ") -> bool:
    """Whether a cell is a number; a decimal comma is allowed unless commas divide the columns."""
    return bool(_NUMBER.fullmatch(cell if divider == "," else cell.replace(",", ".")))


def _numbers(line: str, divider: str) -> set[int]:
    """Places of the cells that are numbers; none in a remark."""
    if line.strip(MARKS) != line.strip("\"' "):
        return set()
    return {k for k, cell in enumerate(cells_of(line, divider)) if is_number(cell, divider)}


def _first_row(lines: list[str]) -> tuple[int, str]:
    """Index of the first line of the table, and the character that divides its columns."""
    filled = [number for number, line in enumerate(lines) if line.strip(MARKS + ",;\t")]
    for k in range(len(filled) - FIRST_ROWS + 1):
        rows = [lines[number] for number in filled[k : k + FIRST_ROWS]]
        for divider in DIVIDERS:
            widths = {len(cells_of(row, divider)) for row in rows}
            shared = set.intersection(*(_numbers(row, divider) for row in rows))
            if len(widths) == 1 and len(shared) >= 2:
                return filled[k], divider
    raise InputError(f"no {FIRST_ROWS} lines of at least two numbers; a table of time and temperature is needed")


def _number_places(rows: list[list[str]], divider: str) -> list[int]:
    """Indices of the columns whose cells are numbers in most rows."""
    width = len(rows[0])
    counts = [0] * width
    for row in rows:
        if len(row) == width:
            for place, cell in enumerate(row):
                counts[place] += is_number(cell, divider)
    least = MOSTLY * max(counts)
    return [place for place, count in enumerate(counts) if count >= least]


def _last_row(lines: list[str], divider: str, places: list[int]) -> int:
    """Index of the last line that is a row, or begins with a number like a row that breaks off."""
    for number in range(len(lines) - 1, -1, -1):
        cells = cells_of(lines[number], divider)
        if _is_row(cells, divider, places) or _looks_broken(lines[number]):
            break
    return number


def _is_row(cells: list[str], divider: str, places: list[int]) -> bool:
    """Whether the cells of these columns are there, each a number or empty, and not all empty."""
    if len(cells) <= places[-1]:
        return False
    filled = [cells[place] for place in places if cells[place]]
    return bool(filled) and all(is_number(cell, divider) for cell in filled)


def _looks_broken(line: str) -> bool:
    """Whether a line begins with a number, like a row, although it lacks numbers in some columns."""
    words = re.split(r"[\s;,|\"]+", line.strip('\t ,;"'))
    return is_number(words[0])


def _values(lines: list[str], divider: str, places: list[int], first: int) -> Array:
    """The numbers of the rows, shape (rows, columns); ``first`` is the number of the first line, for messages."""
    import pandas as pd  # type: ignore[import-untyped]

    text = "\n".join(lines)
    commas = divider != "," and "," in text
    if commas and not _are_decimal(text, lines, divider, places):
        rule = "the commas of its numbers may divide thousands, 1,234 as 1234"
        raise InputError(rule, "write a decimal point and no other mark")
    if re.search(r"\d\.?[dD][+-]?\d", text[:4000]):  # exponents of Fortran
        text = re.sub(r"(?<=[\d.])[dD](?=[+-]?\d)", "e", text)
    separator = r"\s+" if divider == " " else divider
    decimal = "," if commas else "."
    try:
        frame = pd.read_csv(
            io.StringIO(text), header=None, usecols=places, dtype=dict.fromkeys(places, float), sep=separator,
            decimal=decimal, skipinitialspace=True,
        )  # fmt: skip
    except (ValueError, KeyError, pd.errors.ParserError):
        raise InputError(_broken_row(lines, divider, places, first)) from None
    return np.asarray(frame.dropna(how="all").to_numpy())


def _are_decimal(text: str, lines: list[str], divider: str, places: list[int]) -> bool:
    """Whether the commas in the numbers of a table are decimal marks for sure."""
    if "." in text:
        return False
    for line in lines:
        row = cells_of(line, divider)
        cells = [row[place] for place in places if place < len(row)]
        if any("," in cell and not _THOUSANDS.fullmatch(cell) for cell in cells):
            return True
    return False


def _broken_row(lines: list[str], divider: str, places: list[int], first: int) -> str:
    """Words on the first line that is no row."""
    wrong = 0
    for number, line in enumerate(lines):
        if line.strip(MARKS + ",;\t") and not _is_row(cells_of(line, divider), divider, places):
            wrong = number
            break
    beginning = lines[wrong].strip()[:40]
    return f"line {first + wrong} = {beginning!r} is no row of {len(places)} numbers"


def _header(above: list[str], divider: str, width: int, places: list[int]) -> tuple[list[str], list[str], list[str]]:
    """Headers and units of all columns, from the last one or two lines above the table, and the lines above these.

    Raises InputError: the line above the table begins with a number, like a damaged row; two units of one column.
    """
    lines = [line for line in above if line.strip(MARKS + ",;\t")]
    if lines and _looks_broken(lines[-1]):
        number = above.index(lines[-1]) + 1
        beginning = lines[-1].strip()[:40]
        raise InputError(f"line {number} = {beginning!r} is no row of numbers")
    headers = _titles(lines[-1:], divider, width, places)
    below = [header.strip("()[] ") for header in headers]
    if not _are_units(below):
        units = [_unit_in(header) for header in headers]
        return headers, units, lines[:-1] if any(headers) else lines
    headers = _titles(lines[-2:-1], divider, width, places)
    for header, unit in zip(headers, below, strict=True):
        stated = _unit_in(header)
        if stated and unit and scale_of(stated) != scale_of(unit):
            raise InputError(f"{header!r} has the unit {unit} in the row below", "take the wrong one out")
    return headers, below, lines[:-2]


def _are_units(cells: list[str]) -> bool:
    """Whether all cells of a line are units, such as "(us)", "mV" or "Volt", and none is a name such as t or T."""
    for cell in filter(None, cells):
        scale = scale_of(cell)
        if scale is None or not (scale.decibels or scale.dimensions in COLUMNS_OF_UNITS):
            return False
    return any(cells)


def _unit_in(header: str) -> str:
    """The unit in a header ``name (unit)``; "" for any other header."""
    match = _HEADER.fullmatch(header)
    if match is None or _FACTOR.search(match["name"]):
        return ""
    unit = match["unit"]
    return "" if scale_of(unit) is None else unit.strip()


def _titles(lines: list[str], divider: str, width: int, places: list[int]) -> list[str]:
    """Cells of a line that names the columns, one for each; empty cells for any other line, and for none.

    A header may be divided in another way than its rows: by the other dividers, by wide spaces, behind brackets.
    """
    line = "".join(lines).lstrip("%#!/' ")
    wide = re.split(r"\s{2,}", line.strip())
    bracketed = re.split(r"(?<=[)\]])\s+", line.strip())
    divided = [cells_of(line, mark) for mark in DIVIDERS]
    for cells in (cells_of(line, divider), wide, bracketed, *divided):
        titles = [cell.strip(" \"'") for cell in cells]
        while len(titles) > width and not titles[-1]:
            titles.pop()
        if not places[-1] < len(titles) <= width:
            continue
        titles += [""] * (width - len(titles))
        names = [titles[place] for place in places]
        if any(names) and not any(is_number(name, divider) for name in names):
            return titles
    return [""] * width
