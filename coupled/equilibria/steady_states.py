"""All fixed points at given laser settings, and the eigenvalues of the Jacobian there.

The equations are invariant under the phase of the field, so a = sqrt(U) at a fixed point. Internal units: `balance`.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from thermofem.arrays import Array, ArrayLike, Complex
from thermofem.data import dataset
from thermofem.models import ThermalModel

from ..circuit.circuit import Circuit
from ..circuit.stationary import circuit_steady_states, leading
from ..heaters import ConstantHeating, warmed, with_ambient
from ..inputs import check_detuning, check_power
from ..kernel.integrator import CAP
from ..kernel.units import DENSITY, FJ, NS, UW, internal_detuning, internal_pump
from ..resonator import RingResonator
from ..thermal import Heaters, provenance, trusted
from .balance import InternalRing, absorbable, balance, fixed_points, internal_ring

AT_ONCE = 20_000  # Jacobians in one call of LAPACK
# of the sizes of the states, for derivatives: errors of 1e-6 by truncation and 1e-10 by round-off
DIFFERENCE_STEP = 1e-3


def states(U: Array, D: Array, ring: InternalRing) -> tuple[Array, Array]:
    """Return the states [Re a, Im a, N, x], shape (m, 3 + n), with real fields, and the detunings (rad/ns), (m,)."""
    at = balance(U, ring)
    phase_zero = np.zeros(np.shape(U))
    light = np.stack([np.sqrt(U), phase_zero, at.N], axis=-1)
    heat = ring.heat.states(at.P_abs)
    return np.concatenate([light, heat], axis=-1), at.shift - D


def jacobian(y: Array, detuning: float, ring: InternalRing) -> Array:
    """Return the Jacobian d(dy/dt)/dy, shape (3 + n, 3 + n), at a state y, (3 + n,), and a detuning in rad/ns."""
    ring.problem.set_detuning(detuning)
    return ring.problem.slopes(y)[1]


def eigenvalues(U: Array, D: Array, ring: InternalRing) -> Complex:
    """Return the eigenvalues of the Jacobians at m fixed points (U, D), shape (m, 3 + n), in 1/ns."""
    values = []
    for k in range(0, max(len(U), 1), AT_ONCE):
        part = slice(k, k + AT_ONCE)
        pairs = zip(*states(U[part], D[part], ring), strict=True)
        J = np.array([jacobian(y, detuning, ring) for y, detuning in pairs])
        values.append(np.linalg.eigvals(J).astype(complex))
    return np.concatenate(values)


def first_lyapunov(
    jacobian: Callable[[Array], Array], x: Array, size: Array, omega: float, unit: int
) -> tuple[float, Complex]:
    """Return the first Lyapunov coefficient g and all eigenvalues at a Hopf point.

    With A the Jacobian there, A q = i w q, A^T p = -i w p, <p, q> = 1, and B and C the second and third derivatives of
    the right-hand side,

        g = Re [<p, C(q, q, q*)> - 2 <p, B(q, A^-1 B(q, q*))> + <p, B(q*, (2 i w - A)^-1 B(q, q))>]/2
        dr/dt = growth r + g r^3,     x = x_0 + r (q exp(i w t) + q* exp(-i w t))

    so that for g < 0 (supercritical) the ring begins to pulse with an amplitude like the root of the distance, and for
    g > 0 (subcritical) it jumps to a large pulse and has hysteresis. Only the Jacobian is differentiated, by central
    differences along Re q and Im q: B(q, .) = J'(Re q) + i J'(Im q), C(q, q*, .) = J''(Re q) + J''(Im q).

    jacobian: at a state, shape (n,) to (n, n).
    x, size [shape (n,)]: the fixed point, and sizes of its states for the differences.
    omega: near which the eigenvalue i w is looked for.
    unit: index of the state whose amplitude is r: q is scaled to |q[unit]| = 1/2.

    Source: Kuznetsov, Elements of Applied Bifurcation Theory (2004), Section 5.4.
    """
    A = jacobian(x)
    values, vectors = np.linalg.eig(A.astype(complex))
    k = int(np.abs(values - 1j * omega).argmin())
    amplitude = 2 * vectors[unit, k]
    q = vectors[:, k] / amplitude
    p = np.linalg.inv(vectors)[k] * amplitude  # a row, conjugate
    h = DIFFERENCE_STEP / np.max(np.abs(q) / size)
    first = np.zeros(A.shape, dtype=complex)
    second = np.zeros(A.shape)
    for part, factor in ((q.real, 1), (q.imag, 1j)):
        ahead = jacobian(x + h * part)
        behind = jacobian(x - h * part)
        first += factor * (ahead - behind) / (2 * h)
        second += (ahead - 2 * A + behind) / h**2
    mean = np.linalg.solve(A.astype(complex), first @ q.conj())
    twice = 2j * values[k].imag * np.eye(x.size) - A
    double = np.linalg.solve(twice, first @ q)
    g = p @ (second @ q - 2 * first @ mean + first.conj() @ double)
    return float(g.real) / 2, values


class Fixed(NamedTuple):
    """The fixed points at one laser setting, by increasing energy, with growth rate and angular frequency."""

    every: Array  # rows U, N, dT and the longest step beside it in ns
    growth: Array  # 1/ns
    omega: Array  # rad/ns

    @property
    def stable(self) -> Array:
        """The stable fixed points, rows (U, N, dT) in internal units."""
        return self.every[self.growth <= 0, :3]


def survey(pump: ArrayLike, detuning: ArrayLike, ring: InternalRing) -> list[Fixed]:
    """Return the fixed points and their stability, one `Fixed` for each setting (sqrt(fJ)/ns, rad/ns) of shape (m,)."""
    U, D, cell = fixed_points(pump, detuning, ring)
    values = eigenvalues(U, D, ring)
    here = balance(U, ring)
    growth, omega, growing = leading(values)
    sizes = np.where(values.real > 0, np.abs(values), 0.0)
    unstable = growing > 0
    fastest = np.where(unstable, sizes.max(axis=1), 1.0)
    longest = np.where(unstable, CAP / fastest, np.inf)
    every = np.column_stack([U, here.N, here.dT, longest])
    begins = np.searchsorted(cell, range(cell[-1] + 1))
    ends = pairwise([*begins, cell.size])
    return [Fixed(every[a:b], growth[a:b], omega[a:b]) for a, b in ends]


def steady_states(
    ring: RingResonator | Circuit,
    model: ThermalModel,
    *,
    power: Any,
    detuning: float = 0.0,
    heaters: Heaters = None,
    ambient: float | None = None,
    heated: str | None = None,
    read: str | None = None,
    starts: int = 100,
    seed: int = 0,
) -> xr.Dataset:
    """Return the fixed points and their stability at one power and detuning: all of a ring, those found of a circuit.

        P = U (gamma^2 + D^2)/(2 gamma_e),     D = -(w0/n0) [(dn/dT) dT + S(N)] - 2 pi detuning
        b N^2 + (1 - a k) N - k = 0,  k = tau0 g_TPA U^2;     dT = R_th P_abs(U, N), or the steady rise of the model

    N, dT and D are explicit functions of the energy U. At one power the fixed points lie on one smooth curve, the
    tilted resonance; it is cut at its folds into pieces on which the detuning is monotone, so none is missed. U, N and
    dT depend on R_th alone, the stability also on the time constants.

    Parameters
    ----------
    ring : RingResonator or Circuit
        a circuit without delays, whose lit lasers have one frequency.
    model : ThermalModel
        as for `simulate`: a Foster network, a StateSpace with at most 500 states, an OutputMap over one, or Quadratic.
    power : float, W
        in the bus waveguide, larger than 0; for a circuit a mapping from laser name.
    detuning : float, Hz
        laser minus cold resonance, or minus the reference of a circuit.
    heaters : mapping of name to float, W, or to `Volts` or `Amperes`, optional
        constant drives of further inputs of a linear model, as for `simulate`; so are ``heated`` and ``read``.
    ambient : float, K, optional
        temperature of the ambient above that of the geometry: at rest all of it is in delta_T, whatever the model.
    starts, seed : int
        random starts of Newton's method in a circuit: no method is known that finds all its fixed points.

    Returns
    -------
    xarray.Dataset
        over branch, by increasing energy: energy (J), carriers (1/m^3), delta_T (K), drop, through and absorbed (W),
        growth_rate (1/s, the largest real part of the eigenvalues), frequency (Hz, of the eigenvalue with that real
        part; 0 if it is real) and regime:
        "stable", no growing mode; "saddle", an odd number of them, as on the middle branch of a bistability;
        "unstable focus", two or more and the fastest of them oscillates; "unstable node", it does not.
        Of a circuit over state, by increasing energy: energy, carriers, delta_T and absorbed by ring; output (W) by
        port; growth_rate, frequency and growing, the number of eigenvalues with a positive real part: 0 for a stable
        state.

    Raises
    ------
    InputError
        power or detuning out of range, or a model that is not small, not passive, or without a steady state at the
        power; in a circuit powers that vary, lasers of different frequency, or delays.

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
    drives = with_ambient(heaters, ambient)
    if isinstance(ring, Circuit):
        return circuit_steady_states(ring, model, power, detuning, drives, starts, seed)
    return resting(ring, model, power, detuning, drives, heated, read).states


class Resting(NamedTuple):
    """The fixed points of a ring at one power and detuning: energies and detunings D in internal units, and in SI."""

    warm: ConstantHeating
    internal: InternalRing
    energy: Array
    detuned: Array
    states: xr.Dataset


def resting(
    ring: RingResonator,
    model: ThermalModel,
    power: float,
    detuning: float,
    heaters: Heaters,
    heated: str | None,
    read: str | None,
) -> Resting:
    """Find the fixed points of one ring; arguments and errors as of `steady_states`."""
    power = check_power(power)
    detuning = check_detuning(detuning)
    warm = warmed(ring, model, heaters, heated, read)
    at = internal_ring(ring, warm.model, absorbable(ring, power))
    warm_detuning = internal_detuning(detuning + warm.turned(ring))
    U, D, _ = fixed_points(internal_pump(ring, power), warm_detuning, at)
    points = described("steady states", ring, model, at, U, D, np.full(U.size, power), "branch")
    points["delta_T"].values += warm.rise
    points = points.assign_attrs(warm.attributes, input_power=power, detuning=detuning)
    return Resting(warm, at, U, D, points)


def drop_power(ring: RingResonator, U: Array) -> Array:
    """Power (W) at the drop port of fixed points of energy U (fJ): 2 gamma_d U."""
    return 2 * ring.drop_bus_rate * NS * U * UW


def through_power(ring: RingResonator, D: Array, gamma: Array, powers: Array) -> Array:
    """Power (W) at the through port of fixed points: P |1 - 2 gamma_e/(gamma - i D)|^2, D and gamma in 1/ns, P in W."""
    amplitude = 1 - 2 * ring.bus_rate * NS / (gamma - 1j * D)
    return powers * np.abs(amplitude) ** 2


def described(
    kind: str, ring: RingResonator, model: Any, at: InternalRing, U: Array, D: Array, powers: Array, over: str,
    **further: Array,
) -> xr.Dataset:  # fmt: skip
    """Fixed points (U, D; internal units) at ``powers`` (W) as a Dataset in SI with ``further`` variables.

    Warns where dT exceeds the training of the model.
    """
    here = balance(U, at)
    growth, omega, growing = leading(eigenvalues(U, D, at))
    spiral = np.where(omega > 0, "unstable focus", "unstable node")
    unstable = np.where(growing % 2, "saddle", spiral)
    regime = np.where(growing == 0, "stable", unstable)
    absorbed = here.P_abs * UW
    values = further | {
        "energy": U * FJ,
        "carriers": here.N * DENSITY,
        "delta_T": here.dT,
        "drop": drop_power(ring, U),
        "through": through_power(ring, D, here.gamma, powers),
        "absorbed": absorbed,
        "growth_rate": growth / NS,
        "frequency": omega / (2 * np.pi * NS),
        "regime": regime,
    }
    linear_rise = at.model.thermal_resistance * absorbed
    trusted(model, here.dT, linear_rise)
    return xr.Dataset(dataset.variables(over, values, power="input_power"), attrs=provenance(kind, ring, at.model))
