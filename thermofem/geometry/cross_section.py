"""The cross-section of a ring in (r, z) or of a straight guide in (x, z); all lengths in m.

z = 0 lies at the top of the layer marked ``datum``. Layers fill the whole stack from the axis to ``outer_radius``,
or from -``half_width`` to ``half_width``; parts are rings (or discs) or straight bars that overwrite the layers and
earlier parts. A part may also stand on the top of the stack.

A copy of a part off the axis reads the field of one ring alone at another place, where the stack must be laterally
uniform: of the heated ring nothing may reach there but the layers, and parts that cover the whole domain.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from .. import checks
from ..arrays import ArrayLike, Mask
from ..checks import InputError
from ..data import files
from ..materials.material_laws import beyond_table
from ..materials.material_library import VOID, Material, find
from . import geometry_file, parameter_paths, section_parts
from .regions import Subdivision, check_held, check_places, subdivide
from .resistor import Resistor, check_resistors, known_resistor
from .section_parts import Boundary, Bus, Guide, Interface, Layer, Part, Probe, images, length

SECTION_KINDS = ("ring", "straight")

_LISTS = {"layers": Layer, "parts": Part, "interfaces": Interface, "materials": Material, "probes": Probe, "buses": Bus}


@dataclass(frozen=True)
class CrossSection:
    """Everything that defines the heat problem of one ring, or of one straight guide.

    Parameters
    ----------
    name : str
    outer_radius : float, m
        where the domain of a ring ends; that of a straight section ends at ``half_width``.
    layers : tuple of Layer
        bottom to top, exactly one of them the datum.
    parts : tuple of Part
        a later one overwrites earlier ones and the layers.
    interfaces : tuple of Interface
    bottom, top, outer : Boundary
        "top" is everything that faces up or sideways above the stack, ridges included; it cannot be open.
    materials : tuple of Material
        overrides of, and additions to, `materials.LIBRARY`.
    ambient : float, K
    probes : tuple of Probe
        shells around parts, and copies of parts beside the axis, that can be read beside the layers and parts.
    kind : str
        "ring" or "straight".
    length, half_width : float, m
        of a straight section: along the guide, and from x = 0 to either end of the domain. Heat does not flow along the
        guide: what leaves through its ends is neglected.
    light : Guide
        what guides, and at which wavelength; "light" can then be read like a part: the temperature that the mode sees.
    buses : tuple of Bus
        none, one or two.
    straight : float, m
        length of each of the two straights of a racetrack, whose bends are the ring; 0 is a circle. The FEM solves
        circles: heat of a racetrack is that of `surrogate.reduce_layout`, from `read_layout` of its file.

    Raises
    ------
    InputError
        whatever contradicts itself; the message names both parties.
    """

    name: str
    outer_radius: float = math.nan
    layers: tuple[Layer, ...] = ()
    parts: tuple[Part, ...] = ()
    interfaces: tuple[Interface, ...] = ()
    bottom: Boundary = section_parts.ISOTHERMAL
    top: Boundary = section_parts.INSULATED
    outer: Boundary = section_parts.INSULATED
    materials: tuple[Material, ...] = ()
    ambient: float = 293.15
    probes: tuple[Probe, ...] = ()
    kind: str = "ring"
    length: float | None = None
    half_width: float | None = None
    light: Guide | None = None
    buses: tuple[Bus, ...] = ()
    straight: float = 0.0

    def __post_init__(self) -> None:
        checks.plain(self)
        checks.text("name", self.name)
        for field, kind in _LISTS.items():
            object.__setattr__(self, field, checks.instances(field, getattr(self, field), kind))
        checks.instances("the boundary", (self.bottom, self.top, self.outer), Boundary)
        self._check_kind()
        checks.between("ambient", self.ambient, 1, 3000, unit="K")
        self._check_names()
        check_places(self)
        check_copies(self)
        if not any(part.heated for part in self.parts):
            raise InputError(f"{self.name!r}: no part is heated; mark one with heated = true")
        if not (self.bottom.holds or self.top.holds or self.outer.holds):
            raise InputError(
                f"{self.name!r}: bottom, top and outer are all insulated, so heat has no way out and no steady state "
                "exists; make one of them isothermal or convective"
            )
        hint = "only bottom and outer can be open; give top a convection"
        checks.choice("top", self.top.kind, Boundary.KINDS.keys() - {"open"}, hint=hint)
        check_held(self)
        check_resistors(self)
        checks.between("number of [[bus]] tables", len(self.buses), 0, 2, hint="a ring has one or two")
        checks.unique("[[bus]]: name", [bus.name for bus in self.buses])

    def _check_kind(self) -> None:
        """Check that the sizes of the domain and all parts belong to the kind of section."""
        if checks.choice("kind", self.kind, SECTION_KINDS) == "straight":
            length("length", self.length, typical=300e-6)
            object.__setattr__(self, "outer_radius", length("half_width", self.half_width, typical=60e-6))
        elif self.length is not None or self.half_width is not None:
            raise InputError(f'{self.name!r}: length and half_width belong to kind = "straight"')
        else:
            length("outer_radius", self.outer_radius, typical=60e-6)
        self._check_plan()
        for part in self.parts:
            if part.straight != (self.kind == "straight"):
                given = "x and width" if self.kind == "straight" else "radius and width, or inner_radius, outer_radius"
                raise InputError(f"part {part.name!r} of a {self.kind} section needs {given}")

    def _check_plan(self) -> None:
        """Check that a racetrack has bends, and nothing that its straights would not have."""
        hint = section_parts.slip(self.straight, 3e-6)
        checks.between("[plan]: straight", self.straight, 0.0, 1e-2, unit="m", hint=hint)
        if not self.straight:
            return
        if self.kind == "straight":
            raise InputError(f'{self.name!r}: [plan] straight belongs to a ring, not to kind = "straight"')
        disc = next((part.name for part in self.parts if not part.inner_radius), None)
        if disc is not None:
            raise InputError(f"{self.name!r}: the disc {disc!r} has no straights; leave out [plan] straight")
        copy = next((probe.name for probe in self.probes), None)
        if copy is not None:
            raise InputError(f"{self.name!r}: probe {copy!r} is one of a circle; a racetrack reads parts alone")

    def _check_names(self) -> None:
        data = [layer.name for layer in self.layers if layer.datum]
        if len(data) != 1:
            raise InputError(f"{len(data)} layers have datum = true; z = 0 lies at the top of exactly one layer")
        owners = {f"layer {layer.name!r}": layer.material for layer in self.layers}
        owners |= {f"part {part.name!r}": part.material for part in self.parts}
        for what, material in owners.items():
            find(material, self.materials, what=f"{what}: material")
        names = [layer.name for layer in self.layers]
        names += [part.name for part in self.parts]
        names += [probe.name for probe in self.probes]
        checks.unique("the list of layers, parts and probes", names, hint="each needs a name of its own")
        solid = [part.name for part in self.parts if part.material != VOID]
        for interface in self.interfaces:
            checks.choice("interface: part", interface.part, solid)
        for probe in self.probes:
            checks.choice(f"probe {probe.name!r}: part", probe.part, solid)
        if self.light is not None:
            checks.choice("[light]: part", self.light.part, solid)

    def _repr_html_(self) -> str:
        """HTML for notebooks."""
        from ..data.display import section_card

        return section_card(self)

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
        return section_parts.layer_edges(self.layers)

    @cached_property
    def mirrored(self) -> bool:
        """Whether a straight section is its own mirror image in x = 0, so that one half is solved.

        Parts are their own images, or voids that follow each other and are images of each other.
        """
        if self.kind != "straight":
            return False
        beside = [p for p in self.parts if abs(2 * p.centre) > section_parts.SAME_POINT]
        if len(beside) % 2:
            return False
        for part, image in zip(beside[::2], beside[1::2], strict=True):
            follows = self.parts.index(image) == self.parts.index(part) + 1
            if not follows or not images(part, image):
                return False
        return True

    @property
    def depth(self) -> float | None:
        """Total length in m that a straight section stands for: twice ``length`` where only half of it is meshed.

        None for a ring.
        """
        if self.length is None:
            return None
        return 2 * self.length if self.mirrored else self.length

    @property
    def inner_end(self) -> float:
        """r or x in m where the domain begins: 0 on the axis or the mirror plane."""
        return 0.0 if self.kind == "ring" or self.mirrored else -self.outer_radius

    @property
    def heated(self) -> tuple[str, ...]:
        """Names of the parts that may carry absorbed power."""
        return tuple(part.name for part in self.parts if part.heated)

    def part(self, name: str) -> Part:
        """The part of this name."""
        return next(part for part in self.parts if part.name == name)

    def probe(self, name: str) -> Probe:
        """The probe of this name."""
        return next(probe for probe in self.probes if probe.name == name)

    @property
    def first_heated(self) -> Part:
        """The first part that may carry absorbed power."""
        return next(part for part in self.parts if part.heated)

    @property
    def material_names(self) -> dict[str, str]:
        """Name of the material of every layer and part, voids included."""
        names = {layer.name: layer.material for layer in self.layers}
        return names | {part.name: part.material for part in self.parts}

    def material_of(self, region: str) -> Material:
        """Material of a layer or part."""
        names = self.material_names
        checks.choice("region", region, names)
        return find(names[region], self.materials)

    @cached_property
    def subdivision(self) -> Subdivision:
        """The (r, z) plane cut into faces with one owner each."""
        return subdivide(self)

    @property
    def region_names(self) -> tuple[str, ...]:
        """Names of the layers and parts that are meshed: layers from bottom to top, then parts."""
        return tuple(self.volumes())

    def volumes(self) -> dict[str, float]:
        """Exact volume of every region in m^3: integral over its faces of 2 pi r + 2 ``straight``, or of the length."""
        volumes = self.subdivision.volumes(self.depth)
        along = self.subdivision.volumes(2 * self.straight)
        return {name: volume + along[name] for name, volume in volumes.items()} if self.straight else volumes

    def path_length(self, radius: float) -> float:
        """Length in m of a closed line whose bends have a radius in m: 2 pi R, and the straights of a racetrack."""
        return 2 * math.pi * radius + 2 * self.straight

    def on_boundary(self, side: str, r: ArrayLike, z: ArrayLike) -> Mask:
        """Which of the points (r, z) in m lie on ``side``: "bottom", "top", "outer", "axis" or "wall" (of a void)."""
        r = checks.numbers("r", r)
        z = checks.numbers("z", z)
        return self.subdivision.on_side(side, r, z)

    def beyond_laws(self, rise: float = 0.0) -> str:
        """Warning of tables k(T), c_p(T) that do not hold from the ambient to ``rise`` in K above it; "" of none."""
        reached = self.ambient + rise
        ends = sorted((self.ambient, reached))
        ranges: dict[str, tuple[float, float]] = {}
        for material in map(self.material_of, self.region_names):
            for law in (material.conductivity_law, material.specific_heat_law):
                table = beyond_table(law, *ends)
                if table is not None:
                    ranges[material.name] = table
        if not ranges:
            return ""
        laws = ", ".join(f"{name} ({first:g} to {last:g} K)" for name, (first, last) in ranges.items())
        return (
            f"{self.name}: at {reached:.4g} K the tables of {laws} are left and held at their last values: "
            "the temperatures are not those of the materials; give k(T) and c_p(T) that reach there"
        )

    def resistor(self, part: str) -> Resistor:
        """Resistance (ohm) and temperature coefficient (1/K) of a heated part; InputError where it has none."""
        resistor = known_resistor(self, part)
        if resistor is None:
            material = self.material_of(part).name
            raise checks.InputError(
                f"part {part!r} has no resistance, and {material} no resistivity",
                f'give resistance = "120 ohm" to the part, or resistivity = "4.3e-7 ohm*m" in [material.{material}]',
            )
        return resistor

    def opened(self) -> CrossSection:
        """Copy with the stack continued beyond its bottom and outer side (`section_parts.Boundary`, "open").

        >>> strip_ring().opened().bottom.kind
        'open'
        """
        return replace(self, bottom=section_parts.OPEN, outer=section_parts.OPEN)

    def with_(self, values: Mapping[str, Any] | None = None, /, **more: Any) -> CrossSection:
        """A copy with other values, given by the paths of a campaign: numbers in SI, or text with units.

        Parameters
        ----------
        values : mapping from path to value
            "part.core.radius", "layer.box.thickness", "material.SiO2.conductivity", "interface.core.resistance",
            "boundary.top.convection", "part.core.material", "outer_radius", ...
        more : value
            the same for paths without a dot: ``with_(outer_radius=50e-6)``.

        Raises
        ------
        InputError
            a path that leads nowhere, or a geometry that cannot be.

        >>> wider = strip_ring().with_({"part.core.width": 500e-9, "layer.box.thickness": "3 um"})
        >>> wider.layers[1].thickness, wider.volumes()["core"] > strip_ring().volumes()["core"]
        (3e-06, True)
        """
        values = {} if values is None else values
        table = geometry_file.table_of(self)
        parameter_paths.change_values(table, {**values, **more})
        return self.from_toml_text(files.to_toml(table))

    @classmethod
    def from_toml(cls, path: str | Path) -> CrossSection:
        """Read a geometry file.

        Raises
        ------
        InputError
            the file is missing or no TOML, or what it says cannot be; the message begins with the file.
        """
        return files.read_toml(path, "geometry", cls.from_toml_text)

    @classmethod
    def from_toml_text(cls, text: str) -> CrossSection:
        """Read the text of a geometry file."""
        return cls(**geometry_file.fields(text))

    def to_toml(self) -> str:
        """The geometry as the text of a geometry file; reading it back gives an equal CrossSection."""
        return self._text

    @cached_property
    def _text(self) -> str:
        return files.to_toml(geometry_file.table_of(self))


def reach(part: Part) -> float:
    """Largest radius of a part in m."""
    return float(part.outline()[:, 0].max())


def footprint(geometry: CrossSection) -> float:
    """Radius in m beyond which the stack is laterally uniform.

    A part that covers the domain from the axis to its edge is as uniform as a layer.
    """
    if geometry.kind == "straight":
        return 0.0
    edge = geometry.outer_radius * (1 - 1e-9)
    radius = 0.0
    for part in geometry.parts:
        if part.height:
            end = reach(part)
            radius = max(radius, part.inner_radius if end >= edge else end)
    return radius


def check_uniform(geometry: CrossSection, who: str) -> None:
    """Raise InputError where a void cuts the stack: a copy of the ring would add a void that the field lacks."""
    if geometry.kind == "straight":
        raise InputError(f"{who}: {geometry.name!r} is straight; put parallel guides in one section as parts")
    for part in geometry.parts:
        if part.material == VOID and part.height:
            raise InputError(
                f"{who}: the void {part.name!r} makes the stack laterally not uniform, and a neighbour would have its "
                "own void; only a uniform stack can be read off the axis; give the matrices of a three-dimensional "
                "model instead"
            )


def check_copies(geometry: CrossSection) -> None:
    """Raise InputError for a probe off the axis that cannot be read.

    Raises InputError: the copy overlaps the ring itself or leaves the domain, or the stack is not laterally uniform.
    """
    for probe in geometry.probes:
        if probe.distance is None:
            continue
        who = f"probe {probe.name!r}"
        part = geometry.part(probe.part)
        if geometry.kind == "ring":
            check_uniform(geometry, who)
        check_distance(geometry, part, probe.distance, who)


def check_distance(geometry: CrossSection, part: Part, distance: float, who: str) -> None:
    """Raise InputError unless a copy at a distance in m lies beside the ring and inside the domain."""
    end = reach(part)
    least = footprint(geometry) + end
    most = geometry.outer_radius - end
    hint = f"nearer the copy of {part.name!r} overlaps the ring itself, further away it leaves the domain"
    checks.between(f"{who}: distance", distance, least, most, unit="m", hint=hint)
