"""Tables of numbers as instruments, simulators and people write them: the block of numbers, and what its header says.

The block is the longest run of lines whose cells are numbers in the same columns, two at least. Columns may be divided
by tabs, semicolons, commas or spaces, and stand beside columns of text; settings above the header, a row of units below
it and remarks after the last row are passed by. A comma is a decimal mark where tabs, semicolons or spaces divide.
"""

import csv
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from ..arrays import Array
from ..checks import InputError
from .column_units import is_unit, scale_of, unit_in

DIVIDERS = ("\t", ";", ",", " ")
FEWEST = 3  # consecutive lines of numbers that begin the block: settings seldom stand in three such lines
LOOKED, MOSTLY = 60, 0.8  # rows that tell which columns are numbers: those with numbers in this share of them
MARKS = "%#!/\"' "  # that begin a remark or a header in some program
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?|[+-]?nan|[+-]?inf", re.ASCII | re.IGNORECASE)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+", re.ASCII)  # 1,234: or a decimal comma before three digits


@dataclass(frozen=True, eq=False)
class NumberTable:
    """Columns of numbers with what stands above them.

    columns: number of each column in the file, from 1.
    names, units: of each column, "" where the file states none.
    values [shape (rows, columns)]
    above: the lines above the table and the cells beside its first rows, which may name units.
    line: of the first row, from 1; after: how many lines of text follow the last row.
    """

    columns: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    above: tuple[str, ...]
    line: int
    after: int

    def label(self, k: int) -> str:
        """The column as messages name it."""
        return repr(self.names[k]) if self.names[k] else f"column {self.columns[k]}"


def number_table(content: bytes) -> NumberTable:
    """Find the table in a file.

    Raises InputError: no rows of two numbers, a row that breaks off, commas that may divide thousands.

    >>> number_table(b"% Time (us)   T (K)\\n0   293.15\\n1   294.5\\n2   295").names
    ('Time (us)', 'T (K)')
    """
    text = text_of(content)
    head, start, divider = _block(text)
    rows = [cells_of(line, divider) for _, line in islice(_lines(text, start), LOOKED)]
    width = len(rows[0])
    counts = [sum(len(row) == width and is_number(row[k], divider) for row in rows) for k in range(width)]
    columns = [k for k in range(width) if counts[k] >= MOSTLY * max(counts)]
    if len(columns) < 2:
        raise InputError(f"the rows from line {len(head) + 1} on have no two columns of numbers in common")
    end, after = _end(text, divider, columns)
    block = text[start:end]
    del text, content
    values = _values(block, divider, columns, len(head) + 1)
    beside = [", ".join(cell for k, cell in enumerate(row) if k not in columns and cell) for row in rows]
    names, units, above = _header(head, divider, width, columns)
    table = (tuple(k + 1 for k in columns), names, units, values, (*above, *filter(None, beside)), len(head) + 1, after)
    return _counted(NumberTable(*table), head, divider)


def text_of(content: bytes) -> str:
    """The text of a file in UTF-8, UTF-16 with its mark, or Windows' western code page, lines ended by a line feed."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = content.decode("utf-16", errors="replace")
    else:
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = content.decode("cp1252", errors="replace")
    if "\0" in text:
        raise InputError(
            f"line {text[: text.index(chr(0))].count(chr(10)) + 1} holds a NUL character", "is it damaged?"
        )
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def _lines(text: str, at: int = 0) -> Iterator[tuple[int, str]]:
    """Each line and where it begins."""
    while at < len(text):
        stop = text.find("\n", at)
        stop = len(text) if stop < 0 else stop
        yield at, text[at:stop]
        at = stop + 1


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
    """Whether a cell is a number; with a decimal comma unless a comma divides the columns."""
    return bool(_NUMBER.fullmatch(cell if divider == "," else cell.replace(",", ".")))


def _block(text: str) -> tuple[list[str], int, str]:
    """Lines above the table, where it begins, and what divides its columns."""
    runs: dict[str, list[tuple[int, int, int, set[int]]]] = {divider: [] for divider in DIVIDERS}
    head: list[str] = []
    for at, line in _lines(text):
        head.append(line)
        for divider, run in runs.items():
            cells = cells_of(line, divider) if line.strip(MARKS) == line.strip("\"' ") else []
            here = {k for k, cell in enumerate(cells) if is_number(cell, divider)}
            if not cells and run and not line.strip(MARKS + ",;\t"):
                continue  # an empty line
            if len(here) < 2:
                run.clear()
                continue
            while run and (run[-1][2] != len(cells) or len(here.intersection(*(row[3] for row in run))) < 2):
                run.pop(0)
            run.append((at, len(head), len(cells), here))
            if len(run) == FEWEST:
                return head[: run[0][1] - 1], run[0][0], divider
    raise InputError(f"no {FEWEST} lines of at least two numbers; a table of time and temperature is needed")


def _end(text: str, divider: str, columns: list[int]) -> tuple[int, int]:
    """Where the last row ends, and how many lines of words follow it."""
    stop, after = len(text.rstrip("\n\t ,;")), 0
    while stop > 0:
        begin = text.rfind("\n", 0, stop) + 1
        line = text[begin:stop]
        cells = cells_of(line, divider)
        if len(cells) > columns[-1] and all(is_number(cells[k], divider) or not cells[k] for k in columns):
            break
        if _looks_broken(line):
            break  # a row that breaks off: `_values` names it
        stop, after = len(text[:begin].rstrip("\n\t ,;")), after + bool(line.strip())
    return len(text) if text.find("\n", stop) < 0 else text.find("\n", stop), after


def _values(text: str, divider: str, columns: list[int], first: int) -> Array:
    """The numbers of the block, shape (rows, columns)."""
    import pandas as pd  # type: ignore[import-untyped]

    if divider != ",":
        _check_commas(text, divider, columns, first)
    sample = text[:4000].lower()
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
            skipinitialspace=True, na_values=["--"], skip_blank_lines=True, encoding="utf-8", **options,
        )  # fmt: skip
        values = frame.to_numpy()
        empty = np.isnan(values).all(axis=1)
        return values[~empty] if empty.any() else values
    except (ValueError, KeyError, pd.errors.ParserError):
        pass
    for number, (_, line) in enumerate(_lines(text), first):
        cells = cells_of(line, divider)
        wrong = len(cells) <= columns[-1] or not all(is_number(cells[k], divider) or not cells[k] for k in columns)
        if line.strip(MARKS + ",;\t") and (wrong or (number == first and not cells)):
            raise InputError(f"line {number} = {line.strip()[:40]!r} is no row of {len(columns)} numbers")
    raise InputError("its rows have different numbers of cells, or hold text in a column of numbers")


def _looks_broken(line: str) -> bool:
    """Whether a line without numbers in all columns begins as a row: with a number,."""
    words = [word for word in re.split(r"[\s;,|\"]+", line) if word]
    return bool(words) and is_number(words[0])


def _check_commas(text: str, divider: str, columns: list[int], first: int) -> None:
    """InputError where a comma may be a decimal mark and may divide thousands."""
    if "," not in text:
        return
    if "." in text:
        raise InputError("its numbers have commas and points, and one of them divides thousands", "leave that out")
    for _, line in _lines(text):
        cells = cells_of(line, divider)
        if any("," in cells[k] and not _THOUSANDS.fullmatch(cells[k]) for k in columns if k < len(cells)):
            return
    raise InputError(
        f"line {first}: every number with a comma may be meant with thousands, 1,234 as 1234", "write a decimal point"
    )


def _header(
    head: list[str], divider: str, width: int, columns: list[int]
) -> tuple[tuple[str, ...], tuple[str, ...], list[str]]:
    """Names and units of the columns, and the other lines above the table.

    Raises InputError: below the names stands a line with a number first, a damaged row.
    """
    names, units = [""] * width, [""] * width
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
    return tuple(names[k] for k in columns), tuple(units[k] for k in columns), head


def _titles(line: str, divider: str, width: int, columns: list[int]) -> list[str]:
    """Cells of a line that names the columns, one for each; none where it does not, or holds numbers."""
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


def _counted(table: NumberTable, head: list[str], divider: str) -> NumberTable:
    """A table whose times are counted by the first column, made of the start and the increment in its header (Rigol).

    X,CH1,Start,Increment,
    Sequence,Volt,-3.0e-06,1.0e-08
    """
    rows = [cells_of(line.lower(), divider) for line in head[:2]]
    if len(rows) < 2 or not {"start", "increment"} <= set(rows[0]) or "sequence" not in rows[1]:
        return table
    try:
        first, step = (float(rows[1][rows[0].index(word)].replace(",", ".")) for word in ("start", "increment"))
    except (ValueError, IndexError):
        raise InputError("line 2 has no numbers below Start and Increment, which the times are made of") from None
    values = table.values.copy()
    values[:, 0] = first + step * values[:, 0]
    cells = [cells_of(line, divider) for line in head[:2]]
    names = tuple(cells[0][k - 1] for k in table.columns)
    units = ("s", *(cells[1][k - 1] for k in table.columns[1:]))
    return replace(table, names=names, units=units, values=values, above=())
