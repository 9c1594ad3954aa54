"""Power that a bus takes from a ring in one pass, from the supermodes of the two guides along the bend.

    k(z) = (pi/lambda) (n_s - n_a)(g(z)),     g(z) = gap + R - (R^2 - z^2)^(1/2)
    kappa^2 = sin^2 [ k(gap) L + 2 int_0 k(z) cos(beta (R asin(z/R) - z)) dz ],     L the straight section

The bus is the mirror image of the ring's guide. Its supermodes are those of one half with an electric (even E_r) or a
magnetic wall in the middle of the gap; ln(n_s - n_a) over the gap is a parabola through three gaps. Trusted to 20 %:
measured 0.063(3), computed 0.0523 for the racetrack of Borghi et al. 2021, whose gap and width are known to some nm.
Not for bends below 3 um, gaps below 100 nm and guides of different width.

Derivatives are exact for these meshes: each supermode's by Hellmann and Feynman (`shape`), the gap kept.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from ..arrays import Array
from ..geometry.parameter_paths import Change
from .mode_derivatives import Variation, index_slope, variations
from .mode_elements import Space
from .mode_window import UM, Window, drawn
from .surroundings import TAIL

if TYPE_CHECKING:
    from ..geometry import Bus
    from .mode import Mode

WIDER = np.array([0.0, 0.1, 0.25])  # um, added to the gap: where the supermodes are solved
TRUSTED = 0.2  # relative error of kappa^2
MOST_COUPLING = 0.5  # of kappa^2: beyond it the rate equations do not hold
SMALLEST, LARGEST = 2e-8, 3e-6  # m, of half a gap at the foot of the walls, and of a gap
STEP = 1e-30  # of complex differences, which have no round-off


@dataclass(frozen=True, eq=False)
class Coupling:
    """Power coupling between a ring and one bus.

    gap [m]: between the walls at half height.
    straight, bend [m]: length of the straight section, radius of the bends.
    window: triangles of one half, up to the middle of the gap.
    beyond [shape (vertices,)]: stretch of the window's vertices, 0 up to the foot of the outer wall, 1 mid-gap.
    supermodes: even and odd mode at every gap of `WIDER`.
    """

    mode: Mode
    gap: float
    straight: float
    bend: float
    window: Window = field(repr=False)
    beyond: Array = field(repr=False)
    supermodes: tuple[tuple[Mode, Mode], ...] = field(repr=False)

    @cached_property
    def _at(self) -> dict[str, Any]:
        """Arguments of `_phase`."""
        splits = np.array([even.n_eff - odd.n_eff for even, odd in self.supermodes])
        return {
            "splits": splits,
            "n_eff": self.mode.n_eff,
            "wavelength": self.mode.wavelength,
            "straight": self.straight,
            "bend": self.bend,
        }

    @property
    def split(self) -> float:
        """n_s - n_a of the supermodes at the gap."""
        return float(self._at["splits"][0])

    @cached_property
    def phase(self) -> float:
        """Phase of the power exchange in one pass."""
        return _phase(**self._at)

    @property
    def power(self) -> float:
        """Fraction kappa^2 of the power that couples in one pass."""
        return math.sin(self.phase) ** 2

    @cached_property
    def by_gap(self) -> float:
        """Derivative d ln(kappa^2)/d(gap) in 1/m at fixed guides."""
        change = Change("gap", self.gap, "m", optical={("", "gap"): 1.0})
        at_rest = 0.0 * self.mode.light.mesh.points.T
        variation = Variation(self.mode.light, change, at_rest)
        return self.derivative(variation) / self.power

    @cached_property
    def by_width(self) -> float:
        """Derivative d ln(kappa^2)/d(width) in 1/m at fixed gap."""
        light = self.mode.light
        inner, outer = light.surroundings.outermost
        key = "width" if inner is outer and outer.inner_radius else "outer_radius"
        (variation,) = variations(light, [f"part.{outer.name}.{key}"])
        return self.derivative(variation) / self.power

    def derivative(self, variation: Variation, bus: str = "") -> float:
        """Derivative of kappa^2 with respect to a parameter of the section; the gap stays fixed where the guide moves.

        bus: name of the [[bus]], whose gap and straight section the parameter may be.
        """
        gap = variation.change.of_optics(bus, "gap")
        straight = variation.change.of_optics(bus, "straight")
        outer = self.mode.light.surroundings.outermost[1]
        wall = 0.0
        if outer.name in variation.change.outlines:
            corners = variation.change.outlines[outer.name]
            wall = float(corners[1:3, 0].mean()) - variation.centre
        middle = wall + gap / 2  # the middle of the gap follows the wall
        velocity = variation.on(self.window)
        velocity[0] += (middle - velocity[0]) * self.beyond
        splits = []
        for even, odd in self.supermodes:
            even_slope = index_slope(even, variation, velocity)
            odd_slope = index_slope(odd, variation, velocity)
            splits.append(even_slope - odd_slope)
        slopes: dict[str, Any] = {
            "splits": np.array(splits),
            "n_eff": index_slope(self.mode, variation, variation.on(self.mode.window)),
            "wavelength": variation.wavelength,
            "straight": straight,
            "bend": variation.centre - straight / math.pi,
        }
        arguments = {name: value + 1j * STEP * slopes[name] for name, value in self._at.items()}
        moved = _phase(**arguments)
        return math.sin(2 * self.phase) * moved.imag / STEP


def coupling(mode: Mode, gap: float, straight: float = 0.0, *, radius: float | None = None) -> Coupling:
    """Coupling of a bus at a gap, over a straight section between two bends of ``radius``, by default the mode's; in m.

    Raises InputError: a gap that is not positive or in another unit; kappa^2 above `MOST`.
    """
    light = mode.light
    outer = light.surroundings.outline[1:3, 0] - light.centre
    slant = float(outer.max() - outer.mean())
    least = 2 * (SMALLEST + slant)
    gap = checks.between("gap", gap, least, LARGEST, unit="m", hint="did you mean 250e-9? It is that at half height")
    straight = checks.between("straight", straight, 0, 1e-2, unit="m", hint="did you mean 3e-6?")
    radius = mode.radius if radius is None else radius
    bend = checks.positive("radius of the bends", radius, unit="m")
    foot = float(outer.max()) * UM
    wall = float(outer.mean()) * UM
    middle = wall + gap * UM / 2
    inward, _, below, above = light.surroundings.reaches(mode.n_eff, TAIL)
    low, _, bottom, top = light.box(inward, 0.0, below, above)
    left = max(low, light.centre - foot / UM - inward)
    right = light.centre + middle / UM
    window = drawn(light.geometry, (left, right, bottom, top), light.centre, accuracy=2e-3)
    outside = window.mesh.p[0] - foot
    beyond = np.clip(outside / (middle - foot), 0, 1)
    coupler = supermodes(mode, gap, straight, bend, window, beyond)
    if coupler.phase > math.pi / 4:
        raise checks.InputError(
            f"gap = {gap * 1e9:g} nm couples {coupler.power:.2f} of the power in one pass (phase {coupler.phase:.2f}); "
            f"above {MOST_COUPLING} a ring is no resonator of slow rates",
            "take a wider gap or a shorter straight section",
        )
    return coupler


def of_buses(mode: Mode, buses: Sequence[Bus]) -> list[Coupling]:
    """The couplings of [[bus]] tables; a bus beside a racetrack runs along one of its straights.

    Raises InputError: a bus of another width than the ring, or of another straight section than the racetrack.
    """
    racetrack = mode.light.geometry.straight
    inner, outer = mode.light.walls
    width = outer - inner
    couplers = {}
    for bus in buses:
        if bus.width is not None and not math.isclose(bus.width, width, rel_tol=1e-6):
            raise checks.InputError(
                f"bus {bus.name!r} is {bus.width * 1e9:g} nm wide and the ring {width * 1e9:g} nm; couplers of unlike "
                "guides are not computed",
                "give coupling, the power that the bus takes in one pass",
            )
        if racetrack and bus.straight not in (0.0, racetrack):
            raise checks.InputError(
                f"bus {bus.name!r}: straight = {bus.straight:g} m, and [plan] has {racetrack:g} m",
                "leave one of them out",
            )
        lengths = bus.gap, racetrack or bus.straight
        if lengths not in couplers:
            bend = mode.radius if racetrack else mode.radius - bus.straight / math.pi
            couplers[lengths] = coupling(mode, *lengths, radius=bend)
    return [couplers[bus.gap, racetrack or bus.straight] for bus in buses]


def supermodes(mode: Mode, gap: float, straight: float, bend: float, window: Window, beyond: Array) -> Coupling:
    """Solve the supermodes at the gaps of `WIDER`, on a window that ``beyond`` stretches outside the ring's wall."""

    def supermode(wider: float, electric: bool) -> Mode:
        x, y = window.mesh.p
        stretched = x + beyond * wider / 2
        grid = replace(window.mesh, doflocs=np.stack([stretched, y]))
        middle = float(stretched.max())
        wall = (lambda x: np.abs(x[0] - middle) < 1e-6) if electric else None
        space = Space(grid, 2, wall=wall)
        half = replace(mode, window=replace(window, mesh=grid), space=space)
        return half.solved(1)[0]

    pairs = []
    for wider in WIDER:
        modes = [supermode(wider, electric=True), supermode(wider, electric=False)]
        odd, even = sorted(modes, key=lambda mode: mode.n_eff)
        pairs.append((even, odd))
    return Coupling(mode, gap, straight, bend, window, beyond, tuple(pairs))


def _phase(*, splits: Array, n_eff: Any, wavelength: Any, straight: Any, bend: Any) -> Any:
    """Phase of the power exchange in one pass, for real or complex arguments.

    splits: n_s - n_a at the gaps of `WIDER`; beyond the widest ln(n_s - n_a) continues along its tangent.
    """
    powers = np.vander(WIDER, increasing=True)
    logs = np.polynomial.Polynomial(np.linalg.solve(powers, np.log(splits)))
    k = math.pi / (wavelength * UM)
    last = WIDER[-1]
    tangent = logs.deriv()(last)
    decay = tangent if tangent.real < 0 else 0.0
    on_line = k * splits[0] * straight * UM
    if math.isinf(bend.real):
        return on_line
    R = bend * UM
    end = min(0.7 * R, 4 * R**0.5, key=lambda length: length.real)
    z = np.linspace(0, 1, 801) * end
    wider = R - np.sqrt(R**2 - z**2)
    inside = np.where(wider.real < last, wider, last)
    beyond = wider - inside
    rate = k * np.exp(logs(inside) + beyond * decay)
    longer = R * np.arcsin(z / R) - z
    slip = 2 * k * n_eff * longer
    return on_line + 2 * np.trapezoid(rate * np.cos(slip), z)
