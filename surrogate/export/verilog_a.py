"""Verilog-A module: the heat of a ring, or a ring whole with its light and carriers.

Heat has the thermal discipline: Pwr in W into the pins, Temp in K above the pin ambient. Light enters and leaves as
fields, 1 V = 1 sqrt(W), each as a pair of pins re and im; 1 V at ``detuning`` is 1 GHz. The field in sqrt(fJ) and the
carriers in 1e23/m^3 are nodes of disciplines of their own, so that a simulator knows their tolerances.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
from scipy.constants import Boltzmann

from .export_header import comment, identifiers, plain_name, write_texts
from .poles import RCNetwork, rc_network, ring_network
from .ring_rates import DURATION, EPSILON, Demonstration, RingRates, ring_rates

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


LIGHT = ("in_re", "in_im", "add_re", "add_im", "through_re", "through_im", "drop_re", "drop_im", "detuning")
NAMES = ("ar", "ai", "n", "u", "d", "g", "a_re", "a_im", "carriers", "lit")  # of a ring's module
RING_USAGE = (
    "Verilog-A module of a ring, for VACASK and other simulators with OpenVAF",
    "fields in sqrt(W) as pairs re, im: in and add are inputs, through and drop ideal sources",
    "detuning, laser minus cold resonance: 1 V = 1 GHz; heat: W into the core, K above the pin ambient",
    "set reltol=1e-4 and a largest step of 1/400 of the period in VACASK: periods within 2e-4",
)
DISCIPLINES = """nature Field_amplitude
  units = "sqrt(fJ)";
  access = Amp;
  abstol = 1e-6;
endnature
nature Field_rate
  units = "sqrt(fJ)/ns";
  access = Amprate;
  abstol = 1e-6;
endnature
discipline lightfield
  domain continuous;
  potential Field_amplitude;
  flow Field_rate;
enddiscipline
nature Carrier_density
  units = "1e23/m^3";
  access = Dens;
  abstol = 1e-7;
endnature
nature Carrier_rate
  units = "1e23/m^3/ns";
  access = Densrate;
  abstol = 1e-7;
endnature
discipline carrierdensity
  domain continuous;
  potential Carrier_density;
  flow Carrier_rate;
enddiscipline
""".splitlines()


def write(model: Any, path: Path, header: list[str], ring: Any = None, run: Demonstration | None = None) -> Path:
    """Write the module named after the file, and a netlist of VACASK beside it; see `surrogate.export_model`."""
    name, deck = identifiers([path.stem], taken=KEYWORDS)[0], ""
    if ring is None:
        net = rc_network(model, taken=(*KEYWORDS, name))
        light = []
        thermal = net.pins
        signals = []
        disciplines = []
        lines = header
    else:
        net, read = ring_network(model, ring.read, taken=(*KEYWORDS, *LIGHT, *NAMES, name))
        rates = ring_rates(ring)
        signals = list(LIGHT)
        disciplines = DISCIPLINES
        thermal, light = net.pins, _light(rates, read)
        lines = [*RING_USAGE, f"ring: {ring.name}", "", *header]
        if run is not None:
            pins = [{"in_re": "re", "in_im": "im"}.get(pin, "0" if pin[:3] == "add" else pin) for pin in LIGHT]
            deck = _netlist(name, path, run, rates, [*pins, *thermal])
    declarations, statements = _foster(net) if net.shares is None else _coupled(net, net.shares)
    listed = ", ".join([*signals, *thermal, "ambient"])
    module = [
        '`include "disciplines.vams"',
        *disciplines,
        "",
        f"module {name}({listed});",
        f"  inout {listed};",
        *([f"  electrical {', '.join(signals)};"] if signals else []),
        f"  thermal {', '.join([*thermal, 'ambient'])};",
        *(f"  {line}" for line in declarations),
        *(("  lightfield a_re, a_im;", "  carrierdensity carriers;") if light else ()),
        *(("  branch (heat, ambient) lit;", "  real ar, ai, n, u, d, g;") if light else ()),
        "  analog begin",
        *(f"    {line}" for line in [*light, *statements]),
        "  end",
        "endmodule",
    ]
    return write_texts(path, comment(lines, "//") + "\n" + "\n".join(module) + "\n", deck, ".sim")


def _light(r: RingRates, read: str) -> list[str]:
    """Statements of light and carriers; the equations stand in `ring_rates`."""
    dispersion = "".join(
        f" - ({c!r}) * n" + ("" if p == 1 else f" * pow(n * n + {EPSILON**2!r}, {(p - 1) / 2!r})")
        for c, p in r.dispersion
    )
    turn = f"{2 * math.pi!r} * V(detuning)"
    return [
        "ar = Amp(a_re);",
        "ai = Amp(a_im);",
        "n = Dens(carriers);",
        "u = ar * ar + ai * ai;",
        f"d = -({r.thermal_shift!r}) * Temp({read}, ambient){dispersion} - ({r.kerr!r}) * u - {turn};",
        f"g = {r.loss!r} + {r.fca!r} * n + {r.tpa!r} * u;",
        f"Amprate(a_re) <+ ddt(1e-9 * ar) + g * ar + d * ai + {r.pump!r} * V(in_im) + {r.add!r} * V(add_im);",
        f"Amprate(a_im) <+ ddt(1e-9 * ai) + g * ai - d * ar - {r.pump!r} * V(in_re) - {r.add!r} * V(add_re);",
        f"Densrate(carriers) <+ ddt(1e-9 * n) + n * (1.0 + {r.b!r} * n) / ({r.tau0!r} * (1.0 + {r.a!r} * n))"
        f" - {r.g!r} * u * u;",
        f"Pwr(lit) <+ -2e-6 * ({r.absorbed!r} + {r.fca!r} * n + {r.tpa!r} * u) * u;",
        f"V(through_re) <+ V(in_re) - {r.through!r} * ai;",
        f"V(through_im) <+ V(in_im) + {r.through!r} * ar;",
        f"V(drop_re) <+ V(add_re) - {r.drop!r} * ai;",
        f"V(drop_im) <+ V(add_im) + {r.drop!r} * ar;",
    ]


def _netlist(name: str, path: Path, run: Demonstration, rates: RingRates, pins: list[str]) -> str:
    """A netlist of VACASK that runs the module from cold."""
    step, port = run.largest_step(rates), rates.output_port
    file = plain_name(path.name)
    demo = f"{path.stem}_demo"
    return "\n".join(
        [
            f"{run.power * 1e3:.9g} mW at {run.detuning / 1e9:.9g} GHz from cold",  # the first line is a title
            f"// vacask {demo}.sim compiles {file} with openvaf-r and writes {demo}.raw: {port}_re, {port}_im in W^0.5",
            f"// largest step {step:.3g} s: {run.reason()}",
            "ground 0",
            f'load "{file}"',
            f"model {name} {name}",
            "model vsource vsource",
            f'vre (re 0) vsource type="pulse" val0=0 val1={math.sqrt(run.power)!r} delay=0 rise=1p fall=1p width=1',
            "vim (im 0) vsource dc=0",
            f"vdet (detuning 0) vsource dc={run.detuning / 1e9!r}",
            f"x1 ({' '.join([*pins, '0'])}) {name}",
            "control",
            "  options reltol=1e-4",
            f"  save v({port}_re) v({port}_im)",
            f"  analysis {demo} tran step=1p stop={DURATION!r} maxstep={step!r}",
            "endc",
            "",
        ]
    )


def _store(k: int, R: float, C: float) -> str:
    """Verilog-A statement of pole k: the power into it is the flow through R and the storage in C."""
    return f"Pwr(pole__{k}) <+ Temp(pole__{k}) / {float(R)!r} + ddt({float(C)!r} * Temp(pole__{k}));"


def _fluctuation(k: int, R: float) -> str:
    """Verilog-A statement of the thermal fluctuations of pole k: power of the one-sided density 4 k_B T^2/R.

    $temperature is that of the simulated chip in K; the pole then has <dT^2> = k_B T^2/C (`thermofem.fluctuations`).
    """
    density = f"{4 * Boltzmann!r} * $temperature * $temperature / {float(R)!r}"
    return f'Pwr(pole__{k}) <+ white_noise({density}, "heat");'


def _foster(net: RCNetwork) -> tuple[list[str], list[str]]:
    """Declarations and statements of the poles in series from the pin to the ambient."""
    nodes = [net.pins[0], *(f"node__{k}" for k in range(1, net.R.size)), "ambient"]
    inner = [f"thermal {', '.join(nodes[1:-1])};"] if net.R.size > 1 else []
    branches = [f"branch ({nodes[k]}, {nodes[k + 1]}) pole__{k + 1};" for k in range(net.R.size)]
    poles = [_store(k, R, C) for k, (R, C) in enumerate(zip(net.R, net.C, strict=True), start=1)]
    noise = [_fluctuation(k, R) for k, R in enumerate(net.R, start=1) if R > 0]
    return [*inner, *branches], [*poles, *noise]


def _coupled(net: RCNetwork, shares: np.ndarray) -> tuple[list[str], list[str]]:
    """Declarations and statements of one node for each pole, coupled to power and temperature of the pins."""
    count = range(1, net.R.size + 1)
    lines = [f"thermal {', '.join(f'node__{k}' for k in count)};"]
    lines += [f"branch (node__{k}, ambient) pole__{k};" for k in count]
    lines += [f"branch ({pin}, ambient) pin__{i};" for i, pin in enumerate(net.pins)]
    declarations = [*lines, f"real {', '.join(f'z__{i}' for i in net.read)};"]
    lines = []
    for k, (R, C) in enumerate(zip(net.R, net.C, strict=True), start=1):
        lines.append(_store(k, R, C))
        for i, at in enumerate(net.heated):
            if shares[k - 1, i]:
                lines.append(f"Pwr(pole__{k}) <+ -({float(shares[k - 1, i])!r} * Pwr(pin__{at}));")
    for i, _ in enumerate(net.pins):
        reads = net.read_by(i)
        if reads is None:  # heated, but not read: it stays at 0 K
            lines.append(f"Temp(pin__{i}) <+ 0;")
        else:
            used = [(k, share) for k, share in enumerate(reads, start=1) if share]
            rise = " + ".join(f"{float(share)!r} * Temp(pole__{k})" for k, share in used) or "0"
            square = f" + ({net.coefficient!r}) * z__{i} * z__{i}" if net.coefficient else ""
            lines += [f"z__{i} = {rise};", f"Temp(pin__{i}) <+ z__{i}{square};"]
    return declarations, lines
