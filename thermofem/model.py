"""The old place of thermal models, kept for scripts that import it; new code imports from `thermofem.models`."""

from .algebra.poles import pole_responses
from .models import Foster, StateSpace, ThermalModel, check_single, foster

__all__ = ["Foster", "StateSpace", "ThermalModel", "check_single", "foster", "pole_responses"]
