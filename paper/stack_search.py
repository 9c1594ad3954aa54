"""Layer stacks, not stated in the paper, that explain all its statements on self-pulsing at once."""

import warnings

import numpy as np
import xarray as xr
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

import coupled
import surrogate
import thermofem as th
from thermofem.campaign import Variation
from thermofem.plot import BLUE, GREEN, INK, ORANGE, VERMILION

from .fig5 import CYCLE, heat_of_the_pair
from .printed import CENTRE, HEAT_CAPACITY, RING, at, legend_above, panel
from .report.study import Result, figure, study

CORE = 0.22e-6  # m; the cladding is measured from its bottom
VARIED = (
    Variation("box", ("layer.box.thickness",), "m", low=1e-6, high=4e-6),
    Variation("oxide", ("layer.cladding.thickness",), "m", low=CORE + 0.5e-6, high=CORE + 4e-6),
    Variation("conductivity", ("material.SiO2.conductivity",), "W/m/K", low=0.9, high=1.5),
)
PLANE = ((5.0, 0.0), (7.0, -10.0), CENTRE, (8.0, 20.0), (10.0, 10.0))  # dBm, GHz
STATED = {  # what the paper says: within the rounding of its words, and 5 % for the pair fitted to one trace
    "period": (0.75e-6, 0.85e-6, "s"),  # at (8 dBm, 0 GHz)
    "swing": (5.5, 6.5, "K"),  # there
    "frequency": (0.7e6, 1.4e6, "Hz"),  # median over the plane
    "tau_th": (0.95 * 417e-9, 1.05 * 417e-9, "s"),  # of Newton's law fitted to the heat of a cycle
    "heat_capacity": (0.95 * 6.9, 1.05 * 6.9, "1"),  # times that of the core's silicon
}
LOW, HIGH = np.array([ends[:2] for ends in STATED.values()]).T
FIRST, REFINED, GRID = 20, 5, 17
WIDER = 1.2  # times the worst statement of the best stack, up to which others count as nearly as good


@study("stacks that explain the experiment", 6)
def stacks_explained():
    """Members of a family over both oxides and their conductivity, and how far each is from the statements.

    Every quantity is interpolated between `FIRST` members drawn at random and `REFINED` members where the interpolation
    has the nearest stack, or the next one after those that are there. The nearest stack is one that was worked out.
    """
    campaign = th.Campaign(th.strip_ring().to_toml(), VARIED, samples=1)
    family = surrogate.train_family(campaign, tolerance=5e-3, held_out=4)
    wave, samples = heat_of_the_pair(), 2 * CYCLE
    axes = [np.linspace(v.low, v.high, GRID) for v in VARIED]
    low, span = (np.array(ends) for ends in zip(*((v.low, v.high - v.low) for v in VARIED), strict=True))
    unit = np.stack(np.meshgrid(*[np.linspace(0, 1, GRID)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    shares, table = (family.box.draw(FIRST, seed=1) - low) / span, []
    for k in range(FIRST + REFINED):
        if k >= FIRST:
            known = (unit[:, None] == shares[None]).all(axis=2).any(axis=1)
            best = np.argmin(np.where(known, np.inf, distance(everywhere(shares, np.array(table), unit))))
            shares = np.vstack([shares, unit[best]])
        member = family.at(dict(zip(family.names, map(float, low + shares[k] * span), strict=True)))
        table.append(quantities(member, wave, samples))
    table = np.array(table)
    values, there = everywhere(shares, table, unit), ~np.isnan(table).any(axis=1)
    worst, worked = distance(values), distance(table[there])
    k = int(worked.argmin())
    nearest = dict(zip([v.name for v in VARIED], low + shares[there][k] * span, strict=True))
    nearest |= {"oxide": nearest["oxide"] - CORE, **dict(zip(STATED, table[there][k], strict=True))}
    good, nearly = (worst <= WIDER * worst.min()).reshape(GRID, GRID, GRID), {}
    for m, v in enumerate(VARIED):
        along = axes[m][good.any(axis=tuple({0, 1, 2} - {m}))] - (CORE if v.name == "oxide" else 0.0)
        nearly[v.name] = [along.min(), along.max()]
    numbers = {
        "error": family.error, "members": there.sum(),
        "share_all": ((values >= LOW) & (values <= HIGH)).all(axis=1).mean(), "nearly": nearly, "nearest": nearest,
    }
    over, cube = tuple(v.name for v in VARIED), (GRID, GRID, GRID)
    about = {"units": "1", "long_name": "worst statement, in halves of its range"}
    variables = {"worst": (over, worst.reshape(cube), about)}
    for k, (name, ends) in enumerate(STATED.items()):
        variables[name] = (over, values[:, k].reshape(cube), {"units": ends[2]})
    coords = {v.name: (v.name, axis, {"units": v.unit}) for v, axis in zip(VARIED, axes, strict=True)}
    return Result(numbers, {"stacks": xr.Dataset(variables, coords)})


def terms(u):
    """1, u_i and u_i u_j, shape (n, terms)."""
    i, j = np.triu_indices(u.shape[1])
    return np.column_stack([np.ones(len(u)), u, u[:, i] * u[:, j]])


def everywhere(shares, table, unit):
    """All quantities at points of the unit cube: a quadratic polynomial, and a Gaussian process of the rest."""
    there, columns = ~np.isnan(table).any(axis=1), []
    u = shares[: len(table)][there]
    for y in table[there].T:
        curve = np.linalg.lstsq(terms(u), y, rcond=None)[0]
        kernel = ConstantKernel(1.0) * RBF(np.ones(u.shape[1]), (0.05, 50.0))
        process = GaussianProcessRegressor(kernel, alpha=1e-8, normalize_y=True)
        with warnings.catch_warnings():  # of its likelihood
            warnings.simplefilter("ignore", ConvergenceWarning)
            process.fit(u, y - terms(u) @ curve)
        columns.append(terms(unit) @ curve + process.predict(unit))
    return np.column_stack(columns)


def distance(values):
    """Distance of the worst statement from the middle of its range, in halves of the range, shape (n,)."""
    return np.abs((values - (LOW + HIGH) / 2) / ((HIGH - LOW) / 2)).max(axis=-1)


def quantities(model, wave, samples):
    """The quantities of the paper's statements for one stack; nan where the ring rests at the centre of the plane."""
    cycles = {}
    for point in PLANE:
        try:
            cycles[point] = coupled.limit_cycle(RING, model, **at(point)).attrs
        except th.InputError:  # it rests
            continue
    centre = cycles.get(CENTRE, {"period": np.nan, "swing": np.nan})
    frequency = np.median([1 / one["period"] for one in cycles.values()]) if cycles else np.nan
    rise = model.periodic_response(wave, samples)
    data = th.dataset.build(np.linspace(0, wave.period, samples), rise, wave, periodic=True)
    pair = surrogate.fit_newton(data).parameters
    return [centre["period"], centre["swing"], frequency, pair["tau_th"], pair["heat_capacity"] / HEAT_CAPACITY]


@figure
def stack_map(stacks_explained):
    ax, data = panel(), stacks_explained.data["stacks"]
    box, above = data["box"].values * 1e6, (data["oxide"].values - CORE) * 1e6
    worst = data["worst"].min("conductivity").transpose("oxide", "box").values
    drawn = ax.contourf(box, above, worst, levels=np.arange(0.8, 3.1, 0.2), cmap="Greys_r", extend="both")
    ax.figure.colorbar(drawn, ax=ax, label="worst statement / half of its range")
    silica = data.interp(conductivity=1.38)
    for name, words, colour in (
        ("period", "period 0.75, 0.85 µs", BLUE), ("frequency", "0.7, 1.4 MHz over the plane", GREEN),
        ("tau_th", "417 ns ± 5 %", VERMILION), ("heat_capacity", "6.9 c_p ± 5 %", ORANGE),
    ):
        ends = silica[name].transpose("oxide", "box").values
        lines = ax.contour(box, above, ends, STATED[name][:2], colors=colour)
        if any(np.size(path.vertices) for path in lines.get_paths()):
            ax.plot([], [], color=colour, label=words)
    best = stacks_explained.numbers["nearest"]
    ax.plot(best["box"] * 1e6, best["oxide"] * 1e6, "*", color="white", mec=INK, ms=13, clip_on=False, zorder=5)
    ax.set(xlabel="buried oxide (µm)", ylabel="oxide above the core (µm)")
    return legend_above(ax)
