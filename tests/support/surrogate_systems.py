"""Heat problems for the tests of the compact models, on graded rectangles: no mesher is needed.

The mesh is coarse: a reduction or a fit is compared with the very system it came from, so only that must be a heat
problem with the right length and time scales.
"""

from functools import cache

import numpy as np
import skfem
from grids import graded
from scipy.signal import lfilter
from scipy.sparse import diags

import surrogate
import thermofem as th

UM = 1e-6


def discretized(
    *, radius=7.955, width=0.45, height=0.22, box=2.0, above=2.0, k_oxide=1.38, heater=False, smallest=0.08
):
    """Discretization of a strip ring, optionally with a heater on top of the oxide; lengths in um."""
    wide = 2.0
    edges = [0, radius - width / 2, radius + width / 2, 60]
    if heater:
        edges = sorted({*edges, radius - wide / 2, radius + wide / 2})
    top = height + above
    levels = [-box - 30, -box, 0, height, top, *([top + 0.1] if heater else [])]
    lines = {"finest": smallest * UM, "growth": 2.6, "largest": 12 * UM}
    r, z = (graded(*np.array(at) * UM, **lines) for at in (edges, levels))
    grid = skfem.MeshTri.init_tensor(r, z)
    x, y = grid.p[:, grid.t].mean(axis=1) / UM
    inside = (abs(x - radius) < width / 2) & (y > 0) & (y < height)
    strip = y > top
    if heater:
        keep = ~strip | (abs(x - radius) < wide / 2)
        grid = grid.restrict(np.flatnonzero(keep))
        x, y, inside, strip = x[keep], y[keep], inside[keep], strip[keep]
    region = np.select([inside, strip, y < -box, y < 0], [3, 4, 0, 1], 2)
    names = ("substrate", "box", "cladding", "core", "heater")[: 5 if heater else 4]
    mesh = th.mesh.Mesh(grid.p.T, grid.t.T, region, names)
    k = np.array([130.0, k_oxide, k_oxide, 130.0, 25.0])[region]
    rho_c = np.array([2330 * 700.0, 2203 * 703.0, 2203 * 703.0, 2330 * 700.0, 5400 * 600.0])[region]
    held = mesh.skfem.facets_satisfying(lambda p: np.isclose(p[1], -(box + 30) * UM))
    return th.fem.discretize(mesh, k, rho_c, th.fem.Surfaces(held=held))


@cache
def strip(**geometry):
    """StateSpace of a strip ring, core heated and read."""
    return discretized(**geometry).state_space(("core",), ("core",))


def periodic(model, wave, samples=301):
    """Dataset of the periodic state of a model."""
    times = th.waveforms.period_times(wave, samples)
    return th.dataset.build(times, model.periodic_response(wave, samples), wave, periodic=True)


def error_on_squares(model, reference):
    """Rms over 55 square waves, in % of swing."""
    error = surrogate.compare({"": model}, reference, surrogate.square_waves()).rms_relative
    return 100 * float(np.sqrt((error**2).mean()))


def geometries(count):
    """Strip rings spread over what foundries make; always the same ones."""
    rng = np.random.default_rng(20210204)
    for _ in range(count):
        yield {
            "radius": rng.uniform(3, 20),
            "width": rng.uniform(0.3, 2.0),
            "height": rng.uniform(0.15, 0.5),
            "box": rng.uniform(0.7, 3.5),
            "above": rng.uniform(0.4, 4.0),
            "k_oxide": rng.uniform(0.9, 1.5),
            "smallest": 0.3,
        }


def autoregressive(rng, rho, count):
    """Noise of unit variance, AR(1): the correlation of samples k apart is rho^k."""
    drawn = rng.standard_normal(count if rho == 0 else 200 + count)
    return lfilter([np.sqrt(1 - rho**2)], [1, -rho], drawn)[-count:]


def slicot():
    """SLICOT's heat-cont (Chahlaoui, Van Dooren, 2002): A = 0.01 201^2 tridiag(1, -2, 1), collocated at state 67."""
    n = 200
    A = 0.01 * 201**2 * diags([np.ones(n - 1), -2 * np.ones(n), np.ones(n - 1)], [-1, 0, 1])
    e = np.eye(n)[66]
    return th.StateSpace(diags(np.ones(n)).tocsc(), A.tocsc(), e[:, None], e[None])
