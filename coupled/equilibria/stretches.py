"""The stretches of a curve within a window: to round-off, however small the window is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from thermofem.arrays import Array, runs_of

from .roots import crossings

Drawn = Callable[[Array], Array]  # of the parameter of a curve, shape (n,); coordinates, shape (m, n)


def stretches(seen: Drawn, grid: Array) -> list[tuple[float, float]]:
    """The intervals of the parameter in which every coordinate lies in [0, 1], in increasing order.

    seen: the coordinates as fractions of the window.
    grid: of the parameter, fine enough that a coordinate turns at most once between two of its points.
    """
    rows = range(len(seen(grid[:1])))
    borders = [crossings(lambda s, k=k, end=end: seen(s)[k] - end, grid) for k in rows for end in (0.0, 1.0)]  # type: ignore[misc]
    ends = np.unique(np.concatenate([grid[[0, -1]], *borders]))
    middles = seen((ends[1:] + ends[:-1]) / 2)
    inside = np.all((middles >= 0) & (middles <= 1), axis=0)
    return [(float(ends[a]), float(ends[b])) for a, b in runs_of(inside)]


def spread(drawn: Drawn, parts: list[tuple[float, float]], count: int) -> list[Array]:
    """Points at equal distances in the drawn plane on parts of a curve, with their ends; at most ``count`` in all."""
    fine = [np.linspace(low, high, count) for low, high in parts]
    shown = [drawn(s) for s in fine]
    size = np.maximum(np.ptp(np.concatenate(shown, axis=1), axis=1), 1e-300)[:, None]
    steps = [np.sqrt(np.sum((np.diff(points, axis=1) / size) ** 2, axis=0)) for points in shown]
    lengths = [np.concatenate([[0], np.cumsum(step)]) for step in steps]
    total = max(sum(length[-1] for length in lengths), 1e-300)
    counts = [2 + int((count - 2 * len(parts)) * length[-1] / total) for length in lengths]
    return [
        np.interp(np.linspace(0, length[-1], number), length, s)
        for s, length, number in zip(fine, lengths, counts, strict=True)
    ]
