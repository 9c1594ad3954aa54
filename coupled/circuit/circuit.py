"""A circuit of rings, waveguides, splitters, lasers and detectors, and the file that describes it.

Every ring has two couplers, the first with the terminals "in" and "through", the second with "add" and "drop"; light
enters at "in" and "add":

    s_through = s_in + i sqrt(2 gamma_e) a,    s_drop = s_add + i sqrt(2 gamma_d) a

"ring 2.through" is the terminal "through" of "ring 2". A splitter has "in 1", "in 2", "out 1" and "out 2".
docs/circuits.md shows a file with every key.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from thermofem import InputError, checks
from thermofem.data import files
from thermofem.data.files import NUMBER, TABLES, TEXT, read_table

from ..resonator import PUBLISHED, RingResonator

IN = ("in", "add")
OUT = ("through", "drop")  # of a ring
SPLITTER_IN = ("in 1", "in 2")
SPLITTER_OUT = ("out 1", "out 2")


def _transmission(self: Waveguide | LaserPort) -> complex:
    """Complex amplitude transmission of a waveguide or laser port at the reference frequency."""
    return 10 ** (-self.loss / 20) * complex(math.cos(self.phase), -math.sin(self.phase))


@dataclass(frozen=True)
class Waveguide:
    """A one-way waveguide from an output terminal of a ring or splitter to an input terminal.

        s_stop(t) = 10^(-loss/20) exp(-i phase) s_start(t - delay)

    Parameters
    ----------
    start, stop : str
        an output terminal and an input terminal: "ring 1.through", "ring 2.in".
    loss : float, dB
    phase : float, rad
        total propagation phase at the circuit's reference frequency.
    delay : float, s
        0 neglects the propagation time; then the phase does not depend on the frequency.
    """

    start: str
    stop: str
    loss: float = 0.0
    phase: float = 0.0
    delay: float = 0.0

    def __post_init__(self) -> None:
        checks.plain(self)
        of = f"waveguide from {self.start!r}: "
        checks.between(f"{of}loss", self.loss, 0, 400, unit="dB", hint="a waveguide has no gain; 3 dB is a half")
        checks.finite(f"{of}phase", self.phase, unit="rad")
        checks.between(f"{of}delay", self.delay, 0, 1e-2, unit="s", hint="times are in s (did you mean 1e-9?)")

    transmission = property(_transmission)


@dataclass(frozen=True)
class Splitter:
    """A lossless directional coupler of two waveguides.

        s_out1 = sqrt(1 - cross) s_in1 + i sqrt(cross) s_in2,    s_out2 = i sqrt(cross) s_in1 + sqrt(1 - cross) s_in2

    Parameters
    ----------
    name : str
    cross : float
        fraction of the power coupled to the other waveguide, 0 to 1.
    """

    name: str
    cross: float = 0.5

    def __post_init__(self) -> None:
        checks.plain(self)
        checks.check_name("splitter", self.name)
        checks.between(f"splitter {self.name!r}: cross", self.cross, 0, 1)


@dataclass(frozen=True)
class LaserPort:
    """A laser input of a circuit; `simulate` takes the laser's power under its name.

    Parameters
    ----------
    name, stop : str
        name of the laser, and the input terminal of a ring or splitter that it feeds.
    loss : float, dB
        between laser and terminal.
    phase : float, rad
    offset : float, Hz
        frequency of the laser minus the circuit's reference frequency; it may differ between lasers.
    """

    name: str
    stop: str
    loss: float = 0.0
    phase: float = 0.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        checks.plain(self)
        checks.check_name("laser", self.name)
        checks.between(f"laser {self.name!r}: loss", self.loss, 0, 400, unit="dB")
        checks.finite(f"laser {self.name!r}: phase", self.phase, unit="rad")
        checks.between(f"laser {self.name!r}: offset", self.offset, -5e12, 5e12, unit="Hz", hint="did you mean 1e9?")

    transmission = property(_transmission)


@dataclass(frozen=True)
class Detector:
    """A detector at an output terminal; a terminal without waveguide or detector gets a detector of its own name.

    Parameters
    ----------
    name, start : str
        name of the detector, and the output terminal of a ring or splitter.
    bandwidth : float, Hz
        of a single-pole low pass, dz/dt = 2 pi bandwidth (|s|^2 - z); 0 for a detector without limit.
    """

    name: str
    start: str
    bandwidth: float = 0.0

    def __post_init__(self) -> None:
        checks.plain(self)
        checks.check_name("detector", self.name)
        name = f"detector {self.name!r}: bandwidth"
        checks.between(name, self.bandwidth, 0, 1e13, unit="Hz", hint="10e9 is a detector of 10 GHz")


@dataclass(frozen=True)
class Circuit:
    """Rings, the waveguides between their couplers, lasers and detectors.

        da_i/dt = (i D_i - gamma_i) a_i + i sum_p sqrt(2 gamma_ip) s_in,ip
        s_out,ip = s_in,ip + i sqrt(2 gamma_ip) a_i,       s_in(t) = C s_out(t - delay) + E s_laser(t)

    Parameters
    ----------
    rings : mapping of str to RingResonator, or sequence
        by name; a sequence is called "ring 1", "ring 2" and so on.
    waveguides : sequence of Waveguide
    lasers : sequence of LaserPort
    detectors : sequence of Detector
        a free terminal that none names has one called after itself, such as "ring 3.drop".
    splitters : sequence of Splitter
    frequency : float, Hz, optional
        reference of detunings, offsets and phases: a laser's frequency is this, its offset and its detuning. Default
        the cold resonance of the first ring.
    name : str

    Raises
    ------
    InputError
        names used twice, terminals that do not exist or are used twice, no laser, no ring.

    Source: W. Suh, Z. Wang and S. Fan, IEEE J. Quantum Electron. 40, 1511 (2004).

    >>> import coupled
    >>> coupled.bus([coupled.borghi2021()] * 2).ports
    ('through', 'drop 1', 'drop 2')
    """

    rings: Any
    waveguides: Sequence[Waveguide] = ()
    lasers: Sequence[LaserPort] = ()
    detectors: Sequence[Detector] = ()
    splitters: Sequence[Splitter] = ()
    frequency: float | None = None
    name: str = "circuit"

    def __post_init__(self) -> None:
        checks.plain(self)
        given = [self.rings] if isinstance(self.rings, RingResonator) else self.rings
        if not isinstance(given, Mapping):
            given = {f"ring {k}": ring for k, ring in enumerate(given, 1)}
        object.__setattr__(self, "rings", dict(given))
        for name, ring in self.rings.items():
            checks.check_name("ring", name)
            checks.instance(f"ring {name!r}", ring, RingResonator, hint="it must be a RingResonator")
        for field, kind in _KINDS.items():
            object.__setattr__(self, field, checks.instances(field, getattr(self, field), kind))
        for what, some in (("ring", self.rings), ("laser", self.lasers)):
            if not some:
                raise InputError(f"the circuit has no {what}", "lasers=[coupled.LaserPort('in', 'ring 1.in')]")
        checks.text("name", self.name)
        if self.frequency is None:
            object.__setattr__(self, "frequency", self.resonators[0].frequency)
        checks.between("frequency", self.frequency, 1e13, 1e16, unit="Hz", hint="did you mean 192.88e12?")
        checks.unique("list of names of rings and splitters", [*self.names, *(s.name for s in self.splitters)])
        checks.unique("list of laser names", [laser.name for laser in self.lasers])
        checks.unique("list of detector names", [detector.name for detector in self.detectors])
        stops = [w.stop for w in self.waveguides] + [laser.stop for laser in self.lasers]
        starts = [w.start for w in self.waveguides] + [detector.start for detector in self.detectors]
        for what, terminals, places in (("enter", stops, self.entries), ("leave", starts, self.exits)):
            for terminal in terminals:
                checks.choice(f"terminal that light {what}s by", terminal, places)
            checks.unique(f"list of terminals that light {what}s by", terminals)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the rings."""
        return tuple(self.rings)

    @property
    def resonators(self) -> tuple[RingResonator, ...]:
        """The rings of the circuit, in the order of `names`."""
        return tuple(self.rings.values())

    @cached_property
    def entries(self) -> tuple[str, ...]:
        """Input terminals of all rings and splitters, such as "ring 1.in"."""
        return self._terminals(IN, SPLITTER_IN)

    @cached_property
    def exits(self) -> tuple[str, ...]:
        """Output terminals of all rings and splitters, in the order of `entries`."""
        return self._terminals(OUT, SPLITTER_OUT)

    def _terminals(self, of_ring: Sequence[str], of_splitter: Sequence[str]) -> tuple[str, ...]:
        rings = [f"{name}.{side}" for name in self.names for side in of_ring]
        splitters = [f"{splitter.name}.{side}" for splitter in self.splitters for side in of_splitter]
        return (*rings, *splitters)

    @cached_property
    def outputs(self) -> dict[str, str]:
        """Output terminal of each detector by name, free terminals included, but not drop ports without light."""
        known = {d.name: d.start for d in self.detectors}
        fed = {w.stop for w in self.waveguides} | {laser.stop for laser in self.lasers}
        alone = {name for name, ring in self.rings.items() if ring.drop_bus_rate == 0 and f"{name}.add" not in fed}
        used = {*known.values(), *(w.start for w in self.waveguides), *(f"{name}.drop" for name in alone)}
        return known | {exit: exit for exit in self.exits if exit not in used}

    @property
    def ports(self) -> tuple[str, ...]:
        """Names of all detectors, in the order of the port coordinate of results."""
        return tuple(self.outputs)

    @property
    def bandwidths(self) -> tuple[float, ...]:
        """Bandwidth of every detector in Hz, in the order of `ports`, 0 for none."""
        known = {d.name: d.bandwidth for d in self.detectors}
        return tuple(known.get(port, 0.0) for port in self.ports)

    def scattered(self, sigma: float, seed: int = 0) -> Circuit:
        """The circuit with random shifts of its cold resonances, as fabrication causes them.

        Parameters
        ----------
        sigma : float, Hz
            standard deviation of the normal distribution of shifts; the reference frequency is unchanged.
        seed : int
        """
        sigma = checks.between("sigma", sigma, 0, 1e13, unit="Hz", hint="1 nm of wavelength is about 125e9 Hz")
        shift = np.random.default_rng(checks.seed(seed)).normal(0.0, sigma, len(self.names))
        rings = {
            name: replace(ring, frequency=ring.frequency + float(df))
            for (name, ring), df in zip(self.rings.items(), shift, strict=True)
        }
        return replace(self, rings=rings)

    @classmethod
    def from_toml(cls, path: str | Path) -> Circuit:
        """Read a circuit file; docs/circuits.md shows one with every key.

        Raises
        ------
        InputError
            a file that cannot be read, unknown or missing keys, or what `Circuit` refuses.
        """
        folder = checks.path("path", path).parent
        return files.read_toml(path, "circuit", lambda text: cls(**_fields(text, folder)))


_KINDS = {"waveguides": Waveguide, "lasers": LaserPort, "detectors": Detector, "splitters": Splitter}
# of a key in a circuit file; others are text
_UNITS = {"loss": NUMBER, "cross": NUMBER, "phase": "rad", "delay": "s", "offset": "Hz", "bandwidth": "Hz"}


def _fields(text: str, folder: Path) -> dict[str, Any]:
    """Parse a circuit file into the fields of `Circuit`; paths of ring files are relative to ``folder``."""
    tables_of = ["ring", *(kind[:-1] for kind in _KINDS)]
    keys = {"name": TEXT, "frequency": "Hz"} | dict.fromkeys(tables_of, TABLES)
    circuit = read_table(files.from_toml(text), keys, "the circuit file")

    def tables(kind: str, keys: dict[str, str], required: Sequence[str]) -> list[dict[str, Any]]:
        several = enumerate(circuit.pop(kind, []), 1)
        return [read_table(item, keys, f"{kind} number {k}", required=required) for k, item in several]

    rings = tables("ring", {"name": TEXT, "base": TEXT, "file": TEXT, "shift": "Hz"}, ["name"])
    checks.unique("list of ring names", [table["name"] for table in rings])
    for kinds, make in _KINDS.items():
        units = {field.name: _UNITS.get(field.name, TEXT) for field in fields(make)}
        needed = [field.name for field in fields(make) if field.default is MISSING]
        circuit[kinds] = [make(**values) for values in tables(kinds[:-1], units, needed)]
    circuit["rings"] = {table["name"]: _ring(table, folder) for table in rings}
    return circuit


def _ring(values: dict[str, Any], folder: Path) -> RingResonator:
    """The ring that a [[ring]] table names, a published set or a ring file, with its resonance shifted."""
    where = f"ring {values['name']!r}"
    if ("base" in values) == ("file" in values):
        raise InputError(f"{where}: give base (one of {', '.join(PUBLISHED)}) or file")
    if "base" in values:
        ring = PUBLISHED[checks.choice(f"{where}: base", values["base"], PUBLISHED)]()
    else:
        ring = RingResonator.from_toml(folder / values["file"])
    return replace(ring, frequency=ring.frequency + values.get("shift", 0.0))


LASERS = (LaserPort("in", "ring 1.in"),)  # of the circuits below


def bus(
    rings: RingResonator | Sequence[RingResonator],
    *,
    shift: float | Sequence[float] = 0.0,
    phase: float = 0.0,
    loss: float = 0.0,
    delay: float = 0.0,
) -> Circuit:
    """Return a circuit of rings in series on one bus, each with its own drop port: a filter bank.

    Laser "in"; detectors "through", and "drop 1" to "drop N" for rings with a second coupler.

    Parameters
    ----------
    rings : RingResonator or sequence of RingResonator
        in the order in which the light of the bus passes them.
    shift : float or sequence of float, Hz
        added to the cold resonance of every ring, or of each; detunings count from that of the first ring, shifted.
    phase, loss, delay : float; rad, dB, s
        of the waveguide between two rings.

    Raises
    ------
    InputError
        no ring, shifts of another number of rings, or a loss or delay below zero.

    >>> import coupled
    >>> coupled.bus(coupled.borghi2021()).ports
    ('through', 'drop 1')
    """
    every = _several(rings, shift)
    n = len(every)
    between = _chain(n, "through", "in", loss, phase, delay)
    drops = [Detector(f"drop {k}", f"ring {k}.drop") for k, ring in enumerate(every, 1) if ring.drop_bus_rate]
    through = Detector("through", f"ring {n}.through")
    return Circuit(every, between, LASERS, (through, *drops), name="bus")


def scissor(
    rings: RingResonator | Sequence[RingResonator],
    *,
    shift: float | Sequence[float] = 0.0,
    phase: float = 0.0,
    loss: float = 0.0,
    delay: float = 0.0,
) -> Circuit:
    """Return a SCISSOR: rings in parallel between two buses, with light in the second bus running backwards.

    The drop output of a ring feeds "add" of the previous ring. Rings with one coupler give a chain of all-pass filters.
    Laser "in"; detectors "through" at the far end of the first bus, "drop" at the near end of the second.

    Parameters
    ----------
    rings : RingResonator or sequence of RingResonator
        in the order in which the light of the first bus passes them.
    shift : float or sequence of float, Hz
        as for `bus`.
    phase, loss, delay : float; rad, dB, s
        of the waveguide between two rings, on each bus.

    Raises
    ------
    InputError
        as `bus`.

    >>> import coupled
    >>> coupled.scissor([coupled.borghi2021()] * 3).ports
    ('through', 'drop')
    """
    every = _several(rings, shift)
    n = len(every)
    ways = _chain(n, "through", "in", loss, phase, delay)
    detectors = [Detector("through", f"ring {n}.through")]
    if any(ring.drop_bus_rate for ring in every):
        ways += _chain(n, "drop", "add", loss, phase, delay, back=True)
        detectors.append(Detector("drop", "ring 1.drop"))
    return Circuit(every, ways, LASERS, detectors, name="scissor")


def crow(rings: RingResonator | Sequence[RingResonator], *, shift: float | Sequence[float] = 0.0) -> Circuit:
    """Return a CROW (coupled-resonator optical waveguide): a chain of directly coupled rings.

    Neighbouring rings share a coupler. It is modelled by the second coupler of the one and the first of the other with
    a quarter-wave waveguide each way, so da_1/dt = ... - i mu a_2 with mu = sqrt(gamma_d1 gamma_e2), and the losses
    into these two couplers cancel. Laser "in" on the first ring; detectors "through" there, "drop" on the last ring.

    Parameters
    ----------
    rings : RingResonator or sequence of RingResonator
        from the one with the laser to the one with the drop port, each with two couplers.
    shift : float or sequence of float, Hz
        as for `bus`.

    Raises
    ------
    InputError
        no ring, shifts of another number of rings, or a ring without a second coupler.

    >>> import coupled
    >>> coupled.crow([coupled.borghi2021()] * 3).ports
    ('through', 'drop')
    """
    every = _several(rings, shift)
    n = len(every)
    quarter = -math.pi / 2
    for k, ring in enumerate(every, 1):
        checks.positive(f"drop_rate of ring {k}", ring.drop_bus_rate, hint="a second coupler leads to the next ring")
    ways = _chain(n, "drop", "in", 0.0, quarter) + _chain(n, "through", "add", 0.0, quarter, back=True)
    detectors = (Detector("through", "ring 1.through"), Detector("drop", f"ring {n}.drop"))
    return Circuit(every, ways, LASERS, detectors, name="crow")


def _several(rings: RingResonator | Sequence[RingResonator], shift: float | Sequence[float]) -> list[RingResonator]:
    """The rings as a list, each with its cold resonance shifted; ``shift`` in Hz."""
    every = [rings] if isinstance(rings, RingResonator) else list(rings)
    shifts = checks.numbers("shift", shift)
    if shifts.ndim == 0:
        shifts = np.full(len(every), shifts)
    checks.shape("shift", shifts, (len(every),))
    return [replace(ring, frequency=ring.frequency + float(df)) for ring, df in zip(every, shifts, strict=True)]


def _chain(rings: int, start: str, stop: str, *of: float, back: bool = False) -> list[Waveguide]:
    """Waveguides from each ring to the next, or with ``back`` to the previous one; ``of`` are loss, phase and delay."""
    pairs = [(k + 1, k) if back else (k, k + 1) for k in range(1, rings)]
    return [Waveguide(f"ring {a}.{start}", f"ring {b}.{stop}", *of) for a, b in pairs]
