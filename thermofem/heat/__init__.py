"""The axisymmetric heat equation on a meshed cross-section: matrices, probes, and how far they can be off."""

from .problem import Discretization, HeatProblem, assemble, discretize

__all__ = ["Discretization", "HeatProblem", "assemble", "discretize"]
