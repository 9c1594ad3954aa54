"""``thermofem linearize``: the small-signal answer of a ring at a steady state, for a lock."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .. import options
from ..console import say, working

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr

    import coupled


def linearize(
    model: options.Model,
    power: options.Quantity = "1 mW",
    detuning: str = "0 GHz",
    ring: str = options.REFERENCE_RING,
    heated: str | None = None,
    read: str | None = None,
    heater: list[str] | None = None,
    branch: int = 0,
    given: Annotated[
        str, typer.Option("--input", help="Input of figure and table: power, detuning, heat, ambient or a heater.")
    ] = "detuning",
    figure: Path | None = None,
    csv: Path | None = None,
) -> dict[str, Any]:
    """Linearize a ring about a steady state: plant of a lock, bandwidths, thermal resistance with light.

    --json prints the matrices A, B, C, D in SI.

    Options
    -------
    power: [W > 0] Power in the bus waveguide.
    branch: Number of the steady state, by energy, where there are several.
    """
    import numpy as np

    import coupled
    from thermofem import checks

    from ..inputs.command_files import model_of, note_ring, ring_of
    from ..inputs.ring_drives import detuning_of, steady_heaters

    resonator = ring_of(ring)
    hertz = detuning_of(detuning, resonator)
    powers = steady_heaters(heater)
    thermal, parts = model_of(model, heated, read, powers)
    with working("linearizing"):
        linear = coupled.linearize(
            resonator, thermal, power=power, detuning=hertz, heaters=powers, branch=branch, **parts
        )
    given = checks.choice("--input", given, linear.inputs)
    size = np.abs(linear.eigenvalues)
    # 401: frequencies of the Bode plot
    response = linear.response(np.geomspace(size.min() / 100, size.max() * 10, 401) / (2 * np.pi))
    note_ring(resonator, ring)
    numbers = say_response(linear, response, given)
    if csv:
        _write(response.sel(input=given), csv)
    if figure:
        from coupled.plot import plot_bode
        from thermofem.plot import save_figure

        save_figure(plot_bode(response, given)[0], figure)
    matrices = {name: getattr(linear, name).tolist() for name in ("A", "B", "C", "D")}
    names = {"inputs": linear.inputs, "outputs": linear.outputs, "states": linear.states}
    return {**numbers, **names, **matrices, "figure": figure, "csv": csv}


def say_response(linear: coupled.Linear, response: xr.Dataset, given: str) -> dict[str, Any]:
    """Print and return stability, R_eff, and gain and bandwidth from one input to drop power and temperature."""
    import numpy as np

    from thermofem.data import quantity

    leading = linear.eigenvalues[0]
    oscillates = f", oscillating at {quantity.rounded(abs(leading.imag) / (2 * np.pi), 'Hz')}" if leading.imag else ""
    word = "stable" if linear.stable else "UNSTABLE: the answer below is that of small departures while they are small"
    rise = float(linear.state["delta_T"])
    say(f"{word}; leading eigenvalue {leading.real:.4g} 1/s{oscillates}; rise {rise:.4g} K")
    R = linear.thermal_resistance
    say(f"R_eff, with the light's feedback, {R / 1e3:.4g} K/mW")
    responses = {}
    for name in ("drop", "through", "delta_T"):
        channel = response["response"].sel(input=given, output=name)
        static = float(linear.static[linear.outputs.index(name), linear.inputs.index(given)])
        bandwidth = _bandwidth(channel["frequency"].values, np.abs(channel.values), abs(static))
        gain = quantity.gain(static, channel["output_unit"].item(), channel["input_unit"].item())
        band = "no frequency of the plot" if bandwidth is None else quantity.rounded(bandwidth, "Hz")
        say(f"{given} to {name}: {gain} at rest, -3 dB at {band}")
        responses[name] = {"static": static, "bandwidth": bandwidth}
    eigenvalues = [[float(value.real), float(value.imag)] for value in linear.eigenvalues]
    light = {"stable": linear.stable, "thermal_resistance": R, "delta_T": rise}
    return {**light, "eigenvalues": eigenvalues, "input": given, "responses": responses}


def _bandwidth(f: np.ndarray, size: np.ndarray, static: float) -> float | None:
    """The lowest frequency (Hz) at which the magnitude is below static/sqrt(2); None where it is nowhere."""
    import numpy as np

    below = np.flatnonzero(size < static / np.sqrt(2))
    if not below.size or not below[0]:
        return None
    k = below[0]
    logs = np.log(size[[k, k - 1]])
    return float(np.exp(np.interp(np.log(static / np.sqrt(2)), logs, np.log(f[[k, k - 1]]))))


def _write(response: xr.Dataset, path: Path) -> None:
    """Write magnitude and phase of every output over frequency."""
    import numpy as np

    from ..inputs.command_files import write_columns

    values = response["response"]
    columns = {"frequency (Hz)": values["frequency"].values}
    for name in values["output"].values:
        channel = values.sel(output=name)
        per = f"{channel['output_unit'].item()}/{channel['input_unit'].item()}"
        columns[f"|{name}| ({per})"] = np.abs(channel.values)
        columns[f"phase of {name} (deg)"] = np.degrees(np.unwrap(np.angle(channel.values)))
    write_columns(path, columns)
