"""A thermal model as a network: what SPICE and Verilog-A write down, each in its own words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from thermofem import checks
from thermofem.arrays import Array

from .header import identifiers
from .modes import modes


@dataclass(frozen=True, eq=False)
class PoleCircuit:
    """R parallel to C for each pole, and how the pins are coupled to them.

    R, C [shape (n,), K/W and J/K]
    turns [shape (n, inputs)]: share of the power into each heated pin that enters each pole; None: one pin, all poles
        in series (Foster).
    reads [shape (outputs, n)]: share of each pole's temperature in each pin that is read.
    pins: every part once, heated ones first.
    heated, read: pins of the columns of ``turns`` and of the rows of ``reads``.
    coefficient [1/K]: of the output map dT = z + coefficient z^2, or 0.
    """

    R: Array
    C: Array
    turns: Array | None
    reads: Array
    pins: list[str]
    heated: list[int]
    read: list[int]
    coefficient: float

    def read_by(self, pin: int) -> Array | None:
        """Shares of the poles in a pin's temperature; None for a pin that is heated only."""
        return self.reads[self.read.index(pin)] if pin in self.read else None


def network(model: Any, *, taken: tuple[str, ...]) -> PoleCircuit:
    """The network of a model of independent poles; pins are named after the parts, none of them as ``taken``."""
    found = modes(model)
    if not found.rate.size:
        raise checks.InputError("model has R = 0 K/W at every pole: it never warms up, and is no circuit")
    parts = list(dict.fromkeys([*found.inputs, *found.outputs]))
    pins = identifiers(parts, taken=taken)
    heated, read = [parts.index(p) for p in found.inputs], [parts.index(p) for p in found.outputs]
    if len(parts) == 1 and not found.coefficient:  # one pin and a linear model
        size, turns = found.B[:, 0] * found.C[0], None
    else:
        size = np.abs(found.B).max(axis=1)
        turns = found.B / size[:, None]
    return PoleCircuit(size / found.rate, 1 / size, turns, found.C, pins, heated, read, found.coefficient)
