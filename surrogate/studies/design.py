"""Design: the member of a family with wanted properties, and members that no other beats in all of them at once."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from thermofem import CrossSection, Foster, OutputMap, checks
from thermofem.arrays import Array

from ..family import Certified, Family
from ..family.family import ChannelNames
from .inverse_search import (
    LACKING,
    QUANTITIES,
    Follows,
    Quantity,
    Ranges,
    Search,
    at_edge,
    family_over,
    search_of,
    wanted_of,
)

CANDIDATES = 64  # members looked at before the search; the best of them begins it
REACHED = 2e-3  # relative misfit of every target below which it counts as reached
SEARCH_STEP = 1e-4  # of a range, of the differences behind the search
NEAR = 1e-3  # relative misfit that weighs as much as a whole range of distance from the nominal member
LOOKED_AT = 1024  # members, for the front


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
    channel : ChannelNames
        heated and read, of the properties.
    front : xarray.Dataset or None
        where several targets are not reached at once: over "member", quantities and parameters of those of 1024 that
        no other one beats in all targets.
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
    channel: ChannelNames
    front: xr.Dataset | None = field(default=None, repr=False)

    @property
    def model(self) -> Foster | OutputMap:
        """The thermal model of the member."""
        return self.family.of_channel(self.channel, self.values)

    @property
    def thermal_resistance(self) -> float:
        """R_th of the channel in K/W, on the member's own mesh."""
        return self.certified.model.channel(self.channel.heated, self.channel.read).thermal_resistance


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
    heated: str | None = None,
    read: str | None = None,
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
        of the training, and of the members that the search begins from and the front is made of.
    seed : int
    heated, read : str
        the channel of the members; default the first heated part, and itself or what the family reads first. A function
        then gets `Family.at`, which has the output "light", too, where the family reads it.

    Returns
    -------
    Design
        the nearest member where none reaches the target; ``message`` says so.

    Raises
    ------
    InputError
        a range outside the family's box, an unknown quantity, a target of zero, a negative
        target of a property that is positive, or no member that has the property.
    """
    for name, value in wanted_of(target).items():  # before a family is trained
        if name in QUANTITIES:
            checks.positive(f"target {name}", value)
    family = family_over(family, free, tolerance, executor)
    channel = family.channel(heated, read)
    search = search_of(family, free, target, fixed, optics, heated, read)
    x = _nearest(search, seed, executor)
    achieved = search.achieved(x)
    if np.isnan(list(achieved.values())).all():
        raise checks.InputError(f"no member of the {CANDIDATES} looked at has {search.missing}")
    reached = bool(np.all(np.abs(search.misfit(x)) <= REACHED))
    front = None if reached or len(achieved) == 1 else _front(search, seed, executor)
    active = at_edge([family.names[k] for k in search.moving], x)
    values = search.values(x)
    slopes = _sensitivity(search, values)
    message = _message(search, reached, achieved, active, slopes)
    reads = dict.fromkeys(of_member.read for of_member in search.properties.values())
    return Design(
        values=values,
        achieved=achieved,
        target=search.wanted,
        reached=reached,
        active=active,
        sensitivity=slopes,
        certified=family.certify(**values),
        message=f"{channel.heated} to {', '.join(reads)}: {message}",
        family=family,
        channel=channel,
        front=front,
    )


def _nearest(search: Search, seed: int, executor: Executor | None) -> Array:
    """Point of the unit cube with the smallest misfit, shape (free,).

        min over x of |misfit(x)|^2 + NEAR^2 |x - nominal|^2

    by least squares from the nominal member and the best candidates; the last term picks one of many solutions.
    """
    from scipy.optimize import least_squares
    from scipy.stats import qmc

    random = np.random.default_rng(checks.seed(seed))
    candidates = qmc.Sobol(len(search.moving), seed=random).random(CANDIDATES)
    costs = np.sum(search.misfits(candidates, executor) ** 2, axis=1)
    cheapest = np.argsort(costs)[:2]
    nominal = search.nominal

    def residual(x: Array) -> Array:
        return np.append(search.misfit(x), NEAR * (x - nominal))

    options = {"diff_step": SEARCH_STEP, "xtol": 1e-10, "ftol": 1e-12, "max_nfev": 40, "bounds": (0, 1)}
    starts = np.clip([nominal, *candidates[cheapest]], 1e-3, 1 - 1e-3)
    ends = [least_squares(residual, start, **options) for start in starts]
    best = min(ends, key=lambda end: float(end.cost))
    x: Array = best.x
    return x


def _sensitivity(search: Search, values: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """d(quantity)/d(parameter) by differences that stay inside the box."""
    box = search.family.box
    slopes: dict[str, dict[str, float]] = {quantity: {} for quantity in search.properties}
    steps = 10 * SEARCH_STEP * (search.high - search.low)
    for k in search.moving:
        name = box.names[k]
        below = max(values[name] - steps[k], box.low[k])
        above = min(values[name] + steps[k], box.high[k])
        for quantity, of_member in search.properties.items():
            down = of_member({**values, name: below})
            up = of_member({**values, name: above})
            slopes[quantity][name] = float((up - down) / (above - below))
    return slopes


def _message(
    search: Search,
    reached: bool,
    achieved: Mapping[str, float],
    active: Sequence[str],
    slopes: Mapping[str, Mapping[str, float]],
) -> str:
    """Text: whether the targets are reached, by one member of many, and which sensitivities are not known and why."""
    values = [f"{name} = {value:.6g} (wanted {search.wanted[name]:.6g})" for name, value in achieved.items()]
    verdict = "reached:" if reached else "no member that was looked at does that; the nearest gives"
    sentences = [f"{verdict} {', '.join(values)}"]
    if active:
        sentences.append(f"at the end of its range: {', '.join(active)}")
    targets = len(search.wanted)
    free = len(search.moving)
    if reached and targets < free:
        nominal = [f"{name} = {value:.6g}" for name, value in search.family.box.nominal.items()]
        many = f"{targets} wanted and {free} free: one solution of many, the nearest to"
        sentences.append(f"{many} {', '.join(nominal)} in units of the ranges")
    for quantity, by_name in slopes.items():
        names = ", ".join(name for name, slope in by_name.items() if np.isnan(slope))
        if names:
            reason = search.properties[quantity].reason
            sentences.append(f"no sensitivity of {quantity} to {names}: a member beside it has none ({reason})")
    return "; ".join(sentences)


def _front(search: Search, seed: int, executor: Executor | None) -> xr.Dataset | None:
    """Members, of `LOOKED_AT` random ones, that no other beats in all targets at once, sorted by the first quantity."""
    from scipy.stats import qmc

    sobol = qmc.Sobol(len(search.moving), seed=np.random.default_rng(seed))
    points = sobol.random(LOOKED_AT)
    misfits = np.abs(search.misfits(points, executor))
    front = []
    for x, misfit in zip(points, misfits, strict=True):
        no_worse = (misfits <= misfit).all(axis=1)
        better = (misfits < misfit).any(axis=1)
        beaten = np.any(no_worse & better)
        if not beaten and np.all(misfit < LACKING):
            front.append(search.achieved(x) | search.values(x))
    if not front:
        return None
    first = next(iter(search.properties))
    front.sort(key=lambda member: member[first])
    return xr.Dataset({name: ("member", [member[name] for member in front]) for name in front[0]})
