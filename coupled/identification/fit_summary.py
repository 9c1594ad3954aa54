"""Results of fits in a dozen lines: parameters with deviations, the held numbers that they lean on, and notes."""

import textwrap
from collections.abc import Mapping, Sequence

from .held_numbers import leaning

WIDTH = 100  # characters of a line
SHOWN = 3  # notes that are shown whole


def summary(
    title: str,
    parameters: Mapping[str, float],
    deviations: Mapping[str, float],
    sensitivities: Mapping[str, Mapping[str, float]],
    notes: Sequence[str],
) -> str:
    """Text of a fit: a title, a line for each parameter (SI), the held numbers that matter most, and the notes."""
    lines = [title]
    for name, value in parameters.items():
        deviation = deviations.get(name)
        bar = "" if deviation is None else f" +- {deviation:.2g}"
        lines.append(f"  {name:<20} {value:.5g}{bar}")
    lines += [f"  held: {line}" for line in leaning(sensitivities)]
    lines += [textwrap.shorten(f"  note: {note}", WIDTH, placeholder=" ...") for note in notes[:SHOWN]]
    more = len(notes) - SHOWN
    if more > 0:
        lines.append(f"  and {more} more, in .notes")
    return "\n".join(lines)
