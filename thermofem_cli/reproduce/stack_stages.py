"""Layer stacks, not stated in the paper, that explain all its statements on self-pulsing at once."""

from __future__ import annotations

import numpy as np
import xarray as xr

import coupled
import surrogate
from coupled.parameters import borghi2021 as paper
from surrogate.family.interpolation import smooth
from thermofem import checks
from thermofem.arrays import Array, NDArray
from thermofem.campaign import Campaign, Variation
from thermofem.data.dataset import build
from thermofem.geometry import strip_ring
from thermofem.models import Foster, OutputMap
from thermofem.waveforms import Waveform

from .pulsing_stages import heat_of_the_pair
from .settings import CENTRE, watts
from .stages import Job
from .store import Result

CORE = 0.22e-6  # m; the cladding is measured from its bottom
VARIED = (
    Variation("box", ("layer.box.thickness",), "m", low=1e-6, high=4e-6),
    Variation("oxide", ("layer.cladding.thickness",), "m", low=CORE + 0.5e-6, high=CORE + 4e-6),
    Variation("conductivity", ("material.SiO2.conductivity",), "W/m/K", low=0.9, high=1.5),
)
PLANE = ((5.0, 0.0), (7.0, -10.0), CENTRE, (8.0, 20.0), (10.0, 10.0))  # dBm, GHz
STATED = {  # what the paper says: within the rounding of its words, and 5 % for the pair fitted to one trace
    "period": (0.75e-6, 0.85e-6),  # s, at (8 dBm, 0 GHz)
    "swing": (5.5, 6.5),  # K, there
    "frequency": (0.7e6, 1.4e6),  # Hz, median over the plane
    "tau_th": (0.95 * 417e-9, 1.05 * 417e-9),  # s, of Newton's law fitted to the heat of a cycle
    "heat_capacity": (0.95 * 6.9, 1.05 * 6.9),  # times that of the core's silicon
}
UNITS = {"period": "s", "swing": "K", "frequency": "Hz", "tau_th": "s", "heat_capacity": "1"}
FIRST, REFINED, GRID = 20, 5, 17
WIDER = 1.2  # times the worst statement of the best stack, up to which others count as nearly as good


def explained(job: Job) -> Result:
    """Members of a family over both oxides and their conductivity, and how far each is from the statements.

    Every quantity is interpolated between `FIRST` members drawn at random and `REFINED` members where the interpolation
    has the nearest stack; "left" is its rms error at those before they were added, relative. The nearest stack is one
    that was worked out. Without gmsh there are no numbers.
    """
    campaign = Campaign(strip_ring().to_toml(), VARIED, samples=1)
    try:
        family = surrogate.train_family(campaign, tolerance=5e-3, held_out=4)
    except checks.MissingLibraryError as error:
        return Result({"reason": str(error)})
    wave, samples = heat_of_the_pair(job.settings.cycle)
    low, high = np.array(list(STATED.values())).T
    axes = [np.linspace(v.low, v.high, GRID) for v in VARIED]
    unit = np.stack(np.meshgrid(*[np.linspace(0, 1, GRID)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    shares = (family.box.draw(FIRST, seed=1) - family.box.low) / (family.box.high - family.box.low)
    table, off = np.empty((0, len(STATED))), []
    for k in range(FIRST + REFINED):
        if k >= FIRST:  # where the interpolation has the nearest stack, or the next one after those that are there
            values, worst = _everywhere(shares, table, unit)
            known = (unit[:, None] == shares[None]).all(axis=2).any(axis=1)
            best = int(np.argmin(np.where(known, np.inf, worst)))
            shares = np.vstack([shares, unit[best]])
        row = family.box.low + shares[k] * (family.box.high - family.box.low)
        seen = _quantities(family.at(dict(zip(family.names, map(float, row), strict=True))), wave, samples)
        if k >= FIRST:
            off.append(values[best] / seen - 1)
        table = np.vstack([table, seen])
        job.done((k + 1) / (FIRST + REFINED))
    there = ~np.isnan(table).any(axis=1)
    values, worst = _everywhere(shares, table, unit)
    holds = (values >= low) & (values <= high)
    numbers = {
        "error": float(family.error),
        "members": int(there.sum()),
        "left": dict(zip(STATED, np.sqrt(np.nanmean(np.square(off), axis=0)).tolist(), strict=True)),
        "share": dict(zip(STATED, holds.mean(axis=0).tolist(), strict=True)),
        "share_all": float(holds.all(axis=1).mean()),
        "nearly": _region((worst <= WIDER * worst.min()).reshape(GRID, GRID, GRID), axes),
        "nearest": _nearest(table[there], shares[there]),
    }
    over, cube = tuple(v.name for v in VARIED), (GRID, GRID, GRID)
    about = {"units": "1", "long_name": "worst statement, in halves of its range"}
    data = {"worst": (over, worst.reshape(cube), about)}
    names = {name: (over, values[:, k].reshape(cube), {"units": UNITS[name]}) for k, name in enumerate(STATED)}
    coords = {v.name: (v.name, axis, {"units": v.unit}) for v, axis in zip(VARIED, axes, strict=True)}
    return Result(numbers, {"stacks": xr.Dataset({**data, **names}, coords=coords)})


def _everywhere(shares: Array, table: Array, unit: Array) -> tuple[Array, Array]:
    """All quantities interpolated at points of the unit cube, and how far the worst one is from its range's middle."""
    there = ~np.isnan(table).any(axis=1)
    values = np.column_stack([smooth(shares[there], column)(unit) for column in table[there].T])
    return values, _worst(values)


def _worst(values: Array) -> Array:
    """Distance of the worst statement from the middle of its range, in halves of the range, shape (n,)."""
    low, high = np.array(list(STATED.values())).T
    return np.asarray(np.abs((values - (low + high) / 2) / ((high - low) / 2)).max(axis=-1))


def _quantities(model: Foster | OutputMap, wave: Waveform, samples: int) -> list[float]:
    """The quantities of the paper's statements for one stack; nan where the ring rests at the centre of the plane."""
    ring, cycles = coupled.borghi2021(), {}
    for point in PLANE:
        try:
            found = coupled.limit_cycle(ring, model, power=watts(point[0]), detuning=point[1] * 1e9)
            cycles[point] = found.attrs["period"], found.attrs["swing"]
        except checks.InputError:
            continue
    period, swing = cycles.get(CENTRE, (np.nan, np.nan))
    frequency = float(np.median([1 / one for one, _ in cycles.values()])) if cycles else np.nan
    times = np.linspace(0, wave.period or 0.0, samples)
    data = build(times, model.periodic_response(wave, samples), wave, periodic=True)
    pair = surrogate.fit_newton(data).parameters
    return [period, swing, frequency, pair["tau_th"], pair["heat_capacity"] / paper.HEAT_CAPACITY]


def _region(inside: NDArray[np.bool_], axes: list[Array]) -> dict[str, list[float]]:
    """Both ends of every parameter over some stacks, the oxide above the core."""
    found = {}
    for k, v in enumerate(VARIED):
        along = axes[k][inside.any(axis=tuple(m for m in range(3) if m != k))] - (CORE if v.name == "oxide" else 0.0)
        found[v.name] = [float(along.min()), float(along.max())]
    return found


def _nearest(table: Array, shares: Array) -> dict[str, float]:
    """Of the stacks that were worked out, the one whose worst statement is nearest to the middle of its range."""
    worst = _worst(table)
    k = int(worst.argmin())
    stack = {v.name: float(v.low + share * (v.high - v.low)) for v, share in zip(VARIED, shares[k], strict=True)}
    stack["oxide"] -= CORE
    return {**stack, "worst": float(worst[k]), **dict(zip(STATED, table[k].tolist(), strict=True))}
