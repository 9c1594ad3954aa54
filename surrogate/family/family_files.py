"""A family as one file: arrays in NumPy's archive, whatever name the user gives it; no mesher is needed to use it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from thermofem import Campaign, checks
from thermofem.arrays import Array
from thermofem.campaign import Variation
from thermofem.checks import check_names
from thermofem.data.files import from_json, read_bytes, write_whole
from thermofem.data.netcdf import DAMAGE
from thermofem.mesh import Mesh

from .affine_engine import AffineMembers, Coefficients
from .affine_grid import ARRAYS, Axis, CellGrid, SampledWeights, SurfacePoints
from .interpolation import OpticalNumbers, OutputMaps
from .members import pack, unpack
from .moved_mesh_engine import MovedMeshEngine, MovedMeshMembers
from .parameter_box import Box

if TYPE_CHECKING:
    from .family import Family

FORMAT, SCHEMA = "thermofem family", 2
_PLAIN = "inputs", "outputs", "tolerance", "floor", "factor", "engine", "provenance"  # of a family, as JSON has them


def save(family: Family, path: str | Path) -> Path:
    """Write a family as one file."""
    box, maps, campaign = family.box, family.output_maps, family.box.campaign
    content: dict[str, Any] = {"format": FORMAT, "schema": SCHEMA, **{name: getattr(family, name) for name in _PLAIN}}
    content["error"] = vars(family.error)
    content["campaign"] = {name: getattr(campaign, name) for name in ("name", "geometry", "heated", "read")}
    content["campaign"]["variations"] = [
        {name: value for name, value in vars(v).items() if not (v.values and name in ("low", "high"))}
        for v in campaign.variations
    ]
    arrays: dict[str, Any] = {"low": box.low, "high": box.high}
    if isinstance(family.members, AffineMembers):
        more, own = _affine_fields(family.members)
    else:
        mesh, moved = family.members.moved.mesh, family.members.moved
        more = {"regions": mesh.region_names, "accuracy": moved.accuracy}
        own = {"points": mesh.points, "triangles": mesh.triangles, "region": mesh.region, "basis": family.members.basis}
    content = content | more
    arrays = arrays | own
    if maps is not None:
        content["output_maps"] = {"power": maps.power, "error": maps.error}
        arrays |= {"map_shares": maps.shares, "map_coefficients": maps.coefficients}
    if family.optics is not None:
        content["optics"], own = family.optics.content()
        arrays |= own
    whole = pack({"header": np.array(json.dumps(content)), **arrays})
    return write_whole(path, lambda p: p.write_bytes(whole))


def _affine_fields(members: AffineMembers) -> tuple[dict[str, Any], dict[str, Any]]:
    """JSON fields and arrays that store an affine family; of symmetric matrices the upper triangles, row by row."""
    c, grid, upper = members.coefficients, members.coefficients.grid, np.triu_indices(members.size)
    words: dict[str, Any] = {"owner": grid.owner}
    arrays: dict[str, Any] = {"K": members.K[:, *upper], "M": members.M[:, *upper]}
    arrays |= {"ports": members.ports, "volumes": members.volumes, "left": grid.left, "lower": grid.lower}
    for name, axis in (("r", grid.r), ("z", grid.z)):
        arrays |= {f"{name}_base": axis.base, f"{name}_slope": axis.slope}
    for name, (kind, ratio) in (("stiffness", c.stiffness), ("capacity", c.capacity)):
        arrays |= {f"{name}_kind": kind, f"{name}_ratio": ratio}
    if c.surface is not None:
        words["surface"] = {"series": c.surface.points.series, "material": c.surface.points.material}
        arrays["modes"] = c.surface.modes
        arrays |= {f"surface_{name}": getattr(c.surface.points, name) for name in ARRAYS}
    return words, arrays


def read(path: str | Path, make: Callable[[dict[str, Any]], Family]) -> Family:
    """Read the file that `Family.save` wrote; returns ``make(fields)``, where the field ``error`` is a dict of numbers.

    Raises InputError: no such file, not a family, one of another schema, or one that cannot be made.
    """
    raw = read_bytes(path, "family")
    with checks.prefixed(f"{path} is not a family that thermofem wrote", *DAMAGE, hint="is it complete?"):
        arrays = unpack(raw)
        content = from_json(str(arrays.pop("header")))
        found = content["format"], content["schema"]
    if found != (FORMAT, SCHEMA):
        raise checks.InputError(f"{path} has schema {checks.shown(found[1])}; this version reads {SCHEMA}")
    with checks.prefixed(f"{path} is not a complete family", *DAMAGE):
        for name, values in arrays.items():
            checks.numbers(name, values.astype(float))
        return make(_fields(content, arrays))


def _fields(content: dict[str, Any], a: dict[str, Any]) -> dict[str, Any]:
    box = _box(content["campaign"], a)
    error = content["error"]
    maps = content.get("output_maps")
    inputs = check_names("inputs", content["inputs"])
    outputs = check_names("outputs", content["outputs"])
    if content["engine"].startswith("affine"):
        members: AffineMembers | MovedMeshMembers = _lines(content, a, box)
    else:
        mesh = Mesh(a["points"], a["triangles"], a["region"], tuple(content["regions"]))
        moved = MovedMeshEngine(box, float(content["accuracy"]), mesh)
        members = MovedMeshMembers(moved, a["basis"], tuple(dict.fromkeys((*inputs, *outputs))))
    return {
        "box": box,
        "inputs": inputs,
        "outputs": outputs,
        "tolerance": checks.positive("tolerance", content["tolerance"], at_most=1),
        **{name: checks.between(name, content[name], 0, checks.LARGEST) for name in ("floor", "factor")},
        "members": members,
        "error": {
            **{name: checks.between(name, error[name], 0, checks.LARGEST) for name in ("worst", "median")},
            "count": checks.integer("count", error["count"], 1, np.inf),
        },
        "output_maps": maps and OutputMaps(**maps, shares=a["map_shares"], coefficients=a["map_coefficients"]),
        "optics": OpticalNumbers.of_content(content["optics"], a) if "optics" in content else None,
        "provenance": dict(content["provenance"]),
    }


def _box(stored: dict[str, Any], a: dict[str, Array]) -> Box:
    variations = tuple(
        Variation(**{**one, "paths": tuple(one["paths"]), "values": tuple(one["values"])})
        for one in stored["variations"]
    )
    drawn = int(any(not v.values for v in variations))
    words = {**stored, "variations": variations, "read": tuple(stored["read"])}
    box = Box(Campaign(**words, samples=drawn), a["low"], a["high"])
    for ends in (box.low, box.high):
        checks.shape("range", ends, (box.size,))
    if not np.all(box.low < box.high):
        raise ValueError("ranges and parameters do not fit")
    return box


def _lines(content: dict[str, Any], a: dict[str, Any], box: Box) -> AffineMembers:
    r = Axis(a[f"{'r'}_base"], a[f"{'r'}_slope"])
    z = Axis(a[f"{'z'}_base"], a[f"{'z'}_slope"])
    grid = CellGrid(box, r, z, a["left"], a["lower"], content["owner"])
    surface = None
    if "surface" in content:
        series = [tuple(one) for one in content["surface"]["series"]]
        fields = {name: a[f"surface_{name}"] for name in ARRAYS}
        surface = SampledWeights(SurfacePoints(**fields, **{**content["surface"], "series": series}), a["modes"])
    stiffness = (a[f"{'stiffness'}_kind"], a[f"{'stiffness'}_ratio"])
    capacity = (a[f"{'capacity'}_kind"], a[f"{'capacity'}_ratio"])
    n = a["ports"].shape[-1]
    i, j = np.triu_indices(n)
    square = {name: np.zeros((len(a[name]), n, n)) for name in ("K", "M")}
    for name, full in square.items():
        full[:, i, j] = full[:, j, i] = a[name]
    coefficients = Coefficients(grid, stiffness, capacity, surface)
    return AffineMembers(coefficients, **square, ports=a["ports"], volumes=a["volumes"])
