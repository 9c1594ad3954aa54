"""How far a thermal resistance and a step response can be off: by their mesh, and by where the domain ends.

The mesh's share comes from the functions that cubic elements add to quadratic ones on the same triangles. Self-heating
is a minimum principle (R_th = max of 2 c^T u - u^T K u), so R_th rises with every enrichment and R_3 - R_2 is a lower
bound of the error of quadratics; at the corners, where the field is singular, cubics leave the rest, hence
`SATURATION`. The same holds at any real s for H(s) = c^T (K + s M)^-1 c, which is the step response averaged around
1/s: s H(s) = int s exp(-s t) step(t) s dt.

The domain's share compares with the same stack going on beyond its bottom and outer side (`parts.Boundary`, "open").
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..algebra.factor import factorize
from .matrices import Surfaces, capacity, conduction, properties, surface_terms, volume
from .probes import probe_integral

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection
    from .problem import HeatProblem

Array = NDArray[np.float64]

log = logging.getLogger("thermofem")

# Of the error of quadratics, cubics on the same mesh show 65 to 100 % (tests/thermofem/test_accuracy.py).
SATURATION = 1.25
EARLY = 5e8  # 1/s; the step response averaged around 2 ns, whose error is nearest to that of the step at 1 ns
ITERATIONS = 3  # of conjugate gradients; two show 96 to 99 % of what cubics add (measured)


@dataclass(frozen=True, eq=False)
class Enrichment:
    """Matrices of the quadratic and, after them, the cubic functions on the same triangles, held ones left out.

    Attributes
    ----------
    basis : skfem.CellBasis
        of `enrichment.ElementTriP2Enriched`.
    places : array of int
        the functions of the basis, in the order of the matrices.
    quadratics : array of int
        all quadratic functions of the basis, held ones included.
    E, K : sparse; J/K and W/K
    """

    basis: Any
    places: NDArray[np.intp]
    quadratics: NDArray[np.intp]
    E: Any
    K: Any

    @classmethod
    def of(cls, heat: HeatProblem) -> Enrichment:
        """Assemble it for a heat problem."""
        import skfem

        from .enrichment import ElementTriP2Enriched, quadratic

        d = heat.discretization
        basis = skfem.Basis(d.basis.mesh, ElementTriP2Enriched(), intorder=1)  # everything is integrated without it
        conductivity, heat_capacity = properties(heat.geometry, heat.mesh)
        surfaces = surface_terms(basis, conductivity, d.surfaces)
        quadratics = quadratic(basis)
        cubic = np.setdiff1d(np.arange(basis.N), quadratics)
        if len(d.surfaces.held):
            cubic = np.setdiff1d(cubic, basis.get_dofs(d.surfaces.held).all())
        places = np.concatenate([quadratics[d.free], cubic])
        E, K = capacity(basis, heat_capacity), conduction(basis, conductivity) + surfaces
        return cls(basis, places, quadratics, *(matrix[places][:, places] for matrix in (E, K)))

    def mean(self, heat: HeatProblem, name: str) -> Array:
        """Functional of the volume mean over a region or what a probe reads."""
        mesh = heat.mesh
        if name in mesh.region_names:
            integral = volume(self.basis, mesh.region == mesh.region_names.index(name))
        else:
            probe = next(probe for probe in heat.geometry.probes if probe.name == name)
            integral = probe_integral(heat.geometry, mesh, self.basis, probe)
        return np.asarray(integral[self.places] / integral[self.quadratics].sum())


def discretization_error(heat: HeatProblem, heated: str, read: str) -> float:
    """Estimated relative error that the mesh makes in R_th and in the step response from 1 ns on, the larger one.

    `SATURATION` |H_3(s) - H_2(s)| / H_2(s) at s = 0, which is R_th, and at `EARLY`. Where another part is read than
    the heated one nothing has arrived early on, and the error of the step is relative to R_th.

    Parameters
    ----------
    heat : HeatProblem
    heated, read : str
        the channel, checked by the caller.

    Between 0.8 and 1.9 times the true error on the cross-sections of tests/thermofem/test_accuracy.py; on the coarsest
    meshes, of accuracy 1e-2, as little as 0.7 times (measured on five rings), where cubics are far from the end, too.
    """
    source, reading = (heat.enrichment.mean(heat, name) for name in (heated, read))
    # static last: R_th, which comes next, has the same factors
    (early, missing_early), (static, missing) = (added_by_cubics(heat, source, reading, s) for s in (EARLY, 0.0))
    shares = missing / static, missing_early / (early if heated == read else static)
    return float(SATURATION * max(map(abs, shares)))


def added_by_cubics(heat: HeatProblem, source: Array, reading: Array, s: float) -> tuple[float, float]:
    """H(s) of quadratics and what cubics add to it, both in K/W, for functionals of the heat and of the reading.

    Conjugate gradients from the quadratic solution, preconditioned level by level.
    """
    two, coarse = heat.enrichment, heat.discretization.factors
    n = heat.unknowns
    matrix = two.K + s * two.E if s else two.K
    fine = matrix.diagonal()[n:]

    def left(functional: Array) -> tuple[Array, Array]:
        """The quadratic solution, and the residual that it leaves."""
        found = coarse.solve(s, 1.0, functional[:n])
        return found, functional - matrix[:, :n] @ found

    def levels(rest: Array) -> Array:
        return np.concatenate([coarse.solve(s, 1.0, rest[:n]), rest[n:] / fine])

    found, rest = left(source)
    dual = rest if reading is source else left(reading)[1]
    value, added = float(reading[:n] @ found), 0.0
    direction = step = levels(rest)
    size = rest @ step
    for _ in range(ITERATIONS):
        if size <= 0:  # nothing is missing
            break
        image = matrix @ direction
        length = size / (direction @ image)
        added += float(length * (dual @ direction))
        rest = rest - length * image
        step = levels(rest)
        last, size = size, rest @ step
        direction = step + size / last * direction
    return value, added


def domain_error(heat: HeatProblem, heated: str, read: str) -> float:
    """Relative change of R_th if the stack went on beyond its bottom and outer side.

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
    rise = factorize(opened.K)(d.means[heated][opened.free])
    there = float(d.means[read][opened.free] @ rise)
    here = heat.thermal_resistance(heated, read)
    return abs(there - here) / here


ESTIMATES = {"mesh": discretization_error, "domain": domain_error}

NOTABLE = 1e-2  # of R_th: a domain that moves it by more is worth a warning, by less a line of information
_told: set[tuple[float, float]] = set()


def warn_of_domain(geometry: CrossSection, domain: float, accuracy: float) -> None:
    """Say in the log, once for each size of domain, that its end moves R_th by more than the accuracy; and the remedy.

    A warning above `NOTABLE`, information below: a ring on a finite chip or on a mount is no mistake.
    """
    size = geometry.outer_radius, geometry.bottom_z
    if size in _told:
        return
    _told.add(size)
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
