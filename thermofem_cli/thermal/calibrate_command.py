"""``thermofem calibrate``: the ring of a family that explains thermal traces best."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated, Any

import typer

import thermofem as th
from thermofem.data import quantity
from thermofem.errors import InputError

from .. import options
from ..command_files import about, expect, kind_of
from ..console import say, working, written
from .family_options import units_of


def calibrate(
    file: options.Family,
    data: Annotated[list[Path], typer.Argument(help="Measured or simulated thermal traces (netCDF).")],
    noise: Annotated[
        str | None, typer.Option(help="Standard deviation of a sample, e.g. '10 mK'; a number alone is in K.")
    ] = None,
) -> dict[str, Any]:
    """Find the ring of a family that explains thermal traces best, with standard errors."""
    import surrogate

    spread = None if noise is None else _noise(noise)
    found = surrogate.load_family(file)
    for path in data:
        if kind_of(path) == "table":
            raise InputError(
                f"{path} holds a table of numbers, not data (netCDF); convert it in Python: "
                f"thermofem.save(thermofem.read_trace({str(path)!r}, ...), {str(path.with_suffix('.nc'))!r})"
            )
        expect(path, "data")
    with working("fitting"), about(data):
        result = surrogate.calibrate(found, [th.load(path) for path in data], noise=spread)
    for name, unit in units_of(found).items():
        value, error = result.values[name], result.standard_errors[name]
        say(f"{name} = {written(value, unit, error)}" + (" (end of its range)" if name in result.active else ""))
    say(f"residual {result.residual:.3g} K rms, correlation of neighbouring residuals {result.correlation:.2f}")
    for text in result.unseen:
        say(f"not determined by the data: {text}")
    say(f"± contains the noise only; on its own mesh the family is off by {result.certified.error:.1e}")
    return {
        "values": result.values,
        "standard_errors": result.standard_errors,
        "residual": result.residual,
        "correlation": result.correlation,
        "error": result.certified.error,
        "unseen": list(result.unseen),
        "active": list(result.active),
    }


def _noise(text: str) -> float:
    """--noise in K: a quantity, or a number alone."""
    with contextlib.suppress(ValueError):
        text = f"{float(text)!r} K"
    return quantity.positive_rise(text, name="--noise")
