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

from ..arrays import Array
from ..geometry.regions import CUT_GRID
from ..materials.material_library import VOID
from .mode_window import AIR, Box, index_of, material_of

if TYPE_CHECKING:
    from ..geometry import CrossSection, Part

KIND = 0.1  # of the core's index; regions that differ less are of the core's kind
BARRIER = 7.0  # exponent of the decay with the core's index, beyond which a layer is not part of the guide
LEAST_DECAY = 1e-3  # of n_eff^2 - n^2, so that a reach is finite
REFERENCE = 0.25  # of the way from the cladding's index to that of the core's slab: a weakly guided mode
AIRY, RADIAL = (
    9.0,
    7.0,
)  # depth of a disc's window, and of the caustics of its modes; zeros -a of Ai: 2.3, 4.1, 5.5, 6.8
TAIL = 1e-7  # of the power: share of a mode that a window may cut off
SIDES = ("left", "right", "bottom", "top")


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
        found = {}
        for region in (*self.geometry.region_names, AIR):
            material = material_of(self.geometry, region)
            known = material.index is not None
            found[region] = index_of(material, self.wavelength, region, self.geometry.ambient) if known else None
        return found

    @cached_property
    def core_index(self) -> float:
        """Refractive index of the part."""
        material = self.geometry.material_of(self.part.name)
        return index_of(material, self.wavelength, self.part.name, self.geometry.ambient)

    def column(self, r: float) -> list[Step]:
        """What lies at r or x in m, from below (the lowest layer goes on) to above (air)."""
        r = abs(r) if self.geometry.mirrored else r
        lowest = self.geometry.bottom_z
        line = shapely.LineString([(r / CUT_GRID, 2 * lowest / CUT_GRID), (r / CUT_GRID, 1.0 / CUT_GRID)])
        steps = []
        for face in self.geometry.subdivision.faces:
            crossed = face.polygon.intersection(line)
            for piece in getattr(crossed, "geoms", [crossed]):
                if piece.length > 0:
                    _, start, _, stop = piece.bounds
                    steps.append(Step(start * CUT_GRID, stop * CUT_GRID, self.indices[face.owner], face.owner))
        return _filled(sorted(steps), self.indices[AIR])

    @cached_property
    def walls(self) -> list[float]:
        """r or x in m of all corners of parts, sorted; both sides of a mirrored section."""
        corners = np.concatenate([part.outline()[:, 0] for part in self.geometry.parts])
        return sorted({*map(float, corners), *(map(float, -corners) if self.geometry.mirrored else ())})

    @cached_property
    def middle(self) -> float:
        """r or x in m of a column through the part: where most of it is seen, and then nearest to its centre."""
        part = self.part
        inside = [x for x in self.walls if part.inner_radius < x < part.outer_radius]
        ticks = np.array([part.inner_radius, *inside, part.outer_radius])
        centre = (part.inner_radius + part.outer_radius) / 2
        candidates = sorted([centre, *map(float, (ticks[1:] + ticks[:-1]) / 2)], key=lambda r: abs(r - centre))

        def seen(r: float) -> float:
            return round(sum(step.stop - step.start for step in self.column(r) if step.region == part.name), 12)

        return max(candidates, key=seen)

    @cached_property
    def members(self) -> tuple[Part, ...]:
        """The parts that form one rectangle or trapezoid with the part, of its kind of material, itself among them.

        Halves of a diode, layers, rims of a disc: they have the same bottom and top and touch, or lie on each other
        with the same walls.
        """
        members = [self.part]
        others = [p for p in self.geometry.parts if p is not self.part and self.guides(p.name, self.floor)]
        while joined := [p for p in others if any(_completes(p, member) for member in members)]:
            members += joined
            others = [p for p in others if p not in joined]
        return tuple(members)

    def guides(self, region: str, n_eff: float) -> bool:
        """Whether a region is of the core's kind and guides a mode: n > n_eff, within `KIND` of the core's index."""
        n = self.indices.get(region)
        if region == self.part.name:
            return True
        return n is not None and n > n_eff and abs(n / self.core_index - 1) < KIND

    @cached_property
    def outline(self) -> Array:
        """Corners of the `members` together in m, counterclockwise from the inner foot, shape (4, 2)."""
        foot = min(p.bottom for p in self.members)
        top = max(p.top for p in self.members)
        low = np.array([p.outline()[:2, 0] for p in self.members if p.bottom == foot])
        high = np.array([p.outline()[2:, 0] for p in self.members if p.top == top])
        return np.array([(low.min(), foot), (low.max(), foot), (high.max(), top), (high.min(), top)])

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
            rises = bool(passed) and step.n is not None and step.n > (passed[-1].n or 0.0)
            if passed and (step.n is None or (rises and exponent > BARRIER)):
                break
            passed.append(step)
            length = step.stop - step.start
            exponent += 2 * self.k0 * length * math.sqrt(max(self.core_index**2 - (step.n or 0.0) ** 2, 0.0))
        return passed

    @property
    def floor(self) -> float:
        """The larger index of the two media in which the column through the core ends."""
        below, above = self._ends
        return max(below[-1].n or 1.0, above[-1].n or 1.0)

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
        kept = [step for step in self.column(r) if step.stop > low and step.start < high]
        thickness = [min(step.stop, high) - max(step.start, low) for step in kept]
        return slab_index(thickness, [step.n or 1.0 for step in kept], self.k0)

    @cached_property
    def bulk(self) -> frozenset[str]:
        """Layers behind a barrier whose index is above that of the core's slab, such as a wafer: a mode leaks there."""
        below, above = self._ends
        steps = self.column(self.middle)
        beyond = [step for step in steps if step.stop <= below[-1].start or step.start >= above[-1].stop]
        layers = {layer.name for layer in self.geometry.layers}
        return frozenset(step.region for step in beyond if step.region in layers and (step.n or 0) > self.ceiling)

    def steps(self, side: str, *, far: bool = False) -> list[tuple[float, float]]:
        """Lengths in m (inf of the last one) and indices from the guide's outline to one of the `SIDES`.

        far: whether sideways columns go beyond the barriers, up to a `bulk` layer.
        """
        foot = float(self.outline[:, 1].min())
        top = float(self.outline[:, 1].max())
        below, above = self._ends
        if side == "bottom":
            found = [(min(s.stop, foot) - s.start, s.n or 1.0) for s in below if s.start < foot]
        elif side == "top":
            found = [(s.stop - max(s.start, top), s.n or 1.0) for s in above if s.stop > top]
        else:
            found = self._columns(side, self.far_span if far else self._span)
        if not found:  # a disc reaches the axis
            return [(math.inf, self.floor)]
        return [*found[:-1], (math.inf, found[-1][1])]

    def _columns(self, side: str, span: tuple[float, float]) -> list[tuple[float, float]]:
        """Widths in m and n_s of the columns from the outline outwards, between two heights."""
        if side == "right":
            start = float(self.outline[:, 0].max())
            end = self.geometry.outer_radius
        else:
            start = float(self.outline[:, 0].min())
            end = 0.0 if self.geometry.kind == "ring" else -self.geometry.outer_radius
        low, high = sorted((start, end))
        inside = [x for x in self.walls if low < x < high]
        ticks = sorted({start, *inside, end}, reverse=side == "left")
        return [(abs(b - a), self._slab((a + b) / 2, *span)) for a, b in itertools.pairwise(ticks)]

    @property
    def inner_end(self) -> float:
        """r or x in m of the left end of windows: near the axis, inside of a disc's rim, or the end of a section."""
        if self.geometry.kind != "ring":
            return -self.geometry.outer_radius
        left = float(self.outline[:, 0].min())
        return 0.02 * left if left else float(self.outline[:, 0].max()) - self.rim_depth

    @property
    def rim_depth(self) -> float:
        """Depth in m of a disc's rim that holds its first radial orders: a R/(2^(1/3) nu^(2/3)), a of `AIRY`.

        Source: a whispering-gallery field is Ai(x - a_q) near the edge; M. L. Gorodetsky, A. E. Fomin, IEEE J. Sel.
        Top. Quantum Electron. 12, 33 (2006).
        """
        edge = float(self.outline[:, 0].max())
        order = self.ceiling * self.k0 * edge
        return min(AIRY * edge / (2 ** (1 / 3) * order ** (2 / 3)), 0.98 * edge)

    @property
    def lowest(self) -> float:
        """Index below which no mode is looked for: the `floor`, or where the caustic of a disc leaves its rim."""
        if self.geometry.kind != "ring" or self.outline[:, 0].min() > 0:
            return self.floor
        inside = RADIAL / AIRY * self.rim_depth / float(self.outline[:, 0].max())
        return max(self.floor, self.ceiling * (1 - inside))

    @cached_property
    def far_span(self) -> tuple[float, float]:
        """z between the bulk layers."""
        steps = self.column(self.middle)
        low = max((s.stop for s in steps if s.region in self.bulk and s.stop <= self.part.bottom), default=-math.inf)
        high = min((s.start for s in steps if s.region in self.bulk and s.start >= self.part.top), default=math.inf)
        return low, high

    def limit(self, side: str, *, far: bool = False) -> float:
        """Index in which a weakly guided mode ends on one side; a mode below it leaks there."""
        steps = self.steps(side, far=far)
        n = self.floor + REFERENCE * (self.ceiling - self.floor)
        exponent = 0.0
        for length, index in steps:
            exponent += 2 * self.k0 * length * math.sqrt(max(n**2 - index**2, 0.0))
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
        return max(self.cladding_index, self.limit("left", far=True), self.limit("right", far=True))

    def reach(self, side: str, n_eff: float, tail: float) -> float:
        """Distance in m from the outline, on one side, at which the power of a mode has fallen to ``tail``."""
        left = -math.log(tail)
        distance = 0.0
        for length, index in self.steps(side):
            decay = 2 * self.k0 * math.sqrt(max(n_eff**2 - index**2, 0.0))
            if math.isinf(length):
                decay = max(decay, 2 * self.k0 * math.sqrt(LEAST_DECAY))
            if decay * length >= left:
                return distance + left / decay
            left -= decay * length
            distance += length
        raise AssertionError("the last step has no end")

    def reaches(self, n_eff: float, tail: float) -> tuple[float, float, float, float]:
        """`reach` on the `SIDES`."""
        left, right, bottom, top = (self.reach(side, n_eff, tail) for side in SIDES)
        return left, right, bottom, top

    @cached_property
    def limits(self) -> tuple[Box, dict[str, tuple[str, float]]]:
        """Box in m where windows end; side and distance in m of each region that absorbs or guides by itself.

        These are the `bulk` layers and materials without an index that do not touch the part.

        Raises InputError: a material without an index touches the part.
        """
        left, bottom = self.outline.min(axis=0)
        right, top = self.outline.max(axis=0)
        box = [self.inner_end, self.geometry.outer_radius, self.geometry.bottom_z, math.inf]
        away = {}
        own = {part.name for part in self.members}
        beside = {name for pair in self.geometry.subdivision.owners if own & set(pair) for name in pair}
        for name, (r0, z0, r1, z1) in self._boxes.items():
            material = self.geometry.material_of(name)
            if name in beside:
                index_of(material, self.wavelength, name, self.geometry.ambient)
            elif material.name != VOID and (material.index is None or name in self.bulk):
                gaps = (left - r1, r0 - right, bottom - z1, z0 - top)
                side = int(np.argmax(gaps))
                if gaps[side] >= 0:
                    away[name] = (SIDES[side], float(gaps[side]))
                    nearer = max if side in (0, 2) else min
                    box[side] = nearer(box[side], (r1, r0, z1, z0)[side])
        if self.geometry.mirrored:
            box[0] = -box[1]
        return (float(box[0]), float(box[1]), float(box[2]), float(box[3])), away

    @property
    def _boxes(self) -> dict[str, tuple[float, float, float, float]]:
        """Smallest r and z, largest r and z in m of every region."""
        found: dict[str, tuple[float, float, float, float]] = {}
        for face in self.geometry.subdivision.faces:
            corners = np.concatenate([face.rings[0], np.reshape(found.get(face.owner, ()), (-1, 2))])
            r0, z0 = map(float, corners.min(axis=0))
            r1, z1 = map(float, corners.max(axis=0))
            found[face.owner] = (r0, z0, r1, z1)
        return found


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
    own = part.outline()
    other = member.outline()
    beside = any(np.allclose(own[a], other[b], rtol=0, atol=1e-12) for a, b in ((([0, 3]), ([1, 2])), ([1, 2], [0, 3])))
    on_each_other = any(
        np.allclose(own[a], other[b], rtol=0, atol=1e-12) for a, b in (([0, 1], [3, 2]), ([3, 2], [0, 1]))
    )
    return beside or on_each_other


def slab_index(thickness: Sequence[float], index: Sequence[float], k0: float) -> float:
    """n_s of the fundamental TE mode of a stack in which the first and the last medium go on; k0 in 1/m.

    The larger index of these two where the stack guides no mode.

    thickness [m], index: of every layer, the two media among them.
    """
    low = max(index[0], index[-1])
    high = max(index)
    if high <= low or _above_fundamental(low, thickness, index, k0):
        return low
    for _ in range(60):  # halvings, to round-off
        middle = (low + high) / 2
        if _above_fundamental(middle, thickness, index, k0):
            high = middle
        else:
            low = middle
    return (low + high) / 2


def _above_fundamental(n: float, thickness: Sequence[float], index: Sequence[float], k0: float) -> bool:
    """Whether a trial index is above n_s: the field that decays below has no zero up to infinity (Sturm)."""
    slope = k0 * math.sqrt(n**2 - index[0] ** 2)  # E'/E
    for length, layer in zip(thickness[1:-1], index[1:-1], strict=True):
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
    return slope + k0 * math.sqrt(n**2 - index[-1] ** 2) > 0
