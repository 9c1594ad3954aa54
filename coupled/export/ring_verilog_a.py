"""Verilog-A module of a ring whole, with its light, carriers and heat, and a netlist of VACASK that runs it.

Light enters and leaves as fields, 1 V = 1 sqrt(W), each as a pair of pins re and im; 1 V at ``detuning`` is 1 GHz. The
field in sqrt(fJ) and the carriers in 1e23/m^3 are nodes of disciplines of their own, so that a simulator knows their
tolerances.
"""

import math
from pathlib import Path

from thermofem.export.export_header import Target, comment, identifiers, plain_name, write_texts
from thermofem.export.fmi_unit import DURATION
from thermofem.export.verilog_a_heat import KEYWORDS, heat_statements
from thermofem.models import ThermalModel

from ..kernel.rates import EPSILON
from ..resonator import RingResonator
from .ring_ports import Demonstration, RingPorts, ring_network, ring_ports

LIGHT_PINS = ("in_re", "in_im", "add_re", "add_im", "through_re", "through_im", "drop_re", "drop_im", "detuning")
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


def write(ring: RingResonator, model: ThermalModel, target: Target, run: Demonstration | None) -> Path:
    """Write the module named after the file, and a netlist of VACASK beside it; see `coupled.export_ring`."""
    name = identifiers([target.path.stem], taken=KEYWORDS)[0]
    net, read = ring_network(model, ring.read, taken=(*KEYWORDS, *LIGHT_PINS, *NAMES, name))
    ports = ring_ports(ring)
    heat = heat_statements(net)
    electrical = ", ".join(LIGHT_PINS)
    thermal = ", ".join([*net.pins, "ambient"])
    body = [f"    {line}" for line in [*_light(ports, read), *heat.analog]]
    module = [
        '`include "disciplines.vams"',
        *DISCIPLINES,
        "",
        f"module {name}({electrical}, {thermal});",
        f"  inout {electrical}, {thermal};",
        f"  electrical {electrical};",
        f"  thermal {thermal};",
        *(f"  {line}" for line in heat.declarations),
        "  lightfield a_re, a_im;",
        "  carrierdensity carriers;",
        "  branch (heat, ambient) lit;",
        "  real ar, ai, n, u, d, g;",
        "  analog begin",
        *body,
        "  end",
        "endmodule",
    ]
    header = comment([*RING_USAGE, f"ring: {ring.name}", "", *target.header], "//")
    text = "\n".join([header, *module, ""])
    deck = ""
    if run is not None:
        wires = {"in_re": "re", "in_im": "im", "add_re": "0", "add_im": "0"}
        pins = [wires.get(pin, pin) for pin in (*LIGHT_PINS, *net.pins)]
        deck = _netlist(name, target.path, run, ports, pins)
    return write_texts(target.path, text, deck, ".sim")


def _light(ring: RingPorts, read: str) -> list[str]:
    """Statements of light and carriers; the equations stand in `kernel.rates`."""
    r = ring.rates
    dispersion = "".join(
        f" - ({c!r}) * n" + ("" if p == 1 else f" * pow(n * n + {EPSILON**2!r}, {(p - 1) / 2!r})")
        for c, p in ring.dispersion
    )
    turn = f"{2 * math.pi!r} * V(detuning)"
    return [
        "ar = Amp(a_re);",
        "ai = Amp(a_im);",
        "n = Dens(carriers);",
        "u = ar * ar + ai * ai;",
        f"d = -({r.thermal_shift!r}) * Temp({read}, ambient){dispersion} - ({r.kerr!r}) * u - {turn};",
        f"g = {r.loss!r} + {r.fca!r} * n + {r.tpa!r} * u;",
        f"Amprate(a_re) <+ ddt(1e-9 * ar) + g * ar + d * ai + {ring.pump!r} * V(in_im) + {ring.add!r} * V(add_im);",
        f"Amprate(a_im) <+ ddt(1e-9 * ai) + g * ai - d * ar - {ring.pump!r} * V(in_re) - {ring.add!r} * V(add_re);",
        f"Densrate(carriers) <+ ddt(1e-9 * n) + n * (1.0 + {r.b!r} * n) / ({r.tau0!r} * (1.0 + {r.a!r} * n))"
        f" - {r.g!r} * u * u;",
        f"Pwr(lit) <+ -2e-6 * ({r.absorbed!r} + {r.fca!r} * n + {r.tpa!r} * u) * u;",
        f"V(through_re) <+ V(in_re) - {ring.through!r} * ai;",
        f"V(through_im) <+ V(in_im) + {ring.through!r} * ar;",
        f"V(drop_re) <+ V(add_re) - {ring.drop!r} * ai;",
        f"V(drop_im) <+ V(add_im) + {ring.drop!r} * ar;",
    ]


def _netlist(name: str, path: Path, run: Demonstration, ports: RingPorts, pins: list[str]) -> str:
    """A netlist of VACASK that runs the module from cold."""
    step = run.largest_step(ports.rates)
    port = ports.output_port
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
