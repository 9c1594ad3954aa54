"""Families of geometries: one reduced basis for a box of parameters."""

from .certify import Certified
from .family import Family, HeldOut, load_family
from .train import train_family

__all__ = ["Certified", "Family", "HeldOut", "load_family", "train_family"]
