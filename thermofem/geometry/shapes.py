"""Shapes in the plane of a chip: racetracks, heaters and pads, each with the section that it is drawn in; lengths in m.

A shape is a line of its centre, with the width that its part has in the section, or a polygon. The section says which
layers lie there, and at which height the part stands.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely

from .. import checks
from ..arrays import Array, ArrayLike
from ..checks import InputError
from ..materials.material_library import VOID
from . import section_parts
from .cross_section import CrossSection
from .section_parts import Part, bar

NM = 1e3  # um in nm, to which the width of an outline is rounded: layouts have a grid of 1 nm
UM = 1e6  # GEOS has absolute tolerances: polygons are in um
LEAST_BEND = 3e-6  # m; a tighter bend is no line with a slowly turning section
SHARPEST = math.radians(30)  # between two pieces of a line: more is a corner, not a bend
QUARTER = 90  # pieces of a quarter of a circle: a polygon shorter than it by 1e-5


@dataclass(frozen=True)
class Shape:
    """A core or heater of a chip, drawn in its plane.

    Parameters
    ----------
    name : str
        of the input and output of the model.
    section : CrossSection
        a straight one, with the part as it is cut across.
    outline : array, shape (n, 2), m
        corners (x, y) of a polygon; a ring may be drawn as one polygon that is cut open.
    path : array, shape (n, 2), m
        points (x, y) of the centre line; a closed line ends where it begins. Give either ``outline`` or ``path``.
    part : str
        of the section; default its first heated part.

    Raises
    ------
    InputError
        a section that is not straight or has voids, a part that is not heated, a line or outline that crosses itself, a
        bend below 3 um or a corner of a line, a line shorter than wide.

    >>> from thermofem import straight_guide
    >>> Shape("arm", straight_guide(), path=[(0, 0), (20e-6, 0)]).length
    2e-05
    """

    name: str
    section: CrossSection
    outline: ArrayLike | None = None
    path: ArrayLike | None = None
    part: str | None = None

    def __post_init__(self) -> None:
        checks.check_name("shape", self.name)
        what = f"shape {self.name!r}"
        hint = 'th.straight_guide(...) or a geometry file with kind = "straight"'
        checks.instance(f"{what}: section", self.section, CrossSection, hint=hint)
        if self.section.kind != "straight":
            raise InputError(f"{what}: section {self.section.name!r} is that of a ring; a straight one is needed", hint)
        part = checks.choice(f"{what}: part", self.part, self.section.heated, default=self.section.heated[0])
        object.__setattr__(self, "part", part)
        void = next((one.name for one in self.section.parts if one.material == VOID), None)
        if void is not None:
            raise InputError(
                f"{what}: the void {void!r} cuts the stack, which is taken as uniform between shapes; leave it out, or "
                "give the matrices of a three-dimensional model instead"
            )
        if (self.outline is None) == (self.path is None):
            raise InputError(f"{what}: give either an outline or a path, in m")
        field = "path" if self.outline is None else "outline"
        points = _points(f"{what}: {field}", getattr(self, field), 2 if field == "path" else 3)
        object.__setattr__(self, field, tuple(map(tuple, points.tolist())))
        if field == "path":
            _check_bends(what, points)
        polygon = self.polygon
        if polygon.geom_type != "Polygon" or not polygon.area or len(polygon.interiors) > self.closed:
            raise InputError(f"{what}: its {field} crosses itself; draw each piece as a shape of its own")
        least = self.width * (1 - 1e-9)
        checks.between(f"{what}: length", self.length, least, math.inf, unit="m", hint="a line is longer than wide")

    @property
    def _breadth(self) -> float:
        """Width in m of the part in the section."""
        return self.section.part(str(self.part)).breadth

    @cached_property
    def polygon(self) -> shapely.Polygon:
        """The area in the plane, in um; an empty one of a line or outline that crosses itself."""
        if self.path is None:
            plain = shapely.Polygon(np.asarray(self.outline) * UM)
            joined = plain.buffer(0)  # also of a ring that is cut open
            # 1e-6: an outline that crosses itself has areas of either sign
            return joined if abs(plain.area - joined.area) < 1e-6 * plain.area else shapely.Polygon()
        line = np.asarray(self.path) * UM
        curve = shapely.LinearRing(line) if self.closed else shapely.LineString(line)
        around = curve.buffer(self._breadth / 2 * UM, cap_style="flat", join_style="mitre")
        return around if curve.is_simple else shapely.Polygon()

    @cached_property
    def closed(self) -> bool:
        """Whether the shape is a ring."""
        if self.path is None:
            return len(self.polygon.interiors) == 1
        line = np.asarray(self.path)
        return bool((line[0] == line[-1]).all())

    @cached_property
    def width(self) -> float:
        """Width in m; of an outline that of the strip with the same area and perimeter."""
        if self.path is not None:
            return self._breadth
        area = self.polygon.area
        half = self.polygon.length / 4
        width = area / half / 2 if self.closed else half - math.sqrt(max(half**2 - area, 0.0))
        return round(width * NM) / NM / UM

    @property
    def length(self) -> float:
        """Length in m: area over width."""
        return self.polygon.area / UM**2 / self.width

    @cached_property
    def line(self) -> Array | None:
        """Points of the centre line in m, shape (n, 2), the first one repeated in a ring; None of an open outline."""
        if self.path is not None:
            return np.asarray(self.path)
        if not self.closed:
            return None
        middle = shapely.Polygon(self.polygon.exterior).buffer(-self.width / 2 * UM, join_style="mitre")
        return np.asarray(middle.exterior.coords) / UM

    @property
    def bend(self) -> float:
        """Smallest bend radius in m, inf of an outline that is no ring."""
        return math.inf if self.line is None else _bends(self.line)[0]

    @property
    def drawn(self) -> Part:
        """The part of the section with the width of the shape."""
        part = self.section.part(str(self.part))
        return bar(part, part.centre, self.width)

    def outlined(self) -> list[list[list[float]]]:
        """Points (x, y) in m around the shape, to 0.1 nm: the outer ring, then that of a hole."""
        rings = [self.polygon.exterior, *self.polygon.interiors]
        return [(np.round(np.asarray(ring.coords), 4) / UM).tolist() for ring in rings]

    @property
    def centre(self) -> tuple[float, float]:
        """Centroid in m."""
        middle = self.polygon.centroid
        return middle.x / UM, middle.y / UM


def racetrack(
    name: str,
    section: CrossSection,
    radius: float = 5e-6,
    straight: float = 8e-6,
    at: Sequence[float] = (0.0, 0.0),
    part: str | None = None,
) -> Shape:
    """Two half circles joined by two straights along y; without straights a circle.

    Parameters
    ----------
    name : str
    section : CrossSection
        a straight one, such as `straight_guide`.
    radius, straight : float, m
        of the bends, to the centre line, and the length of each straight.
    at : pair of float, m
        the middle.
    part : str
        of the section; default its first heated part. A heater along the racetrack has the same radius and straight.

    Returns
    -------
    Shape

    Raises
    ------
    InputError
        a radius below 3 um, lengths that cannot be; as `Shape`.

    >>> from thermofem import straight_guide
    >>> round(racetrack("ring 1", straight_guide(), radius=7e-6, straight=3e-6).length * 1e6, 2)
    49.98
    """
    radius = section_parts.length("radius", radius, typical=5e-6)
    straight = checks.between("straight", straight, 0.0, 1e-2, unit="m", hint=section_parts.slip(straight, 8e-6))
    middle = checks.numbers("at", at, hint="the middle (x, y) in m")
    checks.shape("at", middle, (2,))
    centres = shapely.LineString([(0.0, -straight / 2 * UM), (0.0, straight / 2 * UM)])
    around = centres.buffer(radius * UM, quad_segs=QUARTER).exterior
    return Shape(name, section, path=np.asarray(around.coords) / UM + middle, part=part)


def along_ring(ring: CrossSection) -> tuple[Shape, ...]:
    """The heated parts of a ring as racetracks with its ``straight``, in the section of the ring made straight.

    The first heated part is at x = 0. Names are those of the parts; other parts follow each of them.
    """
    middle = ring.first_heated.centre
    parts = [bar(part, part.centre - middle, part.breadth) for part in ring.parts]
    section = replace(
        ring,
        kind="straight",
        parts=tuple(parts),
        length=ring.path_length(middle),
        half_width=ring.outer_radius,
        straight=0.0,
        buses=(),
    )
    heated = [ring.part(name) for name in ring.heated]
    return tuple(racetrack(part.name, section, part.centre, ring.straight, part=part.name) for part in heated)


def _points(what: str, value: ArrayLike, least: int) -> Array:
    points = checks.numbers(what, value, hint="points (x, y) in m")
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < least:
        raise InputError(f"{what} has shape {points.shape}; rows (x, y) in m are needed, at least {least}")
    section_parts.length(f"{what}: its extent", float(np.ptp(points, axis=0).max()), typical=20e-6)
    return points


def _check_bends(what: str, line: Array) -> None:
    """Raise InputError unless a line of points turns slowly."""
    radius, turn = _bends(line)
    if turn > SHARPEST:
        raise InputError(
            f"{what}: its path turns by {math.degrees(turn):.0f} deg between two pieces; give bends many points, or "
            "draw a corner as an outline"
        )
    # 1.001: a polygon of many pieces lies inside its bend
    if radius * 1.001 < LEAST_BEND:
        raise InputError(
            f"{what}: its bends have a radius of {radius:g} m, below {LEAST_BEND:g} m; a line must turn slowly",
            'a ring that small is a CrossSection of kind "ring"',
        )


def _bends(line: Array) -> tuple[float, float]:
    """Smallest radius of a line of points in m, and largest turn in rad from one piece to the next."""
    closed = bool((line[0] == line[-1]).all())
    corners = np.concatenate([line, line[1:2]]) if closed else line
    piece = np.diff(corners @ [1, 1j])
    length = np.abs(piece)
    turn = np.abs(np.angle(piece[1:] * piece[:-1].conj()))
    radius = (length[1:] + length[:-1]) / 2 / np.maximum(turn, 1e-12)
    return float(radius.min(initial=math.inf)), float(turn.max(initial=0.0))
