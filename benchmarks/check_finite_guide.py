"""Reference values of a heated guide of finite length in three dimensions, by NGSolve (pip install ngsolve).

    python benchmarks/check_finite_guide.py [order]

A silicon core of 450 x 220 nm, heated evenly over a length L, goes on beyond it on either side; 2 um of oxide below and
above it on a deep silicon substrate. A quarter of it, x > 0 and y > 0, is cut into graded bricks out to 4 mm, where it
is held; elements of the given order (2). Printed is the mean rise over the heated length in K per W at rest, against
which `test_straight.py` holds the two-dimensional section.
"""

from __future__ import annotations

import sys

import ngsolve as ng
import numpy as np
from ngsolve.meshes import MakeStructured3DMesh

WIDTH, HEIGHT, OXIDE, FAR = 0.45, 0.22, 2.0, 4000.0  # um
K = {"Si": 148.0, "SiO2": 1.38}  # W/(m K)
LENGTHS = (10.0, 40.0, 100.0, 320.0)  # um


def graded(start: float, stop: float, first: float, ratio: float = 2.0) -> list[float]:
    """Points from start to stop, start left out; cells grow from ``first`` at start."""
    sizes = [first]
    while sum(sizes) < abs(stop - start):
        sizes.append(sizes[-1] * ratio)
    way = np.cumsum(sizes) / sum(sizes)
    return list(start + way * (stop - start))


def both(start: float, stop: float, first: float) -> list[float]:
    """Points from start to stop, start left out; cells grow from either end to the middle."""
    middle = (start + stop) / 2
    left = graded(start, middle, first)
    return left + [start + stop - x for x in [*left[-2::-1], start]]


def axes(length: float) -> tuple[list[float], list[float], list[float]]:
    """Coordinates in um of the faces of the bricks; z = 0 is the bottom of the core."""
    fine = 0.02
    x = [WIDTH / 2 - p for p in [*graded(0, WIDTH / 2, fine)[::-1], 0]] + graded(WIDTH / 2, FAR, 2 * fine)
    end = length / 2
    y = [end - p for p in [*graded(0, end, 0.2)[::-1], 0]] + graded(end, FAR, 0.2)
    z = [-OXIDE - p for p in [*graded(0, FAR, 0.4)[::-1], 0]]
    z += both(-OXIDE, 0, fine) + both(0, HEIGHT, fine) + graded(HEIGHT, HEIGHT + OXIDE, fine)
    return x, y, z


def rise(length: float, order: int) -> float:
    """Mean rise in K/W over the heated length in um at rest."""
    points = axes(length)
    cells = [len(p) - 1 for p in points]

    def place(*unit: float) -> tuple[float, ...]:
        return tuple(p[round(u * n)] for u, n, p in zip(unit, cells, points, strict=True))

    mesh = MakeStructured3DMesh(hexes=True, nx=cells[0], ny=cells[1], nz=cells[2], mapping=place)

    def inside(value: float, other: float, end: bool) -> ng.CoefficientFunction:
        here = ng.IfPos(ng.x - WIDTH / 2, 0, 1) * ng.IfPos(ng.z, 1, 0) * ng.IfPos(ng.z - HEIGHT, 0, 1)
        core = here * ng.IfPos(ng.y - length / 2, 0, 1) if end else here
        return other + (value - other) * core

    def of(table: dict[str, float]) -> ng.CoefficientFunction:
        return inside(table["Si"], ng.IfPos(ng.z + OXIDE, table["SiO2"], table["Si"]), False)

    space = ng.H1(mesh, order=order, dirichlet="front|right|bottom")  # x and y at their largest, z at its smallest
    u, v = space.TnT()
    # lengths in um: a quarter of a watt, 1e6/4 in W/(m K) um, in a quarter of the core
    volume = WIDTH / 2 * HEIGHT * length / 2
    mean = ng.LinearForm(inside(1.0, 0.0, True) * v * ng.dx).Assemble().vec
    stiff = ng.BilinearForm(of(K) * ng.grad(u) * ng.grad(v) * ng.dx).Assemble().mat
    print(f"L {length:g} um: bricks {cells}, {space.ndof} unknowns", flush=True)
    field = mean.CreateVector()
    field.data = stiff.Inverse(space.FreeDofs(), inverse="sparsecholesky") * mean
    return 0.25e6 * float(ng.InnerProduct(field, mean)) / volume**2


if __name__ == "__main__":
    order = int(sys.argv[1]) if len(sys.argv) > 1 else 2
    with ng.TaskManager():
        for length in LENGTHS:
            print(f"{rise(length, order):.6g} K/W", flush=True)
