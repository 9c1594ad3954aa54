"""Derivatives of a mode with respect to the numbers of its cross-section, exact for the discrete problem.

The vertices move with the outlines as for the heat (`fem.shape_derivatives`), and the unknowns of e and p with them:

    d(beta^2) = -x.(dA + beta^2 dB) x / x.B x,       (A + beta^2 B) dx = -(dA + beta^2 dB + d(beta^2) B) x

dx, free of x itself, is solved once for each parameter with one factorization. Everything else is a function of the
vertices, the indices, the wavelength, x and beta^2, without a solve: its derivative along their changes is a central
difference, with an error of `STEP` squared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from ..algebra.factor import factorize
from ..arrays import Array
from ..checks import InputError
from ..geometry.parameter_paths import Change, change
from ..geometry.section_parts import LIGHT
from ..materials.index_laws import constant, constant_index
from ..mesh.mesh_motion import vertex_velocities
from .reading import containing, light_integral
from .window import UM, Window

if TYPE_CHECKING:
    import xarray as xr

    from .mode import Mode
    from .modes import Light

STEP = 1e-4  # largest strain, or relative change of a wavelength or an index, of the differences
ABOUT = {
    "n_eff": ("1", "effective index"),
    "n_g": ("1", "group index"),
    "thermo_optic": ("1/K", "relative shift of the resonance per kelvin"),
    "index_confinement": ("1", "dn_eff/dn of the core's material"),
    "core_fraction_2": ("1", "share of two-photon absorption in the core"),
    "core_fraction_3": ("1", "share of the carriers in the core"),
    "volume_2": ("m^3", "volume of two-photon absorption"),
    "volume_3": ("m^3", "volume of the carriers"),
    "radius": ("m", "radius that n_eff belongs to"),
    "resonance_wavelength": ("m", "wavelength of the resonance"),
}


def mode_derivatives(mode: Mode, parameters: Sequence[str | Sequence[str]], **rules: bool) -> xr.Dataset:
    """Derivatives of a mode by paths as a campaign varies them, such as "part.core.width"; a tuple changes together.

    Lengths, constant indices and thermo_optic of materials, and "light.wavelength".

    Parameters
    ----------
    parameters : sequence of str or of tuples of str
    rules : bool
        ``dispersion`` and ``spread_carriers`` of the volumes, see `Mode.volume`.

    Returns
    -------
    xarray.Dataset
        over "parameter", per SI unit of it: n_eff, n_g, thermo_optic, index_confinement, core_fraction_2 and _3,
        volume_2 and _3, radius, and resonance_wavelength (of the ring, at the order that it has); value and unit of the
        parameter. Properties of the heat alone have zeros. Against differences on the same moved mesh: 1e-6 (measured).

    Raises
    ------
    InputError
        a path that leads nowhere, or a motion at which a face would appear or vanish.
    """
    import xarray as xr

    each = checks.instances("parameters", [parameters] if isinstance(parameters, str) else parameters, str, tuple, list)
    if not each:
        raise InputError("parameters is empty; name at least one path, e.g. 'part.core.width'")
    light: Light = mode.light  # type: ignore[assignment]
    changes = [change(light.geometry, one) for one in each]
    rows = [_row(mode, one, rules) for one in variations(mode, changes)]
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
    attrs = dict(zip(ABOUT, numbers(mode, **rules), strict=False))
    return xr.Dataset(variables, coords=coords, attrs={"mode": mode.name, "wavelength": mode.wavelength, **attrs})


def numbers(mode: Mode, *, dispersion: bool = False, spread_carriers: bool = False) -> Array:
    """What is differentiated, in the order of `ABOUT` and without radius and resonance."""
    two, three = {"dispersion": dispersion}, {"spread_carriers": spread_carriers}
    G = mode.confinement[mode.core_material]
    shares = mode.core_fraction(2), mode.core_fraction(3, **three)
    volumes = mode.volume(2, **two), mode.volume(3, **two, **three)
    return np.array([mode.n_eff, mode.n_g, mode.thermo_optic, G, *shares, *volumes])


@dataclass(frozen=True, eq=False)
class Variation:
    """How a parameter changes what a mode is solved on, per unit of it.

    heat [shape (2, vertices of the heat's mesh)]: velocity, in m.
    centre: velocity of r = R in m, from which windows count.
    wavelength [m]
    materials [dict from name to dict]: of index and thermo_optic.
    """

    change: Change
    heat: Array
    centre: float = 0.0
    wavelength: float = 0.0
    materials: dict[str, dict[str, float]] = field(default_factory=dict)

    def on(self, light: Light, window: Window) -> Array:
        """Velocity of a window's vertices against its origin in m, shape (2, vertices); air, without heat, rests."""
        grid, places = light.mesh.skfem, window.mesh.p / UM + np.array([[light.centre], [0.0]])
        turned = light.geometry.mirrored & (places[0] < 0)
        places[0] = np.where(turned, -places[0], places[0])
        cells, found = containing(grid, places)
        local = grid.mapping().invF(places[:, :, None], tind=cells)[:, :, 0]
        shares = np.array([1 - local[0] - local[1], local[0], local[1]])
        moved = np.einsum("cn,xcn->xn", shares, self.heat[:, grid.t[:, cells]]) * found
        return np.stack([np.where(turned, -moved[0], moved[0]) - self.centre, moved[1]])

    def step(self, mode: Mode, window: Window, velocity: Array) -> float:
        """Step of the differences in units of the parameter; 0 where nothing changes."""
        corners, moved = window.mesh.p[:, window.mesh.t], velocity[:, window.mesh.t]
        sides, strains = (np.linalg.norm(one - np.roll(one, 1, axis=1), axis=0) for one in (corners, moved))
        of_materials = [abs(slope) for slopes in self.materials.values() for slope in slopes.values()]
        strain = [float((strains * UM / sides).max()), abs(self.centre) / mode.radius]
        largest = max(*strain, abs(self.wavelength) / mode.wavelength, *of_materials, 0.0)
        return STEP / largest if largest else 0.0

    def window(self, window: Window, velocity: Array, h: float) -> Window:
        """A window after a step ``h`` of the parameter."""

        def after(material: Any) -> Any:
            slopes = self.materials.get(material.name, {})
            new: dict[str, Any] = {}
            if "index" in slopes:
                new["index"] = constant_index((constant(material.index) or 1.0) + h * slopes["index"])
            if "thermo_optic" in slopes:
                new["thermo_optic"] = material.thermo_optic + h * slopes["thermo_optic"]
            return replace(material, **new) if new else material

        mesh = replace(window.mesh, doflocs=window.mesh.doflocs + h * UM * velocity)
        return replace(window, mesh=mesh, materials=tuple(map(after, window.materials)))


def variations(mode: Mode, changes: Sequence[Change]) -> list[Variation]:
    """The variation of every change of the mode's geometry."""
    light: Light = mode.light  # type: ignore[assignment]
    roles = (*light.geometry.heated, light.part)
    velocities = vertex_velocities(light.geometry, light.mesh, changes, roles=roles)
    return [_variation(light, *pair) for pair in zip(changes, velocities, strict=True)]


def _variation(light: Light, one: Change, velocity: Array) -> Variation:
    materials = {name: slopes for name, slopes in one.optical.items() if {"index", "thermo_optic"} & slopes.keys()}
    wavelength = one.optical.get(LIGHT, {}).get("wavelength", 0.0)
    return Variation(one, velocity.T, _of_centre(light, one), wavelength, materials)


def _of_centre(light: Light, one: Change) -> float:
    """Velocity of r = R, from which the window counts."""
    corners = one.outlines.get(light.part)
    if corners is None:
        return 0.0
    return float((corners[1:3] if light.at_edge else corners)[:, 0].mean())


def pulled(mode: Mode, one: Variation, velocity: Array) -> tuple[float, float, Array, tuple[Mode, Mode]] | None:
    """Step h of the parameter, d(beta^2), (dA + beta^2 dB) x, and the mode's x on the changed window ahead and behind.

    velocity: of the mode's window, as `Variation.on` gives it. None where nothing changes.
    """
    h = one.step(mode, mode.window, velocity)
    if not h:
        return None

    def at(sign: int) -> Mode:
        window = one.window(mode.window, velocity, sign * h)
        radius = mode.radius + sign * h * one.centre
        space = replace(mode.space, mesh=window.mesh, radius=radius * UM)
        wavelength = mode.wavelength + sign * h * one.wavelength
        return replace(mode, wavelength=wavelength, radius=radius, window=window, space=space)

    moved = at(1), at(-1)
    ahead, behind = (A @ mode.x + mode.square * (B @ mode.x) for A, B in (each.matrices for each in moved))
    pull = (ahead - behind) / (2 * h)
    return h, -float(mode.x @ pull) / mode._flow, pull, moved


def index_slope(mode: Mode, one: Variation, velocity: Array) -> float:
    """dn_eff per unit of a parameter, without a solve."""
    found = pulled(mode, one, velocity)
    relative = one.wavelength / mode.wavelength + (0.0 if found is None else found[1] / (2 * mode.square))
    return relative * mode.n_eff


def ends(mode: Mode, one: Variation) -> tuple[float, Mode, Mode] | None:
    """A step of the parameter, and the mode ahead and behind by it to first order; None where it does not change."""
    found = pulled(mode, one, one.on(mode.light, mode.window))  # type: ignore[arg-type]
    if found is None:
        return None
    h, slope, pull, moved = found
    dx = mode.bordered(-(pull + slope * (mode.matrices[1] @ mode.x)))
    ahead, behind = (
        replace(each, square=mode.square + sign * h * slope, x=mode.x + sign * h * dx)
        for sign, each in zip((1, -1), moved, strict=True)
    )
    return h, ahead, behind


def bordered(mode: Mode) -> Any:
    """Solves (A + beta^2 B) y = b, of rank one too low, for y that is free up to a multiple of x."""
    A, B = mode.matrices
    kept = np.delete(mode.space.free, np.argmax(np.abs(mode.x[mode.space.free])))
    solve = factorize((A + mode.square * B)[kept][:, kept])

    def solved(b: Array) -> Array:
        y = np.zeros(mode.space.size)
        y[kept] = solve(np.ascontiguousarray(b[kept]))
        return y

    return solved


def _row(mode: Mode, one: Variation, rules: dict[str, bool]) -> Array:
    """Derivatives by one parameter, in the order of `ABOUT`."""
    found = ends(mode, one)
    if found is None:
        return np.zeros(len(ABOUT))
    h, ahead, behind = found
    row = (numbers(ahead, **rules) - numbers(behind, **rules)) / (2 * h)
    resonance = mode.wavelength * (row[0] + mode.n_eff * one.centre / mode.radius) / mode.n_g
    return np.append(row, [one.centre, 0.0 if one.wavelength else resonance])


def light_slope(mode: Mode, basis: Any, one: Change) -> Array:
    """Derivative of the mean that the mode reads, on the heat's unknowns; see `reading.light_integral`."""
    (varied,) = variations(mode, [one])
    found = ends(mode, varied)
    if found is None:
        return np.zeros(basis.N)
    h, ahead, behind = found
    means = []
    for sign, each in ((1, ahead), (-1, behind)):
        mesh = replace(basis.mesh, doflocs=basis.mesh.doflocs + sign * h * varied.heat)
        integral = light_integral(each, basis, mesh, sign * h * varied.centre)
        means.append(integral / integral.sum())
    return np.asarray((means[0] - means[1]) / (2 * h))
