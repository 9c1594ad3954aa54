"""All fixed points of one laser setting, with their stability."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thermofem.arrays import Array, NDArray
from thermofem.models import ThermalModel

from ..arguments import check_detuning, check_power, check_ring, one_laser
from ..heaters import constant
from ..resonator import RingResonator, origin
from ..thermal import Compact, attributes, compact, trusted

if TYPE_CHECKING:
    import xarray as xr

    from ..kernels.equations import Rates
    from ..kernels.kinds import Curve, Static, Thermal


@one_laser
def steady_states(
    ring: RingResonator,
    model: ThermalModel,
    *,
    power: float,
    detuning: float = 0.0,
    heaters: Mapping[str, float] | None = None,
    heated: str | None = None,
    read: str | None = None,
) -> xr.Dataset:
    """Return every fixed point at one power and detuning, and whether it is stable.

        P = U (gamma^2 + D^2)/(2 gamma_e),     D = -(w0/n0) [(dn/dT) dT + S(N)] - 2 pi detuning
        b N^2 + (1 - a k) N - k = 0,  k = tau0 g_TPA U^2;     dT = R_th P_abs(U, N), or what the model says at rest

    For an energy U all but the laser is explicit. The fixed points of one power are then one smooth curve, the tilted
    resonance, which is cut at its turning points into pieces that hold a detuning at most once: none is missed. Their
    place depends on R_th alone, their stability on the poles.

    Parameters
    ----------
    ring : RingResonator
    model : ThermalModel
        as for `simulate`: a Foster network, a StateSpace with at most 500 states, an OutputMap over one, or Quadratic.
    power : float, W
        in the bus waveguide, larger than 0.
    detuning : float, Hz
        laser minus cold resonance.
    heaters : mapping of name to float, W, optional
        constant power in further inputs of a linear model, as for `simulate`; so are ``heated`` and ``read``.

    Returns
    -------
    xarray.Dataset
        over branch, by increasing energy: energy (J), carriers (1/m^3), delta_T (K), drop, through and absorbed (W),
        growth_rate (1/s, the largest real part of the eigenvalues), frequency (Hz, of the eigenvalue with that real
        part; 0 if it is real) and regime:
        "stable", no growing mode; "saddle", an odd number of them, as on the middle branch of a bistability;
        "unstable focus", two or more and the fastest of them oscillates; "unstable node", it does not.

    Raises
    ------
    InputError
        power or detuning out of range, or a model that is not small, not passive, or without a steady state at the
        power.

    Tested against the cubic of a ring without two-photon absorption: energies to 1e-10, and all three fixed points down
    to 1e-9 beyond the detuning at which bistability begins. The static rise of a quadratic model is a Chebyshev series
    through its steady states, exact to 1e-12.

    Source: Borghi et al., Opt. Express 29, 4363 (2021), Eqs. 1 and 2.1-2.5, with 2 gamma_e for both buses.

    >>> import coupled, thermofem as th
    >>> model = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    >>> states = coupled.steady_states(coupled.borghi2021(), model, power=5e-3, detuning=-32e9)
    >>> for energy, regime in zip(states.energy.values, states.regime.values):
    ...     print(f"{energy * 1e15:.3f} fJ, {regime}")
    8.581 fJ, stable
    15.551 fJ, saddle
    21.217 fJ, unstable focus
    """
    import xarray as xr

    from thermofem.data import dataset

    check_ring(ring)
    power = check_power(power)
    detuning = check_detuning(detuning)
    warm = constant(model, heaters, heated, read)
    at = internal(ring, warm.model, absorbable(ring, power))
    U, D = fixed_points(ring, at, power, detuning + warm.turned(ring))
    values = observables(ring, at, U, D, np.full(U.size, power))
    trusted(model, values["delta_T"], at.model.thermal_resistance * values["absorbed"])
    values["delta_T"] = values["delta_T"] + warm.rise
    return xr.Dataset(
        {name: ("branch", v, dataset.describe(name)) for name, v in values.items()},
        attrs=provenance("steady states", ring, at.model)
        | {"input_power": float(power), "detuning": float(detuning), **warm.attributes},
    )


class Internal(NamedTuple):
    """A ring and its heat in internal units."""

    model: Compact
    rates: Rates
    fcd: Array
    thermal: Thermal
    static: Static | Curve


def internal(ring: RingResonator, model: ThermalModel, largest: float) -> Internal:
    """Resolve ring and thermal model, whose static rise is wanted up to ``largest``, the absorbed power in W."""
    from ..kernels import equations as eq
    from .static import at_rest

    small = compact(model)
    rates, fcd = eq.internal_rates(ring)
    return Internal(small, rates, fcd, eq.internal_thermal(small), at_rest(small, largest))


def absorbable(ring: RingResonator, power: float) -> float:
    """Largest power in W that a ring can absorb: that of a ring which absorbs as much as it loses in all other ways.

    P_abs = 2 own U <= 4 gamma_e own P/(own + other)^2 <= gamma_e P/other, with other = gamma_e + gamma_d + gamma_s.
    """
    return power * ring.bus_rate / (ring.linear_rate - ring.loss_rate)


def fixed_points(
    ring: RingResonator, at: Internal, power: float, detuning: float, pieces: Array | None = None
) -> tuple[Array, Array]:
    """U and D, internal units, of every fixed point at a power in W and a detuning in Hz, by increasing energy.

    ``pieces`` are those of `balance.turning_points` for the power and a detuning at least as large, where known.
    """
    from ..kernels import equations as eq
    from . import balance

    shift, rest = eq.internal_detuning(detuning), (eq.internal_pump(ring, power), at.rates, at.fcd, at.static)
    if pieces is None:
        pieces = balance.turning_points(balance.reach(shift, *rest), *rest)
    U, D = balance.fixed_points(shift, *rest, pieces)
    order = np.argsort(U)
    return U[order], D[order]


def observables(ring: RingResonator, at: Internal, U: Array, D: Array, powers: Array) -> dict[str, Any]:
    """Energy, carriers, rise, port powers and stability at fixed points (U, D; internal units), by name, in SI."""
    from ..kernels import equations as eq
    from . import balance, spectrum

    N, _, dT, _, _, gamma, _ = balance.balances(np.ascontiguousarray(U), at.rates, at.fcd, at.static)
    found = [kind_of(spectrum.dense(u, d, *at[1:])) for u, d in zip(U, D, strict=True)]
    coupling, dropped = 2 * ring.bus_rate * eq.NS, 2 * ring.drop_bus_rate * eq.NS
    return {
        "energy": U * eq.FJ,
        "carriers": N * eq.DENSITY,
        "delta_T": dT,
        "drop": dropped * U * eq.UW,
        "through": powers * np.abs(1 - coupling / (gamma - 1j * D)) ** 2,
        "absorbed": eq.absorbed_power(U, N, at.rates) * eq.UW,
        "growth_rate": np.array([growth for growth, _, _ in found]) / eq.NS,
        "frequency": np.array([omega for _, omega, _ in found]) / (2 * np.pi * eq.NS),
        "regime": np.array([regime for _, _, regime in found], dtype=str),
    }


def kind_of(eigenvalues: NDArray[np.complex128]) -> tuple[float, float, str]:
    """Return the largest real part, the angular frequency that goes with it (0 if real), and the kind in words."""
    from .spectrum import REAL

    first = eigenvalues[np.argmax(eigenvalues.real)]
    omega = abs(first.imag) if abs(first.imag) > REAL * abs(first) else 0.0
    growing = int(np.sum(eigenvalues.real > 0))
    if growing == 0:
        regime = "stable"
    elif growing % 2:
        regime = "saddle"
    else:
        regime = "unstable focus" if omega else "unstable node"
    return float(first.real), float(omega), regime


def provenance(kind: str, ring: RingResonator, model: Compact) -> dict[str, Any]:
    """Attributes of a Dataset: its kind, the ring and the thermal network."""
    return origin(kind, ring) | attributes(model)
