"""``thermofem sweep``: losses, quality factors and thermal resistance of a ring from sweeps of a laser."""

from pathlib import Path
from typing import Annotated, Any

import typer

from .. import options
from ..console import note, say_fitted, say_row, working

SWEEPS = "Table of wavelength and of the power at a port, one for each power; slow sweeps, up, down or both."


def sweep(
    sweeps: Annotated[list[Path], typer.Argument(metavar="TABLE...", help=SWEEPS)],
    power: Annotated[list[str], typer.Option(help="Power in the bus waveguide, of each table.")],
    free: str = "bus_rate, loss_rate, frequency, thermal_resistance",
    ring: str = options.REFERENCE_RING,
    model: Path | None = None,
    port: str | None = None,
    columns: str = "1,2",
    units: str | None = None,
    noise: float | None = None,
    held: list[str] | None = None,
    figure: Path | None = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Ring file (TOML) to write.")] = Path("swept.toml"),
) -> dict[str, Any]:
    """Find quality factors, losses and R_th of a ring from sweeps of a laser, in nm and dBm as instruments write them.

    The thermal model, R_th alone, is written beside the ring file, with the ending .json.

    Options
    -------
    free: Names of the free parameters: also scattering_rate, lifetime, loaded_q, intrinsic_q, power.
    model: Thermal model (JSON) to take R_th from; default: the paper's.
    port: Port of the tables: drop or through; default: by its header.
    columns: Numbers of the columns of wavelength and power.
    units: Units of both, 'nm,dBm'; default: those of the header.
    noise: Noise of a sample in the unit of the tables, if known.
    """
    from scipy.constants import c

    import coupled
    from coupled.identification.held_numbers import leaning
    from coupled.ring_toml import write_text
    from coupled.sweeps.slow_sweeps import with_seen_resonance
    from thermofem.data import files, quantity
    from thermofem.errors import InputError
    from thermofem.models import save_model

    from ..inputs.command_files import model_of, note_ring, ring_of
    from ..inputs.light_tables import held_of, rate_bounds, sweep_table

    for path in sweeps:
        files.regular(path)
    heat = output.with_suffix(".json")
    options.check_outputs([output, heat], inputs=[*sweeps, model])
    if len(power) != len(sweeps):
        raise InputError(f"--power is given {len(power)} times for {len(sweeps)} tables", "give one for each")
    resonator = ring_of(ring)
    deviations = held_of(resonator, held)
    data = []
    for path, watts in zip(sweeps, power, strict=True):
        table = sweep_table(path, columns, units, port)
        data.append(table.assign_attrs(power=quantity.positive(watts, "W", name="--power")))
    start = model_of(model)[0] if model else None
    resonator = with_seen_resonance(resonator, data)
    wavelength = c / resonator.frequency
    note(f"the search starts at {wavelength * 1e9:.6g} nm and a loaded Q of {resonator.loaded_q:.3g}")
    with working("fitting the sweeps"):
        bounds = rate_bounds(resonator, free)
        result = coupled.fit_transmission(
            resonator, data, free=options.listed(free), model=start, noise=noise, held=deviations, bounds=bounds
        )
    output.write_text(write_text(result.ring, dict.fromkeys(result.parameters, "fitted")), encoding="utf-8")
    save_model(result.model, heat)
    if figure:
        from coupled.plot import plot_transmission_fit
        from thermofem.plot import save_figure

        save_figure(plot_transmission_fit(result)[0], figure)
    note_ring(resonator, ring)
    say_fitted(result)
    say_row("misfit", f"{result.misfit:.3g} of noise and steps")
    for line in leaning(result.sensitivities):
        say_row("held", line, ":")
    return {
        "parameters": result.parameters,
        "standard_deviations": result.standard_deviations,
        "sensitivities": result.sensitivities,
        "alternative": result.alternative,
        "misfit": result.misfit,
        "notes": list(result.notes),
        "wrote": [path for path in (output, heat, figure) if path],
    }
