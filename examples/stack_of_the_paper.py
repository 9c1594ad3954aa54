"""Which layer stack explains what the paper says of its ring? Its stack is not in print.

    python examples/stack_of_the_paper.py [folder]

Trains a family over the buried oxide, the oxide above the core and their conductivity, works out five statements of
Borghi et al. at every node of a grid, prints the nearest stack, and draws stack_of_the_paper.png into the folder.
"""

from __future__ import annotations

import sys
from dataclasses import asdict
from itertools import product
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import xarray as xr

import coupled
import surrogate
import thermofem as th
from coupled import parameters as printed
from thermofem.campaign import Variation
from thermofem.plot import BLUE, GREEN, INK, ORANGE, VERMILION

RING = coupled.borghi2021()
CORE = 0.22e-6  # m; the cladding is measured from the bottom of the core
VARIED = (
    Variation("box", ("layer.box.thickness",), "m", low=1e-6, high=4e-6),
    Variation("oxide", ("layer.cladding.thickness",), "m", low=CORE + 0.5e-6, high=CORE + 4e-6),
    Variation("conductivity", ("material.SiO2.conductivity",), "W/m/K", low=0.9, high=1.5),
)
NODES = 7  # along each of the three
POINTS = ((8.0, 0.0), (5.0, 0.0), (7.0, -10.0), (8.0, 20.0), (10.0, 10.0))  # dBm, GHz; the first is the paper's
STATED = {  # what the paper says: within the rounding of its words, and 5 % for the pair fitted to one trace
    "period": (0.75e-6, 0.85e-6, BLUE, "period 0.75, 0.85 µs"),  # s, at (8 dBm, 0 GHz)
    "swing": (5.5, 6.5, None, ""),  # K, there
    "frequency": (0.7e6, 1.4e6, GREEN, "0.7, 1.4 MHz over the plane"),  # Hz, median of the points
    "tau_th": (0.95 * 417e-9, 1.05 * 417e-9, VERMILION, "417 ns ± 5 %"),  # s, of Newton's law fitted to a cycle's heat
    "heat_capacity": (0.95 * 6.9, 1.05 * 6.9, ORANGE, "6.9 c$_p$ ± 5 %"),  # times that of the core's silicon
}
LOW, HIGH = np.array([ends[:2] for ends in STATED.values()]).T


def pulses(model: th.models.ThermalModel, dbm: float, ghz: float) -> tuple[xr.Dataset, coupled.runs.pulsing.Pulsing]:
    """A run of 20 us from cold, and its cycle."""
    run = coupled.simulate(RING, model, power=1e-3 * 10 ** (dbm / 10), detuning=ghz * 1e9, duration=20e-6)
    return run, coupled.pulsing(run)


def heat_of_a_cycle() -> th.Sampled:
    """Absorbed power of a cycle at the first point, with the pair of the paper: 417 ns, 6.9 c_p."""
    run, found = pulses(surrogate.newton(**asdict(printed.NEWTON_FIT)), *POINTS[0])
    times = np.linspace(0, found.period, 151)
    power = np.interp(20e-6 - 1.5 * found.period + times, run["time"].values, run["absorbed"].values)
    return th.Sampled(times, [*power[:-1], power[0]], repeat=True)


def quantities(model: th.models.ThermalModel, wave: th.Sampled) -> list[float]:
    """What the statements are about, for one stack; nan where the ring does not pulse."""
    cycles = [pulses(model, *point)[1] for point in POINTS]
    rise, times = model.periodic_response(wave, 302), np.linspace(0, wave.period, 302)
    pair = surrogate.fit_newton(th.dataset.build(times, rise, wave, periodic=True)).parameters
    frequency = float(np.nanmedian([1 / one.period for one in cycles]))
    ratio = pair["heat_capacity"] / printed.HEAT_CAPACITY
    return [cycles[0].period, cycles[0].swing, frequency, pair["tau_th"], ratio]


def draw(data: xr.Dataset, best: dict[str, float], path: Path) -> None:
    """The worst statement at the best conductivity, and the ends of the ranges at 1.38 W/(m K)."""
    fig, ax = plt.subplots(figsize=(5.2, 4.2), layout="constrained")
    fine = {name: np.linspace(*data[name].values[[0, -1]], 49) for name in ("box", "oxide")}
    box, above = fine["box"] * 1e6, (fine["oxide"] - CORE) * 1e6
    worst = data["worst"].min("conductivity").interp(fine, method="linear").transpose("oxide", "box")
    drawn = ax.contourf(box, above, worst, levels=np.arange(0.8, 3.1, 0.2), cmap="Greys_r", extend="both")
    fig.colorbar(drawn, ax=ax, label="worst statement / half of its range")
    silica = data.interp(conductivity=1.38).interp(fine, method="cubic").transpose("oxide", "box")
    for name, (low, high, colour, words) in STATED.items():
        if colour:
            ax.contour(box, above, silica[name], (low, high), colors=colour)
            ax.plot([], [], color=colour, label=words)
    ax.plot(best["box"] * 1e6, (best["oxide"] - CORE) * 1e6, "*", color="white", mec=INK, ms=13, zorder=5)
    ax.set(xlabel="buried oxide (µm)", ylabel="oxide above the core (µm)")
    fig.legend(loc="outside upper left", ncols=2, frameon=False, fontsize="small")
    fig.savefig(path, dpi=150)


def main(folder: Path) -> None:
    """Train, work out, print, draw."""
    campaign = th.Campaign(th.strip_ring().to_toml(), VARIED, samples=1)
    family = surrogate.train_family(campaign, tolerance=5e-3, held_out=4)
    axes = {one.name: np.linspace(one.low, one.high, NODES) for one in VARIED}
    nodes, wave = (
        [dict(zip(axes, map(float, node), strict=True)) for node in product(*axes.values())],
        heat_of_a_cycle(),
    )
    table = np.array([quantities(family.at(node), wave) for node in nodes])
    worst = np.abs((table - (LOW + HIGH) / 2) / ((HIGH - LOW) / 2)).max(axis=1)
    k, shape = int(np.nanargmin(worst)), (NODES,) * 3
    best, found = nodes[k], dict(zip(STATED, table[k], strict=True))
    share = ((table >= LOW) & (table <= HIGH)).all(axis=1).mean()
    print(f"{share:.1%} of {len(nodes)} stacks keep all five; family error {family.error.worst:.0e}")
    print(
        f"nearest: {best['box'] * 1e6:.2f} um below, {(best['oxide'] - CORE) * 1e6:.2f} um above, "
        f"{best['conductivity']:.2f} W/(m K): {found['period'] * 1e9:.0f} ns, {found['swing']:.2f} K, "
        f"{found['frequency'] * 1e-6:.2f} MHz, {found['tau_th'] * 1e9:.0f} ns, {found['heat_capacity']:.2f} c_p"
    )
    variables = {name: (tuple(axes), column.reshape(shape)) for name, column in zip(STATED, table.T, strict=True)}
    data = xr.Dataset(variables | {"worst": (tuple(axes), worst.reshape(shape))}, axes)
    draw(data, best, folder / "stack_of_the_paper.png")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
