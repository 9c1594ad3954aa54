"""Heat of the neighbours in a step: the parabola through its values at the last accepted steps; compiled."""

from __future__ import annotations

from typing import NamedTuple

from ..kernels.compiling import inlined
from ..kernels.equations import Array


class Course(NamedTuple):
    """The heat of the neighbours at the last accepted steps, newest first, and the parabola through it."""

    time: Array  # shape (3,)
    value: Array  # shape (3, N)
    first: Array  # shape (N,), divided differences
    second: Array


@inlined
def advance(course: Course, known: int, t: float, value: Array) -> None:
    """Add the values at ``t`` as those of ``known`` steps; fewer than three points give a line or a constant."""
    for j in range(2):
        course.time[2 - j] = course.time[1 - j]
        course.value[2 - j] = course.value[1 - j]
    course.time[0] = t
    course.value[0] = value
    if known > 1:
        now, then = course.time[0] - course.time[1], course.time[1] - course.time[2]
        for i in range(value.size):
            course.first[i] = (course.value[0, i] - course.value[1, i]) / now
            if known > 2:
                early = (course.value[1, i] - course.value[2, i]) / then
                course.second[i] = (course.first[i] - early) / (course.time[0] - course.time[2])


@inlined
def extrapolate(course: Course, t: float, value: Array) -> None:
    """Write the parabola at ``t``."""
    u = t - course.time[0]
    v = u * (t - course.time[1])
    for i in range(value.size):
        value[i] = course.value[0, i] + course.first[i] * u + course.second[i] * v
