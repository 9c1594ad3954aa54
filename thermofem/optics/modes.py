"""The guided modes of a ring or a straight guide: where they are looked for, which there are, and their names."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from .. import checks
from ..arrays import Array
from .mode import Mode
from .mode_elements import Space
from .mode_window import UM, Box, Window, index_of, limits, material_of, window

if TYPE_CHECKING:
    from ..fem import HeatProblem
    from ..geometry import CrossSection, Part
    from ..mesh import Mesh

TAIL = 1e-7  # of the power: share of a mode that the window may cut off
REACHES = 1e-4  # of the power: a metal that so much of the mode reaches is refused
LEAKS = 1e-6  # of the power: where so much of the mode reaches a substrate its leak is computed
LEAK = 0.01  # dB/cm; a larger leak is reported
RIDGE = 0.9  # of dn_eff/dn of the core's material: a part with less is the ridge of a rib, or the rim of a disc
HELD = 0.4  # of the energy, in the core's material over the core's width: less is no mode of this guide

log = logging.getLogger("thermofem")


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
        geometry, given = heat.geometry, heat.geometry.light
        parts = [one.name for one in geometry.parts]
        if given is not None:
            wavelength = wavelength or given.wavelength
            part = part or given.part
        if wavelength is None:
            raise checks.InputError("wavelength is missing; give it, or [light] with wavelength in the geometry")
        hint = "wavelengths are in m (did you mean 1.55e-6?)"
        wavelength = checks.between("wavelength", wavelength, 1e-7, 1e-4, unit="m", hint=hint)
        part = checks.choice("part", part or ("core" if "core" in parts else geometry.heated[0]), parts)
        order = checks.integer("order", order, 2, 3)
        found = cls(geometry, heat.mesh, wavelength, part, order, heat.accuracy)
        found.core_index  # noqa: B018 - the core has an index at this wavelength
        return found

    @property
    def guide(self) -> Part:
        """The part that guides."""
        return next(part for part in self.geometry.parts if part.name == self.part)

    @property
    def centre(self) -> float:
        """r or x in m of the origin of windows: the core's centre, or the edge of a full disc or its rim."""
        p = self.guide
        if p.x is not None:
            return p.x
        filled = any(
            (q.material, q.bottom, q.top) == (p.material, p.bottom, p.top)
            and math.isclose(q.outer_radius, p.inner_radius, rel_tol=1e-9)
            for q in self.geometry.parts
        )
        return p.outer_radius if filled or not p.inner_radius else (p.inner_radius + p.outer_radius) / 2

    @property
    def at_edge(self) -> bool:
        """Whether R is the radius of the edge (of a disc or its rim) and not that of the core's centre."""
        return self.centre == self.guide.outer_radius

    @property
    def radius(self) -> float:
        """R in m; inf for a straight guide."""
        return math.inf if self.geometry.kind == "straight" else self.centre

    @cached_property
    def core_index(self) -> float:
        """Refractive index of the core."""
        return index_of(self.geometry.material_of(self.part), self.wavelength, self.part)

    @cached_property
    def cladding_index(self) -> float:
        """Largest refractive index below that of the core among all layers and parts."""
        regions = [self.geometry.material_of(name) for name in self.geometry.region_names]
        known = [m.index.index(self.wavelength) for m in regions if m.index is not None]
        return max((n for n in known if n < 0.99 * self.core_index), default=1.0)

    def reach(self, n_eff: float, tail: float) -> float:
        """Distance in m at which exp(-2 sqrt(n_eff^2 - n_clad^2) k0 d) has fallen to ``tail``."""
        decay = 2 * math.pi / self.wavelength * math.sqrt(max(n_eff**2 - self.cladding_index**2, 1e-3))
        return -math.log(tail) / (2 * decay)

    @cached_property
    def outline(self) -> Array:
        """Corners of the part in m, shape (4, 2)."""
        return self.guide.outline()

    @cached_property
    def limits(self) -> tuple[Box, dict[str, float]]:
        """Box where the window must end, and distance in m to each region beyond it, as of `window.limits`."""
        return limits(self.geometry, self.guide, self.wavelength)

    def box(self, *asides: float) -> Box:
        """Box (left, right, bottom, top) in m that extends by ``asides`` beyond the part, cut to `limits`."""
        left, bottom = self.outline.min(axis=0)
        right, top = self.outline.max(axis=0)
        wanted = (left - asides[0], right + asides[1], bottom - asides[2], top + asides[3])
        end = self.limits[0]
        return max(wanted[0], end[0]), min(wanted[1], end[1]), max(wanted[2], end[2]), min(wanted[3], end[3])

    @cached_property
    def window(self) -> Window:
        """Triangles on which modes are solved: up to where a mode of index near the cladding's has decayed."""
        weak = self.cladding_index + 0.25 * (self.core_index - self.cladding_index)
        box = self.box(*[self.reach(weak, TAIL)] * 4)
        return window(self.geometry, self.mesh, box, self.centre, self.accuracy)

    @cached_property
    def _space(self) -> Space:
        """The finite-element space of the bend."""
        return Space(self.window.mesh, self.element_order, self.radius * UM)

    @cached_property
    def _straight(self) -> dict[str, Mode]:
        """Guided modes of the straight guide of this cross-section by name, best guided first."""
        space, count = Space(self.window.mesh), 3
        start = Mode("", self.wavelength, self, self.window, space, 0.0, np.empty(0))
        while True:
            found = start.solved(count, 0.999 * self.core_index)
            found = [mode for mode in found if mode.n_eff > self.cladding_index and mode.share > HELD]
            if len(found) < count or count > 40:
                break
            count *= 2
        if not found:
            raise checks.InputError(
                f"{self.geometry.name!r} guides no mode in {self.part!r} at {self.wavelength * 1e9:g} nm",
                "a core needs a larger index than what is around it, and enough width and height",
            )
        named: dict[str, Mode] = {}
        for mode in sorted(found, key=lambda mode: -mode.n_eff):
            kind = "TE" if mode.te_fraction > 0.5 else "TM"
            name = f"{kind}{sum(other.startswith(kind) for other in named)}"
            named[name] = replace(mode, name=name)
        return named

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the modes that the straight guide supports, best guided first."""
        return tuple(self._straight)

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Guided modes, best guided first; modes that leave the core in the bend are left out."""
        return tuple(mode for mode in map(self._solved, self.names) if mode.share >= HELD)

    def mode(self, name: str | None = None) -> Mode:
        """The guided mode called ``name``; default that of the polarisation in [light] of the geometry, else TE0.

        Raises InputError: no such mode is guided; the bend is so tight that the mode leaves the core.
        """
        given = self.geometry.light
        name = checks.choice("mode", name or ("TE0" if given is None else given.mode), self.names)
        mode = self._solved(name)
        if mode.share < HELD:
            raise checks.InputError(
                f"{name} leaves the core at the radius {self.radius * UM:g} um: {mode.share:.0%} of its energy is left "
                "there",
                "take a larger radius, or a wider core",
            )
        self._report(mode)
        return mode

    @cached_property
    def _known(self) -> dict[str, Mode]:
        """Cache of the modes that are solved, by name."""
        return {}

    def _solved(self, name: str) -> Mode:
        """The mode called ``name``, solved in the bend."""
        if name not in self._known:
            straight = self._straight[name]
            same = math.isinf(self.radius) and self.element_order == straight.space.order
            self._known[name] = straight if same else straight.nearest(self._space)
        return self._known[name]

    def _report(self, mode: Mode) -> None:
        """Log what absorbs or guides light within the mode's reach, and a core that is only a part of the guide."""
        share = mode.confinement[self.part] / mode.confinement[mode.core_material]
        if share < RIDGE:
            log.warning(
                "%s: %r is %.0f %% of the %s that guides %s: volumes and confinements are of all of it; the mean over "
                "the part is not the temperature that the light sees; read 'light'",
                self.geometry.name, self.part, 100 * share, mode.core_material, mode.name,
            )  # fmt: skip
        reach = self.reach(mode.n_eff, REACHES)
        leaks = self.reach(mode.n_eff, LEAKS)
        for name, away in self.limits[1].items():
            material = material_of(self.geometry, name)
            if material.index is None and away < reach:
                raise checks.InputError(
                    f"{name!r} ({material.name}) lies {away * UM:.3g} um from {self.part!r}, within the reach of "
                    f"{mode.name}, and has no refractive index",
                    f"move it {reach * UM:.2g} um away, or give it in [material.{material.name}] index = ...",
                )
            if material.index is not None and away < leaks and mode.substrate_loss > LEAK:
                log.warning(
                    "%s: %s leaks into %r, %.3g um away: %.2g dB/cm; that loss heats nothing in the core",
                    self.geometry.name, mode.name, name, away * UM, mode.substrate_loss,
                )  # fmt: skip
