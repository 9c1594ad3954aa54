"""Continuation of a limit cycle in one parameter of the ring, the laser or the thermal model."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from thermofem import InputError, checks
from thermofem.models import ThermalModel

from ..arguments import check_detuning, check_power, check_ring
from ..heaters import constant
from ..resonator import RingResonator
from ..states import State
from ..thermal import check_model, provenance, trusted
from . import branch
from .branch import born, is_hopf_point, laser_of
from .cycle_problem import CycleProblem, value_of
from .limit_cycle import cycle_near, stability
from .multiple_shooting import Family, first_place

MOST_CYCLES = 100_000  # cycles of a branch


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
    heaters: Mapping[str, float] | None = None,
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
    check_ring(ring)
    points = checks.integer("points", points, 1, MOST_CYCLES)
    warm = constant(model, ring.read, heaters, heated, read)
    doubts = check_model(ring, model, warm.model, read)
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
        first = first_place(family, cycle_near(p, guess).trace)
        if first is None:
            raise InputError(f"the cycle at {parameter} = {here:g} is too close to a fold to start from")
        start = first
        along = np.eye(first.unit.size)[-1] * (ends[0] - here or 1.0)
    cycles, why = branch.follow(family, start, along, ends, points)
    path = _dataset(family, cycles, why).assign_attrs(warm.attributes | doubts)
    trusted(model, path["highest_rise"].values - warm.rise)
    return path


def _laser(guess: Any, power: float | None, detuning: float | None, turn: float) -> tuple[float, float]:
    """Power (W) and detuning (Hz) of the first cycle; ``turn`` is the resonance shift by constant heaters in Hz."""
    attrs = getattr(guess, "attrs", {})
    of_cycle = attrs.get("input_power"), attrs.get("detuning", 0.0)
    of_guess = laser_of(guess, turn) if is_hopf_point(guess) else of_cycle
    P = of_guess[0] if power is None else power
    nu = of_guess[1] if detuning is None else detuning
    if P is None:
        raise InputError("power is missing: give the power in W of the first cycle, or a guess that has one")
    P = check_power(P)
    nu = check_detuning(nu)
    if is_hopf_point(guess) and (P, nu) != of_guess:
        raise InputError("power and detuning are those of the Hopf point given as guess; leave them out")
    return float(P), float(nu)


def _dataset(family: Family, cycles: list[branch.Found], why: str) -> xr.Dataset:
    """The cycles of a branch as a Dataset over point, in SI, with their stability, bifurcations and multipliers."""
    p = family.base
    places = [cycle.place for cycle in cycles]
    kind = {"units": "1", "long_name": "kind of the cycle"}
    variables = branch.described(family, places)
    variables["stability"] = ("point", [stability(place.orbit) for place in places], kind)
    special = {"units": "1", "long_name": "where the stability changes"}
    variables["special"] = ("point", [cycle.kind for cycle in cycles], special)
    several = np.array([place.orbit.multipliers for place in places])
    about = {"units": "1", "long_name": "Floquet multipliers"}
    variables["multipliers"] = (("point", "multiplier"), several, about)
    attrs = provenance("branch of cycles", p.ring, p.model)
    attrs |= {"input_power": p.power, "detuning": p.detuning}
    attrs |= {"parameter": family.names[0], "reason": why}
    return xr.Dataset(variables, attrs=attrs)
