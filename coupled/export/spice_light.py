"""SPICE subcircuit of the light and carriers of a ring, its connection to the heat, and the deck of a run.

Light enters and leaves as fields, 1 V = 1 sqrt(W), each as a pair of pins re and im; the inputs draw no current and the
outputs are ideal sources, so that light goes one way. 1 V at ``detuning`` is 1 GHz. Capacitors of 1 nF hold the field
in sqrt(fJ) and the carriers in 1e23/m^3: a current of 1 A is one unit per ns.
"""

import math
from pathlib import Path
from typing import NamedTuple

from thermofem.export.export_header import comment, plain_name
from thermofem.export.fmi_unit import DURATION

from ..kernel.rates import EPSILON
from .ring_ports import Demonstration, RingPorts

RING_USAGE = (
    "SPICE subcircuits of a ring, for ngspice (LTspice and Xyce: not tested)",
    "fields in sqrt(W) as pairs re, im: in and add are inputs, through and drop ideal sources",
    "detuning, laser minus cold resonance: 1 V = 1 GHz; heat: 1 A is 1 W more into the core, 1 V is 1 K above ambient",
    "set .options method=trap reltol=1e-4 trtol=1 and a largest step of 1/400 of the period: periods within 3e-4;",
    "with reltol=1e-6 within 1e-4. Begin cold with PULSE(0 ...): a source that is on at t = 0 begins at a fixed point",
)
LIGHT = "in_re in_im add_re add_im through_re through_im drop_re drop_im detuning"  # pins of a ring

# names of nodes and subcircuits that ngspice takes for the ground, the temperature or the kind of a source


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
    """Subcircuit of light and carriers, as in `kernel.rates`, with the pins `LIGHT`, heat and ambient."""
    r = ring.rates
    square = f"(V(n)*V(n)+{EPSILON**2!r})"
    dispersion = "".join(
        f"-({c!r})*V(n)" + ("" if p == 1 else f"*pow({square},{(p - 1) / 2!r})") for c, p in ring.dispersion
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
