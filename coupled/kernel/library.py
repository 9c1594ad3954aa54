"""Building and loading the compiled kernel, and the structures that Python fills for it.

It is compiled again, by $CXX, ziglang or g++, when a source is newer. Fields of structures stand in the order of
`equations.hpp`, `loop.hpp` and `kernel.hpp`; the past of a circuit is flat here.
"""

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

_D, _I, _L, _P = ctypes.c_double, ctypes.c_int, ctypes.c_int64, ctypes.c_void_p


def _structure(name: str, *fields: tuple[str, Any]) -> Any:
    parts = [(each, kind) for names, kind in fields for each in names.split()]
    return type(name, (ctypes.Structure,), {"_fields_": parts})


Table = _structure("Table", ("columns terms", _I), ("place edges c", _P))
Method = _structure("Method", ("stages order", _I), ("gamma", _D), ("a c dense at slope", _P))
Problem = _structure(
    "Problem",
    ("rings fields order terms lasers pieces heat light delays waves", _I),
    ("method", Method),
    ("modes carriers dispersion bend own floor read weight gain rate cross A H G B edges jumps varies", _P),
    ("power phase detuning", Table),
    ("entry brightest sequence between taken sent delay late seen_ring seen_laser seen_late corner", _P),
    ("energies", _I),
    ("time_tolerance", _D),
)
Loop = _structure(
    "Loop",
    ("t h h_before size_before growth rtol longest restart cap rest_step level seen crossing", _D),
    ("accepted rejected rest_again filled room budget", _L),
    ("begun piece entered fresh per_step quantity ring stop", _I),
    ("past", _P),
    ("past_filled past_room", _L),
)
ReturnMap = _structure(
    "ReturnMap",
    ("p edges fixed slow rows steps", _P),
    ("fixed_count n room filled count", _L),
    ("memory", _P),
)
STRUCTURES = {"Table": Table, "Method": Method, "Problem": Problem, "Loop": Loop, "ReturnMap": ReturnMap}


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


class Place(ctypes.Structure):
    """A field's offset, or a structure's size, in bytes: ``Place`` of layout.cpp."""

    _fields_ = (("name", ctypes.c_char_p), ("bytes", _L))


def python_layout() -> dict[str, int]:
    """Offset of every field, such as "Loop.t", and size of every structure, such as "Loop", in bytes."""
    layout = {}
    for name, structure in STRUCTURES.items():
        for field, _ in structure._fields_:
            layout[f"{name}.{field}"] = int(getattr(structure, field).offset)
        layout[name] = ctypes.sizeof(structure)
    return layout


def kernel_layout(kernel: ctypes.CDLL) -> dict[str, int]:
    """The same as the compiled kernel has it, by its table `ring_layout`."""
    kernel.ring_layout.restype = ctypes.POINTER(Place)
    places = kernel.ring_layout()
    layout = {}
    row = 0
    while places[row].name is not None:
        layout[places[row].name.decode()] = int(places[row].bytes)
        row += 1
    return layout


def check_layout(kernel: ctypes.CDLL) -> None:
    """Raise RuntimeError naming the fields that lie elsewhere in the kernel than in this file."""
    here = python_layout()
    there = kernel_layout(kernel)
    moved = sorted(name for name in here.keys() | there.keys() if here.get(name) != there.get(name))
    if moved:
        raise RuntimeError(f"coupled/kernel/library.py has other structures than what is compiled: {', '.join(moved)}")


@cache
def library() -> ctypes.CDLL:
    """Return the loaded library; it is compiled first if it is missing or older than a source.

    Raises RuntimeError: it lays out a structure otherwise than Python.
    """
    file = path()
    if not is_current(file):
        build(file)
    kernel = ctypes.CDLL(str(chosen(file)))
    check_layout(kernel)
    return kernel
