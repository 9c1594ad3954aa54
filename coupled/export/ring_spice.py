"""SPICE subcircuits of rings and circuits whole: light and carriers, heat, both joined, and the deck of a run.

Light enters and leaves as fields, 1 V = 1 sqrt(W), each as a pair of pins re and im; the inputs draw no current and the
outputs are ideal sources, so that light goes one way. 1 V at ``detuning`` is 1 GHz. Capacitors of 1 nF hold the field
in sqrt(fJ) and the carriers in 1e23/m^3: a current of 1 A is one unit per ns.

In a circuit a waveguide is a rotation,

    s_stop(t) = 10^(-loss/20) exp(-i (phase + 2 pi f delay)) s_start(t - delay)

with f the laser minus the circuit's reference frequency; a delay is two ideal lines, one for re and one for im.
"""

import math
from pathlib import Path
from typing import Any, NamedTuple

from thermofem import InputError
from thermofem.export.export_header import Target, comment, identifiers, plain_name, write_texts
from thermofem.export.fmi_unit import DURATION
from thermofem.export.poles import RCNetwork, rc_network
from thermofem.export.spice_heat import NOISE, WORDS, heat_subcircuit
from thermofem.models import ThermalModel

from ..circuit import Circuit
from ..kernel.rates import EPSILON
from ..kernel.units import NS
from ..resonator import RingResonator
from .ring_ports import Demonstration, RingPorts, lit_part, ring_network, ring_ports

RING_USAGE = (
    "SPICE subcircuits of a ring, for ngspice (LTspice and Xyce: not tested)",
    "fields in sqrt(W) as pairs re, im: in and add are inputs, through and drop ideal sources",
    "detuning, laser minus cold resonance: 1 V = 1 GHz; heat: 1 A is 1 W more into the core, 1 V is 1 K above ambient",
    "set .options method=trap reltol=1e-4 trtol=1 and a largest step of 1/400 of the period: periods within 3e-4;",
    "with reltol=1e-6 within 1e-4. Begin cold with PULSE(0 ...): a source that is on at t = 0 begins at a fixed point",
)
LIGHT_PINS = "in_re in_im add_re add_im through_re through_im drop_re drop_im detuning"  # pins of a ring


class Netlist(NamedTuple):
    """Text of an export: lines of comments, lines of subcircuits, and the deck of a run, "" for none."""

    comments: list[str]
    body: list[str]
    deck: str


def heated_by_light(light: str, mark: str, heated: str, read: str) -> list[str]:
    """Netlist lines that connect pin "heat" of the light's subcircuit to the pins ``heated`` and ``read``.

    light: the line with {} in place of the pin.
    """
    if heated == read:
        return [light.format(heated)]
    return [
        light.format(f"lit{mark}"),
        f"Vlit{mark} lit{mark} rise{mark} 0",
        f"Elit{mark} rise{mark} ambient {read} ambient 1",
        f"Flit{mark} ambient {heated} Vlit{mark} 1",
    ]


def light_subcircuit(name: str, ring: RingPorts) -> list[str]:
    """Subcircuit of light and carriers, as in `kernel.rates`, with the pins `LIGHT_PINS`, heat and ambient."""
    r = ring.rates
    square = f"(V(n)*V(n)+{EPSILON**2!r})"
    dispersion = "".join(
        f"-({c!r})*V(n)" + ("" if p == 1 else f"*pow({square},{(p - 1) / 2!r})") for c, p in ring.dispersion
    )
    recombination = f"{(r.b - r.a) / r.tau0!r}*V(n)*V(n)/(1+{r.a!r}*V(n))"  # besides n/tau0, which is Rn
    return [
        f".subckt {name} {LIGHT_PINS} heat ambient",
        "* field a: 1 V = 1 sqrt(fJ); carriers n: 1 V = 1e23/m^3; u: energy in fJ; d: rad/ns; g: 1/ns",
        *("Car ar 0 1n", "Cai ai 0 1n", "Cn n 0 1n"),
        *(f"Rar ar 0 {1 / r.loss!r}", f"Rai ai 0 {1 / r.loss!r}", f"Rn n 0 {r.tau0!r}"),
        "Bu u 0 V = V(ar)*V(ar)+V(ai)*V(ai)",
        f"Bd d 0 V = -({r.thermal_shift!r})*V(heat,ambient){dispersion}-({r.kerr!r})*V(u)-{2 * math.pi!r}*V(detuning)",
        f"Bg g 0 V = {r.fca!r}*V(n)+{r.tpa!r}*V(u)",
        f"Bar 0 ar I = -V(d)*V(ai)-V(g)*V(ar)-{ring.pump!r}*V(in_im)-{ring.add!r}*V(add_im)",
        f"Bai 0 ai I = V(d)*V(ar)-V(g)*V(ai)+{ring.pump!r}*V(in_re)+{ring.add!r}*V(add_re)",
        f"Bn 0 n I = {r.g!r}*V(u)*V(u)-({recombination})",
        f"Bheat ambient heat I = 2e-6*({r.absorbed!r}+V(g))*V(u)",
        f"Btr through_re 0 V = V(in_re)-{ring.through!r}*V(ai)",
        f"Bti through_im 0 V = V(in_im)+{ring.through!r}*V(ar)",
        f"Bdr drop_re 0 V = V(add_re)-{ring.drop!r}*V(ai)",
        f"Bdi drop_im 0 V = V(add_im)+{ring.drop!r}*V(ar)",
        f".ends {name}",
    ]


def deck(path: Path, run: Demonstration, step: float, wires: list[str], laser: str, outputs: dict[str, str]) -> str:
    """A SPICE deck that runs the subcircuit and writes a table: time in s, and the power at each output in W.

    step [s]: largest step.
    wires: netlist lines that connect the subcircuit.
    laser, outputs: the laser's pair of pins, and the pair of each column of the table; without _re and _im.
    """
    file = plain_name(path.name)
    table = f"{path.stem}_demo.csv"
    about = [
        f"{run.power * 1e3:.9g} mW at {run.detuning / 1e9:.9g} GHz from cold: ngspice -b {path.stem}_demo.cir",
        f"it writes {table}: time in s, power in W; largest step {step:.3g} s: {run.reason()}",
    ]
    powers = [
        f"B{k} power_{k} 0 V = V({pins}_re)*V({pins}_re)+V({pins}_im)*V({pins}_im)"
        for k, pins in enumerate(outputs.values(), 1)
    ]
    nodes = [f"power_{k}" for k in range(1, len(outputs) + 1)]
    return comment(about, "*") + "\n".join(
        [
            f".include {file}",
            f"Vre {laser}_re 0 PULSE(0 {math.sqrt(run.power)!r} 0 1p 1p 1 2)",
            f"Vim {laser}_im 0 0",
            f"Vdet detuning 0 {run.detuning / 1e9!r}",
            *wires,
            *powers,
            ".options method=trap reltol=1e-4 trtol=1",
            ".control",
            f"save {' '.join(nodes)}",
            f"tran {run.row()!r} {DURATION!r} 0 {step!r}",
            f"linearize {' '.join(nodes)}",
            "let rows = length(time)",
            "let i = 0",
            f'echo "{",".join(["time", *outputs])}" > {table}',
            "while i < rows",
            "  let t = time[i]",
            *(f"  let y{k} = {node}[i]" for k, node in enumerate(nodes, 1)),
            f'  echo "$&t,{",".join(f"$&y{k}" for k in range(1, len(nodes) + 1))}" >> {table}',
            "  let i = i + 1",
            "end",
            "quit",
            ".endc",
            ".end",
            "",
        ]
    )


def circuit_netlist(name: str, circuit: Circuit, model: Any, target: Target, run: Demonstration | None) -> Netlist:
    """Netlist of a circuit; ``model`` is that of each ring, or has an input for each.

    Raises InputError: several lasers, or a model of another number of rings.
    """
    if len(circuit.lasers) != 1:
        names = ", ".join(laser.name for laser in circuit.lasers)
        raise InputError(
            f"ring has the lasers {names}: SPICE takes a circuit of one laser, whose frame the fields have"
        )
    model = model.of_rings(circuit.names) if hasattr(model, "of_rings") else model
    net, laser = rc_network(model, taken=WORDS), circuit.lasers[0]
    ports = identifiers([laser.name, *circuit.outputs], taken=(*WORDS, "detuning"))
    heat, heat_pins, lit = _heat_of_rings(name, circuit, model, net, taken=(*WORDS, "detuning", *ports))
    reference = float(circuit.frequency or 0.0) + laser.offset
    kinds: dict[RingPorts, str] = {}
    rings = []
    for k, ring in enumerate(circuit.resonators):
        kind = kinds.setdefault(ring_ports(ring), f"{name}_light_{len(kinds) + 1}")
        nodes = f"e__{2 * k}", f"e__{2 * k + 1}", f"x__{2 * k}", f"x__{2 * k + 1}"
        waves = " ".join(f"{node}_{part}" for node in nodes for part in ("re", "im"))
        shift = (reference - ring.frequency) / 1e9
        rings += [f"Bdet__{k} det__{k} 0 V = V(detuning)+({shift!r})"]
        rings += heated_by_light(f"Xring__{k} {waves} det__{k} {{}} ambient {kind}", f"__{k}", *lit[k])
    body = []
    for kind_ports, kind in kinds.items():
        body += [*light_subcircuit(kind, kind_ports), ""]
    pins = " ".join([f"{port}_{part}" for port in ports for part in ("re", "im")] + ["detuning", *heat_pins])
    body += [*heat_subcircuit(f"{name}_heat", net), "", f".subckt {name} {pins} ambient", *rings, *heat]
    body += [*_waves(circuit, ports), f".ends {name}"]
    lines = [*RING_USAGE, f"in a netlist: X1 {pins} 0 {name}, where node 0 is the ambient", f"circuit: {circuit.name}"]
    demonstration = ""
    if run is not None:
        step = min(run.largest_step(each.rates) for each in kinds)
        outputs = dict(zip(ports[1:], ports[1:], strict=True))
        demonstration = deck(target.path, run, step, [f"X1 {pins} 0 {name}"], ports[0], outputs)
    return Netlist([*lines, "", *target.header], body, demonstration)


def _heat_of_rings(
    name: str, circuit: Circuit, model: Any, net: RCNetwork, *, taken: tuple[str, ...]
) -> tuple[list[str], list[str], list[tuple[str, str]]]:
    """Netlist lines and pins of the heat of all rings, and for each ring its pins (heated, read)."""
    rings = identifiers(circuit.names, taken=taken)
    count = len(rings)
    parts = net.parts
    if count > 1 and len(parts) > 1 and len(model.outputs) == count <= len(model.inputs):
        pin = dict(zip(parts, identifiers(parts, taken=(*taken, *rings)), strict=True))
        pin |= zip(model.inputs[:count], rings, strict=True)
        line = f"Xheat {' '.join(pin[part] for part in parts)} ambient {name}_heat"
        outputs = [pin[part] for part in model.outputs]
        return [line], list(pin.values()), list(zip(rings, outputs, strict=True))
    if len(model.inputs) > 1 and count > 1:
        raise InputError(
            f"model has {len(model.inputs)} inputs and {len(model.outputs)} outputs, the circuit {count} rings: one of "
            "each for every ring is needed (surrogate.reduce_array), or one model for all rings"
        )
    lines = []
    lit = []
    pins: list[str] = []
    for k, ring in enumerate(rings):
        heated, read = lit_part(model, circuit.resonators[k].read)
        pin = {part: ring if part == heated else f"{ring}_{word}" for part, word in zip(parts, net.pins, strict=True)}
        lines.append(f"Xheat__{k} {' '.join(pin.values())} ambient {name}_heat")
        pins += pin.values()
        lit.append((pin[heated], pin[read]))
    return lines, pins, lit


def _waves(circuit: Circuit, ports: list[str]) -> list[str]:
    """Netlist lines of splitters, of the laser's input, of waveguides, of dark entries (0 V) and of detectors.

    Each entry of a ring or splitter is a pair of nodes e__k, each exit x__k; ``ports`` names the laser and detectors.
    """
    laser = circuit.lasers[0]
    lines: list[str] = []
    entry = {terminal: f"e__{k}" for k, terminal in enumerate(circuit.entries)}
    exit = {terminal: f"x__{k}" for k, terminal in enumerate(circuit.exits)}
    for k, splitter in enumerate(circuit.splitters, len(circuit.names)):
        straight = math.sqrt(1 - splitter.cross)
        cross = math.sqrt(splitter.cross)
        first = 2 * k
        second = first + 1
        for through, crossing in ((first, second), (second, first)):
            out = f"x__{through}"
            re = f"{straight!r}*V(e__{through}_re)-{cross!r}*V(e__{crossing}_im)"
            im = f"{straight!r}*V(e__{through}_im)+{cross!r}*V(e__{crossing}_re)"
            lines += [f"B{out}_re {out}_re 0 V = {re}", f"B{out}_im {out}_im 0 V = {im}"]
    lines += _rotated(entry[laser.stop], ports[0], laser.loss, repr(float(laser.phase)))
    for k, w in enumerate(circuit.waveguides):
        start = exit[w.start]
        angle = repr(float(w.phase))
        if w.delay:
            for part in ("re", "im"):
                lines.append(f"T{part}__{k} {start}_{part} 0 far__{k}_{part} 0 Z0=1 TD={w.delay!r}")
                lines.append(f"R{part}__{k} far__{k}_{part} 0 1")
            start = f"far__{k}"
            angle += f"+{2 * math.pi * w.delay / NS!r}*(V(detuning)+({laser.offset / 1e9!r}))"
        lines += _rotated(entry[w.stop], start, w.loss, angle)
    lit = {laser.stop, *(w.stop for w in circuit.waveguides)}
    dark = [node for terminal, node in entry.items() if terminal not in lit]
    for node in dark:
        lines += [f"V{node}_re {node}_re 0 0", f"V{node}_im {node}_im 0 0"]
    for port, terminal in zip(ports[1:], circuit.outputs.values(), strict=True):
        node = exit[terminal]
        lines += [f"E{port}_re {port}_re 0 {node}_re 0 1", f"E{port}_im {port}_im 0 {node}_im 0 1"]
    return lines


def _rotated(out: str, start: str, loss: float, angle: str) -> list[str]:
    """Sources that make field ``out`` = 10^(-loss/20) exp(-i angle) times field ``start``; angle: expression in rad."""
    size = 10 ** (-loss / 20)
    re = f"V({start}_re)"
    im = f"V({start}_im)"
    return [
        f"B{out}_re {out}_re 0 V = {size!r}*(cos({angle})*{re}+sin({angle})*{im})",
        f"B{out}_im {out}_im 0 V = {size!r}*(cos({angle})*{im}-sin({angle})*{re})",
    ]


def write(ring: RingResonator | Circuit, model: ThermalModel, target: Target, run: Demonstration | None) -> Path:
    """Write the subcircuit named after the file, and the deck of a run beside it; see `coupled.export_ring`."""
    name = identifiers([target.path.stem], taken=WORDS)[0]
    if isinstance(ring, Circuit):
        netlist = circuit_netlist(name, ring, model, target, run)
    else:
        netlist = _netlist(name, ring, model, target, run)
    text = comment(netlist.comments, "*") + "\n" + "\n".join(netlist.body) + "\n"
    return write_texts(target.path, text, netlist.deck, ".cir")


def _netlist(name: str, ring: RingResonator, model: ThermalModel, target: Target, run: Demonstration | None) -> Netlist:
    """Netlist of one ring with its heat."""
    ports = ring_ports(ring)
    net, read = ring_network(model, ring.read, taken=(*WORDS, *LIGHT_PINS.split()))
    others = [pin for pin in net.pins if pin != "heat"]
    pins = " ".join([LIGHT_PINS, "heat", *others])
    noise = NOISE if net.shares is None else ()
    usage = f"in a netlist: X1 {pins} 0 {name}, where node 0 is the ambient"
    lines = [*RING_USAGE, *noise, usage, f"ring: {ring.name}", ""]
    body = [
        *light_subcircuit(f"{name}_light", ports),
        "",
        *heat_subcircuit(f"{name}_heat", net),
        "",
        f".subckt {name} {pins} ambient",
        *heated_by_light(f"Xlight {LIGHT_PINS} {{}} ambient {name}_light", "", "heat", read),
        f"Xheat {' '.join(net.pins)} ambient {name}_heat",
        f".ends {name}",
    ]
    demonstration = ""
    if run is not None:
        outputs = {ports.output_port: ports.output_port}
        dark = f"X1 in_re in_im 0 0 {LIGHT_PINS.split(' ', 4)[4]} {' '.join(['heat', *others])} 0 {name}"
        demonstration = deck(target.path, run, run.largest_step(ports.rates), [dark], "in", outputs)
    return Netlist([*lines, *target.header], body, demonstration)
