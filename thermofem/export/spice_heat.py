"""SPICE subcircuit of a thermal model: heat is a current (1 A = 1 W), temperature rise a voltage (1 V = 1 K).

A model that reads the part that it heats is a Foster network. One of several parts, or with an output map, has one R
and one C for each pole; controlled sources couple them to the pins.
"""

from typing import Any

import numpy as np

from ..arrays import Array
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
    lines = [f".subckt {name} {pin} ambient"]
    count = len(resistances)
    node = pin
    for k, (R, C) in enumerate(zip(resistances, capacities, strict=True), start=1):
        after = f"n__{k}" if k < count else "ambient"
        foot = after if foster else "ambient"
        resistor = f"R{k} {node} {after} {float(R)!r}"
        capacitor = f"C{k} {node} {foot} {float(C)!r}"
        lines += [resistor, capacitor] if foster else [capacitor, resistor]
        node = after
    return [*lines, f".ends {name}"]


def _coupled(name: str, net: RCNetwork, shares: Array) -> list[str]:
    """Subcircuit with one R and C for each pole; controlled sources couple it to power and temperature of every pin."""
    pins = " ".join(net.pins)
    lines = [f".subckt {name} {pins} ambient"]
    for number, pin in enumerate(net.pins):
        lines += _pin(number, pin, net)
    for k, (R, C) in enumerate(zip(net.R, net.C, strict=True)):
        pole = f"x__{k + 1}"
        lines.append(f"R{k + 1} {pole} ambient {float(R)!r}")
        lines.append(f"C{k + 1} {pole} ambient {float(C)!r}")
        for i, pin_number in enumerate(net.heated):
            share = float(shares[k, i])
            if share:
                lines.append(f"F{k + 1}_{i + 1} ambient {pole} Vpin{pin_number + 1} {share!r}")
    return [*lines, f".ends {name}"]


def _pin(number: int, pin: str, net: RCNetwork) -> list[str]:
    """Netlist lines of one pin: a source that senses its power, and sources that sum the poles to its temperature."""
    i = number + 1
    shares = net.read_by(number)
    if shares is None:
        return [f"* {pin} is heated, but not read: it stays at 0 K", f"Vpin{i} {pin} ambient 0"]
    lines = [] if number in net.heated else [f"* {pin} is only read: power into it is lost"]
    lines.append(f"Vpin{i} {pin} p__{i} 0")
    first = f"z__{i}" if net.coefficient else f"p__{i}"
    used = np.flatnonzero(shares)
    if not used.size:
        lines.append(f"V{first} {first} ambient 0")  # no pole reaches it: it stays at 0 K
    node = first
    for k in used:
        after = "ambient" if k == used[-1] else f"p{i}__{k + 1}"
        lines.append(f"E{i}_{k + 1} {node} {after} x__{k + 1} ambient {float(shares[k])!r}")
        node = after
    if net.coefficient:
        z = f"V({first},ambient)"
        lines.append(f"Bmap{i} p__{i} ambient V={z}+({net.coefficient!r})*{z}*{z}")
    return lines
