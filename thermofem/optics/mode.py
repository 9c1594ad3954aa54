"""Guided modes of a ring or a straight guide, and what a resonator needs of them.

    n_g = (1/n_eff) int s n n_gm |E|^2 dA / int (1/s) (e - grad p).e dA,     n n_gm = n (n - lambda dn/dlambda)
    d n_eff = sum_i G_i dn_i,     G_i = int_i s n |E|^2 dA / (n_eff int (1/s) (e - grad p).e dA)
    d w/w = -d n_eff/n_g

exact for the discrete problem; s = r/R, and |E|^2 = e_r^2 + e_z^2 + (beta p/s)^2: the axial field is in quadrature.
n_eff = beta/k0 belongs to the radius R of the core's centre (of a full disc, of its edge); nu = beta R does not.

Loss by radiation, of a bend and into a substrate, with perfectly matched layers in straight windows:

    Q = w n_g/(c alpha),    alpha = 2 Im beta

The cladding is taken to go on beyond the stack and the substrate. The window's sides are straight and triangles at most
half of the wavelength in the cladding: jagged sides and coarse layers change Q by tens of percent.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.constants import c

from .. import checks
from ..algebra.factor import factorize
from ..arrays import Array
from ..mesh.triangles import sampled
from .mode_elements import Space, eigenpairs
from .mode_window import UM, Box, Window, drawn, material_of

if TYPE_CHECKING:
    import xarray as xr

    from .modes import Light

DEPTH = 1.5e-6  # m, of the matched layers where there is room
ASIDE = 1.2e-6  # m, at least, between the core and the layers
LARGEST_Q = 1e11  # round-off of Im beta is about 1e-13 of beta
TIGHT = 20.0  # exponent of a bend's tunnelling; beyond it Q_rad is above 1e9 and not computed for a ring
LEAST = 1e5  # 1/s; a ring with a smaller radiation rate counts as one that does not radiate
DECIBEL = 20 / math.log(10)  # per neper of the field


@dataclass(frozen=True, eq=False)
class Mode:
    """One guided mode.

    Attributes
    ----------
    name : str
        TE0, TM0, TE1, ... by the larger transverse component and by falling n_eff.
    wavelength : float, m
    light : Light
        what was solved.
    square : float, 1/um^2
        beta^2; complex where matched layers absorb.
    x : array
        unknowns of ``space``, over the triangles of ``window``; the power flow x.B x is 1.
    """

    name: str
    wavelength: float
    light: Light = field(repr=False)
    window: Window = field(repr=False)
    space: Space = field(repr=False)
    square: Any = field(repr=False)
    x: Array = field(repr=False)

    @property
    def core(self) -> str:
        """The part that guides."""
        return self.light.part

    @property
    def radius(self) -> float:
        """R in m that n_eff belongs to; inf for a straight guide."""
        return self.space.radius / UM

    @property
    def k0(self) -> float:
        """2 pi/wavelength in 1/um."""
        return 2 * math.pi / (self.wavelength * UM)

    @property
    def n_eff(self) -> float:
        """Effective index beta/k0 at the radius R."""
        return math.sqrt(self.square.real) / self.k0

    @property
    def order(self) -> float:
        """Angular order nu = beta R; whole at a resonance."""
        return math.sqrt(self.square) * self.radius * UM

    @cached_property
    def _indices(self) -> tuple[Array, Array]:
        """eps = n^2 and n n_gm of every triangle, shape (triangles, 1) each."""
        return self.window.indices(self.wavelength)

    @cached_property
    def matrices(self) -> tuple[Any, Any]:
        """Matrices A and B of the eigenproblem."""
        return self.space.matrices(self._indices[0], self.k0)

    @cached_property
    def bordered(self) -> Callable[[Array], Array]:
        """Solver of the singular system (A + beta^2 B) y = b; y is determined up to a multiple of x."""
        A, B = self.matrices
        kept = np.delete(self.space.free, np.argmax(np.abs(self.x[self.space.free])))
        solve = factorize((A + self.square * B)[kept][:, kept])

        def solved(b: Array) -> Array:
            y = np.zeros(self.space.size)
            y[kept] = solve(np.ascontiguousarray(b[kept]))
            return y

        return solved

    @cached_property
    def fields(self) -> tuple[Array, Array, Array]:
        """E_r, E_z and E_phi/i at the quadrature points, shape (triangles, points); the power flow is 1."""
        e, _, p, _ = self.space.functions
        own = self.x[self.space.dofs].T
        e_r, e_z = np.einsum("it,ictq->ctq", own[: len(e)], e)
        axial = np.einsum("it,itq->tq", own[len(e) :], p)
        return e_r, e_z, np.sqrt(self.square) * axial / self.space.arc

    @cached_property
    def intensity(self) -> Array:
        """|E|^2 at the quadrature points, shape (triangles, points)."""
        return np.asarray(sum(np.abs(f) ** 2 for f in self.fields))

    def integral(self, values: Array, within: str | None = None) -> float:
        """int values s dA in um^2 over a region or material, or all; values of shape (triangles, points or 1)."""
        kept = values if within is None else values * self.window.inside(within)
        return float((kept * self.space.arc * self.space.dx).sum())

    @cached_property
    def n_g(self) -> float:
        """Group index n_eff + w dn_eff/dw, from the fields."""
        return self.integral(self._indices[1] * self.intensity) / self.n_eff

    @cached_property
    def te_fraction(self) -> float:
        """Fraction of the transverse |E|^2 along r: int s |e_r|^2 / int s (|e_r|^2 + |e_z|^2)."""
        r, z = (self.integral(np.abs(f) ** 2) for f in self.fields[:2])
        return r / (r + z)

    @property
    def core_material(self) -> str:
        """Name of the core's material."""
        return self.window.materials[self.window.names.index(self.core)].name

    @property
    def index(self) -> float:
        """Refractive index of the core."""
        return math.sqrt(self._indices[0][self.window.inside(self.core)][0])

    @cached_property
    def share(self) -> float:
        """Fraction of the mode's n^2 |E|^2 that lies in the core's material, over the width of the core."""
        x = self.space.mesh.p[0][self.space.mesh.t]
        own = x[:, self.window.inside(self.core)[:, 0]]
        column = (x.mean(axis=0) > own.min()) & (x.mean(axis=0) < own.max())
        energy = self._indices[0] * self.intensity
        return self.integral(energy * column[:, None], self.core_material) / self.integral(energy)

    @cached_property
    def confinement(self) -> dict[str, float]:
        """G = dn_eff/dn of every region and of every material in reach; above 1 where light is slow."""
        density = np.sqrt(self._indices[0]) * self.intensity
        names = {material.name for material in self.window.materials} | set(self.window.names)
        return {name: self.integral(density, name) / self.n_eff for name in sorted(names)}

    @cached_property
    def _thermal_density(self) -> Array:
        """Weight n (dn/dT) |E|^2 of the temperature at the quadrature points, not normalised."""
        return np.sqrt(self._indices[0]) * self.window.of_materials(lambda m: m.thermo_optic) * self.intensity

    @property
    def thermo_optic(self) -> float:
        """K = -d ln(w)/dT = (dn_eff/dT)/n_g in 1/K at a uniform temperature change."""
        return self.integral(self._thermal_density) / self.n_eff / self.n_g

    def light_integral(self, basis: Any, mesh: Any = None, shift: float = 0.0) -> Array:
        """Integral of n (dn/dT) |E|^2 times each function of a scalar basis on the heat mesh, shape (functions,).

        It makes the temperature as the mode sees it one more linear functional of the heat problem,

            <T> = int n (dn/dT) T |E|^2 dV / int n (dn/dT) |E|^2 dV,      -dw/w = K <T>,    K = `thermo_optic`

        mesh: scikit-fem mesh with moved vertices, in place of that of the basis.
        shift [m]: by which the core's centre has moved.
        """
        weight = self._thermal_density * self.space.arc * self.space.dx
        hot = np.flatnonzero(weight.any(axis=1))  # air has no heat and no triangles
        r, z = self.space.points[:, hot].reshape(2, -1) / UM
        r = r + (self.light.centre + shift)
        points = np.stack([np.abs(r) if self.light.geometry.mirrored else r, z], axis=1)
        return sampled(basis, points, weight[hot].ravel(), mesh)

    def volume(
        self, power: int, *, length: float | None = None, dispersion: bool = False, spread_carriers: bool = False
    ) -> float:
        """Mode volume in m^3 of two-photon absorption (power 2) or of the carriers made by it (3).

            V_2 = (int n^2 I)^2 / int n^4 I^2,     V_3 = [(int n^2 I)^3 / int n^6 I^3]^(1/2),     I = |E|^2, all space

        Parameters
        ----------
        power : int
            2 or 3.
        length : float, m
            2 pi R of a ring, and the length of a straight section, where it is not given.
        dispersion : bool
            n n_g of the material in place of n^2 in the numerators: the stored energy with dispersion; silicon +7 %.
        spread_carriers : bool
            (3) carriers even over the core's material, as they diffuse in 10 ps: (V_core V_2/Gamma_2)^(1/2).

        Source: P. E. Barclay, K. Srinivasan, O. Painter, Opt. Express 13, 801 (2005); the dispersion is derived.
        """
        checks.integer("power", power, 2, 3)
        own = self.light.geometry.length or 2 * math.pi * self.radius
        length = own if length is None else checks.positive("length", length, unit="m")
        if power == 3 and spread_carriers:
            core = self.integral(np.ones_like(self.intensity), self.core_material) / UM**2 * length
            return math.sqrt(core * self.volume(2, length=length, dispersion=dispersion) / self.core_fraction(2))
        eps, group = self._indices
        stored = self.integral((group if dispersion else eps) * self.intensity)
        dense = self.integral((eps * self.intensity) ** power)
        return float((stored**power / dense) ** (1 / (power - 1))) / UM**2 * length

    def core_fraction(self, power: int, *, spread_carriers: bool = False) -> float:
        """Fraction of int n^(2 power) I^power in the core's material: Gamma_TPA (2) and Gamma_FC (3; 1 when spread)."""
        checks.integer("power", power, 2, 3)
        if power == 3 and spread_carriers:
            return 1.0
        dense = (self._indices[0] * self.intensity) ** power
        return self.integral(dense, self.core_material) / self.integral(dense)

    def derivatives(self, parameters: Sequence[str | Sequence[str]], **rules: bool) -> xr.Dataset:
        """Derivatives of the mode with respect to parameters given by paths, as `mode_derivatives` says."""
        from .mode_derivatives import mode_derivatives

        return mode_derivatives(self, parameters, **rules)

    @cached_property
    def error(self) -> float:
        """Estimated error of n_eff: the difference to elements of order 3 (of those of order 3, to order 2)."""
        return abs(self.nearest(replace(self.space, order=5 - self.space.order)).n_eff - self.n_eff)

    def solved(self, count: int, index: float | None = None) -> list[Mode]:
        """The modes on the same space with n_eff nearest to ``index``, by default to that of this one."""
        pairs = eigenpairs(self.space, *self.matrices, (self.k0 * (index or self.n_eff)) ** 2, count)
        return [replace(self, square=square, x=x) for square, x in pairs]

    def nearest(self, space: Space, window: Window | None = None) -> Mode:
        """Mode on another space over the same cross-section with about the same n_eff and core confinement.

        Radiation modes of a bend may have a nearer n_eff: of several modes the most similar one is then taken.
        """
        start = replace(self, space=space, window=window or self.window)
        found = start.solved(1)
        if not found or found[0]._likeness(self) < 0.9 * self._likeness(self):
            found = start.solved(6)
        return max(found, key=lambda mode: mode._likeness(self))

    def _likeness(self, like: Mode) -> float:
        """Similarity to another mode: fraction of the energy in the core times fraction of the same polarisation."""
        return self.share * (self.te_fraction if like.te_fraction > 0.5 else 1 - self.te_fraction)

    @cached_property
    def q_radiation(self) -> float:
        """Quality factor of the bend's radiation, w n_g/(2 c Im beta); inf where it is above 1e11 and round-off.

        Within 2 % up to 1e9 (measured against exact rings and published bends).
        """
        light = self.light
        if math.isinf(self.radius):
            return math.inf
        aside = max(ASIDE, light.reach(self.n_eff, 1e-7))
        outer = max(2e-6, 0.15 * self.radius + ASIDE)
        _, foot = light.outline.min(axis=0)
        _, top = light.outline.max(axis=0)
        box = light.box(aside, outer + DEPTH, aside + DEPTH, aside + DEPTH)
        if light.geometry.top_z > top:  # else air begins there
            box = (*box[:3], min(box[3], light.geometry.top_z))
        ends = foot - aside - DEPTH, top + aside + DEPTH
        damping = self._damping(box, (0.0, DEPTH, DEPTH, DEPTH), self.radius, ends)
        q = self.k0 * self.n_g / (2 * damping) if damping > 0 else math.inf
        return q if q < LARGEST_Q else math.inf

    @cached_property
    def radiation_rate(self) -> float:
        """Amplitude rate w/(2 Q_rad) in 1/s; 0 where a bend is so wide that Q_rad is above 1e9.

        Raises InputError: Q_rad below 1e3.
        """
        decay = self.k0 * math.sqrt(self.n_eff**2 - self.light.cladding_index**2)
        if 2 / 3 * self.radius * UM * decay**3 / self.square > TIGHT:
            return 0.0
        if self.q_radiation < 1e3:
            rule = f"the bend of {self.radius * UM:g} um radiates: Q = {self.q_radiation:.3g}"
            raise checks.InputError(rule, "take a larger radius or a wider core")
        rate = math.pi * c / self.wavelength / self.q_radiation
        return rate if rate > LEAST else 0.0

    @cached_property
    def substrate_loss(self) -> float:
        """Power loss in dB/cm of the straight guide into a substrate that guides by itself; 0 without one."""
        light = self.light
        away = [far for name, far in light.limits[1].items() if material_of(light.geometry, name).index is not None]
        if not away:
            return 0.0
        aside = max(ASIDE, light.reach(self.n_eff, 1e-7))
        left, right, _, top = light.box(aside + DEPTH, aside + DEPTH, 0.0, aside)
        bottom = light.outline[:, 1].min() - min(away) - DEPTH - 0.5e-6
        depths = (DEPTH, DEPTH, DEPTH, 0.0)
        return DECIBEL * self._damping((left, right, bottom, top), depths, math.inf, (bottom, top)) * 1e4

    def _damping(self, box: Box, depths: tuple[float, ...], radius: float, beyond: tuple[float, float]) -> float:
        """Im beta in 1/um of the mode in a window with matched layers of the given depths in m."""
        light, substrate = self.light, self.light.limits[0][2]

        def largest(z: float) -> float:
            return self.wavelength / (2 * (light.core_index if z < substrate else light.cladding_index))

        window = drawn(light.geometry, box, light.centre, 1e-3, largest, beyond)
        space = Space(window.mesh, 3, radius * UM, tuple(depth * UM for depth in depths))
        return float(np.sqrt(self.nearest(space, window).square).imag)
