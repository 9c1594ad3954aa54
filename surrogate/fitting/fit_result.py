"""The result of a fit: parameters, errors, how well the model describes its data, and notes on what is doubtful."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from thermofem import Foster, checks
from thermofem.arrays import Array, ArrayLike, NDArray
from thermofem.data import files, quantity
from thermofem.data.dataset import Response
from thermofem.models import HasModel, Network

from .pole_projection import FitProblem, Optimum


@dataclass(frozen=True, eq=False)
class Fit(HasModel):
    """A trained model and how well it fits its data.

    Attributes
    ----------
    model : Foster, or Network
    parameters : dict of float
        in SI, by name.
    standard_errors : dict of float
        one standard deviation of each parameter, from the Jacobian, and from the variance and the autocorrelation of
        the residuals of each Dataset. A trace of fewer than 50 samples does not show the latter: there noise counts as
        independent from sample to sample.
        inf where a time constant beyond the data decides, as ``notes`` say; nan where none is known.
    correlations : array, shape (parameters, parameters)
        in the order of ``parameters``; nan where none is known.
    residual : float, in residual_unit
        rms over all samples.
    residual_unit : str
        "K"; of light behind an interferometer "W", "V", or "" of an arbitrary one.
    relative_residual : float
        rms of residual over swing, each Dataset by its own swing.
    training : tuple of str
        the drive of each Dataset; the parameters mean little without it.
    notes : tuple of str
        what makes the data doubtful; time constants that they do not determine.
    geometry : str or None
        TOML of the cross-section, where the data carries it.
    swarm_residual : float or None, K
        what the particle swarm alone reached, with ``method="pso"``.
    misfit_is_noise : bool or None
        whether the misfit is no larger than the scatter of the rows at rest or, without such rows, is white noise.
    training_period : float or None, s
        of the drive, where all Datasets have the same.
    thermal_resistance_deviation : float, K/W
        one standard deviation of R_th, which contains the correlations of the poles; nan where it is not computed. An
        error of the power is not in it.
    method : str
    equations : tuple of str
        of a Network; its coefficients are the parameters.
    """

    model: Foster | Network
    parameters: Mapping[str, float]
    residual: float
    relative_residual: float
    training: tuple[str, ...]
    standard_errors: Mapping[str, float] = field(default_factory=dict)
    correlations: Array = field(default_factory=lambda: np.empty(0), repr=False)
    notes: tuple[str, ...] = ()
    geometry: str | None = field(default=None, repr=False)
    swarm_residual: float | None = None
    misfit_is_noise: bool | None = None
    training_period: float | None = None
    residual_unit: str = "K"
    thermal_resistance_deviation: float = float("nan")
    method: str = "fit"
    equations: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.standard_errors:
            count = len(self.parameters)
            object.__setattr__(self, "standard_errors", dict.fromkeys(self.parameters, float("nan")))
            object.__setattr__(self, "correlations", np.full((count, count), np.nan))

    def _repr_html_(self) -> str:
        """HTML for notebooks."""
        from thermofem.data.display import card

        rows = []
        for name, value in self.parameters.items():
            rows.append((name, f"{value:.4g} ± {self.standard_errors[name]:.1g}"))
        rows.append(
            ("misfit", f"{self.residual:.3g} {self.residual_unit} rms, {self.relative_residual:.2%} of the swing")
        )
        rows += [("trained on", text) for text in self.training]
        rows += [("note", text) for text in self.notes]
        return card("Fit", rows, getattr(self.model, "_repr_html_", str)())

    @property
    def provenance(self) -> dict[str, Any]:
        """Provenance that `surrogate.save_model` writes with the model; an error that is not known is null."""
        return {
            **(self.model.origin or {}),
            "method": self.method,
            "equations": list(self.equations),
            "training": list(self.training),
            "parameters": {} if self.equations else dict(self.parameters),
            "standard_errors": files.plain(self.standard_errors),
            "thermal_resistance_deviation": files.plain(self.thermal_resistance_deviation),
            "residual_K": self.residual if self.residual_unit == "K" else None,
            "relative_residual": self.relative_residual,
            "notes": list(self.notes),
            "training_period": self.training_period,
            "geometry": self.geometry,
        }


KNOWN = np.log(10)  # standard deviation of ln(tau) above which its standard error is not stated
OUTSIDE = 3.0  # time constant over the longest time shown, or the shortest over it, from which it is an extrapolation
UNSEEN = np.log(2)  # standard deviation of ln(tau) above which the data do not determine it: a factor of two


def common(values: Sequence[Any]) -> Any:
    """The one value that all Datasets share, or None."""
    first, *others = values
    alike = all(value == first for value in others)
    return first if alike else None


def pole_parameters(model: Foster) -> dict[str, float]:
    """Resistances ``R_1``.. (K/W) and time constants ``tau_1``.. (s) of a network by name."""
    parameters = {}
    for name, values in (("R", model.R), ("tau", model.tau)):
        for k, value in enumerate(np.asarray(values).tolist(), 1):
            parameters[f"{name}_{k}"] = value
    return parameters


def lowers_only_noise(before: float, after: float, samples: float) -> bool:
    """Whether one more pole lowers the misfit of n independent samples so little that it fits noise.

    n ln(before^2/after^2) < 2 ln(n)        (Bayesian information criterion, two parameters a pole)
    """
    n = max(samples, math.e)
    return bool(n * np.log(before / after) < np.log(n))


def check_explained(misfit: float, deviation: float, by: str, of: str) -> None:
    """Raise InputError if the rms ``misfit`` is most of the standard deviation of the data."""
    left = misfit**2 / deviation**2 if deviation else 0.0  # share of the variance
    explained = max(1 - left, 0)
    # 0.2: share of the variance below which data count as noise; the paper's single pole explains 0.9 and more
    if explained < 0.2:
        raise checks.InputError(
            f"{by} explains {explained:.0%} of the variation of {of}: it is noise, or they are not of one run"
        )


def model_notes(model: Foster, optimum: Optimum, problem: FitProblem) -> tuple[str, ...]:
    """Sentences on what is doubtful in the model that was found."""
    stated = common([r.thermal_resistance for r in problem.responses])
    notes = starts(optimum) + offsets(optimum, problem.responses)
    notes += unseen_times(optimum.log_rate, optimum.gain, optimum.deviation, problem.span)
    notes += cancelling(model.R)
    return (*notes, *other_gain(model, stated))


def starts(optimum: Optimum) -> list[str]:
    """Sentences on the start of the heating of measured traces where it was fitted with the poles."""
    notes = []
    for shift, error in zip(optimum.shift, optimum.shift_error, strict=True):
        size = quantity.rounded(abs(shift), "s", 2)
        side = "later" if shift > 0 else "earlier"
        if error == np.inf:
            notes.append(f"the heating begins {size} {side} than the trace shows, or more: take more poles")
        elif error > 0:
            error = quantity.rounded(error, "s", 2)
            notes.append(f"the heating begins {size} +- {error} {side} than the trace shows: fitted with the poles")
    return notes


def offsets(optimum: Optimum, responses: Sequence[Response]) -> list[str]:
    """Sentences on baselines that were fitted with the poles, because no rows at rest show them."""
    notes = []
    for offset, error, response in zip(optimum.offset, optimum.offset_error, responses, strict=True):
        # 3: rows at rest that show a baseline
        if response.rest_rows < 3:
            size = f"{offset:.3g} +- {error:.2g} K"
            notes.append(f"the offset of the rows is fitted with the poles: {size} beside what was subtracted")
    return notes


def other_gain(model: Foster, stated: float | None) -> list[str]:
    """A sentence if the thermal resistance of the model differs from that of the data by more than 10 %."""
    # 0.1: relative difference of thermal resistances that is reported
    R_th = model.thermal_resistance
    if stated is None or abs(R_th - stated) <= 0.1 * abs(stated):
        return []
    fitted = quantity.rounded(R_th, "K/W")
    true = quantity.rounded(stated, "K/W")
    return [f"R_th is {fitted} where the data state {true}: the model holds for heating like its training, not at rest"]


def cancelling(shares: ArrayLike, unit: str = "K/W") -> list[str]:
    """A sentence if poles of opposite sign nearly cancel, as in a transfer channel fitted with too many poles.

    shares [shape (n,), unit]: R of every pole, or its amplitude.
    """
    largest = np.abs(shares).max()
    total = abs(np.sum(shares))
    if largest <= 100.0 * total:  # 100.0: R of a pole over R_th from which poles of opposite sign count as one
        return []
    return [
        f"poles of up to {largest:.2g} {unit} cancel to {total:.2g} {unit}: two of them are nearly one, so take one "
        "fewer"
    ]


def undetermined(optimum: Optimum, span: tuple[float, float], jacobian: Array) -> NDArray[np.bool_]:
    """Which parameters depend on an extrapolated time constant, so that no linear theory gives their error.

    A pole slower than the data is seen by its gain, a faster one by its R = gain/rate: those alone keep an error.
    jacobian [shape (parameters, 2n)]: derivatives of the parameters with respect to (log_rate, gain).
    """
    shortest, longest = span
    tau = np.exp(-optimum.log_rate)
    slow = tau > OUTSIDE * longest
    fast = tau < shortest / OUTSIDE
    by_gain = np.diag(np.where(fast, optimum.gain, 0.0))
    extrapolated = (slow | fast) & (optimum.gain != 0)
    along = np.vstack([np.eye(tau.size), by_gain])[:, extrapolated]
    change = np.abs(jacobian @ along)
    scale = np.abs(jacobian) @ np.abs(along)
    moved = change > 1e-9 * scale
    return moved.any(axis=1)


def unseen_times(rates: Array, gains: Array, deviations: Array, span: tuple[float, float]) -> list[str]:
    """Sentences on time constants that the data do not determine.

    rates, gains, deviations [shape (n,)]: logarithms of the rates, slowest first, and their standard deviations.
    """
    notes = []
    shortest, longest = span
    for k in reversed(range(len(rates))):
        tau = np.exp(-rates[k])
        text = f"tau = {quantity.rounded(tau, 's')}"
        error = deviations[k]
        length = quantity.rounded(longest, "s")
        if gains[k] == 0:
            notes.append(f"{text} is one pole too many: its best gain is zero")
        elif error > UNSEEN:
            size = f": its standard error is a factor of {np.exp(error):.2g}" if error < KNOWN else ""
            notes.append(f"the data do not determine {text}{size}")
        elif tau > OUTSIDE * longest:
            notes.append(f"{text} is an extrapolation: the data last {length}")
        elif tau < shortest / OUTSIDE:
            begin = quantity.rounded(shortest, "s")
            notes.append(f"{text} is an extrapolation: the data begin to show times at {begin}")
    return notes
