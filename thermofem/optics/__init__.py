"""Guided modes of the same cross-section, on the mesh of its heat problem or on one drawn for them."""

from .mode import Mode
from .modes import Light

__all__ = ["Light", "Mode"]
