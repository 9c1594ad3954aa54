"""A family of rings beside the member's own mesh and scikit-learn's way, error beside the time.

    python benchmarks/bench_family.py [members]

Radius 4 to 12 um, width 400 to 600 nm, box 1 to 3 um. Errors are the largest of R_th and of the step response at 41
times from 1 ns to 100 us, relative, over unseen random members on meshes of accuracy 1e-4. scikit-learn gets as many
solved members as the family: logarithms of their step responses in 12 principal components, and a Gaussian process for
each.
Times are CPU seconds of one run, of members medians.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import surrogate
import thermofem as th
from thermofem.campaign import Variation

TIMES = np.geomspace(1e-9, 1e-4, 41)
VARIED = (
    Variation("radius", ("part.core.radius",), "m", low=4e-6, high=12e-6),
    Variation("width", ("part.core.width",), "m", low=400e-9, high=600e-9),
    Variation("box", ("layer.box.thickness",), "m", low=1e-6, high=3e-6),
)


def timed(call: Callable[[], Any], repeats: int = 1) -> tuple[Any, float]:
    """The result and the median of CPU seconds."""
    taken = []
    for _ in range(repeats):
        start = time.process_time()
        result = call()
        taken.append(time.process_time() - start)
    return result, float(np.median(taken))


def gaussian_process(family: surrogate.family.Family, members: int) -> Callable[[np.ndarray], np.ndarray]:
    """Step responses of new members from those of solved ones."""
    from sklearn.decomposition import PCA
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel

    box = family.box
    rows = box.draw(members, seed=5)
    steps = np.array([th.assemble(box.geometry(row), 5e-4).system.step_response(TIMES, rtol=1e-5) for row in rows])
    parts = PCA(min(12, members - 1)).fit(np.log(steps))
    kernel = ConstantKernel(1.0, (1e-3, 1e6)) * RBF(np.ones(box.size), (0.05, 100.0))
    shares = (np.log(rows) - np.log(box.low)) / np.log(box.high / box.low)
    scores = parts.transform(np.log(steps))
    fits = [GaussianProcessRegressor(kernel, alpha=1e-8, normalize_y=True).fit(shares, score) for score in scores.T]

    def predict(row: np.ndarray) -> np.ndarray:
        share = ((np.log(row) - np.log(box.low)) / np.log(box.high / box.low))[None]
        return np.exp(parts.inverse_transform(np.array([[fit.predict(share)[0] for fit in fits]])))[0]

    return predict


def rows(members: int = 10) -> list[dict[str, Any]]:
    """Rows of the table of peers; ratios to one member of the family."""
    plan = th.Campaign(th.strip_ring().to_toml(), VARIED, samples=1)
    family, training = timed(lambda: surrogate.train_family(plan, 1e-3))
    solved = family.provenance["solved_members"]
    predict, learning = timed(lambda: gaussian_process(family, solved))
    unseen = family.box.draw(members, seed=77)
    exact = [th.assemble(family.box.geometry(row), 1e-4).system.step_response(TIMES, rtol=1e-6) for row in unseen]
    each = [dict(zip(family.names, map(float, row), strict=True)) for row in unseen]
    ours = max(np.abs(family.at(v).step_response(TIMES) / e - 1).max() for v, e in zip(each, exact, strict=True))
    theirs = max(np.abs(predict(row) / e - 1).max() for row, e in zip(unseen, exact, strict=True))
    own, mesh = timed(lambda: surrogate.reduce(th.assemble(family.box.geometry(unseen[0]), 1e-3).system, 1e-4).model, 3)
    v = each[0]
    many = {name: np.resize(unseen[:, k], 100_000) for k, name in enumerate(family.names)}
    member = timed(lambda: family.at(v), 51)[1]
    found = [
        ("one member of the family", f"{family.size} functions, R_i >= 0", ours, member),
        ("its R_th alone", "one Cholesky factorization", ours, timed(lambda: family.thermal_resistance(**v), 51)[1]),
        ("R_th of 100 000 members", "arrays", ours, timed(lambda: family.thermal_resistance(**many))[1]),
        ("one member by its own mesh", "certified", np.abs(own.step_response(TIMES) / exact[0] - 1).max(), mesh),
        ("one member by scikit-learn", "12 Gaussian processes", theirs, timed(lambda: predict(unseen[0]), 11)[1]),
        ("training of the family", f"{solved} members and 8 held out", float(family.error), training),
        ("training of scikit-learn", f"{solved} members", theirs, learning),
    ]
    return [
        {"who": who, "how": how, "error": float(error), "seconds": seconds, "ratio": seconds / member}
        for who, how, error, seconds in found
    ]


if __name__ == "__main__":
    for row in rows(int(sys.argv[1]) if len(sys.argv) > 1 else 10):
        print(f"{row['who']:30}{row['how']:34}{row['error']:10.1e}{row['seconds']:12.3g} s{row['ratio']:10.3g}")
