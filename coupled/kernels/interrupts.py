"""Ctrl-C and compiled code: an exception raised while a kernel hands its results over crashes the interpreter."""

from __future__ import annotations

import signal
import threading
from typing import Any


def uninterrupted(kernel: Any, *arguments: Any) -> Any:
    """Call a compiled kernel, and let Ctrl-C through when it has returned; a second one, or one that compiles, at once.

    Python runs its signal handlers between two of its own instructions. While a kernel runs there is none, but numba
    runs some to turn results into objects: a KeyboardInterrupt raised there ends in a SystemError or a crash.
    """
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        return kernel(*arguments)  # signals go to the main thread only, or nobody listens
    if not kernel.signatures:
        kernel.compile(tuple(kernel.typeof_pyval(argument) for argument in arguments))
    came: list[Any] = []

    def hold(number: int, frame: Any) -> None:
        if came:
            before(number, frame)
        came.append((number, frame))

    signal.signal(signal.SIGINT, hold)
    try:
        return kernel(*arguments)
    finally:
        signal.signal(signal.SIGINT, before)
        if came:
            before(*came[0])
