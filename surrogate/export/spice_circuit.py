"""A circuit of rings as one SPICE subcircuit: rings, waveguides, delays, splitters, one laser, detectors.

Every terminal is a pair of nodes re, im. A waveguide is a rotation,

    s_stop(t) = 10^(-loss/20) exp(-i (phase + 2 pi f delay)) s_start(t - delay)

with f the laser minus the circuit's reference frequency; a delay is two ideal lines, one for re and one for im.
"""

import math
from dataclasses import dataclass
from typing import Any

from thermofem.checks import InputError

from .export_header import identifiers
from .poles import RCNetwork, lit_part
from .ring_rates import NS, RingRates, ring_rates


@dataclass(frozen=True, eq=False)
class CircuitLines:
    """The subcircuit of a circuit.

    lines, pins: the subcircuit and its pins, without the ambient, which is the last.
    kinds: the rates of each kind of ring and the name of its light's subcircuit.
    laser: the pins of the laser.
    outputs: detector -> its pins, without their _re and _im.
    """

    lines: list[str]
    pins: list[str]
    kinds: dict[RingRates, str]
    laser: tuple[str, str]
    outputs: dict[str, str]


def circuit_subcircuit(name: str, circuit: Any, model: Any, net: RCNetwork, *, taken: tuple[str, ...]) -> CircuitLines:
    """The subcircuit of a `coupled.Circuit` with one thermal model for every ring, or one that has an input for each.

    Raises InputError: several lasers, or a model of another number of rings.
    """
    if len(circuit.lasers) != 1:
        names = ", ".join(laser.name for laser in circuit.lasers)
        raise InputError(
            f"ring has the lasers {names}: SPICE takes a circuit of one laser, whose frame the fields have"
        )
    laser = circuit.lasers[0]
    ports = identifiers([laser.name, *circuit.outputs], taken=taken)
    rings = identifiers(circuit.names, taken=(*taken, *ports))
    heat, lit = _heat(name, circuit, model, net, rings, taken=(*taken, *ports, *rings))
    pins = [f"{port}_{part}" for port in ports for part in ("re", "im")] + ["detuning", *heat.pins]
    kinds: dict[RingRates, str] = {}
    lines = [f".subckt {name} {' '.join(pins)} ambient"]
    entry = {terminal: f"e__{k}" for k, terminal in enumerate(circuit.entries)}
    exit = {terminal: f"x__{k}" for k, terminal in enumerate(circuit.exits)}
    for k, ring in enumerate(circuit.resonators):
        kind = kinds.setdefault(ring_rates(ring), f"{name}_light_{len(kinds) + 1}")
        at = [entry[circuit.entries[2 * k]], entry[circuit.entries[2 * k + 1]]]
        at += [exit[circuit.exits[2 * k]], exit[circuit.exits[2 * k + 1]]]
        waves = " ".join(f"{node}_{part}" for node in at for part in ("re", "im"))
        shift = (circuit.frequency - ring.frequency + laser.offset) / 1e9
        lines += [f"Bdet__{k} det__{k} 0 V = V(detuning)+({shift!r})"]
        lines += heated_by_light(f"Xring__{k} {waves} det__{k} {{}} ambient {kind}", f"__{k}", *lit[k])
    lines += heat.lines
    for k, splitter in enumerate(circuit.splitters, len(circuit.names)):
        straight, cross = math.sqrt(1 - splitter.cross), math.sqrt(splitter.cross)
        first, second = f"e__{2 * k}", f"e__{2 * k + 1}"
        for out, own, other in ((f"x__{2 * k}", first, second), (f"x__{2 * k + 1}", second, first)):
            lines.append(f"B{out}_re {out}_re 0 V = {straight!r}*V({own}_re)-{cross!r}*V({other}_im)")
            lines.append(f"B{out}_im {out}_im 0 V = {straight!r}*V({own}_im)+{cross!r}*V({other}_re)")
    lines += _turned(entry[laser.stop], ports[0], laser.loss, repr(float(laser.phase)))
    for k, w in enumerate(circuit.waveguides):
        start, angle = exit[w.start], repr(float(w.phase))
        if w.delay:
            for part in ("re", "im"):
                lines.append(f"T{part}__{k} {start}_{part} 0 far__{k}_{part} 0 Z0=1 TD={w.delay!r}")
                lines.append(f"R{part}__{k} far__{k}_{part} 0 1")
            start = f"far__{k}"
            angle += f"+{2 * math.pi * w.delay / NS!r}*(V(detuning)+({laser.offset / 1e9!r}))"
        lines += _turned(entry[w.stop], start, w.loss, angle)
    lit_entries = {laser.stop, *(w.stop for w in circuit.waveguides)}
    for terminal, node in entry.items():
        if terminal not in lit_entries:
            lines += [f"V{node}_re {node}_re 0 0", f"V{node}_im {node}_im 0 0"]
    for port, terminal in zip(ports[1:], circuit.outputs.values(), strict=True):
        for part in ("re", "im"):
            lines.append(f"E{port}_{part} {port}_{part} 0 {exit[terminal]}_{part} 0 1")
    outputs = dict(zip(ports[1:], ports[1:], strict=True))
    return CircuitLines([*lines, f".ends {name}"], pins, kinds, (f"{ports[0]}_re", f"{ports[0]}_im"), outputs)


def _turned(out: str, start: str, loss: float, angle: str) -> list[str]:
    """A field times 10^(-loss/20) exp(-i angle); the angle in rad is an expression."""
    size, re, im = 10 ** (-loss / 20), f"V({start}_re)", f"V({start}_im)"
    return [
        f"B{out}_re {out}_re 0 V = {size!r}*(cos({angle})*{re}+sin({angle})*{im})",
        f"B{out}_im {out}_im 0 V = {size!r}*(cos({angle})*{im}-sin({angle})*{re})",
    ]


@dataclass(frozen=True, eq=False)
class _Heat:
    """Lines and pins of the heat of all rings."""

    lines: list[str]
    pins: list[str]


def _heat(
    name: str, circuit: Any, model: Any, net: RCNetwork, rings: list[str], *, taken: tuple[str, ...]
) -> tuple[_Heat, list[tuple[str, str]]]:
    """The heat of all rings, and the pins that the light of each heats and reads."""
    count = len(rings)
    parts = list(dict.fromkeys([*model.inputs, *model.outputs]))
    if count > 1 and len(parts) > 1 and len(model.outputs) == count <= len(model.inputs):
        own = list(model.inputs[:count])
        order = [own.index(ring) for ring in circuit.names] if {*own} == {*circuit.names} else range(count)
        words = identifiers(parts, taken=taken)
        pin = dict(zip(parts, words, strict=True))
        for ring, k in zip(rings, order, strict=True):
            pin[own[k]] = ring
        line = f"Xheat {' '.join(pin[part] for part in parts)} ambient {name}_heat"
        return _Heat([line], list(pin.values())), [(pin[own[k]], pin[model.outputs[k]]) for k in order]
    heated, read = lit_part(model)
    if len(model.inputs) > 1 and count > 1:
        raise InputError(
            f"model has {len(model.inputs)} inputs and {len(model.outputs)} outputs, the circuit {count} rings: one of "
            "each for every ring is needed (surrogate.reduce_array), or one model for all rings"
        )
    lines: list[str] = []
    pins: list[str] = []
    lit = []
    for k, ring in enumerate(rings):
        pin = {part: ring if part == heated else f"{ring}_{word}" for part, word in zip(parts, net.pins, strict=True)}
        lines.append(f"Xheat__{k} {' '.join(pin.values())} ambient {name}_heat")
        pins += pin.values()
        lit.append((pin[heated], pin[read]))
    return _Heat(lines, pins), lit


def heated_by_light(light: str, mark: str, heated: str, read: str) -> list[str]:
    """The line of a light subcircuit with its pin heat; where another part is read, sources carry heat and rise over.

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
