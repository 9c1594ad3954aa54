"""Processes that a command has started, and waiting for them."""

from __future__ import annotations

import time
from pathlib import Path


def children(parent: int) -> list[int]:
    """Processes that this one has started, and those that they have, from /proc."""
    found: list[int] = []
    for entry in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = entry.read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        if int(fields[1]) == parent and fields[0] != "Z":
            found += [int(entry.parent.name), *children(int(entry.parent.name))]
    return found


def helpers(parent: int, kind: str = "") -> list[int]:
    """Workers of a command and the server that starts them; of ``kind`` "server" or "worker" alone where it is given.

    The process that keeps account of semaphores is none of them.
    """
    found = []
    for pid in children(parent):
        try:
            line = Path(f"/proc/{pid}/cmdline").read_bytes()
        except OSError:
            continue
        if b"resource_tracker" in line or b"multiprocessing" not in line:
            continue
        server = b"forkserver" in line and pid in direct(parent)
        if kind in ("", "server" if server else "worker"):
            found.append(pid)
    return found


def direct(parent: int) -> list[int]:
    """Processes that this one has started itself."""
    return [pid for pid in children(parent) if _parent(pid) == parent]


def _parent(pid: int) -> int:
    try:
        return int(Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[1])
    except OSError:
        return 0


def wait_for(condition, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)
