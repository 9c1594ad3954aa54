"""The axisymmetric heat equation on a meshed cross-section: matrices, probes and error estimates."""

from .problem import Discretization, HeatProblem, assemble, discretize

__all__ = ["Discretization", "HeatProblem", "assemble", "discretize"]
