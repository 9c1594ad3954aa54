"""FMI unit of the heat of a ring, in C; co-simulation advances its poles exactly."""

from pathlib import Path
from typing import Any

from thermofem.export.fmi_unit import Source, pole_numbers, shared_source, write_unit
from thermofem.export.formats import Target
from thermofem.export.poles import poles_of


def write(model: Any, target: Target) -> Path:
    """Write the unit; see `surrogate.export_model`."""
    poles = poles_of(model)
    numbers = pole_numbers(poles, poles.inputs[0], poles.outputs[0])
    text = "\n".join(["#define LIGHT 0", numbers, shared_source("unit.c")])
    return write_unit(target, poles, Source(text))
