"""Six cross-sections against a second solver: NGSolve (pip install ngsolve), on meshes and elements of its own.

Each geometry goes to NGSolve as polygons with materials; netgen meshes it, refined near the heat, and cubic elements
with the weight 2 pi r give R_th; the step at 1 us comes from a two-stage L-stable SDIRK method, extrapolated. Printed:
both results, the difference, and this package's own estimate, for accuracy = 1e-3.

    python benchmarks/bench_ngsolve.py our.json        # with thermofem: solves and writes the geometries
    python benchmarks/bench_ngsolve.py our.json --ngs  # with ngsolve, in the same or another environment: compares
"""

from __future__ import annotations

import json
import sys
from itertools import pairwise
from pathlib import Path


def ours(path: Path) -> None:
    from dataclasses import replace

    import thermofem as th

    strip = th.strip_ring()
    cavity = th.Part("cavity", "void", inner_radius=4e-6, outer_radius=12e-6, bottom=-6e-6, height=4e-6)
    tilted = replace(strip.parts[0], sidewall_angle=1.3)
    cases = {
        "strip": strip,
        "rib": th.rib_ring(),
        "disc": th.disc(),
        "heated": th.heated_ring(),
        "undercut": replace(strip, parts=(*strip.parts, cavity)),
        "trapezoid": replace(strip, parts=(tilted,)),
    }
    rows = []
    for name, geometry in cases.items():
        heat = th.assemble(geometry, 1e-3)
        step = th.solve(heat, th.Constant(1.0), [1e-6], rtol=1e-5)
        materials = {region: geometry.material_of(region) for region in heat.regions}
        rows.append(
            {
                "name": name,
                "resistance": heat.thermal_resistance(),
                "step": step.delta_T.item(),
                "estimate": step.attrs["discretization_error"],
                "bottom": geometry.bottom_z * 1e6,
                "faces": [
                    [face.owner, [(ring * 1e6).tolist() for ring in face.rings]] for face in geometry.subdivision.faces
                ],
                "k": {region: m.conductivity for region, m in materials.items()},
                "c": {region: m.heat_capacity for region, m in materials.items()},
            }
        )
    path.write_text(json.dumps(rows))


def theirs(row: dict) -> tuple[float, float]:
    """R_th and the step at 1 us in K/W, in um, us, W/(m K) -> 1e6 K/W and W s/(m^3 K) -> 1e-6."""
    import ngsolve as ng
    from netgen.geom2d import SplineGeometry

    owners, splines, points, lines = list(row["k"]), SplineGeometry(), {}, {}
    for owner, rings in row["faces"]:
        for ring in rings:
            for a, b in zip(ring, ring[1:] + ring[:1], strict=True):
                for p in (a, b):
                    points.setdefault(tuple(p), None)
                start, stop = tuple(a), tuple(b)
                if (stop, start) in lines:
                    lines[stop, start][1] = owner
                else:
                    lines[start, stop] = [owner, None]
    fine = {tuple(p) for owner, rings in row["faces"] if owner == "core" for ring in rings for p in ring}
    for p in points:
        points[p] = splines.AppendPoint(*p, maxh=0.001 if p in fine else 0.01)
    for (a, b), (left, right) in lines.items():
        held = abs(a[1] - row["bottom"]) + abs(b[1] - row["bottom"]) < 1e-9
        sides = owners.index(left) + 1, owners.index(right) + 1 if right else 0
        splines.Append(
            ["line", points[a], points[b]],
            leftdomain=sides[0],
            rightdomain=sides[1],
            bc="held" if held else "free",
            maxh=0.04 if a in fine and b in fine else 3,
        )
    for k, owner in enumerate(owners):
        splines.SetMaterial(k + 1, owner)
    mesh = ng.Mesh(splines.GenerateMesh(maxh=3, grading=0.3))
    space = ng.H1(mesh, order=3, dirichlet="held")
    u, v = space.TnT()
    weight = 2 * ng.pi * ng.x
    k = ng.CoefficientFunction([row["k"][name] for name in mesh.GetMaterials()])
    c = ng.CoefficientFunction([row["c"][name] * 1e-6 for name in mesh.GetMaterials()])
    stiffness = ng.BilinearForm(weight * k * ng.grad(u) * ng.grad(v) * ng.dx).Assemble().mat
    mass = ng.BilinearForm(weight * c * u * v * ng.dx).Assemble().mat
    core = ng.LinearForm(weight * v * ng.dx("core")).Assemble().vec
    volume = ng.Integrate(weight * ng.dx("core"), mesh)
    core.data = (1 / volume) * core
    steady = stiffness.Inverse(space.FreeDofs(), inverse="sparsecholesky") * core
    return 1e6 * ng.InnerProduct(core, steady), 1e6 * _step(ng, space, stiffness, mass, core)


def _step(ng: object, space: object, stiffness: object, mass: object, core: object) -> float:
    """Mean rise of the core after 1 us: SDIRK of order 2 on times (j/n)^3, extrapolated from n = 20 and 40."""

    def run(n: int) -> float:
        x = core.CreateVector()
        x[:] = 0
        times = [(j / n) ** 3 for j in range(n + 1)]
        theta = 1 - 2**-0.5  # two-stage SDIRK of order 2, L-stable
        for start, stop in pairwise(times):
            h = stop - start
            matrix = mass.CreateMatrix()
            matrix.AsVector().data = mass.AsVector() + theta * h * stiffness.AsVector()
            inverse = matrix.Inverse(space.FreeDofs(), inverse="sparsecholesky")
            first = (inverse * (core - stiffness * x)).Evaluate()
            second = (inverse * (core - stiffness * (x + (1 - theta) * h * first).Evaluate())).Evaluate()
            x.data += h * ((1 - theta) * first + theta * second)
        return ng.InnerProduct(core, x)

    coarse, fine = run(20), run(40)
    return fine + (fine - coarse) / 3


def compare(path: Path) -> None:
    print(
        f"{'':10}{'R_th':>10}{'NGSolve':>10}{'differ':>9}{'estimate':>10}{'step 1 us':>11}{'NGSolve':>10}{'differ':>9}"
    )
    for row in json.loads(path.read_text()):
        resistance, step = theirs(row)
        print(f"{row['name']:10}{row['resistance']:10.1f}{resistance:10.1f}", end="")
        print(f"{row['resistance'] / resistance - 1:9.1e}{row['estimate']:10.1e}", end="")
        print(f"{row['step']:11.1f}{step:10.1f}{row['step'] / step - 1:9.1e}", flush=True)


if __name__ == "__main__":
    (compare if "--ngs" in sys.argv else ours)(Path(sys.argv[1]))
