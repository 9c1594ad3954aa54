"""SPICE subcircuit: heat is a current (1 A = 1 W), temperature rise a voltage (1 V = 1 K).

A model that reads the part that it heats becomes a Foster network and, where it is passive, also a Cauer ladder. One of
several parts, or with an output map, becomes one R and one C for each pole; controlled sources couple them to the pins.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thermofem import Foster
from thermofem.checks import InputError
from thermofem.data.files import write_whole
from thermofem.models.cauer import cauer

from .circuit import PoleCircuit, network
from .header import comment, identifiers

USAGE = (
    "SPICE subcircuit: 1 A into a pin is 1 W of heat, 1 V is 1 K above the pin ambient",
    "set .options reltol=1e-6 trtol=1 to keep the simulator's own error below 1e-4",
)

# names of nodes and subcircuits that ngspice takes for the ground, the temperature or the kind of a source
WORDS = ("ambient", "gnd", "null", "temper", "time", "hertz", "ac", "dc", "pulse", "sin", "exp", "pwl", "sffm", "am")


def write(model: Any, path: Path, header: list[str]) -> Path:
    """Write the subcircuit named after the file; see `surrogate.export_model`."""
    name = identifiers([path.stem], taken=WORDS)[0]
    net = network(model, taken=WORDS)
    pins = " ".join(net.pins) if len(net.pins) <= 8 else "PINS"
    lines = [*USAGE, f"in a netlist: X1 {pins} 0 {name}, where node 0 is the ambient", "", *header]
    if net.turns is not None:
        body = _coupled(name, net, net.turns)
    else:
        body = _foster(name, net)
        poles = Foster(net.R, net.R * net.C)
        if poles.passive:
            try:
                body += ["", *_cauer(f"{name}_cauer", net.pins[0], poles)]
                lines.insert(3, f"{name} is a Foster network, {name}_cauer the same impedance as a Cauer ladder")
            except InputError as error:
                lines.insert(3, f"{name} is a Foster network, without a Cauer ladder: {error}")
    text = comment(lines, "*") + "\n" + "\n".join(body) + "\n"
    return write_whole(path, lambda p: p.write_text(text, encoding="ascii"))


def _foster(name: str, net: PoleCircuit) -> list[str]:
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


def _coupled(name: str, net: PoleCircuit, turns: NDArray[np.float64]) -> list[str]:
    """One R and C for each pole; the pins feel sums of the poles and feed them shares of their power."""
    lines = [f".subckt {name} {' '.join(net.pins)} ambient"]
    for i, pin in enumerate(net.pins):
        lines += _pin(i, pin, net)
    for k, (R, C) in enumerate(zip(net.R, net.C, strict=True), start=1):
        lines += [f"R{k} x__{k} ambient {float(R)!r}", f"C{k} x__{k} ambient {float(C)!r}"]
        for i, at in enumerate(net.heated):
            if turns[k - 1, i]:
                lines.append(f"F{k}_{i + 1} ambient x__{k} Vpin{at + 1} {float(turns[k - 1, i])!r}")
    return [*lines, f".ends {name}"]


def _pin(i: int, pin: str, net: PoleCircuit) -> list[str]:
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
