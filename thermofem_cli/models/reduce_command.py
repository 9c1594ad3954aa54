"""``thermofem reduce``: geometry in, certified reduced model out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

import thermofem as th
from thermofem import checks

from .. import options
from ..command_files import check_outputs, section_of
from ..console import say, working, wrote


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
    json: options.Json = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
    seed: options.Seed = 0,
    threads: options.Threads = None,
) -> dict[str, Any]:
    """Reduce the FEM of a geometry to a certified handful of poles and write them as JSON."""
    import numpy as np

    import surrogate

    check_outputs([output], inputs=[geometry])
    section = section_of(geometry)
    with working("meshing, assembling and reducing"):
        heat = th.assemble(section, accuracy)
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
    wrote(output)
    return {
        "unknowns": heat.unknowns,
        "poles": rom.order,
        "error_bound": rom.error_bound,
        "heated": names,
        "read": outputs,
        "thermal_resistance": float(static[0][0]) if single else np.asarray(static).tolist(),
        "model": output,
    }
