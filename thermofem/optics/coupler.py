"""Power that a bus takes from a ring in one pass, from the supermodes of the two guides along the bend.

    k(z) = (pi/lambda) (n_s - n_a)(g(z)),     g(z) = gap + R - (R^2 - z^2)^(1/2)
    kappa^2 = sin^2 [ k(gap) L + 2 int_0 k(z) cos(beta (R asin(z/R) - z)) dz ],     L the straight section

The bus is the mirror image of the ring's guide. Its supermodes are those of one half with an electric (even E_r) or a
magnetic wall in the middle of the gap; ln(n_s - n_a) over the gap is a parabola through three gaps. Trusted to 20 %:
measured 0.063(3), computed 0.0523 for the racetrack of Borghi et al. 2021, whose gap and width are known to some nm.
Not for bends below 3 um, gaps below 100 nm and guides of different width.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from ..arrays import Array
from .space import Space, eigenpairs
from .window import UM, drawn, energy_index

if TYPE_CHECKING:
    from .modes import Light, Mode

WIDER = (0.0, 0.1, 0.25)  # um, added to the gap: where the supermodes are solved
TRUSTED = 0.2  # relative error of kappa^2
SMALLEST, LARGEST = 2e-8, 3e-6  # m, of a gap
STEP = 1e-3  # um, of the difference by the width
SIZES = 2e-3  # accuracy whose heat mesh sizes hold here
POINTS = 801  # of the integral along the bend
MOST = 0.5  # of kappa^2: beyond it the rate equations do not hold


@dataclass(frozen=True)
class Coupling:
    """Power coupling of one bus.

    power: kappa^2.
    by_gap, by_width [1/m]: its relative change per gap (the guides as they are), and per width with the gap kept.
    split: n_s - n_a at the gap.
    """

    power: float
    by_gap: float
    by_width: float
    split: float


def coupling(mode: Mode, gap: float, straight: float = 0.0, *, radius: float | None = None) -> Coupling:
    """kappa^2 of a bus at a gap, over a straight section between two bends of ``radius``, the mode's by default; in m.

    Raises InputError: a gap that is not positive or in another unit; kappa^2 above `MOST`.
    """
    gap = checks.between("gap", gap, SMALLEST, LARGEST, unit="m", hint="did you mean 250e-9?")
    straight = checks.between("straight", straight, 0, 1e-2, unit="m", hint="did you mean 3e-6?")
    bend = checks.positive("radius of the bends", mode.radius if radius is None else radius, unit="m")
    light: Light = mode.light  # type: ignore[assignment]
    room = light.reach(mode.n_eff, 1e-7)
    low, _, bottom, top = light.box(room, 0.0, room, room)
    edge = float(light.outline[:, 0].max())
    left = max(low, 2 * light.centre - edge - room)
    window = drawn(light.geometry, (left, edge + gap / 2, bottom, top), light.centre, SIZES)
    half = (edge - light.centre) * UM
    gaps, widths = gap * UM + np.array(WIDER), half + np.array([-STEP, STEP]) / 2

    def split(grid: Any) -> float:
        eps = energy_index(window.materials, window.names, mode.wavelength)[0][window.region]
        end = float(grid.p[0].max())
        walls = (lambda x: np.abs(x[0] - end) < 1e-9, None)
        n = [_largest(Space(grid, 2, wall=wall), eps, mode) for wall in walls]
        return abs(n[0] - n[1])

    def moved(own: float, wide: float) -> Any:
        """The grid with the outer wall of the core at ``own`` and the middle of the gap ``wide``/2 beyond (um)."""
        x, y = window.mesh.p
        beyond = half + (x - half) * (wide / (gap * UM))
        stretched = np.where(x > half, beyond + own - half, np.where(np.abs(x) <= half, x * own / half, x + half - own))
        return replace(window.mesh, doflocs=np.stack([stretched, y]))

    splits = np.array([split(moved(half, g)) for g in gaps])
    wider = [split(moved(w, gap * UM)) for w in widths]
    logs = np.polynomial.Polynomial.fit(gaps, np.log(splits), len(gaps) - 1)
    by_width = float(np.log(wider[1] / wider[0]) / (2 * STEP))
    phase = _phase(mode, gap, straight, bend, logs)
    power = math.sin(phase) ** 2
    if phase > math.pi / 4:
        raise checks.InputError(
            f"gap = {gap * 1e9:g} nm couples {power:.2f} of the power in one pass (phase {phase:.2f}); above {MOST} a "
            "ring is no resonator of slow rates",
            "take a wider gap or a shorter straight section",
        )
    nearer = _phase(mode, gap + 1e-10, straight, bend, logs)
    slope = 2 * phase / math.tan(phase)  # d ln sin^2(phase)/d ln(phase)
    return Coupling(power, slope * math.log(nearer / phase) / 1e-10, slope * by_width * UM, float(splits[0]))


def _largest(space: Space, eps: Array, mode: Mode) -> float:
    """n_eff of the supermode near a mode."""
    pairs = eigenpairs(space, eps, mode.k0, mode.n_eff, 1)
    return math.sqrt(pairs[0][0].real) / mode.k0


def _phase(mode: Mode, gap: float, straight: float, bend: float, logs: np.polynomial.Polynomial) -> float:
    """Phase of the power exchange; ln(n_s - n_a) goes on along its tangent beyond the widest gap."""
    last = gap * UM + WIDER[-1]
    k = math.pi / (mode.wavelength * UM)

    def rate(g: Array) -> Array:
        inside = np.minimum(g, last)
        return k * np.exp(logs(inside) + (g - inside) * min(logs.deriv()(last), 0.0))

    on_line = float(rate(np.array(gap * UM))) * straight * UM
    if math.isinf(bend):
        return on_line
    R = bend * UM
    z = np.linspace(0, min(0.7 * R, 4 * math.sqrt(R)), POINTS)
    slip = math.sqrt(mode.square) * (R * np.arcsin(z / R) - z)
    along = rate(gap * UM + R - np.sqrt(R**2 - z**2)) * np.cos(slip)
    return on_line + 2 * float(np.trapezoid(along, z))
