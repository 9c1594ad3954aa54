"""Verilog-A module with the thermal discipline: Pwr in W into the pins, Temp in K above the pin ambient."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from thermofem.data.files import write_whole

from .circuit import PoleCircuit, network
from .header import comment, identifiers

# reserved words of Verilog-AMS, none of which may name a pin
KEYWORDS = tuple(
    """above abs absdelay absdelta access acos acosh ac_stim aliasparam always ambient analog analysis and asin asinh
    assert assign atan atan2 atanh automatic begin branch buf bufif0 bufif1 case casex casez ceil cell cmos config
    connect connectmodule connectrules continuous cos cosh cross ddt ddt_nature ddx deassign default defparam design
    disable discipline discrete domain driver_update edge else end endcase endconfig endconnectrules enddiscipline
    endfunction endgenerate endmodule endnature endparamset endprimitive endspecify endtable endtask event exclude exp
    final_step flicker_noise floor flow for force forever fork from function generate genvar ground highz0 highz1
    hypot idt idtmod idt_nature if ifnone incdir include inf initial initial_step inout input instance integer join
    laplace_nd laplace_np laplace_zd laplace_zp large last_crossing liblist library limexp ln localparam log
    macromodule max medium merged min module nand nature negedge net_resolution nmos noise_table nor
    noshowcancelled not notif0 notif1 or output parameter paramset pmos posedge potential pow primitive pull0 pull1
    pulldown pullup rcmos real realtime reg release repeat resolveto rnmos rpmos rtran rtranif0 rtranif1 scalared sin
    sinh slew small specify specparam split sqrt string strong0 strong1 supply0 supply1 table tan tanh task temp
    thermal time timer tran tranif0 tranif1 transition tri tri0 tri1 triand trior trireg units unsigned use vectored
    wait wand weak0 weak1 while white_noise wire wor wreal xnor xor zi_nd zi_np zi_zd zi_zp pwr""".split()  # noqa: SIM905 - as a list, two hundred quotes more
)


def write(model: Any, path: Path, header: list[str]) -> Path:
    """Write the module named after the file; see `surrogate.export_model`."""
    name = identifiers([path.stem], taken=KEYWORDS)[0]
    net = network(model, taken=(*KEYWORDS, name))
    pins = ", ".join([*net.pins, "ambient"])
    body = _foster(net) if net.turns is None else _coupled(net, net.turns)
    lines = [
        '`include "disciplines.vams"',
        "",
        f"module {name}({pins});",
        f"  inout {pins};",
        f"  thermal {pins};",
        *(f"  {line}" for line in body),
        "endmodule",
    ]
    text = comment(header, "//") + "\n" + "\n".join(lines) + "\n"
    return write_whole(path, lambda p: p.write_text(text, encoding="ascii"))


def _store(k: int, R: float, C: float) -> str:
    """Heat through R and into C of one pole."""
    return f"  Pwr(pole__{k}) <+ Temp(pole__{k}) / {float(R)!r} + ddt({float(C)!r} * Temp(pole__{k}));"


def _foster(net: PoleCircuit) -> list[str]:
    """The poles in series from the pin to the ambient."""
    nodes = [net.pins[0], *(f"node__{k}" for k in range(1, net.R.size)), "ambient"]
    inner = [f"thermal {', '.join(nodes[1:-1])};"] if net.R.size > 1 else []
    branches = [f"branch ({nodes[k]}, {nodes[k + 1]}) pole__{k + 1};" for k in range(net.R.size)]
    poles = [_store(k, R, C) for k, (R, C) in enumerate(zip(net.R, net.C, strict=True), start=1)]
    return [*inner, *branches, "analog begin", *poles, "end"]


def _coupled(net: PoleCircuit, turns: np.ndarray) -> list[str]:
    """One node for each pole, which takes its share of the power into the pins and adds its share to their Temp."""
    count = range(1, net.R.size + 1)
    lines = [f"thermal {', '.join(f'node__{k}' for k in count)};"]
    lines += [f"branch (node__{k}, ambient) pole__{k};" for k in count]
    lines += [f"branch ({pin}, ambient) pin__{i};" for i, pin in enumerate(net.pins)]
    lines += [f"real {', '.join(f'z__{i}' for i in net.read)};", "analog begin"]
    for k, (R, C) in enumerate(zip(net.R, net.C, strict=True), start=1):
        lines.append(_store(k, R, C))
        for i, at in enumerate(net.heated):
            if turns[k - 1, i]:
                lines.append(f"  Pwr(pole__{k}) <+ -({float(turns[k - 1, i])!r} * Pwr(pin__{at}));")
    for i, _ in enumerate(net.pins):
        shares = net.read_by(i)
        if shares is None:  # heated, but not read: it stays at 0 K
            lines.append(f"  Temp(pin__{i}) <+ 0;")
        else:
            used = [(k, share) for k, share in enumerate(shares, start=1) if share]
            rise = " + ".join(f"{float(share)!r} * Temp(pole__{k})" for k, share in used) or "0"
            square = f" + ({net.coefficient!r}) * z__{i} * z__{i}" if net.coefficient else ""
            lines += [f"  z__{i} = {rise};", f"  Temp(pin__{i}) <+ z__{i}{square};"]
    return [*lines, "end"]
