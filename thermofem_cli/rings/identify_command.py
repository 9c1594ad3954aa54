"""``thermofem identify``: parameters of a ring from measured drop traces."""

from pathlib import Path
from typing import Annotated, Any

import typer

from .. import options
from ..console import note, parameter_unit, say, watched, written, wrote

TRACES = "Drop over time: netCDF of `thermofem simulate`, or a table, one for each power and detuning."
UNITS = "Units of both, 'us,mV' or 'us,dBm'; any but W, mW and dBm frees the scale."


def identify(
    traces: Annotated[list[Path], typer.Argument(metavar="TRACE...", help=TRACES)],
    free: Annotated[str, typer.Option(help="Names of the free parameters.")] = "kappa, tau_f, tau_s, eta",
    ring: options.Ring = options.REFERENCE_RING,
    model: Annotated[
        Path | None, typer.Option(help="Thermal model (JSON) to start from; default: the paper's.")
    ] = None,
    power: Annotated[list[str] | None, typer.Option(help="Power in the bus waveguide, of each table.")] = None,
    detuning: Annotated[list[str] | None, typer.Option(help="Laser minus cold resonance, of each table.")] = None,
    columns: Annotated[str, typer.Option(help="Numbers of the columns of time and drop in tables.")] = "1,2",
    units: Annotated[
        str | None, typer.Option(help="Units of both, 'us,mV' or 'us,dBm'; any but W, mW, dBm frees the scale.")
    ] = None,
    settled: Annotated[bool, typer.Option("--settled", help="The light was on long before the tables begin.")] = False,
    held: options.Held = None,
    figure: options.Figure = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Ring file (TOML) to write.")] = Path(
        "identified.toml"
    ),
    seed: options.Seed = 1,
) -> dict[str, Any]:
    """Find parameters of a ring, its carriers and its heat from drop traces at known power and detuning.

    The thermal model is written beside the ring file, with the ending .json.
    """
    import coupled
    import thermofem as th
    from coupled.identification.held_numbers import leaning
    from coupled.ring_toml import write_text
    from thermofem.data import files, quantity
    from thermofem.errors import InputError
    from thermofem.models import save_model

    from ..inputs.command_files import check_outputs, model_of, note_ring, ring_of
    from ..inputs.light_drives import detuning_of
    from ..inputs.light_tables import drop_table, held_of

    for path in traces:
        files.regular(path)
    heat = output.with_suffix(".json")
    check_outputs([output, heat, figure], images=[figure], inputs=[*traces, ring, model])
    resonator = ring_of(ring)
    deviations = held_of(resonator, held)
    tables = [path for path in traces if path.suffix != ".nc"]
    for option, given in (("--power", power or []), ("--detuning", detuning or [])):
        if len(given) != len(tables):
            raise InputError(f"{option} is given {len(given)} times for {len(tables)} tables; give one for each")
    seen = [] if len(tables) == len(traces) else [th.load(path) for path in traces if path not in tables]
    for path, watts, shift in zip(tables, power or [], detuning or [], strict=True):
        one = drop_table(path, columns, units)
        one.attrs = {
            "input_power": quantity.positive(watts, "W", name="--power"),
            "detuning": detuning_of(shift, resonator),
            "settled": settled,
        }
        seen.append(one)
    found = coupled.identify(
        resonator, seen, free=[name.strip() for name in free.split(",")], model=model_of(model)[0] if model else None,
        seed=seed, show_bar=watched(), held=deviations,
    )  # fmt: skip
    output.write_text(write_text(found.ring, dict.fromkeys(found.parameters, "identified")), encoding="utf-8")
    save_model(found.model, heat)
    if figure:
        from coupled.plot import plot_identification
        from thermofem.plot import save_figure

        save_figure(plot_identification(found)[0], figure)
    note_ring(resonator, ring)
    for name, value in found.parameters.items():
        say(f"{name:>22} = {written(value, parameter_unit(name), found.standard_deviations[name])}")
    resistance = written(float(found.model.thermal_resistance), "K/W", found.thermal_resistance_deviation)
    say(f"{'R_th':>22} = {resistance}")
    misfit = float(found.samples["misfit"].min())
    scale = "3e-5 of the period and 2e-4 of the swing" if found.smooth else "the noise"
    verdict = "the fit failed" if found.failed else "no noise in the traces" if found.smooth else "noise"
    say(f"{'misfit':>22} = {misfit:.3g} of {scale}: {verdict}")
    for k, (read, own) in enumerate(
        zip(found.residuals.period.values, found.residuals.period_model.values, strict=True)
    ):
        say(f"{f'period of trace {k}':>22} = {written(float(read), 's')}, of the model {written(float(own), 's')}")
    for line in leaning(found.sensitivities):
        say(f"{'held':>22} : {line}")
    for line in found.notes:
        note(line)
    wrote(output, heat, figure)
    return {
        "parameters": found.parameters,
        "standard_deviations": found.standard_deviations,
        "thermal_resistance": float(found.model.thermal_resistance),
        "thermal_resistance_deviation": found.thermal_resistance_deviation,
        "sensitivities": found.sensitivities,
        "misfit": misfit,
        "failed": found.failed,
        "passed": not found.failed,
        "notes": list(found.notes),
        "wrote": [path for path in (output, heat, figure) if path],
    }
