"""The pieces of a circuit: waveguides, splitters, lasers and detectors, between terminals that have names.

Every ring has two couplers. Light enters the one at the terminal "in" and leaves at "through", and the other at "add"
and "drop":

    s_through = s_in + i sqrt(2 gamma_e) a,    s_drop = s_add + i sqrt(2 gamma_d) a

"ring 2.through" is that terminal of the ring called "ring 2". A splitter has "in 1", "in 2", "out 1" and "out 2".
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from thermofem import checks

IN, OUT = ("in", "add"), ("through", "drop")  # of a ring
SPLITTER_IN, SPLITTER_OUT = ("in 1", "in 2"), ("out 1", "out 2")
_NAME = re.compile(r"\w[\w +-]*")


def check_name(kind: str, name: str) -> str:
    """Return a name that can be used, or raise InputError."""
    if not (isinstance(name, str) and _NAME.fullmatch(name)):
        raise checks.InputError(f"{kind} name = {name!r} is not usable; take letters, digits, spaces and _ + -")
    return name


def _transmission(self: Waveguide | LaserPort) -> complex:
    """Amplitude at the terminal that the light enters by, per amplitude before it, at the reference frequency."""
    return 10 ** (-self.loss / 20) * complex(math.cos(self.phase), -math.sin(self.phase))


@dataclass(frozen=True)
class Waveguide:
    """Light from one terminal to another.

        s_stop(t) = 10^(-loss/20) exp(-i phase) s_start(t - delay)

    Parameters
    ----------
    start, stop : str
        a terminal that light leaves by, and one that it enters by: "ring 1.through", "ring 2.in".
    loss : float, dB
    phase : float, rad
        whole phase of the light at the circuit's reference frequency.
    delay : float, s
        0 for a waveguide that is short against all that happens; then the phase does not depend on the frequency.
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
        share of the power that changes the waveguide, 0 to 1.
    """

    name: str
    cross: float = 0.5

    def __post_init__(self) -> None:
        checks.plain(self)
        check_name("splitter", self.name)
        checks.between(f"splitter {self.name!r}: cross", self.cross, 0, 1)


@dataclass(frozen=True)
class LaserPort:
    """Where light comes in; its power is given to `simulate` under its name.

    Parameters
    ----------
    name, stop : str
        the terminal that it enters by.
    loss : float, dB
        on the way there.
    phase : float, rad
    offset : float, Hz
        its frequency minus that of the circuit's reference; several lasers may have different ones.
    """

    name: str
    stop: str
    loss: float = 0.0
    phase: float = 0.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        checks.plain(self)
        check_name("laser", self.name)
        checks.between(f"laser {self.name!r}: loss", self.loss, 0, 400, unit="dB")
        checks.finite(f"laser {self.name!r}: phase", self.phase, unit="rad")
        checks.between(f"laser {self.name!r}: offset", self.offset, -5e12, 5e12, unit="Hz", hint="did you mean 1e9?")

    transmission = property(_transmission)


@dataclass(frozen=True)
class Detector:
    """Where light is read; a terminal without a waveguide has a detector of its own name anyway.

    Parameters
    ----------
    name, start : str
        the terminal that light leaves by.
    bandwidth : float, Hz
        of a single-pole low pass, dz/dt = 2 pi bandwidth (|s|^2 - z); 0 for a detector without limit.
    """

    name: str
    start: str
    bandwidth: float = 0.0

    def __post_init__(self) -> None:
        checks.plain(self)
        check_name("detector", self.name)
        name = f"detector {self.name!r}: bandwidth"
        checks.between(name, self.bandwidth, 0, 1e13, unit="Hz", hint="10e9 is a detector of 10 GHz")
