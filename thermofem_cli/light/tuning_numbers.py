"""Numbers that a designer reads off a ring and its heat: pm/K, nm/mW, pi power, thresholds of a map."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from scipy.constants import c

import thermofem as th
from thermofem.data import quantity
from thermofem.errors import InputError

from ..console import say, written

if TYPE_CHECKING:
    import xarray as xr

    from coupled import RingResonator


def shift_per_kelvin(ring: RingResonator) -> float:
    """d(lambda)/dT = lambda thermal_shift / omega in m/K."""
    return c / ring.frequency * ring.thermal_shift / ring.omega


def say_tuning(
    ring: RingResonator, model: th.models.ThermalModel, heated: str | None, read: str | None
) -> dict[str, Any]:
    """Print pm/K and nm per mW absorbed; and the power for a round trip longer by pi, where the geometry is known.

        P_pi = pi c / (n_g L thermal_shift R_th)

    the power that moves the resonance by half a free spectral range c/(n_g L), with the round trip L.
    """
    channel: Any = model
    if len(model.inputs) > 1 or len(model.outputs) > 1:
        channel = channel.channel(heated or model.inputs[0], read or heated or model.outputs[0])
    R = float(channel.thermal_resistance)
    per_kelvin = shift_per_kelvin(ring)
    numbers: dict[str, Any] = {"shift_per_kelvin": per_kelvin, "shift_per_watt": per_kelvin * R}
    line = f"resonance: {per_kelvin * 1e12:.3g} pm/K, {per_kelvin * R * 1e6:.3g} nm per mW absorbed"
    length = _round_trip(model, heated or model.inputs[0])
    if length and R > 0:
        numbers["pi_power"] = math.pi * c / (ring.group_index * length * ring.thermal_shift * R)
        line += f", pi power {written(numbers['pi_power'], 'W')}"
    say(line)
    return numbers


def _round_trip(model: Any, part: str) -> float | None:
    """2 pi radius in m of the part that the light heats, of the geometry that the model's file records."""
    text = (getattr(model, "origin", None) or {}).get("geometry")
    try:
        section = th.CrossSection.from_toml_text(text) if text else None
    except InputError:
        return None
    parts = {one.name: one for one in section.parts} if section else {}
    if part not in parts or getattr(section, "kind", "ring") != "ring":
        return None
    one = parts[part]
    return math.pi * (one.inner_radius + one.outer_radius)


def say_thresholds(found: xr.Dataset) -> dict[str, float | None]:
    """Print the lowest power of a map (W) at which some detuning self-pulses, or is bistable; None without."""
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
