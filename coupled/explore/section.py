"""The cross-section as the page draws it: outlines, and a few modes of the field on a grid of pixels, 8 bit each."""

import base64
from typing import Any

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.linalg import eigh

from thermofem.arrays import Array, NDArray
from thermofem.fem import HeatProblem
from thermofem.materials.material_library import VOID
from thermofem.models import Foster

from .contents import Parts

WIDTH, HEIGHT = 132, 88  # pixels
SPAN = 6e-6  # m, of the picture, unless the parts are wider
MODES = 14  # at most


def section_of(heat: HeatProblem, reduction: Any, parts: Parts) -> dict[str, Any]:
    """Return outlines and modes: T(r, z, t) = sum_i x_i(t) mode_i + sum_h P_h rest_h, dx_i/dt = (R_i P - x_i)/tau_i.

    reduction [surrogate.reduction.reduce.Reduction]: its basis holds one field for each state.
    parts: what the light heats and what is read; every other input is a heater, of which the field at rest is kept.
    """
    R, tau, modes, heaters = _fields(reduction, parts)
    kept = np.sort(np.argsort(-R)[:MODES])
    r, z = _window(heat)
    at_r, at_z = (edges[0] + (np.arange(n) + 0.5) / n * (edges[1] - edges[0]) for edges, n in ((r, WIDTH), (z, HEIGHT)))
    fields = heat.field(np.concatenate([modes[kept], *heaters.values()]))
    grid = np.stack(np.meshgrid(at_r, at_z), axis=-1)
    shown = LinearNDInterpolator(heat.mesh.points, fields.T, fill_value=0.0)(grid) * _within(heat, grid)[..., None]
    images = [_packed(image) for image in np.moveaxis(shown, -1, 0)]
    return {
        "width": WIDTH,
        "height": HEIGHT,
        "r": r,
        "z": z,
        "outlines": _outlines(heat),
        "R": R[kept].tolist(),
        "tau": tau[kept].tolist(),
        "modes": images[: kept.size],
        "heaters": dict(zip(heaters, images[kept.size :], strict=True)),
    }


def _fields(reduction: Any, parts: Parts) -> tuple[Array, Array, Array, dict[str, Array]]:
    """R, tau and states of the poles, with the mean 1 where read, and states of the heaters at rest under 1 W."""
    model, basis = reduction.model, np.asarray(reduction.basis)
    if isinstance(model, Foster):
        return np.asarray(model.R), np.asarray(model.tau), basis.T, {}
    light = parts.heated or model.inputs[0]
    read = model.C[model.outputs.index(parts.read or light)]
    rate, modes = eigh(-model.A, model.E)
    seen = read @ modes
    R = seen * (model.B[:, model.inputs.index(light)] @ modes) / rate
    heaters = {
        name: (basis @ np.linalg.solve(-model.A, model.B[:, k]))[None]
        for k, name in enumerate(model.inputs)
        if name != light
    }
    return R, 1 / rate, (basis @ (modes / np.where(seen == 0, np.inf, seen))).T, heaters


def _packed(image: Array) -> dict[str, Any]:
    """An image as numbers of 8 bits in base64, and what 1 stands for."""
    scale = max(float(np.abs(image).max()), 1e-30) / 127
    return {"scale": scale, "values": base64.b64encode(np.rint(image / scale).astype(np.int8).tobytes()).decode()}


def _window(heat: HeatProblem) -> tuple[tuple[float, float], tuple[float, float]]:
    """The part of the cross-section that is drawn: around the heated parts, within the domain."""
    geometry = heat.geometry
    parts = [part for part in geometry.parts if part.name in geometry.heated]
    inner, outer = min(part.inner_radius for part in parts), max(part.outer_radius for part in parts)
    low, top = min(part.bottom for part in parts), max(part.top for part in parts)
    middle_r, middle_z = (inner + outer) / 2, (low + top) / 2
    span = max(SPAN, 1.6 * (outer - inner), 1.6 * (top - low) * WIDTH / HEIGHT)
    left = max(min(middle_r - span / 2, geometry.outer_radius - span), 0.0)
    high = span * HEIGHT / WIDTH
    ceiling = max(geometry.top_z, top)  # a heater may stand on top of all layers
    bottom = max(min(middle_z - high / 2, ceiling - high), geometry.bottom_z)
    return (left, min(left + span, geometry.outer_radius)), (bottom, min(bottom + high, ceiling))


def _within(heat: HeatProblem, grid: Array) -> NDArray[np.bool_]:
    """Whether points lie in a material: in the layers or in a part that stands on them, not in a void or in the air."""
    r, z = grid[..., 0], grid[..., 1]
    solid = z <= heat.geometry.top_z
    for part in heat.geometry.parts:  # a later part overwrites an earlier one
        covered = (part.inner_radius <= r) & (r <= part.outer_radius) & (part.bottom <= z) & (z <= part.top)
        solid = np.where(covered, part.material != VOID, solid)
    return solid


def _outlines(heat: HeatProblem) -> list[list[list[float]]]:
    """The outlines of all regions, in m."""
    return [[[float(r), float(z)] for r, z in ring] for face in heat.geometry.subdivision.faces for ring in face.rings]
