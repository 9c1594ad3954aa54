"""Thermal models: the contract, every kind that keeps it, and models as files."""

from .contract import OutsideTrainingWarning, ThermalModel, check_single
from .foster import Foster
from .lumped import BORGHI2021_HEAT_CAPACITY, newton, second_order
from .network import Network, gate
from .nonlinear_system import NonlinearSystem
from .output_map import OutputMap
from .quadratic import Quadratic
from .state_space import StateSpace, foster

__all__ = [
    "BORGHI2021_HEAT_CAPACITY",
    "Foster",
    "Network",
    "NonlinearSystem",
    "OutputMap",
    "OutsideTrainingWarning",
    "Quadratic",
    "StateSpace",
    "ThermalModel",
    "check_single",
    "foster",
    "gate",
    "newton",
    "second_order",
]
