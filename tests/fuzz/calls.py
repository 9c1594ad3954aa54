"""Public calls with one argument replaced by a thing of another type, shape or order: a result or InputError.

    python tests/fuzz/calls.py [minutes [seed]]

The calls stand in `targets.py`. Prints each place once at which another error or a RuntimeWarning comes up, a call
takes more than `SLOW`, or an argument is changed or kept; the exit code is then 1.
"""

from __future__ import annotations

import array
import collections
import contextlib
import dataclasses
import enum
import inspect
import os
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import types
import warnings
from collections.abc import Callable, Iterator, Mapping
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import thermofem as th

sys.path.insert(0, str(Path(__file__).parent))

from targets import MODEL, RING, Call, calls, data, long_calls, missing, prepare

LONG = 10**400
SLOW = 20.0  # CPU s, of one call
SHARE = 4.0  # s, of all calls of one function; functions that take long get fewer things
CALLED = ("progress", "report", "f", "quantity")  # functions of the caller
FEWEST = 60  # calls of one function


class Colour(enum.Enum):
    """An enumeration that is none of ours."""

    RED = 1


class Array:
    """An object with the protocol of an array."""

    def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
        return np.array([1.0, 2.0], dtype)


class Once:
    """A generator, made anew for each call."""

    def __call__(self) -> Iterator[float]:
        return iter([1e-7, 2e-7])


def things() -> list[Any]:
    """Arguments that no function asks for, and those that belong to other functions."""
    frozen = np.array([1e-8, 1e-7])
    frozen.flags.writeable = False
    plain: list[Any] = [
        None, True, 0, -0.0, -1, 3, 0.5, 1e-300, 1e300, -1e300, 1e-160, 1e160, 1e99, float("nan"), float("inf"), LONG,
        1j, "", "core", "1e-3", "a\nb", "\ud800", "x" * 10**6, b"x", bytearray(b"ab"), [], [[]], [1], [2, 1], [1, 1],
        [np.nan], ["a"], [None], [[1, 2], [3]], [LONG], [True], (), (1e-7, 1e300), {}, {"core": 1e-3}, {1: 2},
        {"core": "x"}, {"core": None}, set(), frozenset([1.0]), range(3), range(10**12), slice(1), memoryview(b"abc"),
        array.array("d", [1.0, 2.0]), collections.deque([1.0, 2.0]), {"a": 1.0}.keys(), types.MappingProxyType({}),
        Once(), Path("/nowhere/x"), Fraction(1, 3), Decimal("1e-6"), Colour.RED, Colour, Array(),
    ]  # fmt: skip
    numpy: list[Any] = [
        np.array([]), np.array(1.0), np.array(1e-7, np.float32), np.zeros((0, 3)), np.zeros((2, 2)), np.array(["a"]),
        np.array([1j]), np.array([True, False]), np.array([None]), np.array([1.0, None]), np.array([0.1, 0.2], object),
        np.ma.masked, np.ma.masked_array([1, 2], [0, 1]), np.ma.masked_array([1e-8, 1e-7]), np.float16(0.5),
        np.float32(1e-3), np.longdouble(1e-3), np.longdouble("1e4000"), np.int8(3), np.int8(-128), np.uint8(200),
        np.uint64(2**64 - 1), np.bool_(True), np.str_("core"), np.timedelta64(1, "us"), np.datetime64("2026-01-01"),
        np.array([1, 2], "m8[us]"), np.broadcast_to(np.float64(1e-3), (5,)), np.broadcast_to(1.0, (10**5, 10**6)),
        frozen, np.asfortranarray([[1.0, 2.0], [3.0, 4.0]]), np.arange(8.0)[::-2], np.arange(3, dtype=">f8"),
        np.array([1e-8, 1e-7], np.float16), np.array([1, 2], np.uint64), np.array([100, -100], np.int8),
        np.array([(1, 2.0)], "i4,f8"), np.array([1e-8, 1e300]), np.array([1e-300, 1e-7]),
        np.ones((1, 2)).view(np.matrix), np.linspace(1e-9, 1e-3, 3_000_000), np.broadcast_to(1e-4, 99_000_000),
        pd.Series([1e-8, 1e-7]), pd.DataFrame({"a": [1.0]}), pd.NA, pd.Timestamp(0), xr.DataArray([1.0, 2.0]),
        xr.DataArray(1e-3), xr.Dataset(),
    ]  # fmt: skip
    others: list[Any] = [
        int, object(), object, lambda x: x, lambda: 1, print, NotImplemented, ..., np, th, th.Foster, th.Constant,
        ValueError("x"), th.InputError("x"), MODEL, RING, th.strip_ring(), th.Constant(1e-3),
        th.SquareWave(1e-3, 1e-6, 0.5),
    ]  # fmt: skip
    given = data()
    broken = [
        given.isel(time=slice(None, None, -1)), given.isel(time=slice(0, 1)), given.isel(time=slice(0, 0)),
        given * np.nan, given * 1e300, given.drop_vars("delta_T"), given.astype("float32"), given.astype(complex),
        given.expand_dims("ring"), given.rename(time="t"), given.assign_attrs(waveform="x"), given.assign_attrs(read=5),
    ]  # fmt: skip
    return [*plain, *numpy, *others, given, *broken, given.delta_T, [given, given], [given, None]]


def arguments(function: Callable[..., Any], given: Mapping[str, Any]) -> list[str]:
    """Names of everything that a call takes, without pools of processes and the number of searches."""
    try:
        every = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        every = ()
    named = [one.name for one in every if one.kind in (one.POSITIONAL_OR_KEYWORD, one.KEYWORD_ONLY)]
    return [name for name in dict.fromkeys([*given, *named]) if name not in ("executor", "workers", "validate", "runs")]


def jobs(table: dict[str, Call], seed: int) -> list[tuple[str, str, int]]:
    """Every call x every argument x every thing, in random order."""
    count = len(things())
    found = [(name, argument, k) for name, call in table.items() for argument in arguments(*call) for k in range(count)]
    random.Random(seed).shuffle(found)
    return found


def print_of(value: Any, depth: int = 0) -> Any:
    """Something that changes with the numbers that an argument holds."""
    if isinstance(value, np.ndarray):
        return value.shape, str(value.dtype), np.asarray(value).tobytes() if value.size < 10**6 else 0
    if isinstance(value, xr.Dataset | xr.DataArray):
        arrays = {**value.coords, **(value.data_vars if isinstance(value, xr.Dataset) else {"": value.variable})}
        return {name: print_of(one.values) for name, one in arrays.items()}, repr(value.attrs)
    if isinstance(value, pd.Series | pd.DataFrame):
        return print_of(value.to_numpy())
    if isinstance(value, list | tuple) and depth < 3:
        return [print_of(one, depth + 1) for one in value]
    if isinstance(value, dict) and depth < 3:
        return {str(key): print_of(one, depth + 1) for key, one in value.items()}
    return None


def arrays_of(value: Any) -> Iterator[np.ndarray]:
    """Arrays that a value holds at its surface."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, xr.Dataset):
        yield from (one.values for one in value.variables.values())
    elif isinstance(value, xr.DataArray | pd.Series):
        yield np.asarray(value.values)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield from (one for one in vars(value).values() if isinstance(one, np.ndarray))


def place(error: BaseException) -> str:
    """Type of an error and the last line of this project that it passed."""
    ours = [f for f in traceback.extract_tb(error.__traceback__) if "site-packages" not in f.filename]
    ours = [f for f in ours if any(f"/{name}/" in f.filename for name in ("thermofem", "surrogate", "coupled"))] or ours
    return f"{type(error).__name__} at {Path(ours[-1].filename).name}:{ours[-1].lineno}"


class TooLongError(Exception):
    """A call took more than `SLOW`."""


def _too_long(*_: Any) -> None:
    raise TooLongError


def failure(name: str, call: Call, argument: str, thing: Any) -> tuple[str, str] | None:
    """Where and how one call breaks the promise, or None."""
    function, given = call
    said = f"{name}({argument}={type(thing).__name__} {thing!r:.80}): ".replace("\n", " ")
    given = {**given, argument: thing() if isinstance(thing, Once) else thing}
    before = print_of(given)
    signal.setitimer(signal.ITIMER_PROF, SLOW)
    result = None
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(None):
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", RuntimeWarning)
            result = function(**given)
    except (th.InputError, th.MissingLibraryError) as error:
        if "\n" in str(error):
            return f"two lines of {name}", f"{said}{error}"
    except TooLongError as error:
        return f"slow: {name} {place(error)}", said
    except Exception as error:
        return place(error), f"{said}{error!s:.120}".replace("\n", " ")
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    if print_of(given) != before:
        return f"{name} changes {argument}", said
    kept = [one for value in given.values() for one in arrays_of(value) if one.flags.writeable]
    for made in arrays_of(result):
        if any(made.size and made.size < 10**6 and np.shares_memory(made, one) for one in kept):
            return f"{name} keeps {argument}", said
    return None


def tried(table: dict[str, Call], count: int, seconds: float, seed: int = 0) -> tuple[int, dict[str, str]]:
    """Run jobs; how many, and the places where a promise breaks with the call that led there."""
    end, done, wrong, every = time.monotonic() + seconds, 0, dict[str, str](), things()
    spent, times = dict.fromkeys(table, 0.0), dict.fromkeys(table, 0)
    os.environ["TQDM_DISABLE"] = "1"
    signal.signal(signal.SIGPROF, _too_long)
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):  # some calls write files
        prepare()
        for function, given in table.values():  # compiles what they need: that counts for no call
            with contextlib.suppress(th.InputError), warnings.catch_warnings(action="ignore"):
                function(**given)
        for name, argument, k in jobs(table, seed):
            if done >= count or time.monotonic() > end:
                break
            if spent[name] > SHARE and times[name] >= FEWEST:
                continue
            begin = time.process_time()
            if argument in CALLED and callable(every[k]):
                continue  # its own error is passed on
            if found := failure(name, table[name], argument, every[k]):
                wrong.setdefault(*found)
            spent[name] += time.process_time() - begin
            times[name] += 1
            done += 1
    return done, wrong


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_AS, (8 * 2**30,) * 2)  # a call that asks for more ends with its name
    everything = {**calls(), **long_calls()}
    if names := missing(everything):
        sys.exit(f"targets.py has no call of {', '.join(names)}")
    numbers = [float(text) for text in sys.argv[1:3]]
    seconds = 60 * (numbers[0] if numbers else 10.0)
    count, found = tried(everything, 10**9, seconds, int(numbers[1]) if len(numbers) > 1 else 0)
    for where, call in sorted(found.items()):
        print(where, call.encode("ascii", "backslashreplace").decode())
    print(f"{count} calls of {len(everything)} functions, {len(found)} places where a promise breaks")
    sys.exit(bool(found))
