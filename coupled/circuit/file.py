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

from thermofem import checks, quantity, toml_file
from thermofem.checks import InputError

from ..resonator import PUBLISHED, RingResonator
from .parts import Detector, LaserPort, Splitter, Waveguide

_TEXT, _NUMBER = "text", "number"
_RING = {"name": _TEXT, "base": _TEXT, "file": _TEXT, "shift": "Hz"}
_KINDS: dict[str, tuple[type, dict[str, str]]] = {
    "waveguide": (Waveguide, {"start": _TEXT, "stop": _TEXT, "loss": _NUMBER, "phase": "rad", "delay": "s"}),
    "splitter": (Splitter, {"name": _TEXT, "cross": _NUMBER}),
    "laser": (LaserPort, {"name": _TEXT, "stop": _TEXT, "loss": _NUMBER, "phase": "rad", "offset": "Hz"}),
    "detector": (Detector, {"name": _TEXT, "start": _TEXT, "bandwidth": "Hz"}),
}
_NEEDED = {"ring": ("name",), "waveguide": ("start", "stop"), "splitter": ("name",), "laser": ("name", "stop"),
           "detector": ("name", "start")}  # fmt: skip


def fields(text: str, folder: Path | None = None) -> dict[str, Any]:
    """The fields of the `Circuit` that the text of a circuit file describes; ring files are in ``folder``."""
    table = toml_file.parse(text)
    for key in table:
        checks.choice("the circuit file: key", key, ["name", "frequency", "ring", *_KINDS])
    name = table.get("name", "circuit")
    if not isinstance(name, str):
        raise InputError(f"name = {name!r} must be text")
    frequency = table.get("frequency")
    rings: dict[str, RingResonator] = {}
    for values in _tables(table, "ring", _RING):
        if values["name"] in rings:
            raise InputError(f"ring {values['name']!r} is there twice; every ring needs its own name")
        rings[values["name"]] = _ring(values, folder)
    parts = {kind: tuple(make(**v) for v in _tables(table, kind, keys)) for kind, (make, keys) in _KINDS.items()}
    return {
        "rings": rings,
        "waveguides": parts["waveguide"],
        "lasers": parts["laser"],
        "detectors": parts["detector"],
        "splitters": parts["splitter"],
        "frequency": None if frequency is None else quantity.parse(frequency, "Hz", name="frequency"),
        "name": name,
    }


def _tables(table: dict[str, Any], kind: str, keys: dict[str, str]) -> list[dict[str, Any]]:
    """The values of all tables of one kind in SI."""
    tables = table.get(kind, [])
    if not isinstance(tables, list) or not all(isinstance(item, dict) for item in tables):
        raise InputError(f"{kind} must be tables, each opened by a line [[{kind}]]")
    found = []
    for number, item in enumerate(tables, 1):
        where = f"{kind} number {number}"
        for key in item:
            checks.choice(f"{where}: key", key, keys)
        for key in _NEEDED[kind]:
            if key not in item:
                raise InputError(f"{where}: {key} is missing")
        found.append({key: _value(value, keys[key], f"{where}: {key}") for key, value in item.items()})
    return found


def _value(value: Any, kind: str, name: str) -> Any:
    if kind == _TEXT:
        if not isinstance(value, str):
            raise InputError(f"{name} = {value!r} must be text")
        return value
    return checks.finite(name, value) if kind == _NUMBER else quantity.parse(value, kind, name=name)


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
