"""A straight heater beside a ring against a three-dimensional model in NGSolve (pip install ngsolve), at rest.

A ring of 5 um radius (450 x 220 nm of silicon), and a strip of TiN, 2 um wide, 140 nm high and 20 um long, whose
centre is 8 um from that of the ring and whose bottom is 1 um above that of the core. The chip is a box with
insulated sides at +-32 um, on 20 um of silicon that is held below. NGSolve solves the half y > 0 with quadratic and
cubic tetrahedra: their difference is the error of the mesh. Ours is a layout with the mirror images of the heater
(and of the ring) in the sides.

    python benchmarks/bench_heater_3d.py our.json          # with thermofem: solves and writes
    python benchmarks/bench_heater_3d.py our.json --ngs    # with ngsolve, in the same or another environment
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import replace
from itertools import product
from pathlib import Path

RADIUS = 5.0  # um, of the ring
PLACE = 8.0  # um, of the strip's centre
LENGTH = 20.0  # um, of the strip
WIDTH = 2.0  # um
HEIGHT = 0.14  # um
BOTTOM = 1.0  # um
SIDE = 32.0  # um, of the insulated sides
DEPTH = 20.0  # um, of silicon
IMAGES = 2  # mirror images on either side; the next ones are 160 um away and add less than 1e-4


def ours(path: Path) -> None:
    """Rises of ring and strip in K/mW by 1 mW in the strip, and of the ring by 1 mW in itself."""
    import thermofem as th

    guide = th.straight_guide(substrate=DEPTH * 1e-6)
    strip = th.Part(
        "heater", "TiN", bottom=BOTTOM * 1e-6, height=HEIGHT * 1e-6, heated=True, x=0.0, width=WIDTH * 1e-6
    )  # fmt: skip
    section = replace(guide, parts=(*guide.parts, strip))
    began = time.perf_counter()
    by_strip = rises(section, "heater")
    by_ring = rises(section, "ring")
    seconds = time.perf_counter() - began
    values = {"strip to ring": by_strip["ring"], "strip": by_strip["heater"], "ring": by_ring["ring"]}
    path.write_text(json.dumps(values))
    print({name: round(value, 4) for name, value in values.items()}, f"{seconds:.0f} s")


def rises(section: object, heated: str) -> dict[str, float]:
    """Rise of ring and strip in K/mW by the images of ``heated`` in the insulated sides, and by itself."""
    import surrogate
    import thermofem as th

    def ring(x: float, y: float, name: str) -> th.Shape:
        return th.racetrack(name, section, radius=RADIUS * 1e-6, straight=0.0, at=(x * 1e-6, y * 1e-6))

    def strip(x: float, y: float, name: str) -> th.Shape:
        path = [(x * 1e-6, (y - LENGTH / 2) * 1e-6), (x * 1e-6, (y + LENGTH / 2) * 1e-6)]
        return th.Shape(name, section, path=path, part="heater")

    centre, drawn = {"ring": (0.0, ring), "heater": (PLACE, strip)}[heated]
    shapes = [ring(0.0, 0.0, "ring"), strip(PLACE, 0.0, "heater")]
    sources = [heated]
    steps = range(-IMAGES, IMAGES + 1)
    for i, j in product(steps, steps):
        if (i, j) != (0, 0):
            sources.append(f"image {i} {j}")
            shapes.append(drawn(2 * SIDE * i + (-1) ** i * centre, 2 * SIDE * j, sources[-1]))
    layout = surrogate.reduce_layout(shapes, tolerance=1e-3)
    columns = [layout.model.inputs.index(name) for name in sources]
    return {name: float(layout.crosstalk[k, columns].sum()) / 1e3 for k, name in enumerate(("ring", "heater"))}


def half(size: float):
    """Tetrahedra of the half y > 0, in um; ``size`` is that in ring and strip."""
    import ngsolve as ng
    from netgen import occ

    above = occ.Box(occ.Pnt(-SIDE, 0, -2 - DEPTH), occ.Pnt(SIDE, SIDE, 4))
    outer = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=RADIUS + 0.225, h=0.22)
    inner = occ.Cylinder(occ.Pnt(0, 0, 0), occ.Z, r=RADIUS - 0.225, h=0.22)
    core = ((outer - inner) * above).mat("core")
    left = occ.Pnt(PLACE - WIDTH / 2, 0, BOTTOM)
    right = occ.Pnt(PLACE + WIDTH / 2, LENGTH / 2, BOTTOM + HEIGHT)
    strip = occ.Box(left, right).mat("heater")
    core.maxh = size
    strip.maxh = size
    oxide = occ.Box(occ.Pnt(-SIDE, 0, -2), occ.Pnt(SIDE, SIDE, 2.22)).mat("oxide")
    substrate = occ.Box(occ.Pnt(-SIDE, 0, -2 - DEPTH), occ.Pnt(SIDE, SIDE, -2)).mat("substrate")
    shape = occ.Glue([oxide - core - strip, core, strip, substrate])
    for face in shape.faces:
        face.name = "bottom" if abs(face.center.z + 2 + DEPTH) < 1e-6 else "insulated"
    return ng.Mesh(occ.OCCGeometry(shape).GenerateMesh(maxh=8, grading=0.3)).Curve(2)


def theirs(mesh, order: int) -> dict[str, float]:
    """The same rises by NGSolve."""
    import ngsolve as ng

    V = ng.H1(mesh, order=order, dirichlet="bottom")
    u, v = V.TnT()
    k = mesh.MaterialCF({"core": 130, "heater": 19.2, "oxide": 1.38, "substrate": 130})
    K = ng.BilinearForm(1e-6 * k * ng.grad(u) * ng.grad(v) * ng.dx).Assemble().mat
    inverse = K.Inverse(V.FreeDofs(), inverse="sparsecholesky")
    means = {}
    for name in ("core", "heater"):
        volume = ng.Integrate(ng.CF(1) * ng.dx(name), mesh)
        means[name] = ng.LinearForm(v / volume * ng.dx(name)).Assemble().vec
    fields = {}
    for name, mean in means.items():
        fields[name] = mean.CreateVector()
        fields[name].data = 0.5e-3 * (inverse * mean)  # 1 mW, half of which is here
    print(f"order {order}: {V.ndof} unknowns")
    return {
        "strip to ring": ng.InnerProduct(means["core"], fields["heater"]),
        "strip": ng.InnerProduct(means["heater"], fields["heater"]),
        "ring": ng.InnerProduct(means["core"], fields["core"]),
    }


def compare(path: Path) -> None:
    """Print NGSolve's values, the error of its mesh, and how far ours are from them."""
    values = json.loads(path.read_text())
    began = time.perf_counter()
    mesh = half(0.15)
    quadratic = theirs(mesh, 2)
    cubic = theirs(mesh, 3)
    print(f"{time.perf_counter() - began:.0f} s")
    for name, value in cubic.items():
        error = quadratic[name] / value - 1
        print(f"{name}: {value:.4f} K/mW, quadratic {error:+.2%}, ours {values[name] / value - 1:+.2%}")


if __name__ == "__main__":
    (compare if "--ngs" in sys.argv else ours)(Path(sys.argv[1]))
