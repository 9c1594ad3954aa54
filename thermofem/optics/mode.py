"""Guided modes of a ring or a straight guide, and what a resonator needs of them.

    n_g = (1/n_eff) int s n n_gm |E|^2 dA / int (1/s) (e - grad p).e dA,     n n_gm = n (n - lambda dn/dlambda)
    d n_eff = sum_i G_i dn_i,     G_i = int_i s n |E|^2 dA / (n_eff int (1/s) (e - grad p).e dA)
    d w/w = -d n_eff/n_g

exact for the discrete problem; s = r/R, and |E|^2 = e_r^2 + e_z^2 + (beta p/s)^2: the axial field is in quadrature.
n_eff = beta/k0 belongs to the radius R of the core's centre (of a full disc, of its edge); nu = beta R does not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from ..arrays import Array, NDArray
from .space import Space, eigenpairs
from .window import UM, Window, energy_index

if TYPE_CHECKING:
    import xarray as xr

    from .modes import Light


@dataclass(frozen=True, eq=False)
class Mode:
    """One guided mode.

    Attributes
    ----------
    name : str
        TE0, TM0, TE1, ... by the larger transverse component and by falling n_eff.
    wavelength : float, m
    radius : float, m
        R that n_eff belongs to; inf for a straight guide.
    """

    name: str
    wavelength: float
    radius: float
    core: str
    window: Window = field(repr=False)
    space: Space = field(repr=False)
    light: Light | None = field(repr=False)
    square: float = field(repr=False)
    x: Array = field(repr=False)

    @property
    def k0(self) -> float:
        """2 pi/wavelength in 1/um."""
        return 2 * math.pi / (self.wavelength * UM)

    @property
    def n_eff(self) -> float:
        """Effective index beta/k0 at the radius R."""
        return math.sqrt(self.square) / self.k0

    @property
    def order(self) -> float:
        """Angular order nu = beta R; whole at a resonance."""
        return math.sqrt(self.square) * self.radius * UM

    @cached_property
    def _indices(self) -> tuple[Array, Array]:
        """eps and n n_gm of every triangle."""
        eps, group = energy_index(self.window.materials, self.window.names, self.wavelength)
        return eps[self.window.region], group[self.window.region]

    @cached_property
    def fields(self) -> tuple[Array, Array, Array]:
        """E_r, E_z and E_phi/i at the quadrature points, shape (triangles, points); the power flow is 1."""
        e, _, p, _ = self.space.functions
        own = (self.x / math.sqrt(self._flow))[self.space.dofs].T
        e_r, e_z = np.einsum("it,ictq->ctq", own[: len(e)], e)
        axial = np.einsum("it,itq->tq", own[len(e) :], p)
        return e_r, e_z, math.sqrt(self.square) * axial / self.space.arc

    @cached_property
    def matrices(self) -> tuple[Any, Any]:
        """A and B of the eigenproblem."""
        return self.space.matrices(self._indices[0], self.k0)

    @cached_property
    def bordered(self) -> Callable[[Array], Array]:
        """See `shape.bordered`."""
        from .shape import bordered

        return bordered(self)

    @cached_property
    def _flow(self) -> float:
        """x.B x, the power flow of the vector as it is."""
        return float(self.x @ (self.matrices[1] @ self.x))

    @cached_property
    def intensity(self) -> Array:
        """|E|^2 at the quadrature points."""
        return np.asarray(sum(f**2 for f in self.fields))

    def integral(self, values: Array) -> float:
        """int values s dA in um^2; values of shape (triangles, points)."""
        return float((values * self.space.arc * self.space.dx).sum())

    @cached_property
    def n_g(self) -> float:
        """Group index n_eff + w dn_eff/dw, from the fields."""
        return self.integral(self._indices[1][:, None] * self.intensity) / self.n_eff

    @cached_property
    def te_fraction(self) -> float:
        """int s e_r^2 / int s (e_r^2 + e_z^2)."""
        r, z = (self.integral(f**2) for f in self.fields[:2])
        return r / (r + z)

    @property
    def core_material(self) -> str:
        """Name of the core's material."""
        return self.window.materials[self.window.names.index(self.core)].name

    @cached_property
    def share(self) -> float:
        """Share of n^2 |E|^2 in the core's material over the core's width."""
        x = self.space.mesh.p[0][self.space.mesh.t]
        own = x[:, self.window.inside(self.core)]
        column = (x.mean(axis=0) > own.min()) & (x.mean(axis=0) < own.max())
        energy = self._indices[0][:, None] * self.intensity
        inside = (self.window.inside(self.core_material) & column)[:, None]
        return self.integral(energy * inside) / self.integral(energy)

    @cached_property
    def confinement(self) -> dict[str, float]:
        """G = dn_eff/dn of every region and of every material in reach; above 1 where light is slow."""
        density = np.sqrt(self._indices[0])[:, None] * self.intensity
        names = {material.name for material in self.window.materials} | set(self.window.names)
        return {name: self.integral(density * (self._named(name))[:, None]) / self.n_eff for name in sorted(names)}

    def _named(self, name: str) -> NDArray[np.bool_]:
        """Triangles of a region, or else of a material."""
        if name in self.window.names:
            return np.asarray(self.window.region == self.window.names.index(name))
        return self.window.inside(name)

    @cached_property
    def thermal_density(self) -> Array:
        """n (dn/dT) |E|^2 at the quadrature points: what the temperature is weighted with, not normalised."""
        slopes = np.array([material.thermo_optic for material in self.window.materials])[self.window.region]
        return np.sqrt(self._indices[0])[:, None] * slopes[:, None] * self.intensity

    @property
    def index_slope(self) -> float:
        """dn_eff/dT in 1/K of an even temperature."""
        return self.integral(self.thermal_density) / self.n_eff

    @property
    def thermo_optic(self) -> float:
        """K = -d ln(w)/dT = (dn_eff/dT)/n_g in 1/K of an even temperature."""
        return self.index_slope / self.n_g

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
        length = self._length(length)
        if power == 3 and spread_carriers:
            two = self.volume(2, length=length, dispersion=dispersion) / self.core_fraction(2)
            return math.sqrt(self.core_volume(length) * two)
        eps, group = self._indices
        stored = self.integral((group if dispersion else eps)[:, None] * self.intensity)
        dense = self.integral((eps[:, None] * self.intensity) ** power)
        return float((stored**power / dense) ** (1 / (power - 1))) / UM**2 * length

    def core_fraction(self, power: int, *, spread_carriers: bool = False) -> float:
        """Share of int n^(2 power) I^power in the core's material: Gamma_TPA (2) and Gamma_FC (3; 1 when spread)."""
        checks.integer("power", power, 2, 3)
        if power == 3 and spread_carriers:
            return 1.0
        dense = (self._indices[0][:, None] * self.intensity) ** power
        return self.integral(dense * self.window.inside(self.core_material)[:, None]) / self.integral(dense)

    def core_volume(self, length: float | None = None) -> float:
        """Volume in m^3 of the core's material within the window."""
        inside = np.ones_like(self.intensity) * self.window.inside(self.core_material)[:, None]
        return self.integral(inside) / UM**2 * self._length(length)

    def _length(self, length: float | None) -> float:
        if length is not None:
            return checks.positive("length", length, unit="m")
        own = None if self.light is None else self.light.geometry.length
        return own or 2 * math.pi * self.radius

    @cached_property
    def error(self) -> float:
        """Estimated error of n_eff: the difference to elements of order 3 (of those of order 3, to order 2)."""
        other = replace(self.space, order=5 - self.space.order)
        return abs(nearest(self, other, self.window).n_eff - self.n_eff)

    @cached_property
    def q_radiation(self) -> float:
        """Quality factor of the bend's radiation, w n_g/(2 c Im beta); inf where it is above 1e11 and round-off.

        Within 2 % up to 1e9 (measured against exact rings and published bends).
        """
        from .radiation import radiation_q

        return radiation_q(self)

    @cached_property
    def substrate_loss(self) -> float:
        """Power loss in dB/cm of the straight guide into a substrate that guides by itself; 0 without one."""
        from .radiation import substrate_loss

        return substrate_loss(self)

    def derivatives(self, parameters: Sequence[str | Sequence[str]], **rules: bool) -> xr.Dataset:
        """Derivatives by paths as a campaign varies them, see `shape.mode_derivatives`."""
        from .shape import mode_derivatives

        return mode_derivatives(self, parameters, **rules)


def nearest(like: Mode, space: Space, within: Window) -> Mode:
    """The mode on a space over the same cross-section with about the same n_eff, and held by the core as well.

    Radiation modes of a bend may lie between: the best held of several is taken where the nearest is one of them.
    """
    found = _nearby(like, space, within, 1)
    if not found or _likeness(found[0], like) < 0.9 * _likeness(like, like):
        found = _nearby(like, space, within, 6)
    return max(found, key=lambda mode: _likeness(mode, like))


def _likeness(mode: Mode, like: Mode) -> float:
    """Share of the energy in the core, times that of the same polarisation."""
    return mode.share * (mode.te_fraction if like.te_fraction > 0.5 else 1 - mode.te_fraction)


def _nearby(like: Mode, space: Space, within: Window, count: int) -> list[Mode]:
    eps = energy_index(within.materials, within.names, like.wavelength)[0][within.region]
    found = [
        replace(like, space=space, window=within, radius=space.radius / UM, square=square.real, x=x)
        for square, x in eigenpairs(space, eps, like.k0, like.n_eff, count)
        if square.real > 0
    ]
    return [mode for mode in found if mode._flow > 0]
