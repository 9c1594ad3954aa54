"""Loss of a mode by radiation: of a bend, and into a substrate, with perfectly matched layers in straight windows.

    Q = w n_g/(c alpha),    alpha = 2 Im beta

The cladding is taken to go on beyond the stack and the substrate. The window's sides are straight and triangles at most
half of the wavelength in the cladding: jagged sides and coarse layers change Q by tens of percent.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array
from .space import Space, eigenpairs
from .window import UM, Box, drawn, energy_index, material_of

if TYPE_CHECKING:
    from .mode import Mode
    from .modes import Light

DEPTH = 1.5e-6  # m, of the layers where there is room
ASIDE = 1.2e-6  # m, at least, between the core and the layers
LARGEST_Q = 1e11  # round-off of Im beta is about 1e-13 of beta
SIZES = 1e-3  # accuracy whose mesh sizes hold at the core
HELD = 0.3  # of the transverse energy in the core
DECIBEL = 20 / math.log(10)  # per neper of the field


def radiation_q(mode: Mode) -> float:
    """Quality factor by the bend's radiation; inf for a straight guide and above `LARGEST_Q`."""
    if math.isinf(mode.radius):
        return math.inf
    light: Light = mode.light  # type: ignore[assignment]
    aside = max(ASIDE, light.reach(mode.n_eff, 1e-7))
    outer = max(2e-6, 0.15 * mode.radius + ASIDE)
    low, high = light.outline[:, 1].min() - aside - DEPTH, light.outline[:, 1].max() + aside + DEPTH
    covered = light.geometry.top_z > light.outline[:, 1].max()  # else air begins there
    box = light.box(aside, outer + DEPTH, aside + DEPTH, aside + DEPTH)
    inside = (*box[:3], min(box[3], light.geometry.top_z) if covered else box[3])
    damping = _beta(mode, inside, (0.0, DEPTH, DEPTH, DEPTH), mode.radius, (low, high)).imag
    q = mode.k0 * mode.n_g / (2 * damping) if damping > 0 else math.inf
    return q if q < LARGEST_Q else math.inf


def substrate_loss(mode: Mode) -> float:
    """Power loss in dB/cm of the straight guide into what guides by itself below it; 0 without such a layer."""
    light: Light = mode.light  # type: ignore[assignment]
    away = [far for name, far in light.limits[1].items() if material_of(light.geometry, name).index is not None]
    if not away:
        return 0.0
    aside = max(ASIDE, light.reach(mode.n_eff, 1e-7))
    left, right, _, top = light.box(aside + DEPTH, aside + DEPTH, 0.0, aside)
    bottom = light.outline[:, 1].min() - min(away) - DEPTH - 0.5e-6
    beta = _beta(mode, (left, right, bottom, top), (DEPTH, DEPTH, DEPTH, 0.0), math.inf, (bottom, top))
    return DECIBEL * beta.imag * 1e4


def _beta(mode: Mode, box: Box, depths: tuple[float, ...], radius: float, beyond: tuple[float, float]) -> complex:
    """beta in 1/um of the mode in a window with matched layers of these depths in m."""
    light: Light = mode.light  # type: ignore[assignment]
    substrate = light.limits[0][2]

    def largest(_: float, z: float) -> float:
        return mode.wavelength / (2 * (light.core_index if z < substrate else light.cladding_index))

    window = drawn(light.geometry, box, light.centre, SIZES, largest, beyond)
    space = Space(window.mesh, 3, radius * UM, tuple(depth * UM for depth in depths))
    eps = energy_index(window.materials, window.names, mode.wavelength)[0][window.region]

    def share(x: Array) -> float:
        e = space.functions[0]
        field = np.einsum("it,ictq->ctq", x[space.dofs].T[: len(e)], e)
        energy = (np.abs(field) ** 2).sum(axis=0) * space.dx * eps[:, None]
        return float(energy[window.inside(light.part)].sum() / energy.sum())

    pairs = eigenpairs(space, eps, mode.k0, mode.n_eff, 1)
    if share(pairs[0][1]) < HELD:  # a mode of the cladding or the layers
        pairs = eigenpairs(space, eps, mode.k0, mode.n_eff, 6)
    return complex(np.sqrt(max(pairs, key=lambda pair: share(pair[1]))[0]))
