"""``thermofem doctor``: what works on this machine."""

import contextlib
import importlib.metadata
import platform
import re
from collections.abc import Callable
from shutil import which
from typing import Any

from .console import show


def doctor() -> dict[str, Any]:
    """Say what works on this machine, and what is missing for what does not."""
    from rich.table import Table
    from rich.text import Text

    checks: dict[str, Any] = {}
    table = Table("check", "", "what was found", box=None)
    passed = True
    for name, check in CHECKS.items():
        found, problem = check()
        passed &= not problem
        checks[name] = {"ok": not problem, "found": problem or found}
        table.add_row(name, Text("missing", "red") if problem else Text("ok", "green"), problem or found)
    show(table)
    return {"passed": passed, "checks": checks}


def _python() -> tuple[str, str | None]:
    return f"{platform.python_version()} on {platform.system()}", None


def _requirements() -> list[str]:
    """Return the requirements of the installed package, as "NAME>=1; extra == 'EXTRA'"; none if not installed."""
    with contextlib.suppress(importlib.metadata.PackageNotFoundError):
        return importlib.metadata.requires("thermofem") or []
    return []


def _version(line: str) -> tuple[str, str | None]:
    """Return the package name in a requirement, and its installed version, None if it is missing."""
    name = re.split(r"[^\w.-]", line)[0]
    with contextlib.suppress(importlib.metadata.PackageNotFoundError):
        return name, importlib.metadata.version(name)
    return name, None


def _packages() -> tuple[str, str | None]:
    found = [_version(line) for line in _requirements() if "extra ==" not in line]
    missing = " ".join(name for name, version in found if version is None)
    return ", ".join(f"{name} {version}" for name, version in found), f"pip install {missing}" if missing else None


def _meshes() -> tuple[str, str | None]:
    from thermofem import strip_ring
    from thermofem.mesh import committed_mesh

    missing = [a for a in (1e-3, 1e-4) if committed_mesh(strip_ring(), a) is None]
    problem = f"no mesh of the reference strip at {missing}; reinstall" if missing else None
    return "reference strip at 1e-3 and 1e-4", problem


def _mesher() -> tuple[str, str | None]:
    from thermofem.mesh import gmsh_problem

    return "gmsh can mesh new geometries", gmsh_problem()


def _kernel() -> tuple[str, str | None]:
    from coupled.kernel.library import library

    try:
        library()
    except (OSError, RuntimeError) as error:
        return "", f"the compiled kernel cannot be loaded: {error}; reinstall"
    return "the kernel of coupled equations loads", None


def _optional() -> tuple[str, str | None]:
    """Return, in words, which optional packages and programs are installed, and None, as none is required."""
    words = [] if which("ffmpeg") else ["no ffmpeg (films as .mp4)"]
    for line in _requirements():
        extra = re.search(r"extra == .(\w+).", line)
        if extra and extra[1] != "dev":
            name, version = _version(line)
            words.append(f"{name} {version}" if version else f'no {name}: pip install "thermofem[{extra[1]}]"')
    return "; ".join(words), None


CHECKS: dict[str, Callable[[], tuple[str, str | None]]] = {
    "python": _python,
    "packages": _packages,
    "committed meshes": _meshes,
    "mesher": _mesher,
    "kernel": _kernel,
    "optional": _optional,
}
