"""Verilog-A declarations and statements of a thermal model: Pwr in W into the pins, Temp in K above the pin ambient."""

from typing import NamedTuple

from scipy.constants import Boltzmann

from thermofem.arrays import Array

from .poles import RCNetwork

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


class Statements(NamedTuple):
    """Lines of a module: its declarations, and the statements of its analog block."""

    declarations: list[str]
    analog: list[str]


def heat_statements(net: RCNetwork) -> Statements:
    """Declarations and statements of the poles: in series, or one node for each."""
    return _series(net) if net.shares is None else _coupled(net, net.shares)


def _store(k: int, R: float, C: float) -> str:
    """Verilog-A statement of pole k: the power into it is the flow through R and the storage in C."""
    return f"Pwr(pole__{k}) <+ Temp(pole__{k}) / {float(R)!r} + ddt({float(C)!r} * Temp(pole__{k}));"


def _fluctuation(k: int, R: float) -> str:
    """Verilog-A statement of the thermal fluctuations of pole k: power of the one-sided density 4 k_B T^2/R.

    $temperature is that of the simulated chip in K; the pole then has <dT^2> = k_B T^2/C (`thermofem.fluctuations`).
    """
    density = f"{4 * Boltzmann!r} * $temperature * $temperature / {float(R)!r}"
    return f'Pwr(pole__{k}) <+ white_noise({density}, "heat");'


def _series(net: RCNetwork) -> Statements:
    """Declarations and statements of the poles in series from the pin to the ambient."""
    nodes = [net.pins[0], *(f"node__{k}" for k in range(1, net.R.size)), "ambient"]
    inner = [f"thermal {', '.join(nodes[1:-1])};"] if net.R.size > 1 else []
    branches = [f"branch ({nodes[k]}, {nodes[k + 1]}) pole__{k + 1};" for k in range(net.R.size)]
    poles = [_store(k, R, C) for k, (R, C) in enumerate(zip(net.R, net.C, strict=True), start=1)]
    noise = [_fluctuation(k, R) for k, R in enumerate(net.R, start=1) if R > 0]
    return Statements([*inner, *branches], [*poles, *noise])


def _coupled(net: RCNetwork, shares: Array) -> Statements:
    """Declarations and statements of one node for each pole, coupled to power and temperature of the pins."""
    count = range(1, net.R.size + 1)
    lines = [f"thermal {', '.join(f'node__{k}' for k in count)};"]
    lines += [f"branch (node__{k}, ambient) pole__{k};" for k in count]
    lines += [f"branch ({pin}, ambient) pin__{i};" for i, pin in enumerate(net.pins)]
    declarations = [*lines, f"real {', '.join(f'z__{i}' for i in net.read)};"]
    lines = []
    for k, (R, C) in enumerate(zip(net.R, net.C, strict=True), start=1):
        lines.append(_store(k, R, C))
        for pin, share in zip(net.heated, shares[k - 1], strict=True):
            if share:
                lines.append(f"Pwr(pole__{k}) <+ -({float(share)!r} * Pwr(pin__{pin}));")
    for i, _ in enumerate(net.pins):
        reads = net.read_by(i)
        if reads is None:  # heated, but not read: it stays at 0 K
            lines.append(f"Temp(pin__{i}) <+ 0;")
        else:
            used = [(k, share) for k, share in enumerate(reads, start=1) if share]
            rise = " + ".join(f"{float(share)!r} * Temp(pole__{k})" for k, share in used) or "0"
            square = f" + ({net.coefficient!r}) * z__{i} * z__{i}" if net.coefficient else ""
            lines += [f"z__{i} = {rise};", f"Temp(pin__{i}) <+ z__{i}{square};"]
    return Statements(declarations, lines)
