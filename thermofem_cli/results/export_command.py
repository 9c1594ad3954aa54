"""``thermofem export``: a model for circuit and system simulators, as matrices or as a table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from thermofem.errors import InputError

from .. import options
from ..command_files import check_outputs, expect
from ..console import wrote


def export(
    model: options.Model,
    to: Annotated[str, typer.Option(help="spice, verilog-a, fmu, mat or csv.")],
    fmi: Annotated[int, typer.Option(help="Version of FMI for fmu: 2 or 3.")] = 2,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="File to write; default: the model's name, with the ending of --to, if no other file has it.",
        ),
    ] = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
    verbose: options.Verbose = False,
    seed: options.Seed = 0,
    threads: options.Threads = None,
) -> dict[str, Any]:
    """Write a model for a circuit simulator (spice, verilog-a), a system simulator (fmu), as matrices or as a table."""
    import surrogate
    from surrogate.export import FORMATS
    from surrogate.export.header import is_export
    from thermofem import checks

    ending = FORMATS[checks.choice("--to", to, FORMATS)]
    expect(model, "model")
    loaded, provenance = surrogate.load_model(model), surrogate.load_provenance(model)
    target = output or model.with_suffix(ending)  # a folder such as "." has no name to put an ending to
    check_outputs([target], inputs=[model])
    if output is None and target.exists() and not is_export(target):
        raise InputError(f"{target} exists and is no export of thermofem; give -o and a name, this one to replace it")
    surrogate.export_model(loaded, target, to=to, provenance=provenance, fmi=fmi)
    wrote(target)
    return {"file": target, "to": to}
