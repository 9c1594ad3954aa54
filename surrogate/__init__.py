"""Compact thermal models: the paper's lumped equations, their training, and models as files."""

from thermofem.models import load_model, load_provenance, save_model
from thermofem.models.cauer import Cauer, cauer, foster_of, structure_function
from thermofem.models.lumped import BORGHI2021_HEAT_CAPACITY, newton, second_order
from thermofem.models.network import Network, gate

from .arrays.array_reduction import reduce_array
from .export import export_model
from .family import Family, load_family, train_family
from .fitting.decay import fit_decay
from .fitting.fit import Fit, fit_foster, fit_newton, fit_second_order
from .fitting.sindy import fit_sindy
from .fitting.sindy_quadratic import fit_sindy_quadratic
from .fitting.spectrum import fit_spectrum
from .judging.ladder import judge, train_all, verdict
from .judging.validate import compare, held_out_drives, period_error, square_waves, valid_range, validity
from .reduction.balanced import balanced_truncation
from .reduction.output_map import fit_output_map, output_map
from .reduction.pole_derivatives import pole_derivatives
from .reduction.quadratic_reduction import reduce_quadratic
from .reduction.reduce import Reduction, reduce
from .studies.calibrate import calibrate
from .studies.design import design
from .studies.pareto import pareto_front
from .studies.targets import Optics
from .studies.uncertainty import uncertainty

__all__ = [
    "BORGHI2021_HEAT_CAPACITY", "Cauer", "Family", "Fit", "Network", "Optics", "Reduction", "balanced_truncation",
    "calibrate", "cauer", "compare", "design", "export_model", "fit_decay", "fit_foster", "fit_newton",
    "fit_output_map", "fit_second_order", "fit_sindy", "fit_sindy_quadratic", "fit_spectrum", "foster_of", "gate",
    "held_out_drives", "judge", "load_family", "load_model", "load_provenance", "newton", "output_map",
    "pareto_front", "period_error", "pole_derivatives", "reduce", "reduce_array", "reduce_quadratic", "save_model",
    "second_order", "square_waves", "structure_function", "train_all", "train_family", "uncertainty",
    "valid_range", "validity", "verdict",
]  # fmt: skip
