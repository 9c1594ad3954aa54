"""Which of the two libraries of a wheel is loaded: what the processor has, by the kernel of Linux."""

import os
import platform
import runpy
from pathlib import Path
from typing import NamedTuple

import pytest

from coupled.kernel import library

CPUINFO = Path("/proc/cpuinfo")


@pytest.mark.skipif(
    not CPUINFO.exists() or platform.machine() != "x86_64" or "NPY_DISABLE_CPU_FEATURES" in os.environ,
    reason="needs Linux on x86-64",
)
def test_the_level_of_the_processor():
    flags = next(line for line in CPUINFO.read_text().splitlines() if line.startswith("flags")).split()
    assert library.has_v3() == ({"avx2", "fma"} <= {*flags})


@pytest.mark.parametrize(("able", "there", "old", "name"), [
    (True, True, False, "ring_v3.so"),
    (False, True, False, "ring.so"),
    (True, False, False, "ring.so"),
    (True, True, True, "ring.so"),
])  # fmt: skip
def test_the_second_library_is_taken_where_it_runs(able, there, old, name, tmp_path, monkeypatch):
    """A second one that is missing or older than a source is not taken, nor one that the processor cannot run."""
    monkeypatch.setattr(library, "has_v3", lambda: able)
    file = tmp_path / "ring.so"
    file.touch()
    second = library.second_of(file)
    if there:
        second.touch()
    if old:
        os.utime(second, (0, 0))
    assert library.chosen(file).name == name


class _Hook(NamedTuple):
    """What the hook of a wheel knows about the build."""

    root: str
    target_name: str = "wheel"


@pytest.mark.parametrize(("target", "count"), [("x86_64-linux-gnu.2.17", 2), ("aarch64-linux-gnu.2.17", 1)])
def test_the_hook_compiles_two_for_x86_64(target, count, monkeypatch, tmp_path):
    """The second one with -mcpu=x86_64_v3; the compiler itself is left out."""
    root = Path(__file__).parents[2]
    built = []

    def build(file, flags=(), command=None):
        built.append((file.name, "-mcpu=x86_64_v3" in flags))
        return file

    kernel = {"build": build, "second_of": library.second_of, "NAME": "ring.so"}
    module = runpy.run_path(str(root / "hatch_build.py"))
    made = module["KernelHook"].initialize
    monkeypatch.setenv("KERNEL_TARGET", target)
    monkeypatch.setattr(runpy, "run_path", lambda path: kernel)
    data = {"artifacts": []}
    made(_Hook(str(root)), "", data)
    assert built == [("ring.so", False), ("ring_v3.so", True)][:count]
    assert data["artifacts"] == [f"/coupled/kernel/{name}" for name, _ in built]
