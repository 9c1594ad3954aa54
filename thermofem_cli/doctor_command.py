"""``thermofem doctor``: what works on this machine."""

import importlib.metadata
import platform
import re
import sys
from collections.abc import Callable
from typing import Any

from rich.table import Table
from rich.text import Text

from thermofem import strip_ring
from thermofem.mesh import find_committed, gmsh_problem

from .console import show


def doctor() -> dict[str, Any]:
    """Say what works on this machine, and what is missing for what does not."""
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
    problem = None if sys.version_info >= (3, 11) else "3.11 or newer is needed"
    return f"{platform.python_version()} on {platform.system()}", problem


def _packages() -> tuple[str, str | None]:
    try:
        requirements = importlib.metadata.requires("thermofem") or []
    except importlib.metadata.PackageNotFoundError:
        return "thermofem runs from a checkout and is not installed", None
    found, missing = [], []
    for name in (re.split(r"[^\w.-]", line)[0] for line in requirements if "extra ==" not in line):
        try:
            found.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            missing.append(name)
    return ", ".join(found), f"pip install {' '.join(missing)}" if missing else None


def _meshes() -> tuple[str, str | None]:
    missing = [a for a in (1e-3, 1e-4) if find_committed(strip_ring(), a) is None]
    problem = f"no mesh of the reference strip at {missing}; reinstall" if missing else None
    return "reference strip at 1e-3 and 1e-4", problem


def _mesher() -> tuple[str, str | None]:
    return "gmsh can mesh new geometries", gmsh_problem()


def _netcdf() -> tuple[str, str | None]:
    try:
        import h5netcdf
        import h5py
    except ImportError as error:
        return "", str(error)
    return f"HDF5 {h5py.version.hdf5_version}, h5netcdf {h5netcdf.__version__}", None


def _kernel() -> tuple[str, str | None]:
    from coupled.kernel.library import library

    try:
        library()
    except (OSError, RuntimeError) as error:
        return "", f"the compiled kernel cannot be loaded: {error}; reinstall"
    return "the kernel of coupled equations loads", None


def _optional() -> tuple[str, str | None]:
    """What some exports and films alone need; nothing fails without it."""
    from importlib.util import find_spec
    from shutil import which

    there = {
        "ffmpeg (films as .mp4)": which("ffmpeg"),
        "gdsfactory (geometries of its sections)": find_spec("gdsfactory"),
    }
    return ", ".join(name if found else f"no {name}" for name, found in there.items()), None


CHECKS: dict[str, Callable[[], tuple[str, str | None]]] = {
    "python": _python,
    "packages": _packages,
    "committed meshes": _meshes,
    "mesher": _mesher,
    "netCDF": _netcdf,
    "kernel": _kernel,
    "optional": _optional,
}
