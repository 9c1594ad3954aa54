"""What lies around a guide on each side, and how far its modes reach there, by the effective index method.

The column of a cross-section at one r is a stack of slabs. Its fundamental TE mode has the index n_s:

    E'' + k0^2 (n(z)^2 - n_s^2) E = 0,    E -> 0 below and above

Sideways a mode of index n_eff falls in power as exp(-2 k0 int (n_eff^2 - n_s^2)^(1/2) dr), with n_s of each column; up
and down with the index of each layer in place of n_s. It does not fall where that index is above n_eff.

Source: R. M. Knox, P. P. Toulios, Symposium on Submillimeter Waves (1970); K. Okamoto, Fundamentals of Optical
Waveguides, section 2.4.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import shapely
from scipy.optimize import bisect

from ..arrays import Array
from ..geometry.regions import CUT_GRID
from ..materials.material_library import VOID
from .mode_window import AIR, Box, index_of, material_of

if TYPE_CHECKING:
    from ..geometry import CrossSection, Part

KIND = 0.1  # of the core's index; regions that differ less are of the core's kind
BARRIER = 7.0  # exponent of the decay with the core's index, beyond which a layer is not part of the guide
REFERENCE = 0.25  # of the way from the cladding's index to that of the core's slab: a weakly guided mode
AIRY = 9.0  # depth of a disc's window in the scale of Ai, whose zeros are -2.3, -4.1, -5.5, -6.8
RADIAL = 7.0  # depth of the caustics of a disc's modes in the same scale
TAIL = 1e-7  # of the power: share of a mode that a window may cut off
SIDES = ("left", "right", "bottom", "top")
# corners of the inner and outer wall, of the foot and the top, in the order of `Part.outline`; each with its opposite
OPPOSITE = (([0, 3], [1, 2]), ([1, 2], [0, 3]), ([0, 1], [3, 2]), ([3, 2], [0, 1]))


class Step(NamedTuple):
    """A piece of a straight line through the cross-section: ends in m along the line, index (None of a metal)."""

    start: float
    stop: float
    n: float | None
    region: str


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The surroundings of one part of a cross-section at one wavelength in m."""

    geometry: CrossSection
    part: Part
    wavelength: float

    @property
    def k0(self) -> float:
        """2 pi/wavelength in 1/m."""
        return 2 * math.pi / self.wavelength

    @cached_property
    def indices(self) -> dict[str, float | None]:
        """Refractive index of every region; None of a metal."""
        indices: dict[str, float | None] = {}
        for region in (*self.geometry.region_names, AIR):
            metal = material_of(self.geometry, region).index is None
            indices[region] = None if metal else self.index(region)
        return indices

    @cached_property
    def core_index(self) -> float:
        """Refractive index of the part."""
        return self.index(self.part.name)

    def index(self, region: str) -> float:
        """Refractive index of a region; InputError where it has none."""
        return index_of(material_of(self.geometry, region), self.wavelength, region, self.geometry.ambient)

    def column(self, r: float) -> list[Step]:
        """What lies at r or x in m, from below (the lowest layer goes on) to above (air)."""
        r = abs(r) if self.geometry.mirrored else r
        x = r / CUT_GRID
        lowest = 2 * self.geometry.bottom_z / CUT_GRID
        line = shapely.LineString([(x, lowest), (x, 1.0 / CUT_GRID)])
        steps = []
        for face in self.geometry.subdivision.faces:
            crossed = face.polygon.intersection(line)
            for piece in getattr(crossed, "geoms", [crossed]):
                if piece.length > 0:
                    _, start, _, stop = piece.bounds
                    n = self.indices[face.owner]
                    steps.append(Step(start * CUT_GRID, stop * CUT_GRID, n, face.owner))
        return _filled(sorted(steps), self.indices[AIR])

    @cached_property
    def walls(self) -> list[float]:
        """r or x in m of all corners of parts, sorted; both sides of a mirrored section."""
        corners = np.concatenate([part.outline()[:, 0] for part in self.geometry.parts])
        if self.geometry.mirrored:
            corners = np.concatenate([corners, -corners])
        return sorted(set(corners.tolist()))

    @cached_property
    def middle(self) -> float:
        """r or x in m of a column through the part: where most of it is seen, and then nearest to its centre."""
        part = self.part
        inside = [x for x in self.walls if part.inner_radius < x < part.outer_radius]
        ticks = [part.inner_radius, *inside, part.outer_radius]
        centre = part.centre
        between = [(right + left) / 2 for left, right in itertools.pairwise(ticks)]
        candidates = sorted([centre, *between], key=lambda r: abs(r - centre))

        def thickness(r: float) -> float:
            pieces = [step.stop - step.start for step in self.column(r) if step.region == part.name]
            return round(sum(pieces), 12)

        return max(candidates, key=thickness)

    @cached_property
    def members(self) -> tuple[Part, ...]:
        """The parts that form one rectangle or trapezoid with the part, of its kind of material, itself among them.

        Halves of a diode, layers, rims of a disc: they have the same bottom and top and touch, or lie on each other
        with the same walls.
        """
        members = [self.part]
        others = [p for p in self.geometry.parts if p is not self.part]
        others = [p for p in others if self.guides(p.name, self.floor)]
        while joined := [p for p in others if any(_completes(p, member) for member in members)]:
            members += joined
            others = [p for p in others if p not in joined]
        return tuple(members)

    def guides(self, region: str, n_eff: float) -> bool:
        """Whether a region is of the core's kind and guides a mode: n > n_eff, within `KIND` of the core's index."""
        if region == self.part.name:
            return True
        n = self.indices.get(region)
        if n is None or n <= n_eff:
            return False
        return abs(n / self.core_index - 1) < KIND

    @cached_property
    def outline(self) -> Array:
        """Corners of the `members` together in m, counterclockwise from the inner foot, shape (4, 2)."""
        x, z = np.concatenate([p.outline() for p in self.members]).T
        foot = z.min()
        top = z.max()
        low = x[z == foot]
        high = x[z == top]
        return np.array([(low.min(), foot), (low.max(), foot), (high.max(), top), (high.min(), top)])

    @cached_property
    def bounds(self) -> Box:
        """Left, right, foot and top of the outline in m."""
        left, foot, right, top = shapely.Polygon(self.outline).bounds
        return left, right, foot, top

    @property
    def outermost(self) -> tuple[Part, Part]:
        """The members at the inner and at the outer wall."""
        inner = min(self.members, key=lambda p: (p.inner_radius, p is not self.part))
        outer = max(self.members, key=lambda p: (p.outer_radius, p is self.part))
        return inner, outer

    @cached_property
    def _ends(self) -> tuple[list[Step], list[Step]]:
        """Layers below and above the part, outwards, up to a layer that only begins beyond a barrier."""
        steps = self.column(self.middle)
        below = [step for step in reversed(steps) if step.start < self.part.bottom]
        above = [step for step in steps if step.stop > self.part.top]
        return self._before_barrier(below), self._before_barrier(above)

    def _before_barrier(self, steps: Sequence[Step]) -> list[Step]:
        """The first steps, until a metal, or an index that rises where the decay exceeds `BARRIER`."""
        passed: list[Step] = []
        exponent = 0.0
        for step in steps:
            n = step.n or 0.0
            if passed and step.n is None:
                break
            if passed and n > (passed[-1].n or 0.0) and exponent > BARRIER:
                break
            passed.append(step)
            exponent += (step.stop - step.start) * self._decay(self.core_index, n)
        return passed

    def _decay(self, n_eff: float, index: float, least: float = 0.0) -> float:
        """Decay 2 k0 (n_eff^2 - n^2)^(1/2) of the power per m, with the square at least ``least``."""
        excess = max(n_eff**2 - index**2, least)
        return 2 * self.k0 * math.sqrt(excess)

    @property
    def floor(self) -> float:
        """The larger index of the two media in which the column through the core ends."""
        return max(steps[-1].n or 1.0 for steps in self._ends)

    @cached_property
    def ceiling(self) -> float:
        """Index n_s of the column through the core: no mode of the guide has a larger one."""
        return self._slab(self.middle, *self._span)

    @property
    def _span(self) -> tuple[float, float]:
        """z between which the column through the core lies before the barriers."""
        below, above = self._ends
        return below[-1].start, above[-1].stop

    def _slab(self, r: float, low: float, high: float) -> float:
        """n_s of the column at r between two heights in m; what lies at the heights goes on beyond them."""
        thickness = []
        index = []
        for step in self.column(r):
            if step.stop > low and step.start < high:
                thickness.append(min(step.stop, high) - max(step.start, low))
                index.append(step.n or 1.0)
        return slab_index(thickness, index, self.k0)

    @cached_property
    def bulk(self) -> frozenset[str]:
        """Layers behind a barrier whose index is above that of the core's slab, such as a wafer: a mode leaks there."""
        low, high = self._span
        steps = self.column(self.middle)
        beyond = [step for step in steps if step.stop <= low or step.start >= high]
        dense = {step.region for step in beyond if (step.n or 0) > self.ceiling}
        return frozenset(dense.intersection(layer.name for layer in self.geometry.layers))

    def steps(self, side: str, *, far: bool = False) -> list[tuple[float, float]]:
        """Lengths in m (inf of the last one) and indices from the guide's outline to one of the `SIDES`.

        far: whether sideways columns go beyond the barriers, up to a `bulk` layer.
        """
        _, _, foot, top = self.bounds
        below, above = self._ends
        if side == "bottom":
            steps = [(min(s.stop, foot) - s.start, s.n or 1.0) for s in below if s.start < foot]
        elif side == "top":
            steps = [(s.stop - max(s.start, top), s.n or 1.0) for s in above if s.stop > top]
        else:
            steps = self._columns(side, self.far_span if far else self._span)
        if not steps:  # a disc reaches the axis
            return [(math.inf, self.floor)]
        _, last = steps.pop()
        return [*steps, (math.inf, last)]

    def _columns(self, side: str, span: tuple[float, float]) -> list[tuple[float, float]]:
        """Widths in m and n_s of the columns from the outline outwards, between two heights."""
        left, right, _, _ = self.bounds
        start = right
        end = self.geometry.outer_radius
        if side == "left":
            start = left
            end = 0.0 if self.geometry.kind == "ring" else -end
        low, high = sorted((start, end))
        inside = [x for x in self.walls if low < x < high]
        ticks = sorted({start, *inside, end}, reverse=side == "left")
        columns = []
        for a, b in itertools.pairwise(ticks):
            middle = (a + b) / 2
            columns.append((abs(b - a), self._slab(middle, *span)))
        return columns

    @property
    def inner_end(self) -> float:
        """r or x in m of the left end of windows: near the axis, inside of a disc's rim, or the end of a section."""
        if self.geometry.kind != "ring":
            return -self.geometry.outer_radius
        left, right, _, _ = self.bounds
        return 0.02 * left if left else right - self.rim_depth

    @property
    def rim_depth(self) -> float:
        """Depth in m of a disc's rim that holds its first radial orders: a R/(2^(1/3) nu^(2/3)), a of `AIRY`.

        Source: a whispering-gallery field is Ai(x - a_q) near the edge; M. L. Gorodetsky, A. E. Fomin, IEEE J. Sel.
        Top. Quantum Electron. 12, 33 (2006).
        """
        _, edge, _, _ = self.bounds
        order = self.ceiling * self.k0 * edge
        depth = AIRY * edge / (2 ** (1 / 3) * order ** (2 / 3))
        return min(depth, 0.98 * edge)

    @property
    def lowest(self) -> float:
        """Index below which no mode is looked for: the `floor`, or where the caustic of a disc leaves its rim."""
        left, edge, _, _ = self.bounds
        if self.geometry.kind != "ring" or left > 0:
            return self.floor
        inside = RADIAL / AIRY * self.rim_depth / edge
        return max(self.floor, self.ceiling * (1 - inside))

    @cached_property
    def far_span(self) -> tuple[float, float]:
        """z between the bulk layers."""
        bulk = [step for step in self.column(self.middle) if step.region in self.bulk]
        below = [step.stop for step in bulk if step.stop <= self.part.bottom]
        above = [step.start for step in bulk if step.start >= self.part.top]
        return max(below, default=-math.inf), min(above, default=math.inf)

    def limit(self, side: str, *, far: bool = False) -> float:
        """Index in which a weakly guided mode ends on one side; a mode below it leaks there."""
        steps = self.steps(side, far=far)
        n = self.floor + REFERENCE * (self.ceiling - self.floor)
        exponent = 0.0
        for length, index in steps:
            exponent += length * self._decay(n, index)
            if exponent > -math.log(TAIL):
                break
        return index

    @cached_property
    def cladding_index(self) -> float:
        """The largest index in which a mode ends on any side; of a column at the side its n_s."""
        return max(self.floor, self.limit("left"), self.limit("right"))

    @cached_property
    def continuum(self) -> float:
        """As `cladding_index`, with the layers behind barriers: a mode below it is leaky."""
        left = self.limit("left", far=True)
        right = self.limit("right", far=True)
        return max(self.cladding_index, left, right)

    def reach(self, side: str, n_eff: float, tail: float) -> float:
        """Distance in m from the outline, on one side, at which the power of a mode has fallen to ``tail``."""
        exponent = -math.log(tail)
        distance = 0.0
        for length, index in self.steps(side):
            # n_eff^2 - n^2 is at least 1e-3, so that a reach is finite
            least = 1e-3 if math.isinf(length) else 0.0
            decay = self._decay(n_eff, index, least)
            if decay * length >= exponent:
                return distance + exponent / decay
            exponent -= decay * length
            distance += length
        raise AssertionError("the last step has no end")

    def reaches(self, n_eff: float, tail: float) -> tuple[float, ...]:
        """`reach` on the `SIDES`."""
        return tuple(self.reach(side, n_eff, tail) for side in SIDES)

    @cached_property
    def limits(self) -> tuple[Box, dict[str, tuple[str, float]]]:
        """Box in m where windows end; side and distance in m of each region that absorbs or guides by itself.

        These are the `bulk` layers and materials without an index that do not touch the part.

        Raises InputError: a material without an index touches the part.
        """
        left, right, bottom, top = self.bounds
        box = [self.inner_end, self.geometry.outer_radius, self.geometry.bottom_z, math.inf]
        away = {}
        members = {part.name for part in self.members}
        beside: set[str | None] = set()
        for pair in self.geometry.subdivision.owners:
            if not members.isdisjoint(pair):
                beside.update(pair)
        for name, (r0, z0, r1, z1) in self._boxes.items():
            material = self.geometry.material_of(name)
            if name in beside:
                self.index(name)
            elif material.name != VOID and (material.index is None or name in self.bulk):
                gaps = (left - r1, r0 - right, bottom - z1, z0 - top)
                side = int(np.argmax(gaps))
                if gaps[side] >= 0:
                    away[name] = (SIDES[side], gaps[side])
                    nearer = max if side in (0, 2) else min
                    end = (r1, r0, z1, z0)[side]
                    box[side] = nearer(box[side], end)
        left, right, bottom, top = box
        if self.geometry.mirrored:
            left = -right
        return (left, right, bottom, top), away

    @property
    def _boxes(self) -> dict[str, tuple[float, float, float, float]]:
        """Smallest r and z, largest r and z in m of every region."""
        corners: dict[str, list[Array]] = {}
        for face in self.geometry.subdivision.faces:
            corners.setdefault(face.owner, []).append(face.rings[0])
        return {region: shapely.MultiPoint(np.concatenate(rings)).bounds for region, rings in corners.items()}


def _filled(steps: Sequence[Step], air: float | None) -> list[Step]:
    """Steps from -inf to inf; the first one is prolonged, gaps and what is above are air."""
    filled: list[Step] = []
    for step in steps:
        before = filled[-1].stop if filled else step.start
        if step.start - before > CUT_GRID:
            filled.append(Step(before, step.start, air, AIR))
        filled.append(step)
    first = filled[0]._replace(start=-math.inf)
    return [first, *filled[1:], Step(filled[-1].stop, math.inf, air, AIR)]


def _completes(part: Part, member: Part) -> bool:
    """Whether two parts form one rectangle or trapezoid: side by side, or one on the other."""
    corners = part.outline()
    others = member.outline()
    distances = [np.abs(corners[side] - others[opposite]).max() for side, opposite in OPPOSITE]
    return bool(min(distances) <= 1e-12)


def slab_index(thickness: Sequence[float], index: Sequence[float], k0: float) -> float:
    """n_s of the fundamental TE mode of a stack in which the first and the last medium go on; k0 in 1/m.

    The larger index of these two where the stack guides no mode.

    thickness [m], index: of every layer, the two media among them.
    """
    low = max(index[0], index[-1])
    high = max(index)
    if high <= low or _above_fundamental(low, thickness, index, k0):
        return low

    def above(n: float) -> float:
        return 1.0 if _above_fundamental(n, thickness, index, k0) else -1.0

    return float(bisect(above, low, high, xtol=1e-15))


def _above_fundamental(n: float, thickness: Sequence[float], index: Sequence[float], k0: float) -> bool:
    """Whether a trial index is above n_s: the field that decays below has no zero up to infinity (Sturm)."""
    slope = k0 * math.sqrt(n**2 - index[0] ** 2)  # E'/E
    layers = zip(thickness[1:-1], index[1:-1], strict=True)
    for length, layer in layers:
        square = layer**2 - n**2
        k = k0 * math.sqrt(abs(square)) or 1e-9 * k0
        phase = k * length
        if square > 0:
            if phase >= math.pi:
                return False
            field = math.cos(phase) + slope / k * math.sin(phase)
            derivative = slope * math.cos(phase) - k * math.sin(phase)
        else:
            field = 1 + slope / k * math.tanh(phase)  # both over cosh(phase), which is positive
            derivative = slope + k * math.tanh(phase)
        if field <= 0:
            return False
        slope = derivative / field
    above = k0 * math.sqrt(n**2 - index[-1] ** 2)
    return slope + above > 0
