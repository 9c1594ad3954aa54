"""What guides the light of a cross-section: the tables [light] and [[bus]] of a geometry file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from .. import checks
from ..materials.material_library import VOID
from .section_parts import length

if TYPE_CHECKING:
    from .cross_section import CrossSection

POLARISATIONS = ("TE", "TM")
BUSES = ("bus", "drop")  # names of the first and the second one
LIGHT = "light"  # the name under which the temperature that a mode sees is read


@dataclass(frozen=True)
class Guide:
    """The part of a cross-section that guides, and the light in it.

    Parameters
    ----------
    wavelength : float, m
    part : str
    polarisation : str
        "TE" or "TM": its fundamental mode is taken.
    loss : float, 1/m
        power loss of the guide, which heats.
    """

    wavelength: float
    part: str = "core"
    polarisation: str = "TE"
    loss: float | None = None

    def __post_init__(self) -> None:
        checks.plain(self)
        hint = "did you mean 1.55e-6?"
        checks.between("[light]: wavelength", self.wavelength, 1e-7, 1e-4, unit="m", hint=hint)
        checks.choice("[light]: polarisation", self.polarisation, POLARISATIONS)
        if self.loss is not None:
            checks.between("[light]: loss", self.loss, 0, 1e6, unit="1/m", hint="7 dB/cm are 161 1/m")

    @property
    def mode(self) -> str:
        """Name of the fundamental mode."""
        return f"{self.polarisation}0"


@dataclass(frozen=True)
class Bus:
    """A straight bus beside a ring.

    Parameters
    ----------
    name : str
    gap : float, m
        between the walls of ring and bus at half height.
    straight : float, m
        length of the straight section over which a racetrack couples.
    width : float, m
        default that of the ring's guide.
    """

    name: str
    gap: float
    straight: float = 0.0
    width: float | None = None

    def __post_init__(self) -> None:
        checks.plain(self)
        checks.check_name("bus", self.name)
        length(f"bus {self.name!r}: gap", self.gap, typical=200e-9)
        checks.between(f"bus {self.name!r}: straight", self.straight, 0, 1e-2, unit="m", hint="did you mean 3e-6?")
        if self.width is not None:
            length(f"bus {self.name!r}: width", self.width, typical=450e-9)


def check_guides(section: CrossSection) -> None:
    """InputError where [light] or [[bus]] contradict the parts of a section."""
    if len(section.buses) > len(BUSES):
        raise checks.InputError(f"{len(section.buses)} tables [[bus]]; a ring has one or two")
    checks.unique("[[bus]]: name", [bus.name for bus in section.buses])
    if section.buses and section.kind != "ring":
        raise checks.InputError("[[bus]] goes with a ring; this is a straight section")
    if section.light is None:
        return
    solid = [part.name for part in section.parts if part.material != VOID]
    checks.choice("[light]: part", section.light.part, solid)
    groups = (section.layers, section.parts, section.probes)
    if any(one.name == LIGHT for group in groups for one in group):
        raise checks.InputError(
            f"{section.name!r} has [light], and something called {LIGHT!r}: the name of the temperature that the mode "
            "sees; rename it"
        )
