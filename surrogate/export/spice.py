"""SPICE subcircuits: the heat of a ring, and a ring whole with its light and carriers.

Heat is a current (1 A = 1 W), temperature rise a voltage (1 V = 1 K). A model that reads the part that it heats becomes
a Foster network and, where it is passive, also a Cauer ladder. One of several parts, or with an output map, becomes one
R and one C for each pole; controlled sources couple them to the pins.

Light enters and leaves as fields, 1 V = 1 sqrt(W), each as a pair of pins re and im; the inputs draw no current and the
outputs are ideal sources, so that light goes one way. 1 V at ``detuning`` is 1 GHz. Capacitors of 1 nF hold the field
in sqrt(fJ) and the carriers in 1e23/m^3: a current of 1 A is one unit per ns.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thermofem import Foster
from thermofem.checks import InputError
from thermofem.data.files import write_whole
from thermofem.models.cauer import cauer

from .export_header import comment, identifiers, plain_name
from .poles import RCNetwork, lit_part, rc_network
from .ring_rates import DURATION, EPSILON, Demonstration, RingRates, ring_rates
from .spice_circuit import circuit_subcircuit, heated_by_light

USAGE = (
    "SPICE subcircuit: 1 A into a pin is 1 W of heat, 1 V is 1 K above the pin ambient",
    "set .options reltol=1e-6 trtol=1 to keep the simulator's own error below 1e-4",
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
        lines, body = _heat_alone(name, model, header)
    elif hasattr(ring, "rings"):
        lines, body, deck = _circuit(name, model, header, ring, path, run)
    else:
        lines, body, deck = _ring(name, model, header, ring, path, run)
    if ring is not None and run is not None:
        demo = path.with_name(f"{path.stem}_demo.cir")
        write_whole(demo, lambda p: p.write_text(deck, encoding="ascii"))
    text = comment(lines, "*") + "\n" + "\n".join(body) + "\n"
    return write_whole(path, lambda p: p.write_text(text, encoding="ascii"))


def _heat_alone(name: str, model: Any, header: list[str]) -> tuple[list[str], list[str]]:
    """Comments and lines of a thermal model."""
    net = rc_network(model, taken=WORDS)
    pins = " ".join(net.pins) if len(net.pins) <= 8 else "PINS"
    lines = [*USAGE, f"in a netlist: X1 {pins} 0 {name}, where node 0 is the ambient", "", *header]
    body = heat_subcircuit(name, net)
    poles = Foster(net.R, net.R * net.C)
    if net.shares is None and poles.passive:
        try:
            body += ["", *_cauer(f"{name}_cauer", net.pins[0], poles)]
            lines.insert(3, f"{name} is a Foster network, {name}_cauer the same impedance as a Cauer ladder")
        except InputError as error:
            lines.insert(3, f"{name} is a Foster network, without a Cauer ladder: {error}")
    return lines, body


def _ring(
    name: str, model: Any, header: list[str], ring: Any, path: Path, run: Demonstration | None
) -> tuple[list[str], list[str], str]:
    """Comments, lines and deck of one ring with its heat."""
    rates, (heated, read) = ring_rates(ring), lit_part(model)
    net = rc_network(model, taken=(*WORDS, *LIGHT.split(), "heat"))
    parts = list(dict.fromkeys([*model.inputs, *model.outputs]))
    pin = dict(zip(parts, net.pins, strict=True)) | {heated: "heat"}
    others = [pin[part] for part in parts if part != heated]
    pins = " ".join([LIGHT, "heat", *others])
    lines = [*RING_USAGE, f"in a netlist: X1 {pins} 0 {name}, where node 0 is the ambient", f"ring: {ring.name}", ""]
    body = [
        *light_subcircuit(f"{name}_light", rates),
        "",
        *heat_subcircuit(f"{name}_heat", net),
        "",
        f".subckt {name} {pins} ambient",
        *heated_by_light(f"Xlight {LIGHT} {{}} ambient {name}_light", "", pin[heated], pin[read]),
        f"Xheat {' '.join(pin[part] for part in parts)} ambient {name}_heat",
        f".ends {name}",
    ]
    deck = ""
    if run is not None:
        outputs = {rates.output_port: rates.output_port}
        wires = [f"X1 in_re in_im 0 0 {LIGHT.split(' ', 4)[4]} {' '.join(['heat', *others])} 0 {name}"]
        deck = _deck(path, run, run.largest_step(rates), wires, ("in_re", "in_im"), outputs)
    return [*lines, *header], body, deck


def _circuit(
    name: str, model: Any, header: list[str], circuit: Any, path: Path, run: Demonstration | None
) -> tuple[list[str], list[str], str]:
    """Comments, lines and deck of a circuit of rings with their heat."""
    net = rc_network(model, taken=WORDS)
    found = circuit_subcircuit(name, circuit, model, net, taken=(*WORDS, "detuning"))
    body = []
    for rates, kind in found.kinds.items():
        body += [*light_subcircuit(kind, rates), ""]
    body += [*heat_subcircuit(f"{name}_heat", net), "", *found.lines]
    pins = " ".join(found.pins)
    lines = [*RING_USAGE, f"in a netlist: X1 {pins} 0 {name}, where node 0 is the ambient", f"circuit: {circuit.name}"]
    deck = ""
    if run is not None:
        step = min(run.largest_step(rates) for rates in found.kinds)
        deck = _deck(path, run, step, [f"X1 {pins} 0 {name}"], found.laser, found.outputs)
    return [*lines, "", *header], body, deck


def light_subcircuit(name: str, rates: RingRates) -> list[str]:
    """Light and carriers with the pins `LIGHT`, heat and ambient; the equations stand in `ring_rates`."""
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


def heat_subcircuit(name: str, net: RCNetwork) -> list[str]:
    """The thermal model with a pin for each part, and the ambient."""
    return _foster(name, net) if net.shares is None else _coupled(name, net, net.shares)


def _foster(name: str, net: RCNetwork) -> list[str]:
    """R parallel to C, in series from the pin to the ambient."""
    nodes = [net.pins[0], *(f"n__{k}" for k in range(1, net.R.size)), "ambient"]
    lines = [f".subckt {name} {net.pins[0]} ambient"]
    for k, (R, C) in enumerate(zip(net.R, net.C, strict=True)):
        ends = f"{nodes[k]} {nodes[k + 1]}"
        lines += [f"R{k + 1} {ends} {float(R)!r}", f"C{k + 1} {ends} {float(C)!r}"]
    return [*lines, f".ends {name}"]


def _cauer(name: str, pin: str, model: Foster) -> list[str]:
    """Capacities to the ambient, resistances from one to the next."""
    ladder = cauer(model)
    nodes = [pin, *(f"n__{k}" for k in range(1, ladder.order)), "ambient"]
    lines = [f".subckt {name} {pin} ambient"]
    for k, (R, C) in enumerate(zip(np.asarray(ladder.R), np.asarray(ladder.C), strict=True)):
        lines += [f"C{k + 1} {nodes[k]} ambient {float(C)!r}", f"R{k + 1} {nodes[k]} {nodes[k + 1]} {float(R)!r}"]
    return [*lines, f".ends {name}"]


def _coupled(name: str, net: RCNetwork, shares: NDArray[np.float64]) -> list[str]:
    """One R and C for each pole; the pins feel sums of the poles and feed them shares of their power."""
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
    """A source that senses the power into the pin, and the sources that add up its temperature."""
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


def _deck(
    path: Path, run: Demonstration, step: float, wires: list[str], laser: tuple[str, str], outputs: dict[str, str]
) -> str:
    """A deck that runs as it is and writes a table: time in s, and the power at each output in W.

    outputs: column of the table -> pair of pins, without their _re and _im.
    """
    file, table = plain_name(path.name), f"{path.stem}_demo.csv"
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
            f"Vre {laser[0]} 0 PULSE(0 {math.sqrt(run.power)!r} 0 1p 1p 1 2)",
            f"Vim {laser[1]} 0 0",
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
