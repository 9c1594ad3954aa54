"""A circuit of rings: which terminal leads where, checked; fabrication scatter; ready-made ones are in `ready`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from thermofem import checks
from thermofem.data import files

from ..resonator import RingResonator
from . import file
from .parts import IN, OUT, SPLITTER_IN, SPLITTER_OUT, Detector, LaserPort, Splitter, Waveguide, check_name

MOST = 1000  # rings, and splitters
_PARTS = {"waveguides": Waveguide, "lasers": LaserPort, "detectors": Detector, "splitters": Splitter}


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
        reference of detunings, offsets and phases; default the cold resonance of the first ring.
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
        object.__setattr__(self, "rings", _named(self.rings))
        for field, kind in _PARTS.items():
            object.__setattr__(self, field, checks.instances(field, getattr(self, field), kind))
        if len(self.splitters) > MOST:
            raise checks.InputError(f"splitters holds {len(self.splitters)} splitters; at most {MOST} are possible")
        checks.text("name", self.name)
        if self.frequency is None:
            object.__setattr__(self, "frequency", self.resonators[0].frequency)
        checks.between("frequency", self.frequency, 1e13, 1e16, unit="Hz", hint="did you mean 192.88e12?")
        checks.unique(
            "list of names of rings and splitters", [*self.names, *(splitter.name for splitter in self.splitters)]
        )
        checks.unique("list of laser names", [laser.name for laser in self.lasers])
        checks.unique("list of detector names", [detector.name for detector in self.detectors])
        if not self.lasers:
            raise checks.InputError("the circuit has no laser; give lasers=[coupled.LaserPort('in', 'ring 1.in')]")
        for what, terminals, known in (
            ("enter", [*(w.stop for w in self.waveguides), *(laser.stop for laser in self.lasers)], self.entries),
            ("leave", [*(w.start for w in self.waveguides), *(d.start for d in self.detectors)], self.exits),
        ):
            for terminal in terminals:
                if terminal not in known:
                    checks.choice(f"terminal that light {what}s by", terminal, known)
            checks.unique(f"list of terminals that light {what}s by", terminals)

    def __hash__(self) -> int:
        return hash((self.names, self.resonators, self.waveguides, self.lasers, self.detectors, self.splitters))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the rings."""
        return tuple(self.rings)

    @property
    def resonators(self) -> tuple[RingResonator, ...]:
        """The rings themselves, in the order of their names."""
        return tuple(self.rings.values())

    @cached_property
    def entries(self) -> tuple[str, ...]:
        """Terminals that light enters by."""
        rings = [f"{name}.{side}" for name in self.names for side in IN]
        return (*rings, *(f"{splitter.name}.{side}" for splitter in self.splitters for side in SPLITTER_IN))

    @cached_property
    def exits(self) -> tuple[str, ...]:
        """Terminals that light leaves by, in the order of `entries`."""
        rings = [f"{name}.{side}" for name in self.names for side in OUT]
        return (*rings, *(f"{splitter.name}.{side}" for splitter in self.splitters for side in SPLITTER_OUT))

    @cached_property
    def outputs(self) -> dict[str, str]:
        """Name and terminal of every detector, those of free terminals included; not of couplers that do not couple."""
        used = {w.start for w in self.waveguides} | {d.start for d in self.detectors}
        known = {d.name: d.start for d in self.detectors}
        return known | {exit: exit for exit in self.exits if exit not in used and not self._dark(exit)}

    @property
    def ports(self) -> tuple[str, ...]:
        """Names of all detectors."""
        return tuple(self.outputs)

    @property
    def bandwidths(self) -> tuple[float, ...]:
        """Bandwidth of every detector in Hz, in the order of `ports`, 0 for none."""
        known = {d.name: d.bandwidth for d in self.detectors}
        return tuple(known.get(port, 0.0) for port in self.ports)

    def _dark(self, exit: str) -> bool:
        """Whether an exit stays dark: a drop port of a ring without a second coupler, whose add port gets no light."""
        entry = self.entries[self.exits.index(exit)]
        ring = self.rings.get(exit.rpartition(".")[0])
        fed = entry in [*(w.stop for w in self.waveguides), *(laser.stop for laser in self.lasers)]
        return ring is not None and exit.endswith(".drop") and ring.drop_bus_rate == 0 and not fed

    def scattered(self, sigma: float, seed: int = 0) -> Circuit:
        """The circuit with cold resonances that scatter, as fabrication leaves them.

        Parameters
        ----------
        sigma : float, Hz
            standard deviation of a normal distribution; the reference frequency stays.
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
        """Read a circuit file; its keys stand in `coupled.circuit.file`.

        Raises
        ------
        InputError
            a file that cannot be read, unknown or missing keys, or what `Circuit` refuses.
        """
        folder = checks.path("path", path).parent
        return files.read_toml(path, "circuit", lambda text: cls(**file.fields(text, folder)))


def _named(rings: Any) -> dict[str, RingResonator]:
    """Rings by name."""
    if isinstance(rings, RingResonator):
        rings = [rings]
    if not isinstance(rings, Mapping | Sequence) or isinstance(rings, str):
        raise checks.InputError(
            f"rings is a {type(rings).__name__}; give a list of RingResonator, or a dict of them by name"
        )
    if not 1 <= len(rings) <= MOST:
        raise checks.InputError(f"rings holds {len(rings)} rings; 1 to {MOST} are needed")
    named = dict(rings) if isinstance(rings, Mapping) else {f"ring {k}": ring for k, ring in enumerate(rings, 1)}
    named = {check_name("ring", name): ring for name, ring in named.items()}
    for name, ring in named.items():
        checks.instance(f"ring {name!r}", ring, RingResonator, hint="it must be a RingResonator")
    return _ByName(named)


class _ByName(dict[str, RingResonator]):
    """Rings by name, read-only: what is written later is not checked."""

    def _refuse(self, *_: Any, **__: Any) -> Any:
        raise TypeError("the rings of a Circuit cannot be changed; dataclasses.replace makes another Circuit")

    __setitem__ = __delitem__ = __ior__ = update = pop = popitem = clear = setdefault = _refuse

    def __reduce__(self) -> Any:
        """Pickled as a plain dict, which unpickling may fill."""
        return type(self), (dict(self),)
