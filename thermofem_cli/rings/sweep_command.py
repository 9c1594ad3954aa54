"""``thermofem sweep``: losses, quality factors and thermal resistance of a ring from sweeps of a laser."""

import re
from pathlib import Path
from typing import Annotated, Any

import typer
import xarray as xr
from scipy.constants import c

import coupled
import surrogate
from coupled.identification.held_numbers import leaning
from coupled.sweeps.slow_sweeps import with_seen_resonance
from coupled.unknowns import number_of
from thermofem.data import files, quantity
from thermofem.errors import InputError

from .. import options
from ..console import note, parameter_unit, say, working, written, wrote
from ..inputs.command_files import check_outputs, model_of, note_ring, ring_of
from ..inputs.light_tables import held_of, light_unit, picked

SWEEPS = "Table of wavelength and of the power at a port, one for each power; slow sweeps, up, down or both."
FREE = "Names of the free parameters: also scattering_rate, lifetime, loaded_q, intrinsic_q, power."
NAMED_UNITS = re.compile(r"(?<![A-Za-z])(nm|um|µm|pm|m)(?![A-Za-z])")
PORTS = ("drop", "through")
WIDE = 30.0  # factor by which a rate may differ from its start


def sweep(
    sweeps: Annotated[list[Path], typer.Argument(metavar="TABLE...", help=SWEEPS)],
    power: Annotated[list[str], typer.Option(help="Power in the bus waveguide, of each table.")],
    free: Annotated[str, typer.Option(help=FREE)] = "bus_rate, loss_rate, frequency, thermal_resistance",
    ring: options.Ring = options.REFERENCE_RING,
    model: Annotated[
        Path | None, typer.Option(help="Thermal model (JSON) to take R_th from; default: the paper's.")
    ] = None,
    port: Annotated[
        str | None, typer.Option(help="Port of the tables: drop or through; default: by its header.")
    ] = None,
    columns: Annotated[str, typer.Option(help="Numbers of the columns of wavelength and power.")] = "1,2",
    units: Annotated[str | None, typer.Option(help="Units of both, 'nm,dBm'; default: those of the header.")] = None,
    noise: Annotated[float | None, typer.Option(help="Noise of a sample in the unit of the tables, if known.")] = None,
    held: options.Held = None,
    figure: options.Figure = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Ring file (TOML) to write.")] = Path("swept.toml"),
) -> dict[str, Any]:
    """Find quality factors, losses and R_th of a ring from sweeps of a laser, in nm and dBm as instruments write them.

    The thermal model, R_th alone, is written beside the ring file, with the ending .json.
    """
    from coupled.ring_toml import write_text

    for path in sweeps:
        files.regular(path)
    heat = output.with_suffix(".json")
    check_outputs([output, heat, figure], images=[figure], inputs=[*sweeps, ring, model])
    if len(power) != len(sweeps):
        raise InputError(f"--power is given {len(power)} times for {len(sweeps)} tables", "give one for each")
    resonator = ring_of(ring)
    deviations = held_of(resonator, held)
    data = []
    for path, watts in zip(sweeps, power, strict=True):
        one = _table(path, columns, units, port)
        data.append(one.assign_attrs(power=quantity.positive(watts, "W", name="--power")))
    start = model_of(model)[0] if model else None
    resonator = with_seen_resonance(resonator, data)
    wavelength = c / resonator.frequency
    note(f"the search starts at {wavelength * 1e9:.6g} nm and a loaded Q of {resonator.loaded_q:.3g}")
    with working("fitting the sweeps"):
        found = coupled.fit_transmission(
            resonator, data, free=[name.strip() for name in free.split(",")], model=start, noise=noise,
            held=deviations, bounds=_bounds(resonator, free),
        )  # fmt: skip
    output.write_text(write_text(found.ring, dict.fromkeys(found.parameters, "fitted")), encoding="utf-8")
    surrogate.save_model(found.model, heat)
    if figure:
        from coupled.plot import plot_transmission_fit
        from thermofem.plot import save_figure

        save_figure(plot_transmission_fit(found)[0], figure)
    note_ring(resonator, ring)
    for name, value in found.parameters.items():
        say(f"{name:>22} = {written(value, parameter_unit(name), found.standard_deviations[name])}")
    say(f"{'misfit':>22} = {found.misfit:.3g} of noise and steps")
    for line in leaning(found.sensitivities):
        say(f"{'held':>22} : {line}")
    wrote(output, heat, figure)
    return {
        "parameters": found.parameters,
        "standard_deviations": found.standard_deviations,
        "sensitivities": found.sensitivities,
        "alternative": found.alternative,
        "misfit": found.misfit,
        "notes": list(found.notes),
        "wrote": [path for path in (output, heat, figure) if path],
    }


def _table(path: Path, columns: str, units: str | None, port: str | None) -> xr.Dataset:
    """Return a table as a Dataset over step: wavelength (m), and the power at a port in the unit of the table."""
    from thermofem.data.number_table import number_table

    table = number_table(path.read_bytes())
    laser, light = picked(table, columns)
    stated = [text.strip() for text in units.split(",")] if units else ["", ""]
    if len(stated) != 2:
        raise InputError(f"--units = {units!r} must be two units", 'such as "nm,dBm"')
    shown = NAMED_UNITS.search(laser.name)
    unit = stated[0] or laser.unit or (shown[1] if shown else "")
    if not unit:
        raise InputError(f"{path}: {laser.label} states no unit", 'give --units "nm,dBm"')
    factor = quantity.parse(f"1 {unit}", "m", name=f"{path}: the unit of {laser.label}")
    name = port or next((name for name in PORTS if name in light.name.lower()), None)
    if name not in PORTS:
        what = f"--port = {port!r}" if port else f"the port of {path}, {light.label}"
        raise InputError(f"{what} is neither drop nor through", "give --port through")
    attributes = {"units": stated[1] or light_unit(light)} if stated[1] or light_unit(light) else {}
    wavelength = laser.values * factor
    return xr.Dataset({name: ("step", light.values, attributes), "wavelength": ("step", wavelength, {"units": "m"})})


def _bounds(ring: coupled.RingResonator, free: str) -> dict[str, tuple[float, float]]:
    """Return wide bounds of free rates: the split of the linewidth into bus and losses is not known before."""
    rates = [name.strip() for name in free.split(",") if name.strip().endswith("_rate")]
    return {name: (number_of(ring, name) / WIDE, number_of(ring, name) * WIDE) for name in rates}
