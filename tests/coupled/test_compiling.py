"""Each kernel is compiled once for the same types, and the order of the test files lets no two processes do it."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from types import FunctionType

import numpy as np
import pytest
from numba import njit, types
from numba.core.caching import CacheImpl
from numba.core.dispatcher import Dispatcher
from order import PLACES, place
from paths import ROOT

import coupled
import thermofem as th
from coupled.kernels import compiling
from coupled.kernels.compiling import StoredCode, forget_if_older, inner, merged


@njit
def halve(x: float) -> float:
    return x / 2


@merged
def until_small(x: float, limit: float) -> tuple[float, int]:
    for count in range(100):
        x = halve(x)
        if x < limit:
            return x, count
    return x, -1


@njit
def compiled_caller(x: float) -> tuple[float, int]:
    return until_small(x, 1.0)


def test_what_is_merged_is_python_outside_and_no_function_of_its_own_inside():
    assert isinstance(until_small, FunctionType)
    assert compiled_caller(9.0) == until_small(9.0, 1.0) == (9 / 16, 3)
    lines = compiled_caller.inspect_llvm(compiled_caller.signatures[0]).splitlines()
    assert not [line for line in lines if "@" in line and "until_small" in line]


@inner
def third(x: float) -> float:
    return x / 3


@njit
def inner_caller(x: float) -> float:
    return third(x)


def test_what_only_kernels_call_is_python_outside_and_has_no_entry_for_python():
    assert isinstance(third, FunctionType)
    assert inner_caller(9.0) == third(9.0) == 3.0
    lines = inner_caller.inspect_llvm(inner_caller.signatures[0]).splitlines()
    assert not [line for line in lines if line.startswith("define") and "third" in line and "cpython" in line]


def test_stored_code_imports_no_library_when_loaded():
    """NumPy's arrays in Numba among them, .08 CPU s of every start that makes an array in a kernel."""

    def doubled(x):
        out = np.empty(x.size)
        for i in range(x.size):
            out[i] = 2 * x[i]
        return out

    kernel = njit(doubled)
    kernel(np.ones(2))
    (made,) = kernel.overloads.values()
    rooms = [one.globals["__name__"] for one in made._find_referenced_environments()]
    assert "numba.np.arrayobj" in rooms  # what Numba itself would store
    *_, environments = StoredCode(doubled)._impl.reduce(made)
    assert {one.globals["__name__"] for one in environments} <= {__name__}


@pytest.mark.slow
def test_the_kernels_compile_before_the_installation_ends():
    """`make demo` runs ``python -m coupled`` beside the installation, when only the first packages are there."""
    first = re.search(r"\.venv/numba:.*\n\t.*\(INSTALL\) (.*)", (ROOT / "Makefile").read_text())
    assert first
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    names = {re.split(r"[<>=]", one)[0] for one in wanted} - {"numpy", *first[1].split()}
    later = {"scikit-fem": "skfem", "scikit-learn": "sklearn"}
    code = (
        f"import runpy, sys; sys.modules.update(dict.fromkeys({sorted(later.get(n, n) for n in names)}));"
        "runpy.run_module('coupled', run_name='__main__')"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0


def test_no_kernel_is_compiled_for_the_value_of_a_number():
    """Numba compiles what is called with a literal, such as ``f(1)``, once more."""
    model = th.Foster(R=[2e3, 5.8e3], tau=[5.6e-8, 1.2e-6])
    coupled.simulate(coupled.borghi2021(), model, power=6.31e-3, duration=1e-6)
    ours = [module for name, module in sys.modules.items() if name.startswith("coupled.")]
    kernels = {id(k): k for module in ours for k in vars(module).values() if isinstance(k, Dispatcher)}
    assert not [
        f"{kernel.__module__}.{kernel.__name__}: {signature}"
        for kernel in kernels.values()
        for signature in kernel.signatures
        if any(isinstance(part, types.Literal) for part in signature)
    ]


def test_files_that_need_kernels_stand_at_one_end():
    assert place(ROOT / "tests" / "coupled" / "test_maps.py") == 0
    assert place(ROOT / "tests" / "thermofem" / "test_mesh.py") == len(PLACES) - 1
    found = [place(path) for path in sorted((ROOT / "tests").rglob("test_*.py"))]
    assert np.unique(found).tolist() == list(range(len(PLACES)))  # every place has files


def test_a_kernel_runs_where_no_folder_can_keep_its_machine_code(monkeypatch, caplog):
    """An account without a home, on an installation that it cannot write."""
    monkeypatch.setattr(CacheImpl, "_locator_classes", [])
    monkeypatch.setattr(compiling, "_kept", {}, raising=False)
    for decorate in (compiling.compiled, compiling.lean, compiling.inlined, compiling.inlined_lean, inner):
        kernel = decorate(lambda x: x / 4)
        assert kernel(9.0) == 9 / 4
        assert compiled_caller_of(kernel)(9.0) == 9 / 4
        forget_if_older(kernel, __file__)
    (record,) = caplog.records
    assert "NUMBA_CACHE_DIR" in record.message


def compiled_caller_of(kernel):
    """A compiled function that calls a kernel."""
    return njit(lambda x: kernel(x))


def test_a_person_at_a_terminal_is_told_once_that_kernels_are_compiled(tmp_path, monkeypatch, capsys):
    """What waits for a minute without a word looks as if it hung."""

    @njit
    def doubled(x: float) -> float:
        return 2 * x

    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    compiling.say_that_it_compiles.cache_clear()
    doubled._cache = StoredCode(halve.py_func)
    monkeypatch.setattr(doubled._cache, "_load_overload", lambda *_: None)
    assert doubled(3.0) == 6.0
    assert doubled(3) == 6
    assert capsys.readouterr().err.splitlines() == [
        "compiling the equations of light and carriers for this machine: once, for up to a minute"
    ]
