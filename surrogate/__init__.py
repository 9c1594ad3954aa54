"""Compact thermal models: the paper's lumped equations, their training, and models as files."""

from .cauer import Cauer, cauer, foster_of, structure_function
from .decay import Decay, fit_decay
from .export.json import load_model, load_provenance, save_model
from .fit import Fit, fit_foster, fit_newton, fit_second_order
from .lumped import BORGHI2021_HEAT_CAPACITY, newton, second_order
from .reduce import Reduction, reduce
from .sindy import Network, OutsideTrainingWarning, SindyFit, fit_sindy, gate
from .spectrum import fit_spectrum
from .validate import compare, held_out_drives, period_error, square_waves, valid_range, validity

__all__ = [
    "BORGHI2021_HEAT_CAPACITY",
    "Cauer",
    "Decay",
    "Fit",
    "Network",
    "OutsideTrainingWarning",
    "Reduction",
    "SindyFit",
    "cauer",
    "compare",
    "fit_decay",
    "fit_foster",
    "fit_newton",
    "fit_second_order",
    "fit_sindy",
    "fit_spectrum",
    "foster_of",
    "gate",
    "held_out_drives",
    "load_model",
    "load_provenance",
    "newton",
    "period_error",
    "reduce",
    "save_model",
    "second_order",
    "square_waves",
    "structure_function",
    "valid_range",
    "validity",
]
