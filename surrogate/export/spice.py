"""SPICE subcircuits: the heat of a ring, a ring whole with its light and carriers, and a circuit of rings.

Heat is a current (1 A = 1 W), temperature rise a voltage (1 V = 1 K). A model that reads the part that it heats becomes
a Foster network and, where it is passive, also a Cauer ladder. One of several parts, or with an output map, becomes one
R and one C for each pole; controlled sources couple them to the pins.

Light enters and leaves as fields, 1 V = 1 sqrt(W), each as a pair of pins re and im; the inputs draw no current and the
outputs are ideal sources, so that light goes one way. 1 V at ``detuning`` is 1 GHz. Capacitors of 1 nF hold the field
in sqrt(fJ) and the carriers in 1e23/m^3: a current of 1 A is one unit per ns. A waveguide of a circuit is a rotation,

    s_stop(t) = 10^(-loss/20) exp(-i (phase + 2 pi f delay)) s_start(t - delay)

with f the laser minus the circuit's reference frequency; a delay is two ideal lines, one for re and one for im.
"""

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thermofem import Foster, InputError
from thermofem.models.cauer import cauer

from .export_header import comment, identifiers, plain_name, write_texts
from .poles import RCNetwork, lit_part, rc_network, ring_network
from .ring_rates import DURATION, EPSILON, NS, Demonstration, RingRates, ring_rates

USAGE = (
    "SPICE subcircuit: 1 A into a pin is 1 W of heat, 1 V is 1 K above the pin ambient",
    "set .options reltol=1e-6 trtol=1 to keep the simulator's own error below 1e-4",
)
NOISE = (
    "noise: .noise of a pin's voltage at the .temp of the chip, times the root of its absolute temperature, is the",
    "density of its temperature in K/sqrt(Hz): 4 k_B T/R of a resistor stands for 4 k_B T^2/R of a thermal one",
)
RING_USAGE = (
    "SPICE subcircuits of a ring, for ngspice (LTspice and Xyce: not tested)",
    "fields in sqrt(W) as pairs re, im: in and add are inputs, through and drop ideal sources",
    "detuning, laser minus cold resonance: 1 V = 1 GHz; heat: 1 A is 1 W more into the core, 1 V is 1 K above ambient",
    "set .options method=trap reltol=1e-4 trtol=1 and a largest step of 1/400 of the period: periods within 3e-4;",
    "with reltol=1e-6 within 1e-4. Begin cold with PULSE(0 ...): a source that is on at t = 0 begins at a fixed point",
)
LIGHT = "in_re in_im add_re add_im through_re through_im drop_re drop_im detuning"  # pins of a ring

# names of nodes and subcircuits that ngspice takes for the ground, the temperature or the kind of a source
WORDS = ("ambient", "gnd", "null", "temper", "time", "hertz", "ac", "dc", "pulse", "sin", "exp", "pwl", "sffm", "am")


def write(model: Any, path: Path, header: list[str], ring: Any = None, run: Demonstration | None = None) -> Path:
    """Write the subcircuit named after the file, and the deck of a run beside it; see `surrogate.export_model`."""
    name = identifiers([path.stem], taken=WORDS)[0]
    if ring is None:
        lines, body, deck = _heat_alone(name, model, header)
    elif hasattr(ring, "rings"):
        lines, body, deck = _circuit(name, model, header, ring, path, run)
    else:
        lines, body, deck = _ring(name, model, header, ring, path, run)
    return write_texts(path, comment(lines, "*") + "\n" + "\n".join(body) + "\n", deck, ".cir")


def _heat_alone(name: str, model: Any, header: list[str]) -> tuple[list[str], list[str], str]:
    """Comment lines and netlist of a thermal model without light; the deck is empty."""
    net = rc_network(model, taken=WORDS)
    pins = " ".join(net.pins) if len(net.pins) <= 8 else "PINS"
    lines = [*USAGE, f"in a netlist: X1 {pins} 0 {name}, where node 0 is the ambient", "", *header]
    body = _heat(name, net)
    poles = Foster(net.R, net.R * net.C)
    if net.shares is None and poles.passive:
        lines[2:2] = NOISE
        try:
            steps = cauer(poles)
            body += ["", *_ladder(f"{name}_cauer", net.pins[0], steps.R, steps.C, foster=False)]
            lines.insert(5, f"{name} is a Foster network, {name}_cauer the same impedance as a Cauer ladder")
        except InputError as error:
            lines.insert(5, f"{name} is a Foster network, without a Cauer ladder: {error}")
    return lines, body, ""


def _ring(
    name: str, model: Any, header: list[str], ring: Any, path: Path, run: Demonstration | None
) -> tuple[list[str], list[str], str]:
    """Comment lines, netlist and deck of one ring with its heat."""
    rates = ring_rates(ring)
    net, read = ring_network(model, ring.read, taken=(*WORDS, *LIGHT.split()))
    others = [pin for pin in net.pins if pin != "heat"]
    pins = " ".join([LIGHT, "heat", *others])
    lines = [*RING_USAGE, f"in a netlist: X1 {pins} 0 {name}, where node 0 is the ambient", f"ring: {ring.name}", ""]
    if net.shares is None:
        lines[5:5] = NOISE
    body = [
        *_light(f"{name}_light", rates),
        "",
        *_heat(f"{name}_heat", net),
        "",
        f".subckt {name} {pins} ambient",
        *_heated_by_light(f"Xlight {LIGHT} {{}} ambient {name}_light", "", "heat", read),
        f"Xheat {' '.join(net.pins)} ambient {name}_heat",
        f".ends {name}",
    ]
    deck = ""
    if run is not None:
        outputs = {rates.output_port: rates.output_port}
        wires = [f"X1 in_re in_im 0 0 {LIGHT.split(' ', 4)[4]} {' '.join(['heat', *others])} 0 {name}"]
        deck = _deck(path, run, run.largest_step(rates), wires, "in", outputs)
    return [*lines, *header], body, deck


def _circuit(
    name: str, model: Any, header: list[str], circuit: Any, path: Path, run: Demonstration | None
) -> tuple[list[str], list[str], str]:
    """Comment lines, netlist and deck of a `coupled.Circuit`; ``model`` is that of each ring, or has an input for each.

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
    kinds: dict[RingRates, str] = {}
    rings = []
    for k, ring in enumerate(circuit.resonators):
        kind = kinds.setdefault(ring_rates(ring), f"{name}_light_{len(kinds) + 1}")
        nodes = f"e__{2 * k}", f"e__{2 * k + 1}", f"x__{2 * k}", f"x__{2 * k + 1}"
        waves = " ".join(f"{node}_{part}" for node in nodes for part in ("re", "im"))
        shift = (circuit.frequency - ring.frequency + laser.offset) / 1e9
        rings += [f"Bdet__{k} det__{k} 0 V = V(detuning)+({shift!r})"]
        rings += _heated_by_light(f"Xring__{k} {waves} det__{k} {{}} ambient {kind}", f"__{k}", *lit[k])
    body = []
    for rates, kind in kinds.items():
        body += [*_light(kind, rates), ""]
    pins = " ".join([f"{port}_{part}" for port in ports for part in ("re", "im")] + ["detuning", *heat_pins])
    body += [*_heat(f"{name}_heat", net), "", f".subckt {name} {pins} ambient", *rings, *heat]
    body += [*_waves(circuit, ports), f".ends {name}"]
    lines = [*RING_USAGE, f"in a netlist: X1 {pins} 0 {name}, where node 0 is the ambient", f"circuit: {circuit.name}"]
    deck = ""
    if run is not None:
        step = min(run.largest_step(rates) for rates in kinds)
        outputs = dict(zip(ports[1:], ports[1:], strict=True))
        deck = _deck(path, run, step, [f"X1 {pins} 0 {name}"], ports[0], outputs)
    return [*lines, "", *header], body, deck


def _heat_of_rings(
    name: str, circuit: Any, model: Any, net: RCNetwork, *, taken: tuple[str, ...]
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


def _waves(circuit: Any, ports: list[str]) -> list[str]:
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


def _heated_by_light(light: str, mark: str, heated: str, read: str) -> list[str]:
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


def _light(name: str, rates: RingRates) -> list[str]:
    """Subcircuit of light and carriers with the pins `LIGHT`, heat and ambient; the equations stand in `ring_rates`."""
    r = rates
    square = f"(V(n)*V(n)+{EPSILON**2!r})"
    dispersion = "".join(
        f"-({c!r})*V(n)" + ("" if p == 1 else f"*pow({square},{(p - 1) / 2!r})") for c, p in r.dispersion
    )
    recombination = f"{(r.b - r.a) / r.tau0!r}*V(n)*V(n)/(1+{r.a!r}*V(n))"  # besides n/tau0, which is Rn
    return [
        f".subckt {name} {LIGHT} heat ambient",
        "* field a: 1 V = 1 sqrt(fJ); carriers n: 1 V = 1e23/m^3; u: energy in fJ; d: rad/ns; g: 1/ns",
        *("Car ar 0 1n", "Cai ai 0 1n", "Cn n 0 1n"),
        *(f"Rar ar 0 {1 / r.loss!r}", f"Rai ai 0 {1 / r.loss!r}", f"Rn n 0 {r.tau0!r}"),
        "Bu u 0 V = V(ar)*V(ar)+V(ai)*V(ai)",
        f"Bd d 0 V = -({r.thermal_shift!r})*V(heat,ambient){dispersion}-({r.kerr!r})*V(u)-{2 * math.pi!r}*V(detuning)",
        f"Bg g 0 V = {r.fca!r}*V(n)+{r.tpa!r}*V(u)",
        f"Bar 0 ar I = -V(d)*V(ai)-V(g)*V(ar)-{r.pump!r}*V(in_im)-{r.add!r}*V(add_im)",
        f"Bai 0 ai I = V(d)*V(ar)-V(g)*V(ai)+{r.pump!r}*V(in_re)+{r.add!r}*V(add_re)",
        f"Bn 0 n I = {r.g!r}*V(u)*V(u)-({recombination})",
        f"Bheat ambient heat I = 2e-6*({r.absorbed!r}+V(g))*V(u)",
        f"Btr through_re 0 V = V(in_re)-{r.through!r}*V(ai)",
        f"Bti through_im 0 V = V(in_im)+{r.through!r}*V(ar)",
        f"Bdr drop_re 0 V = V(add_re)-{r.drop!r}*V(ai)",
        f"Bdi drop_im 0 V = V(add_im)+{r.drop!r}*V(ar)",
        f".ends {name}",
    ]


def _heat(name: str, net: RCNetwork) -> list[str]:
    """Subcircuit of the thermal model with a pin for each part, and one for the ambient."""
    if net.shares is None:
        return _ladder(name, net.pins[0], net.R, net.C, foster=True)
    return _coupled(name, net, net.shares)


def _ladder(name: str, pin: str, resistances: Any, capacities: Any, *, foster: bool) -> list[str]:
    """Subcircuit of R and C from pin to ambient: each C parallel to its R (Foster), or to the ambient (Cauer)."""
    R = np.asarray(resistances).tolist()
    C = np.asarray(capacities).tolist()
    nodes = [pin, *(f"n__{k}" for k in range(1, len(R))), "ambient"]
    lines = [f".subckt {name} {pin} ambient"]
    for k, ends in enumerate(itertools.pairwise(nodes)):
        resistor = f"R{k + 1} {' '.join(ends)} {R[k]!r}"
        capacitor = f"C{k + 1} {ends[0]} {ends[1] if foster else 'ambient'} {C[k]!r}"
        lines += [resistor, capacitor] if foster else [capacitor, resistor]
    return [*lines, f".ends {name}"]


def _coupled(name: str, net: RCNetwork, shares: NDArray[np.float64]) -> list[str]:
    """Subcircuit with one R and C for each pole; controlled sources couple it to power and temperature of every pin."""
    lines = [f".subckt {name} {' '.join(net.pins)} ambient"]
    for i, pin in enumerate(net.pins):
        lines += _pin(i, pin, net)
    for k, (R, C) in enumerate(zip(net.R, net.C, strict=True), start=1):
        lines += [f"R{k} x__{k} ambient {float(R)!r}", f"C{k} x__{k} ambient {float(C)!r}"]
        for i, at in enumerate(net.heated):
            if shares[k - 1, i]:
                lines.append(f"F{k}_{i + 1} ambient x__{k} Vpin{at + 1} {float(shares[k - 1, i])!r}")
    return [*lines, f".ends {name}"]


def _pin(i: int, pin: str, net: RCNetwork) -> list[str]:
    """Netlist lines of one pin: a source that senses its power, and sources that sum the poles to its temperature."""
    shares = net.read_by(i)
    if shares is None:
        return [f"* {pin} is heated, but not read: it stays at 0 K", f"Vpin{i + 1} {pin} ambient 0"]
    note = [] if i in net.heated else [f"* {pin} is only read: power into it is lost"]
    first = "z__" if net.coefficient else "p__"
    used = np.flatnonzero(shares)
    nodes = [f"{first}{i + 1}", *(f"p{i + 1}__{k + 1}" for k in used[:-1]), "ambient"]
    sums = [
        f"E{i + 1}_{k + 1} {nodes[n]} {nodes[n + 1]} x__{k + 1} ambient {float(shares[k])!r}"
        for n, k in enumerate(used)
    ]
    if not used.size:
        sums.append(f"V{nodes[0]} {nodes[0]} ambient 0")  # no pole reaches it: it stays at 0 K
    if net.coefficient:
        z = f"V({nodes[0]},ambient)"
        sums.append(f"Bmap{i + 1} p__{i + 1} ambient V={z}+({net.coefficient!r})*{z}*{z}")
    return [*note, f"Vpin{i + 1} {pin} p__{i + 1} 0", *sums]


def _deck(path: Path, run: Demonstration, step: float, wires: list[str], laser: str, outputs: dict[str, str]) -> str:
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
