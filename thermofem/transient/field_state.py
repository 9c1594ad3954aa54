"""A field between two windows of `deflation`, and what its steps leave to read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..arrays import Array, ArrayLike
from .esdirk import STAGE_TIMES
from .fast_part import FastPart

# coefficients of the cubic of `Inside` from its four numbers
CUBIC = np.linalg.inv(np.stack([np.arange(4) == 0, STAGE_TIMES[3] ** np.arange(4), np.ones(4), np.arange(4)]))


@dataclass(frozen=True, eq=False)
class FieldState:
    """A field x = V z + r at one time, and the data from which the next step starts.

    time [s]
    z, r [shape (k,) and (n,)]
    slope [shape (n,)]: the time derivative in the equation of the module at the end of the last step: E^-1 times it
        where the system is linear, in W where it is not.
    source [shape (inputs + k,)]: the P and z that this slope was computed with.
    step [s]: length of the last step; 0 before the first.
    heat_in, heat_out [J]: since the start.
    correction [shape (n,), W]: what `FieldIntegrator._correction` has added to the slope.
    """

    time: float
    z: Array
    r: Array
    slope: Array
    source: Array
    step: float = 0.0
    heat_in: float = 0.0
    heat_out: float = 0.0
    correction: Array | float = 0.0


class Inside(NamedTuple):
    """The remainder r in a step, or its outputs: a cubic through both ends, the third stage and the slope at the end.

    The slope at the beginning has no part: it holds what the last step left of fast modes, and what the cubics of the
    power differ by, which is gone after a small part of the step.
    """

    first: Array
    middle: Array
    last: Array
    rate: Array
    """h dr/dt at the end."""

    def __call__(self, u: ArrayLike) -> Array:
        """At the fractions u of the step, shape (*u.shape, components)."""
        return np.asarray((np.asarray(u)[..., None] ** np.arange(4)) @ CUBIC @ np.stack(self))


class Advanced(NamedTuple):
    """A window that was advanced, for `FieldIntegrator.revised`."""

    begin: FieldState
    fast: FastPart
    steps: list[tuple[float, float, Inside]]
    """Start and length in s, and the outputs of the remainder."""
    end: FieldState
    fields: Array
