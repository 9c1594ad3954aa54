"""SPICE subcircuit of a thermal model: heat is a current (1 A = 1 W), temperature rise a voltage (1 V = 1 K).

A model that reads the part that it heats is a Foster network. One of several parts, or with an output map, has one R
and one C for each pole; controlled sources couple them to the pins.
"""

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .poles import RCNetwork

# names of nodes and subcircuits that ngspice takes for the ground, the temperature or the kind of a source
WORDS = ("ambient", "gnd", "null", "temper", "time", "hertz", "ac", "dc", "pulse", "sin", "exp", "pwl", "sffm", "am")
NOISE = (  # of a model whose poles are in series
    "noise: .noise of a pin's voltage at the .temp of the chip, times the root of its absolute temperature, is the",
    "density of its temperature in K/sqrt(Hz): 4 k_B T/R of a resistor stands for 4 k_B T^2/R of a thermal one",
)


def heat_subcircuit(name: str, net: RCNetwork) -> list[str]:
    """Subcircuit of the thermal model with a pin for each part, and one for the ambient."""
    if net.shares is None:
        return ladder(name, net.pins[0], net.R, net.C, foster=True)
    return _coupled(name, net, net.shares)


def ladder(name: str, pin: str, resistances: Any, capacities: Any, *, foster: bool) -> list[str]:
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
