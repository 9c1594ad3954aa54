"""The cross-section of a ring in (r, z): layers, parts, boundaries and interfaces, all lengths in m.

z = 0 lies at the top of the layer marked ``datum``. Layers fill the whole stack from the axis to ``outer_radius``; parts
are rings (or discs) that overwrite the layers and earlier parts. A part may also stand on the top of the stack.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import checks
from .materials import VOID, Material, find

if TYPE_CHECKING:
    from .regions import Subdivision

VERTICAL = math.pi / 2
_LONGEST = 0.1  # m; nothing on a chip is longer
_REGION_NAME = re.compile(r"\w[\w .+-]*")


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
        _check_name("layer", self.name)
        if self.material == VOID:
            raise checks.InputError(f"layer {self.name!r} is void; leave it out, or cut it with a void part")
        length(f"layer {self.name!r}: thickness", self.thickness, typical=2e-6)


@dataclass(frozen=True)
class Part:
    """A ring (a disc when ``inner_radius`` is 0) with a rectangular or trapezoidal cross-section.

    Parameters
    ----------
    name, material : str
        material "void" cuts a hole with insulated walls.
    inner_radius, outer_radius : float, m
        at half height.
    bottom, height : float, m
        bottom is counted from the datum.
    sidewall_angle : float, rad
        pi/2 is vertical; a smaller angle makes the part wider at its foot.
    heated : bool
        whether it may carry absorbed power. Every part and layer can be read.
    """

    name: str
    material: str
    inner_radius: float
    outer_radius: float
    bottom: float
    height: float
    sidewall_angle: float = VERTICAL
    heated: bool = False

    def __post_init__(self) -> None:
        of = f"part {self.name!r}: "
        _check_name("part", self.name)
        checks.between(f"{of}inner_radius", self.inner_radius, 0, _LONGEST, unit="m", hint=slip(self.inner_radius, 5e-6))
        length(f"{of}outer_radius", self.outer_radius, typical=8e-6)
        checks.between(f"{of}bottom", self.bottom, -_LONGEST, _LONGEST, unit="m", hint=slip(self.bottom, 1e-6))
        length(f"{of}height", self.height, typical=220e-9)
        if self.inner_radius >= self.outer_radius:
            raise checks.InputError(
                f"{of}inner_radius = {self.inner_radius:g} m must be smaller than outer_radius = {self.outer_radius:g} m"
            )
        degrees = math.degrees(checks.finite(f"{of}sidewall_angle", self.sidewall_angle))
        checks.between(f"{of}sidewall_angle", degrees, 30, 150, unit="deg", hint="90 deg is vertical")
        outline = self.outline()
        if np.any(np.diff(outline[:, 0])[[0, 2]] * [1, -1] <= 0) or outline[:, 0].min() < 0:
            raise checks.InputError(f"{of}the sidewalls cross; the height is too large for a wall of {degrees:g} deg")
        if self.heated and self.material == VOID:
            raise checks.InputError(f"{of}void cannot be heated; give it a material or heated = false")

    @property
    def top(self) -> float:
        """Height of its upper face in m."""
        return self.bottom + self.height

    def outline(self) -> NDArray[np.float64]:
        """Corners (r, z) in m, counterclockwise from the inner foot, shape (4, 2)."""
        vertical = abs(self.sidewall_angle - VERTICAL) < 1e-9
        lean = 0.0 if vertical else self.height / 2 / math.tan(self.sidewall_angle)
        inner_lean = lean if self.inner_radius else 0.0  # a disc has no inner wall
        inner, outer = self.inner_radius, self.outer_radius
        foot = [(inner - inner_lean, self.bottom), (outer + lean, self.bottom)]
        return np.array([*foot, (outer - lean, self.top), (inner + inner_lean, self.top)])


@dataclass(frozen=True)
class Boundary:
    """What one side of the cross-section does: "isothermal" (held at ambient), "insulated" or "convection".

    Convection carries off ``coefficient`` * (T - ambient) per area; ``coefficient`` is in W/m^2/K.
    """

    kind: str
    coefficient: float = 0.0
    KINDS: ClassVar[tuple[str, ...]] = ("isothermal", "insulated", "convection")

    def __post_init__(self) -> None:
        checks.choice("boundary", self.kind, self.KINDS)
        if self.kind == "convection":
            checks.positive("convection", self.coefficient, unit="W/m^2/K", at_most=1e12)
        elif self.coefficient:
            raise checks.InputError(f"boundary {self.kind!r} takes no coefficient; only convection does")

    @property
    def holds(self) -> bool:
        """Whether it ties the temperature to ambient, so that a steady state exists."""
        return self.kind != "insulated"


ISOTHERMAL, INSULATED = Boundary("isothermal"), Boundary("insulated")


@dataclass(frozen=True)
class Interface:
    """Thermal boundary resistance in m^2 K/W on the whole surface of one part."""

    part: str
    resistance: float

    def __post_init__(self) -> None:
        hint = "silicon on oxide has about 1e-8"
        checks.between(f"interface of {self.part!r}: resistance", self.resistance, 0, 1, unit="m^2*K/W", hint=hint)


@dataclass(frozen=True)
class CrossSection:
    """Everything that defines the heat problem of one ring.

    Parameters
    ----------
    name : str
    outer_radius : float, m
        where the domain ends.
    layers : tuple of Layer
        bottom to top, exactly one of them the datum.
    parts : tuple of Part
        a later one overwrites earlier ones and the layers.
    interfaces : tuple of Interface
    bottom, top, outer : Boundary
        "top" is everything that faces up or sideways above the stack, ridges included.
    materials : tuple of Material
        overrides of, and additions to, `materials.LIBRARY`.
    ambient : float, K

    Raises
    ------
    InputError
        whatever contradicts itself; the message names both parties.
    """

    name: str
    outer_radius: float
    layers: tuple[Layer, ...]
    parts: tuple[Part, ...]
    interfaces: tuple[Interface, ...] = ()
    bottom: Boundary = ISOTHERMAL
    top: Boundary = INSULATED
    outer: Boundary = INSULATED
    materials: tuple[Material, ...] = ()
    ambient: float = 293.15

    def __post_init__(self) -> None:
        from .regions import check_held, check_places

        length("outer_radius", self.outer_radius, typical=60e-6)
        checks.between("ambient", self.ambient, 1, 3000, unit="K")
        self._check_names()
        check_places(self)
        if not any(part.heated for part in self.parts):
            raise checks.InputError(f"{self.name!r}: no part is heated; mark one with heated = true")
        if not (self.bottom.holds or self.top.holds or self.outer.holds):
            raise checks.InputError(
                f"{self.name!r}: bottom, top and outer are all insulated, so heat has no way out and no steady state exists; "
                "make one of them isothermal or convective"
            )
        check_held(self)

    def _check_names(self) -> None:
        if not self.layers:
            raise checks.InputError(f"{self.name!r} has no layers; at least one is needed")
        data = [layer.name for layer in self.layers if layer.datum]
        if len(data) != 1:
            raise checks.InputError(f"{len(data)} layers have datum = true; z = 0 lies at the top of exactly one of them")
        names = [item.name for item in (*self.layers, *self.parts)]
        for name in names:
            if names.count(name) > 1:
                raise checks.InputError(f"the name {name!r} stands {names.count(name)} times; layers and parts share names")
        for item in (*self.layers, *self.parts):
            kind = "layer" if isinstance(item, Layer) else "part"
            find(item.material, self.materials, what=f"{kind} {item.name!r}: material")
        solid = [part.name for part in self.parts if part.material != VOID]
        for interface in self.interfaces:
            checks.choice("interface: part", interface.part, solid)

    @property
    def bottom_z(self) -> float:
        """z of the bottom of the stack in m."""
        return self.layer_edges[0]

    @property
    def top_z(self) -> float:
        """z of the top of the stack in m."""
        return self.layer_edges[-1]

    @cached_property
    def layer_edges(self) -> tuple[float, ...]:
        """z of the bottom of every layer and of the top of the last one, in m."""
        datum = next(k for k, layer in enumerate(self.layers) if layer.datum) + 1
        below = -np.cumsum([layer.thickness for layer in self.layers[:datum]][::-1])[::-1]
        above = np.cumsum([layer.thickness for layer in self.layers[datum:]])
        return (*map(float, below), 0.0, *map(float, above))

    @property
    def heated(self) -> tuple[str, ...]:
        """Names of the parts that may carry absorbed power."""
        return tuple(part.name for part in self.parts if part.heated)

    def material_of(self, region: str) -> Material:
        """Material of a layer or part."""
        by_name = {item.name: item.material for item in (*self.layers, *self.parts)}
        return find(by_name[checks.choice("region", region, by_name)], self.materials)

    @cached_property
    def subdivision(self) -> Subdivision:
        """The (r, z) plane cut into faces with one owner each."""
        from .regions import subdivide

        return subdivide(self)

    @property
    def region_names(self) -> tuple[str, ...]:
        """Names of the layers and parts that are there to be meshed, bottom to top and parts last."""
        return tuple(self.volumes())

    def volumes(self) -> dict[str, float]:
        """Exact volume of every region in m^3: the integral of 2 pi r over its faces."""
        return self.subdivision.volumes()

    def on_boundary(self, side: str, r: ArrayLike, z: ArrayLike) -> NDArray[np.bool_]:
        """Which of the points (r, z) in m lie on ``side``: "bottom", "top", "outer", "axis" or "wall" (of a void)."""
        return self.subdivision.on_side(side, np.asarray(r, dtype=float), np.asarray(z, dtype=float))

    def check_buildable(self) -> None:
        """Raise InputError for what the schema allows and this version cannot solve."""
        for interface in self.interfaces:
            if interface.resistance:
                raise checks.InputError(
                    f"interface of {interface.part!r}: a thermal boundary resistance is not supported yet in this version"
                )
        for region in self.region_names:
            material = self.material_of(region)
            if material.exponent:
                raise checks.InputError(
                    f"material {material.name!r} of {region!r}: temperature-dependent conductivity (exponent = "
                    f"{material.exponent:g}) is not supported yet in this version"
                )

    @classmethod
    def from_toml(cls, path: str | Path) -> CrossSection:
        """Read a geometry file.

        Raises
        ------
        InputError
            the file is missing or no TOML, or what it says cannot be; the message begins with the file.
        """
        from .toml_schema import read_file

        return read_file(path)

    @classmethod
    def from_toml_text(cls, text: str) -> CrossSection:
        """Read the text of a geometry file."""
        from .toml_schema import read_text

        return read_text(text)

    def to_toml(self) -> str:
        """The geometry as the text of a geometry file; reading it back gives an equal CrossSection."""
        from .toml_schema import write_text

        return write_text(self)


def strip_ring(
    radius: float = 7.955e-6,
    width: float = 450e-9,
    height: float = 220e-9,
    box: float = 2e-6,
    cladding: float = 2e-6,
    substrate: float = 30e-6,
    outer_radius: float = 60e-6,
) -> CrossSection:
    """A silicon strip ring on buried oxide under oxide, on silicon; the substrate's bottom is held at ambient.

    Parameters
    ----------
    radius : float, m
        to the centre of the core. The default has the perimeter of a racetrack with 7 um bends and 3 um straights.
    width, height : float, m
        of the core.
    box, cladding, substrate : float, m
        thickness of the buried oxide, of the oxide above the top of the core, and of the substrate.
    outer_radius : float, m
        where the domain ends.

    Source: the ring of Borghi et al., Opt. Express 29, 4363 (2021); substrate and outer radius are ours.

    >>> strip_ring(width=500e-9).region_names
    ('substrate', 'box', 'cladding', 'core')
    """
    length("outer_radius", outer_radius, typical=60e-6)
    for name, value, typical in (("box", box, 2e-6), ("cladding", cladding, 2e-6), ("substrate", substrate, 30e-6)):
        length(name, value, typical=typical)
    length("height", height, typical=220e-9)
    length("radius", radius, typical=8e-6)
    if radius > outer_radius:
        raise checks.InputError(
            f"radius = {radius:g} m is larger than outer_radius = {outer_radius:g} m; {slip(radius, 8e-6, outer_radius)}"
        )
    inner, outer = ring(radius, width)
    layers = (
        Layer("substrate", "Si", substrate),
        Layer("box", "SiO2", box, datum=True),
        Layer("cladding", "SiO2", cladding + height),
    )
    core = Part("core", "Si", inner, outer, bottom=0.0, height=height, heated=True)
    return CrossSection("strip ring", outer_radius, layers, (core,))


def ring(radius: float, width: float, *, of: str = "") -> tuple[float, float]:
    """Inner and outer radius in m of a ring from the radius to its centre and its width; ``of`` opens the message."""
    checks.positive(f"{of}radius", radius, unit="m", hint=slip(radius, 8e-6))
    checks.positive(f"{of}width", width, unit="m")
    if width > 2 * radius:
        raise checks.InputError(
            f"{of}width = {width:g} m is larger than radius = {radius:g} m allows; {slip(width, 450e-9, radius)}"
        )
    return radius - width / 2, radius + width / 2


def length(name: str, value: float, *, typical: float) -> float:
    """A positive length in m that fits on a chip; the hint repairs a slip of units."""
    return checks.positive(name, value, unit="m", at_most=_LONGEST, hint=slip(value, typical))


def slip(value: float, typical: float, at_most: float = _LONGEST) -> str:
    """Hint that says what a length in m may have been meant to be."""
    hint = "lengths are in metres"
    if not (isinstance(value, int | float) and at_most < abs(value) < math.inf):
        return hint
    meant = value * min((1e-3, 1e-6, 1e-9), key=lambda factor: abs(math.log(abs(value) * factor / typical)))
    power = 3 * math.floor(math.log10(abs(meant)) / 3)
    return f"{hint} (did you mean {meant / 10**power:g}e{power}?)"


def _check_name(kind: str, name: str) -> None:
    if not (isinstance(name, str) and _REGION_NAME.fullmatch(name)):
        raise checks.InputError(f"{kind} name = {name!r} is not usable; take letters, digits, spaces and _ . + -")
