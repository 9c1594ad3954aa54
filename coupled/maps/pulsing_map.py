"""Maps of self-pulsing over power and detuning by integration, and how far two maps agree."""

import os
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from thermofem import Quadratic, checks
from thermofem.arrays import Array
from thermofem.checks import Words
from thermofem.data import dataset
from thermofem.data.variables import in_si
from thermofem.models import ThermalModel

from ..arguments import bar, check_duration
from ..contradictions import check_geometry
from ..heaters import constant
from ..kernel.tableaus import Method
from ..kernel.units import DENSITY, FJ, NS, single_ring, units
from ..resonator import RingResonator
from ..runs.pulsing import Pulsing, Regime, classify, lasting
from ..runs.resting import Rest
from ..states import State
from ..thermal import Compact, long_enough, provenance
from .grid import Fixed, Grid, Point, fixed_of, grid_of, trusted_map
from .journal import Journal
from .settled import Cell, settled_row

FAILED = "failed"
REGIMES = {FAILED, "bistable", *map(str, Regime)}


class Follow(Words):
    """Which way a laser is stepped along the second axis of a map, each point from where the last one ended."""

    UP = "up"
    DOWN = "down"


def pulsing_map(
    ring: RingResonator,
    model: ThermalModel,
    powers: ArrayLike,
    detunings: ArrayLike,
    *,
    vary: Mapping[str, ArrayLike] | None = None,
    heaters: Mapping[str, float] | None = None,
    heated: str | None = None,
    read: str | None = None,
    settled: bool | None = None,
    duration: float | None = None,
    rtol: float = 1e-6,
    follow: Follow | str | None = None,
    file: str | Path | None = None,
    executor: Executor | None = None,
    show_bar: bool = False,
) -> xr.Dataset:
    """Return what the ring does at every point of a map: the settled cycle, or what a transient from cold shows.

    By default every point has the numbers of the cycle that the ring settles on from cold, as `limit_cycle` finds it,
    on coarser meshes. Of 403 random points (70 rings, heat up to 60 us) 99 % have a period within 5e-8 of that of
    `limit_cycle`, the worst 3e-7.
    With ``settled=False``, or where a duration is given, a trace of that length is integrated and classified instead:
    `simulate` and `pulsing` for each, as an experiment with a shutter sees it.

    Parameters
    ----------
    ring : RingResonator
    model : ThermalModel
        as for `simulate`.
    powers : array, shape (n,), W
        in the bus waveguide, larger than 0, increasing.
    detunings : array, shape (m,), Hz
        laser minus cold resonance, increasing.
    vary : mapping of str to array, optional
        other axes: numbers of the ring or its carriers, as `identify` names them. A map has two axes, so with one here
        give the power or the detuning as one number, with two both.
    heaters : mapping of name to float, W, optional
        constant power in further inputs of a linear model, on for long before the laser; as for `simulate`, and so are
        ``heated`` and ``read``.
    settled : bool, optional
        whether the numbers are those of settled cycles; by default True unless ``duration`` or ``follow`` is given, or
        the ring has no two-photon absorption: settled cycles are told by their carriers.
    duration : float, s, optional
        of the traces, where they are not settled; 20 us by default.
    rtol : float
        of `simulate`, for traces. At 1e-5 errors of the steps count two cycles as one in one cell of 600.
    follow : "up" or "down", optional
        begin each point of the second axis where the one before, or after, ended, as a laser does that is stepped up or
        down; the two maps differ where there is hysteresis. By default every point begins cold.
    file : path, optional
        fills up with the rows (of the first axis) as they are done. A map that was interrupted, however, goes on from
        it; a file of another map is refused.
    executor : concurrent.futures.Executor, optional
        takes one row at a time; by default one thread for each processor.
    show_bar : bool
        whether to draw a bar on the terminal.

    Returns
    -------
    xarray.Dataset
        over power (W) and detuning (Hz), or the axes given: regime ("self-pulsing", "stable", "slow transient" or
        "failed"), period (s, nan unless it pulses), duty, swing (K) and reason, in words; a point that cannot be
        integrated says why there. ``attrs["settled"]`` is 1 or 0. ``attrs["suggested_duration"]`` (s) is there where
        points of a map of traces are slow transients and the runs were short for the model's heat.

    Raises
    ------
    InputError
        a power or detuning out of range or not increasing, a duration or rtol out of range, a model that cannot be
        integrated, an unknown name, not two axes, or a file of another map.

    Near a fold that has just vanished the first pulse can take longer than any duration chosen. So a trace that seems
    to rest next to a fixed point that is unstable reads "slow transient", with the reason.

    Source: Borghi et al., Opt. Express 29, 4363 (2021), Figs. 4 and 6; cold start, as the paper's shutter does.
    """
    warm = constant(model, heaters, heated, read)
    small, grid = warm.model, grid_of(ring, powers, detunings, vary).warmed(warm)
    doubts = check_geometry(ring, model)
    if settled is None:
        settled = duration is None and follow is None and ring.g_tpa > 0
    elif checks.flag("settled", settled) and not (duration is None and follow is None):
        raise checks.InputError("settled=True goes with neither duration nor follow, which belong to traces")
    elif settled and not ring.g_tpa > 0:
        raise checks.InputError(
            "ring has no two-photon absorption and so no free carriers, by which a map follows settled cycles; give a "
            "duration for a map of traces"
        )
    duration = check_duration(20e-6 if duration is None else duration)
    rtol = checks.between("rtol", rtol, 1e-13, 1e-3, hint="1e-6 gives periods to 2e-4")
    order = None if follow is None else Follow(checks.choice("follow", str(follow), [str(way) for way in Follow]))
    attrs = provenance("pulsing map", ring, small) | {"settled": int(settled), **grid.fixed, **warm.attributes}
    if not settled:
        attrs |= {"duration": float(duration), "rtol": float(rtol)}
    if order is not None:
        attrs["follow"] = str(order)
    journal = Journal(file, _identity(attrs, grid, small))
    left = [k for k in range(len(grid.rows)) if k not in journal.rows]
    with _pool(executor) as pool, bar("map", len(grid.rows), show_bar) as advance, journal:
        for _ in journal.rows:
            advance()
        watches = np.zeros((len(grid.rows), 1))  # above 0 where a row is to end
        fixed = fixed_of(small, [point for k in left for point in grid.rows[k]])
        jobs = {}
        for n, k in enumerate(left):
            row = grid.rows[k]
            own = fixed[n * len(row) : (n + 1) * len(row)]
            way = (settled_row,) if settled else (_row, float(duration), float(rtol), order)
            jobs[pool.submit(way[0], small, row, own, watches[k], *way[1:])] = k
        try:
            for job in as_completed(jobs):
                journal.add(jobs[job], [list(cell) for cell in job.result()])
                advance()
        finally:  # after Ctrl-C or an error: what runs in threads ends at once, in processes with its row
            watches[:, 0] = 1.0
            for job in jobs:
                job.cancel()
    rows = [[Cell(*cell) for cell in journal.rows[k]] for k in range(len(grid.rows))]
    slow = any(cell.regime == Regime.SLOW_TRANSIENT for row in rows for cell in row)
    if slow and not settled and long_enough(small) > duration:
        attrs["suggested_duration"] = long_enough(small)
    columns = {name: [[getattr(cell, name) for cell in row] for row in rows] for name in Cell._fields}
    variables: dict[str, Any] = {
        name: (grid.names, np.array(columns[name]), dataset.describe(name))
        for name in ("regime", "period", "duty", "swing")
    }
    variables["reason"] = (grid.names, np.array(columns["reason"]), {"units": "1", "long_name": "why, in words"})
    pulses = np.array(columns["regime"]) == str(Regime.SELF_PULSING)
    trusted_map(model, small, grid, np.where(pulses, columns["swing"], np.nan))
    return xr.Dataset(variables, grid.coordinates(), attrs | doubts)


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
    first, second = in_si("first", first), in_si("second", second)
    if first["regime"].dims != second["regime"].dims:
        raise checks.InputError(f"the maps are over {first['regime'].dims} and {second['regime'].dims}")
    for axis in first["regime"].dims:
        a, b = first[axis].values, second[axis].values
        if a.shape != b.shape or not np.allclose(a, b, rtol=1e-9, atol=1e-3 if axis == "detuning" else 0):
            raise checks.InputError(f"the maps have different points along {axis}; compute them on the same axes")
    one, other = first["regime"].values, second["regime"].values
    for name, words in (("first", one), ("second", other)):
        if odd := sorted({str(word) for word in words.ravel()} - REGIMES):
            raise checks.InputError(f"{name} has the regime {odd[0]!r}; take {', '.join(sorted(REGIMES))}")
    known = (one != FAILED) & (other != FAILED)
    if not known.any():
        raise checks.InputError("every point failed in one of the maps; their variable 'reason' says why")
    return float(np.mean((one == "self-pulsing")[known] == (other == "self-pulsing")[known]))


def _identity(attrs: dict[str, Any], grid: Grid, model: Compact) -> dict[str, Any]:
    """Everything that the rows of a map depend on, as JSON."""
    numbers = {name: np.asarray(value).tolist() for name, value in attrs.items()}
    numbers |= {f"axis {name}": axis.tolist() for name, axis in zip(grid.names, grid.axes, strict=True)}
    if isinstance(model, Quadratic):
        numbers |= {f"model {name}": np.asarray(getattr(model, name)).tolist() for name in "AHGBC"}
    return numbers


def pulse(
    ring: RingResonator,
    model: Compact,
    *,
    power: float,
    detuning: float,
    duration: float,
    rtol: float,
    initial: State,
    rest: Rest | None = None,
    watch: Array | None = None,
) -> tuple[Pulsing, State]:
    """Return the result of ``pulsing(simulate(...))`` at constant power (W) and detuning (Hz), and the final state.

    The numbers are the same; without the Dataset a point takes two thirds of the time. The arguments are not checked.

    rest: the fixed points; a trace that ends near an unstable one is no rest.
    watch: its first entry is above 0 where another thread asks the integration to stop, by KeyboardInterrupt.
    """
    problem = single_ring(ring, model, power, detuning, duration, Method.RODAS4 if rtol >= 1e-6 else Method.RODAS5P)
    unit = units(problem.order)

    def look(_: float) -> None:
        if watch is not None and watch[0] > 0:
            raise KeyboardInterrupt

    run = problem.integrate(initial.as_array() / unit, rtol=rtol, progress=look)
    t, ar, ai, N, dT = np.ascontiguousarray(run.rows.T)
    checks.enough("run", t.size, 8)
    t, energy = t * NS, (ar * ar + ai * ai) * FJ
    found = classify(t, N * DENSITY, energy, dT, rtol=rtol, every_step=True)
    if found.regime == Regime.STABLE:
        found = lasting(found, t, energy, dT, rest)
    return found, State.from_array(run.y * unit)


def _row(
    model: Compact, points: list[Point], fixed: list[Fixed | str], watch: Array, duration: float, rtol: float,
    follow: Follow | None,
) -> list[Cell]:  # fmt: skip
    """All points of one row, each on its own or from where its neighbour ended; what stops one becomes its reason."""
    cells: list[Cell] = []
    state = cold = State.cold(model.order)
    pairs = list(zip(points, fixed, strict=True))
    for (ring, power, detuning), at in reversed(pairs) if follow == Follow.DOWN else pairs:
        rest = None if isinstance(at, str) else Rest(at.every[:, 0] * FJ, at.every[:, 2], at.growth / NS)
        try:
            found, end = pulse(
                ring, model, power=power, detuning=detuning, duration=duration, rtol=rtol, initial=state, rest=rest,
                watch=watch,
            )  # fmt: skip
            cells.append(Cell(str(found.regime), found.period, found.duty, found.swing, found.reason))
        except (checks.InputError, RuntimeError) as error:
            cells.append(Cell(FAILED, reason=str(error)))
            end = cold
        state = cold if follow is None else end
    return cells[::-1] if follow == Follow.DOWN else cells


@contextmanager
def _pool(executor: Executor | None) -> Iterator[Executor]:
    """The caller's executor, left open, or threads of our own."""
    if executor is not None:
        yield executor
        return
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # the integration releases the interpreter's lock
        yield pool
