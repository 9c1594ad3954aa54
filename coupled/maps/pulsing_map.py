"""Maps of self-pulsing over power and detuning by integration, and how far two maps agree."""

import contextlib
import json
import math
import operator
import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from thermofem import InputError, checks
from thermofem.arrays import Array
from thermofem.campaign.stored_tasks import WorkerDiedError, completed
from thermofem.checks import Words
from thermofem.data import dataset, files
from thermofem.data.variables import in_si
from thermofem.models import ThermalModel

from ..equilibria.steady_states import Fixed
from ..heaters import warmed
from ..inputs import bar, check_duration
from ..kernel.units import FJ, NS
from ..resonator import RingResonator
from ..runs.pulsing import FEWEST, Pulsing, Regime, Rest, classify, lasting
from ..runs.window import Window, advance
from ..states import State
from ..thermal import Compact, Heaters, long_enough, provenance, trusted
from .cycle_map import Cell, settled_row
from .stability_map import Point, fixed_of, grid_of

FAILED = "failed"
VERSION = 3  # of the lines of a file of a map: [row, cells, hash]
REGIMES = {FAILED, "bistable", *map(str, Regime)}


class Follow(Words):
    """Direction in which the laser is stepped along the second axis; each point starts at the previous one's end."""

    UP = "up"
    DOWN = "down"


def pulsing_map(
    ring: RingResonator,
    model: ThermalModel,
    powers: ArrayLike,
    detunings: ArrayLike,
    *,
    vary: Mapping[str, ArrayLike] | None = None,
    heaters: Heaters = None,
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
        the ring has no two-photon absorption: settled cycles are detected by their carriers.
    duration : float, s, optional
        of the traces, where they are not settled; 20 us by default.
    rtol : float
        of `simulate`, for traces. At 1e-5 errors of the steps count two cycles as one in one cell of 600.
    follow : "up" or "down", optional
        start each point of the second axis from the end state of its lower or upper neighbour, as if the laser were
        stepped; the two maps differ where there is hysteresis. By default every point begins cold.
    file : path, optional
        stores each row (of the first axis) when it is finished. An interrupted map continues from it; a file of
        another map is refused.
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
    to rest next to an unstable fixed point is classified as "slow transient", with the reason.

    Source: Borghi et al., Opt. Express 29, 4363 (2021), Figs. 4 and 6; cold start, as the paper's shutter does.
    """
    warm = warmed(ring, model, heaters, heated, read)
    small = warm.model
    grid = grid_of(ring, powers, detunings, vary, warm)
    settled = _settled(settled, ring, traces=not (duration is None and follow is None))
    duration = check_duration(20e-6 if duration is None else duration)
    rtol = checks.between("rtol", rtol, 1e-13, 1e-3, hint="1e-6 gives periods to 2e-4")
    order = None if follow is None else Follow(follow)
    attrs = provenance("pulsing map", ring, small) | {"settled": int(settled), **grid.fixed, **warm.of_heaters}
    if not settled:
        attrs |= {"duration": float(duration), "rtol": float(rtol)}
    if order is not None:
        attrs["follow"] = str(order)
    identity = attrs | {f"axis {name}": axis for name, axis in zip(grid.names, grid.axes, strict=True)}
    identity["model"] = small.to_json()
    pool = contextlib.nullcontext(executor) if executor else ThreadPoolExecutor(os.cpu_count())
    with (
        pool as workers,  # the integration releases the interpreter's lock
        bar("map", len(grid.rows), show_bar) as moved,
        stored_rows(file, identity) as (done, store),
    ):
        open_rows = [k for k in range(len(grid.rows)) if k not in done]
        for _ in done:
            moved()
        watch = np.zeros(1)  # above 0 where the rows are to end
        work = settled_row if settled else partial(_row, duration=duration, rtol=rtol, follow=order)
        points = [point for k in open_rows for point in grid.rows[k]]
        fixed = iter(fixed_of(small, points))
        jobs: dict[partial[list[Cell]], int] = {}
        for k in open_rows:
            row = grid.rows[k]
            jobs[partial(work, small, row, list(islice(fixed, len(row))), watch)] = k
        try:
            with contextlib.closing(completed(operator.call, jobs, executor=workers)) as finished:
                for job, result in finished:
                    try:
                        store(jobs[job], result.result())
                    except WorkerDiedError as error:
                        done[jobs[job]] = [Cell(FAILED, reason=str(error))] * len(grid.axes[1])
                    moved()
        finally:  # after Ctrl-C or an error: what runs in threads ends at once, in processes with its row
            watch[0] = 1.0
    rows = [done[k] for k in range(len(grid.rows))]
    slow = any(cell.regime == Regime.SLOW_TRANSIENT for row in rows for cell in row)
    if slow and not settled and long_enough(small) > duration:
        attrs["suggested_duration"] = long_enough(small)
    columns = {name: np.array([[getattr(cell, name) for cell in row] for row in rows]) for name in Cell._fields}
    trusted(model, columns.pop("rise"))
    return xr.Dataset(dataset.variables(grid.names, columns), grid.coordinates(), {**attrs, **warm.doubts})


def _settled(settled: bool | None, ring: RingResonator, *, traces: bool) -> bool:
    """Return whether a map is of settled cycles, as ``settled`` says or by default. InputError: it cannot be.

    traces: whether a duration or a direction is given, which only traces have.
    """
    if settled is None:
        return not traces and ring.g_tpa > 0
    if checks.flag("settled", settled) and traces:
        raise InputError("settled=True goes with neither duration nor follow, which belong to traces")
    if settled and not ring.g_tpa > 0:
        raise InputError(
            "ring has no two-photon absorption and so no free carriers, by which a map follows settled cycles; give a "
            "duration for a map of traces"
        )
    return settled


def overlap(first: xr.Dataset, second: xr.Dataset) -> float:
    """Return the fraction of points at which two maps agree on whether the ring pulses.

    Parameters
    ----------
    first, second : xarray.Dataset
        from `pulsing_map`, `stability_map` or a measurement: regime over equal powers and detunings. Points that
        failed in either do not count; nan where none is left.

    Raises
    ------
    InputError
        different points, or a regime by another name.

    Source: Borghi et al., Opt. Express 29, 4363 (2021), Section 4, which compares simulated and measured maps so.
    """
    first = in_si("first", first)
    second = in_si("second", second)
    one = first["regime"]
    other = second["regime"]
    for axis in one.dims:
        a = one[axis].values
        b = other[axis].values if axis in other.dims else np.empty(0)
        tolerance = 1e-3 if axis == "detuning" else 0
        if a.shape != b.shape or not np.allclose(a, b, rtol=1e-9, atol=tolerance):
            raise InputError(f"the maps have different points along {axis}; compute them on the same axes")
    for name, regimes in (("first", one), ("second", other)):
        for word in np.unique(regimes):
            checks.choice(f"a regime of {name}", str(word), REGIMES)
    agree = (one == "self-pulsing") == (other == "self-pulsing")
    computed = (one != FAILED) & (other != FAILED)
    return float(np.mean(agree.values[computed.values]))


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
) -> tuple[Pulsing, Window]:
    """Return the result of ``pulsing(simulate(...))`` at constant power (W) and detuning (Hz), and the trace.

    The arguments are not checked, and no Dataset is made.

    rest: the fixed points; a trace that ends near an unstable one is not classified as stable.
    watch: another thread sets its first entry above 0 to stop the integration by KeyboardInterrupt.
    """

    def look(_: float) -> None:
        if watch is not None and watch[0] > 0:
            raise KeyboardInterrupt

    run = advance(ring, model, initial, 0.0, duration, power=power, detuning=detuning, rtol=rtol, progress=look)
    checks.enough("run", run.time.size, FEWEST)
    energy = np.abs(run.fields[0]) ** 2
    result = classify(run.time, run.carriers, energy, run.delta_T, rtol=rtol, every_step=True)
    if result.regime == Regime.STABLE:
        result = lasting(result, run.time, energy, run.delta_T, rest)
    return result, run


def _row(
    model: Compact, points: list[Point], fixed: list[Fixed | str], watch: Array, duration: float, rtol: float,
    follow: Follow | None,
) -> list[Cell]:  # fmt: skip
    """Return the `Cell` of each point of a row, by integration from cold or (``follow``) from its neighbour's end."""
    cells: list[Cell] = []
    state = cold = State.cold(model.order)
    pairs = list(zip(points, fixed, strict=True))
    downwards = follow == Follow.DOWN
    if downwards:
        pairs.reverse()
    for (ring, power, detuning), points_there in pairs:
        rest = _rest(points_there)
        try:
            result, run = pulse(
                ring, model, power=power, detuning=detuning, duration=duration, rtol=rtol, initial=state, rest=rest,
                watch=watch,
            )  # fmt: skip
            end = run.final
            rise = float(run.delta_T.max())
            if rest is not None:
                rise = float(np.max(rest.delta_T, initial=rise))
            cells.append(Cell(result.regime, result.period, result.duty, result.swing, result.reason, rise))
        except (InputError, RuntimeError) as error:
            cells.append(Cell(FAILED, reason=str(error)))
            end = cold
        state = cold if follow is None else end
    return cells[::-1] if downwards else cells


def _rest(fixed: Fixed | str) -> Rest | None:
    """Return the fixed points of a map's point in SI; None where they could not be computed."""
    if isinstance(fixed, str):
        return None
    return Rest(fixed.every[:, 0] * FJ, fixed.every[:, 2], fixed.growth / NS)


@contextlib.contextmanager
def stored_rows(
    file: str | Path | None, identity: dict[str, Any]
) -> Iterator[tuple[dict[int, list[Cell]], Callable[[int, list[Cell]], None]]]:
    """Lock the file of a map; yield its finished rows by number, and a function that adds a row to them and to it.

    The file has one JSON line that identifies the map, then one for each finished row with its hash, in the order of
    completion. A damaged line, as an interrupted run leaves it, is ignored: its row is computed again.

    identity: everything that the rows depend on.
    Raises InputError: the file is of another map, or of something else (it is not changed); it cannot be read or
        written.
    """
    rows: dict[int, list[Cell]] = {}
    if file is None:
        yield rows, rows.__setitem__
        return
    path = checks.path("file", file)
    head = json.dumps({"journal": VERSION, **files.plain(identity)}, sort_keys=True)

    def store(row: int, cells: list[Cell]) -> None:
        rows[row] = cells
        content = [row, files.plain(cells)]
        line = json.dumps([*content, files.digest_tree(content)[:16]])
        with (
            checks.prefixed(f"{path} cannot be written", OSError, hint="what it holds so far is kept"),
            path.open("a", encoding="utf-8") as stream,
        ):
            stream.write(f"{line}\n")

    with files.locked(path.with_name(f".{path.name}.lock"), str(path)):
        text = files.read_bytes(path, "map").decode(errors="replace") if os.path.lexists(path) else ""
        first, *lines = text.splitlines() or [""]
        cut_off = not lines and head.startswith(text)  # by a kill, or a new file
        if first != head and not cut_off:
            raise InputError(
                f"{path} holds no rows of this map (different: {_differing(first, head)}); give another file name"
            )
        sound = [head]
        for line in lines:
            row = _parsed(line)
            if isinstance(row, list) and len(row) == 3 and row[2] == files.digest_tree(row[:2])[:16]:
                number, cells, _ = row
                rows[number] = [Cell._make(math.nan if value is None else value for value in cell) for cell in cells]
                sound.append(line)
        whole = "".join(f"{line}\n" for line in sound)
        if text != whole:
            files.write_whole(path, lambda temporary: temporary.write_text(whole, encoding="utf-8"))
        yield rows, store


def _differing(first: str, head: str) -> str:
    """Names of what differs between the first line of a file and that of a map."""
    parsed = _parsed(first)
    stored = parsed if isinstance(parsed, dict) else {}
    expected = json.loads(head)
    return ", ".join(sorted(key for key in {*stored, *expected} if stored.get(key) != expected.get(key)))


def _parsed(line: str) -> Any:
    """Return the content of a JSON line, None where it is not valid JSON."""
    with contextlib.suppress(InputError):
        return files.from_json(line)
    return None
