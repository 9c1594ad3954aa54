"""Reading of the mesh files that `Mesh.save` writes, without meshio: its import takes longer than a small solve."""

from __future__ import annotations

import re
import struct
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

_TRIANGLE, _TAGS = 2, 2  # gmsh's number of the type, and tags of each: physical and geometrical
_HEAD = re.compile(
    rb"\$MeshFormat\n2\.2 1 8\n\x01\x00\x00\x00\s*\$EndMeshFormat\n"
    rb'\$PhysicalNames\n([0-9]{1,6})\n((?:2 [0-9]{1,6} "[^"\n]*"\n)+)\$EndPhysicalNames\n\$Nodes\n([0-9]{1,9})\n'
)
_BETWEEN = re.compile(rb"\s*\$EndNodes\n\$Elements\n([0-9]{1,9})\n")
_NAME = re.compile(rb'2 ([0-9]+) "([^"]*)"')
_POINT = np.dtype([("number", "<i4"), ("at", "<f8", 3)])


class Content(NamedTuple):
    """Points (n, 3) in m, triangles (m, 3) of indices from 0, their physical tags, and the names of tags."""

    points: NDArray[np.float64]
    triangles: NDArray[np.int64]
    tags: NDArray[np.int64]
    names: dict[int, str]


def read(content: bytes) -> Content | None:
    """The mesh of a binary file of format 2.2 with named triangles in one block; None for any other file.

    Whatever is None here, or damaged, is for meshio to read and to refuse.
    """
    head = _HEAD.match(content)
    if not head:
        return None
    names = {int(tag): name.decode("utf-8", "replace") for tag, name in _NAME.findall(head[2])}
    points = _block(content, head.end(), _POINT, int(head[3]))
    if points is None or not np.array_equal(points["number"], np.arange(1, len(points) + 1)):
        return None
    between = _BETWEEN.match(content, head.end() + points.nbytes)
    if not between or len(content) < between.end() + 12:
        return None
    count, at = int(between[1]), between.end() + 12
    rows = _block(content, at, np.dtype(("<i4", 1 + _TAGS + 3)), count)
    if rows is None or struct.unpack("<3i", content[at - 12 : at]) != (_TRIANGLE, count, _TAGS):
        return None
    if content[at + rows.nbytes :].split() != [b"$EndElements"]:
        return None
    rows = rows.astype(np.int64)
    return Content(points["at"].astype(float), rows[:, 3:] - 1, rows[:, 1], names)


def _block(content: bytes, at: int, kind: np.dtype[Any], count: int) -> NDArray[Any] | None:
    """``count`` records from a place on, or None where the file ends before."""
    if not count or len(content) < at + count * kind.itemsize:
        return None
    return np.frombuffer(content, kind, count, at)
