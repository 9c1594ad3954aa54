"""How the package compiles: decorators, and a cache that loads fast and notices an edit in another file."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from thermofem.checks import InputError

try:
    from numba import config, njit
except ValueError as error:  # it reads its variables of the environment
    raise InputError(f"Numba does not start: {error} Look at the variables NUMBA_... of the environment") from None
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.compiler_lock import global_compiler_lock as global_compiler_lock  # other modules take Numba from here
from numba.core.runtime import rtsys
from numba.extending import overload as overload
from numba.extending import register_jitable

if config.DISABLE_JIT:
    raise InputError("NUMBA_DISABLE_JIT is set: light and carriers run as compiled code alone; unset it")

_log = logging.getLogger(__name__)

# Sums may be reordered and fused; NaN and infinity keep their meaning, which the step control relies on.
_FAST = {"contract", "reassoc", "nsz", "arcp"}

# What nobody uses is not made: an entry for C, and in what only compiled code calls (`overload`) the one for Python.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": _FAST, "no_cfunc_wrapper": True}
_seen: set[str] = set()  # files whose own outdated caches are gone
_kept: dict[str, bool] = {}  # folder of sources -> whether machine code of its functions can be stored


class _Stored(CompileResultCacheImpl):
    """What of a compiled function goes to the disk."""

    def reduce(self, cres: Any) -> Any:
        """Leave out environments without constants: machine code reads nothing else, and each imports its module.

        NumPy's arrays in Numba are such a module: .08 CPU s.

        Raises KeyboardInterrupt: it came in a function that LLVM called, where Python drops it and the code is lost.
        """
        try:
            *kept, environments = super().reduce(cres)
        except RuntimeError as error:
            if "no compiled object yet" not in str(error):
                raise
            raise KeyboardInterrupt from None
        return (*kept, tuple(one for one in environments if one.consts))


class StoredCode(FunctionCache):
    """A cache that loads machine code without the registries that a compilation needs.

    `FunctionCache` fills them at the first load, .5 CPU s for what the stored code no longer asks. The runtime that
    counts references is all that it calls. What is not stored is compiled with the registries filled, as usual.
    """

    _impl_class = _Stored

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled function for a signature, or None where none is stored."""
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            found = self._load_overload(sig, target_context)
            if found is None:
                say_that_it_compiles()
            return found


@cache
def say_that_it_compiles() -> None:
    """Tell a person at a terminal, once, why the first run of an installation takes longer."""
    said = "compiling the equations of light and carriers for this machine: once, for up to a minute"
    _log.info(said)
    if sys.stderr is not None and sys.stderr.isatty():
        print(said, file=sys.stderr)


def compiled(function: Callable[..., Any]) -> Any:
    """Compile when first called."""
    return _made(function, njit, nogil=True)


def inner(function: Callable[..., Any]) -> Any:
    """Compile for the compiled functions that call it; called from Python it runs as Python."""
    return _made(function, register_jitable)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile into the compiled functions that call it; called from Python it runs as Python."""
    return _made(function, register_jitable, forceinline=True)


def lean(function: Callable[..., Any]) -> Any:
    """Compile when first called, without counting references: for a function that makes no array.

    Counting is atomic: for each of the many small arrays of a step it takes as long as a short loop.
    """
    return _made(function, njit, nogil=True, _nrt=False)


def inlined_lean(function: Callable[..., Any]) -> Any:
    """Compile into the caller, without counting references: for a function that makes no array."""
    return _made(function, njit, nogil=True, forceinline=True, _nrt=False)


def merged(function: Callable[..., Any]) -> Any:
    """Run as Python when called from Python, and become part of a compiled caller.

    For what calls large kernels in turn: compiled on its own it would hold, and optimise, a second copy of each. The
    caller imports it by its own name: Numba looks for what it inlines among the globals.
    """
    merging: Any = function
    merging.py_func, merging.targetoptions = function, {"inline": "always"}  # what Numba asks what it is to inline
    return register_jitable(function)


def storable(function: Callable[..., Any]) -> bool:
    """Whether machine code of a function can be stored: beside its file, or else in the user's cache folder.

    A system account has neither where the installation is read-only and its home does not exist.
    """
    folder = str(Path(function.__code__.co_filename).parent)
    if folder not in _kept:
        try:
            StoredCode(function)
        except RuntimeError:  # Numba: no locator
            if all(_kept.values()):
                _log.warning(
                    "no folder for machine code is writable: every run compiles it; set NUMBA_CACHE_DIR to one"
                )
            _kept[folder] = False
        else:
            _kept[folder] = True
    return _kept[folder]


def _made(function: Callable[..., Any], decorator: Callable[..., Any], **options: Any) -> Any:
    """Compile with these options, and store the machine code where that is possible."""
    stored = storable(function)
    kernel = decorator(cache=stored, **options, **OPTIONS)(function)
    return _fresh(kernel) if stored else kernel


def _fresh(kernel: Any) -> Any:
    """Give a kernel its cache, without what an earlier version of its file left: Numba reads that, and fails."""
    source = getattr(kernel, "py_func", kernel).__code__.co_filename
    if hasattr(kernel, "py_func"):
        kernel._cache = StoredCode(kernel.py_func)
    if source not in _seen:
        _seen.add(source)
        forget_if_older(kernel, source)
    return kernel


def forget_if_older(kernel: Any, source: str) -> None:
    """Delete the cached machine code of the kernel's module when ``source``, a file whose functions it calls, is newer.

    Numba compares a cache with the kernel's own file only.
    """
    if not hasattr(kernel, "stats") and not storable(kernel):
        return
    edited, module = Path(source).stat().st_mtime, kernel.__module__.rpartition(".")[2]
    where = kernel.stats.cache_path if hasattr(kernel, "stats") else StoredCode(kernel).cache_path
    for index in Path(where).glob(f"{module}.*.nbi") if where else ():  # none where no code can be stored
        with suppress(FileNotFoundError):  # another process may delete it first
            if index.stat().st_mtime < edited:
                index.unlink()
