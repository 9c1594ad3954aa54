"""The points of a map over power, detuning or numbers of the ring, and the fixed points at each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from thermofem import InputError, checks
from thermofem.arrays import Array, ArrayLike
from thermofem.data.dataset import describe

from ..equilibria.balance import absorbable, internal_ring
from ..equilibria.steady_states import Fixed, survey
from ..heaters import ConstantHeating
from ..inputs import MOST_POINTS, check_axis, check_ring
from ..kernel.units import internal_detuning, internal_pump
from ..resonator import RingResonator
from ..ring_toml import UNITS
from ..thermal import Compact
from ..unknowns import optical_names, varied

Point = tuple[RingResonator, float, float]  # ring, power in W, detuning in Hz


@dataclass(frozen=True, eq=False)
class Grid:
    """The two axes of a map, and the ring, power (W) and detuning (Hz) at every point.

    rows: a list of points for each value of the first axis.
    fixed: power and detuning by name where they are no axes.
    """

    names: tuple[str, str]
    axes: tuple[Array, Array]
    rows: list[list[Point]]
    fixed: dict[str, float]

    def coordinates(self) -> dict[str, Any]:
        """Return the coordinates of the map's Dataset, with units."""
        about = {"power": describe("input_power"), "detuning": describe("detuning")}
        return {
            name: (name, axis, about.get(name, {"units": UNITS.get(name) or "1", "long_name": name.replace("_", " ")}))
            for name, axis in zip(self.names, self.axes, strict=True)
        }

    @property
    def points(self) -> list[Point]:
        """All points, row after row."""
        return [point for row in self.rows for point in row]

    def warmed(self, heaters: ConstantHeating) -> Grid:
        """Return the grid with the detunings shifted by the resonance shift that constant heaters cause."""
        moved = [[(ring, power, nu + heaters.turned(ring)) for ring, power, nu in row] for row in self.rows]
        return replace(self, rows=moved) if heaters.rise else self


def grid_of(
    ring: RingResonator, powers: ArrayLike, detunings: ArrayLike, vary: Mapping[str, ArrayLike] | None
) -> Grid:  # fmt: skip
    """Return the grid of a map over two of power, detuning and the ring's numbers in ``vary``.

    Raises
    ------
    InputError
        values out of range or not increasing, an unknown name, or not two axes.
    """
    check_ring(ring)
    laser = {"power": check_axis("powers", powers), "detuning": check_axis("detunings", detunings)}
    of_ring: dict[str, Array] = {}
    for name, values in checks.mapping("vary", vary, hint='such as {"bus_rate": [3e10, 4e10]}').items():
        checks.choice("a name in vary", name, optical_names(ring))
        of_ring[name] = checks.array(f"vary[{name!r}]", values, increasing=True)
    axes = of_ring | {name: axis for name, axis in laser.items() if axis.size > 1 or not of_ring}
    if len(axes) != 2:
        raise InputError(f"the map has the axes {', '.join(axes)}; it needs two: give the others as one number each")
    fixed = {name: float(axis[0]) for name, axis in laser.items() if name not in axes}
    first, second = axes
    outer, inner = axes.values()
    checks.integer("number of points of the map", outer.size * inner.size, 1, MOST_POINTS)

    def point(a: float, b: float) -> Point:
        values = fixed | {first: a, second: b}
        changed = varied(ring, {name: values[name] for name in of_ring}) if of_ring else ring
        return changed, values["power"], values["detuning"]

    rows = []
    for a in outer.tolist():
        rows.append([point(a, b) for b in inner.tolist()])
    return Grid((first, second), (outer, inner), rows, fixed)


def fixed_of(model: Compact, points: list[Point]) -> list[Fixed | str]:
    """Return the fixed points at every point of a map, or the error message where they cannot be computed."""
    out: list[Fixed | str] = [""] * len(points)
    of_rings: dict[RingResonator, list[int]] = {}
    for k, (ring, _, _) in enumerate(points):
        of_rings.setdefault(ring, []).append(k)
    groups = list(of_rings.values())
    for cells in groups:
        ring = points[cells[0]][0]
        powers, detunings = np.array([points[k][1:] for k in cells]).T
        pump = internal_pump(ring, 1.0) * np.sqrt(powers)
        shift = internal_detuning(1.0) * detunings
        try:
            internal = internal_ring(ring, model, absorbable(ring, powers.max()))
            fixed: Sequence[Fixed | str] = survey(pump, shift, internal)
        except InputError as error:
            several = np.unique(powers)
            if several.size > 1:  # at the highest power, perhaps not at others
                groups += [[k for k in cells if points[k][1] == power] for power in several]
                continue
            fixed = [str(error)] * len(cells)
        for k, fixed_points in zip(cells, fixed, strict=True):
            out[k] = fixed_points
    return out
