"""Thermal models: the contract, every kind that keeps it, and models as files."""

from .cauer import Cauer
from .contract import HasModel, OutsideTrainingWarning, ThermalModel, bare, check_single
from .foster import BORGHI2021_HEAT_CAPACITY, Foster, OutputMap, linear_poles, newton, second_order, two_kinds
from .identified_network import Network, gate
from .model_files import KINDS, load_model, load_provenance, save_model
from .nonlinear_models import NonlinearSystem, Quadratic
from .state_space import StateSpace, foster, has_ports

__all__ = [
    "BORGHI2021_HEAT_CAPACITY", "KINDS", "Cauer", "Foster", "HasModel", "Network", "NonlinearSystem", "OutputMap",
    "OutsideTrainingWarning", "Quadratic", "StateSpace", "ThermalModel", "bare", "check_single", "foster", "gate",
    "has_ports", "linear_poles", "load_model", "load_provenance", "newton", "save_model", "second_order", "two_kinds",
]  # fmt: skip
