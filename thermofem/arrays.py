"""Types of arrays, for annotations, and what several modules do with arrays."""

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike as ArrayLike
from numpy.typing import NDArray as NDArray

Array: TypeAlias = NDArray[np.float64]
Complex: TypeAlias = NDArray[np.complex128]

PIECE = 10_000_000  # numbers of an intermediate array


def in_pieces(function: Callable[[Any], Any], x: NDArray[Any], width: int) -> NDArray[Any]:
    """Evaluate ``function(x[..., None])`` in chunks, so that its (x.size, width) intermediate stays below `PIECE`."""
    if x.size * width <= PIECE:
        return np.asarray(function(x[..., None]))
    pieces = np.array_split(x.ravel(), -(-x.size * width // PIECE))
    return np.concatenate([function(piece[:, None]) for piece in pieces]).reshape(x.shape)


def runs_of(holds: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First index of each run of true values, and the index after its last.

    >>> runs_of(np.array([True, True, False, True]))
    [(0, 2), (3, 4)]
    """
    change = np.diff(np.concatenate([[0], holds.astype(int), [0]]))
    starts, stops = (np.flatnonzero(change == step).tolist() for step in (1, -1))
    return list(zip(starts, stops, strict=True))
