"""Compact thermal models: the paper's lumped equations and their training."""

from .fit import Fit, fit_newton, fit_second_order
from .lumped import BORGHI2021_HEAT_CAPACITY, newton, second_order

__all__ = ["BORGHI2021_HEAT_CAPACITY", "Fit", "fit_newton", "fit_second_order", "newton", "second_order"]
