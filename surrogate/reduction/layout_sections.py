"""The sections of the shapes on a chip, and the response between shapes that they and the bare stack make.

The equation is that of `surrogate.reduction.layout_reduction`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations, combinations_with_replacement, compress
from typing import Any

import numpy as np
import shapely

from thermofem import CrossSection, Foster, InputError, Shape, assemble
from thermofem.arrays import Array, Complex
from thermofem.geometry.section_parts import INSULATED, ISOTHERMAL
from thermofem.geometry.shapes import UM

from .reduce import reduce
from .shape_points import LANE, PER_GAP, Spread, centre_points, distances, points_of
from .stack_green import DISTANCES, HELD, Stack

ENDLESS = 0.3  # 1/s, slowest rate of an endless substrate: a tenth of it moves G by sqrt(w/alpha)/(2 pi k), 0.02 K/W
SECTION = 0.2  # of the tolerance, for the mesh of a section
LANE_SIGMA = LANE / math.sqrt(12)  # m, standard deviation of the widest lane


@dataclass(frozen=True, eq=False)
class Local:
    """Two parts of a straight section that is recentred on the first.

    model: from the power of the one to the mean rise of the other, for 1 m of length.
    half_width [m]
    error: relative error of the static gain, by the mesh and the reduction.
    """

    model: Foster
    half_width: float
    error: float

    def impedance(self, omega: Array) -> Complex:
        """Rise of one part by the other in K m/W at angular frequencies in rad/s."""
        return self.model.impedance(omega / (2 * np.pi))


@dataclass(frozen=True, eq=False)
class Layout:
    """Shapes, the length along which each runs along each other one, and the sections at each of them.

    along [shape (N, N), m]: l_ij. apart [shape (N, N), m]: least distance of two shapes in the plane.
    locals: by two indices, of shapes that run along each other, and of every shape with itself.
    """

    shapes: tuple[Shape, ...]
    along: Array
    apart: Array
    locals: dict[tuple[int, int], Local]
    spreads: list[Spread]
    stack: Stack

    @classmethod
    def of(cls, shapes: tuple[Shape, ...], tolerance: float) -> "Layout":
        """Check the places of the shapes, and solve their sections."""
        polygons = np.array([shape.polygon for shape in shapes])
        apart = shapely.distance(polygons[:, None], polygons) / UM
        along = np.diag([shape.length for shape in shapes])
        for i, j in combinations(range(len(shapes)), 2):
            along[i, j] = along[j, i] = _length_along(shapes[i], shapes[j])
        _check_places(shapes, along, apart)
        _check_parts(shapes, along, apart)
        sections: dict[tuple[int, int], Local] = {}
        for i, j in np.argwhere(np.triu(along)).tolist():
            shape = shapes[i]
            # 0.5: of a length: a part along more than that belongs to the section of a shape
            beside = along[i] > 0.5 * shape.length
            beside[[i, j]] = True
            section = _section_at(shape, list(compress(shapes, beside)), shapes)
            parts = (str(shape.part), str(shapes[j].part))
            sections[i, j] = _solved(section, parts, SECTION * tolerance)
        spreads = [Spread.of(shape) for shape in shapes]
        stack = Stack.of(shapes[0].section)
        return cls(shapes, along, apart, sections, spreads, stack)

    def frequencies(self, tolerance: float) -> Array:
        """0, and angular frequencies in rad/s up to where every own rise is below a tenth of the tolerance."""
        low = 0.1 * (self.stack.slowest or ENDLESS)
        high = 1e16
        # 6: frequencies in a decade
        count = round(6 * np.log10(high / low))
        omega = np.append(0.0, np.geomspace(low, high, count))
        needed = 2
        for (i, j), local in self.locals.items():
            if i == j:
                size = np.abs(local.impedance(omega))
                small = size < 0.1 * tolerance * size[0]
                needed = max(needed, int(small.argmax()))
        return omega[: needed + 1]

    def response(self, omega: Array) -> tuple[Complex, Array]:
        """H(i omega) in K/W, shape (frequencies, N, N), and its error in K/W, shape (N, N), without that of the fit."""
        s = np.asarray(1j * omega, dtype=complex)
        n = len(self.shapes)
        H = np.zeros((omega.size, n, n), dtype=complex)
        error = np.zeros((n, n))
        lines = self._differences(s)
        for pairs, heated, read in self._kinds():
            r, G = self.stack.over_distance(s, heated, read)
            rough, G0 = self.stack.over_distance(s[:1], heated, read, DISTANCES // 2)
            for i, j in pairs:
                first = self.shapes[i]
                second = self.shapes[j]
                gap = self.apart[i, j]
                pitch = gap / PER_GAP if gap else None
                mean = G @ distances(points_of(first, pitch), points_of(second, pitch), r)
                fewer = points_of(first, pitch, fewer=True), points_of(second, pitch, fewer=True)
                coarse = G0 @ distances(*fewer, rough)
                H[:, i, j] = mean
                # a third: of a rule of second order, as on open lines, half of the points err by four times as much
                error[i, j] = abs(coarse[0] - mean[0]) / 3
                if (i, j) in lines:
                    share = self.along[i, j] / (first.length * second.length)
                    H[:, i, j] += share * lines[i, j]
                    local = self.locals[i, j]
                    (static,) = np.abs(local.impedance(omega[:1]))
                    error[i, j] += share * local.error * static
                H[:, j, i] = H[:, i, j]
        error = np.maximum(error, error.T) + self._neglected() * np.abs(H[0])
        return H, error

    def _neglected(self) -> Array:
        """Relative error of each gain by the bends of shapes along each other, or by the metal or silicon of others."""
        area = np.array([shape.width * shape.drawn.height for shape in self.shapes])
        bend = np.array([shape.bend for shape in self.shapes])
        both = np.add.outer(area, area) * (1 - np.eye(area.size) / 2)
        tightest = np.minimum.outer(bend, bend)
        # error of a gain: w h/R^2 of a bend; 0.08e12 1/m^2 times the sum of their w h between shapes apart
        return np.where(self.along > 0, both / tightest**2, 0.08e12 * both)

    def _differences(self, s: Complex) -> dict[tuple[int, int], Complex]:
        """Z - Y in K m/W of each pair that runs along each other, equal sections once."""
        bare = replace(self.stack, bottom=HELD, endless=False) if self.stack.endless else self.stack
        known: dict[Any, Complex] = {}
        lines = {}
        for (i, j), local in self.locals.items():
            middle = float(self.shapes[i].drawn.x or 0.0)
            spreads = (self.spreads[i].moved(middle), self.spreads[j].moved(middle))
            kind = (id(local), *(spread.sigma for spread in spreads))
            if kind not in known:
                known[kind] = local.impedance(s.imag) - bare.over_section(s, local.half_width, *spreads)
            lines[i, j] = known[kind]
        return lines

    def _kinds(self) -> list[tuple[list[tuple[int, int]], Spread, Spread]]:
        """Pairs of shapes with equal spreads; of shapes apart only the heights count, and one lane serves all."""
        groups: dict[Any, list[tuple[int, int]]] = {}
        spreads: dict[Any, tuple[Spread, Spread]] = {}
        for i, j in combinations_with_replacement(range(len(self.shapes)), 2):
            both = self.spreads[i], self.spreads[j]
            if self.along[i, j] == 0.0 and self.apart[i, j] > 0.0:
                both = replace(both[0], sigma=LANE_SIGMA), replace(both[1], sigma=LANE_SIGMA)
            kind = tuple(sorted((*spread.z, spread.sigma) for spread in both))
            groups.setdefault(kind, []).append((i, j))
            spreads[kind] = both
        return [(pairs, *spreads[kind]) for kind, pairs in groups.items()]


def _length_along(first: Shape, second: Shape) -> float:
    """Length in m over which two shapes run along each other as their parts do in the section; 0 of other shapes.

    There the centre line of the first lies as deep inside the outline of the second as in the section:
    depth = width/2 - distance of both centres.
    """
    if first.section != second.section or first.part == second.part:
        return 0.0
    if first.line is None:
        first, second = second, first
    if first.line is None:
        return 0.0
    between = abs(float(first.drawn.x or 0.0) - float(second.drawn.x or 0.0))
    points = centre_points(first, 400) * UM
    to_edge = shapely.distance(shapely.points(points), second.polygon.boundary) / UM
    inside = shapely.contains_xy(second.polygon, *points.T)
    depth = np.where(inside, to_edge, -to_edge)
    in_section = second.width / 2 - between
    # 0.05: of a width, by which two parallel lines may be displaced
    alike = np.abs(depth - in_section) < 0.05 * second.width
    return float(alike.mean() * first.length)


def _check_places(shapes: Sequence[Shape], along: Array, apart: Array) -> None:
    """Raise InputError for shapes that cross or are closer than they are thick, unless they run along each other."""
    for i, j in combinations(range(len(shapes)), 2):
        if along[i, j] > 0:
            continue
        first = shapes[i].drawn
        second = shapes[j].drawn
        who = f"shapes {shapes[i].name!r} and {shapes[j].name!r}"
        above = max(first.bottom - second.top, second.bottom - first.top, 0.0)
        gap = np.hypot(apart[i, j], above)
        if not gap:
            raise InputError(f"{who} cross: they lie at one height, and their outlines overlap; move one of them")
        thick = max(min(part.height, float(part.width or 0.0)) for part in (first, second))
        if gap < thick:
            raise InputError(
                f"{who} are {gap:g} m apart, closer than the {thick:g} m that they are thick; make them parts of one "
                "section, or give the matrices of a three-dimensional model"
            )


def _check_parts(shapes: Sequence[Shape], along: Array, apart: Array) -> None:
    """Raise InputError for a part that is no shape and reaches beyond half of the way to the next shape."""
    drawn = {shape.part for shape in shapes}
    for i, shape in enumerate(shapes):
        nearest = np.min(apart[i], where=along[i] == 0.0, initial=math.inf)
        middle = float(shape.drawn.x or 0.0)
        for part in shape.section.parts:
            reach = np.abs(part.outline()[:, 0] - middle).max()
            beyond = reach - shape.width / 2
            if part.name not in drawn and beyond > nearest / 2:
                raise InputError(
                    f"shape {shape.name!r}: part {part.name!r} of its section reaches {beyond:g} m beyond it; the next "
                    f"shape is {nearest:g} m away; make a plane a layer, or draw the part as a shape"
                )


def _section_at(shape: Shape, beside: Sequence[Shape], shapes: Sequence[Shape]) -> CrossSection:
    """The section at a shape: itself, the shapes that run along it, and the parts that are no shapes.

    It is recentred on the shape, and its sides and bottom are closed: what is beyond them cancels in Z - Y.
    """
    section = shape.section
    present = {other.part: other.drawn for other in beside}
    drawn = {other.part for other in shapes if other.section == section}
    middle = float(shape.drawn.x or 0.0)
    parts = []
    for part in section.parts:
        if part.name in present or part.name not in drawn:
            cut = present.get(part.name, part)
            parts.append(replace(cut, x=float(cut.x or 0.0) - middle, inner_radius=math.nan, outer_radius=math.nan))
    names = {part.name for part in parts}
    interfaces = tuple(contact for contact in section.interfaces if contact.part in names)
    closed = replace(section, bottom=ISOTHERMAL) if section.bottom.kind == "open" else section
    return replace(closed, parts=tuple(parts), interfaces=interfaces, outer=INSULATED, probes=(), light=None, buses=())


@lru_cache(64)
def _solved(section: CrossSection, parts: tuple[str, str], accuracy: float) -> Local:
    """The FEM of a section, reduced, between two of its parts; for 1 m of length."""
    heat = assemble(section, accuracy)
    heated, read = parts
    reduction = reduce(heat.channels(heated, read), accuracy)
    poles = reduction.dynamics
    error = heat.mesh_error(heated, read) + reduction.error_bound
    R = np.asarray(poles.R) * float(section.length or 1.0)
    return Local(replace(poles, R=R), section.outer_radius, error)
