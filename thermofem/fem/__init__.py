"""The axisymmetric heat equation on a meshed cross-section: matrices, probes and error estimates."""

from .assembly import assemble
from .heat_problem import Discretization, HeatProblem, discretize

__all__ = ["Discretization", "HeatProblem", "assemble", "discretize"]
