"""``thermofem solve``: geometry and drive in, netCDF and pictures out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.console import Console

from .. import dataset, quantity, waveforms
from ..checks import InputError
from ..geometry import CrossSection, strip_ring
from ..heat import assemble
from ..solve import solve, solve_periodic

Drive = tuple[str, str | None, str | None, float]


def run(
    geometry: Path | None,
    *,
    drive: Drive,
    sampling: tuple[bool, str, int],
    probes: tuple[str | None, tuple[str, ...]],
    errors: tuple[float, float],
    files: tuple[Path, Path | None, Path | None],
) -> None:
    """Check everything that can be checked, then solve and write."""
    console = Console(stderr=True)
    section = CrossSection.from_toml(geometry) if geometry else strip_ring()
    periodic, duration, samples = sampling
    wave = waveform(*drive)
    if samples < 2:
        raise InputError(f"--samples = {samples} is too few; at least 2 are needed")
    for path in files:
        if path and not path.parent.is_dir():
            raise InputError(f"{path.parent} is not a folder; make it first to write {path.name}")
    heated, read = probes
    with console.status("meshing and assembling"):
        heat = assemble(section, errors[0])
    output, figure, preview = files
    if preview:
        from .. import plot

        plot.save_figure(plot.plot_cross_section(section, heat.mesh), preview)
        console.print(f"wrote {preview}")
    wanted = read[0] if len(read) == 1 else read or None
    with console.status(f"solving with {heat.unknowns} unknowns"):
        if periodic:
            data = solve_periodic(heat, wave, samples, heated=heated, read=wanted, rtol=errors[1])
        else:
            times = np.linspace(0, quantity.parse(duration, "s", name="--duration"), samples)
            data = solve(heat, wave, times, heated=heated, read=wanted, rtol=errors[1])
    dataset.save(data, output)
    if figure:
        from .. import plot

        plot.save_figure(plot.plot_response(data), figure)
    console.print(
        f"R_th = {data.attrs['thermal_resistance'] / 1e3:.4g} K/mW, largest rise {float(data['delta_T'].max()):.4g} K, "
        f"energy imbalance {data.attrs['heat_imbalance']:.0e}"
    )
    for path in (output, figure):
        if path:
            console.print(f"wrote {path}")


def waveform(power: str, pulse: str | None, square: str | None, duty: float) -> waveforms.Waveform:
    """The heating waveform that the options describe."""
    watts = quantity.parse(power, "W", name="--power")
    if pulse and square:
        raise InputError(f"--pulse {pulse} and --square {square} exclude each other; give one")
    if pulse:
        return waveforms.Pulse(watts, quantity.parse(pulse, "s", name="--pulse"))
    if square:
        return waveforms.SquareWave(watts, quantity.parse(square, "s", name="--square"), duty)
    return waveforms.Constant(watts)
