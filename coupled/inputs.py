"""Laser power and detuning as piecewise cubics of time; the integration ends a step at every edge.

An input of a ring is a number, a waveform (`th.Function` for any function of time), a piecewise polynomial, or a
list of these, which add: a bias with a pulse on it is ``[2e-3, th.Pulse(power=1e-3, width=10e-9, start=5e-6)]``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thermofem import checks
from thermofem.display import shown
from thermofem.waveforms import Pieces as Pieces
from thermofem.waveforms import Waveform, cubic_pieces, linear_pieces
from thermofem.waveforms import bounds as bounds
from thermofem.waveforms.contract import seconds

Array = NDArray[np.float64]
Input: TypeAlias = "float | Waveform | Pieces | Sequence[Any]"
DEGREE = 3


@shown
@dataclass(frozen=True, eq=False)
class Sweep:
    """A detuning (or another signed quantity) that is linear between given samples, such as a swept laser.

    Keeps the contract of `thermofem.waveforms`; two samples at one time make a jump.

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
    piecewise_linear: ClassVar[bool] = True
    period: ClassVar[None] = None

    def __post_init__(self) -> None:
        times, values = checks.array("times", self.times, increasing=True), checks.array("values", self.values)
        if times.size != values.size or times.size < 2:
            raise checks.InputError(
                f"times has {times.size} samples, values {values.size}; both need the same, at least 2"
            )
        if times[0] == times[1] or times[-1] == times[-2] or np.any(times[2:] == times[:-2]):
            raise checks.InputError("times must not begin or end with a jump, nor hold a time more than twice")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "values", values)

    def _at(self, t: ArrayLike, side: str) -> Array:
        times, values, t = np.asarray(self.times), np.asarray(self.values), seconds(t)
        slack = 1e-9 * (times[-1] - times[0])
        outside = (t < times[0] - slack) | (t > times[-1] + slack)
        if np.any(outside):
            raise checks.InputError(
                f"the sweep is asked for at t = {np.atleast_1d(t)[np.atleast_1d(outside)][0]:g} s and has samples "
                f"from {times[0]:g} to {times[-1]:g} s; give samples that cover the run"
            )
        k = np.clip(np.searchsorted(times, t, side=side) - 1, 0, times.size - 2)  # type: ignore[call-overload]
        length = times[k + 1] - times[k]
        share = np.where(length > 0, (t - times[k]) / np.where(length > 0, length, 1.0), side == "right")
        return np.asarray(values[k] + share * (values[k + 1] - values[k]))

    def __call__(self, t: ArrayLike) -> Array:
        """The value at ``t``, continuous from the right."""
        return self._at(t, "right")

    def before(self, t: ArrayLike) -> Array:
        """The value just before ``t``."""
        return self._at(t, "left")

    def breakpoints(self, start: float, stop: float) -> Array:
        """Every sample inside."""
        times = np.unique(np.asarray(self.times))
        return times[(times > start) & (times < stop)]

    def mean(self, start: float, stop: float) -> float:
        """Trapezoids between the samples, which is exact."""
        edges, after, before = linear_pieces(self, start, stop)
        return float(np.sum(np.diff(edges) * (after + before)) / 2 / (stop - start))


def pieces(name: str, value: Any, start: float, stop: float) -> Pieces:
    """Turn an input into a piecewise cubic over [start, stop] in s.

    Parameters
    ----------
    name : str
        name of the input in error messages.
    value : float, Waveform, Pieces, scipy.interpolate.PPoly of degree 3 or less, or a list of these, which add

    Raises
    ------
    InputError
        another type, or a function that does not cover the whole window.
    """
    if isinstance(value, list | tuple) and not isinstance(value, Pieces):
        if not value:
            raise checks.InputError(f"{name} is an empty list; give a number, a waveform, or a list of them, which add")
        return add([pieces(f"{name}[{k}]", item, start, stop) for k, item in enumerate(value)])
    whole = np.array([start, stop])
    if isinstance(value, Pieces):
        return _window(name, value, start, stop)
    if hasattr(value, "c") and hasattr(value, "x"):  # a piecewise polynomial of SciPy, highest power first
        c = np.asarray(value.c, dtype=float)
        if c.ndim != 2 or len(c) > DEGREE + 1:
            raise checks.InputError(f"{name} is a polynomial with coefficients {c.shape}; at most cubic, and scalar")
        coefficients = np.vstack([c[::-1], np.zeros((DEGREE + 1 - len(c), c.shape[1]))]).T
        return _window(name, Pieces(np.asarray(value.x, dtype=float), coefficients), start, stop)
    if hasattr(value, "breakpoints"):
        return cubic_pieces(value, start, stop)
    return Pieces(whole, np.array([[checks.finite(name, value), 0.0, 0.0, 0.0]]))


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
