"""Audit of families: members against their own certified reductions, passivity, calibrations, Sobol indices.

    python tests/audit/families.py [members] [random] [calibrations] [seed]

Trains the family of the documentation (radius 4 to 12 um, width 400 to 600 nm, box 1 to 3 um, tolerance 1e-3) and
prints the worst of `members` random members against meshes of their own, and how many of them lie beyond
`predicted_error`; that `random` members have R_i >= 0 and monotone steps; the pulls of `calibrations` synthetic
calibrations; and the first-order Sobol indices of R_th against a double loop of members drawn at random. Raises where a
promise does not hold.
"""

from __future__ import annotations

import sys

import numpy as np
from scipy import stats

import surrogate
import thermofem as th
from thermofem.campaign import Variation

VARIED = (
    Variation("radius", ("part.core.radius",), "m", low=4e-6, high=12e-6),
    Variation("width", ("part.core.width",), "m", low=400e-9, high=600e-9),
    Variation("box", ("layer.box.thickness",), "m", low=1e-6, high=3e-6),
)
TIMES = np.geomspace(1e-9, 1e-3, 61)
NOISE = 0.01  # K, of calibrations with 1 mW


def trained(tolerance: float = 1e-3) -> surrogate.family.Family:
    """The family of the documentation."""
    return surrogate.train_family(th.Campaign(th.strip_ring().to_toml(), VARIED, samples=1), tolerance)


def values(family: surrogate.family.Family, row) -> dict[str, float]:
    """A row as keyword arguments."""
    return dict(zip(family.names, map(float, row), strict=True))


def members(family: surrogate.family.Family, count: int, seed: int) -> None:
    """Random members against their own finer meshes."""
    off, beyond = [], 0
    for k, row in enumerate(family.box.at(np.random.default_rng(seed).random((count, family.box.size)))):
        error = family.certify(**values(family, row)).error
        beyond += error > family.predicted_error(**values(family, row))
        off.append(error)
        if (k + 1) % 10 == 0:
            print(
                f"{k + 1} members: worst {max(off):.2e}, median {np.median(off):.2e}, beyond predicted {beyond}",
                flush=True,
            )
    assert max(off) <= family.tolerance
    assert beyond <= 0.02 * count  # the estimate comes from eight members and is no bound


def passive(family: surrogate.family.Family, count: int, seed: int) -> None:
    """R_i >= 0 and steps that only rise."""
    for row in family.box.at(np.random.default_rng(seed + 1).random((count, family.box.size))):
        model = family.at(values(family, row))
        assert np.all(np.asarray(model.R) >= 0), row
        assert np.all(np.diff(model.step_response(TIMES)) >= 0), row
    print(f"{count} random members: R_i >= 0, monotone steps", flush=True)


def pulls(family: surrogate.family.Family, count: int, seed: int) -> None:
    """(found - truth)/standard error of synthetic calibrations."""
    rng, found = np.random.default_rng(seed + 2), []
    times = np.append(0.0, np.geomspace(2e-9, 50e-6, 150))
    for row in family.box.at(rng.uniform(0.2, 0.8, (count, family.box.size))):
        rise = 1e-3 * family.at(values(family, row)).step_response(times) + NOISE * rng.standard_normal(times.size)
        fit = surrogate.calibrate(family, th.dataset.build(times, rise, th.Constant(1e-3)), noise=NOISE)
        errors = np.array([fit.standard_errors[n] for n in family.names])
        found.append((np.array([fit.values[n] for n in family.names]) - row) / errors)
    table = np.array(found)
    # a mean square of n pulls scatters by sqrt(2/n)
    print(f"{count} calibrations: mean square of the pulls {np.mean(table**2, axis=0).round(2)}", flush=True)
    assert np.all(np.abs(np.mean(table**2, axis=0) - 1) < 4 * np.sqrt(2 / count))


def indices(family: surrogate.family.Family) -> None:
    """Var(E[R_th | p])/Var(R_th) by a double loop of 200 x 400 members."""
    spread = {v.name: stats.uniform(v.low, v.high - v.low) for v in VARIED}
    data, rng = surrogate.uncertainty(family, spread, samples=4096), np.random.default_rng(0)
    for name in spread:
        means, variances = [], []
        for _ in range(200):
            draws = {other: one.rvs(400, random_state=rng) for other, one in spread.items()}
            draws[name] = np.full(400, spread[name].rvs(random_state=rng))
            R = family.thermal_resistance(**draws)
            means.append(R.mean())
            variances.append(R.var())
        brute = np.var(means) / (np.var(means) + np.mean(variances))
        ours = data.first_order.sel(parameter=name).item()
        print(f"first-order index of {name}: {ours:.3f}, brute force {brute:.3f}", flush=True)
        assert abs(ours - brute) < 0.08  # 200 outer samples give a variance to 10 %


def main() -> None:
    """Everything in turn."""
    count, random, calibrations, seed = (
        int(x) for x in (sys.argv[1:] + ["300", "10000", "200", "0"][len(sys.argv) - 1 :])
    )
    family = trained()
    print(family, flush=True)
    indices(family)
    pulls(family, calibrations, seed)
    passive(family, random, seed)
    members(family, count, seed)


if __name__ == "__main__":
    main()
