"""Two rings with silicon cores against a three-dimensional model in NGSolve (pip install ngsolve), static and in time.

The rings lie at x = +-10 um. NGSolve solves the quarter x > 0, y > 0 with cubic tetrahedra twice: with an insulated
plane x = 0, which is both rings heated, and with that plane held at 0, which is one ring heated and the other cooled.
Elements of third order: quadratic ones of the same size miss 1.5 % of the heated ring, and .02 % of the neighbour.
Half the sum is the heated ring, half the difference the neighbour. In time: a two-stage L-stable SDIRK method of order
2 with steps that double; twice as many steps say how good it is, smaller tetrahedra how good the mesh is.

    python benchmarks/bench_neighbours_3d.py our.json          # with thermofem: solves and writes
    python benchmarks/bench_neighbours_3d.py our.json --ngs    # with ngsolve, in the same or another environment
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np

DISTANCE, SIDE = 20.0, 90.0  # um: of the rings, and from the middle to the insulated sides
FIRST, DOUBLINGS = 50e-9, 9  # s, step, doubled so many times
STEPS = 8  # of each length


def ours(path: Path) -> None:
    """Static values and step responses of the reduction, in K/W."""
    import surrogate
    import thermofem as th

    heat = th.assemble(th.strip_ring(outer_radius=120e-6), 1e-3)
    array = surrogate.reduce_array(heat, [(0, 0), (DISTANCE * 1e-6, 0)])
    times = ends()
    steps = [array.channel(0, k).step_response(times).tolist() for k in (0, 1)]
    path.write_text(json.dumps({"static": array.crosstalk[0].tolist(), "steps": steps}))


def ends() -> np.ndarray:
    """Times in s at the ends of the steps of each length."""
    return np.cumsum(FIRST * STEPS * 2.0 ** np.arange(DOUBLINGS))


def quarter(size: float):
    """Mesh of the quarter, in um; ``size`` is that of the tetrahedra in the core."""
    from netgen import occ

    centre = DISTANCE / 2
    outer = occ.Cylinder(occ.Pnt(centre, 0, 0), occ.Z, r=8.18, h=0.22)
    inner = occ.Cylinder(occ.Pnt(centre, 0, 0), occ.Z, r=7.73, h=0.22)
    return meshed(outer - inner, size, SIDE, 32)


def racetrack(size: float):
    """The same for the racetracks of `examples/trench.py` on the uniform stack."""
    from netgen import occ

    def filled(radius: float):
        straight = occ.Box(occ.Pnt(12 - radius, -4, 0), occ.Pnt(12 + radius, 4, 0.22))
        return straight + occ.Cylinder(occ.Pnt(12, 4, 0), occ.Z, r=radius, h=0.22)

    return meshed(filled(5.225) - filled(4.775), size, 32, 22)


def meshed(core, size: float, side: float, depth: float):
    """Tetrahedra of a core in its stack, for x and y from 0 to ``side``, held at the bottom in ``depth``."""
    import ngsolve as ng
    from netgen import occ

    box = occ.Box(occ.Pnt(0, 0, -2), occ.Pnt(side, side, 2.22)).mat("oxide")
    substrate = occ.Box(occ.Pnt(0, 0, -depth), occ.Pnt(side, side, -2)).mat("substrate")
    core = (core * occ.Box(occ.Pnt(0, 0, -1), occ.Pnt(side, side, 1))).mat("core")
    core.maxh = size
    shape = occ.Glue([box - core, core, substrate])
    for face in shape.faces:
        middle = face.center
        if abs(middle.z + depth) < 1e-6:
            face.name = "bottom"
        elif abs(middle.x) < 1e-6:
            face.name = "mirror"
        else:
            face.name = "insulated"
    mesh = ng.Mesh(occ.OCCGeometry(shape).GenerateMesh(maxh=8, grading=0.3))
    return mesh.Curve(3)


def theirs(mesh, held: str, order: int, steps: int) -> tuple[float, np.ndarray, int]:
    """Static mean and step response of the core in K/W with the boundaries ``held`` at 0; and the unknowns."""
    import ngsolve as ng

    V = ng.H1(mesh, order=order, dirichlet=held)
    u, v = V.TnT()
    k = mesh.MaterialCF({"core": 130, "oxide": 1.38, "substrate": 130})
    c = mesh.MaterialCF({"core": 2330 * 700, "oxide": 2203 * 703, "substrate": 2330 * 700})
    K = ng.BilinearForm(1e-6 * k * ng.grad(u) * ng.grad(v) * ng.dx).Assemble().mat
    M = ng.BilinearForm(1e-18 * c * u * v * ng.dx).Assemble().mat
    volume = ng.Integrate(ng.CF(1) * ng.dx("core"), mesh)
    mean = ng.LinearForm(v / volume * ng.dx("core")).Assemble().vec
    free = V.FreeDofs()
    source = mean.CreateVector()
    source.data = 0.5 * mean  # 1 W in a ring, half of which is here
    field, work, one, two = (mean.CreateVector() for _ in range(4))
    field.data = K.Inverse(free, inverse="sparsecholesky") * source
    static, gamma, rises = ng.InnerProduct(mean, field), float(1 - np.sqrt(0.5)), []
    field[:] = 0
    if not steps:
        return static, np.empty(0), V.ndof
    shifted = M.CreateMatrix()
    for level in range(DOUBLINGS):
        h = FIRST * 2.0**level * STEPS / steps
        shifted.AsVector().data = M.AsVector() + gamma * h * K.AsVector()
        inverse = shifted.Inverse(free, inverse="sparsecholesky")
        for _ in range(steps):
            work.data = source - K * field
            one.data = inverse * work
            two.data = field + (1 - gamma) * h * one
            work.data = source - K * two
            two.data = inverse * work
            field.data += (1 - gamma) * h * one + gamma * h * two
        rises.append(ng.InnerProduct(mean, field))
    return static, np.array(rises), V.ndof


def main() -> None:
    path = Path(sys.argv[1])
    if "--ngs" not in sys.argv:
        ours(path)
        return
    for size, order in ((0.5, 3), (0.3, 3), (0.2, 3)):  # static only, for the example
        both, against = (theirs(racetrack(size), held, order, 0) for held in ("bottom", "bottom|mirror"))
        own, other = (both[0] + against[0]) / 2, (both[0] - against[0]) / 2
        print(
            f"racetrack, core {size} um, order {order}, {both[2]} unknowns: {own:.1f} and {other:.2f} K/W", flush=True
        )
    row = json.loads(path.read_text())
    for size, order, steps in ((0.5, 2, 2 * STEPS), (0.5, 3, STEPS), (0.3, 2, 0), (0.3, 3, 0), (0.2, 3, 0)):
        start = time.process_time()
        mesh = quarter(size)
        both, rises_both, unknowns = theirs(mesh, "bottom", order, steps)
        against, rises_against, _ = theirs(mesh, "bottom|mirror", order, steps)
        spent = time.process_time() - start
        print(f"core {size} um, order {order}, {unknowns} unknowns, {steps} steps of each length, {spent:.0f} s")
        static = [(both + against) / 2, (both - against) / 2]
        rises = [(rises_both + rises_against) / 2, (rises_both - rises_against) / 2]
        for name, ours_static, one, ours_rises, rise in zip(
            ("ring", "neighbour"), row["static"], static, row["steps"], rises, strict=True
        ):
            text = f"  {name}: {ours_static:.2f} K/W here, {one:.2f} in three dimensions ({ours_static / one - 1:+.2%})"
            if steps:
                worst = np.max(np.abs(np.array(ours_rises) - rise)) / one
                text += f"; step at {ends()[0] * 1e6:.1f} to {ends()[-1] * 1e6:.0f} us within {worst:.2%}"
            print(text, flush=True)


if __name__ == "__main__":
    main()
