"""Free-carrier recombination: the Shockley-Read-Hall lifetime through one trap level."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thermofem import checks

from .lifetime import SHORTEST

_TIME_HINT = checks.Hint("lifetimes are in s (did you mean 35e-9 for 35 ns?)")
MOST_TURN = 200.0  # of trap_energy/thermal_energy: its exponential is a factor of the densities
_DENSITY_HINT = "densities are in 1/m^3 (1e15 cm^-3 is 1e21)"


@dataclass(frozen=True)
class ShockleyReadHall:
    """Carrier lifetime through one trap level, in its low- and high-injection limits and between.

        tau(N) = tau0 (1 + a N) / (1 + b N)
        a = (tau_p + tau_n) / (tau_p (n0 + n1) + tau_n (p0 + p1)),   b = 1 / (n0 + p0)
        tau0 = (tau_p (n0 + n1) + tau_n (p0 + p1)) / (n0 + p0)
        n0 = n_i^2 / p0,   n1 = n_i exp(E/kT),   p1 = n_i exp(-E/kT),   E = E_trap - E_i

    Parameters
    ----------
    tau_n, tau_p : float, s
        characteristic lifetimes of electrons and of holes: 1/(trap density x capture cross-section x velocity).
    intrinsic_density : float, 1/m^3
        n_i.
    hole_density : float, 1/m^3
        p0, the holes at equilibrium (p-type material).
    trap_energy : float, eV
        E, the trap level above the intrinsic Fermi level.
    thermal_energy : float, eV
        k_B T.

    Raises
    ------
    InputError
        a number that is not finite, not positive, or out of the range of its unit.

    Source: Shockley and Read, Phys. Rev. 87, 835 (1952), as in Borghi et al., Opt. Express 29, 4363 (2021), Eqs. 1, 4.
    """

    tau_n: float
    tau_p: float
    intrinsic_density: float
    hole_density: float
    trap_energy: float
    thermal_energy: float

    def __post_init__(self) -> None:
        checks.plain(self)
        for name in ("tau_n", "tau_p"):
            checks.positive(name, getattr(self, name), unit="s", at_most=0.1, hint=_TIME_HINT)
            checks.between(name, getattr(self, name), SHORTEST, 0.1, unit="s", hint=_TIME_HINT)
        for name in ("intrinsic_density", "hole_density"):
            checks.between(name, getattr(self, name), 1e10, 1e28, unit="1/m^3", hint=_DENSITY_HINT)
        checks.between("trap_energy", self.trap_energy, -2, 2, unit="eV", hint="counted from the intrinsic Fermi level")
        checks.between("thermal_energy", self.thermal_energy, 1e-4, 0.2, unit="eV", hint="k_B T is 0.0253 eV at 293 K")
        checks.between("trap_energy/thermal_energy", self.trap_energy / self.thermal_energy, -MOST_TURN, MOST_TURN)

    @property
    def _weighted(self) -> tuple[float, float]:
        """tau_p (n0 + n1) + tau_n (p0 + p1) in s/m^3, and n0 + p0 in 1/m^3."""
        n0, p0 = self.intrinsic_density**2 / self.hole_density, self.hole_density
        boltzmann = math.exp(self.trap_energy / self.thermal_energy)
        n1, p1 = self.intrinsic_density * boltzmann, self.intrinsic_density / boltzmann
        return self.tau_p * (n0 + n1) + self.tau_n * (p0 + p1), n0 + p0

    @property
    def tau0(self) -> float:
        """Lifetime at vanishing carrier density in s."""
        weighted, equilibrium = self._weighted
        return weighted / equilibrium

    @property
    def a(self) -> float:
        """Coefficient of N in the numerator in m^3."""
        return (self.tau_p + self.tau_n) / self._weighted[0]

    @property
    def b(self) -> float:
        """Coefficient of N in the denominator in m^3."""
        return 1 / self._weighted[1]

    def lifetime(self, density: ArrayLike) -> NDArray[np.float64]:
        """tau(N) in s at the excess density ``density`` in 1/m^3, shape of ``density``."""
        N = checks.numbers("density", density)
        return np.asarray(self.tau0 * (1 + self.a * N) / (1 + self.b * N))
