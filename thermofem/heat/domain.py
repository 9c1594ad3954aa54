"""Error of a thermal resistance caused by the finite domain, relative to a stack that continues beyond it.

See `parts.Boundary`, "open".
"""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..algebra.factor import solve_once
from .matrices import properties
from .surfaces import Surfaces, surface_terms

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection
    from .problem import HeatProblem

log = logging.getLogger("thermofem")

NOTABLE = 1e-2  # of R_th: a domain that moves it by more is worth a warning, by less a line of information
AGAIN = 2.0  # times the largest error that the log told of a domain: one as much larger is told, too
_told: dict[tuple[str, float, float], float] = {}


def domain_error(heat: HeatProblem, heated: str, read: str) -> float:
    """Relative change of R_th if the stack continued beyond its bottom and outer side.

    Sides with convection are mounts, not cuts, and stay as they are. Measured: against a domain of 2 mm the open
    sides of the reference strip leave 9e-5 where its own leave 3.3e-3.
    """
    geometry, d = heat.geometry, heat.discretization
    cut = [side for side in ("bottom", "outer") if getattr(geometry, side).kind in ("isothermal", "insulated")]
    if not cut:
        return 0.0
    grid = d.basis.mesh
    facets = grid.boundary_facets()
    r, z = grid.p[:, grid.facets[:, facets]].mean(axis=1)
    beyond = np.concatenate([facets[geometry.on_boundary(side, r, z)] for side in cut])
    kept = np.setdiff1d(d.surfaces.held, beyond)
    conductivity, _ = properties(geometry, heat.mesh)
    extra = surface_terms(d.basis, conductivity, Surfaces(open=beyond, source=d.surfaces.source))
    held = d.basis.get_dofs(kept).all() if kept.size else kept
    opened = replace(d, stiffness=(d.stiffness + extra).tocsr(), held=held)
    rise = solve_once(opened.K, d.means[heated][opened.free])
    there = float(d.means[read][opened.free] @ rise)
    here = heat.thermal_resistance(heated, read)
    return abs(there - here) / here


def warn_of_domain(geometry: CrossSection, domain: float, accuracy: float) -> None:
    """Log that the end of the domain changes R_th by more than the accuracy, and the remedy.

    A warning above `NOTABLE`, information below: a ring on a finite chip or on a mount is no mistake. Of geometries of
    one name and size the first is told, and what errs `AGAIN` times as much or is the first above `NOTABLE`.
    """
    size = geometry.name, geometry.outer_radius, geometry.bottom_z
    told = _told.get(size, 0.0)
    if domain <= min(AGAIN * told, NOTABLE if told <= NOTABLE else np.inf):
        return
    _told[size] = domain
    log.log(
        logging.WARNING if domain > NOTABLE else logging.INFO,
        "%s: the domain ends %.3g um below and %.3g um beside the axis, which moves R_th by %.1e (accuracy = %g); if "
        'the chip goes on there, say bottom = "open", outer = "open" in [boundary], or geometry.opened()',
        geometry.name,
        -geometry.bottom_z * 1e6,
        geometry.outer_radius * 1e6,
        domain,
        accuracy,
    )
