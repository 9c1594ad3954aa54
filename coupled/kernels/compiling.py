"""How the package compiles: two decorators, and a cache that notices an edit in another file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from numba import njit

# Sums may be reordered and fused; NaN and infinity keep their meaning, which the step control relies on.
_FAST = {"contract", "reassoc", "nsz", "arcp"}

compiled = njit(cache=True, nogil=True, error_model="numpy", fastmath=_FAST)
inlined = njit(cache=True, nogil=True, error_model="numpy", fastmath=_FAST, forceinline=True)


def forget_if_older(kernel: Any, source: str) -> None:
    """Delete the cached machine code of the kernel's module when ``source``, a file whose functions it calls, is newer.

    Numba compares a cache with the kernel's own file only.
    """
    edited, module = Path(source).stat().st_mtime, kernel.__module__.rpartition(".")[2]
    for index in Path(kernel.stats.cache_path).glob(f"{module}.*.nbi"):
        if index.stat().st_mtime < edited:
            index.unlink(missing_ok=True)
