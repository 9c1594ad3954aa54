"""The limit cycle of a self-pulsing ring or circuit, by Newton's method on its return map, and its continuation."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from thermofem import InputError, checks, dataset
from thermofem.models import ThermalModel

from ..circuit.circuit import Circuit
from ..circuit.stationary import autonomous
from ..heaters import warmed
from ..inputs import check_detuning, check_power
from ..kernel.integrator import CARRIERS, ENERGY
from ..kernel.rates import absorbed_power
from ..kernel.tableaus import Method
from ..kernel.units import DENSITY, FJ, NS, UW, internal_rates, units
from ..resonator import RingResonator
from ..runs.simulate import simulate
from ..states import State, starting_point
from ..thermal import Heaters, trusted
from . import branch
from .branch import born, is_hopf_point, laser_of, near_hopf
from .cycle_problem import CycleProblem, measured, pulse_train, value_of
from .multiple_shooting import Family, first_place
from .orbit_measures import measure
from .return_map import FINE, MIDDLE, REACH, Flow, Orbit, close, time_weights

UNSTABLE = 1 + 1e-6  # of a multiplier; their errors are below 3e-7, rarely 2e-6
SWING = 1e-3  # relative, below which the state of a circuit counts as at rest
ROWS = 401  # of a circuit's cycle


def limit_cycle(
    ring: RingResonator | Circuit,
    model: ThermalModel,
    *,
    power: Any,
    detuning: float = 0.0,
    guess: xr.Dataset | State | None = None,
    heaters: Heaters = None,
    heated: str | None = None,
    read: str | None = None,
    settle: float = 20e-6,
) -> xr.Dataset:
    """Return the limit cycle to which a ring or a circuit converges under constant light.

        y(T) = y(0),     dy/dt = f(y) as in `simulate`

    by Newton's method on the return map to a level of rising carriers (`return_map`). The eigenvalues of the derivative
    V of the flow are the Floquet multipliers: factors by which a small perturbation grows in one period.

    Parameters
    ----------
    ring : RingResonator or Circuit
        a circuit without delays, whose lit lasers have one frequency.
    model : ThermalModel
        as for `simulate`.
    power : float, W
        in the bus waveguide, larger than 0; for a circuit a mapping from laser name.
    detuning : float, Hz
        laser minus cold resonance, or minus the reference of a circuit.
    guess : Dataset or State, optional
        start of the search: another cycle of this function, and the one next to it is returned, even if it is unstable;
        a run of `simulate` or a State, from which a transient is integrated; a point of `hopf_curves`
        (``curve.isel(point=k)``), from which a branch of cycles is continued to this power and detuning. By default a
        transient from a cold ring.
    heaters : mapping of name to float, W, optional
        constant power in further inputs of a linear model, as for `simulate`; so are ``heated`` and ``read``.
    settle : float, s
        duration of the transient of a circuit; it should exceed the largest thermal time constant several times.

    Returns
    -------
    xarray.Dataset
        over time (s), one period with both ends: energy (J), carriers (1/m^3), delta_T (K), drop, through and absorbed
        (W), weight (s, quadrature weights for integrals over the period); over multiplier: multipliers (complex, by
        modulus; the one nearest to 1 is the trivial one). Attributes: period (s), duty, swing (K), extinction (dB),
        settling_time (s, in which a perturbation falls to 1/e; inf for an unstable cycle), stability ("stable",
        "doubled" with a multiplier below -1, or "unstable"), pulses (per period), reason (in words), and final_state,
        from which a run or another cycle can start. For a circuit as of `simulate`, with period and multipliers.

    Raises
    ------
    InputError
        power or detuning out of range, a model that is not small, or no cycle: the ring comes to rest, its pulses never
        repeat, or Newton's method finds none near the guess. The message says which.

    Error of the period: 1e-9 on the reference ring (two, five and fourteen poles) against runs of 400 us at
    rtol = 1e-9; docs/cycles.md reports tests on random rings.

    Source: Kuznetsov, Elements of Applied Bifurcation Theory (2004), Sections 1.5 and 10.1.

    >>> import coupled, thermofem as th
    >>> model = th.Foster(R=[600, 1500, 2000, 2200, 1500], tau=[20e-9, 100e-9, 400e-9, 2e-6, 12e-6])
    >>> cycle = coupled.limit_cycle(coupled.borghi2021(), model, power=6.31e-3)
    >>> print(f"{cycle.attrs['period'] * 1e9:.4f} ns, {cycle.attrs['stability']}")
    654.4713 ns, stable
    """
    if isinstance(ring, Circuit):
        return _of_circuit(ring, model, power, heaters, detuning, settle)
    power = check_power(power)
    detuning = check_detuning(detuning)
    warm = warmed(ring, model, heaters, heated, read)
    p = CycleProblem(ring, warm.model, power, detuning, warm.rise)
    orbit = cycle_near(p, guess)
    cycle = dataset_of(p, orbit)
    trusted(model, cycle["delta_T"].values - warm.rise)
    return cycle.assign_attrs(warm.attributes)


def cycle_near(p: CycleProblem, guess: Any) -> Orbit:
    """Return the cycle near a guess, or the one that the transient from it reaches; InputError if there is none."""
    order = p.flow.rough.order
    unit = units(order)
    if guess is None:
        return p.settled(p.flow.rough.zero())
    if is_hopf_point(guess):
        return near_hopf(p, guess)
    attrs = getattr(guess, "attrs", {})
    if not isinstance(guess, State) and "final_state" not in attrs:
        raise InputError(
            f"guess is a {type(guess).__name__}; it must be a cycle of coupled.limit_cycle, a run of coupled.simulate, "
            "a coupled.State or a point of coupled.hopf_curves"
        )
    if "pulses" not in attrs:
        return p.settled(starting_point(guess, order).as_array() / unit, "the guess")
    y = State.end_of(guess).as_array()
    if y.size != unit.size:  # heat of another model
        mean_power = guess["absorbed"].mean().values / UW
        heat = p.internal.heat.states(mean_power)
        light_and_carriers = y[:3] / unit[:3]
        return p.settled(np.concatenate([light_and_carriers, heat]), "the guess")
    orbit = close(p.flow, y / unit, int(attrs["pulses"]), REACH * attrs["period"] / NS)
    if orbit is None:
        raise InputError(
            f"no cycle at power = {p.power:g} W, detuning = {p.detuning:g} Hz near the one given as guess, of "
            f"{attrs['period']:g} s: Newton's method leads to none; take a smaller step, or no guess"
        )
    return orbit


def dataset_of(p: CycleProblem, orbit: Orbit) -> xr.Dataset:
    """Return a cycle of a ring as the Dataset of `limit_cycle`, in SI."""
    t, re, im, N, dT = orbit.trace.rows.T
    ring = p.ring
    U = re**2 + im**2
    incoming = np.sqrt(p.power / UW)
    coupled = 1j * np.sqrt(2 * ring.bus_rate * NS) * (re + 1j * im)
    rates, _ = internal_rates(ring)
    values = {
        "time": t * NS,
        "energy": U * FJ,
        "carriers": N * DENSITY,
        "delta_T": dT + p.rise,
        "drop": 2 * ring.drop_bus_rate * U * FJ,
        "through": np.abs(incoming + coupled) ** 2 * UW,
        "absorbed": absorbed_power(U, N, rates) * UW,
    }
    if ring.scattering_rate > 0:
        values["scattered"] = 2 * ring.scattering_rate * U * FJ
    values["weight"] = time_weights(orbit) * NS
    attrs = p.provenance("limit cycle") | _numbers(orbit)
    attrs["final_state"] = orbit.start * units(p.flow.rough.order)
    cycle = xr.Dataset(dataset.variables("time", values), attrs=attrs)
    return cycle.assign(_multipliers(orbit))


def _multipliers(orbit: Orbit) -> dict[str, Any]:
    return dataset.variables("multiplier", {"multipliers": orbit.multipliers})


def _numbers(orbit: Orbit) -> dict[str, Any]:
    """Attributes of the Dataset of a cycle: period, measures, settling time, stability and the reason in words."""
    measures = measure(orbit.trace.rows)
    period = orbit.T * NS
    kind = stability(orbit)
    size = orbit.size
    words = {
        "stable": f"a deviation shrinks to {size:.3g} of itself in a period",
        "doubled": f"the pulses alternate: a multiplier of {orbit.leading.real:.4g} lies below -1",
        "unstable": f"a deviation grows by {size:.4g} in a period",
    }[kind]
    if orbit.pulses > 1:
        words += f"; {orbit.pulses} pulses in a period"
    return {
        "period": period,
        "duty": measures.duty,
        "swing": measures.swing,
        "extinction": float(measures.extinction),
        "settling_time": _settling_time(period, size),
        "stability": kind,
        "pulses": orbit.pulses,
        "reason": words,
    }


def _settling_time(period: float, size: float) -> float:
    """Time in s in which a deviation falls to 1/e of itself; inf for a cycle that is not stable."""
    if size >= 1:
        return float("inf")
    return float(period / -np.log(size)) if size > 0 else 0.0


def stability(orbit: Orbit) -> str:
    """Stability of a cycle by its multipliers: "stable", "doubled" (a real multiplier below -1) or "unstable"."""
    if orbit.size < UNSTABLE:
        return "stable"
    return "doubled" if orbit.leading.real < -1 and orbit.leading.imag == 0 else "unstable"


def _of_circuit(
    circuit: Circuit,
    model: Any,
    power: Mapping[str, float],
    heaters: Heaters,
    detuning: float,
    settle: float,
) -> xr.Dataset:
    """The cycle of a circuit: a transient from cold of ``settle`` seconds, then `cycle_problem.pulse_train`."""
    settle = checks.between("settle", settle, 1e-9, 1, unit="s", hint="times are in s")
    system = autonomous(circuit, model, power, heaters, detuning)
    rough = system.problem(Method.RODAS4)
    fine = system.problem(Method.RODAS5P)
    duration = settle / NS
    run = Flow(fine, fine).run(fine.zero(), duration, MIDDLE)
    flows = [Flow(rough, fine, CARRIERS, k) for k in range(fine.rings)]
    has_carriers = any(flow.seen(run.rows).any() for flow in flows)
    if not has_carriers:
        flows = [replace(flow, quantity=ENERGY) for flow in flows]
    parts = [measured(run.rows[:, 0], flow.seen(run.rows), duration) for flow in flows]
    swings = [(part.high - part.low) / max(part.high, 1e-300) for part in parts]
    k = int(np.argmax(swings))  # the ring that pulses most
    if swings[k] < SWING:
        raise InputError("the circuit comes to rest and has no pulses there; steady_states finds it")
    if parts[k].rises < 3:
        raise InputError(f"settle = {settle:g} s holds fewer than three pulses in its last part; lengthen it")
    orbit, why, _ = pulse_train(flows[k], run.y, parts[k], wary=False, last=True)
    if orbit is None:
        raise InputError(
            f"settle = {settle:g} s leads to no cycle: {why}",
            "lengthen it, unless the pulses die away or never repeat",
        )
    start = {
        "final_state": orbit.start * units(fine.order, fine.rings),
        "model_tau": np.ravel(1 / system.heat.rate),
        "heater_states": np.concatenate([[], *system.heating.begin]),
    }
    times = np.linspace(0.0, orbit.T * NS, ROWS)
    powers = {laser.name: power.get(laser.name, 0.0) for laser in system.circuit.lasers}
    cycle = simulate(
        system.circuit, model, power=powers, detuning=detuning, heaters=heaters, duration=times[-1], rtol=FINE,
        times=times, initial=xr.Dataset(attrs=start),
    )  # fmt: skip
    cycle.attrs["period"] = float(times[-1])
    return cycle.assign(_multipliers(orbit))


def continue_cycle(
    ring: RingResonator,
    model: ThermalModel,
    parameter: str,
    values: tuple[float, float],
    *,
    power: float | None = None,
    detuning: float | None = None,
    guess: xr.Dataset | State | None = None,
    points: int = 1000,
    heaters: Heaters = None,
    heated: str | None = None,
    read: str | None = None,
) -> xr.Dataset:
    """Continue a cycle, stable or unstable, in one parameter, through its folds (pseudo-arclength).

        cycle equations (y_0, T, p) = 0,     tangent . (y_0 - y_p, T - T_p, p - p_p) = 0,     index p: predicted values

    Parameters
    ----------
    ring : RingResonator
    model : ThermalModel
        as for `limit_cycle`.
    parameter : str
        "power", "detuning", a field of the ring or its carriers, or a pole of a network ("R1", "tau2"), as for
        `cycle_derivatives`. The index of a pole is kept when its time constant crosses that of another.
    values : (float, float), SI
        range of the parameter: the branch starts towards the first value, and ends where it leaves the range.
    power, detuning : float, W and Hz, optional
        of the first cycle; by default those of ``guess``.
    guess : Dataset or State, optional
        as for `limit_cycle`, or a point of `hopf_curves` (``curve.isel(point=k)``), where the branch begins.
    points : int
        largest number of cycles.
    heaters : mapping of name to float, W, optional
        constant power in further inputs of a linear model, as for `simulate`; so are ``heated`` and ``read``.

    Returns
    -------
    xarray.Dataset
        over point, in the order of the branch: the parameter (SI), period (s), duty, swing (K), extinction (dB),
        highest_rise (K), drop_low and drop_high (W), stability ("stable", "doubled" or "unstable") and special ("",
        "fold", "period doubling", "torus" or "Hopf" at a bifurcation point); multipliers over (point, multiplier).
        attrs["reason"] says why the branch ends. Bifurcations are located to 1e-8 of the range. The branch also
        ends where a multiplier exceeds 1e10, as in a canard explosion, where the parameter hardly changes.

    Raises
    ------
    InputError
        as `limit_cycle`, an unknown parameter, values that are equal, or no cycle to begin with.

    Tested with Newton's law: runs of 1 ms on both sides of a fold, at detunings that differ by 1e-6, confirm it.

    Source: Kuznetsov, Elements of Applied Bifurcation Theory (2004), Section 10.2.

    >>> import coupled, surrogate
    >>> ring, newton = coupled.borghi2021().with_lumped_fcd(), surrogate.newton(tau_th=275e-9)
    >>> b = coupled.continue_cycle(ring, newton, "detuning", (20e9, -15e9), power=5.01e-3, detuning=-10e9)
    >>> print(f"{b.detuning.values[b.special == 'fold'].item() / 1e9:.3f} GHz; ends in {b.attrs['reason']}")
    4.598 GHz; ends in a Hopf point
    """
    points = checks.integer("points", points, 1, 100_000)
    warm = warmed(ring, model, heaters, heated, read)
    P, nu = _laser(guess, power, detuning, warm.turned(ring))
    ends = checks.array("values", values)
    if ends.shape != (2,) or ends[0] == ends[1]:
        raise InputError(f"values = {values!r} must be two different numbers, the ends of the range")
    p = CycleProblem(ring, warm.model, P, nu, warm.rise)
    family = Family(p, (parameter,), np.array([ends.max() - ends.min()]))
    here = value_of(p, parameter)
    if not ends.min() <= here <= ends.max():
        raise InputError(f"values = {ends.tolist()} do not hold {here:g}, the {parameter} of the first cycle")
    if is_hopf_point(guess):
        start, along = born(family, guess)
    else:
        orbit = cycle_near(p, guess)
        first = first_place(family, orbit.trace)
        if first is None:
            raise InputError(f"the cycle at {parameter} = {here:g} is too close to a fold to start from")
        start = first
        along = np.eye(first.unit.size)[-1] * (ends[0] - here or 1.0)
    cycles, why = branch.follow(family, start, along, ends, points)
    path = _dataset(family, cycles, why).assign_attrs(warm.attributes)
    trusted(model, path["highest_rise"].values - warm.rise)
    return path


def _laser(guess: Any, power: float | None, detuning: float | None, turn: float) -> tuple[float, float]:
    """Power (W) and detuning (Hz) of the first cycle; ``turn`` is the resonance shift by constant heaters in Hz."""
    attrs = getattr(guess, "attrs", {})
    of_hopf_point = is_hopf_point(guess)
    guessed = laser_of(guess, turn) if of_hopf_point else (attrs.get("input_power"), attrs.get("detuning", 0.0))
    P = guessed[0] if power is None else power
    nu = guessed[1] if detuning is None else detuning
    if P is None:
        raise InputError("power is missing: give the power in W of the first cycle, or a guess that has one")
    P = check_power(P)
    nu = check_detuning(nu)
    if of_hopf_point and (P, nu) != guessed:
        raise InputError("power and detuning are those of the Hopf point given as guess; leave them out")
    return P, nu


def _dataset(family: Family, cycles: list[branch.Found], why: str) -> xr.Dataset:
    """The cycles of a branch as a Dataset over point, in SI, with their stability, bifurcations and multipliers."""
    p = family.base
    places = [cycle.place for cycle in cycles]
    kinds = [stability(place.orbit) for place in places]
    special = [cycle.kind for cycle in cycles]
    several = [place.orbit.multipliers for place in places]
    variables = branch.described(family, places, stability=kinds, special=special)
    variables |= dataset.variables(("point", "multiplier"), {"multipliers": several})
    attrs = p.provenance("branch of cycles")
    attrs |= {"parameter": family.names[0], "reason": why}
    return xr.Dataset(variables, attrs=attrs)
