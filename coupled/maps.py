"""Maps of self-pulsing over power and detuning by integration, and how far two maps agree."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from thermofem import checks
from thermofem.model import Foster, ThermalModel

from .pulsing import Regime, pulsing
from .resonator import RingResonator
from .simulate import simulate
from .stability import axes_of, stability_map
from .steady import check_axis, check_ring, provenance
from .thermal import network

if TYPE_CHECKING:
    import xarray as xr

FAILED = "failed"


class _Cell(NamedTuple):
    """What one run says."""

    regime: str
    period: float
    duty: float
    swing: float
    reason: str


def pulsing_map(
    ring: RingResonator,
    model: ThermalModel,
    powers: ArrayLike,
    detunings: ArrayLike,
    *,
    duration: float = 20e-6,
    rtol: float = 1e-5,
    executor: Executor | None = None,
    progress: bool = False,
) -> xr.Dataset:
    """Integrate every point of a map from a cold ring and classify its trace: `simulate` and `pulsing` for each.

    Parameters
    ----------
    ring : RingResonator
    model : ThermalModel
        linear and small: a Foster network or a StateSpace with at most 500 states.
    powers : array, shape (n,), W
        in the bus waveguide, larger than 0, increasing.
    detunings : array, shape (m,), Hz
        laser minus cold resonance, increasing.
    duration : float, s
    rtol : float
        of `simulate`.
    executor : concurrent.futures.Executor, optional
        takes one row of equal power at a time; by default one thread for each processor.
    progress : bool
        whether to draw a bar on the terminal.

    Returns
    -------
    xarray.Dataset
        over power (W) and detuning (Hz): regime ("self-pulsing", "stable", "slow transient" or "failed"), period (s,
        nan unless it pulses), duty, swing (K) and reason, in words; a point that cannot be integrated says why there.

    Raises
    ------
    InputError
        a power or detuning out of range or not increasing, a duration or rtol out of range, or a model that is not
        linear, small and passive.

    Near a fold that has just vanished the first pulse can take longer than any duration chosen, and where a slow drift
    leads up to an unstable fixed point, long steps of the integration damp what noise would let grow (a smaller rtol
    then helps). So a trace that seems to rest where `stability_map` finds no stable fixed point reads "slow transient",
    with the reason.

    Source: Borghi et al., Opt. Express 29, 4363 (2021), Figs. 4 and 6; cold start, as the paper's shutter does.
    """
    import xarray as xr

    from thermofem import dataset

    check_ring(ring)
    P, nu = check_axis("powers", powers), check_axis("detunings", detunings)
    checks.positive("duration", duration, unit="s", at_most=1, hint="times are in s (did you mean 20e-6 for 20 us?)")
    checks.between("rtol", rtol, 1e-13, 1e-3, hint="1e-5 gives periods to 1e-4")
    poles = network(model)
    rows: list[list[_Cell]] = [[] for _ in P]
    with _pool(executor) as pool, _bar(P.size, progress) as advance:
        jobs = {pool.submit(_row, ring, poles, float(p), nu.tolist(), duration, rtol): k for k, p in enumerate(P)}
        for job in as_completed(jobs):
            rows[jobs[job]] = job.result()
            advance()
    stable = stability_map(ring, poles, P, nu)["stable_points"].values
    rows = [
        [_checked(cell, n) for cell, n in zip(row, points, strict=True)]
        for row, points in zip(rows, stable, strict=True)
    ]
    over = ("power", "detuning")
    columns = {name: [[getattr(cell, name) for cell in row] for row in rows] for name in _Cell._fields}
    variables: dict[str, Any] = {
        name: (over, np.array(columns[name]), dataset.describe(name)) for name in ("regime", "period", "duty", "swing")
    }
    variables["reason"] = (over, np.array(columns["reason"]), {"units": "1", "long_name": "why, in words"})
    attrs = provenance("pulsing map", ring, poles) | {"duration": float(duration), "rtol": float(rtol)}
    return xr.Dataset(variables, coords=axes_of(P, nu), attrs=attrs)


def overlap(first: xr.Dataset, second: xr.Dataset) -> float:
    """Return the fraction of points at which two maps agree on whether the ring pulses.

    Parameters
    ----------
    first, second : xarray.Dataset
        from `pulsing_map`, `stability_map` or a measurement: regime over equal powers and detunings. Points that
        failed in either do not count.

    Raises
    ------
    InputError
        no regime, different points, or no point left to compare.

    Source: Borghi et al., Opt. Express 29, 4363 (2021), Section 4, which compares simulated and measured maps so.
    """
    for name, data in (("first", first), ("second", second)):
        if "regime" not in getattr(data, "variables", {}):
            raise checks.InputError(f"{name} has no variable 'regime'; give maps from pulsing_map or stability_map")
    for axis in ("power", "detuning"):
        a, b = first[axis].values, second[axis].values
        if a.shape != b.shape or not np.allclose(a, b, rtol=1e-9, atol=1e-3 if axis == "detuning" else 0):
            raise checks.InputError(f"the maps have different points along {axis}; compute them on the same axes")
    one, other = first["regime"].values, second["regime"].values
    known = (one != FAILED) & (other != FAILED)
    if not known.any():
        raise checks.InputError("every point failed in one of the maps; their variable 'reason' says why")
    return float(np.mean((one == "self-pulsing")[known] == (other == "self-pulsing")[known]))


def _row(
    ring: RingResonator, model: Foster, power: float, detunings: list[float], duration: float, rtol: float
) -> list[_Cell]:
    """All points of one power."""
    return [_cell(ring, model, power, detuning, duration, rtol) for detuning in detunings]


def _cell(ring: RingResonator, model: Foster, power: float, detuning: float, duration: float, rtol: float) -> _Cell:
    """One point; whatever stops it becomes its reason."""
    try:
        found = pulsing(simulate(ring, model, power=power, detuning=detuning, duration=duration, rtol=rtol))
    except (checks.InputError, RuntimeError) as error:
        return _Cell(FAILED, float("nan"), float("nan"), float("nan"), str(error))
    return _Cell(str(found.regime), found.period, found.duty, found.swing, found.reason)


def _checked(cell: _Cell, stable_points: int) -> _Cell:
    """The cell, unless its trace seems to come to rest where no fixed point is stable."""
    if cell.regime != Regime.STABLE or stable_points:
        return cell
    return cell._replace(regime=str(Regime.SLOW_TRANSIENT), reason=f"{cell.reason}, but no fixed point is stable")


@contextmanager
def _pool(executor: Executor | None) -> Iterator[Executor]:
    """The caller's executor, left open, or threads of our own."""
    if executor is not None:
        yield executor
        return
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # the integration releases the interpreter's lock
        yield pool


@contextmanager
def _bar(total: int, progress: bool) -> Iterator[Any]:
    """A function to call after each row, which moves a bar where one is wanted."""
    if not progress:
        yield lambda: None
        return
    from rich.progress import Progress

    with Progress() as bar:
        task = bar.add_task("map", total=total)
        yield lambda: bar.advance(task)
