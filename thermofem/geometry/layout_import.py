"""Layouts from files: the polygons of a GDS file, or the [[shape]] tables of a geometry file.

A layout file is a geometry file with ``kind = "straight"``, whose layers and parts are the section. It has a table for
each shape, with name, part, and either radius, straight and at (a racetrack), or path, or outline; or a table [gds].
A file of a ring with [plan] straight is the layout of that one racetrack, with its heated parts as shapes.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from .. import checks
from ..arrays import Array
from ..data import files, quantity
from ..data.files import ANY, TEXT, read_table
from .cross_section import CrossSection
from .shapes import UM, Shape, along_ring, racetrack

log = logging.getLogger("thermofem")

_SHAPE = {"name": TEXT, "part": TEXT, "radius": "m", "straight": "m", "at": ANY, "path": ANY, "outline": ANY}
_GDS = {"file": TEXT, "layers": ANY}


def read_layout(
    path: str | Path, layers: Mapping[str, tuple[int, int]] | None = None, section: CrossSection | None = None
) -> tuple[Shape, ...]:
    """Read the shapes of a chip from a GDS file, or from a geometry file with [[shape]] tables.

    Polygons of one layer that touch are one shape. A label inside it is its name; others are numbered from left to
    right, and the log lists them. An open waveguide beside a ring, closer than it is thick, is a bus: it is left out.

    Parameters
    ----------
    path : str or Path
        a GDS file, which gdstk reads, or a layout file (TOML), which needs nothing else.
    layers : mapping of str to (int, int)
        part of the section to the layer and datatype of a GDS file.
    section : CrossSection
        a straight one, for a GDS file.

    Returns
    -------
    tuple of Shape

    Raises
    ------
    MissingLibraryError
        gdstk cannot be imported.
    InputError
        a file that cannot be read, an empty layer, a part that the section does not have; as `Shape`.
    """
    source = files.regular(path, "layout")
    if source.suffix.lower() == ".toml":
        folder = source.parent
        shapes: tuple[Shape, ...] = files.read_toml(source, "layout", lambda text: _of_text(text, folder))
        return shapes
    hint = 'such as layers={"core": (1, 0), "heater": (11, 0)}'
    numbers = checks.mapping("layers", layers, hint=hint)
    if not numbers:
        raise checks.InputError("layers is missing: which layer of the GDS file is which part of the section", hint)
    checks.instance("section", section, CrossSection, hint="a GDS file says nothing of heights: th.straight_guide(...)")
    assert section is not None
    polygons, labels = _drawn(source, numbers)
    drawn: list[Shape] = []
    for part, areas in polygons.items():
        drawn += _named(part, areas, labels, section)
    log.info("%s: %s", source, ", ".join(shape.name for shape in drawn))
    return tuple(drawn)


def _drawn(
    path: Path, layers: Mapping[str, tuple[int, int]]
) -> tuple[dict[str, list[shapely.Polygon]], list[tuple[str, shapely.Point]]]:
    """Merged polygons in um of each part, and the labels with their places."""
    try:
        import gdstk
    except ImportError:
        raise checks.MissingLibraryError(
            'gdstk is needed to read GDS files; install it with pip install "thermofem[gds]"'
        ) from None
    try:
        library = gdstk.read_gds(str(path))
    except Exception:  # gdstk has errors of its own for each kind of damage
        library = gdstk.Library()
    if not library.cells:  # it prints what is wrong, and returns nothing
        raise checks.InputError(f"{path} is no GDS file that gdstk can read, or has no cell")
    unit = library.unit * UM
    cells = library.top_level()
    polygons = {}
    for part, (layer, datatype) in layers.items():
        areas = []
        for cell in cells:
            for drawn in cell.get_polygons(layer=layer, datatype=datatype):
                area = shapely.Polygon(drawn.points * unit)
                areas.append(area.buffer(0))
        if not areas:
            raise checks.InputError(f"{path} has no polygon on layer {layer}/{datatype}, that of {part!r}")
        merged = shapely.union_all(areas, grid_size=1e-4)
        polygons[part] = [area for area in getattr(merged, "geoms", [merged]) if area.area]
    labels = []
    for cell in cells:
        for label in cell.get_labels():
            place = shapely.Point(np.array(label.origin) * unit)
            labels.append((label.text, place))
    return polygons, labels


def _named(
    part: str, areas: list[shapely.Polygon], labels: list[tuple[str, shapely.Point]], section: CrossSection
) -> Iterable[Shape]:
    """Shapes of the polygons of one part, from left to right, without buses."""
    checks.choice("layers: part", part, section.heated)
    height = next(own.height for own in section.parts if own.name == part)
    thick = height * UM
    rings = shapely.union_all([area for area in areas if area.interiors])
    number = 0
    for area in sorted(areas, key=lambda area: area.bounds[:2]):
        beside_ring = rings.area and area.distance(rings) < thick
        if beside_ring and not area.interiors:
            log.info("a bus of %r at x = %.4g um is left out", part, area.bounds[0])
            continue
        number += 1
        whole = shapely.Polygon(area.exterior)
        names = (text for text, place in labels if text.isprintable() and whole.intersects(place))
        name = next(names, f"{part} {number}")
        yield Shape(name, section, outline=_outline(area), part=part)


def _outline(area: shapely.Polygon) -> Array:
    """Corners in m of a polygon; of one with a hole cut open at its first corner."""
    oriented = shapely.orient_polygons(area)
    outer = np.asarray(oriented.exterior.coords)
    if not oriented.interiors:
        return outer[:-1] / UM
    inner = np.asarray(oriented.interiors[0].coords)[:-1]
    distances = np.linalg.norm(inner - outer[0], axis=1)
    nearest = int(np.argmin(distances))
    around = np.roll(inner, -nearest, axis=0)
    return np.concatenate([outer, around, around[:1]]) / UM


def _of_text(text: str, folder: Path) -> tuple[Shape, ...]:
    """Shapes of the text of a layout file."""
    table = files.from_toml(text)
    drawn = table.pop("shape", [])
    gds = table.pop("gds", None)
    section = CrossSection.from_toml_text(files.to_toml(table))
    checks.instance("[[shape]]", drawn, list, hint="a table for each shape")
    shapes = tuple(_shape(item, number, section) for number, item in enumerate(drawn, 1))
    if gds is not None:
        values = read_table(gds, _GDS, "[gds]", required=("file", "layers"))
        layers = checks.mapping("[gds]: layers", values["layers"], hint="such as { core = [1, 0] }")
        shapes += read_layout(folder / values["file"], layers, section)
    if section.straight and not shapes:
        return along_ring(section)
    if not shapes:
        raise checks.InputError("a layout needs [[shape]] tables, or a table [gds] with file and layers")
    return shapes


def _shape(table: Any, number: int, section: CrossSection) -> Shape:
    where = f"shape number {number}"
    values = read_table(table, _SHAPE, where, required=("name",))
    for key in ("at", "path", "outline"):
        if key in values:
            values[key] = _lengths(f"{where}: {key}", values[key])
    if "radius" in values:
        return racetrack(section=section, **{"straight": 0.0, **values})
    stray = [key for key in ("straight", "at") if key in values]
    if stray:
        raise checks.InputError(f"{where}: {stray[0]} belongs to a racetrack, which has a radius")
    return Shape(section=section, **values)


def _lengths(name: str, value: Any) -> Any:
    """Lengths in m from text, in lists of lists."""
    if isinstance(value, list):
        return [_lengths(name, one) for one in value]
    return quantity.parse(value, "m", name=name)
