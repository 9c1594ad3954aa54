"""What the paper says, what we get, and why they differ: one claim for every number that can be computed.

``{stage/path/to/number|factor|format}`` in a text is a number of a stage's file, times a factor, in a format. Nothing
else in the report's texts and tables may stand for a computed number.
"""

from __future__ import annotations

import html
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from .store import Result

PLACE = re.compile(r"\{([^{}|]+)\|([^{}|]*)\|([^{}|]*)\}")


@dataclass(frozen=True)
class Claim:
    """One row of the table.

    Attributes
    ----------
    where : str
        in the paper.
    quantity : str
    said : str
        by the paper.
    ours : str
        with places for numbers.
    within : tuple of (path, low, high)
        numbers, after their factor of 1, that must all lie within what the paper says for the row to agree.
    why : str
        where they differ: our explanation.
    key : bool
        whether the row is printed at the end of the run.
    """

    where: str
    quantity: str
    said: str
    ours: str
    within: tuple[tuple[str, float, float], ...] = ()
    why: str = ""
    key: bool = False

    def known(self, results: Mapping[str, Result]) -> bool:
        """Whether every stage that it needs was run, and none of our numbers is missing."""
        return known(self.ours + self.why, results)

    def agrees(self, results: Mapping[str, Result]) -> bool | None:
        """Whether our numbers lie within what the paper says; None where it gives nothing to compare with."""
        if not self.within:
            return None
        values = [(number(results, path), low, high) for path, low, high in self.within]
        return all(value is not None and low <= value <= high for value, low, high in values)


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
    paths = [path for path, *_ in PLACE.findall(text)]
    stages = {path.split("/")[0] for path in paths}
    return stages <= set(results) and all(number(results, path) is not None for path in paths)


def plain(text: str, results: Mapping[str, Result]) -> str:
    """A text with its numbers in place."""
    return PLACE.sub(lambda m: _shown(number(results, m[1]), m[2], m[3]), text)


def marked_up(text: str, results: Mapping[str, Result]) -> str:
    """The same as HTML: every number is a <data> element that says which file it comes from."""
    pieces, end = [], 0
    for m in PLACE.finditer(text):
        stage, _, path = m[1].partition("/")
        value = number(results, m[1])
        source = html.escape(f"data/{stage}.json#/numbers/{path}", quote=True)
        shown = html.escape(_shown(value, m[2], m[3]))
        attributes = f'value="{html.escape(repr(value), quote=True)}" data-from="{source}" data-factor="{m[2] or 1}"'
        pieces += [html.escape(text[end : m.start()]), f'<data {attributes} title="{source}">{shown}</data>']
        end = m.end()
    return "".join([*pieces, html.escape(text[end:])])


def _shown(value: Any, factor: str, style: str) -> str:
    """A number as a person reads it."""
    if value is None:
        return "none"
    return str(value) if isinstance(value, str) else format(value * float(factor or 1), style).replace("-", "−")
