"""A member of a family against its own mesh and its own certified reduction."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from thermofem import CrossSection, HeatProblem, StateSpace, assemble

from ..reduction.reduce import Projected, project
from .reduced import MemberModes, difference

FINER = 0.2  # accuracy of the member's own mesh over the tolerance of the family
FINEST, REDUCTION = 2e-5, 1e-2  # accuracy of the finest mesh made; tolerance of the reduction over that of the family


@dataclass(frozen=True, eq=False)
class Certified:
    """A member checked on its own mesh.

    Attributes
    ----------
    heat : HeatProblem
    model : StateSpace
        certified reduction in modal form, with every part and read region of the family.
    thermal_resistance : float, K/W
        of the first heated part.
    error : float
        of the family: relative, of R_th and of the step response from 1 ns on.
    error_bound : float
        of ``model`` against its mesh, relative to R_th at every frequency.
    mesh_error : float
        estimated, of the mesh.
    """

    heat: HeatProblem = field(repr=False)
    model: StateSpace = field(repr=False)
    thermal_resistance: float
    error: float
    error_bound: float
    mesh_error: float


def own(heat: HeatProblem, ports: tuple[str, ...], tolerance: float) -> tuple[MemberModes, Projected]:
    """Certified modes of a heat problem between its ports."""
    d = heat.discretization
    columns = np.column_stack([d.means[name][d.free] for name in ports])
    system = StateSpace(E=d.E, A=-d.K, B=columns, C=columns.T, inputs=ports, outputs=ports)
    found = project(system, max(REDUCTION * tolerance, 1e-7))
    rate, beta = found.projection.rate, found.projection.ports
    return MemberModes(1 / rate, (beta / np.sqrt(rate)[:, None]).T), found


def certified(
    geometry: CrossSection, modes: MemberModes, ports: tuple[str, ...], tolerance: float, heated: int
) -> Certified:
    """Compare a member with its own mesh, which is finer than the family's tolerance.

    The first ``heated`` of the ports carry heat.
    """
    heat = assemble(geometry, max(FINER * tolerance, FINEST))
    truth, found = own(heat, ports, tolerance)
    gain = found.projection.gain.diagonal()
    a, b = found.pairs
    rate, beta = found.projection.rate, found.projection.ports
    return Certified(
        heat=heat,
        model=StateSpace(np.eye(rate.size), -np.diag(rate), beta, beta.T, inputs=ports, outputs=ports),
        thermal_resistance=float(truth.R().sum()),
        error=difference(modes, truth, heated),
        error_bound=float((found.certificate.top / np.sqrt(gain[a] * gain[b])).max()),
        mesh_error=heat.mesh_error(ports[0]),
    )
