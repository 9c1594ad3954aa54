"""Calibration: geometry and materials from measured thermal traces, on a family of models."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import xarray as xr

from thermofem import CrossSection, Foster, OutputMap, checks
from thermofem.algebra.pole_responses import pole_responses
from thermofem.arrays import Array, rms
from thermofem.data.dataset import Response, at_probe, responses_of, warn_of
from thermofem.models import two_kinds
from thermofem.models.contract import warn_beyond

from ..family import Certified, Family
from ..family.family import ChannelNames
from ..fitting.pole_projection import by_trace, noise_along
from .inverse_search import at_edge, family_over, inside

log = logging.getLogger("thermofem")

BLIND = 0.3  # of a range: a combination whose standard error is larger is not determined by the data
NOISE_RANGE = 1e-15, 1e6  # K, of a sample


@dataclass(frozen=True, eq=False)
class Calibration:
    """Parameters of a geometry that explain measured traces best.

    Attributes
    ----------
    values, standard_errors : dict from parameter to float; SI
    covariance : array, shape (p, p)
        in the order of ``values``.
    residual : float, K
        rms over all samples.
    reduced_chi_square : float
        residual over noise, squared, per degree of freedom; about 1 where ``noise`` is right and the model explains
        the data. nan without noise.
    correlation : float
        of neighbouring residuals: 0 for noise, within 2/sqrt(samples); near 1 where the geometry cannot explain the
        data.
    unseen : tuple of str
        combinations of parameters that the data cannot tell apart, in words; contacts so small that the standard errors
        do not hold.
    active : tuple of str
        parameters at an end of their range.
    certified : Certified
        the member on its own mesh.
    family : Family
    channel : ChannelNames
        heated and read, of the data and the members.
    """

    values: dict[str, float]
    standard_errors: dict[str, float]
    covariance: Array = field(repr=False)
    residual: float
    reduced_chi_square: float
    correlation: float
    unseen: tuple[str, ...]
    active: tuple[str, ...]
    certified: Certified = field(repr=False)
    family: Family = field(repr=False)
    channel: ChannelNames

    @property
    def model(self) -> Foster | OutputMap:
        """The thermal model with these parameters."""
        return self.family.of_channel(self.channel, self.values)


def calibrate(
    geometry: CrossSection | Family,
    data: xr.Dataset | Sequence[xr.Dataset],
    free: Mapping[str, tuple[float, float]] | None = None,
    *,
    noise: float | None = None,
    tolerance: float = 1e-3,
    heated: str | None = None,
    read: str | None = None,
) -> Calibration:
    """Fit geometry and material parameters to thermal traces.

        min over the box of sum over samples of (delta_T(t; p) - measured)^2/noise^2,    covariance = noise^2 (J^T J)^-1

    by Gauss-Newton (trust region with bounds, SciPy) from several starts, on the derivatives of a family's members with
    respect to its parameters. With ``noise`` the covariance is that of independent noise of one size. Without, each
    trace has the variance of its own residuals and, from 50 samples on and where these are correlated, their
    autocorrelation.

    Parameters
    ----------
    geometry : CrossSection or Family
        of a CrossSection a family is trained over ``free``.
    data : Dataset or list of Dataset
        as `thermofem.load` and `thermofem.read_trace` give them, under any power; from rest or periodic.
    free : dict from parameter to (low, high), SI
        default all parameters of a family over their box.
    noise : float, K
        standard deviation of a sample, in every trace; without it that of the residual of each trace is taken.
    tolerance : float
        of a family that is trained here; keep it below the relative noise of the mean of all samples.
    heated, read : str
        the channel of the data; default the first heated part, and itself or what the family reads first.

    Returns
    -------
    Calibration
        values with standard errors (of the noise alone; `Calibration.certified` has the error of the family), what the
        data do not determine, and the member on its own mesh.

    Raises
    ------
    InputError
        fewer samples than parameters, ranges outside the family's box, data without a drive, or data of another part
        than the channel.
    """
    from scipy.optimize import least_squares

    family = family_over(geometry, free, tolerance)
    ranges = family.ranges
    for name, pair in (free or {}).items():
        ranges[name] = inside(family, name, pair)
    low, high = np.array(list(ranges.values())).T
    responses = responses_of(data)
    channel = family.channel(heated, read)
    _check_channel(family, channel, data)
    warn_of(responses)
    measured = np.concatenate([response.rise for response in responses])
    checks.enough("data", measured.size, len(low) + 1)
    span = replace(family.box, low=low, high=high)
    scale = float(np.std(measured)) or 1.0
    if noise is not None:
        scale = checks.between("noise", noise, *NOISE_RANGE, unit="K")

    def member(x: Array) -> OutputMap:
        values = span.named(span.at(x))
        poles: OutputMap = two_kinds(family.of_channel(channel, values))
        return poles

    def linear_rise(model: OutputMap) -> Array:
        return np.concatenate([_linear_rise(model.linear, d) for d in responses])

    def misfit(x: Array) -> Array:
        model = member(x)
        rise = warn_beyond(model.of(linear_rise(model)), model.largest_rise)
        return (rise - measured) / scale

    def jacobian(x: Array) -> Array:
        row = span.at(x)
        model = member(x)
        modal = family.modal_derivative(row, channel)
        slopes = np.hstack([modal.response(d.wave, d.times, periodic=d.periodic) for d in responses])
        if family.output_maps is not None and model.bent:  # dT = z + a z^2
            z = linear_rise(model)
            of_a = family.output_maps.slopes(family.box, row)
            slopes = (1 + 2 * model.coefficient * z) * slopes + np.outer(of_a, z**2)
        return slopes.T * (span.slope(x) / scale)

    shares = np.random.default_rng(0).uniform(0.15, 0.85, (3, len(low)))  # 4 starts of Gauss-Newton, with the middle
    starts = np.vstack([np.full(len(low), 0.5), shares])
    tolerances = {"xtol": 1e-12, "ftol": 1e-14, "gtol": 1e-12}
    ends = [least_squares(misfit, start, jacobian, bounds=(0, 1), **tolerances) for start in starts]
    best = min(ends, key=lambda end: float(end.cost))
    x: Array = best.x
    residuals: Array = best.fun
    square = float(residuals @ residuals)
    per_freedom = square / (measured.size - len(low))
    variance = 1.0 if noise is not None else per_freedom
    traces = by_trace(residuals, responses)
    covariance, unseen = _covariance(jacobian(x), traces, variance, noise is not None, family.names)
    values = span.named(span.at(x))
    slope = span.slope(x)
    errors = np.sqrt(np.diag(covariance)) * slope
    return Calibration(
        values=values,
        standard_errors=dict(zip(family.names, errors.tolist(), strict=True)),
        covariance=covariance * np.outer(slope, slope),
        residual=rms(residuals * scale),
        reduced_chi_square=per_freedom if noise is not None else np.nan,
        correlation=float(residuals[1:] @ residuals[:-1] / max(square, 1e-300)),
        unseen=(*unseen, *family.doubts(span.at(x), channel)),
        active=at_edge(family.names, x),
        certified=family.certify(**values),
        family=family,
        channel=channel,
    )


def _linear_rise(poles: Foster, response: Response) -> Array:
    """Rise in K at the times of the data, which need not be spread over a period as `periodic_response` has them."""
    rate = 1 / np.asarray(poles.tau)
    phi = pole_responses(rate, response.wave, response.times, periodic=response.periodic)
    return phi @ poles.gain


def _check_channel(family: Family, channel: ChannelNames, data: Any) -> None:
    """Raise InputError where data were heated or read in other parts than the members; warn of several geometries.

    A measured table states only the name of its column, which counts as a part only where the geometry has such a part.
    """
    datasets = data if isinstance(data, list | tuple) else [data]
    regions = family.box.base.region_names
    geometries = {dataset.attrs["geometry"] for dataset in datasets if "geometry" in dataset.attrs}
    if len(geometries) > 1:
        log.warning("data were solved for different geometries, and one set of parameters is fitted to all of them")
    for dataset in map(at_probe, datasets):
        for what, of_members in vars(channel).items():
            part = str(dataset.attrs.get(what) or of_members)
            named = "heated" in dataset.attrs or part in regions
            if named and part != of_members:
                raise checks.InputError(
                    f"data was {what} in {checks.shown(part)}, and the members are in {of_members!r}; solve for that, "
                    f"or, if it is the same part, set its attribute {what!r}"
                )


def _covariance(
    J: Array, residuals: Sequence[Array], variance: float, alike: bool, names: Sequence[str]
) -> tuple[Array, tuple[str, ...]]:
    """Covariance of parameters as fractions of their ranges, and combinations with a standard error above `BLIND`."""
    u, s, vt = np.linalg.svd(J, full_matrices=False)
    least = 1e-12 * s[0] or 1e-300
    size = 1 / np.maximum(s, least)
    noise = noise_along(residuals, u, variance, alike=alike)
    back = vt.T * size
    errors = size * np.sqrt(noise.diagonal())
    unseen = []
    for error, direction in zip(errors, vt, strict=True):
        if error > BLIND:
            largest = np.abs(direction).argmax()
            shares = direction * np.sign(direction[largest])
            terms = [f"{share:+.2f} {name}" for share, name in zip(shares, names, strict=True) if abs(share) > 0.1]
            unseen.append(f"{' '.join(terms)} (shares of the ranges): known to {error:.1g} of the range only")
    return back @ noise @ back.T, tuple(unseen)
