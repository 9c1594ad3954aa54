"""The points of a map: power and detuning, and whatever of the ring is varied with or instead of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thermofem import checks

from ..arguments import MOST_POINTS, check_axis, check_ring
from ..heaters import ConstantHeating
from ..resonator import RingResonator
from ..ring_toml import UNITS
from ..unknowns import check_counts, optical_names, varied

Array = NDArray[np.float64]

Point = tuple[RingResonator, float, float]  # ring, power in W, detuning in Hz


@dataclass(frozen=True, eq=False)
class Grid:
    """Two axes, and the ring, power and detuning of every point.

    Attributes
    ----------
    names : (str, str)
    axes : (array, array)
    rows : list of list of Point
        one list for each value of the first axis.
    fixed : dict of str to float
        power and detuning where they are no axes.
    """

    names: tuple[str, str]
    axes: tuple[Array, Array]
    rows: list[list[Point]]
    fixed: dict[str, float]

    def coordinates(self) -> dict[str, Any]:
        """Coordinates of the Dataset."""
        from thermofem.data import dataset

        about = {"power": dataset.describe("input_power"), "detuning": dataset.describe("detuning")}
        return {
            name: (name, axis, about.get(name, {"units": UNITS.get(name) or "1", "long_name": name.replace("_", " ")}))
            for name, axis in zip(self.names, self.axes, strict=True)
        }

    def warmed(self, heaters: ConstantHeating) -> Grid:
        """The points with the resonances shifted by constant heaters."""
        moved = [[(ring, power, nu + heaters.turned(ring)) for ring, power, nu in row] for row in self.rows]
        return replace(self, rows=moved) if heaters.rise else self


def grid_of(
    ring: RingResonator, powers: ArrayLike, detunings: ArrayLike, vary: Mapping[str, ArrayLike] | None,
    results: Sequence[str] = (),
) -> Grid:  # fmt: skip
    """Resolve the axes of a map; none may have the name of one of its ``results``.

    Raises
    ------
    InputError
        values out of range or not increasing, an unknown name, or not two axes.
    """
    check_ring(ring)
    laser = {"power": check_axis("powers", powers), "detuning": check_axis("detunings", detunings)}
    own: dict[str, Array] = {}
    for name, values in checks.mapping("vary", vary, hint='such as {"bus_rate": [3e10, 4e10]}').items():
        checks.choice("a name in vary", name, optical_names(ring))
        if name in results:
            raise checks.InputError(
                f"vary holds {name!r}, which is a result of the map, too; vary the detunings instead"
            )
        own[name] = checks.array(f"vary[{name!r}]", values)
        if np.any(np.diff(own[name]) <= 0):
            raise checks.InputError(f"vary[{name!r}] must increase from value to value; sort it")
        check_counts("vary", name, ring)
    axes = own | {name: axis for name, axis in laser.items() if axis.size > 1 or not own}
    if len(axes) != 2:
        raise checks.InputError(
            f"the map has the axes {', '.join(axes)}; it needs two: give the others as one number each"
        )
    fixed = {name: float(axis[0]) for name, axis in laser.items() if name not in axes}
    (first, one), (second, other) = axes.items()
    if one.size * other.size > MOST_POINTS:
        size = f"{one.size} x {other.size} points"
        raise checks.InputError(f"the map has {size}; at most {MOST_POINTS:,} are computed at one go")
    rows = []
    for a in one.tolist():
        row = []
        for b in other.tolist():
            at = fixed | {first: a, second: b}
            changed = varied(ring, {name: at[name] for name in own}) if own else ring
            row.append((changed, at["power"], at["detuning"]))
        rows.append(row)
    return Grid((first, second), (one, other), rows, fixed)
