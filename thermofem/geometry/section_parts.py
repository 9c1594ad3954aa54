"""Elements of a cross-section: layers, parts, boundaries, interfaces, probes, guides and buses; all lengths in m."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from .. import checks
from ..arrays import Array
from ..checks import InputError
from ..data import quantity
from ..materials.material_library import VOID

VERTICAL = math.pi / 2
SAME_POINT = 2e-15  # m; points this close are one (two steps of the grid on which outlines are cut)
THINNEST = 1e-10  # m; less than an atom is no continuum, and surely a slip
POLARISATIONS = ("TE", "TM")
BUSES = ("bus", "drop")  # names of the first and the second one
LIGHT = "light"  # the name under which the temperature that a mode sees is read
MODE = "light_mode"  # key of a model's origin and of a Dataset's attributes: name of that mode, such as "TE0"
WAVELENGTH = "light_wavelength"  # the same: its wavelength in m
AMBIENT = "ambient"  # the name of the input that is the temperature of the ambient
_LONGEST = 0.1  # m; nothing on a chip is longer


@dataclass(frozen=True)
class Layer:
    """One layer of the stack.

    Parameters
    ----------
    name, material : str
    thickness : float, m
    datum : bool
        whether z = 0 lies at the top of this layer.
    """

    name: str
    material: str
    thickness: float
    datum: bool = False

    def __post_init__(self) -> None:
        checks.plain(self)
        checks.check_name("layer", self.name)
        if self.material == VOID:
            raise InputError(f"layer {self.name!r} is void; leave it out, or cut it with a void part")
        length(f"layer {self.name!r}: thickness", self.thickness, typical=2e-6)


def layer_edges(layers: Sequence[Layer]) -> tuple[float, ...]:
    """z of the bottom of every layer, bottom to top, and of the top of the last one, in m."""
    datum = next(k for k, layer in enumerate(layers) if layer.datum) + 1
    thickness = [layer.thickness for layer in layers]
    downwards = thickness[:datum][::-1]
    depths = np.cumsum(downwards)
    heights = np.cumsum(thickness[datum:])
    return (*map(float, -depths[::-1]), 0.0, *map(float, heights))


@dataclass(frozen=True)
class Part:
    """A ring (a disc when ``inner_radius`` is 0) or a straight bar with a rectangular or trapezoidal cross-section.

    Parameters
    ----------
    name, material : str
        material "void" cuts a hole with insulated walls.
    inner_radius, outer_radius : float, m
        of a ring, at half height.
    x, width : float, m
        of a straight bar: its centre, and its width at half height; its edges are then the two radii above.
    bottom, height : float, m
        bottom is counted from the datum; a void of height 0 is no void at all.
    sidewall_angle : float, rad
        pi/2 is vertical; a smaller angle makes the part wider at its foot.
    heated : bool
        whether it may carry absorbed power. Every part and layer can be read.
    resistance : float, ohm
        of a heater between its contacts, at the ambient temperature.
    tcr : float, 1/K
        temperature coefficient of the resistance: R = resistance (1 + tcr dT).
    """

    name: str
    material: str
    inner_radius: float = math.nan
    outer_radius: float = math.nan
    bottom: float = 0.0
    height: float = math.nan
    sidewall_angle: float = VERTICAL
    heated: bool = False
    x: float | None = None
    width: float | None = None
    resistance: float | None = None
    tcr: float = 0.0

    def __post_init__(self) -> None:
        checks.plain(self)
        of = f"part {self.name!r}: "
        checks.check_name("part", self.name)
        if self.x is None and self.width is None:
            outer = length(f"{of}outer_radius", self.outer_radius, typical=8e-6)
            hint = slip(self.inner_radius, 5e-6)
            checks.between(f"{of}inner_radius", self.inner_radius, 0, _LONGEST, unit="m", hint=hint)
            checks.ordered(f"{of}inner_radius", self.inner_radius, "outer_radius", outer, unit="m")
        else:
            hint = slip(self.x, 5e-6)
            x = checks.between(f"{of}x", self.x, -_LONGEST, _LONGEST, unit="m", hint=hint)
            half = length(f"{of}width", self.width, typical=450e-9) / 2
            object.__setattr__(self, "inner_radius", x - half)
            object.__setattr__(self, "outer_radius", x + half)
        hint = slip(self.bottom, 1e-6)
        checks.between(f"{of}bottom", self.bottom, -_LONGEST, _LONGEST, unit="m", hint=hint)
        if self.material != VOID or self.height != 0:
            length(f"{of}height", self.height, typical=220e-9)
        angle = checks.finite(f"{of}sidewall_angle", self.sidewall_angle)
        degrees = math.degrees(angle)
        checks.between(f"{of}sidewall_angle", degrees, 30, 150, unit="deg", hint="90 deg is vertical")
        r = self.outline()[:, 0]
        crossed = r[1] <= r[0] or r[2] <= r[3]
        if crossed or (r.min() < 0 and not self.straight):
            raise InputError(f"{of}the sidewalls cross; the height is too large for a wall of {degrees:g} deg")
        if self.resistance is not None:
            checks.positive(f"{of}resistance", self.resistance, unit="ohm", at_most=1e9)
        checks.between(f"{of}tcr", self.tcr, -0.1, 0.1, unit="1/K", hint="metals have 1e-3 to 4e-3")
        if self.heated and self.material == VOID:
            raise InputError(f"{of}void cannot be heated; give it a material or heated = false")

    @property
    def straight(self) -> bool:
        """Whether it is a bar of a straight section."""
        return self.x is not None

    @property
    def top(self) -> float:
        """Height of its upper face in m."""
        return self.bottom + self.height

    @property
    def middle(self) -> float:
        """Height of its middle in m."""
        return self.bottom + self.height / 2

    @property
    def centre(self) -> float:
        """r or x of its middle in m."""
        return (self.inner_radius + self.outer_radius) / 2

    @property
    def breadth(self) -> float:
        """Width along r or x in m, at half height."""
        return self.outer_radius - self.inner_radius

    def outline(self) -> Array:
        """Corners (r, z) or (x, z) in m, counterclockwise from the inner foot, shape (4, 2)."""
        vertical = abs(self.sidewall_angle - VERTICAL) < 1e-9
        lean = 0.0 if vertical else self.height / 2 / math.tan(self.sidewall_angle)
        inner_lean = lean if self.inner_radius or self.straight else 0.0  # a disc has no inner wall
        inner = self.inner_radius
        outer = self.outer_radius
        foot = [(inner - inner_lean, self.bottom), (outer + lean, self.bottom)]
        head = [(outer - lean, self.top), (inner + inner_lean, self.top)]
        return np.array(foot + head)


def bar(part: Part, x: float, width: float) -> Part:
    """The same part as a straight bar, with the x of its middle and its width at half height in m."""
    return replace(part, x=x, width=width, inner_radius=math.nan, outer_radius=math.nan)


def images(part: Part, other: Part) -> bool:
    """Whether two voids are images of each other in x = 0, one on each side of it."""
    outline = part.outline()
    x = outline[:, 0]
    on_one_side = x.min() * x.max() >= 0
    voids = part.material == other.material == VOID
    mirror = outline[[1, 0, 3, 2]] * [-1, 1]
    distance = np.abs(mirror - other.outline()).max()
    return bool(on_one_side and voids and distance <= SAME_POINT)


class BoundaryKind(NamedTuple):
    """A kind of boundary: the unit of its coefficient, None where it has none, and h in W/(m^2 K) by the coefficient.

    A side without a coefficient has h = 0: what crosses it is another weak form, or nothing.
    """

    unit: str | None = None
    exchange: Callable[[Any], Any] = lambda _: 0.0


@dataclass(frozen=True)
class Boundary:
    """Boundary condition on one side: "isothermal" (held at ambient), "insulated", "convection" or "open".

    Convection carries off ``coefficient`` * (T - ambient) per area; ``coefficient`` is in W/m^2/K. Beyond an open side
    the material goes on: far from the heat T - ambient falls as 1/d, with d the distance from the axis at the height of
    the heat, so that k (n . d)/d^2 (T - ambient) per area crosses it, or (n . d)/(d . k^-1 d) where k_r and
    k_z differ. That holds for one material; what heat along a layer changes is in `HeatProblem.errors`. Beyond a
    straight section the field is that of a line source of its length L on a half space, averaged over L:

        T - ambient = P c(d/L)/(pi k L),    c(u) = asinh(1/u) - sqrt(1 + u^2) + u

    so that k (n . d)/(d^2 c(d/L)) (T - ambient) per area crosses an open side.
    """

    kind: str
    coefficient: float = 0.0
    KINDS: ClassVar[dict[str, BoundaryKind]] = {
        "isothermal": BoundaryKind(),
        "insulated": BoundaryKind(),
        "convection": BoundaryKind("W/m^2/K", lambda h: h),
        "open": BoundaryKind(),
    }

    def __post_init__(self) -> None:
        checks.plain(self)
        unit = self.KINDS[checks.choice("boundary", self.kind, self.KINDS)].unit
        if unit is not None:
            checks.positive(self.kind, self.coefficient, unit=unit, at_most=1e12)

    @property
    def exchange(self) -> float:
        """h in W/(m^2 K) of the heat h (T - ambient) per area that leaves; 0 where the side has another weak form."""
        return float(self.KINDS[self.kind].exchange(self.coefficient))

    @property
    def holds(self) -> bool:
        """Whether it couples the side to the ambient temperature, so that a steady state exists."""
        return self.kind != "insulated"


ISOTHERMAL = Boundary("isothermal")
INSULATED = Boundary("insulated")
OPEN = Boundary("open")


@dataclass(frozen=True)
class Interface:
    """Thermal boundary resistance in m^2 K/W on the whole surface of one part.

    Where the surface lies on an isothermal or convective side of the domain, it is in series with that side. Beyond an
    open side the part goes on, and there is no surface. A resistance below 1e-14 m^2 K/W, such as 0, counts as that of
    1e-14, a hundredth of a picometre of oxide: so it has a derivative.
    """

    part: str
    resistance: float

    def __post_init__(self) -> None:
        checks.plain(self)
        hint = "silicon on oxide has about 1e-8"
        checks.between(f"interface of {self.part!r}: resistance", self.resistance, 0, 1, unit="m^2*K/W", hint=hint)


@dataclass(frozen=True)
class Probe:
    """An additional readout: a shell around a part, or a copy of a part off the axis.

    A shell is everything within ``shell`` of the part that is not the part itself, voids left out. A copy stands for a
    neighbouring ring, which reads the same axisymmetric field off its axis; give either ``shell`` or ``distance``.

    Parameters
    ----------
    name : str
    part : str
        the part around which the shell lies, or which is copied.
    shell : float, m
        thickness of the shell.
    distance : float, m
        from the axis to the centre of the copy.

    Raises
    ------
    InputError
        neither or both of ``shell`` and ``distance``, or a length that cannot be.

    >>> Probe(name="neighbour", part="core", distance=20e-6).distance
    2e-05
    """

    name: str
    part: str
    shell: float | None = None
    distance: float | None = None

    def __post_init__(self) -> None:
        checks.plain(self)
        checks.check_name("probe", self.name)
        if (self.shell is None) == (self.distance is None):
            both = "it has neither" if self.shell is None else "not both"
            raise InputError(f"probe {self.name!r}: give shell, or distance for a copy off the axis; {both}")
        if self.shell is not None:
            length(f"probe {self.name!r}: shell", self.shell, typical=0.3e-6)
        if self.distance is not None:
            length(f"probe {self.name!r}: distance", self.distance, typical=20e-6)


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


def ring(radius: float, width: float, *, of: str = "") -> tuple[float, float]:
    """Inner and outer radius in m of a ring with this centre-line radius and width; ``of`` begins the error message."""
    radius = length(f"{of}radius", radius, typical=8e-6)
    hint = slip(width, 450e-9, radius)
    width = checks.between(f"{of}width", width, THINNEST, math.inf, unit="m", hint=hint)
    if width > 2 * radius:
        raise InputError(f"{of}width = {width:g} m is larger than radius = {radius:g} m allows", hint)
    return radius - width / 2, radius + width / 2


def length(name: str, value: float | None, *, typical: float) -> float:
    """A length in m between the sizes of an atom and of a chip, else InputError; the hint corrects the unit."""
    return checks.between(name, value, THINNEST, _LONGEST, unit="m", hint=slip(value, typical))


def slip(value: float | None, typical: float, at_most: float = _LONGEST) -> checks.Hint:
    """Hint with the length in m that was probably meant, where a value is off by a unit."""
    if not (isinstance(value, int | float) and at_most < abs(value) < 1e300):  # 1e300 m; no hint repairs it
        return checks.Hint("lengths are in metres")
    ratio = abs(value) / typical
    unit = min((1e-3, 1e-6, 1e-9), key=lambda factor: abs(math.log(ratio * factor)))
    meant = value * unit
    power = 3 * math.floor(math.log10(abs(meant)) / 3)
    number = f"{meant / 10**power:g}e{power}"
    written = quantity.rounded(meant, "m", 6)
    text = f'did you mean "{written}" ({number} m)?'
    return checks.Hint(f"lengths are in metres (did you mean {number}?)", text=text)
