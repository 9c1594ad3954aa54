"""``thermofem validate GEOMETRY.toml``: kinds of models trained on one geometry, and where each suffices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

import surrogate
from thermofem import checks
from thermofem.arrays import Array
from thermofem.fem import HeatProblem, assemble
from thermofem.geometry import CrossSection
from thermofem.models import NonlinearSystem

if TYPE_CHECKING:
    import xarray as xr
    from rich.table import Table

FOSTER = tuple(f"Foster, trained ({n})" for n in (3, 5))
NAMES = ("Newton", "second order", *FOSTER, "certified reduction (0.0001)", "SINDy")  # few enough for one figure
POWERS = np.geomspace(0.5e-3, 50e-3, 9)  # W, over which linear models are held against k(T)


@dataclass(frozen=True)
class Judged:
    """Results of `judge`.

    errors: of `surrogate.judge`.
    refused [mapping from a name to why that model could not be trained]
    power: for k(T): largest rise (K) and power (W) at which a linear model's steady rise is within 1 and 10 %, and the
        largest relative error of an output map up to the last power tried.
    """

    errors: xr.Dataset
    refused: Mapping[str, str]
    power: dict[str, float] | None

    @property
    def curves(self) -> dict[str, xr.Dataset]:
        """The period error of each model, as `surrogate.period_error` has it."""
        curves = self.errors.squeeze("power").rename(period_error="relative_error")
        return {name: curves.sel(model=name) for name in curves["model"].values.tolist()}


def judge(
    geometry: CrossSection,
    *,
    accuracy: float,
    periods: Array,
    power: float,
    duty: float,
    heated: str | None = None,
    read: str | None = None,
) -> Judged:
    """Train the usual kinds of model on one channel of a geometry and judge them by its FEM, k(T) at the power given.

    Raises
    ------
    InputError
        a geometry that cannot be meshed or reduced, a power without a steady state, a name of no part.
    """
    heat = assemble(geometry, accuracy)
    heated = checks.choice("--heated", heated or heat.heated[0], heat.heated)
    read = checks.choice("--read", read or heated, heat.readable)
    channel = {"heated": heated, "read": read}
    ladder = surrogate.train_all(heat, power=power, duty=duty, hot=0, names=NAMES, **channel)
    models, reference, system = dict(ladder.models), ladder.reference, heat.model(heated, read)
    if isinstance(system, NonlinearSystem):
        models["output map"] = surrogate.output_map(system, power)
        models["quadratic reduction"] = surrogate.reduce_quadratic(system, power)
        reference = system
    errors = surrogate.judge(models, reference, powers=[power], periods=periods, duty=duty)
    return Judged(errors, ladder.refused, against_power(heat, heated, read))


def against_power(heat: HeatProblem, heated: str, read: str) -> dict[str, float] | None:
    """Static error of linear models and of an output map under k(T), against the full order."""
    system = heat.model(heated, read)
    if not isinstance(system, NonlinearSystem):
        return None
    found: list[tuple[float, float]] = []
    for power in POWERS:
        try:
            found.append((float(power), float(system.steady_rise(power)[0])))
        except checks.InputError:  # no steady state: the conductivity has gone
            break
    power, rise = np.array(found).T
    mapped = surrogate.output_map(system, float(power[-1]))
    off = np.abs(system.thermal_resistance * power / rise - 1)
    limits = {"power_tried_W": float(power[-1]), "rise_tried_K": float(rise[-1])}
    limits["map_error"] = float(np.max(np.abs(np.array([mapped.steady_rise(p) for p in power]) / rise - 1)))
    for share in (0.01, 0.1):
        crossing = min(share, float(off[-1]))  # off grows with power
        limits[f"power_{share:g}_W"] = float(np.interp(crossing, off, power))
        limits[f"rise_{share:g}_K"] = float(np.interp(crossing, off, rise))
    return limits


def table(found: Judged, of: str = "") -> Table:
    """Models against the periods over which they can be trusted, under the words ``of``."""
    from rich.table import Table

    shown = Table("model", "states", "within 1 % (µs)", "within 10 % (µs)", "largest error", title=of or None)
    for name, curve in found.curves.items():
        largest = float(np.max(np.abs(curve["relative_error"].values)))
        words = f"{float(f'{100 * largest:.2g}'):g} %" if np.isfinite(largest) else "no such period"
        shown.add_row(name, f"{curve['states'].item():.0f}", _range(curve, 0.01), _range(curve, 0.1), words)
    for name, reason in found.refused.items():
        shown.add_row(name, "", "not trained", "", reason.split(";")[0])
    return shown


def advice(found: Judged) -> list[str]:
    """Which model suffices for which periods and powers, in sentences."""
    lines = [surrogate.verdict(found.errors, within=within).splitlines()[0] for within in (0.1, 0.01)]
    limits = found.power
    if limits is None:
        lines.append("no material depends on temperature: the same at every power")
        return lines
    tried = limits["power_tried_W"]
    for share in (0.01, 0.1):
        power, rise = limits[f"power_{share:g}_W"], limits[f"rise_{share:g}_K"]
        reach = f"up to {power * 1e3:.3g} mW, a rise of {rise:.3g} K"
        end = " and beyond" if power >= tried else "; above, take an output map or a quadratic reduction"
        lines.append(f"k(T): the steady rise of linear models is within {100 * share:g} % {reach}{end}")
    error = f"within {100 * limits['map_error']:.2g} % up to {tried * 1e3:.3g} mW, {limits['rise_tried_K']:.3g} K"
    lines.append(f"k(T): the steady rise of a linear model with output map is {error}")
    return lines


def _range(curve: xr.Dataset, within: float) -> str:
    low, high = surrogate.valid_range(curve, within=within)
    return f"{low * 1e6:.3g} to {high * 1e6:.3g}" if low <= high else "nowhere"
