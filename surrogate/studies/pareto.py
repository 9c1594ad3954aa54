"""The members of a family that no other member beats in all targets at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from thermofem import CrossSection, checks
from thermofem.arrays import Array

from ..family import Family
from .inverse_search import Follows, Quantity, Ranges, Search, family_over, search_of, wanted_of

if TYPE_CHECKING:
    import xarray as xr

POPULATION, GENERATIONS = 40, 25
GOALS = ("smallest", "largest")
NONE = 1e30  # objective of a member without the property


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
    family, free, fixed, optics : as for `surrogate.design`
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
    wanted = wanted_of(target)
    if len(wanted) < 2:
        raise checks.InputError("a Pareto front needs two targets or more; surrogate.design takes one")
    for value in wanted.values():
        if isinstance(value, str):
            checks.choice("target", value, GOALS, hint="or give a number")
    seed = checks.seed(seed)
    return front_of(search_of(family_over(family, free, 1e-3), free, target, fixed, optics), generations, seed)


def front_of(search: Search, generations: int = GENERATIONS, seed: int = 0) -> xr.Dataset:
    """The Pareto front of a search, by NSGA-II; arguments and result of `pareto_front`."""
    import xarray as xr

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
    family = search.family
    data: dict[str, Any] = {
        name: ("member", [values[name] for values, _ in found], {"units": unit, "long_name": name})
        for name, unit in zip(family.names, family.box.units, strict=True)
    }
    data |= {name: ("member", [got[name] for _, got in found], {"long_name": name}) for name in names}
    return xr.Dataset(data, attrs={f"target {name}": search.wanted[name] for name in names})


def _objectives(search: Search, got: Mapping[str, float]) -> Array:
    """All of them to be made small; a member that lacks one property is beaten by every member that has all."""
    if any(np.isnan(value) for value in got.values()):
        return np.full(len(got), NONE)
    found = []
    for name, value in got.items():
        wanted = search.wanted[name]
        if isinstance(wanted, str):
            found.append(value if wanted == "smallest" else -value)
        else:
            found.append(abs(value / wanted - 1))
    return np.array(found)
