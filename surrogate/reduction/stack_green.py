"""The Green function of a bare stack of layers: the rise at a distance from a small hot disc, at any frequency.

In the plane of the chip every layer is uniform. With exp(i k x) along it and exp(s t) in time, heat flows in z only,

    k_z T'' = (k_r k^2 + s rho c) T,    q = sqrt((k_r k^2 + s rho c)/k_z),    kappa = k_z q

and each layer of thickness d turns an admittance Y (flux over rise, W/(m^2 K)) at its far side to one at its near side,

    Y' = kappa (Y + kappa tanh(q d))/(kappa + Y tanh(q d)),    T_far/T_near = 1/(cosh(q d) + Y/kappa sinh(q d))

A unit flux at z_j, where Y_up and Y_down are the admittances of what lies above and below, makes 1/(Y_up + Y_down)
there and the product of the ratios elsewhere. Means over the heights of the parts are Gauss sums. In the plane

    G(r) = 1/(2 pi) int_0^inf g(k) J_0(k r) k dk,    per length of a line: 1/(2 W) [g(0) + 2 sum_n g(k_n) ...]

the second in a section of half width W with insulated sides, k_n = n pi/(2 W).

Source of the transform: A. J. S. Hamilton, Mon. Not. R. Astron. Soc. 312, 257 (2000) (FFTLog), as in `scipy.fft.fht`.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.fft import fht, fhtoffset

from thermofem import Boundary, CrossSection
from thermofem.arrays import Array, Complex

from .shape_points import Spread

HELD = 1e30  # W/(m^2 K), of an isothermal side
NEAREST, FARTHEST = 1e-14, 1e4  # m, range of the transform, which takes both ends for one
DISTANCES = 8192  # of the distances: 455 a decade, between which linear interpolation errs by 3e-6
TAIL_OF_GAUSS = 7.0  # k sigma beyond which exp(-(k sigma)^2) is below 1e-21
RATES = (1e0, 1e12)  # 1/s, where the slowest rate is looked for
CHUNK = 8  # frequencies at once, to bound memory


def _exchange(side: Boundary) -> float:
    """Heat transfer coefficient of a side in W/(m^2 K); `HELD` for an isothermal one."""
    return HELD if side.kind == "isothermal" else side.exchange


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
        along = []
        across = []
        capacity = []
        for layer in section.layers:
            material = section.material_of(layer.name)
            conductivity_factor = float(material.conductivity_law.factor(section.ambient))
            capacity_factor = float(material.specific_heat_law.factor(section.ambient))
            k_r = material.conductivity
            k_z = k_r if material.conductivity_z is None else material.conductivity_z
            along.append(k_r * conductivity_factor)
            across.append(k_z * conductivity_factor)
            capacity.append(material.heat_capacity * capacity_factor)
        return cls(
            edges=np.array(section.layer_edges),
            along=np.array(along),
            across=np.array(across),
            capacity=np.array(capacity),
            bottom=_exchange(section.bottom),
            top=_exchange(section.top),
            endless=section.bottom.kind == "open",
        )

    @cached_property
    def slowest(self) -> float:
        """Slowest rate in 1/s at which heat leaves, uniform in the plane; 0 where the lowest layer has no bottom.

        There g changes its sign: below it is positive, to `STEP` of it.
        """
        if self.endless:
            return 0.0
        low, high = RATES
        # 0.01: step of the logarithm of the rate
        rate = np.geomspace(low, high, int(np.log(high / low) / 0.01))
        middle = self.edges[:1] / 2 + self.edges[-1:] / 2
        spread = Spread(middle, np.ones(1), np.zeros(1), 0.0)
        g = self.green(np.array([1e-3]), np.asarray(-rate, dtype=complex), spread, spread)
        negative = g[:, 0].real < 0
        first = int(negative.argmax())
        return float(rate[max(first - 1, 0)])

    def green(self, k: Array, s: Complex, heated: Spread, read: Spread) -> Complex:
        """g(k) in K m^2/W between the heights of two parts, shape (frequencies, k), without their extent in the plane.

        k [shape (n,), 1/m], s [shape (frequencies,), 1/s]
        """
        chunks = [s[i : i + CHUNK] for i in range(0, len(s), CHUNK)]
        return np.concatenate([self._green(k, chunk, heated, read) for chunk in chunks])

    def _green(self, k: Array, s: Complex, heated: Spread, read: Spread) -> Complex:
        lowest, highest = self.edges[[0, -1]]
        z_heated = np.clip(heated.z, lowest, highest)
        z_read = np.clip(read.z, lowest, highest)
        cuts = np.unique(np.concatenate([self.edges, z_heated, z_read]))
        middles = (cuts[1:] + cuts[:-1]) / 2
        layer = np.searchsorted(self.edges, middles) - 1
        storage = self.capacity[layer] * s[:, None, None]
        square = self.along[layer] * (k**2)[:, None] + storage
        q = np.sqrt(square / self.across[layer])  # (frequencies, k, pieces)
        kappa = np.moveaxis(self.across[layer] * q, -1, 0)
        thick = np.moveaxis(q * np.diff(cuts), -1, 0)
        pieces = list(zip(kappa, thick, strict=True))
        *shape, _ = q.shape
        downwards = [kappa[0] if self.endless else np.full(shape, self.bottom, dtype=complex)]
        for piece in pieces:
            downwards.append(_through(downwards[-1], *piece))
        upwards = [np.full(shape, self.top, dtype=complex)]
        ratio = []
        for piece in reversed(pieces):
            ratio.append(_ratio(upwards[-1], *piece))
            upwards.append(_through(upwards[-1], *piece))
        upwards.reverse()
        ratio.reverse()
        total = np.zeros(shape, dtype=complex)
        for z, share in zip(z_heated, heated.weight, strict=True):
            for other, weight in zip(z_read, read.weight, strict=True):
                low, high = np.searchsorted(cuts, sorted((z, other)))
                rise = share * weight / (upwards[low] + downwards[low])
                for factor in ratio[low:high]:
                    rise = rise * factor
                total += rise
        return total

    def over_distance(
        self, s: Complex, heated: Spread, read: Spread, samples: int = DISTANCES
    ) -> tuple[Array, Complex]:
        """Distances r in m, shape (samples,), and G(r) in K/W at each frequency, shape (frequencies, samples)."""
        k = np.geomspace(1 / FARTHEST, 1 / NEAREST, samples)
        step = float(np.log(k[1] / k[0]))
        bias = -0.5 if self.endless else 0.0  # r G and k g of a half space do not decay without it
        offset = fhtoffset(step, mu=0, bias=bias)
        r = np.exp(offset) / k[::-1]
        variance = heated.sigma**2 + read.sigma**2
        smooth = np.exp(-(k**2) * variance / 2)
        height = float(self.edges[-1] - self.edges[0])
        # 1e-3: k times the height of a held stack, below which g(k) is g(0) to 1e-6
        uniform = 0.0 if self.endless else 1e-3 / height
        least = np.exp(-(TAIL_OF_GAUSS**2))
        first = int(np.searchsorted(k, uniform))
        last = int(np.searchsorted(-smooth, -least))
        g = np.zeros((len(s), samples), dtype=complex)
        g[:, first:last] = self.green(k[first:last], s, heated, read)
        g[:, :first] = g[:, first, None]
        g *= k * smooth / (2 * np.pi)
        real, imaginary = fht(np.stack([g.real, g.imag]), step, 0, offset, bias)
        G = real + 1j * imaginary
        return r, G / r

    def over_section(self, s: Complex, half_width: float, heated: Spread, read: Spread) -> Complex:
        """Rise in K per W/m of ``read`` by ``heated``, two lines in a section with insulated sides, at each frequency.

        half_width [m]
        """
        sigma = np.hypot(heated.sigma, read.sigma)
        highest = TAIL_OF_GAUSS / sigma * np.sqrt(2)
        count = int(np.ceil(highest * 2 * half_width / np.pi))
        k = np.asarray(np.pi * np.arange(count + 1) / (2 * half_width), dtype=float)
        k[0] = k[1] * 1e-6  # the mean over the section; 0 itself would divide 0 by 0 at rest
        shares = np.full(k.size, 1 / half_width)
        shares[0] /= 2
        for spread in (heated, read):
            phases = k[:, None] * (spread.lanes + half_width)
            smooth = np.exp(-((k * spread.sigma) ** 2) / 2)
            shares = shares * np.cos(phases).mean(axis=1) * smooth
        return self.green(k, s, heated, read) @ shares


def _through(load: Complex, kappa: Complex, thick: Complex) -> Complex:
    """Admittance at the near side of a layer with ``load`` at its far side; ``thick`` is q d."""
    tangent = np.tanh(thick)
    return kappa * (load + kappa * tangent) / (kappa + load * tangent)


def _ratio(load: Complex, kappa: Complex, thick: Complex) -> Complex:
    """Rise at the far side of a layer over that at its near side."""
    fade = np.exp(-thick)
    inverse_cosh = 2 * fade / (1 + fade**2)
    loaded = 1 + load / kappa * np.tanh(thick)
    return inverse_cosh / loaded
