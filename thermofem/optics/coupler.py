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
from ..geometry.parameter_paths import Change, change
from .shape import Variation, index_slope, variations
from .space import Space, eigenpairs
from .window import UM, Window, drawn

if TYPE_CHECKING:
    from ..geometry import Bus
    from .mode import Mode
    from .modes import Light

WIDER = (0.0, 0.1, 0.25)  # um, added to the gap: where the supermodes are solved
TRUSTED = 0.2  # relative error of kappa^2
SMALLEST, LARGEST = 2e-8, 3e-6  # m, of a gap
STEP = 1e-5  # largest relative change in the differences of the integral along the bend
SIZES = 2e-3  # accuracy whose heat mesh sizes hold here
POINTS = 801  # of the integral along the bend
MOST = 0.5  # of kappa^2: beyond it the rate equations do not hold


@dataclass(frozen=True, eq=False)
class Coupling:
    """Power coupling of one bus.

    gap [m]: between the walls at half height.
    straight, bend [m]: length of the straight section, radius of the bends.
    window: of one half, to the middle of the gap.
    beyond [shape (vertices,)]: of the window's, 0 up to the foot of the outer wall and 1 in the middle of the gap.
    supermodes: even and odd one at every gap of `WIDER`.
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
        """What the phase is made of."""
        splits = np.array([even.n_eff - odd.n_eff for even, odd in self.supermodes])
        own = {"gap": self.gap, "straight": self.straight, "bend": self.bend}
        return {"splits": splits, "n_eff": self.mode.n_eff, "wavelength": self.mode.wavelength, **own}

    @property
    def split(self) -> float:
        """n_s - n_a at the gap."""
        return float(self._at["splits"][0])

    @cached_property
    def phase(self) -> float:
        """Phase of the power exchange in one pass."""
        return _phase(**self._at)

    @property
    def power(self) -> float:
        """kappa^2."""
        return math.sin(self.phase) ** 2

    @cached_property
    def by_gap(self) -> float:
        """d ln(kappa^2)/d(gap) in 1/m, the guides as they are."""
        return self._slope(_still(self.window), gap=1.0) / self.power

    @cached_property
    def by_width(self) -> float:
        """d ln(kappa^2)/d(width) in 1/m, the gap kept."""
        light: Light = self.mode.light  # type: ignore[assignment]
        part = next(part for part in light.geometry.parts if part.name == light.part)
        key = "width" if part.inner_radius else "outer_radius"
        (one,) = variations(self.mode, [change(light.geometry, f"part.{light.part}.{key}")])
        return self.derivative(one, index_slope(self.mode, one, one.on(light, self.mode.window))) / self.power

    def derivative(self, one: Variation, n_eff: float, bus: str = "") -> float:
        """d(kappa^2) per unit of a parameter of the section, by which the mode's index changes by ``n_eff``.

        bus: name of the [[bus]], whose gap and straight section the parameter may be.
        """
        own = one.change.optical.get(bus, {})
        moved = one.on(self.mode.light, self.window)  # type: ignore[arg-type]
        corners = one.change.outlines.get(self.mode.core)
        wall = 0.0 if corners is None else float(corners[1:3, 0].mean()) - one.centre
        moved[0] += (wall - moved[0]) * self.beyond  # the middle of the gap follows the wall
        straight = own.get("straight", 0.0)
        return self._slope(one, moved, n_eff=n_eff, gap=own.get("gap", 0.0), straight=straight)

    def _slope(
        self, one: Variation, moved: Array | float = 0.0, *, n_eff: float = 0.0, gap: float = 0.0, straight: float = 0.0
    ) -> float:
        """d(kappa^2) where the window's vertices move and the lengths of the bus change."""
        velocity = np.zeros_like(self.window.mesh.p) + moved
        velocity[0] += gap / 2 * self.beyond
        of_guides = replace(one, centre=0.0)  # the supermodes are those of straight guides
        of_pairs = ([index_slope(m, of_guides, velocity) for m in pair] for pair in self.supermodes)
        bend = one.centre - straight / math.pi
        slopes: dict[str, Any] = {
            "splits": np.array([even - odd for even, odd in of_pairs]),
            "n_eff": n_eff,
            "wavelength": one.wavelength,
        }
        slopes |= {"gap": gap, "straight": straight, "bend": bend}
        largest = max(float(np.max(np.abs(slopes[name]) / (np.abs(at) + 1e-9))) for name, at in self._at.items())
        if not largest:
            return 0.0
        h = STEP / largest
        ahead, behind = (_phase(**{k: at + sign * h * slopes[k] for k, at in self._at.items()}) for sign in (1, -1))
        return math.sin(2 * self.phase) * (ahead - behind) / (2 * h)


def coupling(mode: Mode, gap: float, straight: float = 0.0, *, radius: float | None = None) -> Coupling:
    """kappa^2 of a bus at a gap, over a straight section between two bends of ``radius``, the mode's by default; in m.

    Raises InputError: a gap that is not positive or in another unit; kappa^2 above `MOST`.
    """
    gap = checks.between("gap", gap, SMALLEST, LARGEST, unit="m", hint="did you mean 250e-9?")
    straight = checks.between("straight", straight, 0, 1e-2, unit="m", hint="did you mean 3e-6?")
    bend = checks.positive("radius of the bends", mode.radius if radius is None else radius, unit="m")
    light: Light = mode.light  # type: ignore[assignment]
    foot, wall = _walls(mode)
    middle = wall + gap * UM / 2
    if middle - foot < SMALLEST * UM:
        raise checks.InputError(f"gap = {gap * 1e9:g} nm at half height is closed at the foot of the sidewalls")
    room = light.reach(mode.n_eff, 1e-7)
    low, _, bottom, top = light.box(room, 0.0, room, room)
    left = max(low, light.centre - foot / UM - room)
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
    light: Light = mode.light  # type: ignore[assignment]
    (part,) = (one for one in light.geometry.parts if one.name == mode.core)
    width, found = part.outer_radius - part.inner_radius, {}
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
    """Solve the supermodes at the gaps of `WIDER` on a window that is stretched beyond the ring's wall."""

    def supermode(wider: float, electric: bool) -> Mode:
        x, y = window.mesh.p
        grid = replace(window.mesh, doflocs=np.stack([x + beyond * wider / 2, y]))
        end = float(grid.p[0].max())
        held = (lambda x: np.abs(x[0] - end) < 1e-6) if electric else None
        space, own = Space(grid, 2, wall=held), replace(window, mesh=grid)
        found = replace(mode, window=own, space=space, radius=math.inf)
        square, x = eigenpairs(space, found._indices[0], mode.k0, mode.n_eff, 1)[0]
        return replace(found, square=square.real, x=x)

    pairs = [sorted((supermode(wider, wall) for wall in (True, False)), key=lambda m: -m.n_eff) for wider in WIDER]
    return Coupling(mode, gap, straight, bend, window, beyond, tuple((even, odd) for even, odd in pairs))


def _walls(mode: Mode) -> tuple[float, float]:
    """x of the outer wall's foot and of its half height in um."""
    light: Light = mode.light  # type: ignore[assignment]
    outer = light.outline[1:3, 0] - light.centre
    return float(outer.max()) * UM, float(outer.mean()) * UM


def _still(window: Window) -> Variation:
    """Nothing of the section changes."""
    return Variation(Change("", 0.0, "m"), np.zeros_like(window.mesh.p))


def _phase(*, splits: Array, n_eff: float, wavelength: float, gap: float, straight: float, bend: float) -> float:
    """Phase of the power exchange; ln(n_s - n_a) goes on along its tangent beyond the widest gap."""
    gaps = gap * UM + np.array(WIDER)
    logs = np.polynomial.Polynomial.fit(gaps, np.log(splits), len(gaps) - 1)
    k, last = math.pi / (wavelength * UM), float(gaps[-1])

    def rate(g: Array) -> Array:
        inside = np.minimum(g, last)
        return k * np.exp(logs(inside) + (g - inside) * min(logs.deriv()(last), 0.0))

    on_line = float(rate(gaps[:1])[0]) * straight * UM
    if math.isinf(bend):
        return on_line
    R = bend * UM
    z = np.linspace(0, min(0.7 * R, 4 * math.sqrt(R)), POINTS)
    slip = 2 * k * n_eff * (R * np.arcsin(z / R) - z)
    along = rate(gap * UM + R - np.sqrt(R**2 - z**2)) * np.cos(slip)
    return on_line + 2 * float(np.trapezoid(along, z))
