"""The page's kernel: page/kernel.cpp over coupled/kernel, compiled to WebAssembly by zig.

The result is committed, so that a page is written without a compiler for WebAssembly, and the same for everyone.
After a change of the kernel: ``python -m coupled.explore.wasm``.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).parent / "page"
EXPORTS = ("ring_integrate", "ring_follow", "ring_slopes", "realloc")
FLAGS = (
    "-target", "wasm32-wasi", "-mcpu=generic+simd128", "-mexec-model=reactor", "-O3", "-std=c++17", "-ffast-math",
    "-fno-finite-math-only", "-fno-exceptions", "-fno-rtti", "-fvisibility=hidden", "-nostdlib++", "-s",
)  # fmt: skip


def build(target: Path) -> None:
    """Compile the module; needs ziglang, and half a minute of CPU time for its C library at the first time."""
    exports = [f"-Wl,--export={name}" for name in EXPORTS]
    command = [sys.executable, "-m", "ziglang", "c++", *FLAGS, *exports, "kernel.cpp", "-o", str(target)]
    subprocess.run(command, cwd=PAGE, check=True)


if __name__ == "__main__":
    build(PAGE / "kernel.wasm")
