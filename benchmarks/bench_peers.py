"""The full-order transient against named peers, on one mesh, at one error.

    python benchmarks/bench_peers.py [accuracy] [repeats]

The task: the mesh of the reference strip, 2 mW for 20 us, 40 us recorded, error below 1e-3 of the largest rise. Each
peer takes the largest step, or the loosest tolerance, of a sequence that meets the error, else its last. They take
turns, CPU time, medians, each from the matrices on. The reference is our integrator at rtol 1e-7 on the same matrices;
femwell, planar and with linear elements, is judged by its own run with eight times as many steps. What is not installed
is left out.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from statistics import median

import numpy as np
from bench_heat import PULSE, TIMES, crank_nicolson, error

import thermofem as th
from thermofem.transient import integrate
from thermofem.transient.integration import Trajectory
from thermofem.transient.modal import Modal

WANTED = 1e-3
Run = tuple[float, float, str]  # CPU seconds, error, how


def closed_form(system: th.StateSpace, rtol: float) -> Trajectory:
    return Modal(system).run(system.C, PULSE, TIMES, rtol=rtol)


def stepped(system: th.StateSpace, rtol: float) -> Trajectory:
    return integrate(system, PULSE, TIMES, rtol=rtol)


def timed(call: Callable[[], object]) -> tuple[float, object]:
    start = time.process_time()
    result = call()
    return time.process_time() - start, result


def ours(run: Callable[[], Trajectory], reference: np.ndarray, rtol: float) -> Run:
    seconds, found = timed(run)
    left = float(np.abs(found.outputs[:, 0] - reference).max() / reference.max())
    return seconds, left, f"rtol {rtol:g}, {found.solves} solves, {found.factorizations} factorizations"


def by_hand(system: th.StateSpace, reference: np.ndarray, steps: int) -> Run:
    seconds, run = timed(lambda: crank_nicolson(system, steps))
    return seconds, error(*run, reference), f"{2 * steps} steps"


def ngsolve_setup(heat: th.fem.HeatProblem) -> Callable[[np.ndarray, int], Run]:
    """NGSolve's own quadratic elements on our mesh; what is timed is factorization and steps."""
    import ngsolve as ng
    from netgen.meshing import Element2D, FaceDescriptor, Mesh as NetgenMesh, MeshPoint, Pnt

    mesh, grid = heat.mesh, NetgenMesh(dim=2)
    points = [grid.Add(MeshPoint(Pnt(*(1e6 * p), 0))) for p in mesh.points]
    for k, name in enumerate(mesh.region_names, start=1):
        grid.Add(FaceDescriptor(surfnr=k, domin=k, bc=k))
        grid.SetMaterial(k, name)
    for triangle, region in zip(mesh.triangles, mesh.region, strict=True):
        grid.Add(Element2D(int(region) + 1, [points[i] for i in triangle]))
    grid = ng.Mesh(grid)
    section = heat.geometry
    space = ng.H1(grid, order=2)
    held = ng.BitArray(space.ndof)
    held[:] = True
    bottom = section.bottom_z * 1e6
    for vertex in grid.vertices:  # the bottom is held: its vertices and the edges between two of them
        if abs(vertex.point[1] - bottom) < 1e-9:
            for dof in space.GetDofNrs(vertex):
                held[dof] = False
    for edge in grid.edges:
        if all(abs(grid[v].point[1] - bottom) < 1e-9 for v in edge.vertices):
            for dof in space.GetDofNrs(edge):
                held[dof] = False
    u, v = space.TnT()
    weight = 2 * ng.pi * ng.x
    materials = [section.material_of(name) for name in grid.GetMaterials()]
    k = ng.CoefficientFunction([m.conductivity for m in materials])
    c = ng.CoefficientFunction([m.heat_capacity * 1e-6 for m in materials])
    stiffness = ng.BilinearForm(weight * k * ng.grad(u) * ng.grad(v) * ng.dx).Assemble().mat
    mass = ng.BilinearForm(weight * c * u * v * ng.dx).Assemble().mat
    core = ng.LinearForm(weight * v * ng.dx("core")).Assemble().vec
    core.data = (1 / ng.Integrate(weight * ng.dx("core"), grid)) * core

    def factor(h: float) -> object:
        matrix = mass.CreateMatrix()
        matrix.AsVector().data = mass.AsVector() + h * stiffness.AsVector()
        return matrix.Inverse(held, inverse="sparsecholesky")

    def march(steps: int) -> tuple[np.ndarray, np.ndarray]:
        h = 20.0 / steps
        half, quarter = factor(h / 2), factor(h / 4)
        x, right, change = core.CreateVector(), core.CreateVector(), core.CreateVector()
        x[:] = 0
        times, rise = [0.0], [0.0]
        for power in (2e-3, 0.0):
            for n in range(steps):
                for _ in range(4 if n == 0 else 1):
                    right.data = power * 1e6 * core - stiffness * x
                    change.data = (quarter if n == 0 else half) * right
                    x.data += (h / 4 if n == 0 else h) * change
                times.append(times[-1] + h)
                rise.append(ng.InnerProduct(core, x))
        return 1e-6 * np.array(times), np.array(rise)

    def run(reference: np.ndarray, steps: int) -> Run:
        seconds, found = timed(lambda: march(steps))
        return seconds, error(*found, reference), f"{2 * steps} steps"

    return run


def femwell_setup(heat: th.fem.HeatProblem) -> Callable[[int], Run]:
    """femwell's planar transient with linear elements on our mesh: the same triangles, materials and power."""
    import skfem
    from femwell.thermal_transient import solve_thermal_transient

    mesh, section = heat.mesh, heat.geometry
    names = mesh.region_names
    grid = skfem.MeshTri(mesh.points.T, mesh.triangles.T).with_subdomains(
        {name: np.flatnonzero(mesh.region == k) for k, name in enumerate(names)}
    )
    bottom = section.bottom_z
    grid = grid.with_boundaries({"bottom": lambda x: np.isclose(x[1], bottom)})
    basis0 = skfem.Basis(grid, skfem.ElementTriP0())
    materials = [section.material_of(name) for name in names]
    k = np.array([m.conductivity for m in materials])[mesh.region]
    diffusivity = np.array([m.diffusivity for m in materials])[mesh.region]
    core = section.parts[0]
    area = (core.outer_radius - core.inner_radius) * core.height
    length = np.pi * (core.outer_radius + core.inner_radius)
    current = np.sqrt(2e-3 / (length * area))  # with a conductivity of 1: j^2 is the power density

    def march(steps: int) -> tuple[np.ndarray, np.ndarray]:
        h = 20e-6 / steps
        basis, fields = solve_thermal_transient(
            basis0,
            k,
            diffusivity,
            {"core": 1.0},
            {"core": 0.0},
            {"core": lambda t: current if t < 20e-6 - h / 2 else 0.0},
            {"bottom": 0.0},
            h,
            2 * steps,
        )
        inside = np.unique(basis.mesh.t[:, basis.mesh.subdomains["core"]])
        return h * np.arange(2 * steps + 1), np.array([field[inside].mean() for field in fields])

    times, fine = march(8 * 400)
    from scipy.interpolate import CubicSpline

    edge = 8 * 400
    reference = np.where(
        TIMES <= 20e-6,
        CubicSpline(times[: edge + 1], fine[: edge + 1])(np.minimum(TIMES, 20e-6)),
        CubicSpline(times[edge:], fine[edge:])(np.maximum(TIMES, 20e-6)),
    )

    def run(steps: int) -> Run:
        seconds, found = timed(lambda: march(steps))
        return seconds, error(*found, reference), f"{2 * steps} steps, linear elements, planar"

    return run


def petsc_setup(heat: th.fem.HeatProblem, reference: np.ndarray, folder: Path) -> Callable[[float], Run] | None:
    """Writes the matrices for peer_petsc.py; None where no Python has petsc4py."""
    found = sorted(Path("/usr/lib/petscdir").glob("petsc*/*-real/lib/python3/dist-packages/petsc4py"))
    python = Path("/usr/bin/python3")
    if not found or not python.exists():
        return None
    E, A = heat.system.E.tocsr(), heat.system.A.tocsr()
    parts = {}
    for name, matrix in (("E", E), ("A", A)):
        matrix.sort_indices()
        parts |= {f"{name}_{key}": getattr(matrix, key) for key in ("indptr", "indices", "data")}
    half = TIMES.reshape(2, -1).T - [0, 20e-6]
    np.savez(
        folder / "m.npz",
        b=heat.system.B[:, 0],
        c=heat.system.C[0],
        times=half,
        reference=reference.reshape(2, -1).T,
        **parts,
    )
    environment = {**os.environ, "PETSC_DIR": str(found[-1].parents[3]), "PYTHONPATH": ""}

    def run(rtol: float) -> Run:
        command = [str(python), str(Path(__file__).with_name("peer_petsc.py")), str(folder / "m.npz"), str(rtol)]
        done = subprocess.run(command, capture_output=True, text=True, env=environment, check=True)
        row = json.loads(done.stdout.splitlines()[-1])
        return row["seconds"], row["error"], f"rtol {rtol:g}, {row['steps']} steps"

    return run


def loosest(run: Callable[[float], Run], values: list[float]) -> float:
    """The first of the values whose error is small enough, else the last."""
    return next((value for value in values if run(value)[1] <= WANTED), values[-1])


def main(accuracy: float, repeats: int) -> list[dict[str, object]]:
    """Rows of the table."""
    heat = th.assemble(th.strip_ring(), accuracy=accuracy)
    system = heat.system
    reference = integrate(system, PULSE, TIMES, rtol=1e-7).outputs[:, 0]
    steps = [int(100 * 2 ** (k / 2)) for k in range(8, 15)]
    candidates: dict[str, tuple[Callable[[float], Run], list[float]]] = {
        "thermofem": (lambda rtol: ours(lambda: closed_form(system, rtol), reference, rtol), [1e-3]),
        "thermofem, stepping": (lambda rtol: ours(lambda: stepped(system, rtol), reference, rtol), [1e-3]),
        "scikit-fem, Crank–Nicolson by hand": (lambda n: by_hand(system, reference, int(n)), steps),
    }
    rows: list[dict[str, object]] = []
    if find_spec("ngsolve"):
        march = ngsolve_setup(heat)
        candidates["NGSolve, Crank–Nicolson by hand"] = (lambda n: march(reference, int(n)), steps)
    else:
        rows.append({"who": "NGSolve", "how": "not installed"})
    with tempfile.TemporaryDirectory() as folder:
        petsc = petsc_setup(heat, reference, Path(folder))
        if petsc:
            candidates["PETSc TS, adaptive Rosenbrock-W"] = (petsc, [1e-2, 1e-3, 1e-4, 3e-5, 1e-5])
        else:
            rows.append({"who": "PETSc TS", "how": "no petsc4py (Debian: apt-get install python3-petsc4py)"})
        if find_spec("femwell"):
            planar = femwell_setup(heat)
            candidates["femwell, solve_thermal_transient"] = (lambda n: planar(int(n)), [100, 200, 400])
        else:
            rows.append({"who": "femwell", "how": "not installed"})
        chosen = {name: loosest(run, values) for name, (run, values) in candidates.items()}
        taken: dict[str, list[Run]] = {name: [] for name in candidates}
        for _ in range(repeats):
            for name, (run, _) in candidates.items():
                taken[name].append(run(chosen[name]))
    first = [seconds for seconds, *_ in taken["thermofem"]]
    done = [
        {
            "who": name,
            "how": runs[0][2],
            "error": runs[0][1],
            "seconds": median(seconds for seconds, *_ in runs),
            "ratio": median(seconds / own for (seconds, *_), own in zip(runs, first, strict=True)),
        }
        for name, runs in taken.items()
    ]
    return [{"unknowns": heat.unknowns, **row} for row in done + rows]


if __name__ == "__main__":
    numbers = [float(a) for a in sys.argv[1:]]
    for row in main(numbers[0] if numbers else 1e-4, int(numbers[1]) if len(numbers) > 1 else 5):
        print(json.dumps(row))
