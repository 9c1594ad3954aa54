"""Tables of numbers as instruments, simulators and people write them: columns with names and units.

The table begins at the first three lines that hold two numbers or more in the same columns; pandas splits and converts
its rows. Columns may be divided by tabs, semicolons, commas or spaces, and stand beside columns of text; lines above
the header and remarks after the last row are passed by. A comma is a decimal mark where tabs, semicolons or spaces
divide. The header is the line above the first row, ``name (unit)`` or ``name [unit]`` for each column; any other header
leaves the unit of a column open.
"""

import csv
import io
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..checks import InputError, between, shown
from .column_units import TIME, Column, Role, name_and_unit, scale_of

DIVIDERS = ("\t", ";", ",", " ")
FIRST_ROWS = 3  # consecutive lines of numbers that begin the table: settings seldom stand in three such lines
MOSTLY = 0.8  # share of the rows that hold a number in a column of numbers
MARKS = "%#!/"  # that begin a remark or a header in some program
BLANK = MARKS + ",;\t \"'"  # a line of nothing else is blank
WORDS = re.compile(r"[^\s;,|:=()\[\]\"]+")
LETTERS = "sKV"  # that a line above the table may give as a unit; "a" is a word there, and a year to pint, "as" 1e-18 s
_BETWEEN_TITLES = re.compile(r"\s{2,}|(?<=[)\]])\s+")  # wide spaces, or one behind a bracket
_FORTRAN = re.compile(r"(?<=[\d.])[dD](?=[+-]?\d)")  # 1.5D-06
# a comma before other than three digits, behind a lone zero or behind four digits divides no thousands
_DECIMAL_COMMA = re.compile(r"\d,(?=\d)(?!\d{3}(?!\d))|(?<!\d)0,|\d{4},")


@dataclass(frozen=True, eq=False)
class NumberTable:
    """Columns of numbers, and the text around them.

    above: the lines above the header.
    after: how many lines of text follow the last row.
    """

    columns: tuple[Column, ...]
    above: tuple[str, ...] = ()
    after: int = 0

    @property
    def listed(self) -> str:
        """The columns as messages list them."""
        return ", ".join(f"{column.number} {column.header!r}" for column in self.columns)

    def pair(self, columns: str | Sequence[int]) -> list[Column]:
        """The two columns of these numbers, "4,5" or (4, 5), counted from 1.

        Raises InputError: others than two, or a number that no column has.
        """
        numbers = columns.split(",") if isinstance(columns, str) else columns
        by_number = {str(column.number): column for column in self.columns}
        texts = [str(number).strip() for number in numbers]
        if len(texts) != 2 or not set(texts) <= set(by_number):
            raise InputError(f"--columns = {shown(columns)} must be two of the columns of numbers: {self.listed}")
        return [by_number[text] for text in texts]

    def beside(self, columns: Mapping[str, Column]) -> list[Column]:
        """The other columns."""
        numbers = {column.number for column in columns.values()}
        return [column for column in self.columns if column.number not in numbers]

    def named(self, role: str, name: str) -> Column:
        """The column with this header, with or without its unit, or another unit; InputError for none or several."""
        short, unit = name_and_unit(name)
        same = [column for column in self.columns if column.header == name]
        same = same or [column for column in self.columns if column.name == short]
        if len(same) != 1:
            numbers = ",".join(str(column.number) for column in same)
            rule = f"names the columns {numbers}" if same else "is none of the columns"
            hint = f"say which by number, --columns, of {self.listed}"
            raise InputError(f"--{role} = {shown(name)} {rule}", hint)
        return replace(same[0], unit=unit or same[0].unit)

    def with_assumed_unit(self, column: Column, role: Role, said: list[str]) -> Column:
        """The column with its unit, or that which a line above the table states, or SI where its header says enough.

        said: gets the sentence on what was assumed.
        Raises InputError: a header that does not say it, or lines above the table that may name another unit.
        """
        if column.unit:
            return column
        unit = self._stated_unit(role.dimensions)
        if unit:
            said.append(f"{column.label} is in {unit}, as a line above the table says")
        elif self.above or column.header not in role.names:
            lines = f", and {self.above[0][:40]!r} stands above the table" if self.above else ""
            raise InputError(f"{column.label} states no unit{lines}", role.hint)
        else:
            unit = role.unit
            span = f"the span of {column.label}, which states no unit,"
            between(span, np.ptp(column.values), 0, role.longest, hint=role.hint)
            said.append(f"{column.label} states no unit: {unit}")
        return replace(column, unit=unit)

    def _stated_unit(self, dimensions: tuple[str, ...]) -> str:
        """The one unit of these dimensions in the lines above the table that say "unit"; "" for none or several."""
        lines = [line for line in self.above if "unit" in line.lower()]
        words = {word for line in lines for word in WORDS.findall(line) if len(word) > 1 or word in LETTERS}
        scales = {word: scale_of(word) for word in words - {"as"}}
        units = [word for word, scale in scales.items() if scale and scale.dimensions in dimensions]
        return units[0] if len(units) == 1 else ""


def number_table(content: bytes) -> NumberTable:
    """Find the table in a file.

    Raises InputError: no rows of two numbers, a row that breaks off, commas that may divide thousands.

    >>> table = number_table(b"% Time (us)   T (K)\\n0   293.15\\n1   294.5\\n2   295")
    >>> [(column.name, column.unit) for column in table.columns]
    [('Time', 'us'), ('T', 'K')]
    """
    lines = _lines(content)
    begin, divider = _first_row(lines)
    stop = _behind_last_row(lines, divider)
    rows = "\n".join(lines[begin:stop])
    cells = _frame(_FORTRAN.sub("e", rows), divider)
    numbers = _number_columns(cells)
    above = [line for line in lines[:begin] if line.strip(BLANK)]
    headers = _headers(above, divider, cells.shape[1])
    columns = []
    for place in numbers:
        unit = name_and_unit(headers[place])[1]
        columns.append(Column(place + 1, headers[place], unit, numbers[place].to_numpy()))
    after = sum(bool(line.strip(BLANK)) for line in lines[stop:])
    named = int(any(headers))
    return NumberTable(tuple(columns), tuple(above[: len(above) - named]), after)


def has_rows(content: bytes) -> bool:
    """Whether the beginning of a file has a line of two numbers, as every table has."""
    return any(len(_numbers(line, divider)) > 1 for line in _lines(content) for divider in DIVIDERS)


def _lines(content: bytes) -> list[str]:
    """Lines of a file in UTF-8, UTF-16 with its mark, or Windows' western code page."""
    marked = content[:2] in (b"\xff\xfe", b"\xfe\xff")
    try:
        text = content.decode("utf-16" if marked else "utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


def _cells(line: str, divider: str) -> list[str]:
    """Cells of a line, unquoted."""
    if divider == " ":
        return line.split()
    reader = csv.reader([line[:131_072]], delimiter=divider, skipinitialspace=True)
    return [cell.strip() for cell in next(reader, [])]


def _is_number(cell: str) -> bool:
    """Whether a cell is a number, with a decimal point or comma, and an exponent of Python or FORTRAN."""
    point = cell.replace(",", ".")
    with suppress(ValueError):
        float(_FORTRAN.sub("e", point))
        return True
    return False


def _numbers(line: str, divider: str) -> set[int]:
    """Places of the cells that are numbers; none in a remark."""
    if line.lstrip().startswith(tuple(MARKS)):
        return set()
    return {place for place, cell in enumerate(_cells(line, divider)) if _is_number(cell)}


def _begins_with_number(line: str) -> bool:
    """Whether a line begins with a number, like a row, in whatever way its cells are divided."""
    words = re.split(r"[\s;,|\"]+", line.strip('\t ,;"'))  # not at ":" and "(": "12:30" and "(1) Time" are no numbers
    return _is_number(words[0])


def _first_row(lines: list[str]) -> tuple[int, str]:
    """Index of the first line of the table, and the character that divides its columns."""
    filled = [number for number, line in enumerate(lines) if line.strip(BLANK)]
    for k in range(len(filled) - FIRST_ROWS + 1):
        rows = [lines[number] for number in filled[k : k + FIRST_ROWS]]
        for divider in DIVIDERS:
            widths = {len(_cells(row, divider)) for row in rows}
            shared = set.intersection(*(_numbers(row, divider) for row in rows))
            if len(widths) == 1 and len(shared) >= 2:
                return filled[k], divider
    raise InputError(f"no {FIRST_ROWS} lines of at least two numbers; a table of time and temperature is needed")


def _behind_last_row(lines: list[str], divider: str) -> int:
    """Index behind the last line of two numbers, or that begins with one like a row that breaks off."""
    stop = len(lines)
    while len(_numbers(lines[stop - 1], divider)) < 2 and not _begins_with_number(lines[stop - 1]):
        stop -= 1
    return stop


def _frame(text: str, divider: str) -> Any:
    """The cells of the rows, a DataFrame whose columns are counted from 0; numbers where all cells are numbers.

    Raises InputError: a row of more cells than the first, commas that may divide thousands.
    """
    import pandas as pd  # type: ignore[import-untyped]

    commas = divider != "," and "," in text
    if commas and ("." in text or not _DECIMAL_COMMA.search(text)):
        rule = "the commas of its numbers may divide thousands, 1,234 as 1234"
        raise InputError(rule, "write a decimal point and no other mark")
    separator = r"\s+" if divider == " " else divider
    options: dict[str, Any] = {"header": None, "skipinitialspace": True, "low_memory": False}
    try:
        return pd.read_csv(io.StringIO(text), sep=separator, decimal="," if commas else ".", **options)
    except ValueError as error:  # pandas' ParserError is one
        raise InputError(f"a row is damaged: {str(error).splitlines()[0]}") from None


def _number_columns(cells: Any) -> Any:
    """The columns that hold a number in most rows, a DataFrame of floats; text beside the first rows becomes nan.

    Raises InputError: fewer than two columns, a text where most rows have a number.
    """
    import pandas as pd

    try:
        numbers = cells.apply(pd.to_numeric, errors="coerce")
    except OverflowError:
        raise InputError("a whole number of its rows is beyond 1e308") from None
    counts = numbers.notna().sum()
    numbers = numbers.loc[:, counts >= MOSTLY * counts.max()]
    damaged = (numbers.isna() & cells[numbers.columns].notna()).any(axis=1)
    if numbers.shape[1] < 2:
        raise InputError("the rows have no two columns of numbers in common")
    if damaged.any():
        row = cells[damaged].head(1).to_csv(header=False, index=False)
        raise InputError(f"the row {row.strip()[:40]!r} is no row of {numbers.shape[1]} numbers")
    return numbers.dropna(how="all").astype(float)


def _headers(above: list[str], divider: str, width: int) -> list[str]:
    """Headers of the columns: the last line above the table, or two lines of names and units, "second,Volt", in one.

    Raises InputError: the line begins with a number, like a damaged row.
    """
    if above and _begins_with_number(above[-1]):
        raise InputError(f"the line {above[-1].strip()[:40]!r} above the table is no row of numbers")
    rows = [_titles(line, divider, width) for line in ["", "", *above][-2:]]
    names, titles = rows
    units = [title.strip("()[]") for title in titles]
    scales = [scale_of(unit) for unit in units]
    measured = [scale.dimensions for scale in scales if scale]
    if any(names) and len(measured) == width and TIME in measured:
        return [f"{name} ({unit})" for name, unit in zip(names, units, strict=True)]
    return titles


def _titles(line: str, divider: str, width: int) -> list[str]:
    """The cells of a line; empty where it has not one for each column."""
    line = line.lstrip(MARKS + " \"'")
    for cells in (_cells(line, divider), _BETWEEN_TITLES.split(line.strip())):
        titles = [cell.strip(" \"'") for cell in cells]
        if len(titles) == width and any(titles):
            return titles
    return [""] * width
