"""The page's JavaScript modules as one script, its style, and the tables that it shares with Python."""

from __future__ import annotations

import base64
import re
from functools import cache
from importlib.resources import files
from typing import Any

from ..kernel.tableaus import Method, tableau

# in the order in which they use one another
MODULES = (
    "ring", "eigen", "kernel", "equilibria", "curves", "measure", "pulsing", "cycle", "heat", "engine", "channel",
    "plot", "view", "thermal", "state", "script", "figures", "section", "paint", "fields", "pointer", "take", "main",
)  # fmt: skip
LIBRARY = "vendor/d3-scale.min.js"
_IMPORT = re.compile(r"^import\b[^;]*;\n", re.MULTILINE)
_EXPORTS = re.compile(r"^export \{[^}]*\};\n", re.MULTILINE)


def text_of(name: str) -> str:
    """Return a file of the page."""
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


@cache
def script() -> str:
    """Return all modules as one script; names at the top of a module are unique, so that imports can be left out."""
    parts = []
    for name in MODULES:
        text = _EXPORTS.sub("", _IMPORT.sub("", text_of(f"page/{name}.mjs")))
        parts.append(re.sub(r"^export ", "", text, flags=re.MULTILINE))
    whole = "\n".join(parts)
    return f'(() => {{\n"use strict";\n{whole}\n}})();'


def kernel() -> dict[str, Any]:
    """Return the compiled kernel in base64, and the coefficients of its methods."""
    found = {}
    for method in Method:
        table = tableau(method)
        arrays = {name: getattr(table, name).tolist() for name in ("a", "c", "dense", "at", "slope")}
        found[method.value] = {"order": table.order, "gamma": table.gamma} | arrays
    code = files(__package__).joinpath("page/kernel.wasm").read_bytes()
    return {"bytes": base64.b64encode(code).decode(), "tableaus": found}
