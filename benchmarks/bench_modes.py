"""Modes of a silicon strip beside femwell and EMpy: error of n_eff and CPU time of one mode.

    python benchmarks/bench_modes.py              # ours, in the project's environment
    python benchmarks/bench_modes.py --femwell    # in an environment with femwell
    python benchmarks/bench_modes.py --empy       # in an environment with EMpy (pip install ElectroMagneticPython)

450 x 220 nm of silicon in oxide at 1.55 um. The reference, n_eff = 2.3550023, is NGSolve's with hp elements: to all but
the last digit. Each row is the median of three runs after a first one; meshing counts.
"""

import sys
import time
from collections.abc import Callable, Iterator

REFERENCE = 2.3550023
SILICON, OXIDE, WAVELENGTH = 3.4777238, 1.4440236, 1.55  # Salzberg and Villa, Malitson; um
WIDTH, HEIGHT, ASIDE = 0.45, 0.22, 1.5  # um

Case = tuple[str, Callable[[], float]]


def ours() -> Iterator[Case]:
    """The mesh of the heat at two accuracies, elements of order 2 and 3."""
    import thermofem as th

    def solve(accuracy: float, order: int) -> float:
        heat = th.assemble(th.straight_guide(width=WIDTH * 1e-6, height=HEIGHT * 1e-6), accuracy)
        return th.light(heat, wavelength=WAVELENGTH * 1e-6, order=order).mode("TE0").n_eff

    for accuracy in (1e-3, 1e-4):
        for order in (2, 3):
            yield f"thermofem, heat mesh for {accuracy:g}, order {order}", lambda a=accuracy, o=order: solve(a, o)


def femwell() -> Iterator[Case]:
    """Its Nedelec elements of order 2 on gmsh meshes refined at the core."""
    from collections import OrderedDict

    import numpy as np
    import shapely
    from femwell.maxwell.waveguide import compute_modes
    from femwell.mesh import mesh_from_OrderedDict
    from skfem import Basis, ElementTriP0
    from skfem.io import from_meshio

    def solve(size: float) -> float:
        core = shapely.box(-WIDTH / 2, 0, WIDTH / 2, HEIGHT)
        shapes = OrderedDict(core=core, clad=core.buffer(ASIDE))
        resolutions = {"core": {"resolution": size, "distance": 1}}
        mesh = from_meshio(mesh_from_OrderedDict(shapes, resolutions, default_resolution_max=10 * size))
        basis = Basis(mesh, ElementTriP0())
        eps = basis.zeros()
        for name, n in (("core", SILICON), ("clad", OXIDE)):
            eps[basis.get_dofs(elements=name)] = n**2
        return float(np.real(compute_modes(basis, eps, wavelength=WAVELENGTH, num_modes=1, order=2)[0].n_eff))

    for size in (0.04, 0.02):
        yield f"femwell, triangles of {size * 1e3:g} nm at the core, order 2", lambda s=size: solve(s)


def empy() -> Iterator[Case]:
    """Its full-vector finite differences on even grids with lines on the walls."""
    import numpy as np
    from EMpy.modesolvers.FD import VFDModeSolver

    def solve(cells: int) -> float:  # across the height, and twice as many across the width; walls on grid lines
        dx, dy = WIDTH / (2 * cells), HEIGHT / cells
        x = dx * (np.arange(10 * cells + 1) - 5 * cells)
        y = dy * (np.arange(9 * cells + 1) - 4 * cells)

        def eps(x: np.ndarray, y: np.ndarray) -> np.ndarray:
            inside = (np.abs(x) < WIDTH / 2)[:, None] & ((y > 0) & (y < HEIGHT))[None]
            return np.where(inside, SILICON**2, OXIDE**2)

        found = VFDModeSolver(WAVELENGTH, x, y, eps, "0000").solve(1, 1e-8)
        return float(found.modes[0].neff.real)

    for cells in (8, 16):
        yield f"EMpy, {2 * cells} x {cells} cells in the core", lambda c=cells: solve(c)


def main() -> None:
    """Print one row for each case."""
    cases = femwell() if "--femwell" in sys.argv else empy() if "--empy" in sys.argv else ours()
    for name, solve in cases:
        n_eff, seconds = solve(), []
        for _ in range(3):
            begin = time.process_time()
            solve()
            seconds.append(time.process_time() - begin)
        print(f"{name:55} {n_eff - REFERENCE:+.1e}  {sorted(seconds)[1]:6.2f} s")


if __name__ == "__main__":
    main()
