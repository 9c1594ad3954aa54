"""``thermofem simulate`` and ``cosimulate``: a ring driven with a thermal model, or with the FEM in the loop."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .. import options
from ..console import say, time_bar, working

if TYPE_CHECKING:
    import xarray as xr

    import thermofem as th
    from coupled.runs.pulsing import Pulsing


def simulate(
    context: typer.Context,
    model: options.Model,
    power: str = "8 dBm",
    detuning: str = "0 GHz",
    duration: options.Quantity = "20 us",
    rtol: float = 1e-6,
    ring: str = options.REFERENCE_RING,
    heated: str | None = None,
    read: str | None = None,
    heater: list[str] | None = None,
    sweep: str | None = None,
    modulate: list[str] | None = None,
    laser: list[str] | None = None,
    figure: Path | None = None,
    output: options.Output = Path("traces.nc"),
) -> dict[str, Any]:
    """Drive a ring with a thermal model: traces, and whether and how it pulses.

    Options
    -------
    sweep: Detunings (or powers) to go through at a constant rate, '20 GHz, -40 GHz, 20 GHz', over the whole run.
    modulate: Adds to power or detuning: '1 mW square 1 us', '1 mW pulse 10 ns at 5 us' or '2 GHz sine 1 MHz'.
    laser: A further laser, POWER DETUNING [on OFFSET]: '1 mW 4 GHz' beats with the first; '1 uW -5 GHz on 1.5 THz'
        is near the resonance 1.5 THz above. Repeatable.
    heater: Power, voltage or current of another part (heater where it has no name): 'heater=5 mW', '1.2 V',
        'heater=5 mW square 1 us duty 0.3' or 'heater=5 mW pulse 1 us at 2 us'.
    """
    import coupled
    import thermofem as th

    from ..inputs.command_files import model_of, note_ring, ring_of
    from ..inputs.drive_texts import amount_of, reading
    from ..inputs.ring_drives import LASER_INPUTS, heater_powers, lasers, light

    if sweep is not None:
        unit, _ = amount_of("--sweep", sweep.split(",")[0], *LASER_INPUTS)
        swept = LASER_INPUTS[unit]
        options.unused(context, f"has no effect with a --sweep of the {swept}", swept)
    powers = heater_powers(heater, duration)
    thermal, parts = model_of(model, heated, read, powers)
    resonator = ring_of(ring)
    driven = light(resonator, power, detuning, sweep, modulate, duration)
    others = lasers(laser, resonator, duration)
    settings: dict[str, Any] = {"duration": duration, "heaters": powers, "lasers": others, **parts, **driven}
    with time_bar("integrating", duration) as progress:
        run = coupled.simulate(resonator, thermal, rtol=rtol, progress=progress, **settings)
    with working("judging and writing the run"), reading(f"--duration = {context.params['duration']}"):
        found = coupled.pulsing(run)
        th.save(run, output)
    if figure:
        from coupled.plot import plot_sweep, plot_traces
        from thermofem.plot import save_figure

        save_figure(plot_sweep(run) if sweep else plot_traces(run), figure)
    note_ring(resonator, ring)
    numbers = say_pulsing(found, run)
    if others:
        numbers |= {"lasers": 1 + len(others), "probes": _probes(run)}
    return {**numbers, "traces": output, "figure": figure}


def _probes(run: xr.Dataset) -> list[dict[str, float]]:
    """Print and return frequency (Hz) and range of drop power (W) of other resonances, in the second half of a run."""
    if "resonance" not in run.variables:
        return []
    late = run["time"].values >= run["time"].values[-1] / 2
    found = []
    for at, drop in zip(run["resonance"].values, run["probe_drop"].values, strict=True):
        low = float(drop[late].min())
        high = float(drop[late].max())
        say(f"resonance at {at / 1e12:.4f} THz: drop power from {low * 1e3:.4g} to {high * 1e3:.4g} mW")
        found.append({"resonance": float(at), "drop_low": low, "drop_high": high})
    return found


def say_pulsing(found: Pulsing, run: xr.Dataset) -> dict[str, Any]:
    """Print and return regime, period, duty and swing of a trace; if it does not pulse, print its last values."""
    say(f"{found.regime}: {found.reason}")
    if found.regime == "self-pulsing":
        say(f"period {found.period * 1e9:.1f} ns, duty {found.duty:.3g}, swing {found.swing:.2f} K")
    else:
        port = "drop" if run["drop"].values.any() else "through"  # a ring on one bus has no drop port
        say(f"at the end {port} power {float(run[port][-1]) * 1e3:.4g} mW, rise {float(run['delta_T'][-1]):.4g} K")
    numbers = {name: getattr(found, name) for name in ("period", "duty", "swing")}
    return {"regime": str(found.regime), "reason": found.reason, **numbers}


def cosimulate(
    context: typer.Context,
    geometry: options.Geometry = None,
    power: options.Quantity = "8 dBm",
    detuning: str = "0 GHz",
    duration: options.Quantity = "20 us",
    ring: str = options.REFERENCE_RING,
    heater: list[str] | None = None,
    predictor: Annotated[
        str | None, typer.Option(metavar="MODEL", help="Model (JSON) that predicts, or none; default: a reduction.")
    ] = None,
    max_discrepancy: str = "1 mK",
    accuracy: float = 1e-3,
    rtol: float = 1e-6,
    field_times: list[str] | None = None,
    paraview: Path | None = None,
    figure: Path | None = None,
    output: options.Output = Path("cosimulation.nc"),
) -> dict[str, Any]:
    """Drive a ring with the FEM itself in the loop: traces, and whether and how it pulses.

    Options
    -------
    power: [W >= 0] Power in the bus waveguide.
    max_discrepancy: Discrepancy left between light and FEM.
    heater: Power, voltage or current of another part (heater where it has no name): 'heater=5 mW', '1.2 V',
        'heater=5 mW square 1 us duty 0.3' or 'heater=5 mW pulse 1 us at 2 us'.
    """
    import coupled
    import thermofem as th
    from thermofem import InputError, checks
    from thermofem.data import quantity

    from ..inputs.command_files import note_ring, ring_of, section_of
    from ..inputs.drive_texts import reading, times_of
    from ..inputs.ring_drives import detuning_of, heater_powers

    resonator = ring_of(ring)
    settings: dict[str, Any] = {
        "power": power,
        "detuning": detuning_of(detuning, resonator),
        "max_discrepancy": quantity.positive_rise(max_discrepancy, name="--max-discrepancy"),
        "heaters": heater_powers(heater, duration),
        "field_times": times_of(field_times),
        "predictor": _predictor(predictor),
    }
    if paraview and not settings["field_times"]:
        raise InputError("--paraview writes the fields that are kept; say which with --field-times '1 us, 5 us'")
    if paraview:
        th.fields.field_file(paraview, len(settings["field_times"]))
    section = section_of(geometry)
    for name in settings["heaters"]:
        checks.choice("--heater", name, section.heated)
    with working("meshing and assembling"):
        heat = th.assemble(section, accuracy)
    with time_bar(f"{heat.unknowns} temperatures in the loop", duration) as progress:
        run = coupled.cosimulate(resonator, heat, duration=duration, rtol=rtol, progress=progress, **settings)
    with working("judging and writing the run"), reading(f"--duration = {context.params['duration']}"):
        found = coupled.pulsing(run)
        th.save(run, output)
    if paraview:
        th.fields.write_fields(run, paraview)
    if figure:
        from coupled.plot import plot_traces
        from thermofem.plot import save_figure

        save_figure(plot_traces(run), figure)
    note_ring(resonator, ring)
    numbers = say_pulsing(found, run)
    a = run.attrs
    say(
        f"{a['windows']} windows, {a['passes']} passes, largest discrepancy {a['largest_discrepancy'] * 1e3:.2g} mK, "
        f"heat imbalance {a['heat_imbalance']:.0e}"
    )
    seconds = a["cpu_optics"] + a["cpu_corrector"]
    say(f"{a['fem_solves']} solves with {a['fem_unknowns']} unknowns, {seconds:.2g} s of CPU time")
    files = [path for path in (output, paraview, figure) if path]
    costs = ("windows", "passes", "largest_discrepancy", "heat_imbalance", "fem_solves", "fem_unknowns")
    return {**numbers, **{name: a[name] for name in costs}, "wrote": files}


def _predictor(given: str | None) -> th.models.ThermalModel | None:
    from coupled.loop.cosimulate import NO_PREDICTOR
    from thermofem.models import load_model

    from ..inputs.command_files import expect

    if given is None or given == "none":
        return NO_PREDICTOR if given else None
    expect(Path(given), "model")
    return load_model(given)
