"""The sections of the shapes on a chip, and the response between shapes that they and the bare stack make.

The equation is that of `surrogate.reduction.layout_reduction`.
"""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations, combinations_with_replacement
from typing import Any, NamedTuple

import numpy as np
import shapely

from thermofem import CrossSection, Foster, InputError, Shape, assemble
from thermofem.arrays import Array, Complex
from thermofem.geometry.section_parts import INSULATED, ISOTHERMAL, bar
from thermofem.geometry.shapes import UM

from .reduce import reduce
from .shape_points import LANE, distances, lanes_of, points_of
from .stack_green import DISTANCES, ENDLESS, HELD, UNIFORM, Spread, Stack

SECTION = 0.2  # of the tolerance, for the mesh of a section
LANE_SIGMA = LANE / math.sqrt(12)  # m, standard deviation of the widest lane of a line
OTHER = 0.08e12  # 1/m^2, relative error of a gain for w h of silicon or metal that is taken as oxide


class Local(NamedTuple):
    """Two parts of a straight section that is recentred on the first.

    model: from the power of the one in W/m to the mean rise of the other.
    error: relative error of the static gain, by the mesh and the reduction.
    """

    model: Foster
    error: float


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
    stack: Stack

    @classmethod
    def of(cls, shapes: tuple[Shape, ...], tolerance: float) -> "Layout":
        """Check the places of the shapes, and solve their sections."""
        polygons = np.array([shape.polygon for shape in shapes])
        apart = shapely.distance(polygons[:, None], polygons) / UM
        along = np.diag([shape.length for shape in shapes])
        for i, j in combinations(range(len(shapes)), 2):
            along[i, j] = along[j, i] = _length_along(shapes[i], shapes[j])
            if not along[i, j]:
                _check_gap(shapes[i], shapes[j], apart[i, j])
        _check_parts(shapes, along, apart)
        sections = {}
        for i, j in np.argwhere(np.triu(along)).tolist():
            # 0.5: of a length: a part along more than that belongs to the section of a shape
            beside = [k for k in range(len(shapes)) if k in (i, j) or along[i, k] > 0.5 * shapes[i].length]
            section = _section_at(shapes[i], [shapes[k] for k in beside], shapes)
            sections[i, j] = _solved(section, str(shapes[i].part), str(shapes[j].part), SECTION * tolerance)
        return cls(shapes, along, apart, sections, Stack.of(shapes[0].section))

    def frequencies(self, tolerance: float) -> Array:
        """0, and angular frequencies in rad/s up to where every own rise is below a tenth of the tolerance."""
        low = 0.1 * (self.stack.slowest or ENDLESS)
        high = 1e16
        # 6: frequencies in a decade
        count = round(6 * np.log10(high / low))
        omega = np.append(0.0, np.geomspace(low, high, count))
        own = [self.locals[i, i].model.impedance(omega / (2 * np.pi)) for i in range(len(self.shapes))]
        size = np.abs(own)
        small = (size < 0.1 * tolerance * size[:, :1]).all(axis=0)
        return omega[: small.argmax() + 1]

    def ambient(self, omega: Array) -> tuple[Complex, Array]:
        """Rise of each shape per kelvin of the ambient, shape (frequencies, N), by the bare stack, and its error.

        With h of each side H = sum of h g, which is 1 at rest.
        """
        s = np.asarray(1j * omega, dtype=complex)
        lowest, *_, highest = self.stack.edges.tolist()
        sides = ((lowest, self.stack.bottom), (highest, self.stack.top))
        H = np.zeros((omega.size, len(self.shapes)), dtype=complex)
        for k, shape in enumerate(self.shapes):
            for z, exchange in sides:
                (g,) = self.stack.green(UNIFORM, s, Spread(z, z), _spread(shape)).T
                H[:, k] += exchange * g
        area = [sum(part.breadth * part.height for part in shape.section.parts) for shape in self.shapes]
        return H, OTHER * np.array(area)

    def response(self, omega: Array) -> tuple[Complex, Array]:
        """H(i omega) in K/W, shape (frequencies, N, N), and its error in K/W, shape (N, N), without that of the fit."""
        s = np.asarray(1j * omega, dtype=complex)
        n = len(self.shapes)
        H = np.zeros((omega.size, n, n), dtype=complex)
        error = np.zeros((n, n))
        for (heated, read), pairs in self._kinds().items():
            r, G = self.stack.over_distance(s, heated, read)
            rough, G0 = self.stack.over_distance(s[:1], heated, read, DISTANCES // 2)
            for i, j in pairs:
                gap = self.apart[i, j]
                first = self.shapes[i]
                second = self.shapes[j]
                mean = G @ distances(points_of(first, gap), points_of(second, gap), r)
                fewer = points_of(first, gap, fewer=True), points_of(second, gap, fewer=True)
                (coarse,) = G0 @ distances(*fewer, rough)
                H[:, i, j] = H[:, j, i] = mean
                # a third: of a rule of second order, as on open lines, half of the points err by four times as much
                error[i, j] = error[j, i] = abs(coarse - mean[0]) / 3
        for (i, j), difference in self._differences(s).items():
            local = self.locals[i, j]
            share = self.along[i, j] / (self.shapes[i].length * self.shapes[j].length)
            H[:, i, j] = H[:, j, i] = H[:, i, j] + share * difference
            error[i, j] = error[j, i] = error[i, j] + share * local.error * abs(local.model.thermal_resistance)
        return H, error + self._neglected() * np.abs(H[0])

    def _neglected(self) -> Array:
        """Relative error of each gain by bends (w h/R^2) of shapes along each other, or by what others are made of."""
        area = np.array([shape.width * shape.drawn.height for shape in self.shapes])
        bend = np.array([shape.bend for shape in self.shapes])
        both = np.add.outer(area, area) * (1 - np.eye(area.size) / 2)
        tightest = np.minimum.outer(bend, bend)
        return np.where(self.along > 0, both / tightest**2, OTHER * both)

    def _differences(self, s: Complex) -> dict[tuple[int, int], Complex]:
        """Z - Y in K m/W of each pair that runs along each other, equal sections once."""
        bare = replace(self.stack, bottom=HELD, endless=False) if self.stack.endless else self.stack
        known: dict[Any, Complex] = {}
        lines = {}
        for (i, j), local in self.locals.items():
            both = self.shapes[i], self.shapes[j]
            spreads = _spread(both[0]), _spread(both[1])
            kind = (id(local), spreads)
            if kind not in known:
                lanes = [lanes_of(shape.width) + shape.drawn.centre - both[0].drawn.centre for shape in both]
                line = bare.over_section(s, both[0].section.outer_radius, spreads, lanes)
                known[kind] = local.model.impedance(s.imag / (2 * np.pi)) - line
            lines[i, j] = known[kind]
        return lines

    def _kinds(self) -> dict[tuple[Spread, Spread], list[tuple[int, int]]]:
        """Pairs of shapes with equal spreads; of shapes apart only the heights count, and one lane serves all."""
        groups = defaultdict(list)
        for i, j in combinations_with_replacement(range(len(self.shapes)), 2):
            both = _spread(self.shapes[i]), _spread(self.shapes[j])
            if self.along[i, j] == 0.0 and self.apart[i, j] > 0.0:
                both = both[0]._replace(sigma=LANE_SIGMA), both[1]._replace(sigma=LANE_SIGMA)
            groups[min(both), max(both)].append((i, j))
        return groups


def _spread(shape: Shape) -> Spread:
    """How the power of a shape is spread over its height and one of its lanes."""
    part = shape.drawn
    lane = shape.width / lanes_of(shape.width).size
    # 0.5: standard deviation over pitch of a cell of an area: neighbouring Gauss curves leave ripples of 5e-5
    return Spread(part.bottom, part.top, lane * (0.5 if shape.line is None else 1 / math.sqrt(12)))


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
    depth = second.width / 2 - abs(first.drawn.centre - second.drawn.centre)
    # 0.05: of a width, by which two parallel lines may be displaced
    displaced = 0.05 * second.width
    outer, inner = shapely.buffer(second.polygon, -UM * (depth + np.array([-displaced, displaced])), join_style="mitre")
    along = shapely.LineString(first.line * UM).intersection(outer.difference(inner))
    return float(along.length / UM)


def _check_gap(first: Shape, second: Shape, apart: float) -> None:
    """Raise InputError for shapes that cross or are closer than they are thick; ``apart`` in m in the plane."""
    parts = (first.drawn, second.drawn)
    who = f"shapes {first.name!r} and {second.name!r}"
    lower, upper = sorted(parts, key=lambda part: part.bottom)
    gap = np.hypot(apart, max(upper.bottom - lower.top, 0.0))
    if not gap:
        raise InputError(f"{who} cross: they lie at one height, and their outlines overlap; move one of them")
    thick = max(min(part.height, part.breadth) for part in parts)
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
        for part in shape.section.parts:
            reach = np.abs(part.outline()[:, 0] - shape.drawn.centre).max()
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
    drawn = {other.part for other in shapes if other.section == section}
    cut = {part.name: part for part in section.parts if part.name not in drawn}
    cut |= {other.drawn.name: other.drawn for other in beside}
    inside = [cut[part.name] for part in section.parts if part.name in cut]
    parts = tuple(bar(part, part.centre - shape.drawn.centre, part.breadth) for part in inside)
    interfaces = tuple(contact for contact in section.interfaces if contact.part in cut)
    bottom = ISOTHERMAL if section.bottom.kind == "open" else section.bottom
    return replace(
        section, parts=parts, interfaces=interfaces, bottom=bottom, outer=INSULATED, probes=(), light=None, buses=()
    )


@lru_cache(64)
def _solved(section: CrossSection, heated: str, read: str, accuracy: float) -> Local:
    """The FEM of a section, reduced, between two of its parts; for 1 m of length."""
    heat = assemble(section, accuracy)
    reduction = reduce(heat.channels(heated, read), accuracy)
    poles = reduction.dynamics
    R = np.asarray(poles.R) * float(section.length or 1.0)
    return Local(replace(poles, R=R), heat.mesh_error(heated, read) + reduction.error_bound)
