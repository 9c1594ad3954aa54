"""Derivatives of a settled cycle with respect to the numbers of the ring, the laser and the heat.

    (M - 1) dy_0 + t dT = -p,       f(y_0) . dy_0 = 0

with M the derivative of the return map, t and p what the period and a parameter do to the last state: one more right-
hand side of the system that Newton's method solved. The stages follow by substitution, and with them every measure:

    d(swing) = d(dT) at the hottest - d(dT) at the coldest point
    d(crossing) = [d(level) - dU at the crossing]/(dU/d fraction),       d(level) = .55 d(U_min) + .45 d(U_max)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from thermofem import Quadratic, checks
from thermofem.arrays import Array
from thermofem.data.variables import PER
from thermofem.models import ThermalModel

from ..arguments import check_detuning, check_power, check_ring
from ..heaters import constant
from ..resonator import RingResonator
from ..runs.pulsing import DUTY_LEVEL
from ..thermal import provenance, trusted
from .guess import from_guess
from .measures import ENERGY, HEAT, measure
from .orbit import CycleProblem, Orbit, problem, settle
from .parameters import parameter_names, slope, unit_of, value_of
from .scheme import scheme
from .start import settled

if TYPE_CHECKING:
    import xarray as xr

BIT, SMALL = 5e-4, 1e-4  # of a mesh interval: steps for first and second derivatives along the period
FINE = 1e-10  # error of the polynomials between the stages where duty and swing are differentiated


def cycle_derivatives(
    ring: RingResonator,
    model: ThermalModel,
    parameters: Sequence[str] | None = None,
    *,
    power: float,
    detuning: float = 0.0,
    cycle: xr.Dataset | None = None,
    heaters: Mapping[str, float] | None = None,
    heated: str | None = None,
    read: str | None = None,
) -> xr.Dataset:
    """Return the derivatives of a settled cycle with respect to numbers of the ring, the laser and the heat.

    Parameters
    ----------
    ring, model, power, detuning : RingResonator, ThermalModel, W, Hz
        as for `limit_cycle`.
    parameters : sequence of str, optional
        names of numbers of the ring and its carriers as `identify` knows them, "fcd1" and so on for the coefficients of
        its dispersion, "power", "detuning", and "R1", "tau1" and so on for the poles of a network; by default all.
    cycle : Dataset, optional
        the cycle as `limit_cycle` returned it, or one nearby; spares the transient.
    heaters : mapping of name to float, W, optional
        constant power in further inputs of a linear model, as for `simulate`; so are ``heated`` and ``read``.

    Returns
    -------
    xarray.Dataset
        over parameter: value and its SI unit, period (s), duty, swing (K) and extinction (dB) per unit of the
        parameter; the numbers of the cycle itself in attrs.

    Raises
    ------
    InputError
        as `limit_cycle`, and an unknown name.

    Measured against central differences of converged cycles, per relative change of a parameter: 1e-6 of period and
    swing, and of all four where pulses last. Of short pulses the extinction has an error of up to 2e-5 of itself, and
    the duty cycle, the difference of two moments of the period, 4e-5 at 0.07, 2e-4 at 1e-3 and 4e-3 at 5e-6.

    >>> import coupled, thermofem as th
    >>> model = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    >>> d = coupled.cycles.derivatives.cycle_derivatives(coupled.borghi2021(), model, ["power", "tau2"], power=6.31e-3)
    >>> print(f"{d['period'].sel(parameter='power').item() * 1e6:.1f} ns per mW")
    -18.3 ns per mW
    """
    import xarray as xr

    check_ring(ring)
    power = check_power(power)
    detuning = check_detuning(detuning)
    warm = constant(model, heaters, heated, read)
    small = warm.model
    names = parameter_names(ring, small) if parameters is None else [*checks.instances("parameters", parameters, str)]
    p = problem(ring, small, float(power), float(detuning), warm.rise)
    found = settled(p, np.zeros(p.units.size)) if cycle is None else from_guess(p, cycle)
    orbit = settle(p, found.orbit, FINE) or found.orbit
    if parameters is None:
        names = [name for name in names if _differentiable(p, name)]
    rows = derivatives(p, orbit, names)
    about = {"period": "s", "duty": "1", "swing": "K", "extinction": "dB"}
    variables: dict[str, Any] = {
        name: ("parameter", rows[:, k], {"units": f"{unit} {PER}", "long_name": f"derivative of the {name}"})
        for k, (name, unit) in enumerate(about.items())
    }
    values = [value_of(p, name) for name in names]
    variables["value"] = ("parameter", values, {"long_name": "value of the parameter"})
    variables["unit"] = ("parameter", [unit_of(p, name) for name in names], {"long_name": "SI unit of the parameter"})
    seen = measure(p, orbit)
    trusted(model, seen.hottest)
    attrs = provenance("cycle derivatives", ring, small) | {"input_power": p.power, "detuning": p.detuning}
    attrs |= {"period": orbit.T * 1e-9, "duty": seen.duty, "swing": seen.swing, "extinction": float(seen.extinction)}
    attrs |= warm.attributes
    return xr.Dataset(variables, coords={"parameter": names}, attrs=attrs)


def _differentiable(p: CycleProblem, name: str) -> bool:
    """Whether a number has a step for differences."""
    try:
        slope(p, name, np.zeros((1, p.units.size)))
    except checks.InputError:
        return False
    return True


def derivatives(p: CycleProblem, orbit: Orbit, names: Sequence[str]) -> Array:
    """Return d(period in s, duty, swing in K, extinction in dB)/d(parameter in SI), shape (parameters, 4)."""
    from ..kernels import orbit_mesh, orbits

    states = orbit.Y.reshape(-1, orbit.start.size)
    if not names:
        return np.empty((0, 4))
    forcing = np.stack([slope(p, name, states) for name in names], axis=-1).reshape(*orbit.Y.shape, len(names))
    turns, starts, changes = orbits.respond(orbit.start, orbit.Y, orbit.tau, orbit.T, p.at, scheme(), forcing)
    seen = measure(p, orbit)
    at = np.concatenate([_turns(p, orbit, seen.extremes), seen.crossings])
    order = np.argsort(at)
    values, slopes = _values(p, orbit, at), _slopes(p, orbit, seen.crossings)[:, ENERGY]
    base = np.empty((at.size, orbit.start.size))
    base[order] = orbit_mesh.interpolate(orbit.start, orbit.Y, orbit.tau, scheme(), at[order])
    out = np.empty((len(names), 4))
    for k in range(len(names)):
        moved = np.empty_like(base)
        moved[order] = orbit_mesh.interpolate(starts[k], changes[k], orbit.tau, scheme(), at[order])
        dU = 2 * (base[:, 0] * moved[:, 0] + base[:, 1] * moved[:, 1])
        heat = _rise(p, base, moved)
        level = (1 - DUTY_LEVEL) * dU[0] + DUTY_LEVEL * dU[1]
        shift = (level - dU[4:]) / slopes
        duty = float(np.sum(np.where(seen.rising, -shift, shift)))
        dB = 10 / np.log(10) * (dU[1] / values[1, ENERGY] - dU[0] / values[0, ENERGY])
        out[k] = turns[k] * 1e-9, duty, heat[3] - heat[2], dB
    return out


def _values(p: CycleProblem, orbit: Orbit, at: Array) -> Array:
    """U and dT (columns ENERGY and HEAT) at fractions of the period, in any order."""
    from ..kernels import orbit_mesh

    order = np.argsort(at)
    out = np.empty((at.size, 4))
    out[order] = orbit_mesh.look(orbit.start, orbit.Y, orbit.tau, p.at, scheme(), np.ascontiguousarray(at[order]))
    return out


def _slopes(p: CycleProblem, orbit: Orbit, at: Array) -> Array:
    """Their derivatives by the fraction, of the polynomials: the equations magnify an error of the field by 1e3."""
    step = BIT * _widths(orbit, at)
    return np.asarray((_values(p, orbit, at + step) - _values(p, orbit, at - step)) / (2 * step[:, None]))


def _widths(orbit: Orbit, at: Array) -> Array:
    """Smallest of the mesh interval at each fraction of the period and its two neighbours: pulses are short."""
    width = np.diff(orbit.tau)
    at_least = np.minimum(width, np.minimum(np.roll(width, 1), np.roll(width, -1)))
    return np.asarray(at_least[np.clip(np.searchsorted(orbit.tau, at, side="right") - 1, 0, width.size - 1)])


def _turns(p: CycleProblem, orbit: Orbit, at: Array) -> Array:
    """The extremes of U (two) and dT (two) moved to those of the polynomials, by Newton's method."""
    column = np.array([ENERGY, ENERGY, HEAT, HEAT])
    step = SMALL * _widths(orbit, at)
    for _ in range(2):
        at = np.clip(at, step, 1 - step)
        before, here, after = (_values(p, orbit, at + k * step)[np.arange(4), column] for k in (-1, 0, 1))
        bend = after - 2 * here + before
        at = at - np.where(bend != 0, step * (after - before) / (2 * np.where(bend != 0, bend, 1)), 0)
    return np.asarray(np.clip(at, step, 1 - step))


def _rise(p: CycleProblem, states: Array, moved: Array) -> Array:
    """Changes of dT with those of the states."""
    thermal: Any = p.at.thermal
    if isinstance(p.model, Quadratic):
        return np.asarray(moved[:, 3:] @ thermal.C)
    z = states[:, 3:].sum(axis=1)
    return np.asarray((1 + 2 * thermal.curvature * z) * moved[:, 3:].sum(axis=1))
