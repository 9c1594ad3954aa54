"""Damping of a mode by radiation, Im beta, of a bend and into a substrate: matched layers in straight windows.

The cladding is taken to go on beyond the stack and the substrate. The window's sides are straight and triangles at most
half of the wavelength in the cladding: jagged sides and coarse layers change Q by tens of percent.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from .mode_elements import Space
from .mode_window import UM, Box, drawn
from .surroundings import TAIL

if TYPE_CHECKING:
    from .mode import Mode

DEPTH = 1.5e-6  # m, of the matched layers where there is room
LEAST_DISTANCE = 1.2e-6  # m, at least, between the core and the layers
WIDEST = 12e-6  # m, at most, between the core and the layers at its sides
LEAKS = 1e-9  # of the power: where so much of the mode reaches a substrate its leak is computed


def bend_damping(mode: Mode) -> float:
    """Im beta in 1/um of a mode that its bend radiates to the outer side."""
    light = mode.light
    inner, _, below, above = _distances(mode)
    caustic = 2 * (mode.n_eff / light.surroundings.continuum - 1)  # twice as far as where the field radiates
    caustic = min(0.15, max(caustic, 0.0))
    outer = max(2e-6, caustic * mode.radius + LEAST_DISTANCE)
    _, _, foot, top = light.surroundings.bounds
    box = light.box(inner, outer + DEPTH, below + DEPTH, above + DEPTH)
    if light.geometry.top_z > top:  # else air begins there
        box = (*box[:3], min(box[3], light.geometry.top_z))
    ends = foot - below - DEPTH, top + above + DEPTH
    return _damping(mode, box, (0.0, DEPTH, DEPTH, DEPTH), mode.radius, ends)


def substrate_damping(mode: Mode) -> float:
    """Im beta in 1/um of the straight guide into `guiding_layers`, and into slabs at its sides where it is leaky."""
    light = mode.light
    left, right, below, above = _distances(mode)
    low, high = light.surroundings.far_span
    _, _, foot, top = light.surroundings.bounds
    if mode.leaky and low > light.geometry.bottom_z:
        below = max(below, foot - low)
    if mode.leaky:
        high = min(high, light.geometry.top_z + LEAST_DISTANCE)
        above = max(above, high - top)
    box = light.box(left + DEPTH, right + DEPTH, below, above)
    ends = [box[2], box[3]]
    depths = [DEPTH, DEPTH, 0.0, 0.0]
    for side, away in guiding_layers(mode).values():
        end = away + 0.5e-6 + DEPTH  # m: the matched layer begins so far inside the substrate
        if side == "bottom":
            ends[0] = foot - end
            depths[2] = DEPTH
        else:
            ends[1] = top + end
            depths[3] = DEPTH
    bottom = max(ends[0], light.geometry.bottom_z)
    roof = min(ends[1], light.geometry.top_z) if depths[3] else ends[1]
    drawn_box = (box[0], box[1], bottom, roof)
    radius = math.inf
    if light.at_edge:  # a disc has no straight guide; its rim radiates into the substrate alone here
        radius = mode.radius
        depths[:2] = [0.0, 0.0]
    return _damping(mode, drawn_box, tuple(depths), radius, (ends[0], ends[1]))


def guiding_layers(mode: Mode) -> dict[str, tuple[str, float]]:
    """Layers that guide by themselves within the reach of the mode: side and distance in m, by name."""
    around = mode.light.surroundings
    layers = {}
    for name, (side, away) in around.limits[1].items():
        if name in around.bulk and away < around.reach(side, mode.n_eff, LEAKS):
            layers[name] = (side, away)
    return layers


def _distances(mode: Mode) -> list[float]:
    """Distances in m from the core to the ends of a window or to its layers, at the left, right, bottom and top."""
    reaches = mode.light.surroundings.reaches(mode.n_eff, TAIL)
    return np.clip(reaches, LEAST_DISTANCE, [WIDEST, WIDEST, np.inf, np.inf]).tolist()


def _damping(mode: Mode, box: Box, depths: tuple[float, ...], radius: float, beyond: tuple[float, float]) -> float:
    """Im beta in 1/um of the mode in a window with matched layers of the given depths in m."""
    light = mode.light
    around = light.surroundings
    _, _, lowest, highest = around.limits[0]

    def largest(z: float) -> float:
        index = around.continuum if lowest <= z <= highest else around.core_index
        return mode.wavelength / (2 * index)

    window = drawn(light.geometry, box, light.centre, 1e-3, largest, beyond)
    space = Space(window.mesh, 3, radius * UM, tuple(depth * UM for depth in depths))
    absorbed = mode.nearest(space, window)
    return float(np.sqrt(absorbed.square).imag)
