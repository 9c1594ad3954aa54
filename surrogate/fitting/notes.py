"""What a fit says of itself: starts that moved, time constants that are not seen, poles that cancel, another R_th."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from thermofem import Foster
from thermofem.arrays import Array, ArrayLike, NDArray
from thermofem.data import quantity
from thermofem.data.dataset import Response

from .projection import Optimum

FEW = 3  # rows at rest that show a baseline
LOW = 1e-3  # of the swing: R_th P below the last rows by less is the misfit of the fit

CANCELLING = 100.0  # R of a pole over R_th from which poles of opposite sign count as one
EXPLAINED = 0.2  # share of the variance below which data count as noise; the paper's single pole explains 0.9 and more
OTHER = 0.1  # relative difference of thermal resistances that is told
KNOWN = np.log(10)  # standard deviation of ln(tau) from which its size says nothing
OUTSIDE = 3.0  # time constant over the longest time shown, or the shortest over it, from which it is an extrapolation
UNSEEN = np.log(2)  # standard deviation of ln(tau) from which a time constant counts as not seen: a factor of two


def starts(found: Optimum) -> list[str]:
    """Sentences on the starts of measured traces, which were fitted with the poles."""
    notes = []
    for shift, error in zip(found.shift, found.shift_error, strict=True):
        size, side = quantity.rounded(abs(shift), "s", 2), "later" if shift > 0 else "earlier"
        if error == np.inf:
            notes.append(f"the heating begins {size} {side} than the trace shows, or more: take more poles")
        elif error > 0:
            error = quantity.rounded(error, "s", 2)
            notes.append(f"the heating begins {size} +- {error} {side} than the trace shows: fitted with the poles")
    return notes


def offsets(found: Optimum, responses: Sequence[Response]) -> list[str]:
    """Sentences on baselines that were fitted with the poles, because no rows at rest show them."""
    return [
        f"the offset of the rows is fitted with the poles: {offset:.3g} +- {error:.2g} K beside what was subtracted"
        for offset, error, response in zip(found.offset, found.offset_error, responses, strict=True)
        if response.rest_rows < FEW
    ]


def below_last(model: Foster, responses: Sequence[Response], offset: Array) -> list[str]:
    """A sentence where R_th P lies below the last rows of a step, which no model with positive R can reach."""
    for response, level in zip(responses, offset, strict=True):
        t, y = response.times, response.rise - level
        power = response.wave(t)
        if response.periodic or np.ptp(power) > 0 or power[0] <= 0 or t.size < FEW:
            continue
        last, top = y[-max(1, t.size // 50) :], model.thermal_resistance * float(power[0])
        noise = float(np.median(np.abs(np.diff(y, 2)))) / (0.6745 * np.sqrt(6))
        if top < last.mean() - max(4 * noise / np.sqrt(last.size), LOW * float(np.ptp(y))):
            return [f"R_th P is {top:.4g} K, below the last rows, {last.mean():.4g} K: are start and baseline right?"]
    return []


def other_gain(model: Foster, stated: float | None) -> list[str]:
    """Warning if the thermal resistance of the model differs from that of the data."""
    if stated is None or abs(model.thermal_resistance - stated) <= OTHER * abs(stated):
        return []
    own, true = (quantity.rounded(R, "K/W") for R in (model.thermal_resistance, stated))
    return [f"R_th is {own} where the data state {true}: the model holds for heating like its training, not at rest"]


def cancelling(shares: ArrayLike, unit: str = "K/W") -> list[str]:
    """A sentence on poles of opposite sign that are nearly one, as of a transfer channel with too many.

    shares [shape (n,), unit]: R of every pole, or its amplitude.
    """
    largest, total = float(np.abs(shares).max()), abs(float(np.sum(shares)))
    if largest <= CANCELLING * total:
        return []
    return [
        f"poles of up to {largest:.2g} {unit} cancel to {total:.2g} {unit}: two of them are nearly one, so take one "
        "fewer"
    ]


def undetermined(found: Optimum, span: tuple[float, float], jacobian: Array) -> NDArray[np.bool_]:
    """Which parameters move with a time constant that is an extrapolation: no linear theory gives their error.

    A pole slower than the data is seen by its gain, a faster one by its R = gain/rate: those alone keep an error.
    jacobian [shape (parameters, 2n)]: by (log_rate, gain).
    """
    tau, n = np.exp(-found.log_rate), found.gain.size
    slow, fast = tau > OUTSIDE * span[1], tau < span[0] / OUTSIDE
    along = np.vstack([np.eye(n), np.diag(np.where(fast, found.gain, 0.0))])[:, (slow | fast) & (found.gain != 0)]
    return np.asarray((np.abs(jacobian @ along) > 1e-9 * (np.abs(jacobian) @ np.abs(along))).any(axis=1))


def unseen(found: Optimum, span: tuple[float, float]) -> list[str]:
    """Sentences on time constants that the data do not determine."""
    deviation = np.sqrt(np.maximum(found.covariance.diagonal()[: found.log_rate.size], 0))
    return unseen_times(found.log_rate, found.gain, deviation, span)


def unseen_times(rates: Array, gains: Array, deviations: Array, span: tuple[float, float]) -> list[str]:
    """The same of logarithms of rates, slowest first, their gains and standard deviations."""
    notes = []
    for log_rate, gain, sd in zip(rates[::-1], gains[::-1], deviations[::-1], strict=True):
        tau = np.exp(-log_rate)
        said = f"tau = {quantity.rounded(tau, 's')}"
        if gain == 0:
            notes.append(f"{said} is one pole too many: its best gain is zero")
        elif sd > UNSEEN:
            size = f": its standard error is a factor of {np.exp(sd):.2g}" if sd < KNOWN else ""
            notes.append(f"the data do not determine {said}{size}")
        elif tau > OUTSIDE * span[1]:
            notes.append(f"{said} is an extrapolation: the data last {quantity.rounded(span[1], 's')}")
        elif tau < span[0] / OUTSIDE:
            seen = quantity.rounded(span[0], "s")
            notes.append(f"{said} is an extrapolation: the data begin to show times at {seen}")
    return notes
