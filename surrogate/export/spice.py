"""SPICE subcircuit of the heat of a ring; where it is passive, also as a Cauer ladder."""

from pathlib import Path
from typing import Any

from thermofem import Foster, InputError
from thermofem.export.export_header import Target, comment, identifiers, write_texts
from thermofem.export.poles import rc_network
from thermofem.export.spice_heat import NOISE, WORDS, heat_subcircuit, ladder
from thermofem.models.cauer import cauer

USAGE = (
    "SPICE subcircuit: 1 A into a pin is 1 W of heat, 1 V is 1 K above the pin ambient",
    "set .options reltol=1e-6 trtol=1 to keep the simulator's own error below 1e-4",
)


def write(model: Any, target: Target) -> Path:
    """Write the subcircuit named after the file; see `surrogate.export_model`."""
    name = identifiers([target.path.stem], taken=WORDS)[0]
    net = rc_network(model, taken=WORDS)
    pins = " ".join(net.pins) if len(net.pins) <= 8 else "PINS"
    lines = [*USAGE, f"in a netlist: X1 {pins} 0 {name}, where node 0 is the ambient", "", *target.header]
    body = heat_subcircuit(name, net)
    poles = Foster(net.R, net.R * net.C)
    if net.shares is None and poles.passive:
        lines[2:2] = NOISE
        try:
            steps = cauer(poles)
            body += ["", *ladder(f"{name}_cauer", net.pins[0], steps.R, steps.C, foster=False)]
            lines.insert(5, f"{name} is a Foster network, {name}_cauer the same impedance as a Cauer ladder")
        except InputError as error:
            lines.insert(5, f"{name} is a Foster network, without a Cauer ladder: {error}")
    return write_texts(target.path, comment(lines, "*") + "\n" + "\n".join(body) + "\n", "", "")
