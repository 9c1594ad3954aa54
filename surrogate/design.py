"""Design: the member of a family with wanted properties."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thermofem import Campaign, Constant, CrossSection, Foster, checks
from thermofem.campaign.vary import Schedule, Variation
from thermofem.display import shown
from thermofem.geometry.change import change

from .family import Certified, Family, train_family

Array = NDArray[np.float64]

Quantity = str | Callable[[Foster], float]

CANDIDATES = 64  # members looked at before the search; the best of them begins it
REACHED = 2e-3  # relative misfit of every target below which it counts as reached
ON_EDGE = 1e-6  # of a range: a parameter as near as this to its end is an active constraint
PENALTY = 10.0  # relative misfit of a member that has no such property, such as a ring that does not pulse
STEP = 1e-4  # of a range, of the differences behind the search


def rise_time(model: Foster) -> float:
    """Time from 10 to 90 % of the static rise after a step, in s."""
    from scipy.optimize import brentq

    tau = np.asarray(model.tau)
    total, span = model.thermal_resistance, (1e-4 * float(tau.min()), 50 * float(tau.max()))
    at = [
        brentq(lambda t, share=share: float(model.step_response(t)) / total - share, *span, xtol=1e-16, rtol=1e-12)
        for share in (0.1, 0.9)
    ]
    return float(at[1] - at[0])


QUANTITIES: dict[str, Callable[[Foster], float]] = {
    "thermal_resistance": lambda model: model.thermal_resistance,
    "rise_time": rise_time,
}


@shown
@dataclass(frozen=True, eq=False)
class Design:
    """A member of a family, and how well it meets its targets.

    Attributes
    ----------
    values : dict from parameter to float
    achieved, target : dict from quantity to float
    reached : bool
        every target to `REACHED`.
    active : tuple of str
        parameters at an end of their range.
    sensitivity : dict from quantity to dict from parameter to float
        d(quantity)/d(parameter), per SI unit.
    certified : Certified
        the member on its own mesh.
    message : str
    family : Family
    """

    values: dict[str, float]
    achieved: dict[str, float]
    target: dict[str, float]
    reached: bool
    active: tuple[str, ...]
    sensitivity: dict[str, dict[str, float]]
    certified: Certified = field(repr=False)
    message: str
    family: Family = field(repr=False)

    @property
    def model(self) -> Foster:
        """The thermal model of the member."""
        return self.family.at(self.values)


def design(
    family: Family | CrossSection,
    free: Mapping[str, tuple[float, float]] | None = None,
    *,
    target: Mapping[Quantity, float],
    fixed: Mapping[str, float] | None = None,
    tolerance: float = 1e-3,
    seed: int = 0,
) -> Design:
    """Find the member whose properties come nearest to the wanted ones.

        min over the box of sum over targets of (quantity/target - 1)^2

    Parameters
    ----------
    family : Family, or a CrossSection of which one is trained over ``free``
    free : dict from parameter to (low, high), SI
        default all parameters over their whole range; of a CrossSection paths such as "part.core.width".
    target : dict from quantity to float
        "thermal_resistance" (K/W), "rise_time" (s, 10 to 90 %), or any function of a thermal model: a settled period is
        ``lambda model: coupled.limit_cycle(ring, model, power=..., detuning=...).attrs["period"]``. A function that
        raises InputError, for a ring that does not pulse, or returns nan has no such property there.
    fixed : dict from parameter to float
        of the parameters that are not free; default the middle of their range.
    tolerance : float
        of a family that is trained here.
    seed : int

    Returns
    -------
    Design
        the nearest member where none reaches the target; ``message`` says so.

    Raises
    ------
    InputError
        a range outside the family's box, an unknown quantity, a target of zero, or no member that has the property.
    """
    family = family_over(family, free, tolerance)
    low, high, held = _ranges(family, free, fixed or {})
    if not target:
        raise checks.InputError('target is empty; give what is wanted, e.g. {"thermal_resistance": 9e3}')
    names = {_name(q): _function(q) for q in target}
    wanted = {_name(q): checks.finite(f"target {_name(q)}", value) for q, value in target.items()}
    if 0.0 in wanted.values():
        raise checks.InputError("a target of 0 has no relative misfit; give another value")
    moving = np.flatnonzero(high > low)

    def values_of(x: Array) -> dict[str, float]:
        row = held.copy()
        row[moving] = low[moving] + np.clip(x, 0, 1) * (high - low)[moving]
        return {name: float(value) for name, value in zip(family.names, row, strict=True)}

    def achieved(x: Array) -> dict[str, float]:
        model = family.at(values_of(x))
        return {name: _value(function, model) for name, function in names.items()}

    def misfit(x: Array) -> Array:
        got = achieved(x)
        return np.array([PENALTY if np.isnan(got[name]) else got[name] / wanted[name] - 1 for name in names])

    x = _search(misfit, len(moving), seed)
    got = achieved(x)
    if all(np.isnan(value) for value in got.values()):
        raise checks.InputError(f"no member of the {CANDIDATES} looked at has {' and '.join(names)}; take other ranges")
    off = {name: got[name] / wanted[name] - 1 for name in names}
    reached = all(abs(value) <= REACHED for value in off.values())
    at = [family.names[k] for k, y in zip(moving, x, strict=True) if y <= ON_EDGE or y >= 1 - ON_EDGE]
    found = values_of(x)
    return Design(
        values=found,
        achieved=got,
        target=wanted,
        reached=reached,
        active=tuple(at),
        sensitivity=_sensitivity(family, names, found, moving, low, high),
        certified=family.certify(**found),
        message=_message(reached, got, wanted, at),
        family=family,
    )


def family_over(
    given: Family | CrossSection, free: Mapping[str, tuple[float, float]] | None, tolerance: float
) -> Family:
    """A family as it is, or one trained over ranges of the parameters of a geometry."""
    if isinstance(given, Family):
        return given
    if not isinstance(given, CrossSection):
        raise checks.InputError(
            f"family is a {type(given).__name__}; surrogate.train_family or load_family gives one, or give a geometry"
        )
    if not free:
        raise checks.InputError('free is empty; name what may change, e.g. {"part.core.width": (400e-9, 600e-9)}')
    variations = []
    for path, ends in free.items():
        low, high = _ends(path, ends)
        variations.append(Variation(path, (path,), change(given, path).unit, low=low, high=high))
    schedule = Schedule("step", Constant(1e-3), (0.0, 1e-6))
    return train_family(Campaign(given.to_toml(), tuple(variations), (schedule,), samples=1), tolerance)


def _ends(name: str, ends: Any) -> tuple[float, float]:
    try:
        low, high = ends
    except (TypeError, ValueError):
        raise checks.InputError(f"{name} = {ends!r} must be a pair (low, high)") from None
    return checks.finite(f"{name}: low", low), checks.finite(f"{name}: high", high)


def _ranges(
    family: Family, free: Mapping[str, tuple[float, float]] | None, fixed: Mapping[str, float]
) -> tuple[Array, Array, Array]:
    """Low and high ends of all parameters, equal where one is fixed; and the values to begin from."""
    low, high, held = family.box.low.copy(), family.box.high.copy(), family.box.middle.copy()
    for name in (*(free or {}), *fixed):
        checks.choice("parameter", name, family.names)
    for k, name in enumerate(family.names):
        if free is not None and name in free:
            a, b = _ends(name, free[name])
            slack = 1e-9 * (high[k] - low[k])
            if not low[k] - slack <= a < b <= high[k] + slack:
                raise checks.InputError(
                    f"{name} = ({a:g}, {b:g}) must lie inside the family's {low[k]:g} .. {high[k]:g} "
                    f"{family.box.units[k]}"
                )
            low[k], high[k] = max(a, low[k]), min(b, high[k])
        elif free is not None or name in fixed:
            held[k] = checks.between(name, fixed.get(name, held[k]), low[k], high[k], unit=family.box.units[k])
            low[k] = high[k] = held[k]
    if not np.any(high > low):
        raise checks.InputError("nothing is free; name a parameter in free, or fix fewer")
    return low, high, held


def _name(quantity: Quantity) -> str:
    return quantity if isinstance(quantity, str) else getattr(quantity, "__name__", "quantity").strip("<>")


def _function(quantity: Quantity) -> Callable[[Foster], float]:
    if isinstance(quantity, str):
        return QUANTITIES[checks.choice("quantity", quantity, QUANTITIES, hint="or give a function of a model")]
    if not callable(quantity):
        raise checks.InputError(f"quantity = {quantity!r} is neither a name nor a function of a model")
    return quantity


def _value(function: Callable[[Foster], float], model: Foster) -> float:
    """A property of a model; nan where it has none."""
    try:
        return float(function(model))
    except checks.InputError:
        return np.nan


def _search(misfit: Callable[[Array], Array], size: int, seed: int) -> Array:
    """Least squares in a unit cube from the best of some candidates."""
    from scipy.optimize import least_squares
    from scipy.stats import qmc

    starts = qmc.Sobol(size, seed=np.random.default_rng(seed)).random(CANDIDATES)
    costs = [float(np.sum(misfit(x) ** 2)) for x in starts]
    ends = []
    for k in np.argsort(costs)[:2]:
        inside = np.clip(starts[k], 1e-3, 1 - 1e-3)
        ends.append(least_squares(misfit, inside, bounds=(0, 1), diff_step=STEP, xtol=1e-10, ftol=1e-12, max_nfev=40))
    return np.asarray(min(ends, key=lambda end: float(end.cost)).x)


def _sensitivity(
    family: Family,
    names: Mapping[str, Callable[[Foster], float]],
    values: Mapping[str, float],
    moving: NDArray[np.intp],
    low: Array,
    high: Array,
) -> dict[str, dict[str, float]]:
    """d(quantity)/d(parameter) by differences that stay inside the box."""
    found: dict[str, dict[str, float]] = {name: {} for name in names}
    for k in moving:
        name, h = family.names[k], 10 * STEP * (high[k] - low[k])
        ends = max(values[name] - h, family.box.low[k]), min(values[name] + h, family.box.high[k])
        models = [family.at({**values, name: end}) for end in ends]
        for quantity, function in names.items():
            pair = [_value(function, model) for model in models]
            found[quantity][name] = (pair[1] - pair[0]) / (ends[1] - ends[0])
    return found


def _message(reached: bool, got: Mapping[str, float], wanted: Mapping[str, float], active: list[str]) -> str:
    values = ", ".join(f"{name} = {value:.6g} (wanted {wanted[name]:.6g})" for name, value in got.items())
    edge = f"; at the end of its range: {', '.join(active)}" if active else ""
    return (
        f"reached: {values}" if reached else f"no member of this family does that; the nearest gives {values}"
    ) + edge
