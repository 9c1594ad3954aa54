"""Heat between two rings on one chip, exactly: oxide on silicon over a held bottom, by a Hankel transform.

The core is given the properties of the oxide. With xi the radial wave number, the source F(xi) J0(xi r) of a ring with
radii r1 and r2 is read by its copy at the distance d as F(xi) J0(xi d) (addition theorem, mean over the copy's angle):

    Z_d(s) = 1/(2 pi) int_0^inf xi F(xi) F'(xi) J0(xi d) G(xi, s) dxi
    F(xi)  = 2 [r2 J1(xi r2) - r1 J1(xi r1)]/(xi (r2^2 - r1^2))

F' is that of the reader, which may have another radius. G is the mean over the heights of source and reader of Green's
function of -k g'' + (k xi^2 + s rho c) g in the oxide, insulated at its top, over silicon that is held at its bottom.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import j0, j1


@dataclass(frozen=True)
class Stack:
    """Lengths in m, k in W/(m K), c = rho c_p in J/(m^3 K)."""

    radius: float = 7.955e-6
    width: float = 450e-9
    height: float = 220e-9
    cladding: float = 2e-6
    box: float = 2e-6
    substrate: float = 30e-6
    k: float = 1.38
    c: float = 2203 * 703
    k_substrate: float = 130.0
    c_substrate: float = 2330 * 700

    def impedance(self, distance: float, s: float = 0.0, reader: float | None = None) -> float:
        """Z_d(s) in K/W for a real s >= 0 in 1/s; panels much shorter than the shortest wave, 2 pi/(d + 2 r).

        ``reader`` is the radius of the ring that is read, at most the own one; default the same.
        """
        other = self.radius if reader is None else reader
        r2 = self.radius + self.width / 2
        gap = distance - self.radius - other
        # F^2 J0 falls as xi^-3.5 and G as xi^-2: 60/gap leaves less than 1e-9
        edges = np.linspace(0, 60 / gap + 4e7, int((60 / gap + 4e7) * (distance + 2 * r2) / 2) + 2)
        x, w = np.polynomial.legendre.leggauss(8)
        xi = (edges[:-1, None] + np.diff(edges)[:, None] * (x + 1) / 2).ravel()
        weight = (np.diff(edges)[:, None] * w / 2).ravel()
        both = self._shape(xi, self.radius) * self._shape(xi, other)
        return float(np.sum(weight * xi * both * j0(xi * distance) * self._green(xi, s)) / (2 * np.pi))

    def _shape(self, xi: np.ndarray, radius: float) -> np.ndarray:
        """F(xi) of a ring."""
        r1, r2 = radius - self.width / 2, radius + self.width / 2
        return 2 * (r2 * j1(xi * r2) - r1 * j1(xi * r1)) / (xi * (r2**2 - r1**2))

    def _green(self, xi: np.ndarray, s: float) -> np.ndarray:
        """Mean of g over both heights: 2/h^2 int up(z) [int_0^z down(z') dz'] dz / Wronskian; exponentials scaled."""
        q, p = np.sqrt(xi**2 + s * self.c / self.k), np.sqrt(xi**2 + s * self.c_substrate / self.k_substrate)
        b, h, top = self.box, self.height, self.height + self.cladding
        ratio = self.k_substrate * p / (self.k * q * np.tanh(p * self.substrate))  # down'/(q down) at the oxide's foot
        plus, minus = (1 + ratio) / 2, (1 - ratio) / 2  # down = plus e^q(z+b) + minus e^-q(z+b), all times e^-q(b+h)
        x, w = np.polynomial.legendre.leggauss(12)
        total = np.zeros_like(q)
        for z, weight in zip(h * (x + 1) / 2, h * w / 2, strict=True):
            up = (np.exp(q * (h - z)) + np.exp(-q * (2 * top - z - h))) / 2  # cosh(q (top - z)) e^-q(top - h)
            rising = plus * (np.exp(q * (z - h)) - np.exp(-q * h))
            falling = minus * (np.exp(-q * (2 * b + h)) - np.exp(-q * (z + 2 * b + h)))
            total += weight * up * (rising + falling) / q
        # k (up down' - up' down), which does not depend on z, taken at the top: k q down'(top) with the same scaling
        wronskian = self.k * q * (plus - minus * np.exp(-2 * q * (top + b)))
        return 2 / h**2 * total / wronskian
