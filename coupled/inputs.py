"""Laser power and detuning as piecewise cubics of time; the integration ends a step at every edge.

An input of a ring is a number, a waveform (`th.Function` for any function of time), a piecewise polynomial, or a
list of these, which add: a bias with a pulse on it is ``[2e-3, th.Pulse(power=1e-3, width=10e-9, start=5e-6)]``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from thermofem import checks
from thermofem.arrays import Array, ArrayLike
from thermofem.piecewise import Pieces as Pieces
from thermofem.piecewise import bounds as bounds
from thermofem.waveforms import Samples, Waveform

Input: TypeAlias = "float | Waveform | Pieces | Sequence[Any]"
DEGREE = 3
DEEPEST = 10  # lists in lists


@dataclass(frozen=True, eq=False)
class Sweep(Samples, stored=False):
    """A detuning (or another signed quantity) that is linear between given samples, such as a swept laser.

    Two samples at one time make a jump.

    Parameters
    ----------
    times : array, s
        increasing; a time may stand twice.
    values : array, same length
        Hz for a detuning, W for a power.

    >>> Sweep([0, 10e-6], [5e9, -5e9])(2e-6)
    array(3.e+09)
    """

    times: ArrayLike
    values: ArrayLike

    def __post_init__(self) -> None:
        values = checks.array("values", self.values)
        self._check(values)
        object.__setattr__(self, "values", values)


def pieces(name: str, value: Any, start: float, stop: float) -> Pieces:
    """Turn an input into a piecewise cubic over [start, stop] in s.

    name: name of the input in error messages.
    value [float, Waveform, Pieces, scipy.interpolate.PPoly of degree 3 or less, or a list of these, which add]
    Raises InputError: another type, or a function that does not cover the whole window.
    """
    if isinstance(value, list | tuple) and not isinstance(value, Pieces):
        if name.count("[") >= DEEPEST:  # such as a list that holds itself
            raise checks.InputError(f"{name} is a list in lists; at most {DEEPEST} deep are added")
        if not value:
            raise checks.InputError(f"{name} is an empty list; give a number, a waveform, or a list of them, which add")
        return add([pieces(f"{name}[{k}]", item, start, stop) for k, item in enumerate(value)])
    whole = np.array([start, stop])
    if isinstance(value, Pieces):
        return _window(name, value, start, stop)
    if hasattr(value, "c") and hasattr(value, "x"):
        c = _powers(name, value)
        if c.ndim != 2 or len(c) > DEGREE + 1:
            raise checks.InputError(f"{name} is a polynomial with coefficients {c.shape}; at most cubic, and scalar")
        coefficients = np.vstack([c[::-1], np.zeros((DEGREE + 1 - len(c), c.shape[1]))]).T
        return _window(name, Pieces(np.asarray(value.x, dtype=float), coefficients), start, stop)
    if isinstance(value, Waveform):
        return value.pieces(start, stop)
    return Pieces(whole, np.array([[checks.finite(name, value), 0.0, 0.0, 0.0]]))


def _powers(name: str, value: Any) -> Array:
    """Coefficients of a piecewise polynomial of SciPy, highest power first."""
    from scipy.interpolate import PPoly

    if not isinstance(value, PPoly):  # such as BPoly, whose coefficients are those of Bernstein polynomials
        hint = "PPoly.from_bernstein_basis makes a PPoly of a BPoly, PPoly.from_spline of a BSpline"
        raise checks.InputError(f"{name} is a {type(value).__name__}; a PPoly is needed", hint)
    return checks.numbers(f"{name}: coefficients", value.c)


def add(parts: list[Pieces]) -> Pieces:
    """The sum of functions on one window."""
    edges = joint(*parts)
    return Pieces(edges, np.sum([part.on(edges).coefficients for part in parts], axis=0))


def joint(*parts: Pieces) -> Array:
    """The union of all edges; edges closer than round-off of the window are merged."""
    edges = np.unique(np.concatenate([part.edges for part in parts]))
    hair = 4e-16 * np.abs(edges[[0, -1]]).max()
    keep = np.concatenate([[True], np.diff(edges) > hair])
    return np.append(edges[keep][:-1], edges[-1]) if keep.sum() > 1 else edges


def _window(name: str, function: Pieces, start: float, stop: float) -> Pieces:
    """The part of a piecewise cubic between two times, which it must cover."""
    edges, slack = function.edges, 1e-9 * (stop - start)
    if start < edges[0] - slack or stop > edges[-1] + slack:
        raise checks.InputError(
            f"{name} is given from {edges[0]:g} to {edges[-1]:g} s; it must cover {start:g} to {stop:g} s"
        )
    inside = edges[(edges > start + 1e-6 * slack) & (edges < stop - 1e-6 * slack)]
    return function.on(np.concatenate([[start], inside, [stop]]))
