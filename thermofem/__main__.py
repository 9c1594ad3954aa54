"""The command ``thermofem``, and ``python -m thermofem``.

Ctrl-C while a library is imported, or in the functions that LLVM calls when code is compiled, would be swallowed by
some libraries and end in a traceback of others. No file is open then, so that the process ends at once.
"""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

CALLED_BY_LLVM = ("_raw_object_cache_notify", "_raw_object_cache_getbuffer")


def run() -> None:
    """Run the command line; from here on Ctrl-C is one line on standard error and exit code 130."""
    _open_streams()
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)
    from .cli import main

    main()


def _open_streams() -> None:
    """Open the null device where the caller closed a standard stream: the first file would be taken for that stream."""
    while (number := os.open(os.devnull, os.O_RDWR)) < 3:
        pass
    os.close(number)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - until the end


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
