"""Derivatives of a mode with respect to the numbers of its cross-section, exact for the discrete problem.

The vertices move with the outlines as for the heat (`fem.heat_derivatives`), and the unknowns of e and p with them:

    d(beta^2) = -x.(dA + beta^2 dB) x,    x.B x = 1,    (A + beta^2 B) dx = -(dA + beta^2 dB + d(beta^2) B) x

dx, free of x itself, is solved once for each parameter with one factorization. Everything else is a function of the
vertices, the indices, the wavelength, x and beta^2, without a solve: its derivative along their changes is a central
difference, with an error of 1e-8.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array
from ..geometry.parameter_paths import Change, changes_of
from ..geometry.section_parts import LIGHT
from ..materials.material_laws import constant_index, fixed_index
from ..materials.material_library import Material
from ..mesh.mesh_motion import vertex_velocities
from ..mesh.triangles import locate
from .mode_window import UM, Window

if TYPE_CHECKING:
    import xarray as xr

    from .mode import Mode
    from .modes import Light

log = logging.getLogger("thermofem")

ABOUT = {
    "n_eff": ("1", "effective index"),
    "n_g": ("1", "group index"),
    "thermo_optic": ("1/K", "relative shift of the resonance per kelvin"),
    "index_confinement": ("1", "dn_eff/dn of what guides"),
    "core_fraction_2": ("1", "share of two-photon absorption in the core"),
    "core_fraction_3": ("1", "share of the carriers in the core"),
    "volume_2": ("m^3", "volume of two-photon absorption"),
    "volume_3": ("m^3", "volume of the carriers"),
    "radius": ("m", "radius that n_eff belongs to"),
    "wavelength": ("m", "wavelength"),
    "index": ("1", "refractive index of the core"),
    "resonance_wavelength": ("m", "wavelength of the resonance"),
}


def numbers(mode: Mode, *, dispersion: bool = False, spread_carriers: bool = False) -> dict[str, float]:
    """Numbers of a ring from its mode, by the names in `ABOUT` but the resonance; rules as of `Mode.volume`."""
    same_names = ("n_eff", "n_g", "thermo_optic", "index_confinement", "radius", "wavelength", "index")
    values = {name: getattr(mode, name) for name in same_names}
    for power in (2, 3):
        values[f"core_fraction_{power}"] = mode.core_fraction(power, spread_carriers=spread_carriers)
        values[f"volume_{power}"] = mode.volume(power, dispersion=dispersion, spread_carriers=spread_carriers)
    return values


def mode_derivatives(mode: Mode, parameters: Sequence[str | Sequence[str]], **rules: bool) -> xr.Dataset:
    """Derivatives of a mode with respect to parameters given by paths, such as "part.core.width".

    Paths lead to lengths, constant indices and thermo_optic of materials, and "light.wavelength"; those of a tuple
    change together.

    Parameters
    ----------
    parameters : sequence of str or of tuples of str
    rules : bool
        ``dispersion`` and ``spread_carriers`` of the volumes, see `Mode.volume`.

    Returns
    -------
    xarray.Dataset
        over "parameter", per SI unit of it: n_eff, n_g, thermo_optic, index_confinement, core_fraction_2 and _3,
        volume_2 and _3, radius, wavelength, index of the core, and resonance_wavelength (of the ring, at the order that
        it has); value and unit of the parameter. Properties of the heat alone have zeros. Against differences on the
        same moved mesh: 1e-6 (measured).

    Raises
    ------
    InputError
        a path that leads nowhere, or a motion at which a face would appear or vanish.
    """
    if mode.hybrid:
        log.warning(
            "%s: %s is hybrid, %.0f %% TE: its name may go to the other mode along these parameters",
            mode.light.geometry.name, mode.name, 100 * mode.te_fraction,
        )  # fmt: skip
    each = variations(mode.light, parameters)
    rows = [slopes(mode, variation, **rules) for variation in each]
    derivatives = over_parameters(each, rows, ABOUT)
    return derivatives.assign_attrs(mode=mode.name, **numbers(mode, **rules))


@dataclass(frozen=True, eq=False)
class Variation:
    """Change of a mode's geometry and materials per unit of one parameter.

    heat [shape (2, vertices of the heat mesh)]: velocity of the vertices, m per unit.
    """

    light: Light
    change: Change
    heat: Array

    @property
    def wavelength(self) -> float:
        """Change of the wavelength in m per unit of the parameter."""
        return self.change.of_optics(LIGHT, "wavelength")

    @property
    def centre(self) -> float:
        """Velocity in m per unit of r = R, the origin of windows."""
        inner, outer = self.light.surroundings.outermost
        outer_wall = float(self.change.corners(outer.name)[1:3, 0].mean())
        if self.light.at_edge:
            return outer_wall
        inner_wall = float(self.change.corners(inner.name)[[0, 3], 0].mean())
        return (inner_wall + outer_wall) / 2

    def on(self, window: Window) -> Array:
        """Velocity of a window's vertices relative to its origin, m per unit, (2, vertices); air does not move."""
        grid = self.light.mesh.skfem
        r, z = window.mesh.p / UM
        r = r + self.light.centre
        turn = np.where(self.light.geometry.mirrored & (r < 0), -1.0, 1.0)
        cells, (x, y) = locate(grid, np.stack([turn * r, z], axis=1))
        weights = np.array([1 - x - y, x, y])
        corners = self.heat[:, grid.t[:, cells]]
        velocity = np.einsum("cn,xcn->xn", weights, corners) * (cells >= 0)
        return np.stack([turn * velocity[0] - self.centre, velocity[1]])

    def window(self, window: Window, velocity: Array, h: float) -> Window:
        """Window after a step ``h`` of the parameter."""

        def after(material: Material) -> Material:
            n = h * self.change.of_optics(material.name, "index")
            slope = h * self.change.of_optics(material.name, "thermo_optic")
            if n:
                before = fixed_index(material.index) or 1.0
                material = replace(material, index=constant_index(before + n))
            if slope:
                before = material.thermo_optic or 0.0
                material = replace(material, thermo_optic=before + slope)
            return material

        points = window.mesh.doflocs + h * UM * velocity
        mesh = replace(window.mesh, doflocs=points)
        materials = tuple(map(after, window.materials))
        return replace(window, mesh=mesh, materials=materials)

    def ends(self, mode: Mode, velocity: Array) -> tuple[float, tuple[Mode, Mode]]:
        """Step h of the parameter for central differences, and the mode's field x on the windows moved by +h and -h.

        Where nothing changes h is 1 and both are the mode itself.
        """
        mesh = mode.window.mesh
        sides = _sides(mesh.p[:, mesh.t])
        longer = _sides(velocity[:, mesh.t])
        strains = longer * UM / sides
        relative = [strains.max(), self.centre / mode.radius, self.wavelength / mode.wavelength]
        for (_, key), slope in self.change.optical.items():
            if key in ("index", "thermo_optic"):
                relative.append(slope)
        largest = float(np.abs(relative).max())
        if not largest:
            return 1.0, (mode, mode)

        def at(h: float) -> Mode:
            window = self.window(mode.window, velocity, h)
            radius = mode.space.radius + h * self.centre * UM
            space = replace(mode.space, mesh=window.mesh, radius=radius)
            wavelength = mode.wavelength + h * self.wavelength
            return replace(mode, wavelength=wavelength, window=window, space=space)

        h = 1e-4 / largest  # by which no strain, wavelength or index changes more than 1e-4
        return h, (at(h), at(-h))


def _sides(corners: Array) -> Array:
    """Lengths of the three sides of triangles, for corners of shape (2, 3, triangles)."""
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=0)


def variations(light: Light, parameters: Sequence[str | Sequence[str]]) -> list[Variation]:
    """Changes of a mode's geometry with parameters given by paths; the paths in a tuple change together."""
    return _variations(light, changes_of(light.geometry, parameters))


def _variations(light: Light, changes: Sequence[Change]) -> list[Variation]:
    roles = (*light.geometry.heated, light.part)
    velocities = vertex_velocities(light.geometry, light.mesh, changes, roles=roles)
    return [Variation(light, change, velocity.T) for change, velocity in zip(changes, velocities, strict=True)]


def _pull(mode: Mode, h: float, ends: tuple[Mode, Mode]) -> tuple[float, Array]:
    """d(beta^2) per unit of the parameter, and the vector (dA + beta^2 dB) x."""
    residuals = []
    for end in ends:
        A, B = end.matrices
        residuals.append(A @ mode.x + mode.square * (B @ mode.x))
    ahead, behind = residuals
    pull = (ahead - behind) / (2 * h)
    return -float(mode.x @ pull), pull


def index_slope(mode: Mode, variation: Variation, velocity: Array) -> float:
    """dn_eff per unit of a parameter, without a solve; ``velocity`` of the mode's window is that of `Variation.on`."""
    slope, _ = _pull(mode, *variation.ends(mode, velocity))
    relative = variation.wavelength / mode.wavelength + slope / (2 * mode.square)
    return relative * mode.n_eff


def varied(mode: Mode, variation: Variation) -> tuple[float, Mode, Mode]:
    """Step h of the parameter, and the mode at +h and -h to first order; the mode itself where nothing changes."""
    h, ends = variation.ends(mode, variation.on(mode.window))
    if mode in ends:
        return h, *ends
    slope, pull = _pull(mode, h, ends)
    _, B = mode.matrices
    dx = mode.bordered(-(pull + slope * (B @ mode.x)))

    def along(end: Mode, step: float) -> Mode:
        x = mode.x + step * dx
        _, B = end.matrices
        flow = x @ (B @ x)
        return replace(end, square=mode.square + step * slope, x=x / np.sqrt(flow))

    return h, along(ends[0], h), along(ends[1], -h)


def slopes(mode: Mode, variation: Variation, **rules: bool) -> dict[str, float]:
    """Derivatives of the `numbers` of a mode and of its resonance with respect to one parameter."""
    h, ahead, behind = varied(mode, variation)
    before = numbers(behind, **rules)
    after = numbers(ahead, **rules)
    row = {name: (value - before[name]) / (2 * h) for name, value in after.items()}
    stretch = 2 * math.pi * variation.centre / mode.light.geometry.path_length(mode.radius)
    longer = row["n_eff"] + mode.n_eff * stretch
    row["radius"] = variation.centre
    row["resonance_wavelength"] = 0.0 if variation.wavelength else mode.wavelength * longer / mode.n_g
    return row


def over_parameters(
    each: Sequence[Variation], rows: Sequence[Mapping[str, float]], about: Mapping[str, tuple[str, str]]
) -> xr.Dataset:
    """Dataset of derivatives over parameters: one mapping in ``rows`` for each; about: unit and description by name."""
    import xarray as xr

    variables = {}
    for name, (unit, words) in about.items():
        values = [row[name] for row in rows]
        attrs = {"long_name": f"derivative of the {words}", "units": f"{unit} per unit"}
        variables[name] = ("parameter", values, attrs)
    changes = [variation.change for variation in each]
    coords: dict[str, Any] = {
        "parameter": [change.name for change in changes],
        "value": ("parameter", [change.value for change in changes]),
        "unit": ("parameter", [change.unit for change in changes]),
    }
    return xr.Dataset(variables, coords=coords)


def light_slope(mode: Mode, basis: Any, one: Change) -> Array:
    """Derivative of the mode's mean-temperature functional on the heat unknowns, see `Mode.light_integral`."""
    (variation,) = _variations(mode.light, [one])
    h, ahead, behind = varied(mode, variation)
    if ahead is behind:
        return np.zeros(basis.N)
    means = []
    for step, end in ((h, ahead), (-h, behind)):
        points = basis.mesh.doflocs + step * variation.heat
        mesh = replace(basis.mesh, doflocs=points)
        integral = end.light_integral(basis, mesh, step * variation.centre)
        means.append(integral / integral.sum())
    return (means[0] - means[1]) / (2 * h)
