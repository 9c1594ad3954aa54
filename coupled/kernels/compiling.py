"""How the package compiles: two decorators, and a cache that notices an edit in another file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit

# Sums may be reordered and fused; NaN and infinity keep their meaning, which the step control relies on.
_FAST = {"contract", "reassoc", "nsz", "arcp"}

_compile = njit(cache=True, nogil=True, error_model="numpy", fastmath=_FAST)
_inline = njit(cache=True, nogil=True, error_model="numpy", fastmath=_FAST, forceinline=True)
_lean = njit(cache=True, nogil=True, error_model="numpy", fastmath=_FAST, _nrt=False)
_inline_lean = njit(cache=True, nogil=True, error_model="numpy", fastmath=_FAST, forceinline=True, _nrt=False)
_seen: set[str] = set()  # files whose own outdated caches are gone


def compiled(function: Callable[..., Any]) -> Any:
    """Compile when first called."""
    return _fresh(_compile(function))


def inlined(function: Callable[..., Any]) -> Any:
    """Compile into the caller."""
    return _fresh(_inline(function))


def lean(function: Callable[..., Any]) -> Any:
    """Compile when first called, without counting references: for a function that makes no array.

    Counting is atomic: for each of the many small arrays of a step it takes as long as a short loop.
    """
    return _fresh(_lean(function))


def inlined_lean(function: Callable[..., Any]) -> Any:
    """Compile into the caller, without counting references: for a function that makes no array."""
    return _fresh(_inline_lean(function))


def _fresh(kernel: Any) -> Any:
    """Delete what an earlier version of the file left: Numba reads it, and fails, before it sees that it is old."""
    source = kernel.py_func.__code__.co_filename
    if source not in _seen:
        _seen.add(source)
        forget_if_older(kernel, source)
    return kernel


def forget_if_older(kernel: Any, source: str) -> None:
    """Delete the cached machine code of the kernel's module when ``source``, a file whose functions it calls, is newer.

    Numba compares a cache with the kernel's own file only.
    """
    edited, module = Path(source).stat().st_mtime, kernel.__module__.rpartition(".")[2]
    for index in Path(kernel.stats.cache_path).glob(f"{module}.*.nbi"):
        if index.stat().st_mtime < edited:
            index.unlink(missing_ok=True)
