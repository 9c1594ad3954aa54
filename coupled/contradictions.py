"""Where the numbers of a ring contradict the geometry that its thermal model was made from."""

from __future__ import annotations

import functools
import logging
from dataclasses import replace
from typing import Any

from scipy.constants import c

from thermofem import CrossSection
from thermofem.errors import InputError
from thermofem.models.contract import bare

from .resonator import PUBLISHED, RingResonator
from .ring_toml import SILICON

log = logging.getLogger("thermofem")

TAKEN = (0.67, 1.5)  # volume of two-photon absorption over that of the core, where it is that of a published ring
GIVEN = (0.3, 4.0)  # the same, where it was given: a slot or a rib is far from its core


def check_geometry(ring: RingResonator, model: Any) -> dict[str, str]:
    """Compare the volume and the material of a ring with the geometry of a thermal model, and log what contradicts.

    model: a thermal model with the text of its geometry in ``origin``, a HeatProblem, or a family.

    Returns the attribute "warning" of a result, or nothing.
    Raises InputError: the numbers of a silicon ring for a core of another material.
    """
    text = _geometry(model)
    found = _contradiction(ring, text) if text else ""
    if found:
        log.warning("%s", found)
    return {"warning": found} if found else {}


def _geometry(model: Any) -> str:
    """The text of a model's geometry; empty where it is not known."""
    section = getattr(model, "geometry", None) or getattr(getattr(model, "box", None), "base", None)
    if isinstance(section, CrossSection):
        return section.to_toml()
    origins = (getattr(one, "origin", None) for one in (model, bare(model)))
    return next((str(one["geometry"]) for one in origins if one and one.get("geometry")), "")


def without_origin(model: Any) -> Any:
    """The model without its geometry, for the many runs of a search."""
    return replace(model, origin=None) if getattr(model, "origin", None) else model


@functools.lru_cache(256)
def _contradiction(ring: RingResonator, text: str) -> str:
    """A sentence on the volume of a ring that is not that of its geometry, or nothing."""
    section = CrossSection.from_toml_text(text)
    core = "core" if "core" in section.heated else section.heated[0]
    material, (low, high) = section.material_of(core), SILICON
    own = None if material.index is None else material.index.index(c / ring.frequency)
    if own is not None and not low < own < high and low < ring.refractive_index < high and ring.tpa_coefficient:
        raise InputError(
            f"ring {ring.name!r} has the numbers of silicon, and {core!r} of {section.name!r} is {material.name}",
            "`thermofem ring`, coupled.ring_from in Python, makes the ring of a geometry",
        )
    if section.kind != "ring":
        return ""
    of = next((name for name, one in PUBLISHED.items() if one().tpa_volume == ring.tpa_volume), "")
    ratio = ring.tpa_volume / section.volumes()[core]
    least, most = TAKEN if of else GIVEN
    if least < ratio < most:
        return ""
    return (
        f"ring {ring.name!r}: tpa_volume is {ring.tpa_volume * 1e18:.3g} um^3{of and f', that of {of}'}, {ratio:.3g} "
        f"times the volume of {core!r} in the geometry of the model: thresholds of self-pulsing move; give perimeter "
        "and mode_area, or make the ring with `thermofem ring`"
    )
