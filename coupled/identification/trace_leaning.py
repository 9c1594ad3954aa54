"""How far parameters identified from traces lean on the numbers that are held, and the deviation of R_th."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from thermofem.arrays import Array, NDArray

from ..unknowns import Unknowns, varied
from .box_search import End, Prior, at_bound, central_slopes
from .cycle_residuals import SOFT, STAGES, Stage, residuals
from .cycles import Target
from .held_numbers import SHARE, held_numbers, moved_minimum

ASIDE = 1e-6  # of a logarithm: parameters that far from the end of the search are those of the soft fit
LOGARITHM_STEP = 1e-5  # of a logarithm, for the slope of R_th


class Leaning(NamedTuple):
    """What the deviations of identified parameters hold beside noise.

    sensitivities: by parameter, d ln parameter/d ln held for each held number; empty where the fit failed.
    standard_deviations: by parameter, in SI, with those of held numbers.
    thermal_resistance_deviation [K/W]: of R_th of the model; nan where a deviation is not known.
    """

    sensitivities: dict[str, dict[str, float]]
    standard_deviations: dict[str, float]
    thermal_resistance_deviation: float


def leaning_of(
    what: Unknowns, targets: list[Target], end: End, prior: Prior, parameters: Mapping[str, float],
    deviations: Mapping[str, float], held: Mapping[str, float],
) -> Leaning:  # fmt: skip
    """Sensitivities to all held numbers, and deviations that contain those of ``held``, standard deviations in SI.

        d ln x/d ln p = -(J^T J + L)^-1 J^T dr/d ln p,    s_R^2 = g^T D C D g + sum_p (s_p g^T d ln x/d ln p)^2

    with C = (J^T J + L)^-1, g = d ln R_th/d ln x, and D such that the diagonal of D C D is that of the deviations by
    noise.
    """
    x = np.log([parameters[name] for name in what.names])
    relative = np.array([deviations[name] / parameters[name] for name in what.names])
    soft = bool(np.abs(x - end.x).max() > ASIDE)
    stage = SOFT if soft else STAGES[-1]
    own = residuals(what, targets, stage)(x)
    assert own is not None
    J = central_slopes(residuals(what, targets, stage), x, own, len(targets)) if soft else end.J
    L = np.zeros_like(prior.precision) if soft else prior.precision
    free = np.flatnonzero(~at_bound(x, what.low, what.high))
    sensitivities: dict[str, dict[str, float]] = {what.names[k]: {} for k in free}
    slope = _resistance_slopes(what, x)
    inside = J[:, free]
    precision = L[np.ix_(free, free)]
    C = np.asarray(np.linalg.pinv(inside.T @ inside + precision), dtype=float)
    resistance_variance = _variance_by_noise(slope, relative, free, C)
    variance = relative**2
    for name, value in held_numbers(what.ring, what.names).items():
        change = _change(what, targets, stage, x, own, name, value)
        if change is None:
            continue
        slopes = np.zeros(x.size)
        slopes[free] = moved_minimum(inside, change, precision)
        share = held.get(name, 0.0) / value
        variance = variance + (slopes * share) ** 2
        resistance_variance += float(slope @ slopes * share) ** 2
        for k in free:
            sensitivities[what.names[k]][name] = float(slopes[k])
    _, model = what.build(x)
    bar = float(model.thermal_resistance) * float(np.sqrt(resistance_variance))
    widened = {}
    for name, s in zip(what.names, np.sqrt(variance), strict=True):
        widened[name] = float(s * parameters[name])
    return Leaning(sensitivities, widened, bar)


def _change(
    what: Unknowns, targets: list[Target], stage: Stage, x: Array, own: Array, name: str, value: float
) -> Array | None:
    """dr/d ln p of a held number by a forward difference; None where the model is not defined."""
    other = replace(what, ring=varied(what.ring, {name: value * (1 + SHARE)}))
    moved = residuals(other, targets, stage)(x)
    return None if moved is None else (moved - own) / SHARE


def _variance_by_noise(slope: Array, relative: Array, free: NDArray[np.intp], C: Array) -> float:
    """g^T D C D g of a quantity with the slopes g, for deviations of all parameters; C [of the ``free`` ones].

    inf or nan where the quantity depends on a parameter whose deviation is so.
    """
    matters = np.flatnonzero(slope)
    if not np.isfinite(relative[matters]).all():
        return float(np.max(relative[matters]))
    size = np.sqrt(np.maximum(np.diag(C), 1e-300))
    scaled = np.where(slope[free] == 0, 0.0, slope[free] * relative[free]) / size
    return float(scaled @ C @ scaled)


def _resistance_slopes(what: Unknowns, x: Array) -> Array:
    """d ln R_th/d ln x of the model, shape (unknowns,); 0 for parameters of the ring."""
    slopes = []
    for unit in np.eye(x.size):
        above = float(what.build(x + LOGARITHM_STEP * unit)[1].thermal_resistance)
        below = float(what.build(x - LOGARITHM_STEP * unit)[1].thermal_resistance)
        slopes.append(np.log(above / below) / (2 * LOGARITHM_STEP))
    return np.array(slopes)
