"""SPICE subcircuit of a circuit of rings: light along waveguides, heat between neighbours.

A waveguide is a rotation,

    s_stop(t) = 10^(-loss/20) exp(-i (phase + 2 pi f delay)) s_start(t - delay)

with f the laser minus the circuit's reference frequency; a delay is two ideal lines, one for re and one for im.
"""

import math
from typing import Any

from thermofem import InputError
from thermofem.export.export_header import identifiers
from thermofem.export.formats import Target
from thermofem.export.poles import RCNetwork, rc_network
from thermofem.export.spice_heat import WORDS, heat_subcircuit

from ..circuit import Circuit
from ..kernel.units import NS
from .lit_part import lit_part
from .ring_ports import Demonstration, RingPorts, ring_ports
from .spice_light import RING_USAGE, Netlist, deck, heated_by_light, light_subcircuit


def netlist(name: str, circuit: Circuit, model: Any, target: Target, run: Demonstration | None) -> Netlist:
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
    count, parts = len(rings), net.parts
    if count > 1 and len(parts) > 1 and len(model.outputs) == count <= len(model.inputs):
        own = list(model.inputs[:count])
        order = [own.index(ring) for ring in circuit.names] if {*own} == {*circuit.names} else range(count)
        pin = dict(zip(parts, identifiers(parts, taken=(*taken, *rings)), strict=True))
        pin |= {own[k]: ring for ring, k in zip(rings, order, strict=True)}
        line = f"Xheat {' '.join(pin[part] for part in parts)} ambient {name}_heat"
        return [line], list(pin.values()), [(pin[own[k]], pin[model.outputs[k]]) for k in order]
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
    laser, lines = circuit.lasers[0], []
    entry = {terminal: f"e__{k}" for k, terminal in enumerate(circuit.entries)}
    exit = {terminal: f"x__{k}" for k, terminal in enumerate(circuit.exits)}
    for k, splitter in enumerate(circuit.splitters, len(circuit.names)):
        straight = math.sqrt(1 - splitter.cross)
        cross = math.sqrt(splitter.cross)
        first = f"e__{2 * k}"
        second = f"e__{2 * k + 1}"
        for out, own, other in ((f"x__{2 * k}", first, second), (f"x__{2 * k + 1}", second, first)):
            lines.append(f"B{out}_re {out}_re 0 V = {straight!r}*V({own}_re)-{cross!r}*V({other}_im)")
            lines.append(f"B{out}_im {out}_im 0 V = {straight!r}*V({own}_im)+{cross!r}*V({other}_re)")
    lines += _rotated(entry[laser.stop], ports[0], laser.loss, repr(float(laser.phase)))
    for k, w in enumerate(circuit.waveguides):
        start, angle = exit[w.start], repr(float(w.phase))
        if w.delay:
            for part in ("re", "im"):
                lines.append(f"T{part}__{k} {start}_{part} 0 far__{k}_{part} 0 Z0=1 TD={w.delay!r}")
                lines.append(f"R{part}__{k} far__{k}_{part} 0 1")
            start = f"far__{k}"
            angle += f"+{2 * math.pi * w.delay / NS!r}*(V(detuning)+({laser.offset / 1e9!r}))"
        lines += _rotated(entry[w.stop], start, w.loss, angle)
    lit = {laser.stop, *(w.stop for w in circuit.waveguides)}
    for node in (node for terminal, node in entry.items() if terminal not in lit):
        lines += [f"V{node}_re {node}_re 0 0", f"V{node}_im {node}_im 0 0"]
    for port, terminal in zip(ports[1:], circuit.outputs.values(), strict=True):
        lines += [f"E{port}_{part} {port}_{part} 0 {exit[terminal]}_{part} 0 1" for part in ("re", "im")]
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
