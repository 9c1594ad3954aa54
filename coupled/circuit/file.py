"""The circuit file: TOML text with units in, a `Circuit` out.

```toml
name = "two rings on a bus"
frequency = "192.88 THz"         # of detunings and phases; default that of the first ring

[[ring]]
name = "a"
base = "borghi2021"              # or file = "ring.toml", a ring file beside this one
shift = "5 GHz"                  # of its cold resonance; default 0
[[ring]]
name = "b"
base = "borghi2021"

[[waveguide]]                    # from a terminal that light leaves by to one that it enters by
start = "a.through"
stop = "b.in"
loss = 0.3                       # dB
phase = "0.5 rad"
delay = "10 ps"

[[splitter]]                     # terminals "in 1", "in 2", "out 1", "out 2"
name = "s"
cross = 0.5

[[laser]]
name = "in"
stop = "a.in"
offset = "0 GHz"                 # loss and phase as of a waveguide

[[detector]]
name = "out"
start = "b.through"
bandwidth = "20 GHz"             # default without limit
```
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from thermofem import checks
from thermofem.checks import InputError
from thermofem.data import files
from thermofem.data.files import NUMBER, TABLES, TEXT, read_table

from ..resonator import PUBLISHED, RingResonator
from .parts import Detector, LaserPort, Splitter, Waveguide

_RING = {"name": TEXT, "base": TEXT, "file": TEXT, "shift": "Hz"}
_KINDS: dict[str, tuple[type, dict[str, str]]] = {
    "waveguide": (Waveguide, {"start": TEXT, "stop": TEXT, "loss": NUMBER, "phase": "rad", "delay": "s"}),
    "splitter": (Splitter, {"name": TEXT, "cross": NUMBER}),
    "laser": (LaserPort, {"name": TEXT, "stop": TEXT, "loss": NUMBER, "phase": "rad", "offset": "Hz"}),
    "detector": (Detector, {"name": TEXT, "start": TEXT, "bandwidth": "Hz"}),
}
_NEEDED = {"ring": ("name",), "waveguide": ("start", "stop"), "splitter": ("name",), "laser": ("name", "stop"),
           "detector": ("name", "start")}  # fmt: skip
_TOP = {"name": TEXT, "frequency": "Hz", **dict.fromkeys(["ring", *_KINDS], TABLES)}


def fields(text: str, folder: Path | None = None) -> dict[str, Any]:
    """The fields of the `Circuit` that the text of a circuit file describes; ring files are in ``folder``."""
    top = read_table(files.from_toml(text), _TOP, "the circuit file")
    rings: dict[str, RingResonator] = {}
    for ring in _tables(top, "ring", _RING):
        if ring["name"] in rings:
            raise InputError(f"ring {ring['name']!r} is there twice; every ring needs its own name")
        rings[ring["name"]] = _ring(ring, folder)
    parts = {f"{kind}s": tuple(make(**v) for v in _tables(top, kind, keys)) for kind, (make, keys) in _KINDS.items()}
    return {"rings": rings, **parts, "frequency": top.get("frequency"), "name": top.get("name", "circuit")}


def _tables(top: dict[str, Any], kind: str, keys: dict[str, str]) -> list[dict[str, Any]]:
    """The values of all tables of one kind in SI."""
    tables = enumerate(top.get(kind, []), 1)
    return [read_table(item, keys, f"{kind} number {k}", required=_NEEDED[kind]) for k, item in tables]


def _ring(values: dict[str, Any], folder: Path | None) -> RingResonator:
    """The ring of a table: a published set or a file, its resonance shifted."""
    where = f"ring {values['name']!r}"
    if ("base" in values) == ("file" in values):
        raise InputError(f"{where}: give base (one of {', '.join(PUBLISHED)}) or file")
    if "base" in values:
        ring = PUBLISHED[checks.choice(f"{where}: base", values["base"], PUBLISHED)]()
    else:
        ring = RingResonator.from_toml((folder or Path()) / values["file"])
    return replace(ring, frequency=ring.frequency + values.get("shift", 0.0))
