"""Verilog-A module of the heat of a ring: pins of the thermal discipline, Pwr in W, Temp in K above the pin ambient."""

from pathlib import Path
from typing import Any

from thermofem.export.export_header import Target, comment, identifiers, write_texts
from thermofem.export.poles import rc_network
from thermofem.export.verilog_a_heat import KEYWORDS, heat_statements


def write(model: Any, target: Target) -> Path:
    """Write the module named after the file; see `surrogate.export_model`."""
    name = identifiers([target.path.stem], taken=KEYWORDS)[0]
    net = rc_network(model, taken=(*KEYWORDS, name))
    heat = heat_statements(net)
    listed = ", ".join([*net.pins, "ambient"])
    module = [
        '`include "disciplines.vams"',
        "",
        f"module {name}({listed});",
        f"  inout {listed};",
        f"  thermal {listed};",
        *(f"  {line}" for line in heat.declarations),
        "  analog begin",
        *(f"    {line}" for line in heat.analog),
        "  end",
        "endmodule",
    ]
    return write_texts(target.path, comment(target.header, "//") + "\n" + "\n".join(module) + "\n", "", "")
