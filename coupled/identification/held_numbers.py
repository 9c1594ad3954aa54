"""How far a fit leans on the numbers that it holds: their derivatives, and deviations that contain theirs.

A minimum of |r(x, p)|^2 + (x - x_0)^T L (x - x_0) in the unknowns x moves with a held number p as

    dx/dp = -(J^T J + L)^-1 J^T dr/dp,        J = dr/dx,

in the approximation of Gauss and Newton. A quantity q(x, p) moves as dq/dp + dq/dx dx/dp, and the variance of q that
the deviation s_p of a held number adds is (s_p dq/dp)^2 of this total derivative.
"""

import textwrap
from collections.abc import Mapping, Sequence

import numpy as np

from thermofem import checks

from ..resonator import RingResonator
from ..unknowns import COMPUTED, fitted_names, number_of

WEAK = 0.02  # slope of a parameter, below which a held number does not matter
HELD_STEP = 5e-3  # of a held number, by which it is moved for a derivative
IGNORED = {"lumped_fcd", *COMPUTED}  # the lumped term is one of ``fcd``; the others are computed from fields
WIDTH = 100  # characters of a line
MOST_LINES = 12  # of the text of a fit
SHOWN = 3  # notes that are shown whole


def held_numbers(ring: RingResonator, free: Sequence[str]) -> dict[str, float]:
    """Numbers of a ring that a fit holds and that are not 0, in SI by name; the carriers by "tau0" alone."""
    sets = {name for computed, fields in COMPUTED.items() if computed in free for name in fields}
    carriers = {name for name in fitted_names(ring) if not hasattr(ring, name)} - {"tau0"}
    names = fitted_names(ring) - IGNORED - carriers - sets - {*free}
    if carriers & {*free}:
        names -= {"tau0"}
    values = {name: number_of(ring, name) for name in sorted(names)}
    return {name: value for name, value in values.items() if np.isfinite(value) and value != 0}


def held_deviations(held: Mapping[str, float] | None, known: Sequence[str], free: Sequence[str]) -> dict[str, float]:
    """Check the standard deviations of held numbers: InputError for an unknown or free name, or a negative number."""
    given = checks.mapping("held", held, hint='standard deviations in SI, such as {"fca_cross_section": 7e-23}')
    for name, deviation in given.items():
        if name in free:
            raise checks.InputError(f"held has {name!r}, which is free: only a number that is held has a deviation")
        checks.choice("a name in held", name, known)
        checks.between(f"held[{name!r}]", deviation, 0, np.inf)
    return {name: float(deviation) for name, deviation in given.items()}


def leaning(sensitivities: Mapping[str, Mapping[str, float]], most: int = 3) -> list[str]:
    """Lines on the held numbers on which parameters lean most, each with the parameter that it moves most.

    sensitivities: of a parameter to each held number, d ln parameter/d ln held; slopes below `WEAK` are left out.
    """
    strongest: dict[str, tuple[float, str]] = {}
    for parameter, by_held in sensitivities.items():
        for held, slope in by_held.items():
            if abs(slope) > abs(strongest.get(held, (WEAK, ""))[0]):
                strongest[held] = (slope, parameter)
    order = sorted(strongest, key=lambda held: -abs(strongest[held][0]))
    lines = []
    for held in order[:most]:
        slope, parameter = strongest[held]
        lines.append(f"{parameter} moves by {slope:+.2g} % for 1 % of {held}")
    return lines


def summary(
    title: str,
    parameters: Mapping[str, float],
    deviations: Mapping[str, float],
    sensitivities: Mapping[str, Mapping[str, float]],
    notes: Sequence[str],
) -> str:
    """Text of a fit: a title, a line for each parameter (SI), the held numbers that matter most, and the notes.

    At most `MOST_LINES` lines, if the parameters leave room: the last one says how many of the notes are left out.
    """
    lines = [title]
    for name, value in parameters.items():
        deviation = deviations.get(name)
        bar = "" if deviation is None else f" +- {deviation:.2g}"
        lines.append(f"  {name:<20} {value:.5g}{bar}")
    further = [f"held: {line}" for line in leaning(sensitivities)]
    further += [textwrap.shorten(f"note: {note}", WIDTH - 2, placeholder=" ...") for note in notes]
    room = max(MOST_LINES - len(lines), 1)
    if len(further) > room:
        hidden = len(further) - room + 1
        further = [*further[: room - 1], f"and {hidden} more lines, in .sensitivities and .notes"]
    return "\n".join([*lines, *(f"  {line}" for line in further)])
