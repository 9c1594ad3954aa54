"""The thermal model of one racetrack from the geometry file of its ring, with the temperature that its light sees.

Core and heaters are a layout of racetracks (`surrogate.reduction.layout_reduction`). The temperature that the mode sees
differs from the mean of the core only by the field in the section, so that by the power P_j of part j of length L_j

    H_light,j(s) = H_core,j(s) + [Z_light,j(s) - Z_core,j(s)]/L_j

with Z the rise by the power per length of the straight section, reduced with a certificate.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.sparse import block_diag

from thermofem import CrossSection, InputError, StateSpace, assemble
from thermofem.geometry.section_parts import LIGHT
from thermofem.geometry.shapes import Shape, along_ring

from .array_reduction import ArrayReduction
from .layout_reduction import reduce_layout
from .layout_sections import SECTION
from .reduce import reduce


def reduce_racetrack(ring: CrossSection, tolerance: float = 1e-3) -> ArrayReduction:
    """Reduce a ring with ``straight`` to a thermal model of its heated parts, and of "light" where it has [light].

    Parameters
    ----------
    ring : CrossSection
        with ``straight``; its outer side does not count, the chip goes on in its plane.
    tolerance : float
        as of `reduce_layout`.

    Raises
    ------
    InputError
        bends below 3 um, a light whose part is not heated; as `reduce_layout`.
    """
    shapes = along_ring(ring)
    layout = reduce_layout(shapes, tolerance)
    origin = {**(layout.model.origin or {}), "geometry": ring.to_toml()}
    layout = replace(layout, model=replace(layout.model, origin=origin))
    return layout if ring.light is None else _with_light(layout, shapes, ring.light.part, tolerance)


def _with_light(layout: ArrayReduction, shapes: tuple[Shape, ...], guide: str, tolerance: float) -> ArrayReduction:
    """The same with the output "light" after those of the parts."""
    names = [shape.name for shape in shapes]
    if guide not in names:
        raise InputError(
            f"the light of a racetrack is read beside the mean of its core, and {guide!r} is not heated",
            "give that part heated = true",
        )
    core = names.index(guide)
    section = shapes[0].section
    heat = assemble(section, SECTION * tolerance)
    local = reduce(heat.channels(names, (guide, LIGHT)), SECTION * tolerance)
    straight: Any = local.model  # two outputs: a StateSpace
    whole = layout.model
    lengths = np.array([shape.length for shape in shapes])
    heated = straight.B * (float(section.length or 1.0) / lengths)
    difference = straight.C[1] - straight.C[0]
    read = np.zeros((len(names) + 1, whole.order + local.order))
    read[:-1, : whole.order] = whole.C
    read[-1] = np.concatenate([whole.C[core], difference])
    model = StateSpace(
        E=block_diag([whole.E, straight.E], format="csr"),
        A=block_diag([whole.A, straight.A], format="csr"),
        B=np.concatenate([whole.B, heated]),
        C=read,
        inputs=whole.inputs,
        outputs=(*whole.outputs, LIGHT),
        origin=whole.origin,
    )
    mesh = max(heat.mesh_error(name, LIGHT) for name in names)
    of_light = layout.channel_bounds[core] + local.error_bound + mesh
    bounds = np.vstack([layout.channel_bounds, of_light])
    return replace(layout, model=model, channel_bounds=bounds, error_bound=float(bounds.max()))
