"""The command ``thermofem``, and ``python -m thermofem``.

Ctrl-C while a library is imported, or in the functions that LLVM calls when code is compiled, would be swallowed by
some libraries and end in a traceback of others. No file is open then, so that the process ends at once.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from importlib.machinery import SourceFileLoader
from importlib.util import cache_from_source
from types import CodeType, FrameType

CALLED_BY_LLVM = ("_raw_object_cache_notify", "_raw_object_cache_getbuffer")


def run() -> None:
    """Run the command line; from here on Ctrl-C is one line on standard error and exit code 130."""
    _open_streams()
    _compile_what_is_cut()
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)
    from thermofem_cli import main

    main()


def _open_streams() -> None:
    """Open the null device where the caller closed a standard stream: the first file would be taken for that stream."""
    while (number := os.open(os.devnull, os.O_RDWR)) < 3:
        pass
    os.close(number)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - until the end


def _compile_what_is_cut() -> None:
    """Have modules compiled again whose stored byte code a full disk cut off.

    Python before 3.13 keeps such a file, and ends every later start with an EOFError (CPython issue 126606).
    """
    load = SourceFileLoader.get_code

    def load_whole(loader: SourceFileLoader, name: str) -> CodeType | None:
        try:
            return load(loader, name)
        except EOFError:
            source = loader.get_filename(name)
            with contextlib.suppress(OSError):
                os.remove(cache_from_source(source))
            return loader.source_to_code(loader.get_data(source), source)

    SourceFileLoader.get_code = load_whole  # type: ignore[method-assign,assignment]


def _interrupt(number: int, frame: FrameType | None) -> None:
    """End the process where KeyboardInterrupt would be lost, unless a file is being written; else raise it."""
    lost, at = False, frame
    while at is not None:
        lost |= at.f_code.co_filename.startswith("<frozen importlib") or at.f_code.co_name in CALLED_BY_LLVM
        if at.f_code.co_name == "write_whole":  # `files`: it takes its temporary file away
            lost = False
            break
        at = at.f_back
    if not lost:
        raise KeyboardInterrupt
    os.write(2, b"thermofem: interrupted\n")
    os._exit(130)


if __name__ == "__main__":
    run()
