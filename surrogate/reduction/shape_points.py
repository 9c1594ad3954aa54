"""Shapes in the plane as points with weights, and how often two points of two shapes lie at each distance.

The mean of G(|r - r'|) over two shapes is the sum of G over the distribution of their distances, which is the same at
every frequency. A line is points along lanes, an outline cells of a square grid that it cuts; each point stands for a
cell whose extent a Gauss curve of the same variance describes, pitch/sqrt(12). Points are complex, x + i y.

Error. Points a distance D apart on a closed line leave exp(-2 pi gap/D) of G at a gap, on an open one the midpoint
rule's D^2/24 (G' at the ends)/length: with D = gap/8 below 1e-3 of G, measured as the change by half of the points.
"""

import math

import numpy as np
import shapely

from thermofem.arrays import Array, Complex
from thermofem.geometry.shapes import UM, Shape

LANE, MOST_LANES = 0.6e-6, 12  # m, width of a lane; a wide shape has wider ones
PER_GAP = 8  # points for each gap to another shape


def lanes_of(width: float, pitch: float = 0.0) -> Array:
    """Middles of equal lanes across a width in m, from -width/2 to width/2.

    pitch [m]: least width of a lane, where that is larger than the usual one.
    """
    count = min(MOST_LANES, math.ceil(width / max(LANE, pitch)))
    middles = (np.arange(count) + 0.5) / count
    return width * (middles - 0.5)


def points_of(shape: Shape, gap: float = 0.0, *, fewer: bool = False) -> tuple[Complex, Array]:
    """Points in m, and weights of sum 1, shape (n,).

    gap [m]: to the other shape; points are as fine as the lanes need at most. fewer: half of the points.
    """
    pitch = gap / PER_GAP
    lanes = lanes_of(shape.width, pitch)
    lane = shape.width / lanes.size
    if shape.line is None:
        # 1.4: pitch of the cells of an area, where errors are estimated
        cell = 1.4 * lane if fewer else lane
        return _cells(shape.polygon, cell * UM)
    # 3: points along a line for each width of a lane; 48: along a shape, at least
    count = max(48, math.ceil(shape.length / max(lane / 3, pitch)))
    return _along(shape.line, count // 2 if fewer else count, lanes)


def _along(line: Array, count: int, lanes: Array) -> tuple[Complex, Array]:
    """Points at equal steps of a line, and beside it on every lane, which weighs more outside of a bend."""
    corners = line @ [1, 1j]
    at_corner = np.append(0.0, np.cumsum(np.abs(np.diff(corners))))
    step = at_corner[-1] / count
    half_steps = step / 2 * np.arange(2 * count + 1)
    before = np.interp(half_steps - step / 4, at_corner, corners)
    after = np.interp(half_steps + step / 4, at_corner, corners)
    tangent = (after - before) / np.abs(after - before)
    middle = np.interp(half_steps, at_corner, corners)
    on_lanes = middle[:, None] + 1j * tangent[:, None] * lanes
    weight = np.abs(np.diff(on_lanes[::2], axis=0))
    return on_lanes[1::2].ravel(), (weight / weight.sum()).ravel()


def _cells(polygon: shapely.Polygon, pitch: float) -> tuple[Complex, Array]:
    """Centroids in m of the cells of a square grid inside a polygon in um, and their shares of its area."""
    west, south, east, north = polygon.bounds
    columns = math.ceil((east - west) / pitch)
    rows = math.ceil((north - south) / pitch)
    x, wide = np.linspace(west, east, columns, endpoint=False, retstep=True)
    y, high = np.linspace(south, north, rows, endpoint=False, retstep=True)
    X, Y = np.meshgrid(x, y)
    boxes = shapely.box(X, Y, X + wide, Y + high).ravel()
    cells = shapely.intersection(boxes, polygon)
    area = shapely.area(cells)
    inside = area > 0
    middles = shapely.get_coordinates(shapely.centroid(cells[inside]))
    return middles @ [1, 1j] / UM, area[inside] / area.sum()


def distances(one: tuple[Complex, Array], other: tuple[Complex, Array], r: Array) -> Array:
    """Weights of G at the distances ``r`` in m, equal steps in log r, whose sum is the mean over two sets of points."""
    p, of_p = one
    q, of_q = other
    total = np.zeros(r.size)
    rows = max(1, 1_000_000 // len(q))  # numbers at once
    step = np.log(r[1] / r[0])
    for start in range(0, len(p), rows):
        chunk = slice(start, start + rows)
        apart = np.abs(p[chunk, None] - q).ravel()
        weight = np.outer(of_p[chunk], of_q).ravel()
        place = np.log(np.maximum(apart, r[0]) / r[0]) / step
        index = place.astype(np.intp)
        upper = weight * (place - index)
        total += np.bincount(index, weight - upper, r.size)
        total += np.bincount(index + 1, upper, r.size)
    return total
