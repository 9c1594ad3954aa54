"""Writers of a thermal model for circuit and system simulators: SPICE, Verilog-A, FMI unit, matrices, table of poles.

Each is a function ``write(model, target)`` of a `Format` in `surrogate.export`. Matrices are in SI:
E dx/dt = A x + B P, dT = C x. A Quadratic adds H and G as `thermofem.Quadratic` has them; an output map adds its
coefficient.
"""

import csv
import io
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat

from thermofem import Foster, InputError, Quadratic, StateSpace
from thermofem.data.files import write_whole
from thermofem.export import spice_heat, verilog_a_heat
from thermofem.export.export_header import Target, comment, identifiers, write_texts
from thermofem.export.fmi_unit import Source, c_compiler, pole_numbers, write_unit
from thermofem.export.poles import poles_of, rc_network
from thermofem.models.cauer import cauer

USAGE = (
    "SPICE subcircuit: 1 A into a pin is 1 W of heat, 1 V is 1 K above the pin ambient",
    "set .options reltol=1e-6 trtol=1 to keep the simulator's own error below 1e-4",
)


def write_spice(model: Any, target: Target) -> Path:
    """Write the SPICE subcircuit named after the file; where it is passive, also as a Cauer ladder."""
    name = identifiers([target.path.stem], taken=spice_heat.WORDS)[0]
    network = rc_network(model, taken=spice_heat.WORDS)
    pins = " ".join(network.pins) if len(network.pins) <= 8 else "PINS"
    use = f"in a netlist: X1 {pins} 0 {name}, where node 0 is the ambient"
    body = spice_heat.heat_subcircuit(name, network)
    about = [*USAGE, use]
    poles = Foster(network.R, network.R * network.C)
    if network.shares is None and poles.passive:
        try:
            steps = cauer(poles)
            body += ["", *spice_heat.ladder(f"{name}_cauer", network.pins[0], steps.R, steps.C, foster=False)]
            ladder = f"{name}_cauer the same impedance as a Cauer ladder"
        except InputError as error:
            ladder = f"without a Cauer ladder: {error}"
        about = [*USAGE, *spice_heat.NOISE, use, f"{name} is a Foster network, {ladder}"]
    header = comment([*about, "", *target.header], "*")
    return write_texts(target.path, header + "\n" + "\n".join(body) + "\n", "", "")


def write_verilog_a(model: Any, target: Target) -> Path:
    """Write the Verilog-A module named after the file: thermal pins, Pwr in W, Temp in K above the pin ambient."""
    words = verilog_a_heat.KEYWORDS
    name = identifiers([target.path.stem], taken=words)[0]
    network = rc_network(model, taken=(*words, name))
    heat = verilog_a_heat.heat_statements(network)
    pins = ", ".join([*network.pins, "ambient"])
    module = [
        '`include "disciplines.vams"',
        "",
        f"module {name}({pins});",
        f"  inout {pins};",
        f"  thermal {pins};",
        *(f"  {line}" for line in heat.declarations),
        "  analog begin",
        *(f"    {line}" for line in heat.analog),
        "  end",
        "endmodule",
    ]
    return write_texts(target.path, comment(target.header, "//") + "\n" + "\n".join(module) + "\n", "", "")


def write_fmu(model: Any, target: Target) -> Path:
    """Write the FMI unit in C; co-simulation advances its poles exactly."""
    poles = poles_of(model)
    numbers = pole_numbers(poles, poles.inputs[0], poles.outputs[0])
    law = files(__package__).joinpath("heat_unit.c").read_text(encoding="utf-8")
    constants = f"#define FIRST 0\n#define HEAT 0\n{numbers}"
    return write_unit(target, poles, Source(constants, law, c_compiler()))


def write_mat(model: Any, target: Target) -> Path:
    """Write A, B, C, E and the names of inputs and outputs."""
    if isinstance(model, StateSpace):
        matrices = {"E": model.E, "A": model.A, "B": model.B, "C": model.C}
    elif isinstance(model, Quadratic):
        matrices = {"E": np.eye(model.order), "A": model.A, "B": model.B[:, None], "C": model.C[None]}
        matrices |= {"H": model.H, "G": model.G}
    else:
        poles = poles_of(model)
        matrices = {"E": np.eye(poles.rate.size), "A": -np.diag(poles.rate), "B": poles.B, "C": poles.C}
        if poles.coefficient:
            matrices["coefficient"] = poles.coefficient
    words = {"inputs": list(model.inputs), "outputs": list(model.outputs), "header": "\n".join(target.header)}
    content = matrices | words
    return write_whole(target.path, lambda p: savemat(str(p), content, appendmat=False, do_compression=True))


def write_csv(model: Any, target: Target) -> Path:
    """Write the columns ``tau (s)`` and ``R READ from HEATED (K/W)``."""
    poles = poles_of(model)
    text = io.StringIO()
    text.write(comment(target.header, "#"))
    if poles.coefficient:
        text.write(f"# rise: z + ({poles.coefficient!r} /K) z^2, where z is what the poles add up to\n")
    table = csv.writer(text, lineterminator="\n")
    columns = [f"R {read} from {heated} (K/W)" for read in poles.outputs for heated in poles.inputs]
    table.writerow(["tau (s)", *columns])
    for rate, reads, drives in zip(poles.rate, poles.C.T, poles.B, strict=True):
        gains = np.outer(reads, drives) / rate
        table.writerow([repr(float(number)) for number in (1 / rate, *gains.flat)])
    return write_whole(target.path, lambda p: p.write_text(text.getvalue(), encoding="utf-8"))
