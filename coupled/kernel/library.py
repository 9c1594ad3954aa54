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
from typing import Any

HERE = Path(__file__).parent
SOURCES = HERE / "cpp"
FLAGS = ("-std=c++17", "-ffast-math", "-fno-finite-math-only", "-fvisibility=hidden", "-s")
# vectors of 256 bits, but where 7 derivatives and a value fill 512: steps take 5 to 15 % less
NARROW = ("-mprefer-vector-width=256",) if platform.machine() in ("x86_64", "AMD64") else ()
NAME = "ring" + {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
SECOND = "_v3"  # end of the name of a second library in wheels of x86-64, for processors since 2013: a fifth less time
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
    """Return the path of the library: beside this file, or in the user's cache where that folder is read-only."""
    if os.access(HERE, os.W_OK) or (HERE / NAME).exists():
        return HERE / NAME
    from platformdirs import user_cache_path

    return user_cache_path("thermofem") / sysconfig.get_platform() / NAME


def is_current(file: Path) -> bool:
    """Whether a library exists and is not older than a source; a wheel has headers alone, which exports need."""
    units = [*SOURCES.glob("*.cpp")]
    sources = [*units, *SOURCES.glob("*.hpp")] if units else []
    newest = max((source.stat().st_mtime for source in sources), default=0.0)
    return file.exists() and file.stat().st_mtime >= newest


def second_of(file: Path) -> Path:
    """Path of the second library beside the one for every processor."""
    return file.with_stem(file.stem + SECOND)


def has_v3() -> bool:
    """Whether the processor has the instructions of x86-64-v3 (AVX2, FMA), as NumPy finds them."""
    import numpy as np  # not where a wheel is built, which reads this file

    config: dict[str, Any] = dict(np.show_config(mode="dicts") or {})
    extensions = config.get("SIMD Extensions", {})
    names = {*extensions.get("baseline", []), *extensions.get("found", [])}
    return "X86_V3" in names or {"AVX2", "FMA3"} <= names


def chosen(file: Path) -> Path:
    """The library for this processor: the second one of a wheel where it is current and can run."""
    second = second_of(file)
    return second if is_current(second) and has_v3() else file


@cache
def library() -> ctypes.CDLL:
    """Return the loaded library; it is compiled first if it is missing or older than a source.

    Raises RuntimeError: it lays out a structure otherwise than `structures`.
    """
    from .structures import check_layout  # not where a wheel is built, which runs this file alone

    file = path()
    if not is_current(file):
        build(file)
    kernel = ctypes.CDLL(str(chosen(file)))
    check_layout(kernel)
    return kernel
