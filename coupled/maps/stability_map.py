"""Where in the plane of power and detuning the ring is stable, bistable or self-pulsing, without any integration.

The points of a map lie over power, detuning or numbers of the ring; all maps share them, and the fixed points at each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from thermofem import InputError, checks, dataset
from thermofem.arrays import Array, ArrayLike
from thermofem.models import ThermalModel

from ..equilibria.balance import absorbable, internal_ring
from ..equilibria.steady_states import Fixed, survey
from ..heaters import ConstantHeating, warmed
from ..inputs import MOST_POINTS, check_axis, check_ring
from ..kernel.units import NS, internal_detuning, internal_pump
from ..resonator import RingResonator
from ..ring_toml import UNITS
from ..thermal import Compact, Heaters, provenance, trusted, warn_at_top
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
        about = {"power": dataset.describe("input_power"), "detuning": dataset.describe("detuning")}
        return {
            name: (name, axis, about.get(name, {"units": UNITS.get(name) or "1", "long_name": name.replace("_", " ")}))
            for name, axis in zip(self.names, self.axes, strict=True)
        }

    @property
    def points(self) -> list[Point]:
        """All points, row after row."""
        return [point for row in self.rows for point in row]


def grid_of(
    ring: RingResonator, powers: ArrayLike, detunings: ArrayLike, vary: Mapping[str, ArrayLike] | None,
    heaters: ConstantHeating,
) -> Grid:  # fmt: skip
    """Return the grid of a map over two of power, detuning and the ring's numbers in ``vary``.

    The detunings of the points hold the shift of the resonance that constant heaters cause.

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
        return changed, values["power"], values["detuning"] + heaters.turned(changed)

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


def stability_map(
    ring: RingResonator,
    model: ThermalModel,
    powers: ArrayLike,
    detunings: ArrayLike,
    *,
    vary: Mapping[str, ArrayLike] | None = None,
    heaters: Heaters = None,
    heated: str | None = None,
    read: str | None = None,
) -> xr.Dataset:
    """Classify every point of a map by the eigenvalues at all of its fixed points.

        d(perturbation)/dt = J(U, D) perturbation,     growth = max Re eigenvalue(J)

    Parameters
    ----------
    ring : RingResonator
    model : ThermalModel
        as for `simulate`; the eigenvalues of a quadratic one are dense at every point, which takes longer.
    powers : array, shape (n,), W
        in the bus waveguide, larger than 0, increasing.
    detunings : array, shape (m,), Hz
        laser minus cold resonance, increasing.
    vary : mapping of str to array, optional
        other axes, as for `pulsing_map`.
    heaters : mapping of name to float, W, optional
        constant power in further inputs of a linear model, as for `simulate`; so are ``heated`` and ``read``.

    Returns
    -------
    xarray.Dataset
        over power (W) and detuning (Hz), or the axes given: regime, "self-pulsing" without a stable fixed point,
        "stable" with one, "bistable" with two or more; fixed_points and stable_points, their numbers; growth_rate
        (1/s) of the least unstable fixed point, and frequency (Hz) of its fastest growing or slowest decaying mode, 0
        if that is real.

    Raises
    ------
    InputError
        a power or detuning out of range or not increasing, an unknown name, not two axes, or a model that is not
        small, or not passive, or without a steady state at the powers.

    Where a limit cycle exists beside a stable point (a subcritical Hopf bifurcation, common with Newton's law), a ring
    switched on from cold may pulse although the point counts as stable here; `pulsing_map` integrates.

    Source: Borghi et al., Opt. Express 29, 4363 (2021), Section 4, for the maps.
    """
    warm = warmed(ring, model, heaters, heated, read)
    grid = grid_of(ring, powers, detunings, vary, warm)
    small = warm.model
    fixed, stable, growth, frequency, rise = _survey(small, grid)
    trusted(model, rise)
    names = np.array(["self-pulsing", "stable", "bistable"])
    columns = {
        "regime": names[np.minimum(stable, 2).astype(int)],
        "fixed_points": fixed.astype(int),
        "stable_points": stable.astype(int),
        "growth_rate": growth,
        "frequency": frequency,
    }
    attrs = provenance("stability map", ring, small) | grid.fixed | warm.attributes
    return xr.Dataset(dataset.variables(grid.names, columns), grid.coordinates(), attrs)


def _survey(model: Compact, grid: Grid) -> Array:
    """Return numbers of fixed and stable points, growth (1/s), frequency (Hz), highest rise (K), shape (5, n, m)."""
    points = grid.points
    largest = max(absorbable(ring, power) for ring, power, _ in points)
    if model.thermal_resistance * largest >= 2 * model.top:
        warn_at_top(model.top, f"the ring may absorb up to {largest:.2g} W at these powers")
    rows = []
    for found in fixed_of(model, points):
        if isinstance(found, str):
            raise InputError(found)
        least = found.growth.argmin()
        stable = (found.growth <= 0).sum()
        growth = found.growth[least] / NS
        frequency = found.omega[least] / (2 * np.pi * NS)
        rows.append([found.growth.size, stable, growth, frequency, found.every[:, 2].max()])
    return np.array(rows).T.reshape(5, *(axis.size for axis in grid.axes))
