"""The result of a fit: parameters, errors, and how well the model describes its data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from thermofem import Foster
from thermofem.arrays import Array
from thermofem.data import files
from thermofem.models import HasModel


@dataclass(frozen=True, eq=False)
class Fit(HasModel):
    """A trained model and how well it fits its data.

    Attributes
    ----------
    model : Foster
    parameters : dict of float
        in SI, by name.
    standard_errors : dict of float
        one standard deviation of each parameter, from the Jacobian, and from the variance and the autocorrelation of
        the residuals of each Dataset. A trace of fewer than 50 samples does not show the latter: there noise counts as
        independent from sample to sample.
        inf where a time constant beyond the data decides, as ``notes`` say.
    correlations : array, shape (parameters, parameters)
        in the order of ``parameters``.
    residual : float, K
        rms over all samples.
    relative_residual : float
        rms of residual over swing, each Dataset by its own swing.
    training : tuple of str
        the drive of each Dataset; the parameters mean little without it.
    notes : tuple of str
        what makes the data doubtful, such as a drive with another duty; time constants that they do not determine.
    geometry : str or None
        TOML of the cross-section, where the data carries it.
    swarm_residual : float or None, K
        what the particle swarm alone reached, with ``method="pso"``.
    misfit_is_noise : bool or None
        whether the misfit is that of the rows at rest, where there are such, or else forgets itself from row to row.
    training_period : float or None, s
        of the drive, where all Datasets have the same.
    """

    model: Foster
    parameters: Mapping[str, float]
    standard_errors: Mapping[str, float]
    correlations: Array = field(repr=False)
    residual: float
    relative_residual: float
    training: tuple[str, ...]
    notes: tuple[str, ...] = ()
    geometry: str | None = field(default=None, repr=False)
    swarm_residual: float | None = None
    misfit_is_noise: bool | None = None
    training_period: float | None = None

    def _repr_html_(self) -> str:
        """HTML for notebooks."""
        from thermofem.data.display import card

        rows = [(k, f"{v:.4g} ± {self.standard_errors[k]:.1g}") for k, v in self.parameters.items()]
        rows.append(("misfit", f"{self.residual:.3g} K rms, {self.relative_residual:.2%} of the swing"))
        rows += [("trained on", text) for text in self.training] + [("note", text) for text in self.notes]
        return card("Fit", rows, self.model._repr_html_())

    @property
    def provenance(self) -> dict[str, Any]:
        """Provenance that `surrogate.save_model` writes with the model; an error that is not known is null."""
        return {
            "method": "fit",
            "training": list(self.training),
            "parameters": dict(self.parameters),
            "standard_errors": files.plain(self.standard_errors),
            "residual_K": self.residual,
            "relative_residual": self.relative_residual,
            "notes": list(self.notes),
            "training_period": self.training_period,
            "geometry": self.geometry,
        }
