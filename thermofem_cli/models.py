"""``thermofem reduce | validate | simulate``: geometries to models, models to error curves and traces."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from thermofem import checks
from thermofem.data.files import IMAGES

from . import drives, options
from .bar import Bar
from .files import DEFAULT_RING, check_outputs, model_of, one_channel, ring_of, say_ring, section_of
from .kinds import expect
from .output import say, show, working

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr
    from numpy.typing import NDArray


def reduce(
    geometry: options.Geometry = None,
    tolerance: Annotated[float, typer.Option(help="Error of Z(f) over R_th, kept at every frequency.")] = 1e-4,
    accuracy: options.Accuracy = 1e-3,
    heated: Annotated[
        str | None, typer.Option(help="Inputs, the ring first: 'core, heater'; default: the ring.")
    ] = None,
    read: Annotated[
        str | None, typer.Option(help="Outputs: 'core, neighbour', parts and probes; default: the first input.")
    ] = None,
    output: options.Output = Path("model.json"),
) -> dict[str, Any]:
    """Reduce the FEM of a geometry to a certified handful of poles and write them as JSON."""
    import numpy as np

    import surrogate
    from thermofem.fem import assemble

    check_outputs([output])
    expect(geometry, "geometry")
    section = section_of(geometry)
    with working("meshing, assembling and reducing"):
        heat = assemble(section, accuracy)
        names = [name.strip() for name in heated.split(",")] if heated else [heat.heated[0]]
        for name in names:
            checks.choice("--heated", name, heat.heated)
        outputs = [name.strip() for name in read.split(",")] if read else names[:1]
        for name in outputs:
            checks.choice("--read", name, heat.readable)
        rom = surrogate.reduce(heat.channels(names, outputs), tolerance=tolerance)
    provenance = {**rom.provenance, "geometry": section.to_toml(), "mesh_accuracy": accuracy}
    surrogate.save_model(rom.model, output, provenance=provenance)
    say(f"{heat.unknowns} unknowns -> {rom.order} poles, error of Z(f) below {rom.error_bound:.1e} of R_th everywhere")
    single = (len(names), len(outputs)) == (1, 1)
    static = [[rom.model.thermal_resistance]] if single else np.asarray(rom.model.gain)
    for to, row in zip(outputs, static, strict=True):
        for name, R in zip(names, row, strict=True):
            say(f"R_th = {R / 1e3:.4g} K/mW" + ("" if single else f" from {name} to {to}"))
    say(f"wrote {output}")
    return {
        "unknowns": heat.unknowns,
        "poles": rom.order,
        "error_bound": rom.error_bound,
        "heated": names,
        "read": outputs,
        "thermal_resistance": float(static[0][0]) if single else np.asarray(static).tolist(),
        "model": output,
    }


def validate(
    inputs: Annotated[list[Path], typer.Argument(metavar="GEOMETRY.toml | MODELS.json...", help="What to judge.")],
    reference: Annotated[Path | None, typer.Option(help="What models are judged by: a model (JSON).")] = None,
    power: Annotated[str, typer.Option(help="Power of the square wave.")] = "2 mW",
    duty: Annotated[float, typer.Option(help="Its duty cycle.")] = 1 / 3,
    shortest: Annotated[str, typer.Option(help="Shortest period.")] = "0.1 us",
    longest: Annotated[str, typer.Option(help="Longest period.")] = "10 us",
    accuracy: options.GeometryAccuracy = 1e-3,
    heated: options.Heated = None,
    read: options.Read = None,
    figure: options.Figure = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Curves (.nc); for a geometry also the figure (.png).")
    ] = None,
) -> dict[str, Any]:
    """Judge models by their period error (Section 6 of the paper): over which periods can each be trusted?

    Given a geometry, the usual kinds of model are trained on it and judged by its FEM, with k(T) at the power asked;
    given models, those.
    """
    import numpy as np

    from thermofem.data import quantity

    ends = [
        quantity.positive(text, "s", name=name) for name, text in (("--shortest", shortest), ("--longest", longest))
    ]
    if ends[0] >= ends[1]:
        raise checks.InputError(f"--shortest = {shortest} must be below --longest = {longest}")
    checks.between("--duty", duty, 0, 1, hint="the duty cycle is the fraction of the period that is on")
    periods, watts = np.geomspace(ends[0], ends[1], 41), quantity.positive(power, "W", name="--power")
    if any(path.suffix.lower() == ".toml" for path in inputs):
        if len(inputs) > 1 or reference:
            raise checks.InputError("validate takes one geometry alone; models with --reference, without a geometry")
        curves = output if output and output.suffix.lower() == ".nc" else None
        figures = [path for path in (figure, output) if path and path != curves]
        figures = figures if figures or curves else [Path("period_error.png")]
        settings: dict[str, Any] = {"periods": periods, "power": watts, "duty": duty, "heated": heated, "read": read}
        return _validate_geometry(inputs[0], figures, curves, accuracy=accuracy, **settings)
    if reference is None:
        raise checks.InputError("models are judged by a --reference, e.g. from `reduce`; or give one geometry (.toml)")
    load = lambda path: one_channel(path, heated, read)  # noqa: E731
    return _validate_models(inputs, reference, load, output or Path("period_error.nc"), figure, periods, watts, duty)


def _validate_models(
    models: list[Path],
    reference: Path,
    load: Callable[[Path], Any],
    output: Path,
    figure: Path | None,
    periods: NDArray[np.float64],
    watts: float,
    duty: float,
) -> dict[str, Any]:
    """Curves of models from files."""
    import surrogate

    check_outputs([output, figure], images=[figure])
    if output.suffix.lower() in IMAGES:
        raise checks.InputError(f"--output = {output} takes the curves (.nc); --figure {output} draws them")
    for path in (*models, reference):
        expect(path, "model")
    names = [path.stem for path in models]
    checks.unique("MODELS", names, hint="curves are named after the files")
    judge, curves = load(reference), {}
    for name, path in zip(names, models, strict=True):
        curves[name] = surrogate.period_error(load(path), judge, periods, power=watts, duty=duty)
        say(f"{name}: {curves[name].attrs['validity']}")
    _save_curves(curves, output)
    if figure:
        _draw_curves(curves, figure)
    say(f"wrote {output}" + (f" and {figure}" if figure else ""))
    return {"models": {name: _judged(curve) for name, curve in curves.items()}, "curves": output, "figure": figure}


def _save_curves(curves: Mapping[str, xr.Dataset], path: Path) -> None:
    """Write the curves of several models over a dimension ``model``."""
    import xarray as xr

    from thermofem.data import dataset

    joined = xr.concat(list(curves.values()), dim="model", combine_attrs="drop_conflicts")
    dataset.save(joined.assign_coords(model=list(curves)), path)


def _judged(curve: xr.Dataset) -> dict[str, Any]:
    """Largest error of a model, and the periods (s) over which it is within 1 and 10 %."""
    import numpy as np

    import surrogate

    error = np.abs(curve["relative_error"].values)
    ranges = {f"within_{share:g}": list(surrogate.valid_range(curve, within=share)) for share in (0.01, 0.1)}
    return {"largest_error": float(error.max()) if np.isfinite(error).all() else None, **ranges}


def _validate_geometry(
    path: Path, figures: list[Path], curves: Path | None, *, power: float, duty: float, **settings: Any
) -> dict[str, Any]:
    """Train the usual kinds of model on a geometry: figures, a table, and the curves where wanted."""
    from thermofem.geometry import CrossSection

    from .validate import advice, judge, table

    check_outputs([*figures, curves], images=figures)
    expect(path, "geometry")
    geometry = CrossSection.from_toml(path)
    with working("solving, training models, judging"):
        found = judge(geometry, power=power, duty=duty, **settings)
    by = "its FEM" if found.power is None else "its FEM with k(T)"
    of = f"{geometry.name}: square waves of {power * 1e3:g} mW, {duty:.0%} duty, against {by}"
    for figure in figures:
        _draw_curves(found.curves, figure, of)
    if curves:
        _save_curves(found.curves, curves)
    show(table(found, of))
    lines = advice(found)
    for line in lines:
        say(line)
    say(f"wrote {' and '.join(map(str, [*figures, *([curves] if curves else [])]))}")
    return {
        "models": {name: _judged(curve) for name, curve in found.curves.items()},
        "refused": dict(found.refused),
        "advice": lines,
        "figures": figures,
        "curves": curves,
    }


def _draw_curves(curves: Mapping[str, xr.Dataset], figure: Path, of: str = "") -> None:
    """Draw the period errors of several models under the title ``of``."""
    from surrogate.plot import plot_period_errors
    from thermofem.plot import save_figure

    save_figure(plot_period_errors(curves, title=of)[0], figure)


def simulate(
    model: options.Model,
    power: options.Power = "8 dBm",
    detuning: options.Detuning = "0 GHz",
    duration: options.Duration = "20 us",
    rtol: Annotated[float, typer.Option(help="Relative error of a step.")] = 1e-6,
    ring: options.Ring = DEFAULT_RING,
    channel: options.Channel = None,
    heated: options.Heated = None,
    read: options.Read = None,
    heater: Annotated[list[str] | None, typer.Option(help=drives.HEATER)] = None,
    sweep: Annotated[str | None, typer.Option(help=drives.SWEEP)] = None,
    modulate: Annotated[list[str] | None, typer.Option(help=drives.MODULATE)] = None,
    laser: Annotated[list[str] | None, typer.Option(help=drives.LASER)] = None,
    figure: options.Figure = None,
    output: options.Output = Path("traces.nc"),
) -> dict[str, Any]:
    """Drive a ring with a thermal model: traces, and whether and how it pulses."""
    import coupled
    from thermofem.data import dataset, quantity

    check_outputs([output, figure], images=[figure])
    expect(model, "model")
    length = quantity.positive(duration, "s", name="--duration")
    powers = drives.heaters(heater or [], length)
    thermal, parts = model_of(model, *drives.channel(channel, heated, read), powers)
    resonator = ring_of(ring)
    light, swept = drives.light(resonator, power, detuning, sweep, modulate or [], length)
    others = drives.lasers(laser or [], resonator, length)
    settings: dict[str, Any] = {"duration": length, "heaters": powers, "lasers": others, **parts, **light}
    say_ring(resonator, ring)
    first = "the first run on a machine compiles for some seconds"
    with Bar("integrating", settings["duration"], first=first) as progress:
        run = coupled.simulate.record(resonator, thermal, rtol=rtol, progress=progress, **settings)
    with working(f"judging the run and writing {output}"):
        found = verdict(run, duration)
        dataset.save(run, output)
    if figure:
        from coupled.plot.runs import plot_sweep, plot_traces
        from thermofem.plot import save_figure

        traced = run
        save_figure(plot_sweep(traced) if swept else plot_traces(traced), figure)
    say_pulsing(found)
    probes = _probes(run)
    for one in probes:
        low, high = (f"{one[name] * 1e3:.4g}" for name in ("drop_low", "drop_high"))
        say(f"resonance at {one['resonance'] / 1e12:.4f} THz: drop power from {low} to {high} mW")
    say(f"wrote {output}" + (f" and {figure}" if figure else ""))
    numbers = {"lasers": 1 + len(others), "probes": probes} if others else {}
    return {**pulsing_numbers(found), **numbers, "traces": output, "figure": figure}


def _probes(run: Any) -> list[dict[str, float]]:
    """Frequency (Hz) of the other resonances, and their drop power (W) in the second half of a run."""
    if "resonance" not in run.variables:
        return []
    late = run["time"].values >= run["time"].values[-1] / 2
    return [
        {"resonance": float(at), "drop_low": float(drop[late].min()), "drop_high": float(drop[late].max())}
        for at, drop in zip(run["resonance"].values, run["probe_drop"].values, strict=True)
    ]


def verdict(run: Any, duration: str) -> Any:
    """Classify a run by `coupled.pulsing`; InputError where it has too few steps."""
    from coupled.runs.pulsing import FEWEST, pulsing

    steps = run["time"].values.size - 1
    if steps + 1 < FEWEST:
        raise checks.InputError(
            f"--duration = {duration} is over after {steps} steps, too few for a cycle; make it longer"
        )
    return pulsing(run)


def say_pulsing(found: Any) -> None:
    """Regime and cycle of a trace in words."""
    say(f"{found.regime}: {found.reason}")
    if found.regime == "self-pulsing":
        say(f"period {found.period * 1e9:.1f} ns, duty {found.duty:.3f}, swing {found.swing:.2f} K")


def pulsing_numbers(found: Any) -> dict[str, Any]:
    """Regime and cycle of a trace."""
    numbers = {name: getattr(found, name) for name in ("period", "duty", "swing")}
    return {"regime": str(found.regime), "reason": found.reason, **numbers}
