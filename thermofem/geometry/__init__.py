"""The cross-section of a ring in (r, z): layers, parts and their overlaps, and the geometry file."""

from .cross_section import CrossSection
from .gdsfactory_import import from_gdsfactory
from .layout_import import read_layout
from .ring_sections import disc, heated_ring, rib_ring, straight_guide, strip_ring
from .section_parts import Boundary, Bus, Guide, Interface, Layer, Part, Probe
from .shapes import Shape, racetrack

__all__ = [
    "Boundary", "Bus", "CrossSection", "Guide", "Interface", "Layer", "Part", "Probe", "Shape", "disc",
    "from_gdsfactory", "heated_ring", "racetrack", "read_layout", "rib_ring", "straight_guide", "strip_ring",
]  # fmt: skip
