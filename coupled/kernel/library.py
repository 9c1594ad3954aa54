"""Building and loading the compiled kernel; it is compiled again, by $CXX, ziglang or g++, when a source is newer."""

import ctypes
import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

SOURCES = Path(__file__).parent
FLAGS = ("-std=c++17", "-ffast-math", "-fno-finite-math-only", "-fvisibility=hidden", "-s")
# vectors of 256 bits, but where 7 derivatives and a value fill 512: steps take 5 to 15 % less
NARROW = ("-mprefer-vector-width=256",) if platform.machine() in ("x86_64", "AMD64") else ()
NAME = "ring" + {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
NO_COMPILER = "coupled/kernel is not compiled, and there is no C++ compiler: pip install ziglang, or set CXX"


def compiler() -> list[str]:
    """Return the command of a C++17 compiler: $CXX, ziglang, c++, clang++ or g++, the first that is found.

    Raises RuntimeError: no compiler is found.
    """
    if os.environ.get("CXX"):
        return os.environ["CXX"].split()
    if importlib.util.find_spec("ziglang"):  # clang, as for wheels: derivatives take a third of the time of g++
        return [sys.executable, "-m", "ziglang", "c++"]
    for name in ("c++", "clang++", "g++"):
        if shutil.which(name):
            return [name]
    raise RuntimeError(NO_COMPILER)


def build(target: Path, flags: tuple[str, ...] = (), command: list[str] | None = None) -> Path:
    """Compile the sources into the shared library ``target``; an old file is replaced when the new one is complete.

    flags: additional compiler options, such as ``("-target", "x86_64-windows-gnu")`` of zig.
    """
    command = command or compiler()
    target.parent.mkdir(parents=True, exist_ok=True)
    position = () if target.suffix == ".dll" else ("-fPIC",)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:

        def compiled(source: Path) -> str:
            out = str(Path(folder, source.stem + ".o"))
            width = NARROW if source.stem != "follow" and not flags else ()
            _run([*command, "-O3", *FLAGS, *width, *position, *flags, "-c", str(source), "-o", out])
            return out

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            objects = list(pool.map(compiled, sorted(SOURCES.glob("*.cpp"))))
        made = str(Path(folder, target.name))
        plain = ("-nostdlib++",) if "ziglang" in command else ()  # nothing of it is used
        _run([*command, "-shared", *plain, *flags, *objects, "-o", made])
        os.replace(made, target)
    return target


def _run(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)} failed:\n{done.stderr}")


def path() -> Path:
    """Return the path of the library: beside its sources, or in the user's cache where that folder is read-only."""
    if os.access(SOURCES, os.W_OK) or (SOURCES / NAME).exists():
        return SOURCES / NAME
    from platformdirs import user_cache_path

    return user_cache_path("thermofem") / sysconfig.get_platform() / NAME


@cache
def library() -> ctypes.CDLL:
    """Return the loaded library; it is compiled first if it is missing or older than a source."""
    file = path()
    sources = [*SOURCES.glob("*.cpp"), *SOURCES.glob("*.hpp")]
    if sources and (not file.exists() or file.stat().st_mtime < max(s.stat().st_mtime for s in sources)):
        build(file)
    return ctypes.CDLL(str(file))
