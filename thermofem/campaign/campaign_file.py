"""The varied quantities and the drives of a campaign, and its file: TOML with units in, fields of a `Campaign` out.

geometry = "strip.toml"                # beside this file; or [geometry] with the same tables inside
samples = 100                          # points of the Latin hypercube; seed = 0
[[vary]]                               # path, and values | from, to, count | from, to; optional name, spacing
[[drive]]                              # power, and pulse | square, duty, periodic; optional name, duration, samples
[probes]                               # heated, read

A family needs no [[drive]]; a run does.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .. import checks, waveforms
from ..arrays import Array
from ..checks import InputError
from ..data import files, quantity
from ..data.files import ANY, FLAG, NUMBER, TABLE, TABLES, TEXT, read_table, to_toml

# names of variables and dimensions of one result; each drive is a group beside them
RESULT = ("time", "power", "delta_T", "probe", "field", "field_time", "vertex", "triangle", "triangles", "corner", "r")

Value = float | str


@dataclass(frozen=True)
class Variation:
    """One varied quantity: listed values, or a range from which a Latin hypercube draws.

    Parameters
    ----------
    name : str
        its name in the index.
    paths : tuple of str
        where the geometry takes it: "part.core.width", "layer.box.thickness", "material.SiO2.conductivity",
        "interface.core.resistance", "boundary.top.convection", "outer_radius"; several take the same value.
    unit : str
        SI unit of the values.
    values : tuple
        numbers in SI, or words (a material); crossed with the values of every other listed variation.
    low, high : float
        ends of the range to draw from, where there are no values.
    logarithmic : bool
        draw evenly in the logarithm.
    """

    name: str
    paths: tuple[str, ...]
    unit: str = ""
    values: tuple[Value, ...] = ()
    low: float = math.nan
    high: float = math.nan
    logarithmic: bool = False

    def __post_init__(self) -> None:
        checks.check_name("vary:", self.name)
        checks.choice(f"vary {self.name!r}: unit", self.unit, quantity.SI, hint="it is in SI")
        if self.values:
            return
        low = checks.finite(f"{self.name}: from", self.low)
        high = checks.finite(f"{self.name}: to", self.high)
        checks.ordered(f"{self.name}: from", low, "to", high)
        if self.logarithmic:
            checks.positive(f"{self.name}: from", low, hint="the spacing is logarithmic")

    def at(self, share: float) -> float:
        """Value at the fraction ``share`` (0 to 1) of the range."""
        if self.logarithmic:
            return float(self.low * (self.high / self.low) ** share)
        return float(self.low + share * (self.high - self.low))

    def text(self, value: Value) -> str:
        """A value as the geometry file writes it."""
        return value if isinstance(value, str) else quantity.write(value, self.unit)


@dataclass(frozen=True)
class Drive:
    """One drive of every geometry: a waveform with the times to keep, or one period of its periodic state.

    Parameters
    ----------
    name : str
    wave : Waveform
    times : tuple of float, s
        empty for the periodic state.
    samples : int
        of the periodic state.
    """

    name: str
    wave: waveforms.Waveform
    times: tuple[float, ...] = ()
    samples: int = 301

    def __post_init__(self) -> None:
        if not checks.check_name("drive", self.name).isidentifier() or self.name in RESULT:
            raise InputError(
                f"drive name = {self.name!r} is not usable", f"take letters, digits and _, not {RESULT[0]}"
            )
        self.kept  # noqa: B018  an impossible sampling raises here, not in a thousand workers

    @property
    def kept(self) -> Array:
        """Times in s at which the result is stored: ``times``, or ``samples`` of them over one period."""
        if self.times:
            return checks.array(f"drive {self.name!r}: times", self.times, increasing=True)
        return waveforms.period_times(self.wave, self.samples)


_TOP = {
    "name": TEXT, "geometry": ANY, "samples": ANY, "seed": ANY, "accuracy": NUMBER, "rtol": NUMBER, "vary": TABLES,
    "drive": TABLES, "probes": TABLE,
}  # fmt: skip
_PROBES = {"heated": ANY, "read": ANY}
_VARY = {"path": ANY, "name": TEXT, "values": ANY, "from": ANY, "to": ANY, "count": ANY, "spacing": ANY}
_DRIVE = {
    "name": TEXT, "power": "W", "pulse": "s", "square": "s", "duty": NUMBER, "periodic": FLAG, "duration": "s",
    "first": "s", "samples": ANY, "spacing": ANY,
}  # fmt: skip
MOST_POINTS = 1_000_000  # points of a hypercube, values of a quantity, samples of a drive
_UNITS = ("m", "K", "rad", "W/m/K", "kg/m^3", "J/kg/K", "W/m^2/K", "m^2*K/W", "1/m", "1/K", "")


def fields(text: str, folder: Path) -> dict[str, Any]:
    """The fields of the `Campaign` that the text of a campaign file describes; geometry files lie in ``folder``."""
    top = read_table(files.from_toml(text), _TOP, "the file", required=("geometry",))
    probes = read_table(top.get("probes", {}), _PROBES, "[probes]")
    read = probes.get("read", [])
    if read != []:
        read = checks.check_names("[probes]: read", [read] if isinstance(read, str) else read)
    heated = probes.get("heated")
    return {
        "geometry": _geometry(top["geometry"], folder),
        "variations": tuple(_variation(item, k) for k, item in enumerate(top.get("vary", []), 1)),
        "drives": tuple(_drive(item, k) for k, item in enumerate(top.get("drive", []), 1)),
        "name": top.get("name", "campaign"),
        "heated": heated if heated is None else checks.check_name("[probes]: heated", heated),
        "read": tuple(read),
        "accuracy": top.get("accuracy", 1e-3),
        "rtol": top.get("rtol", 1e-4),
        "samples": checks.integer("samples", top.get("samples", 0), 0, MOST_POINTS),
        "seed": checks.integer("seed", top.get("seed", 0), 0, MOST_POINTS),
    }


def _geometry(given: Any, folder: Path) -> str:
    """Text of the base geometry, checked to be a valid geometry."""
    from ..geometry import CrossSection

    if isinstance(given, dict):
        text = to_toml(given)
        CrossSection.from_toml_text(text)
        return text
    path = folder / checks.text("geometry, the name of a file or a table", given)
    CrossSection.from_toml(path)
    return files.read_text(path, "geometry")


def _variation(table: dict[str, Any], k: int) -> Variation:
    given = table.get("path")
    where = f"vary {given if isinstance(given, str) else k}"
    table = read_table(table, _VARY, where, required=("path",))
    paths = checks.check_names(f"{where}: path", [given] if isinstance(given, str) else given)
    name = table.get("name", paths[0])
    logarithmic = checks.choice(f"{where}: spacing", table.get("spacing", "linear"), ("linear", "log")) == "log"
    listed = table.get("values")
    keys = {"values", "from", "to", "count"} & set(table)
    empty = listed is not None and not (isinstance(listed, list) and listed)
    if empty or keys not in ({"values"}, {"from", "to"}, {"from", "to", "count"}):
        raise InputError(f"{where}: give values = [...], or from and to, not both")
    if listed is not None:
        unit, values = _listed(listed, where)
        return Variation(name, paths, unit, values)
    unit, (begin, end) = _listed([table["from"], table["to"]], where)
    low = checks.finite(f"{where}: from", begin)
    high = checks.finite(f"{where}: to", end)
    free = Variation(name, paths, unit, low=low, high=high, logarithmic=logarithmic)
    if "count" not in table:
        return free
    count = checks.integer(f"{where}: count", table["count"], 2, MOST_POINTS)
    values = tuple(float(f"{free.at(share):.9g}") for share in np.linspace(0, 1, count))
    return Variation(name, paths, unit, values)


def _listed(texts: list[Any], where: str) -> tuple[str, tuple[Value, ...]]:
    """Common SI unit of the listed texts, and their values in SI; words, such as materials, stay text with unit ""."""
    for unit in _UNITS:
        try:
            return unit, tuple(quantity.parse(text, unit, name=where) for text in texts)
        except InputError:
            continue
    if all(isinstance(text, str) and text[:1].isalpha() for text in texts):
        return "", tuple(texts)
    raise InputError(
        f'{where}: {checks.shown(texts)} are not all quantities of one kind; write each with its unit, "450 nm"'
    )


def _drive(table: dict[str, Any], k: int) -> Drive:
    where = f"drive {table.get('name', k)}"
    table = read_table(table, _DRIVE, where)
    watts = table.get("power", 1e-3)
    periodic = table.get("periodic", False)
    kind = next((kind for kind in ("pulse", "square") if kind in table), "step")
    spacing = table.get("spacing", "log" if kind == "step" else "linear")
    faults = {
        "pulse and square exclude each other; give one": kind == "pulse" and "square" in table,
        "duty goes with square: a pulse or a step has none": "duty" in table and "square" not in table,
        'first goes with spacing = "log"; even times begin at 0': "first" in table and spacing == "linear",
    }
    if periodic and "square" in table:
        for key in ("duration", "first", "spacing"):
            faults[f"{key} is that of a transient, not of a periodic state"] = key in table
    for fault, applies in faults.items():
        if applies:
            raise InputError(f"{where}: {fault}")
    wave: waveforms.Waveform = waveforms.Constant(watts)
    if kind == "pulse":
        wave = waveforms.Pulse(watts, table["pulse"])
    elif kind == "square":
        wave = waveforms.SquareWave(watts, table["square"], table.get("duty", 1 / 3))
    name = table.get("name", kind)
    if periodic:
        samples = checks.integer(f"{where}: samples", table.get("samples", 301), 3, MOST_POINTS)
        return Drive(name, wave, samples=samples)
    checks.choice(f"{where}: spacing", spacing, ("linear", "log"))
    return Drive(name, wave, _times(table, where, spacing))


def _times(table: dict[str, Any], where: str, spacing: str) -> tuple[float, ...]:
    """Times of a transient in s: 0, then evenly spaced in time, or in its logarithm from ``first`` on."""
    duration = checks.positive(f"{where}: duration", table.get("duration", 40e-6), unit="s")
    samples = checks.integer(f"{where}: samples", table.get("samples", 81 if spacing == "log" else 401), 2, MOST_POINTS)
    if spacing == "linear":
        return tuple(map(float, np.linspace(0, duration, samples)))
    first = checks.positive(f"{where}: first", table.get("first", 1e-9), unit="s", at_most=duration)
    return (0.0, *map(float, np.geomspace(first, duration, max(samples - 1, 2))))
