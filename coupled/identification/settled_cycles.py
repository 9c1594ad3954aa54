"""Period and harmonics of a trace's second half, and of free runs of a model, with what the noise leaves open."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from thermofem.arrays import Array
from thermofem.errors import InputError

from ..contradictions import without_origin
from ..resonator import RingResonator
from ..runs.pulsing import Regime, crossings, pulsing
from ..runs.repetition import LONGEST_PATTERN, miss
from ..runs.simulate import simulate
from ..thermal import Compact
from ..unknowns import Unknowns
from .cycles import HARMONICS, Cycle, cycle_of, lag
from .forced_filters import noise_of
from .levenberg import Residuals
from .matching import Target

if TYPE_CHECKING:
    import xarray as xr

EARLY, LATE = 5e-9, 1e-9  # s between samples of a free run in its first and second half, or
MOST = 50_000  # so many samples in a half
RTOL = 1e-5
HIDDEN = 0.06  # of the mean: a swing that the noise of a trace at rest may hide
RESTS = 3.0  # a model at rest counts as one of so many periods of the trace
REPEATS = 0.03  # relative change of heights and lengths of pulses that repeat


class Stage(NamedTuple):
    """Harmonics that count, floors of the deviations of period (relative) and shape (of the swing), and most steps."""

    harmonics: int
    period: float
    shape: float
    steps: int


STAGES = (
    Stage(6, 1e-2, 2e-2, 12),
    Stage(HARMONICS, 5e-3, 1e-2, 10),
    Stage(HARMONICS, 1e-3, 2e-3, 10),
    Stage(HARMONICS, 3e-5, 2e-4, 12),
)
SOFT = Stage(HARMONICS, 1e-2, 4e-2, 20)  # of a law that cannot follow the traces


class Seen(NamedTuple):
    """The cycle of a trace; standard deviations of its ln(period) and of the parts of its harmonics, shape (33,)."""

    cycle: Cycle
    period_deviation: float
    deviations: Array


def seen(target: Target) -> Seen:
    """Period and harmonics of the second half by least squares on its samples: no lines between them.

    drop = Re sum_k c_k exp(2 pi i k (t - t_0)/T), with more harmonics in each step of Gauss-Newton for ln T.
    """
    t, drop, T = target.times, target.drop, target.observed.mean().period
    late = t >= (t[0] + t[-1]) / 2
    every = -(-int(late.sum()) // MOST)  # samples of long traces are averaged
    t, drop = (x[late][: late.sum() // every * every].reshape(-1, every).mean(axis=1) for x in (t, drop))
    t = t - t[0]
    if not np.isfinite(T):
        still = np.zeros(HARMONICS + 1, dtype=complex)
        still[0] = drop.mean()
        own = max(float(drop.std()), noise_of(target.drop))
        return Seen(Cycle(np.nan, still), np.nan, np.full(HARMONICS + 1, own * np.sqrt(2 / drop.size)))
    most = min(HARMONICS, max(1, t.size // 4 - 1), max(1, int(0.5 * T * (t.size - 1) / t[-1])))
    for K in (4, 12, HARMONICS, HARMONICS, HARMONICS):
        k = np.arange(1, min(K, most) + 1)
        w = np.exp(2j * np.pi * np.outer(t / T, k))
        A = np.hstack([np.ones((t.size, 1)), w.real, -w.imag])
        c = np.linalg.lstsq(A, drop, rcond=None)[0]
        z = c[1 : 1 + k.size] + 1j * c[1 + k.size :]
        turning = (1j * (w * k) @ z).real * (-2 * np.pi * t / T)  # d drop/d ln T
        B = np.column_stack([A, turning])
        left = drop - A @ c
        T *= float(np.exp(np.clip(np.linalg.lstsq(B, left, rcond=None)[0][-1], -0.02, 0.02)))
    s = np.sqrt(left @ left / max(t.size - B.shape[1], 1))
    harmonics, deviations = np.zeros(HARMONICS + 1, dtype=complex), np.full(HARMONICS + 1, np.inf)
    harmonics[: k.size + 1], deviations[: k.size + 1] = np.append(c[0], z), s * np.sqrt(2 / t.size)
    return Seen(Cycle(T, harmonics), float(s * np.sqrt(np.linalg.pinv(B.T @ B)[-1, -1])), deviations)


def free_run(ring: RingResonator, model: Compact, target: Target) -> tuple[xr.Dataset, Cycle]:
    """The run of a model under the drive of a trace, and its cycle in the half that is compared."""
    begin, end = target.window(model)
    middle = (begin + end) / 2
    early, late = max(EARLY, middle / MOST), max(LATE, (end - middle) / MOST)
    times = np.concatenate([np.arange(0.0, middle, early), np.arange(middle + late, end, late)])
    run = simulate(
        ring, without_origin(model), power=target.power, detuning=target.detuning, duration=end, times=times,
        rtol=RTOL,
    )  # fmt: skip
    return run, cycle_of(run, at=np.linspace(begin, end, int((end - begin) / late)), near=target.observed.clock)


def repeats(run: xr.Dataset) -> bool:
    """Whether the pulses of a run repeat; a run at rest does."""
    return pulsing(run).regime != Regime.SELF_PULSING or repeat_within(run["time"].values, run["carriers"].values)


def repeat_within(t: Array, N: Array) -> bool:
    """Whether the last pulses of the carriers repeat in height and distance, up to four of them together."""
    late = t >= t[-1] / 2
    edges = crossings(t, N, (N[late].min() + N[late].max()) / 2)
    heights = np.array([N[i:j].max() for i, j in pairwise(np.searchsorted(t, edges))])
    return min(miss(heights, np.diff(edges), k) for k in range(1, LONGEST_PATTERN + 1)) < REPEATS


def compared(own: Cycle, aim: Seen, stage: Stage, absolute: bool) -> tuple[Array, Cycle]:
    """Residuals over their deviations, shape (66,), and the model's cycle aligned in phase, and scale.

    ln(T_model/T) over hypot(its deviation, floor), then the differences of the mean and of the harmonics' parts over
    hypot(theirs, floor of the swing).
    """
    trace, K = aim.cycle, np.arange(HARMONICS + 1) <= stage.harmonics
    both = np.isfinite([own.period, trace.period])
    aligned = own.shifted(lag(own.harmonics, trace.harmonics)) if both.all() else own
    if not absolute:
        h = aligned.harmonics if both[1] else aligned.harmonics[:1]
        factor = float(np.vdot(h, trace.harmonics[: h.size]).real / np.vdot(h, h).real)
        aligned = Cycle(aligned.period, factor * aligned.harmonics)
    off = (aligned.harmonics - trace.harmonics) * K
    level = abs(trace.harmonics[0])
    if both[1]:
        period = own.period if both[0] else RESTS * trace.period
        drift = np.log(period / trace.period) / np.hypot(aim.period_deviation, stage.period)
        scale = np.hypot(aim.deviations, stage.shape * trace.swing)
        mean = np.hypot(aim.deviations[0] / np.sqrt(2), stage.shape * trace.swing)
    else:
        drift, scale, mean = 0.0, np.full(K.size, HIDDEN * level), np.hypot(aim.deviations[0], stage.shape * level)
    parts = off[1:] / scale[1:]
    return np.concatenate([[drift, off[0].real / mean], parts.real, parts.imag]), aligned


def cycle_residuals(what: Unknowns, targets: list[Target], aims: list[Seen]) -> Callable[[Stage], Residuals]:
    """The residuals of all traces as a function of the logarithms, for each stage."""

    def of(x: Array, stage: Stage) -> Array | None:
        rows = []
        try:
            ring, model = what.build(x)
            for target, aim in zip(targets, aims, strict=True):
                own = free_run(ring, model, target)[1]
                rows.append(compared(own, aim, stage, target.observed.absolute)[0])
        except (InputError, RuntimeError):
            return None
        return np.concatenate(rows)

    return lambda stage: lambda x: of(x, stage)
