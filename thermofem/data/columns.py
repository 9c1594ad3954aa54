"""Columns of numbers in a text, with the names and units of the header above them.

What is read: columns divided by commas, semicolons, tabs or spaces, after any header. The last line above the table
with text in all columns names them; a line of bare units below it counts too. Both may have another separator than the
rows; a unit of time, temperature or voltage that no column takes is refused. Lines that begin with % or # are header.
Any other line between the header and the table is a damaged row, and refused, as is one that another separator divides.
With semicolons or tabs a comma is a decimal mark; a table in which it may divide thousands is refused, and so are two
units for one column.
A unit stands in the header, "Time (s)", "CH1 [mV]", "time_us" or "t / us", or is given in ``units``. Where the header
states the start and the increment of the times (Rigol), the first column counts them. Empty columns at the end and
empty rows are left out.
"""

from __future__ import annotations

import csv
import re
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .. import checks
from ..arrays import Array, NDArray
from ..checks import InputError
from . import quantity
from .dataset import POSSIBLE
from .header_units import IN_BRACKETS, SECONDS, are_units, header_unit, hidden_unit, is_unit, stated_unit

DIVIDERS = ("\t", ";", ",", "|", ":", " ")
MARKS = "%#/!'\" "  # of lines that are comments in some program
UNIT_ROWS, FEW = 5, 50  # lines above the table that may be a row of units; cells from which on it is none
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}", re.ASCII)  # 1,234: or a decimal comma before three digits
HOTTEST = 1e5  # K; beyond any temperature: the code of an instrument whose input is overloaded, such as 9.9E+37


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of numbers with the names and units that their header gives.

    names, units: unit "" where the header states none.
    values [shape (rows, columns)]: nan where a cell is empty.
    lines [shape (rows,)]: line of the file that each row stands on, from 1.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    lines: NDArray[np.int64]

    def column(self, argument: str, name: str) -> int:
        """Index of a column by its header, with or without what follows the unit."""
        checks.text(argument, name)
        short = [IN_BRACKETS.split(known)[0].strip() for known in self.names]
        if name in self.names:
            return self.names.index(name)
        if short.count(name) == 1:
            return short.index(name)
        if name in short:
            several = [full for full, known in zip(self.names, short, strict=True) if known == name]
            raise InputError(f"{argument} = {name!r} names {len(several)} columns; give one of {', '.join(several)}")
        checks.choice(f"{argument}: column", name, dict.fromkeys([*self.names, *short]))
        return -1  # not reached: `choice` raises

    def numbers(self, place: int, name: str = "") -> Array:
        """The numbers of a column; InputError where one is empty or not finite."""
        values = self.values[:, place]
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            more = f" ({bad.size} rows in all)" if bad.size > 1 else ""
            what = f"{name or self.names[place]!r} is empty or not finite{more}; take such rows out"
            raise InputError(f"line {self.lines[bad[0]]}: {what}")
        return values


def in_si(name: str, values: Array, offset: float, factor: float) -> Array:
    """A column times the factor of its unit, plus the offset; InputError where that is beyond any number."""
    with np.errstate(over="ignore"):
        found = offset + factor * values
    if not np.isfinite(found).all():
        raise InputError(f"{name!r} is beyond any number here; is its unit right?")
    return found


def times_in_si(name: str, values: Array, offset: float, factor: float) -> Array:
    """`in_si` of a column of times, whose span must be one that floats compute with."""
    found = in_si(name, values, offset, factor)
    with np.errstate(over="ignore"):
        span = float(np.ptp(found))
    if span > 0:
        checks.between(f"the span of {name!r}", span, *POSSIBLE, unit="s", hint="is its unit right?")
    return found


def parse(text: str) -> Columns:
    """Find the table in a text; InputError when there are no numbers or a row breaks off.

    >>> parse("% Time (us)   T (K)\\n0   293.15\\n1   294.5").units
    ('us', 'K')
    """
    lines, first, step = _counted(text.splitlines())
    divider = _divider(lines)
    cells, at, width = array("d"), array("q"), 0  # a list of lists takes four times the memory
    for number, line in enumerate(lines, 1):
        values = _floats(_cells(line, divider), divider)
        if values is not None and (not at or len(values) == width):
            width = len(values)
            cells.extend(values)
            at.append(number)
        elif at and not _is_remark(line):
            raise _damaged(number, line, width)
    if not np.isfinite(cells).any():
        raise InputError("no line of at least two numbers; a table of time and temperature is needed")
    _check_marks([lines[k - 1] for k in at], at, divider)
    table = np.array(cells, dtype=float).reshape(-1, width)
    used = np.isfinite(table).any(axis=0)
    names, units = _header(lines[: at[0] - 1], divider, used)
    with np.errstate(over="ignore", invalid="ignore"):  # refused where it is read, as not finite
        table[:, 0] = first + step * table[:, 0]
    wide = max(int(np.flatnonzero(used)[-1]) + 1, 2)
    return Columns(names[:wide], units[:wide], table[:, :wide], np.frombuffer(at, np.int64))


def _counted(lines: list[str]) -> tuple[list[str], float, float]:
    """Lines of a table whose times are counted, with a plain header, and the first time and the step in s; else 0, 1.

    X,CH1,Start,Increment,
    Sequence,Volt,-3.0e-06,1.0e-08
    """
    divider = next((d for d in (";", "\t") if lines and d in lines[0]), ",")
    head = [[cell.strip(" \"'") for cell in line.split(divider)] for line in lines[:2]]
    words = [cell.lower() for cell in head[0]] if head else []
    if len(head) < 2 or not {"start", "increment"} <= set(words) or head[1][0].lower() != "sequence":
        return lines, 0.0, 1.0
    places = words.index("start"), words.index("increment")
    try:
        first, step = (quantity.number(head[1][k].replace(",", ".")) for k in places)
    except (ValueError, IndexError):
        what = "has no numbers below Start and Increment, which the times are made of"
        raise InputError(f"line 2 = {lines[1].strip()[:40]!r} {what}") from None
    cells = lines[2].split(divider) if len(lines) > 2 else []
    wide = min(places)
    titles = (row[:wide] + [""] * (len(cells) - wide) for row in (head[0], ["s", *head[1][1:]]))
    return [*(divider.join(row) for row in titles), *lines[2:]], first, step


def text_of(content: bytes) -> str:
    """Text of a table in UTF-8; InputError for other encodings, and for a NUL character, which is damage."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise InputError("it is UTF-16 text; save it as UTF-8")
    if b"\0" in content:
        line = content[: content.index(b"\0")].count(b"\n") + 1
        raise InputError(f"line {line} holds a NUL character; the file is damaged, or UTF-16 text: save it as UTF-8")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line, byte = content[: error.start].count(b"\n") + 1, content[error.start]
        raise InputError(
            f"line {line} holds the byte 0x{byte:02x}, which is no UTF-8 text but may be Latin-1; save it as UTF-8"
        ) from None


def _is_remark(line: str) -> bool:
    return not line.strip(" \t;,") or line.lstrip().startswith(("%", "#"))


def _damaged(number: int, line: str, columns: int) -> InputError:
    return InputError(f"line {number} = {line.strip()[:40]!r} is no row of {columns} numbers")


def _divider(lines: list[str]) -> str:
    """Separator of the columns: tab, semicolon or comma if the last line then holds numbers; otherwise spaces."""
    last = [line for line in lines if line.strip()][-3:]
    for divider in ("\t", ";", ","):
        if any(_floats(_cells(line, divider), divider) is not None for line in last):
            return divider
    return " "


def _cells(line: str, divider: str) -> list[str]:
    """Cells of a line, unquoted; in a header with spaces, two of them end a cell."""
    if divider != " ":
        try:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=divider, skipinitialspace=True), [])]
        except csv.Error as error:  # a cell of more than 131072 characters
            raise InputError(f"a line of {len(line)} characters is no row of a table ({error})") from None
    line = line.strip()
    cells = line.split()
    return cells if _floats(cells, divider) is not None else re.split(r"\s{2,}|\t", line)


def _floats(cells: list[str], divider: str) -> list[float] | None:
    """The cells as numbers, nan where empty; None unless there are two cells or more, and a number among them."""
    if divider in (";", "\t"):
        cells = [cell.replace(",", ".") for cell in cells]
    try:
        values = [quantity.number(cell) if cell and cell != "--" else np.nan for cell in cells]
    except ValueError:
        return None
    return values if len(values) > 1 and any(cells) else None


def _check_marks(rows: list[str], at: Sequence[int], divider: str) -> None:
    """InputError where a comma may be a decimal mark and may divide thousands; ``at``: lines of the file."""
    commas = [k for k, row in enumerate(rows) if "," in row] if divider in (";", "\t") else []
    if not commas:
        return
    point = next((k for k, row in enumerate(rows) if "." in row), None)
    if point is not None:
        what = f"a comma in its numbers, and line {at[point]} a point; one of them divides thousands"
        raise InputError(f"line {at[commas[0]]} has {what}: leave that out")
    for k in commas:
        if any("," in cell and not _THOUSANDS.fullmatch(cell) for cell in _cells(rows[k], divider)):
            return
    cell = next(cell for cell in _cells(rows[commas[0]], divider) if "," in cell)
    what = f"{cell!r} may be {cell.replace(',', '')} or {cell.replace(',', '.')}, as may every number with a comma"
    raise InputError(f"line {at[commas[0]]}: {what}; write a decimal point, or leave the thousands undivided")


def _header(lines: list[str], divider: str, used: NDArray[np.bool_]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names and units of the columns from the lines above them; ``used`` marks the columns with numbers.

    The lines are divided as the rows are, or by the separator that finds more units in them.

    Raises InputError: a line below the names holds a number, or is neither names nor units: a damaged row; a line that
    another separator makes a row; units that no column takes.
    """
    columns, bare = used.size, [line.lstrip("%# ") for line in lines]
    own = split = [_names(line, divider, used) for line in bare]
    if _stated(own, used) < used.sum():
        split = max(own, *([_names(line, d, used) for line in bare] for d in DIVIDERS), key=lambda s: _stated(s, used))
    fitting, last = _fitting(split, used)
    place, below = last, None
    last = next((k for k in fitting if k > last >= 0 and any(split[k]) and are_units(split[k])), last)  # not of each
    above = [k for k in fitting if k < last]
    if above and are_units(split[last]):
        place, below = above[-1], split[last]
    for k, line in enumerate(lines):
        words = line.split() if divider == " " else own[k]
        broken = any(map(_is_number, words)) if k > last >= 0 else _is_number(words[0]) if words else False
        broken = broken or any(_floats(_cells(line, d), d) is not None for d in DIVIDERS)
        if not _is_remark(line) and (broken or (k > last and k in _fitting(own, used)[0] and any(own[k]))):
            raise _damaged(k + 1, line, columns)
    if last < 0:
        names, units = [str(k + 1) for k in range(columns)], [""] * columns
    else:
        names, units = split[place], [stated_unit(name) for name in split[place]]
        stated = [(place, split[place]), *((k, split[k]) for k in above if k != place)]
        _check_units(units, stated if below is None else [*stated, (last, below)])
    if below:
        units = [unit or cell.strip("()[] ") for unit, cell in zip(units, below, strict=True)]
    taken = sum(bool(unit) for unit, holds in zip(units, used, strict=True) if holds)
    for k, line in enumerate(lines):
        near = k >= len(lines) - UNIT_ROWS
        if _in_brackets(line) > taken or (near and (_bare(line) > taken or (k > last and _loose(line)))):
            what = f"line {k + 1} = {line.strip()[:40]!r} states units that no column takes"
            raise InputError(f"{what}; write a name and a unit for each of {columns} columns, divided as the rows are")
    return tuple(names), tuple(units)


def _fitting(split: list[list[str]], used: NDArray[np.bool_]) -> tuple[list[int], int]:
    """Lines with a cell for each column, and the last of them that is full; else the last one, or -1."""
    fitting = [k for k, cells in enumerate(split) if len(cells) == used.size and not _is_number(cells[0])]
    if used.sum() == 2:  # a setting of the instrument, such as "Time offset [us],0"
        fitting = [k for k in fitting if not (_is_number(split[k][1]) and stated_unit(split[k][0]))]
    full = [k for k in fitting if all(split[k][c] and not _is_number(split[k][c]) for c in np.flatnonzero(used))]
    return fitting, full[-1] if full else fitting[-1] if fitting else -1


def _stated(split: list[list[str]], used: NDArray[np.bool_]) -> int:
    """Number of units in the header that these cells of lines make: in its names, or in a line of units below them."""
    fitting, last = _fitting(split, used)
    if last < 0:
        return 0
    inside = sum(is_unit(stated_unit(cell)) for cell in split[last])
    return max(inside, len(split[last]) if fitting[0] < last and are_units(split[last]) else 0)


def _in_brackets(line: str) -> int:
    """How many units of a time, a temperature or a voltage a line has in brackets, without a number after them."""
    found = ((m[1], line[m.end() :].lstrip(' :=,;|\t"')[:1]) for m in IN_BRACKETS.finditer(line))
    return sum(is_unit(unit, ("s", "K", "V")) for unit, after in found if not after.isdigit())


def _bare(line: str) -> int:
    """How many units a line has that is nothing but units, one of them of seconds, whatever divides and marks it."""
    rows = ([cell.strip("\"' ") for cell in line.lstrip(MARKS).split(d)] for d in DIVIDERS)
    full = ([cell for cell in cells if cell] for cells in rows)
    of_units = (cells for cells in full if 1 < len(cells) < FEW and are_units(cells))
    return max((len(cells) for cells in of_units if any(map(SECONDS.fullmatch, cells))), default=0)


def _loose(line: str) -> bool:
    """Whether a line without columns holds a word that looks like a unit which is not SI, and no number before it."""
    words = IN_BRACKETS.sub(" ", line.lstrip(MARKS)).split()
    return any(hidden_unit(b) and not _is_number(a) and not _is_number(b[:1]) for a, b in pairwise(["", *words]))


def _check_units(units: list[str], stated: list[tuple[int, list[str]]]) -> None:
    """InputError where header lines, (index, cells), state another unit for a column of that name, or one says two."""
    names = [IN_BRACKETS.split(cell)[0].strip() for cell in stated[0][1]]
    for k, cells in stated:
        for name, unit, cell, own in zip(names, units, cells, stated[0][1], strict=True):
            bare = cell != own and is_unit(cell) and cell.strip("()[] ")
            same = name == IN_BRACKETS.split(cell)[0].strip()
            others = [bare] if bare else [text.strip() for text in IN_BRACKETS.findall(cell)] if same else []
            other = next((o for o in others if unit and header_unit(o) != header_unit(unit) and is_unit(o)), None)
            if other is not None:
                raise InputError(
                    f"line {k + 1} gives {name!r} in {other}, the header in {unit}; take the wrong one out"
                )


def _names(line: str, divider: str, used: NDArray[np.bool_]) -> list[str]:
    """Split a header line into cells: at two spaces, else after closing brackets, else at every space.

    One without the empty columns at the end of the rows gets their cells.
    """
    cells, columns = _cells(line, divider), used.size
    filled = int(np.flatnonzero(used).max(initial=-1)) + 1
    if divider != " " and len(cells) == filled < columns:
        return cells + [""] * (columns - filled)
    if divider == " ":
        ways = (cells, re.split(r"(?<=[)\]])\s+", line.strip()), line.split())
        cells = next((way for way in ways if len(way) == columns), cells)
    return cells


def _is_number(cell: str) -> bool:
    """Whether a cell of a header is a number."""
    try:
        quantity.number(cell.replace(",", "."))
    except ValueError:
        return False
    return True


def measured(table: Columns, place: int, temperatures: Array) -> Array:
    """Return temperatures in K; InputError where one is the overload code of an instrument."""
    bad = np.flatnonzero(~(np.abs(temperatures) <= HOTTEST))
    if bad.size:
        raise InputError(
            f"line {table.lines[bad[0]]}: {table.names[place]!r} = {table.values[bad[0], place]:g} is beyond "
            f"{HOTTEST:g} K, such as an overload of the instrument; take such rows out"
        )
    return temperatures
