"""The list of thermal models that every contract test runs over: a new kind of model joins by one line."""

from __future__ import annotations

from functools import cache

import numpy as np
from grids import facets_where, graded, tensor_mesh

import surrogate
import thermofem as th
from thermofem.model import foster


@cache
def coarse_fem() -> th.StateSpace:
    """The reference strip on a very coarse mesh (some hundred unknowns): an exact model of itself."""
    um = 1e-6
    mesh = tensor_mesh(
        graded(0, 7.73 * um, 8.18 * um, 60 * um, finest=0.22 * um, growth=8),
        graded(-32 * um, -2 * um, 0, 0.22 * um, 2.22 * um, finest=0.11 * um, growth=8),
        lambda r, z: np.where((abs(r - 7.955 * um) < 0.225 * um) & (z > 0) & (z < 0.22 * um), 2, z > -2 * um),
        ("substrate", "oxide", "core"),
    )
    k, c = np.array([130, 1.38, 130])[mesh.region], np.array([2330 * 700, 2203 * 703, 2330 * 700])[mesh.region]
    held = facets_where(mesh, lambda r, z: np.isclose(z, -32 * um))
    return th.discretize(mesh, k, c, held=held).state_space(("core",), ("core",))


MODELS = {
    "newton": lambda: surrogate.newton(tau_th=275e-9),
    "second order": lambda: surrogate.second_order(kappa=8.87e5, tau_f=55.8e-9, tau_s=1200e-9, eta=0.31),
    "foster of five": lambda: th.Foster(R=[600, 1500, 2500, 2000, 1200], tau=[3e-9, 30e-9, 200e-9, 1.5e-6, 8e-6]),
    "fem": coarse_fem,
    "fem, diagonalised": lambda: foster(coarse_fem()),
}
