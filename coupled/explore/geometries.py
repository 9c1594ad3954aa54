"""Family of geometries on the page: Foster networks of its members on a grid, with common time constants."""

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


def family_of(family: Any, read: str | None = None) -> dict[str, Any]:
    """Return Foster networks of a `surrogate.family.Family` on a grid of its parameters, and the interpolation error.

    read: the output of the family that detunes the ring; default its first.

    All members have the same time constants; R_i >= 0 is fitted to each member's step response by nonnegative least
    squares, with its R_th. Between grid points R_i is interpolated linearly, so the model stays passive. ``error``: the
    largest deviation of the step responses of 24 random members, relative to R_th; ``scale`` converts SI to the shown
    unit. Only the first three parameters vary; the others are fixed at the middle of their range.
    """
    checks.has("family", family, "names", "box", "model", hint="surrogate.train_family or load_family makes one")
    low = np.asarray(family.box.low, dtype=float)
    high = np.asarray(family.box.high, dtype=float)
    names = list(family.names)
    units = list(family.box.units)
    moved = min(len(names), 3)
    points = POINTS[moved]
    middle = dict(zip(names, (low + high) / 2, strict=True))
    read = read or getattr(family, "outputs", (None,))[0]
    logs = [bool(log) for log in getattr(family.box, "logarithmic", [False] * len(names))]
    spaced = [np.geomspace if log else np.linspace for log in logs]
    axes = [spaced[k](low[k], high[k], points) for k in range(moved)]
    shares = []
    for values in product(*axes):
        parameters = middle | dict(zip(names, values, strict=False))
        shares.append(_shares(family.model(read=read, **parameters)))
    rows = np.array(shares)
    grid = [np.linspace(0, 1, points)] * moved
    between = RegularGridInterpolator(grid, rows.reshape(*(points,) * moved, TAU.size))
    draw = np.random.default_rng(1)
    error = 0.0
    for _ in range(24):
        share = draw.uniform(0, 1, moved)
        member = {names[k]: _at(share[k], low[k], high[k], logs[k]) for k in range(moved)}
        exact = family.model(read=read, **(middle | member))
        step = -np.expm1(-TIMES[:, None] / TAU) @ between(share)[0]
        largest = np.abs(step - exact.step_response(TIMES)).max()
        error = max(error, float(largest / exact.thermal_resistance))
    sliders = [
        {
            "name": names[k], "low": low[k], "high": high[k], "moved": k < moved, "log": logs[k],
            "unit": "µm" if units[k] == "m" else units[k], "scale": 1e6 if units[k] == "m" else 1.0,
        }
        for k in range(len(names))
    ]  # fmt: skip
    return {
        "parameters": sliders,
        "points": points,
        "tau": TAU.tolist(),
        "R": [[float(f"{x:.7g}") for x in row] for row in rows],
        "error": error,
    }


def _at(share: float, low: float, high: float, log: bool) -> float:
    """Return the value at the fraction ``share`` of the range from low to high, linear or logarithmic."""
    if log:
        return float(low * (high / low) ** share)
    return float(low + share * (high - low))


def _shares(model: Any) -> Array:
    """Return R_i >= 0 in K/W, shape (31,), on the time constants TAU, fitted to a member's step response; sum R_th."""
    total = model.thermal_resistance
    A = np.vstack([-np.expm1(-TIMES[:, None] / TAU), 100 * np.ones(TAU.size)])
    b = np.append(model.step_response(TIMES), 100 * total) / total
    shares, _ = nnls(A, b)
    return shares * total / shares.sum()
