"""Compact thermal models: the paper's lumped equations, their training, and models as files."""

from .decay import Decay, fit_decay
from .export.json import load_model, load_provenance, save_model
from .fit import Fit, fit_newton, fit_second_order
from .lumped import BORGHI2021_HEAT_CAPACITY, newton, second_order
from .reduce import Reduction, reduce

__all__ = [
    "BORGHI2021_HEAT_CAPACITY",
    "Decay",
    "Fit",
    "Reduction",
    "fit_decay",
    "fit_newton",
    "fit_second_order",
    "load_model",
    "load_provenance",
    "newton",
    "reduce",
    "save_model",
    "second_order",
]
