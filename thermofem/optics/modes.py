"""The guided modes of a ring or a straight guide: where they are looked for, which there are, and their names."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .. import checks
from ..checks import InputError
from .mode import Mode
from .mode_elements import Space
from .mode_window import UM, Box, Window, material_of, window
from .surroundings import REFERENCE, TAIL, Surroundings

if TYPE_CHECKING:
    from ..fem import HeatProblem
    from ..geometry import CrossSection
    from ..mesh import Mesh

RIDGE = 0.9  # of dn_eff/dn of what guides: a part with less is the ridge of a rib, the rim of a disc, half of a diode
HELD = 0.4  # of the energy, within the core and where the mode falls to a tenth: less is no mode of this guide
ROOF = 1e-4  # of the power of a weakly guided mode: with less at the top of the stack a window ends there
WEAKEST = 0.03  # of the way from the cladding's index to the core's slab: no window is widened for a weaker mode
FIRST, MOST = 3, 48  # modes that are solved for at first and at most

log = logging.getLogger("thermofem")


class _Search(NamedTuple):
    """Modes of the straight guide, the window on which they were solved, and its distances from the core in m."""

    window: Window
    reaches: Sequence[float]
    modes: list[Mode]


@dataclass(frozen=True, eq=False)
class Light:
    """The guided modes of one part of a cross-section at one wavelength, as `light` returns them."""

    geometry: CrossSection
    mesh: Mesh = field(repr=False)
    wavelength: float
    part: str
    element_order: int
    accuracy: float

    @classmethod
    def of(cls, heat: HeatProblem, wavelength: float | None = None, part: str | None = None, order: int = 2) -> Light:
        """Guided modes on the mesh of a heat problem; arguments as of `fem.assembly.light`."""
        geometry = heat.geometry
        parts = [member.name for member in geometry.parts]
        if geometry.light is not None:
            wavelength = wavelength or geometry.light.wavelength
            part = part or geometry.light.part
        if wavelength is None:
            raise InputError("wavelength is missing; give it, or [light] with wavelength in the geometry")
        hint = "wavelengths are in m (did you mean 1.55e-6?)"
        wavelength = checks.between("wavelength", wavelength, 1e-7, 1e-4, unit="m", hint=hint)
        default = "core" if "core" in parts else geometry.heated[0]
        part = checks.choice("part", part or default, parts)
        order = checks.integer("order", order, 2, 3)
        light = cls(geometry, heat.mesh, wavelength, part, order, heat.accuracy)
        light.surroundings.core_index  # noqa: B018 - the core has an index at this wavelength
        return light

    @cached_property
    def surroundings(self) -> Surroundings:
        """What lies around the part on each side."""
        return Surroundings(self.geometry, self.geometry.part(self.part), self.wavelength)

    @property
    def walls(self) -> tuple[float, float]:
        """r or x in m of the inner and the outer wall at half height, of the part and what forms the core with it."""
        inner, outer = self.surroundings.outermost
        return inner.inner_radius, outer.outer_radius

    @property
    def centre(self) -> float:
        """r or x in m of the origin of windows: the core's centre, or the edge of a full disc or its rim."""
        inner, outer = self.walls
        if inner or self.geometry.kind == "straight":
            return (inner + outer) / 2
        return outer

    @property
    def at_edge(self) -> bool:
        """Whether R is the radius of the edge (of a disc or its rim) and not that of the core's centre."""
        return self.centre == self.walls[1]

    @property
    def radius(self) -> float:
        """R in m; inf for a straight guide."""
        return math.inf if self.geometry.kind == "straight" else self.centre

    def box(self, left: float, right: float, below: float, above: float) -> Box:
        """Box (left, right, bottom, top) in m that extends by these lengths beyond the core, cut to its limits."""
        inner, outer, foot, top = self.surroundings.bounds
        ends, _ = self.surroundings.limits
        start = max(inner - left, ends[0])
        stop = min(outer + right, ends[1])
        bottom = max(foot - below, ends[2])
        roof = min(top + above, ends[3])
        return start, stop, bottom, roof

    @property
    def _weak(self) -> float:
        """n_eff of a weakly guided mode: `REFERENCE` of the way from the cladding's index to the core's slab."""
        cladding = self.surroundings.cladding_index
        return cladding + REFERENCE * (self.surroundings.ceiling - cladding)

    @property
    def window(self) -> Window:
        """Triangles on which modes are solved: up to where a weakly guided mode has decayed."""
        return self._search.window

    @cached_property
    def _bent(self) -> Window:
        """Triangles on which modes of the bend are solved: outwards not much beyond the caustic of the best one."""
        if self.at_edge or math.isinf(self.radius):
            return self.window
        best = max(mode.n_eff for mode in self._straight.values())
        return self._cut(self._search.reaches, self._caustic(best))

    def _cut(self, reaches: Sequence[float], farthest: float) -> Window:
        """Triangles up to ``reaches`` from the core on the four sides, and at most ``farthest`` outwards; all in m."""
        left, right, below, above = reaches
        _, _, _, top = self.surroundings.bounds
        stack = self.geometry.top_z - top
        if stack > self.surroundings.reach("top", self._weak, ROOF):
            above = min(above, stack)
        right = min(right, farthest)
        box = self.box(left, right, below, above)
        return window(self.geometry, self.mesh, box, self.centre, self.accuracy)

    def _caustic(self, n_eff: float) -> float:
        """Distance in m from the outer wall at which a mode of the bend begins to radiate, n_clad r = n_eff R.

        At least that at which a mode between the indices of cladding and core has decayed: beyond a caustic windows
        have modes of their own, which mix with that of the guide where they are large.
        """
        cladding = self.surroundings.cladding_index
        between = cladding + REFERENCE * (self.surroundings.core_index - cladding)
        least = self.surroundings.reach("right", between, TAIL)
        return max(least, self.radius * (n_eff / cladding - 1))

    @cached_property
    def _space(self) -> Space:
        """The finite-element space of the bend."""
        return Space(self._bent.mesh, self.element_order, self.radius * UM)

    @cached_property
    def _search(self) -> _Search:
        """Modes of the straight guide, on a window for a weakly guided one, or for the weakest of them if wider."""
        first = self._searched(self.surroundings.reaches(self._weak, TAIL))
        cladding = self.surroundings.cladding_index
        least = cladding + WEAKEST * (self.surroundings.ceiling - cladding)
        indices = [mode.n_eff for mode in first.modes if mode.n_eff > least]
        weakest = min(indices, default=math.inf)
        if weakest >= self._weak:
            return first
        return self._searched(self.surroundings.reaches(weakest, TAIL))

    def _searched(self, reaches: Sequence[float]) -> _Search:
        """Guided modes of the straight guide, of a disc of the disc, on a window with these distances in m."""
        floor = self.surroundings.lowest
        window = self._cut(reaches, self._caustic(self._weak) if self.at_edge else math.inf)
        space = Space(window.mesh, 2, self.radius * UM if self.at_edge else math.inf)
        start = Mode("", self.wavelength, self, window, space, 0.0, np.empty(0))
        count = FIRST
        while True:
            solved = start.solved(count, self.surroundings.ceiling)
            lowest = min(mode.n_eff for mode in solved)
            complete = len(solved) < count or lowest < floor
            if complete or count >= MOST:
                break
            count *= 2
        if not complete:
            log.warning(
                "%s: %d modes were looked at, down to n_eff = %.4g; %r may guide more below that",
                self.geometry.name, count, lowest, self.part,
            )  # fmt: skip
        guided = [mode for mode in solved if mode.n_eff > floor and mode.held > HELD]
        return _Search(window, reaches, guided)

    @cached_property
    def _straight(self) -> dict[str, Mode]:
        """Guided modes of the straight guide (of a disc, of the disc) by name, best guided first."""
        modes = self._search.modes
        if not modes:
            floor = self.surroundings.lowest
            ceiling = self.surroundings.ceiling
            raise InputError(
                f"{self.geometry.name!r} guides no mode in {self.part!r} at {self.wavelength * 1e9:g} nm: none has an "
                f"index between {floor:.4g} around it and {ceiling:.4g} of its layers",
                "a core needs a larger index than what is around it, and enough width and height",
            )
        named: dict[str, Mode] = {}
        orders = {"TE": 0, "TM": 0}
        for mode in sorted(modes, key=lambda mode: -mode.n_eff):
            kind = "TE" if mode.te_fraction > 0.5 else "TM"
            name = f"{kind}{orders[kind]}"
            named[name] = replace(mode, name=name)
            orders[kind] += 1
        return named

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the modes that the straight guide supports, best guided first."""
        return tuple(self._straight)

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Guided modes, best guided first; modes that leave the core in the bend are left out."""
        return tuple(filter(self._stays, map(self._solved, self.names)))

    def mode(self, name: str | None = None) -> Mode:
        """The guided mode called ``name``; default that of the polarisation in [light] of the geometry, else TE0.

        Raises InputError: no such mode is guided; the bend is so tight that the mode leaves the core.
        """
        default = "TE0" if self.geometry.light is None else self.geometry.light.mode
        name = name or default
        if name not in self.names:
            rule = f"{self.geometry.name!r} guides no mode {name!r} in {self.part!r} at {self.wavelength * 1e9:g} nm"
            raise InputError(rule, f"it guides {', '.join(self.names)}")
        mode = self._solved(name)
        if not self._stays(mode):
            raise InputError(
                f"{name} leaves the core at the radius {self.radius * UM:g} um: {mode.share:.0%} of its energy is left "
                f"there, {self._straight[name].share:.0%} without the bend",
                "take a larger radius, or a wider core",
            )
        self._report(mode)
        return mode

    def _stays(self, mode: Mode) -> bool:
        """Whether a mode of the bend has its energy where the straight guide has it, and a barrier holds it there."""
        # with less than half of its share of the energy in the straight guide a mode has left the bend
        if mode.share < 0.5 * self._straight[mode.name].share:
            return False
        # below this exponent nothing holds a mode in the bend
        return math.isinf(self.radius) or mode.tunnelling(self.surroundings.floor) > 2.0

    @cached_property
    def _known(self) -> dict[str, Mode]:
        """Cache of the modes that are solved, by name."""
        return {}

    def _solved(self, name: str) -> Mode:
        """The mode called ``name``, solved in the bend."""
        if name not in self._known:
            mode = self._straight[name]
            if mode.radius != self.radius or mode.space.order != self.element_order:
                mode = mode.nearest(self._space, self._bent)
            self._known[name] = mode
        return self._known[name]

    def _report(self, mode: Mode) -> None:
        """Log what absorbs or guides light within the mode's reach, and a core that is not all of the guide.

        Raises InputError: a material without an index within the reach.
        """
        share = mode.confinement[self.part] / mode.index_confinement
        if share < RIDGE:
            log.warning(
                "%s: %r is %.0f %% of the %s that guides %s: volumes and confinements are of all of it; the mean over "
                "the part is not the temperature that the light sees; read 'light'",
                self.geometry.name, self.part, 100 * share, mode.core_material, mode.name,
            )  # fmt: skip
        if mode.hybrid:
            log.warning(
                "%s: %s is hybrid, %.0f %% TE: a small change of the geometry may give it another name",
                self.geometry.name, mode.name, 100 * mode.te_fraction,
            )  # fmt: skip
        if mode.lacking and not mode.lacking_in_core:
            log.warning(
                "%s: dn/dT of %s is missing and counts as 0 in the shift per kelvin of %s",
                self.geometry.name, " and ".join(mode.lacking), mode.name,
            )  # fmt: skip
        for name, (side, away) in self.surroundings.limits[1].items():
            material = material_of(self.geometry, name)
            # 1e-4: a metal that so much of the power reaches is refused
            reach = self.surroundings.reach(side, mode.n_eff, 1e-4)
            if material.index is None and away < reach:
                raise InputError(
                    f"{name!r} ({material.name}) lies {away * UM:.3g} um from {self.part!r}, within the reach of "
                    f"{mode.name}, and has no refractive index",
                    f"move it {reach * UM:.2g} um away, or give it in [material.{material.name}] index = ...",
                )
        # 0.01 dB/cm: a larger leak is reported
        if mode.substrate_loss > 0.01:
            log.warning(
                "%s: %s leaks into %s: %.2g dB/cm; that loss heats nothing in the core",
                self.geometry.name, mode.name, " and ".join(mode.drains), mode.substrate_loss,
            )  # fmt: skip
