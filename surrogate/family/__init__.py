"""Families of geometries: one reduced basis for a box of parameters."""

from .family import Family, load_family
from .members import Certified, HeldOut
from .train_family import train_family

__all__ = ["Certified", "Family", "HeldOut", "load_family", "train_family"]
