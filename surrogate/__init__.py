"""Compact thermal models: the paper's lumped equations, their training, and models as files."""

from thermofem import OutsideTrainingWarning
from thermofem.models import load_model, load_provenance, save_model
from thermofem.models.cauer import Cauer, cauer, foster_of, structure_function
from thermofem.models.lumped import BORGHI2021_HEAT_CAPACITY, newton, second_order
from thermofem.models.network import Network, gate

from .array import ArrayReduction, reduce_array
from .calibrate import Calibration, calibrate
from .decay import Decay, fit_decay
from .design import Design, design
from .export import export_model
from .family import Certified, Family, load_family, train_family
from .fit import Fit, fit_foster, fit_newton, fit_second_order
from .ladder import Ladder, judge, train_all, verdict
from .output_map import fit_output_map, output_map
from .pareto import pareto_front
from .pole_derivatives import pole_derivatives
from .quadratic import QuadraticReduction, reduce_quadratic
from .quantities import Optics
from .reduce import Reduction, reduce
from .sindy import SindyFit, fit_sindy
from .sindy_quadratic import fit_sindy_quadratic
from .spectrum import fit_spectrum
from .truncate import Truncation, balanced_truncation
from .uncertainty import uncertainty
from .validate import compare, held_out_drives, period_error, square_waves, valid_range, validity

__all__ = [
    "BORGHI2021_HEAT_CAPACITY", "ArrayReduction", "Calibration", "Cauer", "Certified", "Decay", "Design", "Family",
    "Fit", "Ladder", "Network", "Optics", "OutsideTrainingWarning", "QuadraticReduction", "Reduction", "SindyFit",
    "Truncation", "balanced_truncation", "calibrate", "cauer", "compare", "design", "export_model", "fit_decay",
    "fit_foster", "fit_newton", "fit_output_map", "fit_second_order", "fit_sindy", "fit_sindy_quadratic",
    "fit_spectrum", "foster_of", "gate", "held_out_drives", "judge", "load_family", "load_model", "load_provenance",
    "newton", "output_map", "pareto_front", "period_error", "pole_derivatives", "reduce", "reduce_array",
    "reduce_quadratic", "save_model", "second_order", "square_waves", "structure_function", "train_all",
    "train_family", "uncertainty", "valid_range", "validity", "verdict",
]  # fmt: skip
