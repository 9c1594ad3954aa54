"""``thermofem identify``: parameters of a ring from measured drop traces."""

from pathlib import Path
from typing import Annotated, Any

import typer

from .. import options
from ..console import note, say_fitted, say_row, watched, written

TRACES = "Drop over time: netCDF of `thermofem simulate`, or a table, one for each power and detuning."


def identify(
    traces: Annotated[list[Path], typer.Argument(metavar="TRACE...", help=TRACES)],
    free: str = "kappa, tau_f, tau_s, eta",
    ring: str = options.REFERENCE_RING,
    model: Path | None = None,
    power: list[str] | None = None,
    detuning: list[str] | None = None,
    columns: str = "1,2",
    units: str | None = None,
    settled: bool = False,
    held: list[str] | None = None,
    figure: Path | None = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Ring file (TOML) to write.")] = Path(
        "identified.toml"
    ),
    seed: options.Seed = 1,
) -> dict[str, Any]:
    """Find parameters of a ring, its carriers and its heat from drop traces at known power and detuning.

    The thermal model is written beside the ring file, with the ending .json.

    Options
    -------
    free: Names of the free parameters.
    model: Thermal model (JSON) to start from; default: the paper's.
    power: Power in the bus waveguide, of each table.
    detuning: Laser minus cold resonance, of each table.
    columns: Numbers of the columns of time and drop in tables.
    units: Units of both, 'us,mV' or 'us,dBm'; any but W, mW, dBm frees the scale.
    settled: The light was on long before the tables begin.
    """
    import coupled
    import thermofem as th
    from coupled.identification.held_numbers import leaning
    from coupled.ring_toml import write_text
    from thermofem.data import files, quantity
    from thermofem.errors import InputError
    from thermofem.models import save_model

    from ..inputs.command_files import model_of, note_ring, ring_of
    from ..inputs.light_tables import drop_table, held_of
    from ..inputs.ring_drives import detuning_of

    for path in traces:
        files.regular(path)
    heat = output.with_suffix(".json")
    options.check_outputs([output, heat], inputs=[*traces, model])
    resonator = ring_of(ring)
    deviations = held_of(resonator, held)
    tables = [path for path in traces if path.suffix != ".nc"]
    for option, values in (("--power", power or []), ("--detuning", detuning or [])):
        if len(values) != len(tables):
            raise InputError(f"{option} is given {len(values)} times for {len(tables)} tables; give one for each")
    measured = [] if len(tables) == len(traces) else [th.load(path) for path in traces if path not in tables]
    for path, watts, shift in zip(tables, power or [], detuning or [], strict=True):
        trace = drop_table(path, columns, units)
        trace.attrs = {
            "input_power": quantity.positive(watts, "W", name="--power"),
            "detuning": detuning_of(shift, resonator),
            "settled": settled,
        }
        measured.append(trace)
    start = model_of(model)[0] if model else None
    result = coupled.identify(
        resonator, measured, free=options.listed(free), model=start, seed=seed, show_bar=watched(), held=deviations
    )
    output.write_text(write_text(result.ring, dict.fromkeys(result.parameters, "identified")), encoding="utf-8")
    names = ", ".join(path.name for path in traces)
    save_model(result.model, heat, provenance={"source": f"drop traces {names}, by thermofem identify"})
    if figure:
        from coupled.plot import plot_identification
        from thermofem.plot import save_figure

        save_figure(plot_identification(result)[0], figure)
    note_ring(resonator, ring)
    say_fitted(result)
    R_th = float(result.model.thermal_resistance)
    say_row("R_th", written(R_th, "K/W", result.thermal_resistance_deviation))
    misfit = float(result.samples["misfit"].min())
    scale = "3e-5 of the period and 2e-4 of the swing" if result.smooth else "the noise"
    verdict = "the fit failed" if result.failed else "no noise in the traces" if result.smooth else "noise"
    say_row("misfit", f"{misfit:.3g} of {scale}: {verdict}")
    of_data = result.residuals.period.values.tolist()
    of_model = result.residuals.period_model.values.tolist()
    for k, (period, modelled) in enumerate(zip(of_data, of_model, strict=True)):
        say_row(f"period of trace {k}", f"{written(period, 's')}, of the model {written(modelled, 's')}")
    for line in leaning(result.sensitivities):
        say_row("held", line, ":")
    for line in result.notes:
        note(line)
    return {
        "parameters": result.parameters,
        "standard_deviations": result.standard_deviations,
        "thermal_resistance": R_th,
        "thermal_resistance_deviation": result.thermal_resistance_deviation,
        "sensitivities": result.sensitivities,
        "misfit": misfit,
        "failed": result.failed,
        "passed": not result.failed,
        "notes": list(result.notes),
        "wrote": [path for path in (output, heat, figure) if path],
    }
