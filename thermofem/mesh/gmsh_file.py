"""Files of gmsh, formats 2.2 and 4.1, as text or binary: triangles in named groups.

A count in a damaged file may promise more than the file holds: nothing is allocated before it is known to be there.
meshio reads these formats, too, but allocates first, and its import takes longer than a small solve.
"""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..checks import InputError

LARGEST = 100_000_000  # bytes of a file: about a million triangles as text
_LINE, _TRIANGLE, _POINT = 1, 2, 15  # gmsh's numbers of types, and their corners
_CORNERS = {_LINE: 2, _TRIANGLE: 3, _POINT: 1}
_SECTION = re.compile(rb"\s*\$([A-Za-z]{1,40})[ \t\r]*\n")
_NAME = re.compile(rb'([0-9]{1,9})\s+([0-9]{1,9})\s+"([^"]*)"')
_FORMAT = re.compile(rb"\s*(2\.2|4\.1)\s+([01])\s+8\s*\n?")
_POINT_ROW = np.dtype([("number", "<i4"), ("at", "<f8", 3)])


class Content(NamedTuple):
    """Points (n, 3) in m, triangles (m, 3) of indices from 0, their physical tags, and the names of tags."""

    points: NDArray[np.float64]
    triangles: NDArray[np.int64]
    tags: NDArray[np.int64]
    names: dict[int, str]


def read(content: bytes) -> Content:
    """The triangles of a file, and the points they use; InputError for a damaged file and for other elements."""
    sections = _sections(content)
    head = _FORMAT.match(sections.get(b"MeshFormat", b""))
    if not head:
        raise InputError("it is no gmsh file of format 2.2 or 4.1", "gmsh -save -format msh41 writes one")
    text = head[2] == b"0"
    if not text and sections[b"MeshFormat"][head.end() : head.end() + 4] != b"\x01\x00\x00\x00":
        raise InputError("its numbers have another byte order")
    missing = [name for name in (b"Nodes", b"Elements") if name not in sections]
    if missing:
        raise InputError(f"it has no ${missing[0].decode()}; is it complete?")
    new = head[1] == b"4.1"
    nodes, elements = (_Numbers(sections[name], text) for name in (b"Nodes", b"Elements"))
    numbers, points = (_nodes_41 if new else _nodes_22)(nodes)
    if new:
        groups = _groups(_Numbers(sections[b"Entities"], text)) if b"Entities" in sections else {}
        corners, tags = _elements_41(elements, groups)
    else:
        corners, tags = _elements_22(elements)
    for rest in (nodes, elements):
        rest.end()
    return Content(*_used(numbers, points, corners), tags, _names(sections.get(b"PhysicalNames", b"")))


def _names(section: bytes) -> dict[int, str]:
    """Names of the physical surfaces by tag; one in each line after the first, which counts them."""
    found: dict[int, str] = {}
    for line in section.splitlines()[1:]:
        row = _NAME.fullmatch(line.strip())
        if line.strip() and not row:
            raise InputError(f'its $PhysicalNames has the line {line.decode("utf-8", "replace")!r}; 2 1 "name" is one')
        if row and int(row[1]) == 2:
            if int(row[2]) in found:
                raise InputError(f"its $PhysicalNames names surface {int(row[2])} twice")
            found[int(row[2])] = row[3].decode("utf-8", "replace")
    return found


def _sections(content: bytes) -> dict[bytes, bytes]:
    """What lies between $Name and $EndName."""
    found: dict[bytes, bytes] = {}
    at = 0
    while head := _SECTION.match(content, at):
        name = head[1]
        stop = content.find(b"$End" + name, head.end())
        if stop < 0 or name in found:
            raise InputError(f"its ${name.decode()} {'stands twice' if name in found else 'has no end'}")
        found[name], at = content[head.end() : stop], stop + 4 + len(name)
    if content[at:].strip():
        raise InputError("it is no gmsh file" if not found else "it is damaged between its sections")
    return found


class _Numbers:
    """The numbers of a section, taken one after the other."""

    def __init__(self, content: bytes, text: bool) -> None:
        self.content, self.at, self.values = content, 0, np.empty(0)
        self.text = text
        if text:
            try:
                if b"_" in content:
                    raise ValueError
                self.values = np.array(content.split(), dtype=float)
            except ValueError:
                raise InputError("it holds text where a number belongs") from None

    def take(self, kind: str | np.dtype[Any], count: int) -> Any:
        """The next ``count`` numbers of a type."""
        size = 1 if self.text else np.dtype(kind).itemsize
        if not 0 <= count <= ((self.values.size if self.text else len(self.content)) - self.at) // size:
            raise InputError("it promises more numbers than it holds")
        start, self.at = self.at, self.at + count * size
        if not self.text:
            return np.frombuffer(self.content, kind, count, start)
        found = self.values[start : self.at]
        if np.dtype(kind).kind == "f":
            return found
        if not np.array_equal(found, np.trunc(found)) or np.abs(found).max(initial=0) > 2**53:
            raise InputError("a count or number of a point in it is not whole")
        return found.astype(np.int64)

    def whole(self, count: int, kind: str = "<i4") -> list[int]:
        """The next whole numbers."""
        return list(map(int, self.take(kind, count)))

    def end(self) -> None:
        """InputError unless every number was taken."""
        if (self.at < self.values.size) if self.text else self.content[self.at :].strip():
            raise InputError("it holds more numbers than it promises")


def _count(section: _Numbers) -> int:
    """Number of rows of a section of format 2.2: text on a line of its own, also in a binary file."""
    if section.text:
        return section.whole(1)[0]
    line = re.match(rb"\s*([0-9]{1,9})[ \t\r]*\n", section.content)
    if not line:
        raise InputError("a count in it is no number")
    section.at = line.end()
    return int(line[1])


def _nodes_22(section: _Numbers) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Numbers and places of all points."""
    count = _count(section)
    if section.text:
        rows = section.take("<f8", 4 * count).reshape(-1, 4)
        return rows[:, 0], rows[:, 1:]
    found = section.take(_POINT_ROW, count)
    return found["number"], found["at"]


def _elements_22(section: _Numbers) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Corners, as numbers of points, and physical tags of all triangles."""
    left, corners, tags = _count(section), [], []
    while left > 0:
        kind, rows, count = section.whole(3)
        if section.text:  # the number of the element comes first, and each row has a head of its own
            kind, rows, count, first = rows, 1, count, 0
        else:
            first = 1
        known = _corners(kind)
        if rows < 1 or rows > left or not 0 <= count <= 100:
            raise InputError("a block of its elements is damaged")
        width = first + count + known
        found = section.take("<i4", rows * width).reshape(rows, width)
        left -= rows
        if kind == _TRIANGLE:
            corners.append(found[:, -3:])
            tags.append(found[:, first] if count else np.zeros(rows, dtype=np.int64))
    return _joined(corners, tags)


def _nodes_41(section: _Numbers) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Numbers and places of all points."""
    blocks = section.whole(4, "<u8")[0]
    numbers, points = [np.empty(0)], [np.empty((0, 3))]
    for _ in range(blocks):
        dimension, _, parametric = section.whole(3)
        count = section.whole(1, "<u8")[0]
        width = 3 + (dimension if parametric == 1 and 0 <= dimension <= 3 else 0)
        numbers.append(section.take("<u8", count))
        points.append(section.take("<f8", count * width).reshape(count, width)[:, :3])
    return np.concatenate(numbers), np.concatenate(points)


def _groups(section: _Numbers) -> dict[int, list[int]]:
    """Physical tags of every surface."""
    found: dict[int, list[int]] = {}
    counts = section.whole(4, "<u8")
    for dimension, count in enumerate(counts):
        for _ in range(count):
            tag = section.whole(1)[0]
            section.take("<f8", 6 if dimension else 3)
            physical = section.whole(section.whole(1, "<u8")[0])
            if dimension:
                section.take("<i4", section.whole(1, "<u8")[0])
            if dimension == 2:
                found[tag] = physical
    section.end()
    return found


def _elements_41(section: _Numbers, groups: dict[int, list[int]]) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Corners, as numbers of points, and physical tags of all triangles."""
    corners, tags = [], []
    for _ in range(section.whole(4, "<u8")[0]):
        _, entity, kind = section.whole(3)
        count, width = section.whole(1, "<u8")[0], 1 + _corners(kind)
        found = section.take("<u8", count * width).reshape(count, width)
        if kind == _TRIANGLE:
            physical = groups.get(entity) or [0]
            if len(physical) > 1:
                raise InputError(f"surface {entity} is in the physical groups {physical}; one is needed")
            corners.append(found[:, 1:])
            tags.append(np.full(count, physical[0], dtype=np.int64))
    return _joined(corners, tags)


def _corners(kind: int) -> int:
    """Points of an element; InputError for those that are not computed with."""
    if kind not in _CORNERS:
        raise InputError(
            f"it holds elements of gmsh's type {kind}, which are no triangles of three corners",
            "mesh with triangles of first order, without quadrangles (no Recombine) and volumes",
        )
    return _CORNERS[kind]


def _joined(corners: list[Any], tags: list[Any]) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """All blocks of triangles."""
    if not sum(map(len, corners)):
        raise InputError("it holds no triangles")
    return np.concatenate(corners), np.concatenate(tags).astype(np.int64)


def _used(numbers: Any, points: Any, corners: Any) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The points that triangles use, in their order in the file, and the triangles as indices into them."""
    order = np.argsort(numbers, kind="stable")
    sorted_numbers = numbers[order]
    if np.any(sorted_numbers[1:] == sorted_numbers[:-1]):
        raise InputError("two of its points have the same number")
    at = np.minimum(np.searchsorted(sorted_numbers, corners), max(0, len(numbers) - 1))
    if not len(numbers) or np.any(sorted_numbers[at] != corners):
        raise InputError("a triangle has a corner that is none of its points")
    used, triangles = np.unique(order[at], return_inverse=True)
    return np.asarray(points[used], dtype=float), triangles.reshape(corners.shape)
