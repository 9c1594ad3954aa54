"""``thermofem reproduce``: the paper from our own FEM.

The paper is M. Borghi, D. Bazzanella, M. Mancinelli, L. Pavesi, Opt. Express 29, 4363 (2021). Its COMSOL runs are
replaced by the FEM of this package on a strip ring of the same perimeter; nothing is taken from a laboratory.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

import coupled
import surrogate
from coupled.parameters import borghi2021 as paper

from .. import dataset
from ..geometry import strip_ring
from ..heat import HeatProblem, assemble
from ..model import Foster, ThermalModel
from ..solve import solve, solve_periodic
from ..waveforms import Pulse, SquareWave

if TYPE_CHECKING:
    import xarray as xr

POWER = 2e-3  # W, the paper's heating
INPUT_POWER, DETUNING = 6.31e-3, 0.0  # W (8 dBm) and Hz: the point of its Fig. 5(b)


@dataclass
class Results:
    """What the stages hand to each other."""

    heat: HeatProblem = None  # type: ignore[assignment]
    data: dict[str, xr.Dataset] = field(default_factory=dict)
    fits: dict[str, Any] = field(default_factory=dict)
    models: dict[str, ThermalModel] = field(default_factory=dict)
    runs: dict[str, xr.Dataset] = field(default_factory=dict)
    pulsing: dict[str, Any] = field(default_factory=dict)
    curves: dict[str, xr.Dataset] = field(default_factory=dict)


def run(out: Path) -> None:
    """Walk from the geometry to self-pulsing traces; data, models and figures go into ``out``."""
    dataset.make_folder(out)
    console = Console()
    stages: dict[str, Callable[[Results, Path], None]] = {
        "finite elements": _assemble,
        "20 µs pulse, Fig. 5(a)": _pulse,
        "periodic square waves, Fig. 5(b)": _squares,
        "training": _train,
        "certified reduction, Fig. 7": _reduce,
        "self-pulsing at (8 dBm, 0 GHz)": _couple,
        "figures": _figures,
    }
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    results = Results()
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("", total=len(stages))
        for name, stage in stages.items():
            progress.update(task, description=name)
            stage(results, out)
            progress.advance(task)
        progress.update(task, description="done")
    console.print(_parameters(results))
    console.print(_numbers(results))
    console.print(f"data, models and figures are in {out}/")


def _assemble(results: Results, out: Path) -> None:
    results.heat = assemble(strip_ring(), accuracy=1e-3)


def _pulse(results: Results, out: Path) -> None:
    times = np.unique(
        np.concatenate([np.linspace(0, 40e-6, 801), np.geomspace(1e-9, 1e-6, 40), 20e-6 + np.geomspace(1e-9, 1e-6, 40)])
    )
    data = solve(results.heat, Pulse(POWER, width=20e-6), times, field_times=[21e-6])
    results.data["pulse"] = data
    dataset.save(data, out / "pulse.nc")


def _squares(results: Results, out: Path) -> None:
    for name, period in (("square_1us", 1e-6), ("square_0.8us", 0.8e-6)):
        data = solve_periodic(results.heat, SquareWave(POWER, period, 0.33))
        results.data[name] = data
        dataset.save(data, out / f"{name}.nc")


def _train(results: Results, out: Path) -> None:
    """Fit every lumped model and write it; uniform samples of the pulse, so that no time is favoured."""
    pulse, square, shorter = (results.data[name] for name in ("pulse", "square_1us", "square_0.8us"))
    rise = pulse.sel(time=np.linspace(0, 20e-6, 401), method="nearest")
    fall = pulse.sel(time=np.linspace(20e-6, 40e-6, 401), method="nearest")
    results.fits = {
        "rise": surrogate.fit_newton(rise),
        "fall": surrogate.fit_decay(fall["time"] - 20e-6, fall["delta_T"]),
        "newton": surrogate.fit_newton(square),
        "newton_0.8us": surrogate.fit_newton(shorter),
        "second_order": surrogate.fit_second_order(square),
        "second_order_0.8us": surrogate.fit_second_order(shorter),
    }
    capacity = paper.HEAT_CAPACITY
    results.models = {
        "Newton, paper's fit": surrogate.newton(tau_th=417e-9, heat_capacity=6.9 * capacity),
        "Newton, ours": results.fits["newton_0.8us"].model,
        "second order, paper, FEM": _second_order(paper.SECOND_ORDER_FEM),
        "second order, paper, experiment": _second_order(paper.SECOND_ORDER_EXPERIMENT),
        "second order, ours": results.fits["second_order"].model,
    }
    for name in ("newton", "newton_0.8us", "second_order", "second_order_0.8us"):
        fit = results.fits[name]
        provenance = {
            "parameters": dict(fit.parameters),
            "standard_errors": dict(fit.standard_errors),
            "training": list(fit.training),
        }
        surrogate.save_model(fit.model, out / f"{name}.json", provenance=provenance)


def _reduce(results: Results, out: Path) -> None:
    """The FEM as a handful of poles: it drives the optics as itself, and plays the reference of the period error."""
    rom = surrogate.reduce(results.heat.system, tolerance=1e-4)
    results.fits["reduction"] = rom
    results.models["finite elements, reduced"] = rom.model
    surrogate.save_model(rom.model, out / "reduction.json", provenance=rom.provenance)
    periods = np.geomspace(0.1e-6, 10e-6, 41)
    trained = {"Newton": results.fits["newton"].model, "second order": results.fits["second_order"].model}
    for name, model in trained.items():
        curve = surrogate.period_error(model, rom.model, periods, power=POWER, duty=1 / 3)
        results.curves[name] = curve
        dataset.save(curve, out / f"period_error_{name.replace(' ', '_')}.nc")


def _second_order(p: paper.SecondOrderParameters) -> Foster:
    return surrogate.second_order(kappa=p.kappa, tau_f=p.tau_f, tau_s=p.tau_s, eta=p.eta, heat_capacity=p.heat_capacity)


def _couple(results: Results, out: Path) -> None:
    """Drive the ring's optics and carriers with each model from a cold start."""
    ring = coupled.borghi2021()
    grid = np.linspace(0, 20e-6, 20001)
    for name, model in results.models.items():
        whole = coupled.simulate(ring, model, power=INPUT_POWER, detuning=DETUNING, duration=20e-6)
        results.pulsing[name] = coupled.pulsing(whole)
        traces = coupled.simulate(ring, model, power=INPUT_POWER, detuning=DETUNING, duration=20e-6, times=grid)
        results.runs[name] = traces
        dataset.save(traces, out / f"traces_{name.replace(', ', '_').replace(' ', '_').replace(chr(39), '')}.nc")


def _figures(results: Results, out: Path) -> None:
    from . import plot

    plot.pulse_figure(results, out / "fig5a_pulse.png")
    plot.square_figure(results, out / "fig5b_square.png")
    plot.period_figure(results, out / "fig7_period_error.png")
    plot.traces_figure(results, out / "traces_8dBm_0GHz.png")


def _parameters(results: Results) -> Table:
    """Trained parameters with their standard errors, next to the paper's."""
    table = Table(
        "", "1 µs square", "0.8 µs square", "paper, FEM", "paper, experiment", title="Second-order equation (Eq. 3)"
    )
    fits = [results.fits[name] for name in ("second_order", "second_order_0.8us")]
    sets = [paper.SECOND_ORDER_FEM, paper.SECOND_ORDER_EXPERIMENT]
    rows = {
        "κ (1/µs)": ("kappa", 1e-6, 3),
        "τ_f (ns)": ("tau_f", 1e9, 1),
        "τ_s (ns)": ("tau_s", 1e9, 0),
        "η": ("eta", 1, 3),
    }
    for heading, (name, unit, digits) in rows.items():
        ours = [f"{f.parameters[name] * unit:.{digits}f} ± {f.standard_errors[name] * unit:.{digits}f}" for f in fits]
        table.add_row(heading, *ours, *(f"{getattr(s, name) * unit:.{digits}f}" for s in sets))
    resistances = [f.model.thermal_resistance for f in fits] + [_second_order(s).thermal_resistance for s in sets]
    table.add_row("R_th (K/mW)", *(f"{r / 1e3:.2f}" for r in resistances))
    table.add_row("misfit (K rms)", *(f"{f.residual:.2f}" for f in fits), "", "")
    return table


def _numbers(results: Results) -> Table:
    """What the paper says, what we get."""
    fits, swing = results.fits, {name: float(np.ptp(d["delta_T"].values)) for name, d in results.data.items()}
    newton, fall = fits["newton_0.8us"].parameters, fits["fall"]
    table = Table("quantity", "the paper", "here", title="Next to the paper")
    table.add_row("R_th of the ring (K/mW)", "7.78 (its κ τ_f τ_s)", f"{results.heat.thermal_resistance() / 1e3:.3f}")
    table.add_row(
        "rise after 20 µs of 2 mW (K)", "a curve, Fig. 5(a)", f"{float(results.data['pulse']['delta_T'].max()):.2f}"
    )
    table.add_row(
        "one exponential through the rise (ns)", "not given", f"{fits['rise'].parameters['tau_th'] * 1e9:.0f}"
    )
    table.add_row(
        "two exponentials through the fall (ns)", "not given", " and ".join(f"{t * 1e9:.0f}" for t in fall.tau)
    )
    table.add_row("swing at 0.8 µs, 2 mW, 33 % (K)", "about 6", f"{swing['square_0.8us']:.2f}")
    table.add_row("Newton fitted at 0.8 µs: τ_th (ns)", "417", f"{newton['tau_th'] * 1e9:.0f}")
    table.add_row("Newton fitted at 0.8 µs: c_p over silicon's", "6.9", f"{newton['heat_capacity_ratio']:.2f}")
    rom = fits["reduction"]
    error = results.curves["second order"].interp(period=[0.5e-6, 1e-6, 2e-6])["relative_error"].values * 100
    said = "10 % at 0.5 and 2 µs, least at 1 µs"
    table.add_row("period error of Eq. 3 at 0.5, 1, 2 µs (%)", said, ", ".join(f"{e:+.0f}" for e in error))
    table.add_row("FEM as poles: certified error", "left open", f"{rom.order} poles, {rom.error_bound:.0e} of R_th")
    for name, found in results.pulsing.items():
        here = f"{found.period * 1e9:.0f} ns, duty {found.duty:.2f}, {found.swing:.1f} K"
        table.add_row(f"(8 dBm, 0): {name}", "about 800 ns", here if np.isfinite(found.period) else str(found.regime))
    return table
