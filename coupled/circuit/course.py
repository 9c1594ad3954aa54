"""Heat of the neighbours in a step: the parabola through its values at the last accepted steps; compiled."""

from __future__ import annotations

from typing import NamedTuple

from ..kernels.compiling import inlined_lean
from ..kernels.equations import Array


class Course(NamedTuple):
    """The heat of the neighbours at the last accepted steps, newest first, and the parabola through it."""

    time: Array  # shape (3,)
    value: Array  # shape (3, N)
    first: Array  # shape (N,), divided differences
    second: Array


@inlined_lean
def advance(course: Course, known: int, t: float, value: Array) -> None:
    """Add the values at ``t`` as those of ``known`` steps; fewer than three points give a line or a constant."""
    time, values, first, second = course.time, course.value, course.first, course.second
    time[2], time[1], time[0] = time[1], time[0], t
    for i in range(value.size):
        values[2, i], values[1, i], values[0, i] = values[1, i], values[0, i], value[i]
    if known > 1:
        now, then, both = time[0] - time[1], time[1] - time[2], time[0] - time[2]
        for i in range(value.size):
            first[i] = (values[0, i] - values[1, i]) / now
            if known > 2:
                second[i] = (first[i] - (values[1, i] - values[2, i]) / then) / both


@inlined_lean
def extrapolate(course: Course, t: float, value: Array) -> None:
    """Write the parabola at ``t``."""
    newest, first, second = course.value, course.first, course.second
    u = t - course.time[0]
    v = u * (t - course.time[1])
    for i in range(value.size):
        value[i] = newest[0, i] + first[i] * u + second[i] * v
