"""Generators of hostile input: names, text, numbers, units, trees and files that somebody else may send.

`tests/test_readers.py` runs every reader over all of them; `tests/fuzz/readers.py` edits valid files at random.
"""

from __future__ import annotations

import io
import json
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from surrogate.family.members import pack

BREAKS = ["\n", "\r", "\r\n", "\x0b", "\x0c", "\x1c", "\x85", "\u2028", "\u2029"]
ODD = ["\0", "\x1b[31m", "\t", "\x7f", "\u202e", "\ud800", '"', "'", "`", "$", "\\", "/", "*/", "]", "[/x]", "{", "%"]


def names() -> list[str]:
    """Names that no file may carry on: line breaks with commands behind them, control characters, too long, empty."""
    command = ".control\nshell touch hostile\n.endc"
    broken = [f"core{b}{command.replace(chr(10), b)}" for b in BREAKS]
    return [*broken, *(f"core{odd}x" for odd in ODD), "", " ", "-", "core;x", "x" * 101, "core=1"]


def texts() -> list[str]:
    """Texts that a provenance may hold, and that a writer must keep on the lines of its comment."""
    return [f"wafer 7{b}.control{b}shell touch hostile{b}.endc{b}.include /etc/passwd" for b in BREAKS] + [
        f"x{odd}y" for odd in ODD if odd != "\ud800"
    ]


def numbers() -> list[str]:
    """Numbers as JSON or TOML text that no reader may take, or may take only as a finite float."""
    return ["9" * 400, "9" * 5000, "1e400", "NaN", "Infinity", "-Infinity", "nan", "inf", "1_0", "١٢"]


def units() -> list[str]:
    """Quantities whose unit costs more than it is worth."""
    return [
        "1 mW*9**9**9**9", "1 nm*(2**999999999)", "1 " + "m" * 100_000, "1 " + "*".join(["m"] * 3000), "1 m**99999999",
        "1 " + "(" * 500 + "m" + ")" * 500, "1 m^-999999999", "1 9**9**9**9", "1 m**m", "1 m;import os", "1 __import__",
        "1 ((min^9)^9)^9", "9" * 500 + " m", "1 m\0", "1 m/", "1 \ud800", "1 m**2.5", "1 m 9**9**9",
    ]  # fmt: skip


def trees() -> list[str]:
    """JSON texts of odd shape and depth."""
    deep = ["[" * n + "]" * n for n in (100, 100_000)] + ['{"a":' * 1000 + "1" + "}" * 1000]
    odd = ["[Infinity,[]]", "[]", "null", "3", '"\\ud800"', "{", "", "\0", "[1,", '{"kind": []}', '{"kind": "x"}']
    return [*deep, *odd, *(f'{{"x": {n}}}' for n in numbers())]


def tomls() -> list[str]:
    """TOML texts beside the geometry's own: depth, integers of any length, dates, NUL."""
    return [
        f"a = {'[' * 100}{']' * 100}", f"a = {'[' * 20_000}{']' * 20_000}", *(f"x = {n}" for n in numbers()),
        "x = 1979-05-27", 'geometry = "\\u0000"', "a." * 5000 + "b = 1", "[probes]\nread = 5", "[[vary]]\npath = []",
        "[[drive]]\npower = 1979-05-27", *(f'name = "x"\nouter_radius = {json.dumps(unit)}' for unit in units()),
    ]  # fmt: skip


def tables() -> list[str]:
    """Tables of numbers that are none."""
    return ["x" * 200_000 + ",1\n1,2\n", '"' + "x" * 200_000 + '",1\n', "1_0,2\n3,4\n", "١,٢\n٣,٤\n", "1,2\n3\n", "\0"]


def netcdf(folder: Path) -> Iterator[Path]:
    """netCDF files that declare more than they hold, point at other files, or say the wrong unit."""
    import h5py

    secret = folder / "secret.bin"
    secret.write_bytes(b"8 bytes!" * 20)
    time = np.linspace(0, 1e-5, 20)
    huge = {"shape": (10**12,), "dtype": "f8", "chunks": (10**6,), "compression": "gzip"}

    def written(name: str, fill: Any) -> Path:
        path = folder / f"{name}.nc"
        with h5py.File(path, "w") as file:
            file["time"] = time
            fill(file)
        return path

    def virtual(file: Any) -> None:
        layout = h5py.VirtualLayout(shape=(20,), dtype="f8")
        layout[:] = h5py.VirtualSource(str(folder / "declares.nc"), "time", shape=(20,))
        file.create_virtual_dataset("delta_T", layout)

    def unit(text: str) -> Any:
        return lambda file: file["time"].attrs.update(units=text)

    yield written("declares", lambda file: file.create_dataset("delta_T", **huge))
    yield written(
        "external",
        lambda file: file.create_dataset("delta_T", shape=(20,), dtype="f8", external=[(str(secret), 0, 160)]),
    )
    yield written("virtual", virtual)
    yield written("link", lambda file: file.update(delta_T=h5py.ExternalLink(str(folder / "declares.nc"), "time")))
    yield from (written(f"unit {k}", unit(text)) for k, text in enumerate(["m", "furlongs_per", "s*9**9**9**9"]))
    classic = folder / "classic.nc"
    classic.write_bytes(b"CDF\x01" + b"\0" * 30)
    yield classic


def damaged(content: bytes, seed: int, count: int) -> Iterator[bytes]:
    """Copies of a file with a few bytes overwritten, or cut off."""
    pick = random.Random(seed)
    for _ in range(count):
        wrong = bytearray(content)
        start, length = pick.randrange(len(wrong)), pick.randrange(1, 33)
        if pick.random() < 0.2:
            yield bytes(wrong[:start])
            continue
        wrong[start : start + length] = pick.randbytes(min(length, len(wrong) - start))
        yield bytes(wrong)


JSON_VALUES: list[Any] = [
    None, True, 0, -1, 1e308, 5e-324, 10**30, "", "x", "a\nb", "x" * 10_000, [], [[1.0], [2, 3]], {},
]  # fmt: skip


def replaced_leaves(tree: Any) -> Iterator[Any]:
    """Trees with one node of a tree replaced or left out."""
    yield from JSON_VALUES
    if isinstance(tree, dict):
        for key, value in tree.items():
            yield {k: v for k, v in tree.items() if k != key}
            yield from ({**tree, key: other} for other in replaced_leaves(value))
    if isinstance(tree, list) and tree:
        yield tree[:-1]
        yield from ([other, *tree[1:]] for other in replaced_leaves(tree[0]))


def archives(content: bytes) -> Iterator[tuple[str, bytes]]:
    """Copies of NumPy's archive with one array damaged or left out, with the hash of what is left."""
    with np.load(io.BytesIO(content)) as file:
        arrays = {name: file[name] for name in file.files if name != "hash"}
    damage = {"nan": lambda a: a * np.nan, "text": lambda a: a.astype(str), "short": lambda a: a[:-1]}
    for name in arrays.keys() - {"header"}:
        for what, change in damage.items():
            yield f"{name}: {what}", pack({**arrays, name: change(arrays[name])}, deflated=False)
        yield f"{name}: missing", pack({key: v for key, v in arrays.items() if key != name}, deflated=False)
