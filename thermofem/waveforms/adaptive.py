"""Any function of time as a piecewise cubic, with error control and a search for narrow features."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import checks
from .contract import Array, Waveform

LEVELS = 13  # a stretch without breakpoints is looked at in 2^13 cells: a pulse of 1e-4 of it is seen
FEWEST_LEVELS = 6  # where there are many stretches
BUDGET = 2**17  # cells of all stretches together
MOST_LEVELS = 22  # if the time scale requires more
MOST_PIECES = 200_000
SHORTEST = 1e-12  # of a stretch: a shorter cell that does not fit contains a jump that is no breakpoint
NODES = np.array([0, 1 / 3, 2 / 3, 1])
CHECKED = np.array([0.1273, 0.4529, 0.5471, 0.8727])  # of a cell; not evenly spaced, so that they miss no harmonic
_TO_COEFFICIENTS = np.linalg.inv(NODES[:, None] ** np.arange(4)).T  # values at the nodes @ this = coefficients of u^j


def fitted(wave: Waveform, start: float, stop: float, tolerance: float) -> tuple[Array, Array]:
    """Edges and coefficients of a piecewise cubic within ``tolerance`` of the largest value, at all checked times.

    Each stretch between breakpoints is halved until the cubic through four points of a cell agrees with the function
    at every checked time in it. These are in 2^13 cells a stretch (or as many as ``wave.time_scale`` needs), so a
    feature narrower than 1e-4 of the stretch may be missed unless a breakpoint or a time scale names it.

    start, stop [s]
    Returns edges [shape (n + 1,), s]
    Returns coefficients [shape (n, 4)]: of (t - edges[k])^j.
    Raises InputError: more than 200 000 pieces are needed.
    """
    marks = np.concatenate([[start], wave.breakpoints(start, stop), [stop]])
    levels = _levels(wave, marks)
    checked = [_checked(wave, a, b, 2**level) for a, b, level in zip(marks[:-1], marks[1:], levels, strict=True)]
    peak = max(float(np.abs(values).max()) for _, values in checked)
    allowed = max(tolerance * peak, np.finfo(float).tiny)
    cells = [
        _stretch(wave, float(a), float(b), level, seen, allowed)
        for a, b, level, seen in zip(marks[:-1], marks[1:], levels, checked, strict=True)
    ]
    edges = np.append(np.concatenate([c[0] for c in cells]), stop)
    return edges, np.concatenate([c[1] for c in cells])


def _levels(wave: Waveform, marks: Array) -> list[int]:
    """Halvings of every stretch down to the cells that are checked."""
    lengths = np.diff(marks)
    shared = int(np.clip(np.log2(BUDGET / lengths.size), FEWEST_LEVELS, LEVELS))
    scale = getattr(wave, "time_scale", None)
    asked = np.ceil(np.log2(lengths / scale)) if scale else np.zeros(lengths.size)
    if asked.max() > MOST_LEVELS:
        raise checks.InputError(
            f"time_scale = {scale:g} s is less than 1/{2**MOST_LEVELS:g} of a run of {lengths.max():g} s; "
            "give breakpoints around the short features instead"
        )
    return np.maximum(asked, shared).astype(int).tolist()


def _checked(wave: Waveform, a: float, b: float, cells: int) -> tuple[Array, Array]:
    """Times inside every cell, sorted, and the values there."""
    times = a + (b - a) * ((np.arange(cells)[:, None] + CHECKED) / cells).ravel()
    return times, np.asarray(wave(times), dtype=float)


def _stretch(
    wave: Waveform, a: float, b: float, level: int, seen: tuple[Array, Array], allowed: float
) -> tuple[Array, Array]:
    """Left edges and coefficients over one stretch without breakpoints."""
    left, length = np.array([a]), b - a
    done: list[tuple[Array, Array]] = []
    depth = 0
    while left.size:
        size = length / 2**depth
        last = np.minimum(left + size, b)
        at = left[:, None] + (last - left)[:, None] * NODES
        values = np.asarray(wave(at), dtype=float)
        values[:, -1] = wave.before(last)
        scaled = values @ _TO_COEFFICIENTS
        bad = _misfits(wave, left, last, scaled, seen if depth < level else None, allowed)
        if size <= SHORTEST * length:  # a jump: constant up to the end of the cell, where a cubic would overshoot
            scaled[bad] = values[bad, :1] * [1.0, 0.0, 0.0, 0.0]
            bad[:] = False
        h = (last - left)[~bad, None]
        done.append((left[~bad], scaled[~bad] / h ** np.arange(4)))
        if sum(d[0].size for d in done) + 2 * bad.sum() > MOST_PIECES:
            raise checks.InputError(
                f"the {type(wave).__name__} changes too fast between {a:g} and {b:g} s: more than {MOST_PIECES} cubics "
                "are needed; is it noise? give samples of it (th.Sampled), or breakpoints where it jumps"
            )
        middle = left[bad] + size / 2
        left = np.sort(np.concatenate([left[bad], middle]))
        depth += 1
    edges = np.concatenate([d[0] for d in done])
    order = np.argsort(edges)
    return edges[order], np.concatenate([d[1] for d in done])[order]


def _misfits(
    wave: Waveform, left: Array, last: Array, scaled: Array, seen: tuple[Array, Array] | None, allowed: float
) -> NDArray[np.bool_]:
    """Which cells differ from the function by more than ``allowed`` at a checked time."""
    if seen is None:
        u = np.broadcast_to(CHECKED, (left.size, CHECKED.size))
        values = np.asarray(wave(left[:, None] + (last - left)[:, None] * u), dtype=float)
        return np.any(np.abs(cubic(scaled[:, None], u) - values) > allowed, axis=1)
    times, values = seen
    first, end = np.searchsorted(times, left), np.searchsorted(times, last)
    cell = np.repeat(np.arange(left.size), end - first)
    index = np.arange(cell.size) + np.repeat(first - np.append(0, np.cumsum(end - first)[:-1]), end - first)
    u = (times[index] - left[cell]) / (last - left)[cell]
    off = np.abs(cubic(scaled[cell], u) - values[index]) > allowed
    return np.bincount(cell[off], minlength=left.size) > 0


def cubic(coefficients: Array, u: Array) -> Array:
    """Values at ``u`` of cubics with coefficients of rising powers along the last axis."""
    a, b, c, d = np.moveaxis(coefficients, -1, 0)
    return np.asarray(a + u * (b + u * (c + u * d)))
