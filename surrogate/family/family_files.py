"""A family as one file: arrays in NumPy's archive, whatever name the user gives it; no mesher is needed to use it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thermofem import Campaign, checks
from thermofem.arrays import Array
from thermofem.campaign import Variation
from thermofem.checks import check_names
from thermofem.data.files import from_json, read_bytes, write_whole
from thermofem.data.netcdf import DAMAGE
from thermofem.geometry.section_parts import LIGHT
from thermofem.mesh import Mesh

from .affine_engine import AffineMembers, Coefficients
from .affine_grid import ARRAYS, Axis, CellGrid, SampledWeights, SurfacePoints
from .interpolation import OutputMaps
from .members import pack, unpack
from .moved_mesh_engine import MovedMeshEngine, MovedMeshMembers
from .optical_numbers import LightPort, LitMembers, OpticalNumbers
from .parameter_box import Box

if TYPE_CHECKING:
    from .family import Family

FORMAT = "thermofem family"
SCHEMA = 2
_PLAIN = "inputs", "outputs", "tolerance", "floor", "factor", "engine", "provenance"  # of a family, as JSON has them


def save(family: Family, path: str | Path) -> Path:
    """Write a family as one file."""
    box = family.box
    maps = family.output_maps
    campaign = box.campaign
    content: dict[str, Any] = {"format": FORMAT, "schema": SCHEMA}
    content |= {name: getattr(family, name) for name in _PLAIN}
    content["error"] = vars(family.error)
    content["campaign"] = {name: getattr(campaign, name) for name in ("name", "geometry", "heated", "read")}
    content["campaign"]["variations"] = [_variation(v) for v in campaign.variations]
    arrays: dict[str, Any] = {"low": box.low, "high": box.high}
    members = family.members
    if isinstance(members, LitMembers):
        arrays |= {f"light_{name}": values for name, values in vars(members.light).items()}
        members = members.members
    fields = _affine_fields(members) if isinstance(members, AffineMembers) else _moved_fields(members)
    content |= fields.words
    arrays |= fields.arrays
    if maps is not None:
        content["output_maps"] = {"power": maps.power, "error": maps.error}
        arrays |= {"map_shares": maps.shares, "map_coefficients": maps.coefficients}
    if family.optics is not None:
        content["optics"], polynomials = family.optics.content()
        arrays |= polynomials
    arrays["header"] = np.array(json.dumps(content))
    whole = pack(arrays)
    return write_whole(path, lambda p: p.write_bytes(whole))


class Fields(NamedTuple):
    """JSON fields and arrays that store a part of a family."""

    words: dict[str, Any]
    arrays: dict[str, Any]


def _variation(v: Variation) -> dict[str, Any]:
    """JSON fields of a varied parameter; a list of values has no ends."""
    fields = dict(vars(v))
    if v.values:
        del fields["low"], fields["high"]
    return fields


def _moved_fields(members: MovedMeshMembers) -> Fields:
    """Fields of a family on moved meshes."""
    mesh = members.moved.mesh
    words = {"regions": mesh.region_names, "accuracy": members.moved.accuracy}
    arrays = {"points": mesh.points, "triangles": mesh.triangles, "region": mesh.region, "basis": members.basis}
    return Fields(words, arrays)


def _affine_fields(members: AffineMembers) -> Fields:
    """Fields of an affine family; of symmetric matrices the upper triangles, row by row."""
    c = members.coefficients
    grid = c.grid
    upper = np.triu_indices(members.size)
    words: dict[str, Any] = {"owner": grid.owner}
    arrays: dict[str, Any] = {"K": members.K[:, *upper], "M": members.M[:, *upper]}
    arrays |= {"ports": members.ports, "volumes": members.volumes, "left": grid.left, "lower": grid.lower}
    for name, axis in (("r", grid.r), ("z", grid.z)):
        arrays |= {f"{name}_base": axis.base, f"{name}_slope": axis.slope}
    for name, (kind, ratio) in (("stiffness", c.stiffness), ("capacity", c.capacity)):
        arrays |= {f"{name}_kind": kind, f"{name}_ratio": ratio}
    if c.surface is not None:
        points = c.surface.points
        words["surface"] = {"series": points.series, "material": points.material}
        arrays["modes"] = c.surface.modes
        arrays |= {f"surface_{name}": getattr(points, name) for name in ARRAYS}
    return Fields(words, arrays)


def read(path: str | Path, make: Callable[[dict[str, Any]], Family]) -> Family:
    """Read the file that `Family.save` wrote; returns ``make(fields)``, where the field ``error`` is a dict of numbers.

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
        return make(_fields(content, arrays))


def _fields(content: dict[str, Any], a: dict[str, Any]) -> dict[str, Any]:
    box = _box(content["campaign"], a)
    inputs = check_names("inputs", content["inputs"])
    outputs = check_names("outputs", content["outputs"])
    lit = "light_coefficients" in a
    if lit != (LIGHT in outputs):
        raise ValueError("the output of the light and its weights do not fit")
    members: AffineMembers | MovedMeshMembers | LitMembers
    if content["engine"].startswith("affine"):
        members = _affine_members(content, a, box)
    else:
        mesh = Mesh(a["points"], a["triangles"], a["region"], tuple(content["regions"]))
        moved = MovedMeshEngine(box, float(content["accuracy"]), mesh)
        means = dict.fromkeys(name for name in (*inputs, *outputs) if name != LIGHT)
        members = MovedMeshMembers(moved, a["basis"], tuple(means))
    if lit:
        port = LightPort(a["light_powers"], a["light_coefficients"], a["light_shifts"])
        terms = len(port.powers)
        checks.shape("light: powers", port.powers, (terms, box.size))
        checks.shape("light: coefficients", port.coefficients, (terms, members.size))
        checks.shape("light: shifts", port.shifts, (terms,))
        members = LitMembers(members, port, box)
    error = {name: _not_negative(name, content["error"]) for name in ("worst", "median")}
    error["count"] = checks.integer("count", content["error"]["count"], 1, np.inf)
    fields: dict[str, Any] = {"box": box, "inputs": inputs, "outputs": outputs, "members": members, "error": error}
    fields["tolerance"] = checks.positive("tolerance", content["tolerance"], at_most=1)
    fields |= {name: _not_negative(name, content) for name in ("floor", "factor")}
    if "output_maps" in content:
        maps = content["output_maps"]
        fields["output_maps"] = OutputMaps(**maps, shares=a["map_shares"], coefficients=a["map_coefficients"])
    if "optics" in content:
        fields["optics"] = OpticalNumbers.of_content(content["optics"], a)
    fields["provenance"] = dict(content["provenance"])
    return fields


def _not_negative(name: str, content: dict[str, Any]) -> float:
    return checks.between(name, content[name], 0, checks.LARGEST_NUMBER)


def _box(stored: dict[str, Any], a: dict[str, Array]) -> Box:
    variations = []
    for fields in stored["variations"]:
        lists = {name: tuple(fields[name]) for name in ("paths", "values")}
        variations.append(Variation(**{**fields, **lists}))
    drawn = int(any(not v.values for v in variations))
    words = {**stored, "variations": tuple(variations), "read": tuple(stored["read"])}
    campaign = Campaign(**words, samples=drawn)
    box = Box(campaign, a["low"], a["high"])
    for ends in (box.low, box.high):
        checks.shape("range", ends, (box.size,))
    if not np.all(box.low < box.high):
        raise ValueError("ranges and parameters do not fit")
    return box


def _affine_members(content: dict[str, Any], a: dict[str, Any], box: Box) -> AffineMembers:
    r = Axis(a["r_base"], a["r_slope"])
    z = Axis(a["z_base"], a["z_slope"])
    grid = CellGrid(box, r, z, a["left"], a["lower"], content["owner"])
    surface = None
    if "surface" in content:
        words = dict(content["surface"])
        words["series"] = [tuple(names) for names in words["series"]]
        arrays = {name: a[f"surface_{name}"] for name in ARRAYS}
        surface = SampledWeights(SurfacePoints(**arrays, **words), a["modes"])
    stiffness = (a["stiffness_kind"], a["stiffness_ratio"])
    capacity = (a["capacity_kind"], a["capacity_ratio"])
    n = a["ports"].shape[-1]
    i, j = np.triu_indices(n)
    square = {name: np.zeros((len(a[name]), n, n)) for name in ("K", "M")}
    for name, full in square.items():
        full[:, i, j] = a[name]
        full[:, j, i] = a[name]
    coefficients = Coefficients(grid, stiffness, capacity, surface)
    return AffineMembers(coefficients, **square, ports=a["ports"], volumes=a["volumes"])
