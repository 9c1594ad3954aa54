"""The files of the page: its modules as one script, and its kernel as WebAssembly with the coefficients of the methods.

page/kernel.wasm is committed, so that a page is written without a compiler for WebAssembly, and the same for everyone.
After a change of coupled/kernel: ``python -c "from coupled.explore import bundle; bundle.compile_kernel()"``.
"""

import base64
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

from ..kernel.tableaus import Method, tableau

# in the order in which they use one another
MODULES = (
    "ring", "eigen", "kernel", "equilibria", "curves", "pulsing", "cycle", "engine", "plot", "thermal", "state",
    "figures", "section", "paint", "fields", "take", "main",
)  # fmt: skip
LIBRARY = "vendor/d3-scale.min.js"
HERE = Path(__file__).parent
COMPILER = (
    "-m", "ziglang", "c++", "-target", "wasm32-wasi", "-mcpu=generic+simd128", "-mexec-model=reactor", "-O3",
    "-std=c++17", "-ffast-math", "-fno-finite-math-only", "-fno-exceptions", "-fno-rtti", "-fvisibility=hidden",
    "-nostdlib++", "-s", "-Wl,--export=page_integrate", "-Wl,--export=page_follow", "-Wl,--export=page_slopes",
    "-Wl,--export=ring_layout", "-Wl,--export=realloc",
)  # fmt: skip
_IMPORT = re.compile(r"^import\b[^;]*;\n", re.MULTILINE)
_EXPORTS = re.compile(r"^export \{[^}]*\};\n", re.MULTILINE)


def text_of(name: str) -> str:
    """Return the text of a file, such as "page/page.css"."""
    return (HERE / name).read_text(encoding="utf-8")


@cache
def script() -> str:
    """Return all JavaScript modules as one script without imports; their top-level names are unique."""
    parts = []
    for name in MODULES:
        text = _EXPORTS.sub("", _IMPORT.sub("", text_of(f"page/{name}.mjs")))
        parts.append(re.sub(r"^export ", "", text, flags=re.MULTILINE))
    whole = "\n".join(parts)
    return f'(() => {{\n"use strict";\n{whole}\n}})();'


def kernel() -> dict[str, Any]:
    """Return the compiled kernel in base64, and the coefficients of the Rosenbrock methods by name."""
    found = {}
    for method in Method:
        table = tableau(method)
        arrays = {name: getattr(table, name).tolist() for name in ("a", "c", "dense", "at", "slope")}
        found[method.value] = {"order": table.order, "gamma": table.gamma} | arrays
    code = (HERE / "page/kernel.wasm").read_bytes()
    return {"bytes": base64.b64encode(code).decode(), "tableaus": found}


def compile_kernel(target: Path = HERE / "page/kernel.wasm") -> None:
    """Compile page/kernel.cpp; needs ziglang, and half a minute of CPU time for its C library at the first time."""
    subprocess.run([sys.executable, *COMPILER, "kernel.cpp", "-o", str(target)], cwd=HERE / "page", check=True)
