"""Allowed places of a copy of a part off the axis: the stack must be laterally uniform there.

The axisymmetric field is that of one ring alone on a uniform stack. A copy reads it at another place. Of the heated
ring nothing may reach that place but the layers, and parts that cover the whole domain.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from .. import checks
from ..materials.library import VOID
from .parts import THINNEST, Part

if TYPE_CHECKING:
    from .cross_section import CrossSection


def reach(part: Part) -> float:
    """Largest radius of a part in m."""
    return float(part.outline()[:, 0].max())


def footprint(geometry: CrossSection) -> float:
    """Radius in m beyond which the stack is laterally uniform.

    A part that covers the domain from the axis to its edge is as uniform as a layer.
    """
    edge = geometry.outer_radius * (1 - 1e-9)
    if geometry.kind == "straight":
        return 0.0
    radii = [part.inner_radius if reach(part) >= edge else reach(part) for part in geometry.parts if part.height]
    return max(radii, default=0.0)


def check_uniform(geometry: CrossSection, who: str) -> None:
    """Raise InputError where a void cuts the stack: its copies would have one each, which one ring's field lacks."""
    if geometry.kind == "straight":
        raise checks.InputError(f"{who}: {geometry.name!r} is straight; put parallel guides in one section as parts")
    cut = next((part.name for part in geometry.parts if part.material == VOID and part.height), None)
    if cut is not None:
        raise checks.InputError(
            f"{who}: the void {cut!r} makes the stack laterally not uniform, and a neighbour would have its own void; "
            "only a uniform stack can be read off the axis; give the matrices of a three-dimensional model instead"
        )


def check_copies(geometry: CrossSection) -> None:
    """Raise InputError for a probe off the axis that cannot be read.

    Raises InputError: the copy overlaps the ring itself, leaves the domain or the layers, or the stack is not laterally
        uniform.
    """
    for probe in geometry.probes:
        if probe.distance is None:
            continue
        who = f"probe {probe.name!r}"
        part = next(part for part in geometry.parts if part.name == probe.part)
        if geometry.kind == "ring":
            check_uniform(geometry, who)
        if part.bottom < geometry.bottom_z - THINNEST or part.top > geometry.top_z + THINNEST:
            raise checks.InputError(
                f"{who}: part {part.name!r} stands on the top of the stack, with nothing beside it that a copy could "
                "read; add a layer around the part"
            )
        check_distance(geometry, part, probe.distance, who)


def check_distance(geometry: CrossSection, part: Part, distance: float, who: str) -> None:
    """Raise InputError unless a copy at a distance in m lies beside the ring and inside the domain."""
    least, most = footprint(geometry) + reach(part), distance + reach(part)
    if distance < least:
        raise checks.InputError(
            f"{who}: at distance = {distance:g} m the copy of {part.name!r} overlaps parts of the ring itself, which "
            f"reach {footprint(geometry):g} m; distance must be at least {least:g} m"
        )
    if most > geometry.outer_radius:
        raise checks.InputError(
            f"{who}: the copy of {part.name!r} at distance = {distance:g} m reaches {most:g} m, and the domain ends at "
            f"outer_radius = {geometry.outer_radius:g} m; outer_radius must be at least {most:g} m, and twice that "
            "keeps the outer side from being felt"
        )
