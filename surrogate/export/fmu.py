"""FMI unit of the heat of a ring, in C; co-simulation advances its poles exactly."""

from importlib.resources import files
from pathlib import Path
from typing import Any

from thermofem.export.export_header import Target
from thermofem.export.fmi_unit import Source, c_compiler, pole_numbers, write_unit
from thermofem.export.poles import poles_of


def write(model: Any, target: Target) -> Path:
    """Write the unit; see `surrogate.export_model`."""
    poles = poles_of(model)
    numbers = pole_numbers(poles, poles.inputs[0], poles.outputs[0])
    law = files(__package__).joinpath("heat_unit.c").read_text(encoding="utf-8")
    constants = f"#define FIRST 0\n#define HEAT 0\n{numbers}"
    return write_unit(target, poles, Source(constants, law, c_compiler()))
