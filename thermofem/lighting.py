"""`thermofem.light`: a cross-section or its heat problem in, its guided modes out."""

from __future__ import annotations

from . import checks
from .fem import HeatProblem
from .fem.assembly import meshed
from .geometry import CrossSection
from .optics import Light

DRAWN = 1e-3  # accuracy of the heat mesh that `light` makes for a geometry


def light(
    section: CrossSection | HeatProblem, *, wavelength: float | None = None, part: str | None = None, order: int = 2
) -> Light:
    """The guided modes of a cross-section.

    Parameters
    ----------
    section : CrossSection or HeatProblem
        of a heat problem its mesh is taken, cut to a window about the part; of a geometry that of `assemble`. Where the
        heat has no triangles (air above the stack, voids) a mesh is drawn.
    wavelength : float, m
        default that of [light] in the geometry.
    part : str
        the core; default that of [light], or "core", or the first heated part.
    order : int
        of the elements, 2 or 3. On the mesh for 1e-3 of the heat n_eff and n_g are within 2e-4 (order 2) and 2e-5 (3).

    Raises
    ------
    InputError
        no guided mode; a material without an index in its reach; a wavelength outside an index law's range.

    >>> import thermofem as th
    >>> mode = th.light(th.strip_ring(), wavelength=1.55e-6).mode("TE0")
    >>> round(mode.n_eff, 2), round(mode.n_g, 2)
    (2.36, 4.29)
    """
    hint = "th.strip_ring() is a geometry, th.assemble(geometry) a heat problem"
    checks.instance("section", section, CrossSection, HeatProblem, hint=hint)
    heat = section if isinstance(section, HeatProblem) else meshed(section, DRAWN)[0]
    return Light.of(heat, wavelength, part, order)
