"""A family as one file: arrays in NumPy's archive, whatever name the user gives it; no mesher is needed to use it.

The archive holds the arrays under dotted names, and as JSON the tree of all other numbers and words. An object of one
of the `KINDS` is stored as the arguments of its constructor, whose names are those of its attributes.
"""

from __future__ import annotations

import inspect
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from thermofem import Campaign, checks
from thermofem.campaign import Variation
from thermofem.data.files import from_json, read_bytes, write_whole
from thermofem.data.netcdf import DAMAGE
from thermofem.mesh import Mesh

from .affine_engine import AffineMembers, Coefficients
from .affine_grid import Axis, CellGrid, SampledWeights, SurfacePoints
from .interpolation import OutputMaps, Polynomial
from .members import HeldOut, pack, unpack
from .moved_mesh_engine import MovedMeshEngine, MovedMeshMembers
from .optical_numbers import LightPort, Members, OpticalNumbers
from .parameter_box import Box

FORMAT = "thermofem family"
SCHEMA = 3
KINDS: dict[str, Any] = {
    kind.__name__: kind
    for kind in (
        AffineMembers, Axis, Box, Campaign, CellGrid, Coefficients, HeldOut, LightPort, Members, Mesh, MovedMeshEngine,
        MovedMeshMembers, OpticalNumbers, OutputMaps, Polynomial, SampledWeights, SurfacePoints, Variation,
    )
}  # fmt: skip


def save(family: Any, path: str | Path) -> Path:
    """Write a family as one file."""
    arrays: dict[str, Any] = {}
    tree = {"format": FORMAT, "schema": SCHEMA, "family": _parts(family, "", arrays)}
    arrays["header"] = np.array(json.dumps(tree))
    whole = pack(arrays)
    return write_whole(path, lambda p: p.write_bytes(whole))


def _parts(value: Any, name: str, arrays: dict[str, Any]) -> dict[str, Any]:
    """Trees of the arguments that make an object; a family does not depend on the drives of its campaign."""
    names = [part for part in inspect.signature(type(value)).parameters if part != "drives"]
    return {part: _tree(getattr(value, part), f"{name}{part}.", arrays) for part in names}


def _tree(value: Any, name: str, arrays: dict[str, Any]) -> Any:
    """What JSON holds of a value; arrays are added to ``arrays`` and leave their names."""
    if isinstance(value, np.ndarray):
        arrays[name[:-1]] = value
        return {"array": name[:-1]}
    if isinstance(value, tuple | list):
        return [_tree(part, f"{name}{k}.", arrays) for k, part in enumerate(value)]
    if type(value) in KINDS.values():
        return {"kind": type(value).__name__, **_parts(value, name, arrays)}
    absent = isinstance(value, float) and math.isnan(value)
    return None if absent else value


def read(path: str | Path, make: Callable[..., Any], check: Callable[[Any], None]) -> Any:
    """Read the file that `Family.save` wrote; returns ``make(**fields)``, which ``check`` has seen.

    Raises InputError: no such file, not a family, one of another schema, or one that cannot be made.
    """
    raw = read_bytes(path, "family")
    with checks.prefixed(f"{path} is not a family that thermofem wrote", *DAMAGE, hint="is it complete?"):
        arrays = unpack(raw)
        content = from_json(str(arrays.pop("header")))
        name = content["format"]
        schema = content["schema"]
    if (name, schema) != (FORMAT, SCHEMA):
        raise checks.InputError(f"{path} has schema {checks.shown(schema)}; this version reads {SCHEMA}")
    with checks.prefixed(f"{path} is not a complete family", *DAMAGE):
        for name, values in arrays.items():
            checks.numbers(name, values.astype(float))
        family = make(**{part: _made(tree, arrays) for part, tree in content["family"].items()})
        check(family)
    return family


def _made(tree: Any, arrays: dict[str, Any]) -> Any:
    """The value of a tree; the inverse of `_tree`."""
    if isinstance(tree, list):
        return tuple(_made(part, arrays) for part in tree)
    if not isinstance(tree, dict):
        return tree
    if "array" in tree:
        return arrays[tree["array"]]
    if "kind" not in tree:
        return tree
    parts = {name: _made(part, arrays) for name, part in tree.items() if name != "kind"}
    return KINDS[tree["kind"]](**parts)
