"""Guided modes of the same cross-section, on the mesh of its heat problem or on one drawn for them."""

from .modes import Light, Mode, light

__all__ = ["Light", "Mode", "light"]
