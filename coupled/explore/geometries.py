"""A family of geometries for the page: members on a grid, on common time constants."""

from itertools import product
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from scipy.optimize import nnls

from thermofem import checks
from thermofem.arrays import Array

POINTS = {1: 33, 2: 13, 3: 8}  # of the grid along each parameter
TAU = np.geomspace(1e-9, 1e-4, 31)  # s; six a decade
TIMES = np.geomspace(2e-10, 1e-3, 90)  # s, at which steps are fitted


def family_of(family: Any) -> dict[str, Any]:
    """Return the grid of a `surrogate.family.Family`: R_i >= 0 on fixed time constants, linear between the points.

    Every point is fitted to the step response of its member by nonnegative least squares with its R_th, so what lies
    between is a mixture of steps: passive, and as far off as steps are from linear in the parameters. ``error`` is the
    largest deviation found on 24 random members, relative to R_th; ``scale`` leads from SI to the displayed unit. More
    than three parameters: the others stay at the middle of their range.
    """
    checks.has("family", family, "names", "box", "model", hint="surrogate.train_family or load_family makes one")
    low, high = (np.asarray(getattr(family.box, name), dtype=float) for name in ("low", "high"))
    names, units = list(family.names), list(family.box.units)
    moved = min(len(names), 3)
    points = POINTS[moved]
    middle = dict(zip(names, (low + high) / 2, strict=True))
    logs = [bool(log) for log in getattr(family.box, "logarithmic", [False] * len(names))]
    spaced = [np.geomspace if log else np.linspace for log in logs]
    axes = [spaced[k](low[k], high[k], points) for k in range(moved)]
    rows = np.array([_shares(family.model(**(middle | dict(zip(names, at, strict=False))))) for at in product(*axes)])
    grid = [np.linspace(0, 1, points)] * moved
    between = RegularGridInterpolator(grid, rows.reshape(*(points,) * moved, TAU.size))
    draw = np.random.default_rng(1)
    error = 0.0
    for _ in range(24):
        share = draw.uniform(0, 1, moved)
        values = {names[k]: _at(share[k], low[k], high[k], logs[k]) for k in range(moved)}
        exact = family.model(**(middle | values))
        found = -np.expm1(-TIMES[:, None] / TAU) @ between(share)[0]
        error = max(error, float(np.abs(found - exact.step_response(TIMES)).max() / exact.thermal_resistance))
    parameters = [
        {
            "name": names[k], "low": low[k], "high": high[k], "moved": k < moved, "log": logs[k],
            "unit": "µm" if units[k] == "m" else units[k], "scale": 1e6 if units[k] == "m" else 1.0,
        }
        for k in range(len(names))
    ]  # fmt: skip
    return {
        "parameters": parameters,
        "points": points,
        "tau": TAU.tolist(),
        "R": [[float(f"{x:.7g}") for x in row] for row in rows],
        "error": error,
    }


def _at(share: float, low: float, high: float, log: bool) -> float:
    """The value at a fraction of a range."""
    return float(low * (high / low) ** share if log else low + share * (high - low))


def _shares(model: Any) -> Array:
    """R_i >= 0 on the common time constants, with the member's R_th."""
    total = model.thermal_resistance
    A = np.vstack([-np.expm1(-TIMES[:, None] / TAU), 100 * np.ones(TAU.size)])
    found, _ = nnls(A, np.append(model.step_response(TIMES), 100 * total) / total)
    return np.asarray(found * total / found.sum())
