"""Steady transmission of a nonlinear ring: all branches against detuning or power, and the path of a slow sweep."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
import xarray as xr

from thermofem import Foster, InputError, checks
from thermofem.arrays import Array, ArrayLike
from thermofem.models import ThermalModel

from ..circuit.circuit import Circuit
from ..circuit.stationary import low_power_transmission
from ..heaters import warmed, with_ambient
from ..inputs import check_detuning, check_power, check_ring
from ..kernel.rates import absorbed_power
from ..kernel.units import FJ, NS, UW, internal_pump, internal_rates
from ..resonator import RingResonator
from ..thermal import Heaters, trusted
from .balance import (
    SPACING,
    InternalRing,
    absorbable,
    balance,
    carriers,
    farthest,
    fixed_points,
    internal_ring,
    peak,
    tilted,
)
from .steady_states import described, drop_power, eigenvalues, through_power
from .zeros import intervals_in_window, zeros

CURVE_POINTS = 600  # of a curve
Curve: TypeAlias = Callable[[Array], tuple[Array, ...]]


def transmission(
    ring: RingResonator | Circuit,
    model: ThermalModel | None = None,
    *,
    power: Any = None,
    detuning: float | ArrayLike,
    heaters: Heaters = None,
    ambient: float | None = None,
    heated: str | None = None,
    read: str | None = None,
) -> xr.Dataset:
    """Return all fixed points of a ring against detuning or power, or the low-power transmission of a circuit.

    At one power it is the tilted resonance, one smooth curve with a parameter t (U = top/cosh^2 t); at one detuning
    power is a function of the energy, P = U (gamma^2 + D^2)/(2 gamma_e). Either way the curve runs through its folds:
    where it is bistable it has three values.

    Parameters
    ----------
    ring : RingResonator or Circuit
    model : ThermalModel
        as for `steady_states`; a circuit needs it for heaters alone.
    power, detuning : float, or (first, last); W, Hz
        one of them a pair, the range of the curve. For a circuit ``detuning`` are all its detunings, increasing, and
        ``power`` names the laser, ``{"in": 1e-6}``; by default the first one.
    heaters, ambient, heated, read : as of `steady_states`
        the last two of a ring.

    Returns
    -------
    xarray.Dataset
        over point, along the curve from border to border of the range, up to 600: power, detuning, and all that
        `steady_states` gives, with regime "stable", "saddle", "unstable focus" or "unstable node".
        Of a circuit transmission (power at the port per power of the laser), phase (rad) by port, and energy (J per W)
        by ring, over detuning, without carriers and without heat by the light.

    Raises
    ------
    InputError
        as `steady_states`; neither or both of them a pair; light that heats a circuit.

    >>> import coupled, thermofem as th
    >>> model = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    >>> curve = coupled.transmission(coupled.borghi2021(), model, power=5e-3, detuning=(-120e9, 20e9))
    >>> peak = curve.isel(point=int(curve["drop"].values.argmax()))
    >>> print(f"{float(peak['drop']) * 1e3:.2f} mW at {float(peak.detuning) / 1e9:.0f} GHz, {peak.regime.item()}")
    2.20 mW at -92 GHz, stable
    """
    drives = with_ambient(heaters, ambient)
    if isinstance(ring, Circuit):
        return low_power_transmission(ring, detuning, power, model, drives)
    P, nu = _checked(power, detuning)
    swept = P if P.size > 1 else nu
    if P.size + nu.size != 3 or swept[0] >= swept[1]:
        raise InputError(
            f"power = {power!r}, detuning = {detuning!r}: one must be a pair (first, last) with first < last, "
            "the other one number"
        )
    warm = warmed(ring, cast(ThermalModel, model), drives, heated, read)
    at = internal_ring(ring, warm.model, absorbable(ring, P[-1]))
    turned = warm.turned(ring)
    U, D, powers, warm_detunings = _in_range(*_curve(ring, at, P, nu + turned), P, nu + turned)
    detunings = warm_detunings - turned
    points = described("transmission", ring, model, at, U, D, powers, "point", power=powers, detuning=detunings)
    points["delta_T"].values += warm.rise
    return points.assign_attrs(warm.attributes)


class PortCurve(NamedTuple):
    """Curve of all fixed points at the ports, without their stability: what a fit computes many times.

    power [W], detuning [Hz], drop, through [W]: shape (points,), those of `transmission`.
    """

    power: Array
    detuning: Array
    drop: Array
    through: Array


def port_curve(ring: RingResonator, model: Foster, *, power: ArrayLike, detuning: ArrayLike) -> PortCurve:
    """Return the powers at both ports along the curve of `transmission`, whose arguments it takes."""
    P, nu = _checked(power, detuning)
    at = internal_ring(ring, model, absorbable(ring, P[-1]))
    U, D, powers, detunings = _in_range(*_curve(ring, at, P, nu), P, nu)
    gamma = balance(U, at).gamma
    return PortCurve(powers, detunings, drop_power(ring, U), through_power(ring, D, gamma, powers))


def _curve(ring: RingResonator, at: InternalRing, P: Array, nu: Array) -> tuple[Curve, float, float]:
    """The curve of all fixed points at one power or at one detuning, and the first and last value of its parameter s.

    s is t of the tilted resonance at one power, log U at one detuning. The curve is a function of s, shape (n,): U, D,
    power (W), detuning (Hz) and a function that vanishes at the folds, over the range of the swept quantity.
    """
    shifts = 2 * np.pi * NS * nu
    unit = internal_pump(ring, 1.0)
    weak = internal_pump(ring, P[0])
    strong = internal_pump(ring, P[-1])
    faint, top = peak([weak, strong], at).tolist()
    end = farthest(float(np.abs(shifts).max()), top, at)

    def tilt(t: Array) -> tuple[Array, ...]:
        U, D, shift, slope = tilted(t, strong, top, at)
        return U, D, np.full(U.size, P[0]), shift / (2 * np.pi * NS), slope

    def line(s: Array) -> tuple[Array, ...]:
        U = np.exp(s)
        here = balance(U, at)
        D = here.shift - shifts[0]
        square = here.gamma**2 + D**2
        half_slope = here.gamma * here.gamma_slope + D * here.shift_slope  # d square/dU, halved
        rises = 1 + 2 * U * half_slope / square  # d log P/d log U
        return U, D, U * square / unit**2, np.full(s.size, nu[0]), rises

    if P.size == 1:
        return tilt, -end, end
    return line, float(np.log(faint / np.cosh(end) ** 2)), float(np.log(top))


def power_for_drop(ring: RingResonator, model: ThermalModel, *, drop: ArrayLike, detuning: ArrayLike) -> Array:
    """Return the bus power (W) that gives a steady drop power: the inverse transmission, which is single-valued.

        U = P_drop/(2 gamma_drop),     P = U [gamma(U)^2 + D(U)^2]/(2 gamma_e)

    It is explicit on all branches, so measured sweeps, bistable or not, can be fitted by least squares in ln P.
    The result has the broadcast shape of ``drop`` and ``detuning``.

    Parameters
    ----------
    ring : RingResonator
    model : ThermalModel
        as for `steady_states`; only its static response matters.
    drop : array, W
        larger than 0.
    detuning : array, Hz
        broadcast against ``drop``.

    Raises
    ------
    InputError
        a drop power that is not positive, a detuning or a model as for `steady_states`.
    """
    check_ring(ring)
    powers, nu = np.broadcast_arrays(checks.numbers("drop", drop), checks.numbers("detuning", detuning))
    for value in (powers.min(), powers.max()):
        check_power(value, "drop")
    check_detuning(float(nu.ravel()[np.abs(nu).argmax()]))
    checks.positive("drop_rate of the ring", ring.drop_bus_rate, unit="1/s", hint="it has no drop port")
    U = powers.ravel() / (2 * ring.drop_bus_rate) / FJ
    rates, _ = internal_rates(ring)
    N = carriers(U, rates)[0]
    largest = float(absorbed_power(U, N, rates).max()) * UW
    at = internal_ring(ring, warmed(ring, model).model, largest)
    linear = at.model.thermal_resistance * largest
    trusted(model, at.model.steady_rise(largest), linear)
    here = balance(U, at)
    D = here.shift - 2 * np.pi * NS * nu.ravel()
    power = U * (here.gamma**2 + D**2) / internal_pump(ring, 1.0) ** 2
    return np.asarray(power).reshape(powers.shape)


def sweep(
    ring: RingResonator,
    model: ThermalModel,
    *,
    power: float | ArrayLike,
    detuning: float | ArrayLike,
) -> xr.Dataset:
    """Follow the fixed point of a ring while power or detuning changes slowly (quasi-static sweep, with hysteresis).

    The ring stays on its branch, the part of the curve of all fixed points between two folds. Where the branch ends at
    a fold, the ring jumps to the stable fixed point nearest in log U. Where the branch becomes unstable at a
    Hopf point the ring begins to pulse; the sweep continues on the unstable fixed point, with its kind in regime.
    `simulate` with a waveform computes the pulses.

    Parameters
    ----------
    ring : RingResonator
    model : ThermalModel
        as for `steady_states`.
    power, detuning : float or array, W, Hz
        one of them the steps in the order in which they are taken, up, down, or up and down again.

    Returns
    -------
    xarray.Dataset
        over step: power, detuning, all that `steady_states` gives, and jumped, whether the ring left its branch.

    Raises
    ------
    InputError
        as `steady_states`; not exactly one of them an array.
    """
    check_ring(ring)
    P, nu = _checked(power, detuning)
    if (P.size > 1) == (nu.size > 1):
        raise InputError("one of power and detuning must be an array of steps, the other one number")
    warm = warmed(ring, model)
    at = internal_ring(ring, warm.model, absorbable(ring, float(P.max())))
    steps = max(P.size, nu.size)
    P = np.broadcast_to(P, steps)
    nu = np.broadcast_to(nu, steps)
    pump = internal_pump(ring, 1.0) * np.sqrt(P)
    U, D, step = fixed_points(pump, 2 * np.pi * NS * nu, at)
    stable = eigenvalues(U, D, at).real.max(axis=1) < 0
    curve, *_ = _curve(ring, at, np.unique(P), np.unique(nu))
    tilt = np.sqrt(np.maximum(peak(pump[:1], at) / U, 1))
    place = np.log(U) if np.ptp(P) else np.copysign(np.arccosh(tilt), D)
    intervals = int(np.ceil(np.ptp(place) / SPACING))
    grid = np.linspace(place.min(), place.max(), intervals + 2)
    folds, _ = zeros(lambda s, _: curve(s)[4], grid)
    branch = np.searchsorted(folds, place)
    path: list[int] = []
    jumped = np.zeros(steps, dtype=bool)
    for k in range(steps):
        here = np.flatnonzero(step == k)
        lasting = here[stable[here]] if stable[here].any() else here
        before = path[-1] if path else lasting[0]
        same = here[branch[here] == branch[before]]
        jumped[k] = not same.size
        nearest = np.abs(np.log(U[lasting] / U[before])).argmin()
        path.append(lasting[nearest] if jumped[k] else same[0])
    further = {"power": P, "detuning": nu, "jumped": jumped}
    return described("slow sweep", ring, model, at, U[path], D[path], P, "step", **further).assign_attrs(warm.doubts)


def _in_range(curve: Curve, low: float, high: float, P: Array, nu: Array) -> tuple[Array, ...]:
    """Points of a curve in the range of its power or detuning, both ends included: U, D, power (W), detuning (Hz)."""
    by_power = P.size > 1
    row = 2 if by_power else 3
    ends = P if by_power else nu
    grid = np.linspace(low, high, CURVE_POINTS)

    def share(s: Array) -> Array:
        return (curve(s)[row] - ends[0])[None] / np.ptp(ends)

    parts = intervals_in_window(share, grid)
    lengths = np.diff(parts, axis=1)[:, 0]
    spread = CURVE_POINTS - 2 * len(parts)
    counts = 2 + (spread * lengths / lengths.sum()).astype(int)
    s = np.concatenate([np.linspace(*part, count) for part, count in zip(parts, counts, strict=True)])
    values = curve(s)[:4]
    swept = values[row]
    border = np.isin(s, parts)
    nearest = np.abs(swept[border, None] - ends).argmin(axis=1)
    swept[border] = ends[nearest]  # to the last digit
    return values


def _checked(power: float | ArrayLike, detuning: float | ArrayLike) -> list[Array]:
    """Check powers and detunings, one number or several of each; returns them as arrays."""
    checked = []
    for name, numbers, check in (("power", power, check_power), ("detuning", detuning, check_detuning)):
        values = checks.array(name, numbers)
        for k, value in enumerate(values):
            check(value, f"{name}[{k}]" if values.size > 1 else name)
        checked.append(values)
    return checked
