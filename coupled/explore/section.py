"""The cross-section on the page: outlines of the regions, and the leading thermal modes as images of 8 bits."""

import base64
from typing import Any

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.linalg import eigh

from thermofem.arrays import Array, NDArray
from thermofem.fem import HeatProblem
from thermofem.geometry.section_parts import AMBIENT
from thermofem.materials.material_library import VOID
from thermofem.models import Foster
from thermofem.ring_temperature import detuning_output

from .contents import Parts

WIDTH, HEIGHT = 132, 88  # pixels
SPAN = 6e-6  # m, of the picture, unless the parts are wider
MODES = 14  # at most


def section_of(heat: HeatProblem, reduction: Any, parts: Parts) -> dict[str, Any]:
    """Return outlines and thermal modes of the cross-section; the page computes the temperature field from them.

        T(r, z, t) = sum_i x_i(t) mode_i + sum_h P_h rest_h,     dx_i/dt = (R_i P - x_i)/tau_i

    reduction [surrogate.reduction.reduce.Reduction]: its basis holds one field for each state.
    parts: input of the light and output; every other input h is a heater with the steady field rest_h at 1 W.
    """
    R, tau, modes, heaters = _fields(reduction, parts)
    kept = np.sort(np.argsort(-R)[:MODES])
    r, z = _window(heat)
    at_r = r[0] + (np.arange(WIDTH) + 0.5) / WIDTH * (r[1] - r[0])
    at_z = z[0] + (np.arange(HEIGHT) + 0.5) / HEIGHT * (z[1] - z[0])
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
    """Return R (K/W) and tau (s) of the K poles, their fields on n unknowns, and steady fields of the heaters at 1 W.

    Shapes (K,), (K,), (K, n), and (1, n) for each heater; the field of a pole is scaled to 1 at the read output.
    """
    model, basis = reduction.model, np.asarray(reduction.basis)
    if isinstance(model, Foster):
        return np.asarray(model.R), np.asarray(model.tau), basis.T, {}
    light = parts.heated or model.inputs[0]
    output = parts.read or detuning_output(parts.wanted, light, tuple(model.outputs))
    read = model.C[model.outputs.index(output)]
    rate, modes = eigh(-model.A, model.E)
    seen = read @ modes
    R = seen * (model.B[:, model.inputs.index(light)] @ modes) / rate
    heaters = {
        name: (basis @ np.linalg.solve(-model.A, model.B[:, k]))[None]
        for k, name in enumerate(model.inputs)
        if name not in (light, AMBIENT)
    }
    return R, 1 / rate, (basis @ (modes / np.where(seen == 0, np.inf, seen))).T, heaters


def _packed(image: Array) -> dict[str, Any]:
    """Return an image as integers of 8 bits in base64, and the value ``scale`` of one unit."""
    scale = max(float(np.abs(image).max()), 1e-30) / 127
    return {"scale": scale, "values": base64.b64encode(np.rint(image / scale).astype(np.int8).tobytes()).decode()}


def _window(heat: HeatProblem) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the drawn rectangle in m, (r_min, r_max), (z_min, z_max): around the heated parts, within the domain."""
    geometry = heat.geometry
    parts = [part for part in geometry.parts if part.name in geometry.heated]
    inner = min(part.inner_radius for part in parts)
    outer = max(part.outer_radius for part in parts)
    low = min(part.bottom for part in parts)
    top = max(part.top for part in parts)
    middle_r = (inner + outer) / 2
    middle_z = (low + top) / 2
    span = max(SPAN, 1.6 * (outer - inner), 1.6 * (top - low) * WIDTH / HEIGHT)
    left = max(min(middle_r - span / 2, geometry.outer_radius - span), 0.0)
    high = span * HEIGHT / WIDTH
    ceiling = max(geometry.top_z, top)  # a heater may stand on top of all layers
    bottom = max(min(middle_z - high / 2, ceiling - high), geometry.bottom_z)
    return (left, min(left + span, geometry.outer_radius)), (bottom, min(bottom + high, ceiling))


def _within(heat: HeatProblem, grid: Array) -> NDArray[np.bool_]:
    """Return whether each point (r, z) of ``grid``, shape (..., 2), lies in a material, not in a void or the air."""
    r, z = grid[..., 0], grid[..., 1]
    solid = z <= heat.geometry.top_z
    for part in heat.geometry.parts:  # a later part overwrites an earlier one
        covered = (part.inner_radius <= r) & (r <= part.outer_radius) & (part.bottom <= z) & (z <= part.top)
        solid = np.where(covered, part.material != VOID, solid)
    return solid


def _outlines(heat: HeatProblem) -> list[list[list[float]]]:
    """Return the boundary curves of all regions, each a list of points [r, z] in m."""
    return [[[float(r), float(z)] for r, z in ring] for face in heat.geometry.subdivision.faces for ring in face.rings]
