"""Derivatives of a mode with respect to the lengths of its cross-section, exact for the discrete problem.

The vertices move with the outlines as for the heat (`fem.shape_derivatives`), and the unknowns of e and p with them:

    d(beta^2) = -x.(dA + beta^2 dB) x / x.B x,       (A + beta^2 B) dx = -(dA + beta^2 dB + d(beta^2) B) x

dx, free of x itself, is solved once for each parameter. Everything else is a function of the vertices, x and beta^2,
without a solve: its derivative along (V, dx, d(beta^2)) is a central difference, with an error of `STEP` squared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from ..algebra.factor import factorize
from ..arrays import Array
from ..checks import InputError
from ..geometry.parameter_paths import Change, change
from .reading import containing
from .space import Space
from .window import UM

if TYPE_CHECKING:
    import xarray as xr

    from .modes import Light, Mode

STEP = 1e-4  # largest strain of the differences
ABOUT = {
    "n_eff": ("1", "effective index"),
    "n_g": ("1", "group index"),
    "thermo_optic": ("1/K", "relative shift of the resonance per kelvin"),
    "index_confinement": ("1", "dn_eff/dn of the core's material"),
    "volume_2": ("m^3", "volume of two-photon absorption"),
    "volume_3": ("m^3", "volume of the carriers"),
    "resonance_wavelength": ("m", "wavelength of the resonance"),
}


def mode_derivatives(mode: Mode, parameters: Sequence[str | Sequence[str]]) -> xr.Dataset:
    """Derivatives of a mode by paths as a campaign varies them, such as "part.core.width"; a tuple changes together.

    Returns
    -------
    xarray.Dataset
        over "parameter", per SI unit of it: n_eff, n_g, thermo_optic, index_confinement, volume_2, volume_3 and
        resonance_wavelength (of the ring, at the order that it has); value and unit of the parameter. Properties of the
        heat alone have zeros. Against differences on the same moved mesh: 1e-6 (measured).

    Raises
    ------
    InputError
        a path that leads nowhere, or a motion at which a face would appear or vanish.
    """
    import xarray as xr

    from ..fem.shape_derivatives import vertex_velocities

    light: Light = mode.light  # type: ignore[assignment]
    each = checks.instances("parameters", [parameters] if isinstance(parameters, str) else parameters, str, tuple, list)
    if not each:
        raise InputError("parameters is empty; name at least one path, e.g. 'part.core.width'")
    changes = [change(light.geometry, one) for one in each]
    roles = (*light.geometry.heated, light.part)
    velocities = vertex_velocities(light.geometry, light.mesh, changes, roles=roles)
    rows = [_row(mode, _on_window(mode, V), _of_centre(light, one)) for one, V in zip(changes, velocities, strict=True)]
    variables: dict[str, Any] = {
        name: (
            "parameter",
            [row[k] for row in rows],
            {"long_name": f"derivative of the {words}", "units": f"{unit} per unit"},
        )
        for k, (name, (unit, words)) in enumerate(ABOUT.items())
    }
    coords = {
        "parameter": [one.name for one in changes],
        "value": ("parameter", [one.value for one in changes]),
        "unit": ("parameter", [one.unit for one in changes]),
    }
    attrs = dict(zip(ABOUT, _numbers(mode), strict=False))
    return xr.Dataset(variables, coords=coords, attrs={"mode": mode.name, "wavelength": mode.wavelength, **attrs})


def _numbers(mode: Mode) -> Array:
    """What is differentiated, in the order of `ABOUT` and without the resonance."""
    G = mode.confinement[mode.core_material]
    return np.array([mode.n_eff, mode.n_g, mode.thermo_optic, G, mode.volume(2), mode.volume(3)])


def _on_window(mode: Mode, velocity: Array) -> Array:
    """Velocity of the window's vertices, shape (2, vertices); 0 in air, where the heat has no mesh."""
    light: Light = mode.light  # type: ignore[assignment]
    grid = light.mesh.skfem
    places = mode.space.mesh.p / UM + np.array([[light.centre], [0.0]])
    turned = light.geometry.mirrored & (places[0] < 0)
    places[0] = np.where(turned, -places[0], places[0])
    cells, found = containing(grid, places)
    local = grid.mapping().invF(places[:, :, None], tind=cells)[:, :, 0]
    shares = np.array([1 - local[0] - local[1], local[0], local[1]])
    moved = np.einsum("cn,ncx->xn", shares, velocity[grid.t[:, cells].T]) * found
    return np.stack([np.where(turned, -moved[0], moved[0]), moved[1]])


def _of_centre(light: Light, one: Change) -> float:
    """Velocity of r = R, from which the window counts."""
    corners = one.outlines.get(light.part)
    if corners is None:
        return 0.0
    at_edge = light.centre == light.outline[1:3, 0].mean()
    return float((corners[1:3] if at_edge else corners)[:, 0].mean())


def _row(mode: Mode, velocity: Array, centre: float) -> Array:
    """Derivatives by one parameter, in the order of `ABOUT`."""
    space = mode.space
    relative = velocity - np.array([[centre], [0.0]])
    corners, moved = space.mesh.p[:, space.mesh.t], relative[:, space.mesh.t]
    sides, strains = (np.linalg.norm(one - np.roll(one, 1, axis=1), axis=0) for one in (corners, moved))
    strain = max(float((strains * UM / sides).max()), abs(centre) / mode.radius)
    if not strain:
        return np.zeros(len(ABOUT))
    h = STEP / strain

    def at(sign: int) -> Space:
        mesh = replace(space.mesh, doflocs=space.mesh.doflocs + sign * h * UM * relative)
        return replace(space, mesh=mesh, radius=space.radius + sign * h * UM * centre)

    eps, (ahead, behind) = mode._indices[0], (at(1), at(-1))
    A, B = space.matrices(eps, mode.k0)
    pairs = [one.matrices(eps, mode.k0) for one in (ahead, behind)]
    pulls = [A_ @ mode.x + mode.square * (B_ @ mode.x) for A_, B_ in pairs]
    pull, flow = (pulls[0] - pulls[1]) / (2 * h), B @ mode.x
    slope = -float(mode.x @ pull) / float(mode.x @ flow)
    kept = np.delete(np.arange(space.size), np.argmax(np.abs(mode.x)))  # dx is free up to a multiple of x
    solve = factorize((A + mode.square * B)[kept][:, kept])
    dx = np.zeros(space.size)
    dx[kept] = solve(np.ascontiguousarray(-(pull + slope * flow)[kept]))
    ends = [
        replace(
            mode,
            space=one,
            window=replace(mode.window, mesh=one.mesh),
            radius=mode.radius + sign * h * centre,
            square=mode.square + sign * h * slope,
            x=mode.x + sign * h * dx,
        )
        for sign, one in ((1, ahead), (-1, behind))
    ]
    found = (_numbers(ends[0]) - _numbers(ends[1])) / (2 * h)
    found[0] = slope / (2 * mode.square) * mode.n_eff
    longer = 0.0 if np.isinf(mode.radius) else mode.n_eff * centre / mode.radius
    return np.append(found, mode.wavelength * (found[0] + longer) / mode.n_g)
