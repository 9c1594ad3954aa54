"""How the cost grows: with unknowns, poles, cells of a map and geometries of a campaign.

    python benchmarks/bench_scaling.py [largest number of unknowns]

One run each, CPU seconds (wall seconds of one worker for the campaign). The slope is d log(seconds)/d log(size).
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import skfem

import coupled
import surrogate
import thermofem as th
from thermofem.transient import integrate

SECOND = surrogate.second_order(kappa=7.45e5, tau_f=71e-9, tau_s=1030e-9, eta=0.29)
RING = coupled.borghi2021()


def cpu(call: Callable[[], object]) -> float:
    start = time.process_time()
    call()
    return time.process_time() - start


def refined(accuracy: float, times: int) -> th.StateSpace:
    """The reference strip on a mesh of this package, each triangle cut into four so many times."""
    heat = th.assemble(th.strip_ring(), accuracy=accuracy)
    mesh, section = heat.mesh, heat.geometry
    grid = skfem.MeshTri(mesh.points.T, mesh.triangles.T)
    grid = grid.with_subdomains({n: np.flatnonzero(mesh.region == k) for k, n in enumerate(mesh.region_names)})
    grid = grid.refined(times)
    region = np.empty(grid.t.shape[1], dtype=np.int64)
    for k, name in enumerate(mesh.region_names):
        region[grid.subdomains[name]] = k
    fine = th.mesh.Mesh(grid.p.T, grid.t.T, region, mesh.region_names)
    materials = [section.material_of(name) for name in mesh.region_names]
    held = grid.facets_satisfying(lambda x: np.isclose(x[1], section.bottom_z))
    k, c = (np.array([getattr(m, name) for m in materials])[region] for name in ("conductivity", "heat_capacity"))
    return th.fem.discretize(fine, k, c, th.fem.Surfaces(held=held)).state_space(("core",), ("core",))


def unknowns(most: float) -> dict[str, list[tuple[float, float]]]:
    times = np.concatenate([np.geomspace(1e-9, 20e-6, 60), 20e-6 + np.geomspace(1e-9, 20e-6, 60)])
    found: dict[str, list[tuple[float, float]]] = {
        "pulse at rtol 1e-3 in closed form, by unknowns": [],
        "the same stepped, by unknowns": [],
        "reduction to 1e-4, by unknowns": [],
    }
    for accuracy, cuts in ((1e-3, 0), (1e-4, 0), (1e-3, 1), (1e-4, 1), (1e-4, 2), (1e-4, 3)):
        system = refined(accuracy, cuts)
        if system.order > most:
            break
        closed = cpu(lambda s=system: s.response(th.Pulse(2e-3, 20e-6), times, rtol=1e-3))
        stepped = cpu(lambda s=system: integrate(s, th.Pulse(2e-3, 20e-6), times, rtol=1e-3))
        found["pulse at rtol 1e-3 in closed form, by unknowns"].append((system.order, closed))
        found["the same stepped, by unknowns"].append((system.order, stepped))
        found["reduction to 1e-4, by unknowns"].append((system.order, cpu(lambda s=system: surrogate.reduce(s, 1e-4))))
    return found


def poles() -> list[tuple[float, float]]:
    found = []
    for share in (1, 4, 16, 64):
        model = th.Foster(
            R=np.repeat(SECOND.R, share) / share, tau=np.outer(SECOND.tau, np.geomspace(0.9, 1.1, share)).ravel()
        )
        run = lambda m=model: coupled.simulate(RING, m, power=6.31e-3, detuning=0.0, duration=20e-6)  # noqa: E731
        run()
        found.append((2.0 * share, cpu(run)))
    return found


def cells() -> list[tuple[float, float]]:
    found = []
    for n in (4, 8, 16, 32):
        axes = 1e-3 * 10 ** np.linspace(0.3, 1, n), np.linspace(-30e9, 30e9, 2 * n)
        run = lambda a=axes: coupled.stability_map(RING, SECOND, *a)  # noqa: E731
        run()
        found.append((2.0 * n * n, cpu(run)))
    return found


CAMPAIGN = """
[[vary]]
path = "part.core.radius"
from = "4 um"
to = "12 um"
count = {}
[[drive]]
power = "1 mW"
samples = 21
"""


def geometries() -> list[tuple[float, float]]:
    from thermofem.campaign import Campaign
    from thermofem.campaign.campaign_file import fields

    section = th.strip_ring().to_toml().replace("[[", "[[geometry.").replace("\n[boundary]", "\n[geometry.boundary]")
    found = []
    for count in (16, 64, 256):  # few show the start of the worker only
        text = "accuracy = 1e-2\n[geometry]\n" + section + CAMPAIGN.format(count)
        plan = Campaign(**fields(text, Path()))
        with tempfile.TemporaryDirectory() as folder:
            start = time.perf_counter()
            plan.run(Path(folder) / "c", workers=1)
            found.append((float(count), time.perf_counter() - start))
    return found


def main(most: float) -> dict[str, list[tuple[float, float]]]:
    return {
        **unknowns(most),
        "20 us of self-pulsing, by poles": poles(),
        "stability map, by cells": cells(),
        "campaign of one worker, by geometries": geometries(),
    }


if __name__ == "__main__":
    print(json.dumps(main(float(sys.argv[1]) if len(sys.argv) > 1 else 4e5)))
