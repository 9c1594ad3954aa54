"""Guided modes of a ring or a straight guide, and what a resonator needs of them.

    n_g = (1/n_eff) int s n n_gm |E|^2 dA / int (1/s) (e - grad p).e dA,     n n_gm = n (n - lambda dn/dlambda)
    d n_eff = sum_i G_i dn_i,     G_i = int_i s n |E|^2 dA / (n_eff int (1/s) (e - grad p).e dA)
    d w/w = -d n_eff/n_g

exact for the discrete problem; s = r/R, and |E|^2 = e_r^2 + e_z^2 + (beta p/s)^2: the axial field is in quadrature.
n_eff = beta/k0 belongs to the radius R of the core's centre (of a full disc, of its edge); nu = beta R does not.

Loss by radiation, of a bend and into a substrate, by `mode_radiation`:    Q = w n_g/(c alpha),    alpha = 2 Im beta
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
from .mode_radiation import bend_damping, guiding_layers, substrate_damping
from .mode_window import UM, Window

if TYPE_CHECKING:
    import xarray as xr

    from .modes import Light

HYBRID = 0.3  # of TE or TM: a mode with more of both is hybrid
FELT = 1e-3  # of the energy: a material with less of it need not have dn/dT
TIGHT = 20.0  # exponent of a bend's tunnelling; beyond it Q_rad is above 1e9 and not computed for a ring
LEAST_RATE = 1e5  # 1/s; a ring with a smaller radiation rate counts as one that does not radiate
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
        free = self.space.free
        largest = np.argmax(np.abs(self.x[free]))
        others = np.delete(free, largest)
        singular = A + self.square * B
        solve = factorize(singular[others][:, others])

        def solved(b: Array) -> Array:
            y = np.zeros(self.space.size)
            y[others] = solve(np.ascontiguousarray(b[others]))
            return y

        return solved

    @cached_property
    def fields(self) -> tuple[Array, Array, Array]:
        """E_r, E_z and E_phi/i at the quadrature points, shape (triangles, points); the power flow is 1."""
        e, _, p, _ = self.space.functions
        unknowns = self.x[self.space.dofs].T
        e_r, e_z = np.einsum("it,ictq->ctq", unknowns[: len(e)], e)
        axial = np.einsum("it,itq->tq", unknowns[len(e) :], p)
        return e_r, e_z, np.sqrt(self.square) * axial / self.space.arc

    @cached_property
    def intensity(self) -> Array:
        """|E|^2 at the quadrature points, shape (triangles, points)."""
        r, z, axial = self.fields
        return np.abs(r) ** 2 + np.abs(z) ** 2 + np.abs(axial) ** 2

    def integral(self, values: Array, *within: str) -> float:
        """int values s dA in um^2 over regions or materials, or all; values of shape (triangles, points or 1)."""
        if within:
            values = values * self.window.inside(*within)
        return float((values * self.space.arc * self.space.dx).sum())

    @cached_property
    def n_g(self) -> float:
        """Group index n_eff + w dn_eff/dw, from the fields."""
        return self.integral(self._indices[1] * self.intensity) / self.n_eff

    @cached_property
    def te_fraction(self) -> float:
        """Fraction of the transverse |E|^2 along r: int s |e_r|^2 / int s (|e_r|^2 + |e_z|^2)."""
        e_r, e_z, _ = self.fields
        along_r = self.integral(np.abs(e_r) ** 2)
        along_z = self.integral(np.abs(e_z) ** 2)
        return along_r / (along_r + along_z)

    @property
    def hybrid(self) -> bool:
        """Whether neither transverse component is much the larger one, so that TE or TM is a weak name."""
        return HYBRID < self.te_fraction < 1 - HYBRID

    @cached_property
    def guiding(self) -> tuple[str, ...]:
        """Regions that guide: the core, and what is of its kind of material and has n > n_eff."""
        around = self.light.surroundings
        return tuple(name for name in self.window.names if around.guides(name, self.n_eff))

    @property
    def core_material(self) -> str:
        """Names of the materials of `guiding`, that of the core first."""
        names = [self.window.regions[region].name for region in (self.core, *self.guiding)]
        return " and ".join(dict.fromkeys(names))

    @property
    def index(self) -> float:
        """Refractive index of the core."""
        eps, _ = self._indices
        return math.sqrt(eps[self.window.inside(self.core)][0])

    @cached_property
    def _energy(self) -> Array:
        """n^2 |E|^2 at the quadrature points, shape (triangles, points)."""
        return self._indices[0] * self.intensity

    @cached_property
    def share(self) -> float:
        """Fraction of the mode's n^2 |E|^2 that lies in what guides, over the width of the core."""
        mesh = self.space.mesh
        x = mesh.p[0][mesh.t].mean(axis=0)
        walls = (self.light.surroundings.outline[:, 0] - self.light.centre) * UM
        column = (x > walls.min()) & (x < walls.max())
        return self._share_of(self._energy * column[:, None], *self.guiding)

    @cached_property
    def held(self) -> float:
        """Fraction of the mode's n^2 |E|^2 within the core and as far around it as its power decays to 1/10."""
        light = self.light
        around = light.surroundings
        excess = max(self.n_eff**2 - around.floor**2, 1e-6)
        decay = around.k0 * math.sqrt(excess)
        least = math.log(10) / (2 * decay)
        aside = {"left": least, "right": least}
        for side in aside:
            beside = around.steps(side)[0][1]
            if self.n_eff > beside:
                aside[side] = around.reach(side, self.n_eff, 0.1)
        left, right, bottom, top = light.box(aside["left"], aside["right"], least, least)
        x, y = self.space.points / UM
        between = (x > left - light.centre) & (x < right - light.centre)
        inside = between & (y > bottom) & (y < top)
        return self._share_of(self._energy * inside)

    def _share_of(self, energy: Array, *within: str) -> float:
        """Integral of a part of n^2 |E|^2 over all of it."""
        return self.integral(energy, *within) / self.integral(self._energy)

    @cached_property
    def confinement(self) -> dict[str, float]:
        """G = dn_eff/dn of every region and of every material in reach; above 1 where light is slow."""
        density = np.sqrt(self._indices[0]) * self.intensity
        materials = {material.name for material in self.window.materials}
        names = sorted(materials.union(self.window.names))
        return {name: self.integral(density, name) / self.n_eff for name in names}

    @cached_property
    def index_confinement(self) -> float:
        """G = dn_eff/dn of all that guides, as its index changes everywhere alike."""
        return sum(self.confinement[name] for name in self.guiding)

    @cached_property
    def lacking(self) -> tuple[str, ...]:
        """Materials without dn/dT that carry more than `FELT` of n^2 |E|^2."""
        lacking = {material.name for material in self.window.materials if material.thermo_optic is None}
        felt = FELT * self.integral(self._energy)
        return tuple(name for name in sorted(lacking) if self.integral(self._energy, name) > felt)

    @property
    def lacking_in_core(self) -> tuple[str, ...]:
        """Materials of what guides without dn/dT."""
        materials = [self.window.regions[region] for region in self.guiding]
        return tuple(sorted({material.name for material in materials if material.thermo_optic is None}))

    @cached_property
    def _thermal_density(self) -> Array:
        """Weight n (dn/dT) |E|^2 of the temperature at the quadrature points, not normalised."""
        if self.lacking_in_core:
            name = self.lacking_in_core[0]
            raise checks.InputError(
                f"thermo_optic is missing: {self.name} shifts by the dn/dT of {name!r}, which guides it",
                f'give it in [material.{name}], such as thermo_optic = "3e-5 1/K"',
            )
        slopes = self.window.of_materials(lambda m: m.thermo_optic or 0.0)
        n = np.sqrt(self._indices[0])
        return n * slopes * self.intensity

    @property
    def thermo_optic(self) -> float:
        """K = -d ln(w)/dT = (dn_eff/dT)/n_g in 1/K at a uniform temperature change.

        Raises InputError: dn/dT of a material that guides is missing. What is missing elsewhere counts as 0.
        """
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
        if self.light.geometry.mirrored:
            r = np.abs(r)
        points = np.stack([r, z], axis=1)
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
            by default the perimeter of a ring (`CrossSection.path_length`), or the length of a straight section.
        dispersion : bool
            n n_g of the material in place of n^2 in the numerators: the stored energy with dispersion; silicon +7 %.
        spread_carriers : bool
            (3) carriers even over all that guides, as they diffuse in 10 ps: (V_core V_2/Gamma_2)^(1/2).

        Source: P. E. Barclay, K. Srinivasan, O. Painter, Opt. Express 13, 801 (2005); the dispersion is derived.
        """
        checks.integer("power", power, 2, 3)
        if length is None:
            length = self.light.geometry.length or self.light.geometry.path_length(self.radius)
        else:
            length = checks.positive("length", length, unit="m")
        if power == 3 and spread_carriers:
            area = self.integral(np.ones_like(self.intensity), *self.guiding) / UM**2
            absorbing = self.volume(2, length=length, dispersion=dispersion)
            return math.sqrt(area * length * absorbing / self.core_fraction(2))
        eps, group = self._indices
        energy = (group if dispersion else eps) * self.intensity
        stored = self.integral(energy)
        dense = self.integral(self._energy**power)
        area = (stored**power / dense) ** (1 / (power - 1))
        return area / UM**2 * length

    def core_fraction(self, power: int, *, spread_carriers: bool = False) -> float:
        """Fraction of int n^(2 power) I^power in what guides: Gamma_TPA (2) and Gamma_FC (3; 1 when spread)."""
        checks.integer("power", power, 2, 3)
        if power == 3 and spread_carriers:
            return 1.0
        dense = self._energy**power
        return self.integral(dense, *self.guiding) / self.integral(dense)

    def derivatives(self, parameters: Sequence[str | Sequence[str]], **rules: bool) -> xr.Dataset:
        """Derivatives of the mode with respect to parameters given by paths, as `mode_derivatives` says."""
        from .mode_derivatives import mode_derivatives

        return mode_derivatives(self, parameters, **rules)

    @cached_property
    def error(self) -> float:
        """Estimated error of n_eff: the difference to elements of order 3 (of those of order 3, to order 2)."""
        other = replace(self.space, order=5 - self.space.order)
        return abs(self.nearest(other).n_eff - self.n_eff)

    def solved(self, count: int, index: float | None = None) -> list[Mode]:
        """The modes on the same space with n_eff nearest to ``index``, by default to that of this one."""
        beta = self.k0 * (index or self.n_eff)
        pairs = eigenpairs(self.space, *self.matrices, beta**2, count)
        return [replace(self, square=square, x=x) for square, x in pairs]

    def nearest(self, space: Space, window: Window | None = None) -> Mode:
        """Mode on another space over the same cross-section with about the same n_eff and core confinement.

        Radiation modes of a bend may have a nearer n_eff: of several modes the most similar one is then taken.
        """
        start = replace(self, space=space, window=window or self.window)
        likeness = 0.9 * self._likeness(self)
        modes = start.solved(1)
        if not modes or modes[0]._likeness(self) < likeness:
            modes = start.solved(6)
        return max(modes, key=lambda mode: mode._likeness(self))

    def _likeness(self, like: Mode) -> float:
        """Similarity to another mode: fraction of the energy in the core times fraction of the same polarisation."""
        same = self.te_fraction if like.te_fraction > 0.5 else 1 - self.te_fraction
        return self.share * same

    @cached_property
    def q_radiation(self) -> float:
        """Quality factor of the bend's radiation, w n_g/(2 c Im beta); inf where it is above 1e11 and round-off.

        Within 2 % up to 1e9 (measured against exact rings and published bends).
        """
        if math.isinf(self.radius) or self._tunnelling > 3 * TIGHT:
            return math.inf
        damping = bend_damping(self)
        if damping <= 0:
            return math.inf
        q = self.k0 * self.n_g / (2 * damping)
        # beyond 1e11 it is round-off: that of Im beta is about 1e-13 of beta
        return q if q < 1e11 else math.inf

    @cached_property
    def radiation_rate(self) -> float:
        """Amplitude rate w/(2 Q_rad) in 1/s; 0 where a bend is so wide that Q_rad is above 1e9.

        Raises InputError: Q_rad below 1e3.
        """
        if self._tunnelling > TIGHT:
            return 0.0
        if self.q_radiation < 1e3:
            rule = f"the bend of {self.radius * UM:g} um radiates: Q = {self.q_radiation:.3g}"
            raise checks.InputError(rule, "take a larger radius or a wider core")
        rate = math.pi * c / self.wavelength / self.q_radiation
        return rate if rate > LEAST_RATE else 0.0

    @property
    def leak_rate(self) -> float:
        """Amplitude rate leak v_g/2 in 1/s of `substrate_loss`; 0 where it is below `LEAST_RATE`."""
        alpha = self.substrate_loss * 100 / DECIBEL * 2  # 1/m, of the power
        rate = alpha * c / self.n_g / 2
        return rate if rate > LEAST_RATE else 0.0

    def tunnelling(self, cladding: float) -> float:
        """Exponent (2/3) R gamma^3/beta^2 of a bend's tunnelling, gamma = k0 (n_eff^2 - cladding^2)^(1/2); 0 if leaky.

        Source: D. Marcuse, Bell Syst. Tech. J. 50, 2551 (1971).
        """
        excess = max(self.n_eff**2 - cladding**2, 0.0)
        gamma = self.k0 * math.sqrt(excess)
        return float(2 / 3 * self.radius * UM * gamma**3 / self.square.real)

    @property
    def _tunnelling(self) -> float:
        """`tunnelling` into all that goes on beyond the guide."""
        return self.tunnelling(self.light.surroundings.continuum)

    @property
    def leaky(self) -> bool:
        """Whether n_eff is below the index of a slab at the side of the guide, so that it leaks there."""
        return self.n_eff < self.light.surroundings.continuum

    @property
    def drains(self) -> tuple[str, ...]:
        """What the mode leaks into: names of layers in quotation marks, or the slabs at the sides."""
        drains = [f"{name!r}, {away * UM:.3g} um away" for name, (_, away) in guiding_layers(self).items()]
        if self.leaky:
            drains.append(f"a slab mode of index {self.light.surroundings.continuum:.4f} at its side")
        return tuple(drains)

    @cached_property
    def substrate_loss(self) -> float:
        """Power loss in dB/cm of the straight guide into a substrate or another layer that guides by itself.

        0 where none is within reach (`mode_radiation.LEAKS`) and no slab at the side has an index above n_eff.
        """
        if not guiding_layers(self) and not self.leaky:
            return 0.0
        return DECIBEL * substrate_damping(self) * 1e4
