"""The cross-section as the page draws it: outlines, and a few modes of the field on a grid of pixels, 8 bit each."""

from __future__ import annotations

import base64
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from thermofem import HeatProblem

Array = NDArray[np.float64]

WIDTH, HEIGHT = 132, 88  # pixels
SPAN = 6e-6  # m, of the picture, unless the parts are wider
MODES = 14  # at most; the others are left out and what they hold is said by `weight_left`
SMALL = 1e-4  # share of R_th below which a mode is not drawn


def section_of(heat: HeatProblem, reduction: Any) -> dict[str, Any]:
    """Return outlines and modes: T(r, z, t) = sum_i x_i(t) mode_i(r, z), dx_i/dt = (R_i P - x_i)/tau_i.

    Parameters
    ----------
    heat : HeatProblem
    reduction : surrogate.Reduction
        of its first heated part; its basis holds one field for each pole.
    """
    R, tau = (np.asarray(getattr(reduction.model, name), dtype=float) for name in ("R", "tau"))
    kept = np.flatnonzero(SMALL * R.sum() < R)
    kept = np.sort(kept[np.argsort(-R[kept])][:MODES])
    r, z = _window(heat)
    fields = heat.field(np.asarray(reduction.basis).T[kept])
    at_r, at_z = (edges[0] + (np.arange(n) + 0.5) / n * (edges[1] - edges[0]) for edges, n in ((r, WIDTH), (z, HEIGHT)))
    grid = np.stack(np.meshgrid(at_r, at_z), axis=-1).reshape(-1, 2)
    modes = _on_grid(np.asarray(heat.mesh.points), fields, grid)
    scale = np.maximum(np.abs(modes).max(axis=1), 1e-30) / 127
    return {
        "width": WIDTH,
        "height": HEIGHT,
        "r": r,
        "z": z,
        "outlines": _outlines(heat),
        "R": R[kept].tolist(),
        "tau": tau[kept].tolist(),
        "scale": scale.tolist(),
        "modes": [
            base64.b64encode(np.rint(m / s).astype(np.int8).tobytes()).decode()
            for m, s in zip(modes, scale, strict=True)
        ],
    }


def _packed(values: Array) -> str:
    """Numbers between -127 and 127 as 8 bits each, in base64."""
    return base64.b64encode(np.rint(values).astype(np.int8).tobytes()).decode()


def _window(heat: HeatProblem) -> tuple[tuple[float, float], tuple[float, float]]:
    """The part of the cross-section that is drawn: around the first heated part, within the domain."""
    geometry = heat.geometry
    part = next(part for part in geometry.parts if part.name == geometry.heated[0])
    middle_r, middle_z = (part.inner_radius + part.outer_radius) / 2, (part.bottom + part.top) / 2
    span = max(SPAN, 1.6 * (part.outer_radius - part.inner_radius))
    left = max(min(middle_r - span / 2, geometry.outer_radius - span), 0.0)
    high = span * HEIGHT / WIDTH
    bottom = max(min(middle_z - high / 2, geometry.top_z - high), geometry.bottom_z)
    return (left, min(left + span, geometry.outer_radius)), (bottom, min(bottom + high, geometry.top_z))


def _on_grid(points: Array, fields: Array, grid: Array) -> Array:
    """Fields at the vertices, shape (modes, n), between them by a plane on each triangle; 0 outside."""
    from scipy.interpolate import LinearNDInterpolator

    unique, first = np.unique(points, axis=0, return_index=True)
    return np.nan_to_num(LinearNDInterpolator(unique * 1e6, fields[:, first].T)(grid * 1e6).T)


def _outlines(heat: HeatProblem) -> list[list[list[float]]]:
    """The outlines of all regions, in m."""
    return [[[float(r), float(z)] for r, z in ring] for face in heat.geometry.subdivision.faces for ring in face.rings]
