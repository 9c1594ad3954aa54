"""Transmission of a nonlinear ring: all branches against detuning or power, and the loop that a slow sweep follows."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from thermofem import Foster, checks
from thermofem.arrays import Array, ArrayLike
from thermofem.models import ThermalModel

from ..arguments import MOST_POINTS, check_detuning, check_power, check_ring, one_laser
from ..resonator import RingResonator
from ..thermal import trusted
from .steady import Internal, absorbable, internal, observables, provenance
from .stretches import spread, stretches

if TYPE_CHECKING:
    import xarray as xr

POINTS = 600  # of a curve
HALVINGS = 10  # of a step of a sweep, until it is clear which fixed point follows on which
CLEAR = 0.3  # of the gap between two energies, on a logarithmic scale, and of a factor e: what a clear step may change


@one_laser
def transmission(
    ring: RingResonator,
    model: ThermalModel,
    *,
    power: float | ArrayLike,
    detuning: float | ArrayLike,
) -> xr.Dataset:
    """Return the curve of all fixed points against detuning at one power, or against power at one detuning.

    At one power it is the tilted resonance, one smooth curve with a parameter s (D = gamma sinh s); at one detuning
    power is a function of the energy, P = U (gamma^2 + D^2)/(2 gamma_e). Either way the curve runs through its folds:
    where it is bistable it has three values.

    Parameters
    ----------
    ring : RingResonator
    model : ThermalModel
        as for `steady_states`.
    power, detuning : float, or (first, last); W, Hz
        one of them a pair, the range of the curve.

    Returns
    -------
    xarray.Dataset
        over point, along the curve from border to border of the range, up to 600: power, detuning, and all that
        `steady_states` gives, with regime "stable", "saddle", "unstable focus" or "unstable node".

    Raises
    ------
    InputError
        as `steady_states`; neither or both of them a pair.

    >>> import coupled, thermofem as th
    >>> model = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    >>> curve = coupled.transmission(coupled.borghi2021(), model, power=5e-3, detuning=(-120e9, 20e9))
    >>> peak = curve.isel(point=int(curve["drop"].values.argmax()))
    >>> print(f"{float(peak['drop']) * 1e3:.2f} mW at {float(peak.detuning) / 1e9:.0f} GHz, {peak.regime.item()}")
    2.20 mW at -92 GHz, stable
    """
    from ..kernels import equations as eq
    from . import balance

    check_ring(ring)
    P, nu = _ends("power", power), _ends("detuning", detuning)
    at = internal(ring, model, absorbable(ring, P[-1]))
    rest = (at.rates, at.fcd, at.static)
    if (P.size, nu.size) == (1, 2):
        pump = eq.internal_pump(ring, P[0])
        end = balance.reach(2 * np.pi * eq.NS * float(np.abs(nu).max()), pump, *rest)

        def along(s: Array) -> tuple[Array, Array, Array, Array]:
            U, D, shift, _ = np.array([balance.tilted(v, pump, *rest) for v in s]).T
            return U, D, np.full(U.size, P[0]), shift / (2 * np.pi * eq.NS)

        U, D, powers, detunings = _window(along, -end, end, 3, nu)
    elif (P.size, nu.size) == (2, 1):
        shift_0 = 2 * np.pi * eq.NS * nu[0]
        weak, strong = (eq.internal_pump(ring, p) for p in P)
        high = np.log(balance.energy(0.0, strong, *rest))
        low = np.log(balance.energy(balance.reach(abs(shift_0), weak, *rest), weak, *rest))

        def along(s: Array) -> tuple[Array, Array, Array, Array]:
            U = np.exp(s)
            shift, gamma = balance.balances(U, *rest)[[3, 5]]
            D = shift - shift_0
            return U, D, U * (gamma**2 + D**2) / eq.internal_pump(ring, 1.0) ** 2, np.full(U.size, nu[0])

        U, D, powers, detunings = _window(along, low, high, 2, P)
    else:
        raise checks.InputError("one of power and detuning must be a pair (first, last), the other one number")
    found = _dataset(ring, at, U, D, powers, detunings)
    _trust(model, at, found)
    found.attrs |= provenance("transmission", ring, at.model)
    return found


@one_laser
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
    from ..kernels import equations as eq
    from ..kernels.kinds import Static
    from . import balance

    check_ring(ring)
    lights = checks.numbers("drop", drop), checks.numbers("detuning", detuning)
    try:
        wanted, nu = np.broadcast_arrays(*lights)
    except ValueError:
        shapes = f"{lights[0].shape} and {lights[1].shape}"
        raise checks.InputError(f"drop and detuning have shapes {shapes}, which do not go together") from None
    if not 0 < wanted.size <= checks.LONGEST:
        rule = f"1 to {checks.LONGEST:,} values are needed"
        raise checks.InputError(f"drop and detuning of shape {wanted.shape} hold {wanted.size} values; {rule}")
    if not (np.all(wanted > 0) and np.all(wanted < 1)):
        raise checks.InputError(f"drop = {np.min(wanted):g} .. {np.max(wanted):g} W must lie between 0 and 1 W")
    check_detuning(float(nu.ravel()[np.abs(nu).argmax()]))
    if ring.drop_bus_rate == 0:
        raise checks.InputError(f"ring {ring.name!r} has no drop port")
    U = wanted.ravel() / (2 * ring.drop_bus_rate) / eq.FJ
    rates, fcd = eq.internal_rates(ring)
    N = balance.balances(U, rates, fcd, Static(0.0))[0]
    largest = float(eq.absorbed_power(U, N, rates).max()) * eq.UW
    at = internal(ring, model, largest)
    linear = at.model.thermal_resistance * largest
    trusted(model, linear if isinstance(at.model, Foster) else at.model.steady_rise(largest), linear)
    shift, gamma = balance.balances(U, at.rates, at.fcd, at.static)[[3, 5]]
    D = shift - 2 * np.pi * eq.NS * nu.ravel()
    return np.asarray(U * (gamma**2 + D**2) / eq.internal_pump(ring, 1.0) ** 2).reshape(wanted.shape)


@one_laser
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
    from ..kernels import equations as eq
    from . import balance

    check_ring(ring)
    P, nu = (checks.array(name, v, longest=MOST_POINTS) for name, v in (("power", power), ("detuning", detuning)))
    if (P.size > 1) == (nu.size > 1):
        raise checks.InputError("one of power and detuning must be an array of steps, the other one number")
    for name, values, check in (("power", P, check_power), ("detuning", nu, check_detuning)):
        for k, value in enumerate(values):
            check(value, f"{name}[{k}]" if values.size > 1 else name)
    at = internal(ring, model, absorbable(ring, float(P.max())))
    rest = (at.rates, at.fcd, at.static)
    steps = max(P.size, nu.size)
    P, nu = np.broadcast_to(P, steps), np.broadcast_to(nu, steps)
    shifts = 2 * np.pi * eq.NS * nu
    farthest = float(np.abs(shifts).max())

    def between(values: Array, k: float) -> float:
        low = int(k)
        return float(values[low] + (k - low) * (values[min(low + 1, steps - 1)] - values[low]))

    def points_at(k: float) -> Array:
        pump = eq.internal_pump(ring, between(P, k))
        if pump not in pieces:
            pieces.clear()  # of one power at a time
            pieces[pump] = balance.turning_points(balance.reach(farthest, pump, *rest), pump, *rest)
        points = balance.fixed_points(between(shifts, k), pump, *rest, pieces[pump])
        return np.asarray(points[:, np.argsort(points[0])])

    pieces: dict[float, Any] = {}
    path, jumped, before = np.empty((2, steps)), np.zeros(steps, dtype=bool), None
    for k in range(steps):
        points, here, jumped[k] = _followed(points_at, max(k - 1, 0), k, before, at, HALVINGS)
        path[:, k], before = points[:, here], (points[0], here)
    found = _dataset(ring, at, path[0], path[1], P, nu, "step")
    _trust(model, at, found)
    found["jumped"] = ("step", jumped, {"units": "1", "long_name": "left its branch"})
    found.attrs |= provenance("slow sweep", ring, at.model)
    return found


def _trust(model: ThermalModel, at: Internal, found: xr.Dataset) -> None:
    """Compare the rises along a curve with what the model describes."""
    linear = at.model.thermal_resistance * found["absorbed"].values
    trusted(model, found["delta_T"].values, linear)


def _window(along: Any, low: float, high: float, row: int, ends: Array) -> tuple[Array, Array, Array, Array]:
    """The part of a curve within the range of its power or detuning (``row``), both ends of the range included."""
    grid = np.linspace(low, high, POINTS)
    parts = stretches(lambda s: (along(s)[row] - ends[0])[None] / np.ptp(ends), grid)
    if not parts:  # between two neighbouring floats
        name, unit = ("power", "W") if row == 2 else ("detuning", "Hz")
        span = f"{ends[0]:.17g} to {ends[1]:.17g} {unit}"
        raise checks.InputError(f"{name} = {span} is narrower than round-off; widen it")
    points = spread(lambda s: np.array(along(s))[[0, 2, 3]], parts, POINTS)  # energy, power, detuning
    curve = list(along(np.concatenate(points)))
    stops = np.cumsum([s.size for s in points])
    for k in (*(stops - 1), *(stops - [s.size for s in points])):
        curve[row][k] = ends[np.argmin(np.abs(ends - curve[row][k]))]  # to the last digit
    return tuple(curve)


def _followed(
    points_at: Callable[[float], Array], first: float, last: float, before: tuple[Array, int] | None, at: Internal,
    halvings: int,
) -> tuple[Array, int, bool]:  # fmt: skip
    """Fixed points (U, D) at the end of a step, which one follows on that of ``before``, and whether that is a jump."""
    points = points_at(last)
    if before is not None and _clear(points[0], before[0]):
        return points, before[1], False
    if before is None or not halvings:
        return points, *_next(points[0], before, lambda i: _stable(points[:, i], at))
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


def _next(U: Array, before: tuple[Array, int] | None, stable: Any) -> tuple[int, bool]:
    """Which of the fixed points of energies ``U`` follows on the one of the step before, and whether that is a jump.

    In the order of their energies every second one is a saddle; they come and go in pairs with a neighbour.
    """
    if before is None:
        rest = [i for i in range(U.size) if stable(i)]
        return (rest or [0])[0], False
    earlier, at = before
    alike = range(at % 2, U.size, 2) or range(U.size)
    nearest = min(alike, key=lambda i: abs(np.log(U[i] / earlier[at])))
    if U.size >= earlier.size:
        return nearest, False
    pair = int(np.argmin(np.diff(np.log(earlier))))  # the two that met and vanished
    if at not in (pair, pair + 1):
        return nearest, False
    rest = [i for i in range(U.size) if stable(i)] or list(range(U.size))
    return min(rest, key=lambda i: abs(np.log(U[i] / earlier[at]))), True


def _stable(point: Array, at: Internal) -> bool:
    """Whether a fixed point (U, D) is stable."""
    from . import spectrum

    return bool(spectrum.dense(point[0], point[1], *at[1:]).real.max() < 0)


def _ends(name: str, value: float | ArrayLike) -> Array:
    """One number, or an increasing pair."""
    ends = checks.array(name, value)
    if ends.size > 2 or (ends.size == 2 and ends[0] >= ends[1]):
        raise checks.InputError(f"{name} = {value!r} must be one number or a pair (first, last) with first < last")
    for end in ends:
        (check_power if name == "power" else check_detuning)(end, name)
    return ends


def _dataset(
    ring: RingResonator, at: Internal, U: Array, D: Array, powers: Array, detunings: Array, over: str = "point"
) -> xr.Dataset:
    """Fixed points along a line, in SI."""
    import xarray as xr

    from thermofem.data import dataset

    values = {"power": powers, "detuning": detunings} | observables(ring, at, U, D, powers)
    return xr.Dataset(
        {name: (over, v, dataset.describe("input_power" if name == "power" else name)) for name, v in values.items()}
    )
