"""Foster network to Cauer ladder and back, and the structure function of a heat path.

A Cauer ladder follows the heat path: a capacity C_1 at the source, a resistance R_1, a capacity C_2, ...,

    Z(s) = 1 / (s C_1 + 1 / (R_1 + 1 / (s C_2 + 1 / (R_2 + ...))))

so that the running sums of its R and C (the cumulative structure function) show the layers: steep where heat capacity
is large, flat where little capacity conducts badly.

Source: V. Szekely, T. Van Bien, Solid-State Electronics 31, 1363 (1988); JEDEC JESD51-14.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal, localcontext
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from .. import checks
from ..arrays import NDArray
from .contract import Delegates, ThermalModel, columns, keep_names, names, parts, reader, rows
from .foster import Foster, linear_poles

FEWER = "merge neighbouring poles, or fit or reduce to fewer"


@dataclass(frozen=True, eq=False)
class Cauer(Delegates):
    """Ladder of resistances to the next node and capacities to the ambient, from the heated part outwards.

    Parameters
    ----------
    R : array, shape (n,), K/W
    C : array, shape (n,), J/K
    origin : dict, optional
        where the model comes from (geometry as TOML, how it was made); exports and model files keep it.

    Raises
    ------
    InputError
        lengths that differ, or values that are not positive.
    """

    R: Any
    C: Any
    inputs: tuple[str, ...] = ("core",)
    outputs: tuple[str, ...] = ("core",)
    origin: Mapping[str, Any] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        R = checks.array("R", self.R)
        C = checks.array("C", self.C)
        checks.shape("C", C, R.shape)
        checks.positive("R of the ladder", R.min(), unit="K/W")
        checks.positive("C of the ladder", C.min(), unit="J/K")
        keep_names(self)
        checks.keep(self, R=R, C=C)

    @property
    def thermal_resistance(self) -> float:
        """R_th = sum of R in K/W."""
        return float(self.R.sum())

    @cached_property
    def dynamics(self) -> Foster:
        """The Foster network of the ladder."""
        return foster_of(self)

    @property
    def _other(self) -> Foster:
        return self.dynamics

    def to_json(self) -> dict[str, Any]:
        """Fields of the model file, from the heated part outwards."""
        return {
            **names(self),
            "thermal_resistance": self.thermal_resistance,
            "ladder": rows(("C", self.C), ("R", self.R)),
            "units": {"thermal_resistance": "K/W", "C": "J/K", "R": "K/W"},
        }

    @classmethod
    @reader
    def from_json(cls, content: Mapping[str, Any]) -> Cauer:
        """The ladder that the content of a model file describes."""
        return cls(**columns(content, "ladder", R="K/W", C="J/K"), **parts(content))


def cauer(model: ThermalModel) -> Cauer:
    """The ladder of a passive linear model, by continued fractions in decimals of many digits; of a Cauer, itself.

    Parameters
    ----------
    model : ThermalModel
        linear, with one input and one output; or a fit or reduction that holds it.

    Returns
    -------
    Cauer
        R (K/W) and C (J/K) from the heated part outwards.

    Raises
    ------
    InputError
        a network that is not passive, or whose R are all zero; more than 200 poles, or so many so near each
        other that R or C of the ladder exceed 1e100 (150 from 1 to 2 us reach 1e268 J/K). Poles of zero R are left out,
        equal time constants merged.
    """
    if isinstance(model, Cauer):
        return model
    model = linear_poles(model, "has a Cauer ladder")
    warms = model.R > 0
    if not model.passive or not warms.any():
        raise checks.InputError("model has no ladder: it is not passive (an R is negative), or never warms up (all 0)")
    tau, group = np.unique(model.tau[warms], return_inverse=True)
    R = np.bincount(group, weights=model.R[warms])
    # the time goes with the fourth power of the number of poles: 4 s for 200
    checks.integer("poles of the ladder", R.size, 1, 200, hint=FEWER)
    ladder_R = []
    ladder_C = []
    with localcontext() as context:
        # 12: more for each pole: the continued fraction loses up to the square of the ratio of neighbours
        context.prec = 40 + 12 * R.size  # 40 decimal digits kept, and
        top, bottom = _polynomials(R, tau)
        while top.size:  # the leading coefficients of both differences vanish by construction
            C = bottom[0] / top[0]  # 1/Z = s C + rest
            bottom = (bottom - C * np.array([*top, Decimal(0)]))[1:]
            ladder_C.append(float(C))
            resistance = top[0] / bottom[0]  # 1/rest = R + next Z
            top = (top - resistance * bottom)[1:]
            ladder_R.append(float(resistance))
    return Cauer(ladder_R, ladder_C, model.inputs, model.outputs, getattr(model, "origin", None))


def _polynomials(R: NDArray[Any], tau: NDArray[Any]) -> tuple[Any, Any]:
    """Numerator and denominator of Z(s) = sum_i R_i/(1 + s tau_i), as decimal coefficients of falling powers of s."""
    top = np.array([Decimal(0)])
    bottom = np.array([Decimal(1)])
    for r, t in zip(R.tolist(), tau.tolist(), strict=True):
        pole = np.array([Decimal(t), Decimal(1)])
        top = np.polyadd(np.convolve(top, pole), Decimal(r) * bottom)
        bottom = np.convolve(bottom, pole)
    return top[1:], bottom


def foster_of(ladder: Cauer) -> Foster:
    """The Foster network of a ladder.

    With the ladder's incidence D (bidiagonal), C dx/dt = -D^T R^-1 D x + e_1 P. The singular values of
    R^-1/2 D C^-1/2 are the square roots of the rates, which keeps the slow ones accurate.

    Parameters
    ----------
    ladder : Cauer

    Returns
    -------
    Foster
        as many poles as the ladder has steps.

    Raises
    ------
    InputError
        no ladder.
    """
    size = ladder.R.size
    D = np.eye(size) - np.eye(size, k=1)
    _, sigma, modes = np.linalg.svd(D / np.sqrt(ladder.R)[:, None] / np.sqrt(ladder.C))
    tau = 1 / sigma**2
    gain = modes[:, 0] ** 2 / ladder.C[0]
    return Foster(R=gain * tau, tau=tau, inputs=ladder.inputs, outputs=ladder.outputs)


def structure_function(model: ThermalModel) -> xr.Dataset:
    """Cumulative structure function: capacity reached against resistance passed, from the heated part outwards.

    Parameters
    ----------
    model : ThermalModel
        linear and passive; best a fine spectrum from `surrogate.fit_spectrum`.

    Returns
    -------
    Dataset
        over ``node``: ``resistance`` (K/W), ``capacity`` (J/K), both cumulative.
    """
    ladder = cauer(model)
    about_R = {"units": "K/W", "long_name": "cumulative thermal resistance"}
    about_C = {"units": "J/K", "long_name": "cumulative heat capacity"}
    resistance = ("node", np.cumsum(ladder.R), about_R)
    capacity = ("node", np.cumsum(ladder.C), about_C)
    return xr.Dataset({"resistance": resistance, "capacity": capacity})
