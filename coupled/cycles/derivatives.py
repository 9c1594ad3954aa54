"""Derivatives of a limit cycle with respect to parameters of the ring, the laser and the thermal model.

    V_i dy_i + f dh_i + p_i = dy_(i+1),       w_i . dy_i = 0

is the linearised multiple-shooting system (`multiple_shooting`), p_i the derivative of the flow by the parameter. Its
nodes y_i are the extremes of U and dT and the crossings of U with the level of the duty cycle, h_i the times between
them. The derivatives of nodes and times by a parameter give those of every measure:

    d(swing) = d(dT) at the maximum of dT - d(dT) at its minimum
    d(crossing) = [d(level) - dU at the crossing]/(dU/dt),       d(level) = .55 d(U_min) + .45 d(U_max)
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from thermofem import checks
from thermofem.arrays import Array
from thermofem.data.variables import PER
from thermofem.models import ThermalModel

from ..heaters import warmed
from ..inputs import check_detuning, check_power
from ..kernel.units import NS
from ..resonator import RingResonator
from ..runs.pulsing import DUTY_LEVEL
from ..thermal import Heaters, trusted
from ..unknowns import FROM_ZERO
from .cycle_problem import CycleProblem, numbers_of, value_of
from .limit_cycle import cycle_near
from .multiple_shooting import Family, Nodes, flow, linearised, newton, weights
from .orbit_measures import measure
from .return_map import Orbit

ACCURATE = 1e-10  # rtol of the traces: light, which follows heat and carriers, has derivatives that err by 1e4 times it


def cycle_derivatives(
    ring: RingResonator,
    model: ThermalModel,
    parameters: Sequence[str] | None = None,
    *,
    power: float,
    detuning: float = 0.0,
    cycle: xr.Dataset | None = None,
    heaters: Heaters = None,
    heated: str | None = None,
    read: str | None = None,
) -> xr.Dataset:
    """Return the derivatives of a limit cycle with respect to parameters of the ring, the laser and the heat.

    Parameters
    ----------
    ring, model, power, detuning : RingResonator, ThermalModel, W, Hz
        as for `limit_cycle`.
    parameters : sequence of str, optional
        fields of the ring and its carriers as in `identify`, "fcd1", "fcd2", ... for the dispersion coefficients,
        "power", "detuning", and "R1", "tau1", ... for the poles of a network; by default all.
    cycle : Dataset, optional
        the cycle as `limit_cycle` returned it, or one nearby, as start; without it a transient is integrated.
    heaters : mapping of name to float, W, optional
        constant power in further inputs of a linear model, as for `simulate`; so are ``heated`` and ``read``.

    Returns
    -------
    xarray.Dataset
        over parameter: value and its SI unit, period (s), duty, swing (K) and extinction (dB) per unit of the
        parameter; the measures of the cycle itself in attrs.

    Raises
    ------
    InputError
        as `limit_cycle`, and an unknown name.

    Error against finite differences of cycles, per relative change of a parameter: period and swing to 5e-9, duty
    and extinction to 1e-6 on the reference ring with two to fourteen poles.

    >>> import coupled, thermofem as th
    >>> model = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])
    >>> d = coupled.cycles.derivatives.cycle_derivatives(coupled.borghi2021(), model, ["power", "tau2"], power=6.31e-3)
    >>> print(f"{d['period'].sel(parameter='power').item() * 1e6:.1f} ns per mW")
    -18.3 ns per mW
    """
    power = check_power(power)
    detuning = check_detuning(detuning)
    warm = warmed(ring, model, heaters, heated, read)
    p = CycleProblem(ring, warm.model, power, detuning, warm.rise)
    numbers = numbers_of(p)
    if parameters is None:
        names = [name for name, (value, _) in numbers.items() if name == "detuning" or value or name in FROM_ZERO]
    else:
        names = list(checks.instances("parameters", parameters, str))
    orbit = cycle_near(p, cycle)
    rows = derivatives(p, orbit, names)
    units = {"period": "s", "duty": "1", "swing": "K", "extinction": "dB"}
    variables: dict[str, Any] = {}
    for column, (name, unit) in zip(rows.T, units.items(), strict=True):
        about = {"units": f"{unit} {PER}", "long_name": f"derivative of the {name}"}
        variables[name] = ("parameter", column, about)
    values = [numbers[name][0] for name in names]
    about = {"long_name": "value of the parameter"}
    variables["value"] = ("parameter", values, about)
    si_units = [numbers[name][1] for name in names]
    about = {"long_name": "SI unit of the parameter"}
    variables["unit"] = ("parameter", si_units, about)
    measures = measure(orbit.trace.rows)
    trusted(model, measures.hottest)
    attrs = p.provenance("cycle derivatives") | warm.attributes
    attrs |= {"period": orbit.T * NS, "duty": measures.duty, "swing": measures.swing}
    attrs |= {"extinction": float(measures.extinction)}
    return xr.Dataset(variables, coords={"parameter": names}, attrs=attrs)


def derivatives(p: CycleProblem, orbit: Orbit, names: Sequence[str]) -> Array:
    """Return d(period (s), duty, swing (K), extinction (dB))/d(parameter in SI), shape (parameters, 4)."""
    if not names:
        return np.empty((0, 4))
    measures = measure(orbit.trace.rows)
    moments = np.concatenate([measures.extremes, measures.crossings])
    order = np.argsort(moments)
    y = _states_at(p, orbit, moments[order])
    changes = _changes(p, orbit, names, y, moments[order])
    places = np.argsort(order)
    y = y[places]
    dy = changes.y[:, places]
    begins = np.cumsum(changes.h, axis=1) - changes.h
    dt = begins[:, places]
    dT = changes.h.sum(axis=1)
    low, high, coldest, hottest = range(4)  # the extrema, and the crossings of the level after them
    crossings = slice(4, None)
    U = (y[:, :2] ** 2).sum(axis=1)
    dU = np.einsum("kn,qkn->qk", 2 * y[:, :2], dy[:, :, :2])
    rise = np.einsum("kn,qkn->qk", _rise_by_heat(p, y), dy[:, :, 3:])
    level = (1 - DUTY_LEVEL) * dU[:, low] + DUTY_LEVEL * dU[:, high]
    slopes = np.array([_energy_slope(p, state) for state in y[crossings]])
    shift = dt[:, crossings] + (level[:, None] - dU[:, crossings]) / slopes
    signs = np.where(measures.rising, -1.0, 1.0)
    share = signs @ measures.crossings / orbit.T
    duty = (shift @ signs - dT * share) / orbit.T
    dB = 10 / np.log(10) * (dU[:, high] / U[high] - dU[:, low] / U[low])
    swing = rise[:, hottest] - rise[:, coldest]
    return np.column_stack([dT * NS, duty, swing, dB])


def _states_at(p: CycleProblem, orbit: Orbit, times: Array) -> Array:
    """The states of an orbit at increasing times in ns, shape (times, n)."""
    states = []
    state = orbit.start
    for duration in np.diff(times, prepend=0.0):
        if duration > 0:
            state = flow(p.flow.fine, state, duration, ACCURATE).y
        states.append(state)
    return np.array(states)


def _changes(p: CycleProblem, orbit: Orbit, names: Sequence[str], y: Array, times: Array) -> Nodes:
    """Changes of the states ``y`` at ``times`` and of the durations between them, per SI unit of each parameter."""
    family = Family(p, tuple(names), np.array([value_of(p, name) or 1.0 for name in names]))
    durations = np.diff(times, append=times[0] + orbit.T)
    nodes = Nodes(y, durations, family.start())
    linear = linearised(family, nodes, ACCURATE)
    q = len(names)
    planes = np.eye(orbit.start.size + 1 + q)[-q:]  # the parameters
    solution = linear and newton(nodes, linear, planes, np.zeros(q), weights(family, orbit.trace))
    if not solution:
        raise checks.InputError(
            f"parameters: the cycle is at a fold, where it has no derivatives by {', '.join(names)}"
        )
    _, tangents = solution
    return tangents.times(np.diag(1 / family.ranges))


def _energy_slope(p: CycleProblem, y: Array) -> float:
    """dU/dt at a state, fJ/ns."""
    rate, _ = p.flow.fine.slopes(y)
    return float(2 * y[:2] @ rate[:2])


def _rise_by_heat(p: CycleProblem, y: Array) -> Array:
    """d(dT)/dx: temperature rise differentiated by the thermal states x, at k states; shape (k, thermal states)."""
    return p.model.read_slope(y[:, 3:])
