"""Sizes of the triangles from the wanted accuracy.

With d the distance to the outlines of the heated parts and d_c that to one of their corners,

    size(r, z) = min(h + slope d, h_c + slope d_c, max(4 um, d/10))        (4 um and h grow in large domains: `fitted`)

The heat flux is singular where conductivities meet at a corner, and so h_c decides the accuracy. Outlines and corners
of other parts and of voids count in the same way with h and h_c multiplied by 1 + d/(0.3 um): what is far from the heat
sees a smoother field. Corners on an insulated surface have the stronger singularity, and 0.15 h_c. h_c is at most the
distance to the next corner: thin parts far away, and the neck where two parts nearly touch, conduct as they should.

Copies of parts off the axis are read far from the heat, where mostly the last term bounds the sizes. With them it is
multiplied by f = slope(accuracy)/slope(1e-3), about the fourth root of the accuracy, as the error of a smooth field
needs; and at a distance e from a copy's centre line, L away from the heated parts there, size <= f L/4 + slope e.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from .. import checks
from ..arrays import Array, Indices

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection
    from ..geometry.regions import Subdivision

LARGEST_SIZE = 4e-6  # m, near the heat
REACH = 0.3e-6  # m, the size of a core: where the field around it begins to smooth out
THICKNESS = 450e-9 * 220e-9 / 1340e-9
EXTENT = math.sqrt(450e-9 * 220e-9)  # m, of the reference core: see `fitted`
THICK, WIDE = 60.0, 500e-6  # times the reference core, and m: sizes grow in proportion beyond both, see `fitted`


@dataclass(frozen=True)
class Sizes:
    """Element sizes: ``h`` in m on an outline, ``h_c`` in m at a corner; both grow by ``slope`` per distance.

    largest: bound of the sizes near the heat, m.
    """

    h: float
    slope: float
    h_c: float
    largest: float = LARGEST_SIZE


def sizes(accuracy: float) -> Sizes:
    """Sizes for a relative error of R_th and of every value of the step response from 1 ns on.

    For a core of 450 x 220 nm; `fitted` adapts them. Power laws through (h, slope, h_c) = (45 nm, .5, 10 nm) at 1e-3
    and (30 nm, .3, 2 nm) at 1e-4. Measured with quadratic triangles against meshes for 1e-5, the largest error at 1, 3
    ns and of R_th over 18 cross-sections (wide, thick and small cores, rib, disc, heater, air-clad, trenches,
    undercuts, trapezoid, thin oxide, thermal contact, nitride): 1.0e-2, 7.5e-4, 8.2e-5 for 1e-2, 1e-3, 1e-4. Against an
    independent high-order solution R_th of the reference strip is off 3.1e-4 at 1e-3.

    Raises InputError: accuracy outside 1e-5 .. 0.05.
    """
    hint = "it is the wanted relative error of the thermal resistance and the step response"
    decades = -3 - math.log10(checks.between("accuracy", accuracy, 1e-5, 0.05, hint=hint))
    decades *= 0.85 if decades < 0 else 1.0  # corners and layers that are hardly resolved give less than the power law
    h = 45e-9 * (2 / 3) ** decades
    slope = 0.5 * (3 / 5) ** decades
    h_c = 10e-9 * (1 / 5) ** decades
    return Sizes(h, slope, h_c)


def fitted(geometry: CrossSection, at: Sizes) -> Sizes:
    """Sizes for the heated parts of a geometry, scaled from the sizes ``at`` of the reference core of 450 x 220 nm.

    The error of the early step response is made in the cold layer around a part and is in proportion to
    h^4 perimeter/area; that of R_th is made at the corners and depends on h_c over the part's extent. In domains beyond
    `WIDE`, sizes grow with a core thicker than `THICK`: the layer that they do not resolve then holds little heat.
    """
    faces = [face for face in geometry.subdivision.faces if face.owner in geometry.heated]
    areas = np.array([face.area for face in faces])
    perimeters = np.array([_perimeter(face.edges(), mirrored=geometry.mirrored) for face in faces])
    areas = areas * (2 if geometry.mirrored else 1)
    thickness = float((areas / perimeters).min()) / THICKNESS
    extent = float(np.sqrt(areas).min()) / EXTENT
    grown = max(1.0, min(thickness / THICK, geometry.outer_radius / WIDE))
    h = at.h * grown * min(thickness, 16.0) ** 0.25
    return Sizes(h=h, slope=at.slope, h_c=at.h_c * min(extent, 2.0), largest=LARGEST_SIZE * grown)


def _perimeter(edges: Array, *, mirrored: bool) -> float:
    """Length of a face's outline in m; of a mirrored section with that of its image, without the mirror plane."""
    lengths = np.linalg.norm(np.diff(edges, axis=1), axis=-1)[:, 0]
    if not mirrored:
        return float(lengths.sum())
    off_mirror = edges[:, :, 0].any(axis=1)
    return float(2 * lengths[off_mirror].sum())


def size_function(geometry: CrossSection, at: Sizes) -> Callable[[float, float], float]:
    """Function of (r, z) in m that returns the element size in m there; the mesher calls it some thousand times."""
    at, cut = fitted(geometry, at), geometry.subdivision
    of_heated = _drawn(geometry, True)
    of_others = _drawn(geometry, False)
    heated = shapely.multilinestrings(shapely.linestrings(cut.corners[of_heated]))
    other = shapely.multilinestrings(shapely.linestrings(cut.corners[of_others]))
    ends = np.unique(np.concatenate([of_heated, of_others]))
    corners = np.array(_corners(cut, ends, heated, at.h_c)).reshape(-1, 3)
    copies = _copies(geometry)
    far = min(1.0, at.slope / sizes(1e-3).slope) if copies else 1.0
    edge = max(part.outer_radius for part in geometry.parts if part.heated)

    def size(r: float, z: float) -> float:
        point = shapely.Point(r, z)
        d = heated.distance(point)
        smallest = min(at.h + at.slope * d, far * max(at.largest, d / 10))
        if other:
            smallest = min(smallest, at.h * (1 + d / REACH) + at.slope * other.distance(point))
        for inner, outer, middle in copies:
            x = min(max(r, inner), outer)
            on_copy = far * (x - edge) / 4
            smallest = min(smallest, on_copy + at.slope * math.hypot(r - x, z - middle))
        at_corners = corners[:, 2] + at.slope * np.hypot(corners[:, 0] - r, corners[:, 1] - z)
        return float(at_corners.min(initial=smallest))

    return size


def _copies(geometry: CrossSection) -> list[tuple[float, float, float]]:
    """Inner and outer radius and middle height in m of every copy off the axis."""
    rows = []
    for probe in geometry.probes:
        if probe.distance is not None:
            part = geometry.part(probe.part)
            reach = part.outer_radius
            rows.append((probe.distance - reach, probe.distance + reach, part.middle))
    return rows


def _drawn(geometry: CrossSection, heated: bool) -> Indices:
    """Edges, as pairs of corners, of the heated parts or of all others and voids; not those on axis or outer side."""
    cut = geometry.subdivision
    parts = {part.name for part in geometry.parts if part.heated == heated}
    drawn = np.array([not parts.isdisjoint(pair) for pair in cut.owners])
    if not heated:
        drawn |= cut.side == "wall"
    return cut.ends[drawn & ~np.isin(cut.side, ["axis", "outer"])]


def _corners(cut: Subdivision, ends: Indices, heated: Any, h_c: float) -> list[tuple[float, float, float]]:
    """r, z and element size in m at ends of edges, except at convex corners in the open, where the field is smooth."""
    turns: dict[tuple[float, float], list[float]] = {}
    for face in cut.faces:
        for ring in face.rings:
            before = ring - np.roll(ring, 1, axis=0)
            after = np.roll(before, -1, axis=0)
            cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
            for (r, z), turn in zip(ring.tolist(), cross, strict=True):
                turns.setdefault((r, z), []).append(turn)
    at_end = set(cut.ends[np.isin(cut.side, ["axis", "outer"])].flat)
    in_the_open = set(cut.ends[np.isin(cut.side, ["top", "wall"])].flat)
    rows = []
    for k in ends:
        r, z = cut.corners[k].tolist()
        convex = len(turns[r, z]) == 1 and turns[r, z][0] > 0
        if k in at_end or (k in in_the_open and convex):
            continue
        # 0.15: an insulated surface makes the singularity r^(1/2) instead of r^(2/3): h_c is reduced to this
        share = 0.15 if k in in_the_open else 1.0
        others = cut.corners[ends[ends != k]]
        away = np.hypot(others[:, 0] - r, others[:, 1] - z)
        distance = heated.distance(shapely.Point(r, z))
        size = h_c * share * (1 + distance / REACH)
        rows.append((r, z, float(away.min(initial=size))))
    return rows
