"""Maps as ``map`` and ``stability`` print and draw them: thresholds, thermal tuning, curves of bifurcations."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import coupled
import thermofem as th
from coupled import RingResonator
from coupled.heaters import constant
from coupled.maps.hopf_plane import threshold_plane
from coupled.ring_from import tuning
from coupled.thermal import as_read, without_origin
from thermofem.data import quantity

from ..console import note, say, working, written
from ..options import PlaneTexts


def write_map(
    found: xr.Dataset,
    output: Path,
    figure: Path | None,
    ring: RingResonator,
    model: th.models.ThermalModel,
    parts: dict[str, Any],
) -> dict[str, Any]:
    """Write a map to a file; print and return its regimes, thresholds and thermal tuning."""
    th.save(found, output)
    names, counts = np.unique(found["regime"].values, return_counts=True)
    points = dict(zip(map(str, names), map(int, counts), strict=True))
    say(", ".join(f"{count} {name}" for name, count in points.items()))
    thresholds = say_thresholds(found)
    numbers = {"thresholds": thresholds, **say_tuning(ring, model, **parts)}
    return {"points": points, **numbers, "map": output, "figure": figure}


def shows_threshold(found: xr.Dataset) -> bool:
    """Whether a map has self-pulsing, and not at its lowest power already."""
    pulsing = (found["regime"] == "self-pulsing").any("detuning").values
    return bool(pulsing.any() and not pulsing[0])


def note_options(plane: PlaneTexts | None) -> None:
    """Print the options of a map of a plane."""
    if plane is not None:
        note(f'--power "{plane.power}" --detuning "{plane.detuning}" maps the plane about it')


def threshold_axes(
    ring: RingResonator, model: th.models.ThermalModel, heaters: dict[str, Any], parts: dict[str, Any]
) -> PlaneTexts | None:
    """Return the axes of the plane about the lowest Hopf point, which is printed; None where there is no Hopf curve."""
    warmed = constant(model, ring.read, heaters, **parts)
    threshold = threshold_plane(as_read(ring, warmed.model), without_origin(warmed.model))
    if threshold is None:
        note("the ring has no Hopf curve with this model, at any power up to 1 W")
        return None
    turned = warmed.turned(ring)
    lowest, window = threshold
    level = 10 * math.log10(lowest.power / 1e-3)
    place = quantity.rounded(lowest.detuning - turned, "Hz")
    note(f"the Hopf curve begins at {quantity.rounded(lowest.power, 'W')} ({level:.2f} dBm), at {place}")
    powers = [quantity.rounded(power, "W") for power in window.powers]
    detunings = [quantity.rounded(detuning - turned, "Hz") for detuning in window.detunings]
    return PlaneTexts(", ".join(powers), ", ".join(detunings))


def say_tuning(ring: RingResonator, model: th.models.ThermalModel, **parts: str | None) -> dict[str, float]:
    """Print and return the thermal tuning: pm/K, nm per mW, and if known the power for half a free spectral range."""
    found = tuning(ring, model, **parts)
    kelvin = f"{found['shift_per_kelvin'] * 1e12:.3g} pm/K"
    watt = f"{found['shift_per_watt'] * 1e6:.3g} nm"
    pi = f", pi power {written(found['pi_power'], 'W')}" if "pi_power" in found else ""
    say(f"resonance: {kelvin}, {watt} per mW absorbed{pi}")
    return found


def say_thresholds(found: xr.Dataset) -> dict[str, float | None]:
    """Print and return the lowest power of a map (W) with self-pulsing, and with bistability; None without."""
    thresholds: dict[str, float | None] = {}
    for regime in ("self-pulsing", "bistable"):
        rows = (found["regime"] == regime).transpose("power", "detuning").values
        at = [k for k, row in enumerate(rows) if row.any()]
        thresholds[regime] = float(found["power"][at[0]]) if at else None
        if not at:
            continue
        watts, hertz = found["power"].values, found["detuning"].values[rows[at[0]]]
        below = f"none at {quantity.rounded(watts[at[0] - 1], 'W')}" if at[0] else "the lowest power of the map"
        dbm = 10 * math.log10(watts[at[0]] / 1e-3)
        where = quantity.rounded(float(hertz[0]), "Hz")
        where += f" to {quantity.rounded(float(hertz[-1]), 'Hz')}" if hertz.size > 1 else ""
        say(f"{regime} from {quantity.rounded(watts[at[0]], 'W')} ({dbm:.2f} dBm) on, at {where} ({below})")
    return thresholds


def draw_map(
    found: xr.Dataset,
    path: Path,
    show: tuple[str, ...],
    ring: RingResonator,
    model: th.models.ThermalModel,
    heaters: dict[str, Any],
    parts: dict[str, Any],
) -> None:
    """Draw a map with the Hopf curves, the folds of fixed points and those of cycles of a linear model."""
    from coupled.plot import plot_maps
    from thermofem.plot import save_figure

    warmed = constant(model, ring.read, heaters, **parts)
    thermal, turned = warmed.model, warmed.turned(ring)  # Hz, by which the heaters move the resonance
    ring = as_read(ring, thermal)
    thermal = without_origin(thermal)
    axes = found["power"].values, found["detuning"].values + turned
    hopf = []
    folds = []
    if not hasattr(thermal, "H"):
        with working("following the Hopf curves, the folds of fixed points and those of cycles"):
            hopf = coupled.hopf_curves(ring, thermal, *axes)
            folds = [
                *coupled.fold_curves(ring, thermal, *axes),
                *coupled.cycles.cycle_folds.cycle_fold_curves(ring, thermal, *axes),
            ]
    for curve in (*hopf, *folds):
        curve["detuning"] = curve["detuning"].copy(data=curve["detuning"].values - turned)
    states = getattr(thermal, "order", None)
    size = f" with {states} states" if isinstance(states, int) else ""
    words = [ring.name, f"{type(thermal).__name__}{size}, R_th = {thermal.thermal_resistance / 1e3:.4g} K/mW"]
    words += [f"{name} at {quantity.rounded(power, 'W', 4)}" for name, power in warmed.rest.powers.items()]
    title = ", ".join(words)
    save_figure(plot_maps({title: found}, show=show, hopf={title: hopf}, folds={title: folds})[0, 0], path)
