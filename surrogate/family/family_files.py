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
from thermofem.data.quantity import SI
from thermofem.mesh import Mesh

from .affine_engine import AffineMembers, Coefficients
from .affine_grid import Axis, CellGrid, SampledWeights, SurfacePoints
from .interpolation import OutputMaps
from .members import pack, unpack
from .moved_mesh_engine import MovedMeshEngine, MovedMeshMembers
from .optical_numbers import OpticalNumbers
from .parameter_box import Box

if TYPE_CHECKING:
    from .family import Family

FORMAT, SCHEMA = "thermofem family", 1
_POINTS = ("ends", "gauss", "interval", "outward")


def save(family: Family, path: str | Path) -> Path:
    """Write a family."""
    content: dict[str, Any] = {
        "format": FORMAT,
        "schema": SCHEMA,
        "campaign": _campaign(family.box.campaign),
        "logarithmic": list(family.box.logarithmic),
        "inputs": list(family.inputs),
        "outputs": list(family.outputs),
        "tolerance": family.tolerance,
        "error": {"worst": family.error.worst, "median": family.error.median, "count": family.error.count},
        "floor": family.floor,
        "factor": family.factor,
        "engine": family.engine,
        "provenance": family.provenance,
    }
    if family.output_maps is not None:
        content["output_maps"] = {"power": family.output_maps.power, "error": family.output_maps.error}
    arrays: dict[str, Any] = {"low": family.box.low, "high": family.box.high}
    if isinstance(family.members, AffineMembers):
        content["owner"], content["statics"] = family.members.coefficients.grid.owner, family.members.statics
        arrays |= _line_arrays(family.members)
        if family.members.coefficients.surface is not None:
            points = family.members.coefficients.surface.points
            content["surface"] = {
                "kind": list(map(str, points.kind)),
                "material": list(map(str, points.material)),
                "parts": [list(part) for part in points.parts],
            }
    else:
        mesh = family.members.moved.mesh
        content["regions"], content["accuracy"] = list(mesh.region_names), family.members.moved.accuracy
        arrays |= {"points": mesh.points, "triangles": mesh.triangles, "region": mesh.region}
        arrays |= {"basis": family.members.basis}
    if family.output_maps is not None:
        arrays |= {"map_shares": family.output_maps.shares, "map_coefficients": family.output_maps.coefficients}
    if family.optics is not None:
        content["optics"], own = family.optics.content()
        arrays |= own
    whole = pack({"header": np.array(json.dumps(content)), **arrays})
    return write_whole(path, lambda p: p.write_bytes(whole))


def _check_arrays(arrays: dict[str, Array]) -> None:
    for name, values in arrays.items():
        if values.dtype.kind not in "biuf" or not np.all(np.isfinite(values)):
            raise ValueError(f"{name} holds what is no finite number")


def _line_arrays(members: AffineMembers) -> dict[str, Any]:
    c = members.coefficients
    arrays = {
        "r_base": c.grid.r.base,
        "r_slope": c.grid.r.slope,
        "z_base": c.grid.z.base,
        "z_slope": c.grid.z.slope,
        "stiffness_kind": c.stiffness[0],
        "stiffness_ratio": c.stiffness[1],
        "capacity_kind": c.capacity[0],
        "capacity_ratio": c.capacity[1],
        "K": members.K,
        "M": members.M,
        "ports": members.ports,
        "volumes": members.volumes,
    }
    if c.surface is not None:
        arrays["modes"] = c.surface.modes
        arrays |= {f"surface_{name}": getattr(c.surface.points, name) for name in _POINTS}
    return arrays


def _campaign(campaign: Campaign) -> dict[str, Any]:
    names = ("name", "paths", "unit", "values", "low", "high", "logarithmic")
    variations = [{name: getattr(v, name) for name in names} for v in campaign.variations]
    for one in variations:
        if one["values"]:
            del one["low"], one["high"]
    geometry, heated, read = campaign.geometry, campaign.heated, list(campaign.read)
    return {"name": campaign.name, "geometry": geometry, "heated": heated, "read": read, "variations": variations}


def read(path: str | Path, make: Callable[[dict[str, Any]], Family]) -> Family:
    """``make`` a family of the fields that `Family.save` wrote; ``error`` is a dict of its numbers.

    Raises InputError: no such file, not a family, one of a newer version, or one that cannot be made.
    """
    raw = read_bytes(path, "family")
    try:
        arrays = unpack(raw)
        content = from_json(str(arrays.pop("header")))
        known = content["format"] == FORMAT
    except (KeyError, TypeError, ValueError) as error:
        raise checks.InputError(f"{path} is not a family that thermofem wrote ({error}); is it complete?") from None
    if not known or content.get("schema") != SCHEMA:
        raise checks.InputError(f"{path} has schema {checks.shown(content.get('schema'))}; this version reads {SCHEMA}")
    try:
        _check_arrays(arrays)
        return make(_fields(content, arrays))
    except DAMAGE as error:
        raise checks.InputError(f"{path} is not a complete family: {error}") from None


def _fields(content: dict[str, Any], arrays: dict[str, Array]) -> dict[str, Any]:
    box = _box(content, arrays)
    inputs, outputs = (check_names(kind, content[kind]) for kind in ("inputs", "outputs"))
    ports = tuple(dict.fromkeys((*inputs, *outputs)))
    lines = content["engine"].startswith("affine")
    hot = content.get("output_maps")
    error = content["error"]
    output_maps = None
    if hot is not None:
        output_maps = OutputMaps(
            float(hot["power"]), arrays["map_shares"], arrays["map_coefficients"], float(hot["error"])
        )
    return {
        "box": box,
        "inputs": inputs,
        "outputs": outputs,
        "tolerance": checks.positive("tolerance", content["tolerance"], at_most=1),
        **{name: checks.between(name, content[name], 0, checks.LARGEST) for name in ("floor", "factor")},
        "members": _lines(content, arrays, box) if lines else _moved(content, arrays, box, ports),
        "error": {
            **{name: checks.between(name, error[name], 0, checks.LARGEST) for name in ("worst", "median")},
            "count": checks.integer("count", error["count"], 1, np.inf),
        },
        "output_maps": output_maps,
        "optics": OpticalNumbers.of_content(content["optics"], arrays) if "optics" in content else None,
        "provenance": dict(content["provenance"]),
    }


def _box(content: dict[str, Any], arrays: dict[str, Array]) -> Box:
    stored = content["campaign"]
    variations = tuple(
        Variation(**{**one, "paths": tuple(one["paths"]), "values": tuple(one["values"])})
        for one in stored["variations"]
    )
    drawn = any(not v.values for v in variations)
    campaign = Campaign(
        geometry=stored["geometry"],
        variations=variations,
        name=stored["name"],
        heated=stored["heated"],
        read=tuple(stored["read"]),
        samples=1 if drawn else 0,
    )
    names = tuple(v.name for v in variations)
    low, high, logarithmic = arrays["low"], arrays["high"], tuple(content["logarithmic"])
    if not (low.shape == high.shape == (len(names),) == (len(logarithmic),) and np.all(low < high)):
        raise ValueError("ranges and parameters do not fit")
    for variation in variations:
        checks.choice(f"unit of {variation.name}", variation.unit, SI)
    return Box(campaign, names, low, high, logarithmic)


def _lines(content: dict[str, Any], a: dict[str, Any], box: Box) -> AffineMembers:
    grid = CellGrid(box, Axis(a["r_base"], a["r_slope"]), Axis(a["z_base"], a["z_slope"]), content["owner"])
    surface = None
    if "surface" in content:
        s = content["surface"]
        fields = {name: a[f"surface_{name}"] for name in _POINTS}
        kind, material = (np.array(s[name], dtype=object) for name in ("kind", "material"))
        parts = [tuple(part) for part in s["parts"]]
        surface = SampledWeights(SurfacePoints(kind=kind, material=material, parts=parts, **fields), a["modes"])
    stiffness, capacity = ((a[f"{x}_kind"], a[f"{x}_ratio"]) for x in ("stiffness", "capacity"))
    coefficients = Coefficients(grid, stiffness, capacity, surface)
    statics = checks.integer("statics", content["statics"], 1, a["ports"].shape[-1])
    return AffineMembers(coefficients, a["K"], a["M"], a["ports"], a["volumes"], statics)


def _moved(content: dict[str, Any], a: dict[str, Any], box: Box, ports: tuple[str, ...]) -> MovedMeshMembers:
    mesh = Mesh(a["points"], a["triangles"], a["region"], tuple(content["regions"]))
    return MovedMeshMembers(MovedMeshEngine.on(box, float(content["accuracy"]), mesh), a["basis"], ports)
