"""The axisymmetric heat equation on a meshed cross-section: matrices, probes and error estimates."""

from .assembly import assemble, light
from .heat_problem import HeatProblem
from .surfaces import Surfaces
from .weak_forms import Discretization, discretize

__all__ = ["Discretization", "HeatProblem", "Surfaces", "assemble", "discretize", "light"]
