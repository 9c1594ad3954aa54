"""Generators of hostile input, seeded: names, text, numbers, units, trees and files that somebody else may send.

Each generator gives pairs (what it is, the thing). The tests run every reader over all of them; `make fuzz` draws more.
"""

from __future__ import annotations

import contextlib
import io
import json
import random
import struct
import threading
import time
import warnings
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from surrogate.family.archive import pack

BREAKS = ["\n", "\r", "\r\n", "\x0b", "\x0c", "\x1c", "\x1d", "\x1e", "\x85", "\u2028", "\u2029"]
ODD = ["\0", "\x1b[31m", "\t", "\x7f", "\u202e", "\ud800", '"', "'", "`", "$", "\\", "/", "*/", "]", "[/x]", "{", "%"]


def names() -> list[str]:
    """Names that no file may carry on: line breaks with commands behind them, control characters, too long, empty."""
    command = ".control\nshell touch hostile\n.endc"
    broken = [f"core{b}{command.replace(chr(10), b)}" for b in BREAKS]
    return [*broken, *(f"core{odd}x" for odd in ODD), "", " ", "-", "core;x", "x" * 101, "core=1", "a" * 10**6]


def texts() -> list[str]:
    """Texts that a provenance may hold, and that a writer must keep on the lines of its comment."""
    return [f"wafer 7{b}.control{b}shell touch hostile{b}.endc{b}.include /etc/passwd" for b in BREAKS] + [
        f"x{odd}y" for odd in ODD if odd != "\ud800"
    ]


def numbers() -> list[str]:
    """Numbers as JSON or TOML text that no reader may take, or may take only as a finite float."""
    return ["9" * 400, "9" * 5000, "-" + "9" * 400, "1e400", "NaN", "Infinity", "-Infinity", "nan", "inf", "1_0", "١٢"]


def units() -> list[str]:
    """Quantities whose unit costs more than it is worth."""
    return [
        "1 mW*9**9**9**9", "1 nm*(2**999999999)", "1 " + "m" * 100_000, "1 " + "*".join(["m"] * 3000), "1 m**99999999",
        "1 " + "(" * 500 + "m" + ")" * 500, "1 m^-999999999", "1 9**9**9**9", "1 m**m", "1 m;import os", "1 __import__",
        "١ m", "1_0 m", "9" * 500 + " m", "1 m\0", "1 m/", "1 \ud800", "1 m**2.5", "1 2 m", "1 m 9**9**9",
    ]  # fmt: skip


def trees(seed: int = 0, count: int = 40) -> list[str]:
    """JSON texts of odd shape and depth, beside the seeded random ones."""
    pick = random.Random(seed)
    deep = ["[" * n + "]" * n for n in (100, 1000, 100_000)] + ['{"a":' * 1000 + "1" + "}" * 1000]
    odd = [
        "[Infinity,[]]",
        "[]",
        "null",
        "3",
        '"\\ud800"',
        "{",
        "",
        "\0",
        "[1,",
        '{"kind": []}',
        '{"kind": {}}',
        '{"kind": 3}',
    ]

    def grow(depth: int) -> Any:
        leaves = [None, True, 0, -1, 10**30, 1e300, "x", "", "\n", [], {}]
        if depth == 0 or pick.random() < 0.4:
            return pick.choice(leaves)
        items = [grow(depth - 1) for _ in range(pick.randrange(4))]
        keys = ["kind", "poles", "R", "tau", "inputs", "name", "times", "power", "cases"]
        return items if pick.random() < 0.5 else {pick.choice(keys): item for item in items}

    return [*deep, *odd, *(f'{{"x": {n}}}' for n in numbers()), *(json.dumps(grow(5)) for _ in range(count))]


def tomls() -> list[str]:
    """TOML texts beside the geometry's own: depth, integers of any length, dates, NUL."""
    nested = [f"a = {'[' * n}{']' * n}" for n in (100, 1000, 20_000)]
    return [
        *nested, *(f"x = {n}" for n in numbers()), "x = 1979-05-27", 'geometry = "\\u0000"', "a." * 5000 + "b = 1",
        "[probes]\nread = 5", "[[vary]]\npath = []", "[[drive]]\npower = 1979-05-27", "samples = " + "9" * 5000,
    ]  # fmt: skip


def netcdf(folder: Path) -> Iterator[tuple[str, Path]]:
    """netCDF files that declare more than they hold, point at other files, or say the wrong unit."""
    import h5netcdf
    import h5py

    def file(name: str) -> Any:
        made = h5py.File(folder / f"{name}.nc", "w")
        made["time"] = np.linspace(0, 1e-5, 20)
        return made

    secret = folder / "secret.bin"
    secret.write_bytes(b"8 bytes!" * 20)
    with file("declares") as made:
        made.create_dataset("delta_T", shape=(10**12,), dtype="f8", chunks=(10**6,), compression="gzip")
    yield "declares 1e12 values", folder / "declares.nc"
    with file("scale") as made:  # h5netcdf leaves a dimension without values alone, unless its NAME is an array
        made.create_dataset("delta_T", shape=(10**12,), dtype="f8", chunks=(10**6,), compression="gzip")
        made["delta_T"].attrs["NAME"] = [b"This is a netCDF dimension but not a netCDF variable."]
    yield "more than fit", folder / "scale.nc"
    with file("external") as made:
        made.create_dataset("delta_T", shape=(20,), dtype="f8", external=[(str(secret), 0, 160)])
    yield "lie in another file", folder / "external.nc"
    with file("virtual") as made:
        layout = h5py.VirtualLayout(shape=(20,), dtype="f8")
        layout[:] = h5py.VirtualSource(str(folder / "declares.nc"), "time", shape=(20,))
        made.create_virtual_dataset("delta_T", layout)
    yield "views of other files", folder / "virtual.nc"
    with file("link") as made:
        made["delta_T"] = h5py.ExternalLink(str(folder / "declares.nc"), "time")
    yield "a link to another file", folder / "link.nc"
    with file("complex") as made:
        made["delta_T"] = np.zeros(20, dtype=complex)
    yield "holds complex values", folder / "complex.nc"
    with h5netcdf.File(folder / "dimension.nc", "w") as made:
        made.dimensions = {"time": 20}
        made.create_variable("time", ("time",), data=np.linspace(0, 1e-5, 20))
        made.create_variable("delta_T", ("time",), data=np.zeros(20))
    with h5py.File(folder / "dimension.nc", "a") as made:
        del made["time"]  # the other variable still refers to it
    yield "cannot be read as netCDF", folder / "dimension.nc"
    for name, unit in (("metres", "m"), ("nonsense", "furlongs_per"), ("bomb", "s*9**9**9**9")):
        with file(name) as made:
            made["time"].attrs["units"] = unit
            made["delta_T"] = np.zeros(20)
        yield "variable 'time'", folder / f"{name}.nc"
    for length in (12, 30):  # h5netcdf adds zeros, or leaves what is too long for its dimension
        with h5netcdf.File(folder / f"{length}.nc", "w") as made:
            made.dimensions = {"time": 20}
            made.create_variable("time", ("time",), data=np.linspace(0, 1e-5, 20))
        with h5py.File(folder / f"{length}.nc", "a") as made:
            made.create_dataset("delta_T", data=np.zeros(length), maxshape=(None,)).dims[0].attach_scale(made["time"])
        yield f"'delta_T' has {length} values, its dimension 'time' 20", folder / f"{length}.nc"
    for version in (1, 2, 5):
        (folder / f"classic{version}.nc").write_bytes(b"CDF" + bytes([version]) + b"\0" * 30)
        yield "save it as netCDF-4", folder / f"classic{version}.nc"
    for name in ("unit", "Units"):  # read as K, 1000 times too large
        with file(name) as made:
            made["delta_T"] = np.linspace(0, 1e3, 20)
            made["delta_T"].attrs[name] = "mK"
        yield f"has an attribute '{name}'", folder / f"{name}.nc"


TEXT_22 = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
3
1 3 "axis"
2 7 "core"
2 9 "box"
$EndPhysicalNames
$Nodes
5
1 0 0 0
2 1e-6 0 0
3 1e-6 1e-6 0
4 0 1e-6 0
8 2e-6 0 0
$EndNodes
$Elements
4
1 1 2 3 1 1 4
2 2 2 7 1 1 2 3
3 2 2 7 1 1 3 4
4 2 2 9 2 2 8 3
$EndElements
"""
TEXT_41 = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
2
2 7 "core"
2 9 "box"
$EndPhysicalNames
$Entities
1 1 2 0
1 0 0 0 0
1 0 0 0 0 1e-6 0 0 2 1 -1
1 0 0 0 1e-6 1e-6 0 1 7 1 1
2 1e-6 0 0 2e-6 1e-6 0 1 9 0
$EndEntities
$Nodes
2 5 1 8
0 1 0 1
1
0 0 0
2 1 0 4
2
3
4
8
1e-6 0 0
1e-6 1e-6 0
0 1e-6 0
2e-6 0 0
$EndNodes
$Elements
3 4 1 4
1 1 1 1
1 1 4
2 1 2 2
2 1 2 3
3 1 3 4
2 2 2 1
4 2 8 3
$EndElements
"""


def contradicting(data: Any, seed: int = 0) -> Iterator[tuple[str, Any]]:
    """Copies of a Dataset of a part heated from rest, in K over s, whose time or attributes contradict its values.

    Each is refused, or carries a note.
    """
    pick = random.Random(seed)
    end, top = float(data["time"][-1]), float(data["delta_T"].max())
    for _ in range(4):
        offset = end * 10 ** pick.uniform(-2, 1)
        yield f"{offset:g} s late", data.assign_coords(time=("time", data["time"].values + offset, data["time"].attrs))
        factor = 10 ** pick.uniform(0.3, 4)
        gain = top / float(data["power"].max())
        yield f"{factor:g} times the resistance", data.assign_attrs(thermal_resistance=factor * gain)
        yield f"a {factor:g}th of the resistance", data.assign_attrs(thermal_resistance=gain / factor)
    for name in ("delta_T", "time", "power"):
        value = float(data[name].max())
        for key, limit in {
            "valid_min": value * 1.01, "valid_max": value * 0.99, "valid_range": [-1.0, value * 0.99],
            "missing_value": value, "_FillValue": value, "valid_range ": "x",
        }.items():  # fmt: skip
            odd = data.copy(deep=True)
            odd[name].attrs[key.strip()] = limit
            yield f"{name}: {key} = {limit}", odd


def meshes() -> dict[str, bytes]:
    """Files of gmsh that are valid: two squares in the plane, the second one half cut away."""
    formats = {  # of the numbers of each line of 4.1: int, size_t, double; the last letter goes on
        b"Entities": ["Q", "idddQ", "iddddddQQi", "iddddddQiQi", "iddddddQiQi"],
        b"Nodes": ["Q", "iiiQ", "Q", "d", "iiiQ", *"QQQQ", *"dddd"],
        b"Elements": ["Q", "iiiQ", "Q", "iiiQ", "Q", "Q", "iiiQ", "Q"],
    }
    binary = b"$MeshFormat\n4.1 1 8\n" + struct.pack("<i", 1) + b"\n$EndMeshFormat\n"
    at = TEXT_41.index("$PhysicalNames")
    binary += TEXT_41[at : TEXT_41.index("$Entities")].encode()
    for name, kinds in formats.items():
        head = b"$" + name + b"\n"
        start = TEXT_41.encode().index(head) + len(head)
        lines = TEXT_41.encode()[start : TEXT_41.encode().index(b"$End" + name)].splitlines()
        packed = b""
        for line, kind in zip(lines, kinds, strict=True):
            for k, number in enumerate(line.split()):
                letter = kind[min(k, len(kind) - 1)]
                packed += struct.pack(f"<{letter}", float(number) if letter == "d" else int(number))
        binary += head + packed + b"\n$End" + name + b"\n"
    return {"2.2 text": TEXT_22.encode(), "4.1 text": TEXT_41.encode(), "4.1 binary": binary}


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


def flipped(content: bytes, last: int) -> Iterator[bytes]:
    """Copies of a file with one byte inverted: every eighth up to the last, the groups of an HDF5 file among them."""
    for k in range(0, min(last, len(content)), 8):
        yield content[:k] + bytes([content[k] ^ 0xFF]) + content[k + 1 :]


@contextlib.contextmanager
def changing(path: Path, seed: int) -> Iterator[None]:
    """Write over a file, replace it and delete it again and again, in another thread; in the end it is as before."""
    content, over, pick = path.read_bytes(), threading.Event(), random.Random(seed)
    forms = [content] * 15 + list(damaged(content, seed, 15))

    def change() -> None:
        while not over.is_set():
            how, other = pick.randrange(3), pick.choice(forms)
            if how == 0:
                path.write_bytes(other)
            elif how == 1:
                path.with_suffix(".other").write_bytes(other)
                path.with_suffix(".other").replace(path)
            else:
                path.unlink(missing_ok=True)
            time.sleep(0.004 * pick.random())

    thread = threading.Thread(target=change)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        path.write_bytes(content)


TOML_VALUES = [
    "true", "0", "-1", "1.5", "1e308", "-1e-320", "9223372036854775807", '""', '" "', '"x"', '"1"', '"0 m"',
    '"-1 um"', '"nan m"', '"1e400 W"', '"1e-320 s"', '"3 K"', '"no"', "[]", "[[]]", "[1, 2]", '["core", 3]', "{}",
    "{ a = 1 }", '"a\\nb"', '"../x"', '"/dev/zero"', f'"{"x" * 10_000}"', "1979-05-27", '"1 mW*9**9**9"',
]  # fmt: skip
JSON_VALUES: list[Any] = [
    None, True, 0, -1, 1.5, 1e308, -1e-320, 5e-324, 10**18, 10**30, "", " ", "x", "1", "a\nb", "x" * 10_000, "../x",
    "/dev/zero", [], [[]], [1, 2], [[1.0, 2.0], [3.0]], ["core", 3], {}, {"a": 1}, [None], [True], [10**18],
]  # fmt: skip


def replaced_lines(text: str) -> Iterator[str]:
    """TOML with the value of one line replaced, the line left out, or there twice."""
    lines = text.splitlines()
    for k, line in enumerate(lines):
        key, equals, _ = line.partition(" = ")
        if equals:
            for value in TOML_VALUES:
                yield "\n".join([*lines[:k], f"{key} = {value}", *lines[k + 1 :]])
        if line.strip():
            yield "\n".join(lines[:k] + lines[k + 1 :])
            yield "\n".join(lines[: k + 1] + lines[k:])


def replaced_leaves(tree: Any) -> Iterator[Any]:
    """Trees with one node of a tree replaced, left out or there twice; an object also with one key more."""
    yield from JSON_VALUES
    if isinstance(tree, dict):
        yield {**tree, "another": 1}
        for key, value in tree.items():
            yield {k: v for k, v in tree.items() if k != key}
            yield from ({**tree, key: other} for other in replaced_leaves(value))
    if isinstance(tree, list):
        for k in sorted({0, len(tree) - 1} if tree else ()):
            yield tree[:k] + tree[k + 1 :]
            yield [*tree[: k + 1], *tree[k:]]
            yield from ([*tree[:k], other, *tree[k + 1 :]] for other in replaced_leaves(tree[k]))


ARRAY_DAMAGE: dict[str, Callable[[Any], Any]] = {
    "nan": lambda a: a * np.nan,
    "infinite": lambda a: a / 0.0,
    "complex": lambda a: a.astype(complex),
    "text": lambda a: a.astype(str),
    "a number": lambda a: np.array(3.0),
    "short": lambda a: a[:-1],
    "twice": lambda a: np.repeat(a, 2, axis=0),
    "another dimension": lambda a: a.T[..., None],
    "negative": lambda a: -1 - a,
    "zero": lambda a: 0 * a,
    "1 % more": lambda a: a * 1.01 if a.dtype.kind == "f" else a + 1,
}


VARIABLE_DAMAGE: dict[str, Callable[[Any], Any]] = {
    **{what: damage for what, damage in ARRAY_DAMAGE.items() if what not in ("a number", "short", "twice")},
    "bytes": lambda a: np.full(a.shape, b"a"),
    "records": lambda a: np.zeros(a.shape, [("a", float), ("b", int)]),
    "objects": lambda a: np.full(a.shape, None),
    "arrays": lambda a: np.array([np.empty(0)] * a.size + [None], object)[:-1],
    "true or false": lambda a: a > a.mean(),
    "one nan": lambda a: np.where(np.arange(a.size) == a.size // 2, np.nan, a),
    "seconds late": lambda a: a + 100.0,
    "tiny": lambda a: a * 1e-300,
    "huge": lambda a: a * 1e300,
    "repeated": lambda a: np.full(a.shape, a[1]),
}
ATTRIBUTES: list[Any] = [
    "",
    "{",
    "[]",
    "null",
    5,
    float("nan"),
    np.array([1, 2]),
    np.array(["a", "b"]),
    b"\xff",
    "x" * 10_000,
]


def datasets(data: Any) -> Iterator[tuple[str, Any]]:
    """Copies of a Dataset along time with one variable damaged or one attribute replaced."""
    for name in data.variables:
        for what, damage in VARIABLE_DAMAGE.items():
            with np.errstate(all="ignore"):
                other = damage(data[name].values)
            if other.shape == data[name].shape:
                yield f"{name}: {what}", data.assign({name: ("time", other, data[name].attrs)})
    for name in (*data.attrs, "geometry", "materials"):
        for value in ATTRIBUTES:
            yield f"{name} = {value!r:.20}", data.assign_attrs({name: value})


def archives(content: bytes) -> Iterator[tuple[str, bytes]]:
    """Copies of NumPy's archive with one array damaged or left out, with the hash of what is left."""
    with np.load(io.BytesIO(content)) as file:
        arrays = {name: file[name] for name in file.files if name != "hash"}
    for name in arrays.keys() - {"header"}:
        with np.errstate(all="ignore"):
            others = {what: damage(arrays[name]) for what, damage in ARRAY_DAMAGE.items()}
        trees = [(what, {**arrays, name: other}) for what, other in others.items()]
        trees.append(("missing", {key: value for key, value in arrays.items() if key != name}))
        for what, tree in trees:
            yield f"{name}: {what}", pack(tree, deflated=False)
        for shape in ("(" * 5000, "(-1,)", "(10**9,)", "(1000000000000,)", "'", "(1,)\n  x", "\0"):
            memory = io.BytesIO(content)
            with zipfile.ZipFile(memory, "a") as file:  # a second member of the name: the last one counts
                text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
                with warnings.catch_warnings(action="ignore"):
                    file.writestr(f"{name}.npy", b"\x93NUMPY\x01\0" + len(text).to_bytes(2, "little") + text)
            yield f"{name}: shape {shape[:9]}", memory.getvalue()
