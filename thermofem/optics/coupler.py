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
SMALLEST, LARGEST = 2e-8, 3e-6  # m, of half a gap at the foot of the walls, and of a gap
STEP = 1e-30  # of complex differences, which have no round-off
SIZES = 2e-3  # the mesh is as fine as one for heat of this relative accuracy
POINTS = 801  # of the integral along the bend
MOST = 0.5  # of kappa^2: beyond it the rate equations do not hold


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
        own = {"straight": self.straight, "bend": self.bend}
        return {"splits": splits, "n_eff": self.mode.n_eff, "wavelength": self.mode.wavelength, **own}

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
        return self.derivative(Variation(self.mode.light, change, 0.0 * self.mode.light.mesh.points.T)) / self.power

    @cached_property
    def by_width(self) -> float:
        """Derivative d ln(kappa^2)/d(width) in 1/m at fixed gap."""
        light = self.mode.light
        inner, outer = light.surroundings.outermost
        key = "width" if inner is outer and outer.inner_radius else "outer_radius"
        (one,) = variations(light, [f"part.{outer.name}.{key}"])
        return self.derivative(one) / self.power

    def derivative(self, one: Variation, bus: str = "") -> float:
        """Derivative of kappa^2 with respect to a parameter of the section; the gap stays fixed where the guide moves.

        bus: name of the [[bus]], whose gap and straight section the parameter may be.
        """
        gap = one.change.optical.get((bus, "gap"), 0.0)
        straight = one.change.optical.get((bus, "straight"), 0.0)
        corners = one.change.outlines.get(self.mode.light.surroundings.outermost[1].name)
        wall = 0.0 if corners is None else float(corners[1:3, 0].mean()) - one.centre
        velocity = one.on(self.window)  # the middle of the gap follows the wall
        velocity[0] += (wall + gap / 2 - velocity[0]) * self.beyond
        of_pairs = ([index_slope(m, one, velocity) for m in pair] for pair in self.supermodes)
        slopes: dict[str, Any] = {
            "splits": np.array([even - odd for even, odd in of_pairs]),
            "n_eff": index_slope(self.mode, one, one.on(self.mode.window)),
            "wavelength": one.wavelength,
            "straight": straight,
            "bend": one.centre - straight / math.pi,
        }
        moved = _phase(**{name: at + 1j * STEP * slopes[name] for name, at in self._at.items()})
        return math.sin(2 * self.phase) * moved.imag / STEP


def coupling(mode: Mode, gap: float, straight: float = 0.0, *, radius: float | None = None) -> Coupling:
    """Coupling of a bus at a gap, over a straight section between two bends of ``radius``, by default the mode's; in m.

    Raises InputError: a gap that is not positive or in another unit; kappa^2 above `MOST`.
    """
    light = mode.light
    outer = light.outline[1:3, 0] - light.centre
    least = 2 * (SMALLEST + float(outer.max() - outer.mean()))
    gap = checks.between("gap", gap, least, LARGEST, unit="m", hint="did you mean 250e-9? It is that at half height")
    straight = checks.between("straight", straight, 0, 1e-2, unit="m", hint="did you mean 3e-6?")
    bend = checks.positive("radius of the bends", mode.radius if radius is None else radius, unit="m")
    foot = float(outer.max()) * UM
    middle = float(outer.mean()) * UM + gap * UM / 2
    room = light.surroundings.reaches(mode.n_eff, TAIL)
    low, _, bottom, top = light.box(room[0], 0.0, room[2], room[3])
    left = max(low, light.centre - foot / UM - room[0])
    window = drawn(light.geometry, (left, light.centre + middle / UM, bottom, top), light.centre, SIZES)
    beyond = np.clip((window.mesh.p[0] - foot) / (middle - foot), 0, 1)
    found = supermodes(mode, gap, straight, bend, window, beyond)
    if found.phase > math.pi / 4:
        raise checks.InputError(
            f"gap = {gap * 1e9:g} nm couples {found.power:.2f} of the power in one pass (phase {found.phase:.2f}); "
            f"above {MOST} a ring is no resonator of slow rates",
            "take a wider gap or a shorter straight section",
        )
    return found


def of_buses(mode: Mode, buses: Sequence[Bus]) -> list[Coupling]:
    """The couplings of [[bus]] tables; InputError where one has another width than the ring."""
    inner, outer = mode.light.walls
    width = outer - inner
    found = {}
    for bus in buses:
        if bus.width is not None and not math.isclose(bus.width, width, rel_tol=1e-6):
            raise checks.InputError(
                f"bus {bus.name!r} is {bus.width * 1e9:g} nm wide and the ring {width * 1e9:g} nm; couplers of unlike "
                "guides are not computed",
                "give coupling, the power that the bus takes in one pass",
            )
        if (bus.gap, bus.straight) not in found:
            bend = mode.radius - bus.straight / math.pi
            found[bus.gap, bus.straight] = coupling(mode, bus.gap, bus.straight, radius=bend)
    return [found[bus.gap, bus.straight] for bus in buses]


def supermodes(mode: Mode, gap: float, straight: float, bend: float, window: Window, beyond: Array) -> Coupling:
    """Solve the supermodes at the gaps of `WIDER`, on a window that ``beyond`` stretches outside the ring's wall."""

    def supermode(wider: float, electric: bool) -> Mode:
        x, y = window.mesh.p
        grid = replace(window.mesh, doflocs=np.stack([x + beyond * wider / 2, y]))
        end = float(grid.p[0].max())
        held = (lambda x: np.abs(x[0] - end) < 1e-6) if electric else None
        own = replace(mode, window=replace(window, mesh=grid), space=Space(grid, 2, wall=held))
        return own.solved(1)[0]

    pairs = [sorted((supermode(wider, wall) for wall in (True, False)), key=lambda m: -m.n_eff) for wider in WIDER]
    return Coupling(mode, gap, straight, bend, window, beyond, tuple((even, odd) for even, odd in pairs))


def _phase(*, splits: Array, n_eff: Any, wavelength: Any, straight: Any, bend: Any) -> Any:
    """Phase of the power exchange in one pass, for real or complex arguments.

    splits: n_s - n_a at the gaps of `WIDER`; beyond the widest ln(n_s - n_a) continues along its tangent.
    """
    logs = np.polynomial.Polynomial(np.linalg.solve(np.vander(WIDER, increasing=True), np.log(splits)))
    k, last = math.pi / (wavelength * UM), WIDER[-1]
    tangent = logs.deriv()(last)
    on_line = k * splits[0] * straight * UM
    if math.isinf(bend.real):
        return on_line
    R = bend * UM
    z = np.linspace(0, 1, POINTS) * min(0.7 * R, 4 * R**0.5, key=lambda end: end.real)
    wider = R - np.sqrt(R**2 - z**2)
    inside = np.where(wider.real < last, wider, last)
    rate = k * np.exp(logs(inside) + (wider - inside) * (tangent if tangent.real < 0 else 0.0))
    slip = 2 * k * n_eff * (R * np.arcsin(z / R) - z)
    return on_line + 2 * np.trapezoid(rate * np.cos(slip), z)
