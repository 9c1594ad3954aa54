"""Probes as functionals of the field: shells around parts, and copies of parts off the axis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..arrays import Array
from .off_axis import off_axis_integral
from .shell import shell_integral

if TYPE_CHECKING:
    from ..geometry.cross_section import CrossSection
    from ..geometry.parts import Probe
    from ..mesh import Mesh


def probe_integral(geometry: CrossSection, mesh: Mesh, basis: Any, probe: Probe) -> Array:
    """Volume integral of each basis function over what a probe reads, in m^3."""
    if probe.shell is None:
        return off_axis_integral(geometry, basis, probe)
    return shell_integral(geometry, mesh, basis, probe)


def probe_mean(geometry: CrossSection, mesh: Mesh, basis: Any, probe: Probe) -> Array:
    """Functional of the volume mean over what a probe reads; its entries sum to one.

    Raises InputError: the probe's part is not meshed: nothing of it is left.
    """
    integral = probe_integral(geometry, mesh, basis, probe)
    return integral / integral.sum()
