"""The Green function of a bare stack of layers: the rise at a distance from a small hot disc, at any frequency.

In the plane of the chip every layer is uniform. With exp(i k x) along it and exp(s t) in time, heat flows in z only,

    k_z T'' = (k_r k^2 + s rho c) T,    q = sqrt((k_r k^2 + s rho c)/k_z),    kappa = k_z q

so that a piece of a layer of thickness d is a two-port. The fluxes into its faces, W/m^2, are by the rises of both

    kappa/tanh(q d) T_near - kappa/sinh(q d) T_far,    and the same with near and far exchanged,

and those of all pieces at a height add to the flux that enters there. g(k) is the rise by a unit flux, K m^2/W; means
over the heights of the parts are Gauss sums. In the plane

    G(r) = 1/(2 pi) int_0^inf g(k) J_0(k r) k dk,    per length of a line: 1/(2 W) [g(0) + 2 sum_n g(k_n) ...]

the second in a section of half width W with insulated sides, k_n = n pi/(2 W).

Source of the transform: A. J. S. Hamilton, Mon. Not. R. Astron. Soc. 312, 257 (2000) (FFTLog), as in `scipy.fft.fht`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.fft import fht, fhtoffset
from scipy.linalg import eigh

from thermofem import Boundary, CrossSection
from thermofem.arrays import Array, Complex

HELD = 1e30  # W/(m^2 K), of an isothermal side
ENDLESS = 0.3  # 1/s, slowest rate of an endless substrate: a tenth of it moves G by sqrt(w/alpha)/(2 pi k), 0.02 K/W
NEAREST, FARTHEST = 1e-14, 1e4  # m, range of the transform, which takes both ends for one
DISTANCES = 8192  # of the distances: 455 a decade, between which linear interpolation errs by 3e-6
TAIL_OF_GAUSS = 7.0  # k sigma beyond which exp(-(k sigma)^2) is below 1e-21
UNIFORM = np.array([1e-3])  # 1/m, k of heat that is uniform in the plane


def _exchange(side: Boundary) -> float:
    """Heat transfer coefficient of a side in W/(m^2 K); `HELD` for an isothermal one."""
    return HELD if side.kind == "isothermal" else side.exchange


class Spread(NamedTuple):
    """Heights in m over which the power of a part is uniform, and the standard deviation of its lanes or cells in m."""

    bottom: float
    top: float
    sigma: float = 0.0

    @property
    def heights(self) -> tuple[Array, Array]:
        """z of Gauss points in m, and their weights of sum 1."""
        # 3: Gauss points over the height of a part
        node, weight = np.polynomial.legendre.leggauss(3)
        return self.bottom + (self.top - self.bottom) * (node + 1) / 2, weight / 2


@dataclass(frozen=True, eq=False)
class Stack:
    """The layers of a section without its parts, at its ambient temperature.

    edges [shape (layers + 1,), m]: z of the bottom of each layer and of the top.
    along, across [shape (layers,), W/m/K]: conductivity in the plane and in z.
    capacity [shape (layers,), J/m^3/K]: rho c_p.
    bottom, top [W/(m^2 K)]: exchange with the ambient.
    endless: whether the lowest layer goes on below its bottom.
    """

    edges: Array
    along: Array
    across: Array
    capacity: Array
    bottom: float
    top: float
    endless: bool

    @classmethod
    def of(cls, section: CrossSection) -> "Stack":
        """The stack of a section."""
        layers = [section.material_of(layer.name).at(section.ambient) for layer in section.layers]
        along, across, capacity = np.transpose(layers)
        edges = np.array(section.layer_edges)
        endless = section.bottom.kind == "open"
        return cls(edges, along, across, capacity, _exchange(section.bottom), _exchange(section.top), endless)

    @cached_property
    def slowest(self) -> float:
        """Slowest rate in 1/s at which heat leaves, uniform in the plane; 0 where the lowest layer has no bottom."""
        if self.endless:
            return 0.0
        layers = self.capacity.size
        # 30: pieces of a layer, of lumped capacity
        pieces = np.linspace(0, layers, 30 * layers + 1)
        cuts = np.interp(pieces, np.arange(layers + 1), self.edges)
        storage = np.convolve(np.repeat(self.capacity, 30) * np.diff(cuts), [0.5, 0.5])
        conduction = self._fluxes(UNIFORM, 0j, cuts)[0].real
        *_, longest = eigh(np.diag(storage), conduction, eigvals_only=True)
        return float(1 / longest)

    def green(self, k: Array, s: Complex, heated: Spread, read: Spread) -> Complex:
        """g(k) in K m^2/W between the heights of two parts, shape (frequencies, k), without their extent in the plane.

        k [shape (n,), 1/m], s [shape (frequencies,), 1/s]
        """
        lowest, highest = self.edges[[0, -1]]
        z = np.concatenate([heated.heights[0], read.heights[0]]).clip(lowest, highest)
        cuts = np.unique(np.append(self.edges, z))
        places = np.split(np.searchsorted(cuts, z), 2)
        flux = np.bincount(places[0], heated.heights[1], cuts.size)
        mean = np.bincount(places[1], read.heights[1], cuts.size)
        return np.array([np.linalg.solve(self._fluxes(k, one, cuts), flux[:, None])[..., 0] @ mean for one in s])

    def _fluxes(self, k: Array, s: complex, cuts: Array) -> Complex:
        """Fluxes in W/m^2 that enter at the heights ``cuts`` by the rises there, shape (k, cuts, cuts)."""
        layer = np.searchsorted(self.edges, (cuts[1:] + cuts[:-1]) / 2) - 1
        square = self.along[layer] * k[:, None] ** 2 + s * self.capacity[layer]
        q = np.sqrt(square / self.across[layer])
        kappa = self.across[layer] * q
        depth = q * np.diff(cuts)
        fade = np.exp(-depth)
        lost = -np.expm1(-2 * depth)  # 1 - fade^2, also of a thin piece
        through = 2 * kappa * fade / lost
        into = kappa * (1 + fade**2) / lost
        matrix = np.zeros((k.size, cuts.size, cuts.size), dtype=complex)
        near = np.arange(layer.size)
        far = near + 1
        matrix[:, near, near] = into
        matrix[:, far, far] += into
        matrix[:, near, far] = matrix[:, far, near] = -through
        matrix[:, 0, 0] += kappa[:, 0] if self.endless else self.bottom
        matrix[:, -1, -1] += self.top
        return matrix

    def over_distance(
        self, s: Complex, heated: Spread, read: Spread, samples: int = DISTANCES
    ) -> tuple[Array, Complex]:
        """Distances r in m, shape (samples,), and G(r) in K/W at each frequency, shape (frequencies, samples)."""
        k = np.geomspace(1 / FARTHEST, 1 / NEAREST, samples)
        step = float(np.log(k[1] / k[0]))
        bias = -0.5 if self.endless else 0.0  # r G and k g of a half space do not decay without it
        offset = fhtoffset(step, mu=0, bias=bias)
        r = np.exp(offset) / k[::-1]
        blur = k * np.hypot(heated.sigma, read.sigma)
        seen = blur < np.sqrt(2) * TAIL_OF_GAUSS
        g = np.zeros((len(s), samples), dtype=complex)
        g[:, seen] = self.green(k[seen], s, heated, read)
        g *= k * np.exp(-(blur**2) / 2) / (2 * np.pi)
        real, imaginary = fht(np.stack([g.real, g.imag]), step, 0, offset, bias)
        G = real + 1j * imaginary
        return r, G / r

    def over_section(
        self, s: Complex, half_width: float, spreads: tuple[Spread, Spread], lanes: Sequence[Array]
    ) -> Complex:
        """Rise in K per W/m of one line by another in a section with insulated sides, at each frequency.

        half_width [m]; lanes [m]: x of those of both.
        """
        sigma = np.hypot(spreads[0].sigma, spreads[1].sigma)
        highest = TAIL_OF_GAUSS / sigma * np.sqrt(2)
        count = int(np.ceil(highest * 2 * half_width / np.pi))
        k = np.asarray(np.pi * np.arange(count + 1) / (2 * half_width), dtype=float)
        k[0] = k[1] * 1e-6  # the mean over the section; 0 itself would divide 0 by 0 at rest
        shares = np.full(k.size, 1 / half_width)
        shares[0] /= 2
        for x in lanes:
            shares *= np.cos(k[:, None] * (x + half_width)).mean(axis=1)
        shares *= np.exp(-((k * sigma) ** 2) / 2)
        return self.green(k, s, *spreads) @ shares
