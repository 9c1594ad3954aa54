"""``thermofem noise``: thermo-refractive noise of the ring of one geometry, from the matrices of its heat."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import options
from .console import say, working

if TYPE_CHECKING:
    import xarray as xr

PRINTED = (1e3, 1e5, 1e7)  # Hz


def noise(
    geometry: options.Geometry = None,
    wavelength: str | None = None,
    mode: str | None = None,
    temperature: options.Quantity = None,
    frequency: str = "100 Hz, 100 MHz",
    accuracy: float = 1e-3,
    figure: Path | None = None,
    csv: Path | None = None,
) -> dict[str, Any]:
    """Compute the thermo-refractive noise of one geometry: how quiet its resonance can be.

    The table has frequency and one-sided density, as programs for combs read it.

    Options
    -------
    mode: Guided mode; default: that of [light], or TE0.
    temperature: [K] Absolute temperature, e.g. '300 K'; default: the ambient of the geometry.
    frequency: First and last frequency.
    """
    import numpy as np

    import thermofem as th
    from thermofem.data import quantity

    from .inputs.command_files import section_of, write_columns
    from .inputs.drive_texts import RANGE, reading, wavelength_of

    section = section_of(geometry)
    with reading(f"--frequency = {frequency!r}", f"{RANGE} '100 Hz, 100 MHz'"):
        low, high = sorted(quantity.positive(part.strip(), "Hz", name="--frequency") for part in frequency.split(","))
    # 181: frequencies of the plot
    shown = np.geomspace(low, high, 181)
    with working("meshing, and solving for the mode"):
        heat = th.assemble(section, accuracy)
        found = th.light(heat, wavelength=wavelength_of(section, wavelength)).mode(mode)
        lit = heat.with_light(found)
    with working(f"noise of {heat.unknowns} temperatures"):
        every = np.unique([0.0, *PRINTED, *shown])
        data = th.thermal_noise(lit, every, temperature=temperature)
    lit.domain_error(read="light", what="the noise at low frequencies")
    spectrum = data.sel(frequency=shown)
    numbers = _said(data, found)
    if csv:
        write_columns(csv, {"frequency (Hz)": shown, "S_nu (Hz^2/Hz)": spectrum["S_nu"].values})
    if figure:
        from thermofem import plot

        plot.save_figure(plot.plot_noise(data.sel(frequency=slice(low, high)), float(data["S_T"][0])), figure)
    return {**numbers, "figure": figure, "csv": csv}


def _said(data: xr.Dataset, mode: Any) -> dict[str, Any]:
    """Print and return rms values, three densities, and the linewidth that they make."""
    from thermofem.data import quantity
    from thermofem.fluctuations import linewidth

    a = data.attrs
    kelvin = a["temperature"]
    shift = a["thermal_shift"]
    say(f"{mode.name} at {quantity.rounded(mode.wavelength, 'm', 6)}, {kelvin:g} K, {shift / 1e9:.4g} GHz/K")
    rise = quantity.rounded(a["rms_temperature"], "K")
    jitter = quantity.rounded(a["rms_frequency"], "Hz")
    say(f"rms temperature {rise}, rms frequency {jitter}")
    densities = {}
    for f in PRINTED:
        density = float(data["S_nu"].sel(frequency=f))
        densities[f"{f:g}"] = density
        say(f"S_nu at {quantity.write(f, 'Hz')}: {density:.4g} Hz^2/Hz")
    width = linewidth(data)
    say(
        f"linewidth of a laser that follows the resonance: {quantity.rounded(width, 'Hz')}, by the beta-separation line"
    )
    bound = float((data["bound"] / data["S_T"]).max())
    say(f"reduction: within {bound:.0e} of every density, certified")
    numbers = {name: a[name] for name in ("temperature", "thermal_shift", "rms_temperature", "rms_frequency")}
    return {**numbers, "S_nu": densities, "linewidth": width, "relative_bound": bound}
