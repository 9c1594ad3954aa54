"""Layouts: the polygons of a GDS file or of a gdsfactory component, or the [[shape]] tables of a geometry file.

A layout file is a geometry file with ``kind = "straight"``, whose layers and parts are the section. It has a table for
each shape, with name, part, and either radius, straight and at (a racetrack), or path, or outline; or a table [gds].
A file of a ring with [plan] straight is the layout of that one racetrack, with its heated parts as shapes.
"""

from __future__ import annotations

import logging
from collections import Counter
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
from .gdsfactory_import import Drawing, drawn_component
from .shapes import UM, Shape, along_ring, racetrack

log = logging.getLogger("thermofem")

GRID = 1e-3  # um, of drawings: an area may reach that far beyond the cell that holds it
_SHAPE = {"name": TEXT, "part": TEXT, "radius": "m", "straight": "m", "at": ANY, "path": ANY, "outline": ANY}
_GDS = {"file": TEXT, "layers": ANY}


def read_layout(
    path: Any, layers: Mapping[str, tuple[int, int]] | None = None, section: CrossSection | None = None
) -> tuple[Shape, ...]:
    """Read the shapes of a chip from a GDS file, a gdsfactory component, or a geometry file with [[shape]] tables.

    Polygons of one layer that touch are one shape. A label inside it is its name, else the cell that holds it, followed
    by the part for all but the first part of ``layers``. Shapes without a name, or with the same one, are numbered from
    left to right; the log lists all. An open waveguide beside a ring, closer than it is thick, is a bus, which is left
    out.

    Parameters
    ----------
    path : str, Path, or gdsfactory.Component
        a GDS file, which gdstk reads; a layout file (TOML), which needs nothing else; or a component, with a name of
        each instance in place of a cell.
    layers : mapping of str to (int, int)
        part of the section to the layer and datatype of a GDS file. Of a component the default is that of the PDK: the
        level "core", and the levels of heaters.
    section : CrossSection
        a straight one, for a GDS file; of a component without ``layers`` that of the active PDK's layer stack.

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
    if isinstance(path, str | Path):
        source = files.regular(path, "layout")
        if source.suffix.lower() == ".toml":
            return files.read_toml(source, "layout", lambda text: _of_text(text, source.parent))
        drawing = _drawn(source, *_with_heights(layers, section))
    else:
        of_pdk = layers is None and section is None
        drawing = drawn_component(path) if of_pdk else drawn_component(path, *_with_heights(layers, section))
    drawn = tuple(_shapes(drawing))
    log.info("%s: %s", drawing.source, ", ".join(shape.name for shape in drawn))
    return drawn


def _with_heights(layers: Any, section: Any) -> tuple[Mapping[str, tuple[int, int]], CrossSection]:
    """Layers and section of a drawing that says nothing of heights."""
    hint = 'such as layers={"core": (1, 0), "heater": (11, 0)}'
    numbers = checks.mapping("layers", layers, hint=hint)
    if not numbers:
        raise checks.InputError("layers is missing: which layer of the GDS file is which part of the section", hint)
    checks.instance("section", section, CrossSection, hint="a GDS file says nothing of heights: th.straight_guide(...)")
    return numbers, section


def _drawn(path: Path, layers: Mapping[str, tuple[int, int]], section: CrossSection) -> Drawing:
    """What a GDS file draws on the layers of the parts."""
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
        drawn = [area for cell in cells for area in cell.get_polygons(layer=layer, datatype=datatype)]
        if not drawn:
            raise checks.InputError(f"{path} has no polygon on layer {layer}/{datatype}, that of {part!r}")
        polygons[part] = [shapely.Polygon(area.points * unit).buffer(0) for area in drawn]
    labels = []
    instances = []
    for cell in cells:
        for label in cell.get_labels():
            place = shapely.Point(np.array(label.origin) * unit)
            labels.append((label.text, place))
        for reference in cell.references:
            corners = reference.bounding_box()
            if corners is not None:
                extent = shapely.box(*np.ravel(corners) * unit)
                instances.append((reference.cell_name, extent))
    return Drawing(str(path), section, polygons, labels, instances)


def _shapes(drawing: Drawing) -> Iterable[Shape]:
    """Shapes of the merged polygons of each part, from left to right, without buses."""
    first = next(iter(drawing.polygons))
    for part, polygons in drawing.polygons.items():
        checks.choice("layers: part", part, drawing.section.heated)
        merged = shapely.union_all(polygons, grid_size=1e-4)
        areas = [area for area in getattr(merged, "geoms", [merged]) if area.area]
        areas = _without_buses(areas, part, drawing.section.part(part).height * UM)
        names = [_name(area, drawing) for area in areas]
        names = [part if not name else name if part == first else f"{name} {part}" for name in names]
        repeated = Counter(names)
        number: Counter[str] = Counter()
        for area, name in zip(areas, names, strict=True):
            if name == part or repeated[name] > 1:
                number[name] += 1
                name = f"{name} {number[name]}"
            yield Shape(name, drawing.section, outline=_outline(area), part=part)


def _without_buses(areas: list[shapely.Polygon], part: str, thick: float) -> list[shapely.Polygon]:
    """Areas in um from left to right, without open ones closer to a ring than ``thick``, in um."""
    rings = shapely.union_all([area for area in areas if area.interiors])
    shapes = []
    for area in sorted(areas, key=lambda area: area.bounds[:2]):
        if area.distance(rings) < thick and not area.interiors:
            log.info("a bus of %r at x = %.4g um is left out", part, area.bounds[0])
        else:
            shapes.append(area)
    return shapes


def _name(area: shapely.Polygon, drawing: Drawing) -> str:
    """Label inside an area, else the only cell that holds it; empty where there is none."""
    whole = shapely.Polygon(area.exterior)
    for text, place in drawing.labels:
        if text.isprintable() and whole.intersects(place):
            return text
    holders = [name for name, extent in drawing.instances if extent.buffer(GRID).covers(whole)]
    return holders[0] if len(holders) == 1 else ""


def _outline(area: shapely.Polygon) -> Array:
    """Corners in m of a polygon; of one with a hole cut open at its first corner."""
    oriented = shapely.orient_polygons(area)
    rings = [oriented.exterior, *oriented.interiors]
    corners = shapely.get_coordinates(rings)
    return np.concatenate([corners, corners[:1]]) / UM


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
