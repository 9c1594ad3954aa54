"""Which test files run first, and where, when several processes share them.

Compiling the kernels takes minutes, and two processes that need one at the same time both compile it. So the files that
need kernels stand at one end of the queue, from which the first process takes them, and the others begin at the other
end; when they meet, what is compiled is in Numba's cache, which they share. They meet among small files: behind a dear
last one the other process would wait.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from paths import ROOT
from xdist.scheduler import LoadFileScheduling

PLACES = (
    "tests/coupled",
    "tests/test_",
    "tests/cli",
    "tests/test_house.py",
    "tests/test_every_model.py",
    "tests/test_every_waveform.py",
    "tests/test_docs.py",
    "tests/cli/test_reproduce.py",
    "",
)


def place(path: Path) -> int:
    """The place of a test file in the queue, which is that of the longest of `PLACES` that it begins with."""
    name = path.relative_to(ROOT).as_posix()
    return max((len(start), k) for k, start in enumerate(PLACES) if name.startswith(start))[1]


class TwoEnds(LoadFileScheduling):
    """Files as they are collected: the first process takes the first ones, the others the last ones."""

    def _assign_work_unit(self, node: Any) -> None:
        if self.nodes[0] is not node:
            self.workqueue.move_to_end(next(reversed(self.workqueue)), last=False)
        super()._assign_work_unit(node)
