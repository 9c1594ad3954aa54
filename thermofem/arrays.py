"""Types of arrays, for annotations."""

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike as ArrayLike
from numpy.typing import NDArray as NDArray

Array: TypeAlias = NDArray[np.float64]
Complex: TypeAlias = NDArray[np.complex128]

PIECE = 10_000_000  # numbers of an intermediate array


def in_pieces(function: Callable[[Any], Any], x: NDArray[Any], width: int) -> NDArray[Any]:
    """``function`` of a column of x, which makes a row of ``width`` numbers of each and sums it, in bounded memory."""
    if x.size * width <= PIECE:
        return np.asarray(function(x[..., None]))
    pieces = np.array_split(x.ravel(), -(-x.size * width // PIECE))
    return np.concatenate([function(piece[:, None]) for piece in pieces]).reshape(x.shape)
