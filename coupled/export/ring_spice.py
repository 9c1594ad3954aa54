"""SPICE subcircuits of a ring whole: its light and carriers, its heat, and both joined."""

from pathlib import Path

from thermofem.export.export_header import comment, identifiers, write_texts
from thermofem.export.formats import Target
from thermofem.export.spice_heat import NOISE, WORDS, heat_subcircuit
from thermofem.models import ThermalModel

from ..circuit import Circuit
from ..resonator import RingResonator
from . import circuit_spice
from .lit_part import ring_network
from .ring_ports import Demonstration, ring_ports
from .spice_light import LIGHT, RING_USAGE, Netlist, deck, heated_by_light, light_subcircuit


def write(ring: RingResonator | Circuit, model: ThermalModel, target: Target, run: Demonstration | None) -> Path:
    """Write the subcircuit named after the file, and the deck of a run beside it; see `coupled.export_ring`."""
    name = identifiers([target.path.stem], taken=WORDS)[0]
    if isinstance(ring, Circuit):
        netlist = circuit_spice.netlist(name, ring, model, target, run)
    else:
        netlist = _netlist(name, ring, model, target, run)
    text = comment(netlist.comments, "*") + "\n" + "\n".join(netlist.body) + "\n"
    return write_texts(target.path, text, netlist.deck, ".cir")


def _netlist(name: str, ring: RingResonator, model: ThermalModel, target: Target, run: Demonstration | None) -> Netlist:
    """Netlist of one ring with its heat."""
    ports = ring_ports(ring)
    net, read = ring_network(model, ring.read, taken=(*WORDS, *LIGHT.split()))
    others = [pin for pin in net.pins if pin != "heat"]
    pins = " ".join([LIGHT, "heat", *others])
    noise = NOISE if net.shares is None else ()
    usage = f"in a netlist: X1 {pins} 0 {name}, where node 0 is the ambient"
    lines = [*RING_USAGE, *noise, usage, f"ring: {ring.name}", ""]
    body = [
        *light_subcircuit(f"{name}_light", ports),
        "",
        *heat_subcircuit(f"{name}_heat", net),
        "",
        f".subckt {name} {pins} ambient",
        *heated_by_light(f"Xlight {LIGHT} {{}} ambient {name}_light", "", "heat", read),
        f"Xheat {' '.join(net.pins)} ambient {name}_heat",
        f".ends {name}",
    ]
    demonstration = ""
    if run is not None:
        outputs = {ports.output_port: ports.output_port}
        dark = f"X1 in_re in_im 0 0 {LIGHT.split(' ', 4)[4]} {' '.join(['heat', *others])} 0 {name}"
        demonstration = deck(target.path, run, run.largest_step(ports.rates), [dark], "in", outputs)
    return Netlist([*lines, *target.header], body, demonstration)
