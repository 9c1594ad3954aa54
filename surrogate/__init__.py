"""Compact thermal models: the paper's lumped equations, their training, and models as files."""

from thermofem.models import load_model, save_model
from thermofem.models.cauer import cauer
from thermofem.models.foster import newton, second_order

from .export import export_model
from .family import load_family, train_family
from .fitting.exponential_sums import fit_decay, fit_spectrum
from .fitting.fit import fit_foster, fit_newton, fit_second_order
from .fitting.sindy import fit_sindy
from .judging.ladder import judge, train_all
from .judging.validate import compare, period_error, square_waves
from .reduction.array_reduction import reduce_array
from .reduction.balanced import balanced_truncation
from .reduction.layout_reduction import reduce_layout
from .reduction.nonlinear_reduction import output_map, reduce_quadratic
from .reduction.reduce import reduce
from .studies.calibrate import calibrate
from .studies.design import design
from .studies.inverse_search import Optics
from .studies.uncertainty import uncertainty

__all__ = [
    "Optics", "balanced_truncation", "calibrate", "cauer", "compare", "design", "export_model", "fit_decay",
    "fit_foster", "fit_newton", "fit_second_order", "fit_sindy", "fit_spectrum", "judge", "load_family",
    "load_model", "newton", "output_map", "period_error", "reduce", "reduce_array", "reduce_layout", "reduce_quadratic",
    "save_model", "second_order", "square_waves", "train_all", "train_family", "uncertainty",
]  # fmt: skip
