"""Mesh refinement at the largest estimated errors, until the error of every judged channel is below the target.

At every shift whose error is above `AIM` of the target the triangles with the largest shares are divided: as few of
them as bring the sum down to `AIM` if dividing leaves `LEFT` of a share, or those with `BULK` of the sum where even all
would not do (W. Doerfler, SIAM J. Numer. Anal. 33, 1106 (1996)).
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array, NDArray
from .accuracy import Estimate

AIM = 0.8  # of the target
LEFT = 0.15  # of the share of a triangle after it was divided in four: 1/16 where the field is smooth, 0.4 at a corner
BULK = 0.8  # of the sum


def marked(estimate: Estimate, target: float) -> NDArray[np.bool_]:
    """Select the triangles to divide."""
    chosen = np.zeros(0, dtype=bool)
    for channel, errors in estimate.errors.items():
        own = target / max(estimate.weights[channel], 1e-12)
        for error, share in zip(errors, estimate.shares[channel], strict=True):
            chosen = chosen if chosen.size else np.zeros(share.size, dtype=bool)
            if error > own:
                chosen |= _largest(share, AIM * own)
    return chosen


def _largest(share: Array, wanted: float) -> NDArray[np.bool_]:
    """The fewest triangles whose division reduces the sum of the shares to ``wanted``, at most `BULK` of it."""
    order = np.argsort(share)[::-1]
    so_far, total = np.cumsum(share[order]), float(share.sum())
    needed = min((total - wanted) / (1 - LEFT), BULK * total)
    chosen = np.zeros(share.size, dtype=bool)
    chosen[order[: int(np.searchsorted(so_far, needed)) + 1]] = True
    return chosen
