"""Standard deviations of identified parameters: from noise, from the error of the model, and from held numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from thermofem.arrays import Array, Indices

from ..unknowns import Unknowns, varied
from .box_search import End, Prior, at_bound, central_slopes, least_squares
from .cycle_residuals import SOFT, STAGES, Stage, residuals
from .cycles import Target
from .held_numbers import HELD_STEP, held_numbers

WIDENED, FLAT = 8, 2.0  # most widenings, and rise of the misfit at two deviations, 4 of a parabola, that calls for one
ORDER = 6  # of the divided differences in which a smooth trace vanishes and white noise does not
# share of the swing: less is no noise. Measured: 1e-8 to 1e-5 in traces of `simulate` and `cosimulate` at 10 ns or less
# between samples; an 8-bit oscilloscope alone leaves 1e-3
SMOOTH = 1e-4
ASIDE = 1e-6  # of a logarithm: parameters that far from the end of the search are those of the soft fit
LOGARITHM_STEP = 1e-5  # of a logarithm, for the slope of R_th


class Curvature(NamedTuple):
    """Deviations (logarithms) that the slopes of the residuals give, nan on a bound, and the largest widening."""

    deviations: Array
    factor: float


def white_noise(t: Array, drop: Array) -> float:
    """Standard deviation of the white noise in a smooth trace, from divided differences over seven samples.

        d = sum_j w_j y_j,    w_j ~ prod_(l != j) 1/(t_j - t_l),    sum_j w_j^2 = 1

    d vanishes for polynomials below the sixth degree, and has the deviation of the noise; its median is not moved by
    edges. The times need not be equally spaced.
    """
    windows = sliding_window_view(t / np.median(np.diff(t)), ORDER + 1)
    distances = windows[:, :, None] - windows[:, None, :]
    weights = 1 / np.prod(distances + np.eye(ORDER + 1), axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    differences = np.sum(weights * sliding_window_view(drop, ORDER + 1), axis=1)
    return float(np.median(np.abs(differences))) / 0.6745  # of a normal distribution


def without_noise(targets: list[Target]) -> bool:
    """Whether no trace has white noise above 1e-4 of its swing, as those of a simulation; never where it is known."""
    known = any(target.noise is not None for target in targets)
    return not known and all(
        white_noise(target.times, target.drop) < SMOOTH * target.seen.cycle.scale for target in targets
    )


def curvature(what: Unknowns, targets: list[Target], stage: Stage, x: Array, prior: Prior) -> Curvature:
    """Deviations of the parameters ``x`` (logarithms) from the Jacobian J of the residuals of a stage.

        C = (J^T J + L)^-1,    L: precision of the prior

    for residuals of standard deviation 1; widened where the misfit is flatter than the slopes say.
    """
    deviations = np.full(x.size, np.nan)
    free = np.flatnonzero(~at_bound(x, what.low, what.high))
    if not free.size:
        return Curvature(deviations, 1.0)
    of = residuals(what, targets, stage)
    r = of(x)
    assert r is not None
    J = central_slopes(of, x, r, len(targets))[:, free]
    L = prior.precision[np.ix_(free, free)]

    def cost(part: Array) -> float:
        y = x.copy()
        y[free] = part
        left = of(y)
        off = part - prior.centre[free]
        return np.inf if left is None else float(left @ left + off @ L @ off)

    C = np.asarray(np.linalg.inv(J.T @ J + L), dtype=float)
    wide, factor = _widened(cost, x[free], C, what.low[free], what.high[free])
    deviations[free] = np.sqrt(np.diag(wide))
    return Curvature(deviations, factor)


def unknown_as_inf(deviations: Array) -> Array:
    """The deviations of logarithms, inf where they say nothing on the parameter."""
    # a logarithm uncertain by 1 or more is not determined
    return np.where(deviations > 1.0, np.inf, deviations)


def _widened(cost: Callable[[Array], float], x: Array, C: Array, low: Array, high: Array) -> tuple[Array, float]:
    """Covariance of the parameters ``x`` (logarithms), widened by a profile of the misfit, and the largest factor.

    Along each eigenvector of C the misfit should rise by 4 at two standard deviations. Where it rises less, as with
    slopes taken across the onset of self-pulsing, that deviation is widened until it does.
    """
    variances, directions = np.linalg.eigh(C)
    factors = np.ones(x.size)
    least = cost(x)
    for k, (s, along) in enumerate(zip(np.sqrt(variances), directions.T, strict=True)):
        for _ in range(WIDENED):
            ends = [x + sign * 2 * s * factors[k] * along for sign in (1, -1)]
            rises = [cost(y) - least for y in ends if np.all((y > low) & (y < high))]
            rise = min(rises, default=4.0)
            if rise > FLAT:
                break
            factors[k] *= min(2 / np.sqrt(max(rise, 0.04)), 4.0)
    return (directions * variances * factors**2) @ directions.T, float(factors.max())


def spread_over_traces(what: Unknowns, targets: list[Target], stage: Stage, x: Array, prior: Prior | None) -> Array:
    """Standard deviations (logarithms) by the jackknife: fits x_k from ``x`` on, each without trace k.

        s^2 = (K - 1)/K sum_k (x_k - mean)^2

    They hold what a model that cannot follow the traces makes of the choice of traces; 0 for a single trace.
    """
    count = len(targets)
    if count == 1:
        return np.zeros(x.size)
    ends = []
    for k in range(count):
        others = targets[:k] + targets[k + 1 :]
        of = residuals(what, others, stage)
        end = least_squares(of, x, what.low, what.high, steps=stage.steps, traces=count - 1, prior=prior)
        ends.append(end.x)
    off = np.array(ends) - np.mean(ends, axis=0)
    return np.sqrt((count - 1) / count * np.sum(off**2, axis=0))


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
    values = np.array([*parameters.values()])
    x = np.log(values)
    relative = np.array([*deviations.values()]) / values
    soft = bool(np.abs(x - end.x).max() > ASIDE)
    stage = SOFT if soft else STAGES[-1]
    of = residuals(what, targets, stage)
    own = of(x)
    assert own is not None
    J = central_slopes(of, x, own, len(targets)) if soft else end.J
    L = np.zeros_like(prior.precision) if soft else prior.precision
    free = np.flatnonzero(~at_bound(x, what.low, what.high))
    sensitivities: dict[str, dict[str, float]] = {what.names[k]: {} for k in free}
    slope = _resistance_slopes(what, x)
    inside = J[:, free]
    C = np.asarray(np.linalg.pinv(inside.T @ inside + L[np.ix_(free, free)]), dtype=float)
    resistance_variance = _variance_by_noise(slope, relative, free, C)
    variance = relative**2
    for name, number in held_numbers(what.ring, what.names).items():
        change = _change(what, targets, stage, x, own, name, number)
        if change is None:
            continue
        slopes = np.zeros(x.size)
        slopes[free] = -C @ (inside.T @ change)
        share = held.get(name, 0.0) / number
        variance = variance + (slopes * share) ** 2
        resistance_variance += float(slope @ slopes * share) ** 2
        for k in free:
            sensitivities[what.names[k]][name] = float(slopes[k])
    _, model = what.build(x)
    bar = float(model.thermal_resistance) * float(np.sqrt(resistance_variance))
    widened = (np.sqrt(variance) * values).tolist()
    return Leaning(sensitivities, dict(zip(what.names, widened, strict=True)), bar)


def _change(
    what: Unknowns, targets: list[Target], stage: Stage, x: Array, own: Array, name: str, value: float
) -> Array | None:
    """dr/d ln p of a held number by a forward difference; None where the model is not defined."""
    other = replace(what, ring=varied(what.ring, {name: value * (1 + HELD_STEP)}))
    moved = residuals(other, targets, stage)(x)
    return None if moved is None else (moved - own) / HELD_STEP


def _variance_by_noise(slope: Array, relative: Array, free: Indices, C: Array) -> float:
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
