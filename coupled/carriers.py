"""Free-carrier recombination, with a constant lifetime or through one trap level; decay curves and their fit."""

import math
from collections.abc import Collection
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, get_args

import numpy as np
import xarray as xr
from scipy.optimize import least_squares

from thermofem import checks, dataset
from thermofem.arrays import Array, ArrayLike
from thermofem.data.variables import in_si

SHORTEST = 1e-15  # s: faster than any recombination, and its inverse is far from overflow
FARTHEST = 690.0  # of a logarithm: the largest number
UNITS = {  # of the fields of all laws
    "tau": "s", "tau_n": "s", "tau_p": "s", "intrinsic_density": "1/m^3", "hole_density": "1/m^3", "trap_energy": "eV",
    "thermal_energy": "eV",
}  # fmt: skip
GRID, SEARCHES = 24, 4  # lifetimes on each axis where searches may begin; how many do


@dataclass(frozen=True)
class ConstantLifetime:
    """Recombination with a constant lifetime, dN/dt = -N/tau, as at low density or when carriers are swept out.

    Parameters
    ----------
    tau : float, s

    >>> float(ConstantLifetime(10e-9).lifetime(1e23))
    1e-08
    """

    tau: float
    a: ClassVar[float] = 0.0
    b: ClassVar[float] = 0.0

    def __post_init__(self) -> None:
        checks.plain(self)
        hint = "lifetimes are in s (did you mean 10e-9 for 10 ns?)"
        checks.between("tau", self.tau, SHORTEST, 0.1, unit="s", hint=hint)

    @property
    def tau0(self) -> float:
        """The lifetime tau in s."""
        return self.tau

    def lifetime(self, density: ArrayLike) -> Array:
        """The lifetime tau in s, as an array of the shape of ``density``."""
        return np.full(checks.numbers("density", density).shape, float(self.tau))


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
        hint = "lifetimes are in s (did you mean 35e-9 for 35 ns?)"
        for name in ("tau_n", "tau_p"):
            checks.between(name, getattr(self, name), SHORTEST, 0.1, unit="s", hint=hint)
        hint = "densities are in 1/m^3 (1e15 cm^-3 is 1e21)"
        for name in ("intrinsic_density", "hole_density"):
            checks.between(name, getattr(self, name), 1e10, 1e28, unit="1/m^3", hint=hint)
        checks.between("trap_energy", self.trap_energy, -2, 2, unit="eV", hint="counted from the intrinsic Fermi level")
        checks.between("thermal_energy", self.thermal_energy, 1e-4, 0.2, unit="eV", hint="k_B T is 0.0253 eV at 293 K")
        # its exponential is a factor of the densities
        checks.between("trap_energy/thermal_energy", self.trap_energy / self.thermal_energy, -200, 200)

    @property
    def _weighted(self) -> tuple[float, float]:
        """The terms tau_p (n0 + n1) + tau_n (p0 + p1) in s/m^3, and n0 + p0 in 1/m^3."""
        p0 = self.hole_density
        n0 = self.intrinsic_density**2 / p0
        boltzmann = math.exp(self.trap_energy / self.thermal_energy)
        n1 = self.intrinsic_density * boltzmann
        p1 = self.intrinsic_density / boltzmann
        return self.tau_p * (n0 + n1) + self.tau_n * (p0 + p1), n0 + p0

    @property
    def tau0(self) -> float:
        """Lifetime at vanishing carrier density in s."""
        weighted, equilibrium = self._weighted
        return weighted / equilibrium

    @property
    def a(self) -> float:
        """Coefficient a in tau(N) = tau0 (1 + a N)/(1 + b N), in m^3."""
        return (self.tau_p + self.tau_n) / self._weighted[0]

    @property
    def b(self) -> float:
        """Coefficient b in tau(N) = tau0 (1 + a N)/(1 + b N), in m^3."""
        return 1 / self._weighted[1]

    def lifetime(self, density: ArrayLike) -> Array:
        """tau(N) in s at the excess density ``density`` in 1/m^3, shape of ``density``."""
        N = checks.numbers("density", density)
        return np.asarray(self.tau0 * (1 + self.a * N) / (1 + self.b * N))


CarrierLaw = ConstantLifetime | ShockleyReadHall  # of rings: whatever has tau0, a and b, and its fields in UNITS
LAWS: tuple[type[Any], ...] = get_args(CarrierLaw)


def law_with(names: Collection[str]) -> type[Any]:
    """The law that has most of these fields."""
    return max(LAWS, key=lambda law: sum(one.name in names for one in fields(law)))


def carrier_decay(carriers: ShockleyReadHall, initial: float, times: ArrayLike) -> xr.Dataset:
    """Return the carrier density after a short pump pulse, without light.

        dN/dt = -N/tau(N),    t/tau0 = ln(N0/N) + (a - b)/b ln((1 + b N0)/(1 + b N))

    Parameters
    ----------
    carriers : ShockleyReadHall
    initial : float, 1/m^3
        N0, the density that the pulse leaves.
    times : array, s
        increasing, from 0 on.

    Returns
    -------
    xarray.Dataset
        over time (s): carriers (1/m^3) and lifetime (s), tau(N) = -N/(dN/dt) at that instant.

    Raises
    ------
    InputError
        a density or time out of range.

    Exact to round-off: the closed form is inverted by Newton's method in ln N.

    Source: Borghi et al., Opt. Express 29, 4363 (2021), Eq. 1 and Fig. 3.

    >>> import coupled
    >>> found = carrier_decay(coupled.borghi2021().carriers, 1e23, [0, 50e-9, 300e-9])
    >>> print([f"{v * 1e9:.1f} ns" for v in found["lifetime"].values])
    ['57.3 ns', '57.0 ns', '40.9 ns']
    """
    hint = "densities are in 1/m^3 (1e17 cm^-3 is 1e23)"
    N0 = checks.positive("initial", initial, unit="1/m^3", at_most=1e28, hint=hint)
    checks.has("carriers", carriers, "tau0", "lifetime", hint="the .carriers of a ring are needed")
    t = checks.array("times", times, increasing=True, hint="times are in s")
    checks.between("times[0]", t[0], 0, 1, unit="s", hint="times count from the pulse on")
    checks.between("times[-1]", t[-1], 0, 1, unit="s", hint="did you mean 50e-9 for 50 ns?")
    N = _density(t, N0, carriers.tau0, carriers.a, carriers.b)
    columns = {"time": t, "carriers": N, "lifetime": carriers.lifetime(N)}
    law = {name: getattr(carriers, name) for name in ("tau0", "a", "b")}
    attrs = {"kind": "carrier decay", "initial_density": N0, **law}
    return xr.Dataset(dataset.variables("time", columns), attrs=attrs)


@dataclass(frozen=True, eq=False)
class CarrierFit:
    """Result of `fit_carrier_decay`.

    Attributes
    ----------
    carriers : ShockleyReadHall
        with the fitted lifetimes.
    parameters, standard_errors : dict of str to float
        of the fitted "tau0" and "tau_high" (s), the lifetimes at vanishing and at high density, and "initial_density"
        (1/m^3); and of "tau_n" and "tau_p" (s), which follow from these lifetimes at the given trap energy.
    residual : float
        rms of ln(N/N_fit).
    """

    carriers: ShockleyReadHall
    parameters: dict[str, float]
    standard_errors: dict[str, float]
    residual: float


def fit_carrier_decay(data: xr.Dataset, material: ShockleyReadHall) -> CarrierFit:
    """Fit the lifetimes of Shockley-Read-Hall recombination to a measured decay, by least squares in ln N.

    The lifetime changes from tau0 = [tau_p (n0 + n1) + tau_n (p0 + p1)]/(n0 + p0) to tau_n + tau_p around N = n0 + p0,
    which the doping fixes. So a decay determines two numbers, and not the three (tau_n, tau_p, E_t): every trap energy
    in a range fits equally well. E_t is therefore taken from ``material``. The searches start from the best points of a
    grid of lifetimes.

    Parameters
    ----------
    data : xarray.Dataset
        carriers (1/m^3, larger than 0) over time (s).
    material : ShockleyReadHall
        n_i, p0, kT and the fixed trap energy; its lifetimes do not matter.

    Raises
    ------
    InputError
        a variable missing or not positive, or a decay that no tau_n, tau_p > 0 has at the trap energy given.

    Source: Borghi et al., Opt. Express 29, 4363 (2021), Fig. 3(b) and Appendix B, whose E_t is a fit as well.
    """
    checks.instance("material", material, ShockleyReadHall, hint="coupled.borghi2021().carriers is one")
    data = in_si("data", data)
    t = checks.array("data.time", data["time"].values, increasing=True, hint="times are in s")
    N = checks.array("data.carriers", data["carriers"].values)
    checks.shape("carriers", N, t.shape)
    checks.positive("the least of data.carriers", N.min(), unit="1/m^3")
    best = _least_squares(t, N, material.b)
    fitted = np.exp(best.x)  # N0, tau0, tau_high
    p0 = material.hole_density
    n0 = material.intrinsic_density**2 / p0
    boltzmann = np.exp(material.trap_energy / material.thermal_energy)
    electrons = n0 + material.intrinsic_density * boltzmann
    holes = p0 + material.intrinsic_density / boltzmann
    equilibrium = n0 + p0
    slopes = np.linalg.inv([[holes / equilibrium, electrons / equilibrium], [1.0, 1.0]])  # of (tau_n, tau_p)
    tau_n, tau_p = (slopes @ fitted[1:]).tolist()
    if min(tau_n, tau_p) <= 0:
        raise checks.InputError(
            f"trap_energy = {material.trap_energy:g} eV gives no positive lifetimes for this decay (tau0 = "
            f"{fitted[1]:.3g} s, tau_high = {fitted[2]:.3g} s)",
            "replace(material, trap_energy=..)",
        )
    by_values = np.vstack([np.eye(3), np.column_stack([np.zeros(2), slopes])])
    by_logarithms = by_values * fitted
    variance = 2 * best.cost / (t.size - 3)
    covariance = np.linalg.inv(best.jac.T @ best.jac) * variance
    errors = np.sqrt(np.einsum("ij,jk,ik->i", by_logarithms, covariance, by_logarithms))
    names = ("initial_density", "tau0", "tau_high", "tau_n", "tau_p")
    return CarrierFit(
        replace(material, tau_n=tau_n, tau_p=tau_p),
        dict(zip(names, [*fitted.tolist(), tau_n, tau_p], strict=True)),
        dict(zip(names, errors.tolist(), strict=True)),
        float(np.sqrt(2 * best.cost / t.size)),
    )


def _least_squares(t: Array, N: Array, b: float) -> Any:
    """The least-squares result for ln(N0, tau0, tau_high) of lowest cost, of searches from a grid of lifetimes."""

    def misfit(x: Array) -> Array:
        N0, low, high = np.exp(np.clip(x, -FARTHEST, FARTHEST))
        with np.errstate(all="ignore"):
            model = _density(t - t[0], N0, low, high / low * b, b)
            errors = np.log(model / N)
        return np.nan_to_num(errors, nan=FARTHEST, posinf=FARTHEST, neginf=-FARTHEST)

    tau = np.log((t[-1] - t[0]) * np.geomspace(1e-4, 1e4, GRID))
    grid = [np.array([np.log(N[0]), low, high]) for low in tau for high in tau]
    starts = sorted(grid, key=lambda x: float(np.sum(misfit(x) ** 2)))[:SEARCHES]
    tries = [least_squares(misfit, x, xtol=1e-14, ftol=1e-14, gtol=1e-14, x_scale="jac") for x in starts]
    best = min(tries, key=lambda result: float(result.cost))
    if np.linalg.matrix_rank(best.jac) < 3:
        raise checks.InputError("data.carriers does not decay, or does not show two lifetimes: they cannot be told")
    return best


def _density(t: Array, N0: float, tau0: float, a: float, b: float) -> Array:
    """Density N (1/m^3) at times t after N(0) = N0, by Newton's method in u = ln(N/N0), which is monotone."""

    def slower(N: Any) -> Any:  # (a - b)/b ln(1 + b N), whose limit for b = 0 is a N
        return (a - b) / b * np.log1p(b * N) if b else a * N

    u = -t / (tau0 * max((1 + a * N0) / (1 + b * N0), 1))  # the decay at the longest lifetime
    for _ in range(100):
        N = N0 * np.exp(u)
        f = u + slower(N) - slower(N0) + t / tau0
        step = f / (1 + (a - b) * N / (1 + b * N))
        u = u - step
        if np.max(np.abs(step)) < 1e-14 * (1 + np.max(np.abs(u))):
            break
    return np.asarray(N0 * np.exp(u))
