"""How far a thermal resistance can be off: by its mesh, and by where the domain ends.

The mesh's share comes from one more static solve on the same triangles with cubic elements. Self-heating is a minimum
principle (R_th = max of 2 c^T u - u^T K u), so R_th rises with every enrichment and R_3 - R_2 is a lower bound of the
error of quadratics; at the corners, where the field is singular, cubics leave the rest, hence `SATURATION`.

The domain's share compares with the same stack going on beyond its bottom and outer side (`parts.Boundary`, "open").
"""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .factor import factorize
from .matrices import Surfaces, conduction, mean, surface_terms
from .shell import shell_mean

if TYPE_CHECKING:
    from .heat import HeatProblem

Array = NDArray[np.float64]

log = logging.getLogger("thermofem")

# Of the error of quadratics, cubics on the same mesh show 74 to 90 % on the reference strip (accuracy 1e-2 .. 1e-4).
SATURATION = 1.25


def discretization_error(heat: HeatProblem, heated: str, read: str) -> float:
    """Estimated relative error of R_th that the mesh makes: `SATURATION` |R_3 - R_2| / R_2.

    Parameters
    ----------
    heat : HeatProblem
    heated, read : str
        the channel, checked by the caller.

    Between 0.7 and 1.5 times the true error on the cross-sections of tests/test_accuracy.py.
    """
    import skfem

    from .heat import properties

    d, mesh = heat.discretization, heat.mesh
    basis = skfem.Basis(d.basis.mesh, skfem.ElementTriP3(), intorder=5)  # exact for r grad u . grad v
    conductivity, _ = properties(heat.geometry, mesh)
    stiffness = conduction(basis, conductivity) + surface_terms(basis, conductivity, d.surfaces)
    held = basis.get_dofs(d.surfaces.held).all() if len(d.surfaces.held) else np.empty(0, dtype=np.intp)
    free = np.setdiff1d(np.arange(basis.N), held)

    def functional(name: str) -> Array:
        if name in mesh.region_names:
            return mean(basis, mesh.region == mesh.region_names.index(name))[free]
        probe = next(probe for probe in heat.geometry.probes if probe.name == name)
        return shell_mean(heat.geometry, mesh, basis, probe)[free]

    rise = factorize(stiffness.tocsr()[free][:, free])(functional(heated))
    coarse = heat.thermal_resistance(heated, read)
    return abs(float(SATURATION * (functional(read) @ rise - coarse) / coarse))


def domain_error(heat: HeatProblem, heated: str, read: str) -> float:
    """Relative change of R_th if the stack went on beyond its bottom and outer side.

    Sides with convection are mounts, not cuts, and stay as they are. Measured: against a domain of 2 mm the open
    sides of the reference strip leave 9e-5 where its own leave 3.3e-3.
    """
    from .heat import properties

    geometry, d = heat.geometry, heat.discretization
    cut = [side for side in ("bottom", "outer") if getattr(geometry, side).kind in ("isothermal", "insulated")]
    grid = d.basis.mesh
    facets = grid.boundary_facets()
    r, z = grid.p[:, grid.facets[:, facets]].mean(axis=1)
    beyond = np.concatenate([facets[geometry.on_boundary(side, r, z)] for side in cut] or [facets[:0]])
    kept = np.setdiff1d(d.surfaces.held, beyond)
    conductivity, _ = properties(geometry, heat.mesh)
    extra = surface_terms(d.basis, conductivity, Surfaces(open=beyond, source=d.surfaces.source))
    opened = replace(
        d, stiffness=(d.stiffness + extra).tocsr(), held=d.basis.get_dofs(kept).all() if kept.size else kept
    )
    channel = opened.state_space((heated,), (read,))
    there = float(channel.C[0] @ factorize(-channel.A)(channel.B[:, 0]))
    here = heat.thermal_resistance(heated, read)
    return abs(there - here) / here


ESTIMATES = (discretization_error, domain_error)
