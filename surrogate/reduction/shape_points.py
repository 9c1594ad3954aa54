"""Shapes in the plane as points with weights, and how often two points of two shapes lie at each distance.

The mean of G(|r - r'|) over two shapes is the sum of G over the distribution of their distances, which is the same at
every frequency. A line is points along lanes, an outline cells of a square grid that it cuts; each point stands for a
cell whose extent a Gauss curve of the same variance describes, pitch/sqrt(12).

Error. Points a distance D apart on a closed line leave exp(-2 pi gap/D) of G at a gap, on an open one the midpoint
rule's D^2/24 (G' at the ends)/length: with D = gap/8 below 1e-3 of G, measured as the change by half of the points.
"""

from dataclasses import dataclass, replace

import numpy as np
import shapely

from thermofem.arrays import Array
from thermofem.geometry.shapes import UM, Shape

LANE, MOST_LANES = 0.6e-6, 12  # m, width of a lane; a wide shape has wider ones
PER_GAP = 8  # points for each gap to another shape


@dataclass(frozen=True, eq=False)
class Spread:
    """How the power of a part is spread across its section.

    z [shape (n,), m], weight [shape (n,)]: over its height.
    lanes [shape (m,), m]: x of equal lanes over its width.
    sigma [m]: standard deviation of one lane, or of one cell of an area.
    """

    z: Array
    weight: Array
    lanes: Array
    sigma: float

    @classmethod
    def of(cls, shape: Shape) -> "Spread":
        """Uniform over the part of a shape."""
        part = shape.drawn
        # 3: Gauss points over the height of a part
        node, weight = np.polynomial.legendre.leggauss(3)
        lanes = lanes_of(shape.width)
        lane = shape.width / lanes.size
        # 0.5: standard deviation over pitch of a cell of an area: neighbouring Gauss curves leave ripples of 5e-5
        sigma = 0.5 * lane if shape.line is None else lane / np.sqrt(12)
        z = part.bottom + part.height * (node + 1) / 2
        return cls(z, weight / 2, lanes + float(part.x or 0.0), float(sigma))

    def moved(self, x: float) -> "Spread":
        """The same with x counted from another place in m."""
        return replace(self, lanes=self.lanes - x)


def lanes_of(width: float, pitch: float = 0.0) -> Array:
    """Middles of equal lanes across a width in m, from -width/2 to width/2.

    pitch [m]: largest width of a lane, where that is larger than the usual one.
    """
    count = min(MOST_LANES, int(np.ceil(width / LANE)))
    if pitch > width / count:
        count = int(np.ceil(width / pitch))
    middles = (np.arange(count) + 0.5) / count
    return width * (middles - 0.5)


def points_of(shape: Shape, pitch: float | None = None, *, fewer: bool = False) -> tuple[Array, Array]:
    """Points in m, shape (n, 2), and weights of sum 1, shape (n,).

    pitch [m]: between points; as fine as the lanes need by default. fewer: half of the points.
    """
    lanes = lanes_of(shape.width, pitch or 0.0)
    lane = shape.width / lanes.size
    if shape.line is None:
        # 1.4: pitch of the cells of an area, where errors are estimated
        cell = 1.4 * lane if fewer else lane
        return _cells(shape.polygon, cell * UM)
    # 3: points along a line for each width of a lane
    spacing = pitch or lane / 3
    # 48: points along a shape, at least
    count = max(48, int(np.ceil(shape.length / spacing)))
    return _along(shape.line, count // 2 if fewer else count, lanes)


def centre_points(shape: Shape, count: int) -> Array:
    """Points at equal steps of the centre line in m, shape (count, 2); of a shape that has one."""
    points, _ = _along(np.asarray(shape.line), count, np.zeros(1))
    return points


def _along(line: Array, count: int, lanes: Array) -> tuple[Array, Array]:
    """Points at equal steps of a line, and beside it on every lane, which weighs more outside of a bend."""
    edge = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    step = edge[-1] / count
    corners = _lanes_at(line, edge, step * np.arange(count + 1), step, lanes)
    weight = np.linalg.norm(np.diff(corners, axis=0), axis=-1)
    points = _lanes_at(line, edge, step * (np.arange(count) + 0.5), step, lanes)
    return points.reshape(-1, 2), (weight / weight.sum()).ravel()


def _lanes_at(line: Array, edge: Array, along: Array, step: float, lanes: Array) -> Array:
    """Points on every lane at positions ``along`` a line in m, shape (positions, lanes, 2); ``edge`` of its corners."""

    def at(position: Array) -> Array:
        return np.column_stack([np.interp(position, edge, line[:, axis]) for axis in (0, 1)])

    tangent = at(along + step / 4) - at(along - step / 4)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    return at(along)[:, None] + lanes[:, None] * normal[:, None]


def _cells(polygon: shapely.Polygon, pitch: float) -> tuple[Array, Array]:
    """Centroids in m of the cells of a square grid inside a polygon in um, and their shares of its area."""
    west, south, east, north = polygon.bounds
    width = east - west
    height = north - south
    columns = int(np.ceil(width / pitch))
    rows = int(np.ceil(height / pitch))
    x = west + np.arange(columns) * width / columns
    y = south + np.arange(rows) * height / rows
    X, Y = np.meshgrid(x, y)
    boxes = shapely.box(X, Y, X + width / columns, Y + height / rows).ravel()
    cells = shapely.intersection(boxes, polygon)
    area = shapely.area(cells)
    inside = area > 0
    middles = shapely.get_coordinates(shapely.centroid(cells[inside]))
    return middles / UM, area[inside] / area.sum()


def distances(one: tuple[Array, Array], other: tuple[Array, Array], r: Array) -> Array:
    """Weights of G at the distances ``r`` in m, equal steps in log r, whose sum is the mean over two sets of points."""
    p, of_p = one
    q, of_q = other
    total = np.zeros(r.size)
    rows = max(1, 1_000_000 // len(q))  # numbers at once
    step = np.log(r[1] / r[0])
    for start in range(0, len(p), rows):
        chunk = slice(start, start + rows)
        x, y = np.moveaxis(p[chunk, None] - q, -1, 0)
        apart = np.maximum(np.hypot(x, y).ravel(), r[0])
        weight = np.outer(of_p[chunk], of_q).ravel()
        place = np.clip(np.log(apart / r[0]) / step, 0, r.size - 1.001)
        index = place.astype(np.intp)
        upper = weight * (place - index)
        total += np.bincount(index, weight - upper, r.size)
        total += np.bincount(index + 1, upper, r.size)
    return total
