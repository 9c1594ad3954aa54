"""The cross-section on the page: outlines of the regions, and the leading thermal modes as images of 8 bits."""

import base64
from typing import Any

import numpy as np
from scipy.interpolate import LinearNDInterpolator
from scipy.linalg import eigh

from thermofem.arrays import Array, Mask
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
    order = np.argsort(-R)
    largest = np.sort(order[:MODES])
    r, z = _window(heat)
    columns, rows = np.meshgrid(_centres(r, WIDTH), _centres(z, HEIGHT))
    pixels = np.stack([columns, rows], axis=-1)
    states = np.concatenate([modes[largest], *heaters.values()])
    fields = heat.field(states)
    interpolated = LinearNDInterpolator(heat.mesh.points, fields.T, fill_value=0.0)
    pictures = interpolated(pixels) * _within(heat, pixels)[..., None]
    images = [_packed(image) for image in np.moveaxis(pictures, -1, 0)]
    of_modes = images[: largest.size]
    of_heaters = images[largest.size :]
    return {
        "width": WIDTH,
        "height": HEIGHT,
        "r": r,
        "z": z,
        "outlines": _outlines(heat),
        "R": R[largest].tolist(),
        "tau": tau[largest].tolist(),
        "modes": of_modes,
        "heaters": dict(zip(heaters, of_heaters, strict=True)),
    }


def _centres(window: tuple[float, float], pixels: int) -> Array:
    """Return the centres of the pixels between the two ends of a window, in m."""
    low, high = window
    return low + (np.arange(pixels) + 0.5) / pixels * (high - low)


def _fields(reduction: Any, parts: Parts) -> tuple[Array, Array, Array, dict[str, Array]]:
    """Return R (K/W) and tau (s) of the K poles, their fields on n unknowns, and steady fields of the heaters at 1 W.

    Shapes (K,), (K,), (K, n), and (1, n) for each heater; the field of a pole is scaled to 1 at the read output.
    """
    model = reduction.model
    basis = np.asarray(reduction.basis)
    if isinstance(model, Foster):
        return np.asarray(model.R), np.asarray(model.tau), basis.T, {}
    light = parts.heated or model.inputs[0]
    output = parts.read or detuning_output(parts.wanted, light, tuple(model.outputs))
    read = model.C[model.outputs.index(output)]
    rate, modes = eigh(-model.A, model.E)
    outputs = read @ modes
    R = outputs * (model.B[:, model.inputs.index(light)] @ modes) / rate
    scaled = modes / np.where(outputs == 0, np.inf, outputs)
    heaters = {}
    for k, name in enumerate(model.inputs):
        if name not in (light, AMBIENT):
            states = np.linalg.solve(-model.A, model.B[:, k])
            heaters[name] = (basis @ states)[None]
    return R, 1 / rate, (basis @ scaled).T, heaters


def _packed(image: Array) -> dict[str, Any]:
    """Return an image as integers of 8 bits in base64, and the value ``scale`` of one unit."""
    scale = max(float(np.abs(image).max()), 1e-30) / 127
    pixels = np.rint(image / scale).astype(np.int8)
    return {"scale": scale, "values": base64.b64encode(pixels.tobytes()).decode()}


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
    right = min(left + span, geometry.outer_radius)
    return (left, right), (bottom, min(bottom + high, ceiling))


def _within(heat: HeatProblem, grid: Array) -> Mask:
    """Return whether each point (r, z) of ``grid``, shape (..., 2), lies in a material, not in a void or the air."""
    r = grid[..., 0]
    z = grid[..., 1]
    solid = z <= heat.geometry.top_z
    for part in heat.geometry.parts:  # a later part overwrites an earlier one
        across = (part.inner_radius <= r) & (r <= part.outer_radius)
        along = (part.bottom <= z) & (z <= part.top)
        solid = np.where(across & along, part.material != VOID, solid)
    return solid


def _outlines(heat: HeatProblem) -> list[list[list[float]]]:
    """Return the boundary curves of all regions, each a list of points [r, z] in m."""
    curves = [ring for face in heat.geometry.subdivision.faces for ring in face.rings]
    return [np.asarray(curve, dtype=float).tolist() for curve in curves]
