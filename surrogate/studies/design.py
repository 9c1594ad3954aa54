"""Design: the member of a family with wanted properties, and members that no other beats in all of them at once."""

import contextlib
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

from thermofem import CrossSection, Foster, OutputMap, checks
from thermofem.arrays import Array

from ..family import Certified, Family
from .inverse_search import QUANTITIES, Follows, Quantity, Ranges, Search, family_over, search_of, wanted_of

CANDIDATES = 64  # members looked at before the search; the best of them begins it
REACHED = 2e-3  # relative misfit of every target below which it counts as reached
ON_EDGE = 1e-6  # of a range: a parameter as near as this to its end is an active constraint
STEP = 1e-4  # of a range, of the differences behind the search
POPULATION, GENERATIONS = 40, 25
NONE = 1e30  # objective of a member without the property


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
        d(quantity)/d(parameter), per SI unit; nan where a member beside this one lacks the quantity, as ``message``
        then says.
    certified : Certified
        the member on its own mesh.
    message : str
    family : Family
    front : xarray.Dataset or None
        the Pareto front, see `surrogate.studies.design.pareto_front`, where several targets are not reached at once.
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
    front: xr.Dataset | None = field(default=None, repr=False)

    @property
    def model(self) -> Foster | OutputMap:
        """The thermal model of the member."""
        return self.family.at(self.values)


def design(
    family: Family | CrossSection,
    free: Ranges | None = None,
    *,
    target: Mapping[Quantity, float],
    fixed: Mapping[str, float] | None = None,
    optics: Follows | None = None,
    tolerance: float = 1e-3,
    executor: Executor | None = None,
    seed: int = 0,
) -> Design:
    """Find the member whose properties come nearest to the wanted ones.

        min over the box of sum over targets of (quantity/target - 1)^2

    Fewer targets than free parameters have many solutions. The one nearest to the geometry that the family was made of
    is returned, distances counted in the ranges of ``free``, and ``message`` says so.

    Parameters
    ----------
    family : Family, or a CrossSection of which one is trained over ``free``
    free : dict from parameter to (low, high), SI
        default all parameters over their whole range; of a CrossSection paths such as "part.core.width".
    target : dict from quantity to float
        "thermal_resistance" (K/W), "rise_time" (s, 10 to 90 %), "time_constant" (s, to 1 - 1/e), or any function of a
        thermal model: a settled period is
        ``lambda model: coupled.limit_cycle(ring, model, power=..., detuning=...).attrs["period"]``. A function that
        raises InputError, for a ring that does not pulse, or returns nan has no such property there.
    fixed : dict from parameter to float
        of the parameters that are not free; default the middle of their range, the geometric mean of a positive one.
    optics : Optics
        how the optics follow the geometry; functions then take a second argument, the dict of changes.
    tolerance : float
        of a family that is trained here.
    executor : concurrent.futures.Executor
        of the training and of the candidates that the search begins from.
    seed : int

    Returns
    -------
    Design
        the nearest member where none reaches the target; ``message`` says so, and ``front`` holds the Pareto front
        where there are several targets and pymoo is installed.

    Raises
    ------
    InputError
        a range outside the family's box, an unknown quantity, a target of zero, a negative
        target of a property that is positive, or no member that has the property.
    """
    for name, value in wanted_of(target).items():  # before a family is trained
        checks.finite("target", value, hint="words are for surrogate.studies.design.pareto_front")
        if name in QUANTITIES:
            checks.positive(f"target {name}", value)
    family = family_over(family, free, tolerance, executor)
    search = search_of(family, free, target, fixed, optics)
    wanted = {name: float(value) for name, value in search.wanted.items()}
    x = _nearest(search, seed, executor)
    got = search.achieved(x)
    if all(np.isnan(value) for value in got.values()):
        raise checks.InputError(f"no member of the {CANDIDATES} looked at has {search.missing}")
    reached, front = search.reached(x, REACHED), None
    if not reached and len(got) > 1:
        with contextlib.suppress(checks.MissingLibraryError):  # pymoo
            front = _front(search, GENERATIONS, seed)
    at = [family.names[k] for k, y in zip(search.moving, x, strict=True) if y <= ON_EDGE or y >= 1 - ON_EDGE]
    found = search.values(x)
    slopes = _sensitivity(search, found)
    return Design(
        values=found,
        achieved=got,
        target=wanted,
        reached=reached,
        active=tuple(at),
        sensitivity=slopes,
        certified=family.certify(**found),
        message=_message(search, reached, got, at, slopes),
        family=family,
        front=front,
    )


def _nearest(search: Search, seed: int, executor: Executor | None) -> Array:
    """Least squares in a unit cube from the nominal member and the best of some candidates."""
    from scipy.optimize import least_squares
    from scipy.stats import qmc

    starts = qmc.Sobol(len(search.moving), seed=np.random.default_rng(checks.seed(seed))).random(CANDIDATES)
    costs = np.sum(search.misfits(starts, executor) ** 2, axis=1)
    found = []
    for start in (search.nominal, *starts[np.argsort(costs)[:2]]):
        begin = np.clip(start, 1e-3, 1 - 1e-3)
        options = {"diff_step": STEP, "xtol": 1e-10, "ftol": 1e-12, "max_nfev": 40}
        found.append(least_squares(search.misfit, begin, bounds=(0, 1), **options))
    best = np.asarray(min(found, key=lambda end: float(end.cost)).x)
    if len(search.wanted) >= len(search.moving) or not search.reached(best, REACHED):
        return best
    ends = [np.asarray(end.x) for end in found]
    return min((_closest(search, end) for end in ends if search.reached(end, REACHED)), key=search.distance)


def _closest(search: Search, x: Array) -> Array:
    """The solution nearest to the nominal member, from one of many."""
    from scipy.optimize import minimize

    on = {"type": "eq", "fun": search.misfit}
    options = {"eps": STEP, "ftol": 1e-8, "maxiter": 30}
    end = minimize(lambda y: search.distance(y) ** 2, x, constraints=on, bounds=[(0, 1)] * len(x), options=options)
    y = np.clip(end.x, 0, 1)
    return y if search.reached(y, REACHED / 10) and search.distance(y) < search.distance(x) else x


def _sensitivity(search: Search, values: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """d(quantity)/d(parameter) by differences that stay inside the box."""
    family = search.family
    found: dict[str, dict[str, float]] = {name: {} for name in search.properties}
    for k in search.moving:
        name, h = family.names[k], 10 * STEP * (search.high[k] - search.low[k])
        ends = max(values[name] - h, family.box.low[k]), min(values[name] + h, family.box.high[k])
        for quantity, one in search.properties.items():
            down, up = (float(one({**values, name: end})) for end in ends)
            found[quantity][name] = (up - down) / (ends[1] - ends[0])
    return found


def _message(
    search: Search,
    reached: bool,
    got: Mapping[str, float],
    active: list[str],
    slopes: Mapping[str, Mapping[str, float]],
) -> str:
    """Whether the targets are reached, by one member of many, and which sensitivities are not known and why."""
    values = ", ".join(f"{name} = {value:.6g} (wanted {search.wanted[name]:.6g})" for name, value in got.items())
    found = f"reached: {values}" if reached else f"no member that was looked at does that; the nearest gives {values}"
    if active:
        found += f"; at the end of its range: {', '.join(active)}"
    wanted, free = len(search.wanted), len(search.moving)
    if reached and wanted < free:
        at = ", ".join(f"{name} = {value:.6g}" for name, value in search.family.box.nominal.items())
        found += f"; {wanted} wanted and {free} free: one solution of many, the nearest to {at} in units of the ranges"
    for quantity, each in slopes.items():
        if names := [name for name, slope in each.items() if np.isnan(slope)]:
            why = search.properties[quantity].reason
            found += f"; no sensitivity of {quantity} to {', '.join(names)}: a member beside it has none ({why})"
    return found


def pareto_front(
    family: Family | CrossSection,
    free: Ranges | None = None,
    *,
    target: Mapping[Quantity, float | str],
    fixed: Mapping[str, float] | None = None,
    optics: Follows | None = None,
    generations: int = GENERATIONS,
    seed: int = 0,
) -> xr.Dataset:
    """Return the Pareto front of several targets, by NSGA-II (pymoo) with 40 members a generation.

        objectives:  |quantity/target - 1|,  quantity ("smallest"),  -quantity ("largest")

    Parameters
    ----------
    family, free, fixed, optics : as for `design`
        a geometry is trained to 1e-3.
    target : dict from quantity to float, "smallest" or "largest"
        at least two quantities.
    generations : int
    seed : int

    Returns
    -------
    xarray.Dataset
        over "member", by the first quantity: every parameter (SI) and every quantity.

    Raises
    ------
    InputError
        fewer than two targets, an unknown word, what `design` refuses, or no member with all properties.

    Source: Deb et al., IEEE Trans. Evol. Comput. 6, 182 (2002).
    """
    generations = checks.integer("generations", generations, 1, 10000)
    checks.enough("target", len(target), 2, "quantities", hint="surrogate.design takes one")
    for value in wanted_of(target).values():
        if isinstance(value, str):
            checks.choice("target", value, ("smallest", "largest"), hint="or give a number")
    search = search_of(family_over(family, free, 1e-3), free, target, fixed, optics)
    return _front(search, generations, checks.seed(seed))


def _front(search: Search, generations: int, seed: int) -> xr.Dataset:
    """The result of `pareto_front`; MissingLibraryError without pymoo."""
    try:
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.problem import ElementwiseProblem
        from pymoo.optimize import minimize
    except ImportError:
        raise checks.MissingLibraryError('a Pareto front needs pymoo; pip install "thermofem[swarm]"') from None

    size, names = len(search.moving), list(search.properties)

    class Members(ElementwiseProblem):
        def __init__(self) -> None:
            super().__init__(n_var=size, n_obj=len(names), xl=np.zeros(size), xu=np.ones(size))

        def _evaluate(self, x: Array, out: dict[str, Any], *args: Any, **kwargs: Any) -> None:
            out["F"] = _objectives(search, search.achieved(x))

    ended = minimize(Members(), NSGA2(pop_size=POPULATION), ("n_gen", generations), seed=seed)
    found = [(search.values(x), search.achieved(x)) for x in np.atleast_2d(ended.X)]
    found = [pair for pair in found if not any(np.isnan(value) for value in pair[1].values())]
    if not found:
        raise checks.InputError(f"no member looked at has {search.missing}")
    found.sort(key=lambda pair: pair[1][names[0]])
    units = zip(search.family.names, search.family.box.units, strict=True)
    data: dict[str, Any] = {
        name: ("member", [values[name] for values, _ in found], {"units": unit, "long_name": name})
        for name, unit in units
    }
    data |= {name: ("member", [got[name] for _, got in found], {"long_name": name}) for name in names}
    return xr.Dataset(data, attrs={f"target {name}": search.wanted[name] for name in names})


def _objectives(search: Search, got: Mapping[str, float]) -> Array:
    """All of them to be made small; a member that lacks one property is beaten by every member that has all."""
    if any(np.isnan(value) for value in got.values()):
        return np.full(len(got), NONE)
    signs = {"smallest": 1.0, "largest": -1.0}
    pairs = ((value, search.wanted[name]) for name, value in got.items())
    return np.array([signs[w] * value if isinstance(w, str) else abs(value / w - 1) for value, w in pairs])
