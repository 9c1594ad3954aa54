"""Transmission of a nonlinear ring: all branches against detuning or power, and the loop that a slow sweep follows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numpy as np
import xarray as xr

from thermofem import Foster, checks
from thermofem.arrays import Array, ArrayLike, NDArray
from thermofem.data import dataset
from thermofem.models import ThermalModel

from ..arguments import check_detuning, check_power, check_ring
from ..circuit.circuit import Circuit
from ..circuit.low_power import low_power_transmission
from ..contradictions import check_geometry
from ..kernel.units import FJ, NS, UW, internal_pump, internal_rates
from ..resonator import RingResonator
from ..thermal import NEEDED, trusted
from .balance import (
    InternalRing,
    absorbable,
    balance,
    carriers,
    energy,
    farthest_s,
    fixed_points,
    internal_ring,
    tilted,
)
from .observables import observables, provenance
from .spectrum import eigenvalues
from .zeros import equidistant, intervals_in_window

POINTS = 600  # of a curve
HALVINGS = 10  # of a step of a sweep, until it is clear which fixed point follows on which
CLEAR = 0.3  # of the gap between two energies, on a logarithmic scale, and of a factor e: what a clear step may change


def transmission(
    ring: RingResonator | Circuit,
    model: ThermalModel | None = None,
    *,
    power: Any = None,
    detuning: float | ArrayLike,
) -> xr.Dataset:
    """Return the curve of all fixed points against detuning or power of a ring, or the low-power one of a circuit.

    At one power it is the tilted resonance, one smooth curve with a parameter s (D = gamma sinh s); at one detuning
    power is a function of the energy, P = U (gamma^2 + D^2)/(2 gamma_e). Either way the curve runs through its folds:
    where it is bistable it has three values.

    Parameters
    ----------
    ring : RingResonator or Circuit
    model : ThermalModel
        as for `steady_states`; none is needed for a circuit.
    power, detuning : float, or (first, last); W, Hz
        one of them a pair, the range of the curve. For a circuit ``detuning`` are all its detunings, increasing, and
        ``power`` names the laser, ``{"in": 1e-6}``; by default the first one.

    Returns
    -------
    xarray.Dataset
        over point, along the curve from border to border of the range, up to 600: power, detuning, and all that
        `steady_states` gives, with regime "stable", "saddle", "unstable focus" or "unstable node".
        Of a circuit transmission (power at the port per power of the laser), phase (rad) by port, and energy (J per W)
        by ring, over detuning, without carriers and heat.

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
    if isinstance(ring, Circuit):
        return low_power_transmission(ring, detuning, power)
    check_ring(ring)
    checks.has("model", model, "dynamics", hint=NEEDED)
    doubts = check_geometry(ring, model)
    P, nu = _ends("power", power), _ends("detuning", detuning)
    at = internal_ring(ring, cast(ThermalModel, model), absorbable(ring, P[-1]))
    if (P.size, nu.size) == (1, 2):
        pump = internal_pump(ring, P[0])
        end = farthest_s(2 * np.pi * NS * float(np.abs(nu).max()), pump, at)

        def curve(s: Array) -> tuple[Array, ...]:
            U, D, shift, _ = tilted(s, pump, at)
            return U, D, np.full(U.size, P[0]), shift / (2 * np.pi * NS)

        U, D, powers, detunings = _in_range(curve, -end, end, 3, nu)
    elif (P.size, nu.size) == (2, 1):
        shift_0 = 2 * np.pi * NS * nu[0]
        weak, strong = (internal_pump(ring, p) for p in P)
        high = float(np.log(energy(0.0, strong, at)))
        low = float(np.log(energy(farthest_s(abs(shift_0), weak, at), weak, at)))

        def curve(s: Array) -> tuple[Array, ...]:
            here = balance(np.exp(s), at)
            D = here.shift - shift_0
            powers = np.exp(s) * (here.gamma**2 + D**2) / internal_pump(ring, 1.0) ** 2
            return np.exp(s), D, powers, np.full(s.size, nu[0])

        U, D, powers, detunings = _in_range(curve, low, high, 2, P)
    else:
        raise checks.InputError("one of power and detuning must be a pair (first, last), the other one number")
    found = _dataset(ring, at, U, D, powers, detunings)
    _trust(model, at, found)
    found.attrs |= provenance("transmission", ring, at.model) | doubts
    return found


def power_for_drop(ring: RingResonator, model: ThermalModel, *, drop: ArrayLike, detuning: ArrayLike) -> Array:
    """Return the bus power (W) that a steady drop power needs: the transmission turned round, which has one value.

        U = P_drop/(2 gamma_drop),     P = U [gamma(U)^2 + D(U)^2]/(2 gamma_e)

    No branch has to be guessed and nothing solved, so that measured loops, bistable or not, are fitted by plain least
    squares in ln P.

    Parameters
    ----------
    ring : RingResonator
    model : ThermalModel
        as for `steady_states`; only its static response matters.
    drop : array, W
        larger than 0.
    detuning : array, Hz
        of a shape that goes with that of ``drop``.

    Raises
    ------
    InputError
        a drop power that is not positive, a detuning or a model as for `steady_states`, shapes that do not go
        together.
    """
    check_ring(ring)
    lights = checks.numbers("drop", drop), checks.numbers("detuning", detuning)
    try:
        wanted, nu = np.broadcast_arrays(*lights)
    except ValueError:
        shapes = f"{lights[0].shape} and {lights[1].shape}"
        raise checks.InputError(f"drop and detuning have shapes {shapes}, which do not go together") from None
    if not wanted.size:
        rule = "one value or more is needed"
        raise checks.InputError(f"drop and detuning of shape {wanted.shape} hold {wanted.size} values; {rule}")
    if not (np.all(wanted > 0) and np.all(wanted < 1)):
        raise checks.InputError(f"drop = {np.min(wanted):g} .. {np.max(wanted):g} W must lie between 0 and 1 W")
    check_detuning(float(nu.ravel()[np.abs(nu).argmax()]))
    if ring.drop_bus_rate == 0:
        raise checks.InputError(f"ring {ring.name!r} has no drop port")
    U = wanted.ravel() / (2 * ring.drop_bus_rate) / FJ
    rates, _ = internal_rates(ring)
    N = carriers(U, rates)[0]
    largest = float((2 * (rates.absorbed + rates.fca * N + rates.tpa * U) * U).max()) * UW
    at = internal_ring(ring, model, largest)
    linear = at.model.thermal_resistance * largest
    trusted(model, linear if isinstance(at.model, Foster) else at.model.steady_rise(largest), linear)
    here = balance(U, at)
    D = here.shift - 2 * np.pi * NS * nu.ravel()
    return np.asarray(U * (here.gamma**2 + D**2) / internal_pump(ring, 1.0) ** 2).reshape(wanted.shape)


def sweep(
    ring: RingResonator,
    model: ThermalModel,
    *,
    power: float | ArrayLike,
    detuning: float | ArrayLike,
) -> xr.Dataset:
    """Follow the fixed point of a laser whose power or detuning changes so slowly that the ring is always at rest.

    From step to step the ring stays on its branch; wide steps are divided until it is clear which fixed point follows.
    Where the branch ends in a fold the ring jumps to the nearest stable one. Where it turns unstable without ending (a
    Hopf point) the ring begins to pulse; the fixed point is followed on, and regime says so: `simulate` with a waveform
    says what the ring does there.

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
    P, nu = (checks.array(name, v) for name, v in (("power", power), ("detuning", detuning)))
    if (P.size > 1) == (nu.size > 1):
        raise checks.InputError("one of power and detuning must be an array of steps, the other one number")
    for name, values, check in (("power", P, check_power), ("detuning", nu, check_detuning)):
        for k, value in enumerate(values):
            check(value, f"{name}[{k}]" if values.size > 1 else name)
    at = internal_ring(ring, model, absorbable(ring, float(P.max())))
    steps = max(P.size, nu.size)
    P, nu = np.broadcast_to(P, steps), np.broadcast_to(nu, steps)
    pumps, shifts = internal_pump(ring, 1.0) * np.sqrt(P), 2 * np.pi * NS * nu
    U, D, step = fixed_points(pumps, shifts, at)
    every = np.split(np.array([U, D]), np.flatnonzero(np.diff(step)) + 1, axis=1)

    def points_at(k: float) -> Array:
        if k == int(k):
            return every[int(k)]
        power, shift = (float(np.interp(k, np.arange(steps), values)) for values in (P, shifts))
        return np.array(fixed_points(internal_pump(ring, power), shift, at)[:2])

    path, jumped, before = np.empty((2, steps)), np.zeros(steps, dtype=bool), None
    for k in range(steps):
        points, here, jumped[k] = _followed(points_at, max(k - 1, 0), k, before, at, HALVINGS)
        path[:, k], before = points[:, here], (points[0], here)
    found = _dataset(ring, at, path[0], path[1], P, nu, "step")
    _trust(model, at, found)
    found["jumped"] = ("step", jumped, {"units": "1", "long_name": "left its branch"})
    found.attrs |= provenance("slow sweep", ring, at.model)
    return found


def _trust(model: ThermalModel | None, at: InternalRing, found: xr.Dataset) -> None:
    """Compare the rises along a curve with what the model describes."""
    linear = at.model.thermal_resistance * found["absorbed"].values
    trusted(model, found["delta_T"].values, linear)


def _in_range(
    curve: Callable[[Array], tuple[Array, ...]], low: float, high: float, row: int, ends: Array
) -> tuple[Array, ...]:
    """The part of a curve within the range of its power or detuning (``row``), both ends of the range included."""
    grid = np.linspace(low, high, POINTS)
    parts = intervals_in_window(lambda s: (curve(s)[row] - ends[0])[None] / np.ptp(ends), grid)
    if not parts:  # between two neighbouring floats
        name, unit = ("power", "W") if row == 2 else ("detuning", "Hz")
        span = f"{ends[0]:.17g} to {ends[1]:.17g} {unit}"
        raise checks.InputError(f"{name} = {span} is narrower than round-off; widen it")
    points = equidistant(lambda s: np.array(curve(s))[[0, 2, 3]], parts, POINTS)  # energy, power, detuning
    values = list(curve(np.concatenate(points)))
    stops = np.cumsum([s.size for s in points])
    for k in (*(stops - 1), *(stops - [s.size for s in points])):
        values[row][k] = ends[np.argmin(np.abs(ends - values[row][k]))]  # to the last digit
    return tuple(values)


def _followed(
    points_at: Callable[[float], Array], first: float, last: float, before: tuple[Array, int] | None, at: InternalRing,
    halvings: int,
) -> tuple[Array, int, bool]:  # fmt: skip
    """Fixed points (U, D) at the end of a step, which one follows on that of ``before``, and whether that is a jump."""
    points = points_at(last)
    if before is not None and _clear(points[0], before[0]):
        return points, before[1], False
    if before is None or not halvings:
        return points, *_next(points[0], before, _stable(points[0], points[1], at))
    middle = (first + last) / 2
    between, here, jumped = _followed(points_at, first, middle, before, at, halvings - 1)
    points, here, again = _followed(points_at, middle, last, (between[0], here), at, halvings - 1)
    return points, here, jumped or again


def _clear(U: Array, earlier: Array) -> bool:
    """Whether as many fixed points have moved by much less than they lie apart: each then follows on its own."""
    if U.size != earlier.size:
        return False
    gaps = np.diff(np.log(earlier))
    return bool(np.abs(np.log(U / earlier)).max() <= CLEAR * min(1.0, gaps.min(initial=1.0)))


def _next(U: Array, before: tuple[Array, int] | None, stable: NDArray[np.bool_]) -> tuple[int, bool]:
    """Which of the fixed points of energies ``U`` follows on the one of the step before, and whether that is a jump.

    In the order of their energies every second one is a saddle; they come and go in pairs with a neighbour.
    """
    if before is None:
        rest = [i for i in range(U.size) if stable[i]]
        return (rest or [0])[0], False
    earlier, at = before
    alike = range(at % 2, U.size, 2) or range(U.size)
    nearest = min(alike, key=lambda i: abs(np.log(U[i] / earlier[at])))
    if U.size >= earlier.size:
        return nearest, False
    pair = int(np.argmin(np.diff(np.log(earlier))))  # the two that met and vanished
    if at not in (pair, pair + 1):
        return nearest, False
    rest = [i for i in range(U.size) if stable[i]] or list(range(U.size))
    return min(rest, key=lambda i: abs(np.log(U[i] / earlier[at]))), True


def _stable(U: Array, D: Array, at: InternalRing) -> NDArray[np.bool_]:
    """Whether each of the fixed points is stable."""
    return np.asarray(eigenvalues(U, D, at).real.max(axis=1) < 0)


def _ends(name: str, value: float | ArrayLike) -> Array:
    """One number, or an increasing pair."""
    ends = checks.array(name, value)
    if ends.size > 2 or (ends.size == 2 and ends[0] >= ends[1]):
        raise checks.InputError(f"{name} = {value!r} must be one number or a pair (first, last) with first < last")
    for end in ends:
        (check_power if name == "power" else check_detuning)(end, name)
    return ends


def _dataset(
    ring: RingResonator, at: InternalRing, U: Array, D: Array, powers: Array, detunings: Array, over: str = "point"
) -> xr.Dataset:
    """Fixed points along a line, in SI."""
    values = {"power": powers, "detuning": detunings} | observables(ring, at, U, D, powers)
    return xr.Dataset(
        {name: (over, v, dataset.describe("input_power" if name == "power" else name)) for name, v in values.items()}
    )
