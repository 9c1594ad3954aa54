"""The paper's statements beside our values, with the reason of each difference: rows of table.toml.

``{stage/path/to/number|factor|format|low..high}`` in a text is a number of a stage's file, times a factor, in a format;
with a range, which is in the units shown, the row agrees only where the number lies within it. Nothing else in the
report's texts may stand for a computed number.
"""

from __future__ import annotations

import html
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .sections import one_line
from .store import Result

PLACE = re.compile(r"\{([^{}|]+)\|([^{}|]*)\|([^{}|]*)(?:\|([^{}|]*)\.\.([^{}|]*))?\}")
INDEX = re.compile(r"(?<![A-Za-z0-9])([A-Za-zα-ωΑ-Ω])_([A-Za-z]+)")  # c_p, τ_th
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Claim:
    """One row of the table.

    where: in the paper, or who else says it.
    paper: what it says.
    ours: with places for numbers.
    why: where they differ: our explanation.
    key: whether the row is printed at the end of the run.
    """

    where: str
    quantity: str
    paper: str
    ours: str
    why: str = ""
    key: bool = False

    def known(self, results: Mapping[str, Result]) -> bool:
        """Whether every stage that it needs was run, and none of our numbers is missing."""
        return known(self.ours + self.why, results)

    def agrees(self, results: Mapping[str, Result]) -> bool | None:
        """Whether our numbers lie within the paper's range; None where it gives none."""
        places = [m for m in PLACE.finditer(self.ours) if m[4]]
        found = [(number(results, m[1]), float(m[2] or 1), float(m[4]), float(m[5])) for m in places]
        if not found:
            return None
        return all(value is not None and low <= value * factor <= high for value, factor, low, high in found)


def claims() -> tuple[Claim, ...]:
    """The rows of table.toml."""
    rows = tomllib.loads((Path(__file__).parent / "table.toml").read_text(encoding="utf-8"))["row"]
    return tuple(Claim(**one_line(row)) for row in rows)


def number(results: Mapping[str, Result], path: str) -> Any:
    """The number at ``stage/path/to/number``, list items counted from 0; None where there is none."""
    stage, *rest = path.split("/")
    value: Any = results[stage].numbers
    for step in rest:
        if value is None:
            return None
        value = value[int(step)] if isinstance(value, list) else value[step]
    return value


def known(text: str, results: Mapping[str, Result]) -> bool:
    """Whether every number in a text was computed."""
    paths = [m[1] for m in PLACE.finditer(text)]
    stages = {path.split("/")[0] for path in paths}
    return stages <= set(results) and all(number(results, path) is not None for path in paths)


def plain(text: str, results: Mapping[str, Result]) -> str:
    """A text with its numbers in place."""
    return PLACE.sub(lambda m: _shown(number(results, m[1]), m[2], m[3]), text)


def marked_up(text: str, results: Mapping[str, Result]) -> str:
    """The row as HTML: every number is a <data> element that names its file."""
    pieces, end = [], 0
    for m in PLACE.finditer(text):
        stage, _, path = m[1].partition("/")
        value = number(results, m[1])
        source = html.escape(f"data/{stage}.json#/numbers/{path}", quote=True)
        shown = html.escape(_shown(value, m[2], m[3]))
        attributes = f'value="{html.escape(repr(value), quote=True)}" data-from="{source}" data-factor="{m[2] or 1}"'
        pieces += [typeset(text[end : m.start()]), f'<data {attributes} title="{source}">{shown}</data>']
        end = m.end()
    return "".join([*pieces, typeset(text[end:])])


def typeset(text: str) -> str:
    """Words as HTML, c_p with its index below."""
    return INDEX.sub(r"\1<sub>\2</sub>", html.escape(text))


def _shown(value: Any, factor: str, style: str) -> str:
    """A number as a person reads it: 6·10⁻⁵, not 6e-05."""
    if value is None:
        return "none"
    if isinstance(value, str):
        return value
    digits, _, exponent = format(value * float(factor or 1), style).partition("e")
    return digits.replace("-", "−") + (f"·10{str(int(exponent)).translate(RAISED)}" if exponent else "")
