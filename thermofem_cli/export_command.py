"""``thermofem export``: a model, or a ring whole, for circuit and system simulators; matrices; a table of poles."""

from pathlib import Path
from typing import Annotated, Any

import typer

from . import options
from .console import note, working

OUTPUT = "File to write; default: the model's name, with the ending of --to, if no other file has it."


def export(
    context: typer.Context,
    model: options.Model,
    to: str | None = None,
    ring: Annotated[str | None, typer.Option(help=f"{options.RING}: write its light and carriers, too.")] = None,
    circuit: Path | None = None,
    power: options.Quantity = None,
    detuning: str = "0 GHz",
    fmi: int = 2,
    platforms: str = "",
    output: Annotated[Path | None, typer.Option("--output", "-o", help=OUTPUT)] = None,
) -> dict[str, Any]:
    """Write a model or a ring for a circuit simulator (spice, verilog-a) or a system simulator (fmu), or as numbers.

    Options
    -------
    to: Format, such as spice or fmu; a wrong one gets the list.
    circuit: Circuit file (TOML) in place of --ring, for spice.
    power: [W >= 0] Also write a run from cold with this power in the bus.
    fmi: Version of FMI for fmu: 2 or 3.
    platforms: Libraries in a unit: 'linux, windows, macos, macos-arm, linux-arm'; default: this platform.
    """
    import coupled
    import surrogate
    import thermofem as th
    from coupled.export import export_ring as rings
    from surrogate.export import FORMATS
    from thermofem import InputError, checks
    from thermofem.export.export_header import is_export

    from .inputs.command_files import expect, ring_of
    from .inputs.ring_drives import detuning_of

    if to is None:
        raise InputError(f"--to is missing: the format, one of {', '.join(FORMATS)}")
    ending = FORMATS[checks.choice("--to", to, FORMATS)].ending
    expect(model, "model")
    if ring and circuit:
        raise InputError(f"--ring {ring} and --circuit {circuit} exclude each other; a circuit file has its rings")
    if power is None:
        options.unused(context, "is of the run that --power writes", "detuning")
    loaded = surrogate.load_model(model)
    shared: dict[str, Any] = {"to": to, "provenance": th.models.load_provenance(model), "fmi": fmi}
    shared["platforms"] = list(filter(None, options.listed(platforms)))
    target = output or model.with_suffix(ending)  # a folder such as "." has no name to put an ending to
    demo = None
    if power is not None and (ring or circuit):
        demonstration = rings.FORMATS[checks.choice("--to of a ring", to, rings.FORMATS)].demonstration
        demo = target.with_name(f"{target.stem}_demo{demonstration}")
    options.check_outputs([target, demo], inputs=[model, ring, circuit])
    if output is None and target.exists() and not is_export(target):
        raise InputError(f"{target} exists and is no export of thermofem; give -o and a name, this one to replace it")
    light = ring_of(ring) if ring else coupled.Circuit.from_toml(circuit) if circuit else None
    period: float | None = None
    if light is None:
        if power is not None:
            raise InputError(f"--power {power:g} W is that of a ring's laser; give --ring or --circuit, too")
        surrogate.export_model(loaded, target, **shared)
    elif power is None:
        coupled.export_ring(light, loaded, target, **shared)
    else:
        resonators = light.resonators if isinstance(light, coupled.Circuit) else (light,)
        hertz = detuning_of(detuning, resonators[0])  # of a circuit pm are those of the first ring
        if isinstance(light, coupled.RingResonator):
            with working("settled period"):
                period = _period(light, loaded, power, hertz)
        coupled.export_ring(light, loaded, target, power=power, detuning=hertz, period=period, **shared)
    return {"file": target, "demo": demo, "to": to, "period": period}


def _period(ring: Any, model: Any, power: float, detuning: float) -> float | None:
    """Return the settled period in s; None, with a message, where the ring does not pulse."""
    import coupled
    from coupled.export.ring_ports import lit_channel
    from thermofem import InputError

    channel = lit_channel(model, ring.read)
    try:
        return float(coupled.limit_cycle(ring, channel, power=power, detuning=detuning).attrs["period"])
    except InputError as error:
        note(
            "the ring is quiet at this power and detuning, which is normal; the largest step then follows from the "
            f"carriers' lifetime ({error})"
        )
        return None
