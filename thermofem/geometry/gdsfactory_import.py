"""Cross-sections and drawings from gdsfactory: a component and the layer stack of its PDK.

gdsfactory gives lengths in um, and sidewall angles in degrees from the vertical. As the cross-section of one ring, a
racetrack of length L becomes a circle of radius L/(2 pi). A component with several rings and heaters is a `Drawing`.
"""

import logging
import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import shapely

from .. import checks
from .cross_section import CrossSection
from .section_parts import Layer, Part, ring

log = logging.getLogger("thermofem")

UM = 1e-6
THIN = 1e-4  # um; levels closer than this touch
CORE = "core"
BACKGROUND = ("substrate", "box", "clad")
RING = "such as ring_double has; th.read_layout(component) takes several rings and heaters"
SECTION_LENGTH = 100e-6  # m, of the section of a layout; it cancels
SECTION_WIDTH = 1e-6  # m, of a part that a layout draws, each shape with its own width
MATERIALS = {"si": "Si", "sio2": "SiO2", "sin": "Si3N4", "tin": "TiN", "aluminum": "Al", "al": "Al", "air": "air"}


def from_gdsfactory(
    component: Any,
    layer_stack: Any = None,
    *,
    core: str = CORE,
    background: tuple[str, ...] = BACKGROUND,
    materials: Mapping[str, str] | None = None,
    outer_radius: float = 60e-6,
) -> CrossSection:
    """Return the cross-section of a gdsfactory ring component.

    The levels in ``background`` become layers. The guiding section of the component's cross-section becomes the heated
    part "core", and its other sections (slabs, heaters) become parts named after their levels.

    Parameters
    ----------
    component : gdsfactory.Component
        a ring with the setting ``cross_section``, such as ``ring_single``, ``ring_double`` or ``ring_double_heater``.
    layer_stack : gdsfactory.technology.LayerStack
        default: that of the active PDK.
    core : str
        level of the guiding silicon.
    background : tuple of str
        levels that cover the whole chip, bottom to top; they must touch.
    materials : mapping of str to str
        names of materials in the stack to those of thermofem, beside `MATERIALS`.
    outer_radius : float, m
        where the domain ends.

    Raises
    ------
    MissingLibraryError
        gdsfactory cannot be imported.
    InputError
        a component without exactly one closed waveguide, or with one of another length than its settings make (a disk,
        several rings), a cross-section that the PDK does not know by name, a level that is missing, levels that do not
        touch, an unknown material, a section beside the middle of the waveguide, or two different ones on one level.
    """
    gf = _library()
    chosen = layer_stack if layer_stack is not None else gf.get_active_pdk().layer_stack
    settings = dict(component.settings)
    checks.choice("setting of the component", "cross_section", settings, hint=RING)
    added = {name.lower(): material for name, material in (materials or {}).items()}
    stack = _Stack(chosen.layers, MATERIALS | added, core)
    layers = stack.background(background)
    sections = []
    for key in ("cross_section", "cross_section_heater"):
        if settings.get(key):
            sections += _cross_section(gf, key, settings).sections
    section_on = {str(section.layer): section for section in reversed(sections)}
    drawn = checks.choice(f"layer of level {core!r}", str(stack.drawn(core)), section_on)
    length = _loop(component, section_on[drawn])
    radius = _equivalent_radius(gf, settings)
    circumference = 2 * math.pi * radius
    # 0.01 of the length of a loop, which polygons on a grid of 1 nm change by 1e-3
    if abs(length * UM - circumference) > 0.01 * length * UM:
        raise checks.InputError(
            f"component holds a loop of {length:.4g} um, but its settings make a ring of "
            f"{circumference / UM:.4g} um; build this CrossSection from th.Part"
        )
    level_on = {str(stack.drawn(name)): name for name in (*reversed(list(stack.levels)), core)}
    hint = "sections beside the middle are not imported: build this CrossSection from th.Part"
    parts: dict[str, Part] = {}
    for section in sections:
        name = level_on[checks.choice("layer of a section of the component", str(section.layer), level_on)]
        offset = getattr(section, "offset", 0.0) or 0.0  # the side on which such a section lies depends on the bend
        checks.between(f"level {name!r}: offset of its section", offset, -THIN, THIN, unit="um", hint=hint)
        # gdsfactory gives the width at the height ``width_to_z``
        width = section.width * UM + 2 * stack.lean(name)
        inner, outer = ring(radius, width, of=f"{name}: ")
        part = stack.part(name, inner_radius=inner, outer_radius=outer)
        if parts.setdefault(part.name, part) != part:
            raise checks.InputError(
                f"level {name!r} has two sections of different width; a part is made of one, so build this "
                "CrossSection from th.Part, one for each"
            )
    ordered = sorted(parts.values(), key=lambda part: part.name == CORE)  # the core overwrites the slab under it
    label = str(getattr(component, "function_name", None) or component.name)
    return CrossSection(label, outer_radius, layers, tuple(ordered)).opened()


class _Stack(NamedTuple):
    """A layer stack of gdsfactory.

    materials: names in the stack, in lower case, to those of thermofem.
    core: level of the guiding silicon.
    """

    levels: Mapping[str, Any]
    materials: Mapping[str, str] = MATERIALS
    core: str = CORE

    def level(self, name: str) -> Any:
        """The level of this name."""
        return self.levels[checks.choice("level of the layer stack", name, self.levels)]

    def drawn(self, name: str) -> Any:
        """The drawn layer of a level; of a derived layer (drawn minus etched) that of the drawn one."""
        layer = self.level(name).layer
        while hasattr(layer, "layer1"):
            layer = layer.layer1
        return layer

    def material(self, name: str) -> str:
        """Material of a level."""
        material = str(self.level(name).material)
        hint = f"give it as materials={{{material!r}: 'SiO2'}} or the name of another material"
        return self.materials[checks.choice(f"level {name!r}: material", material.lower(), self.materials, hint=hint)]

    def background(self, names: tuple[str, ...]) -> tuple[Layer, ...]:
        """Layers of the stack, bottom to top; the datum is the layer whose top lies at z = 0."""
        layers: list[Layer] = []
        edge = self.level(names[0]).zmin
        for name in names:
            level = self.level(name)
            if abs(level.zmin - edge) > THIN:
                raise checks.InputError(
                    f"level {name!r} begins at {level.zmin:g} um, but the one below ends at {edge:g} um; levels of "
                    "background must touch, bottom to top"
                )
            edge = level.zmin + level.thickness
            layers.append(Layer(name, self.material(name), level.thickness * UM, datum=abs(edge) < THIN))
        return tuple(layers)

    def part(self, name: str, **place: float) -> Part:
        """The part of a level, at a place that its fields give."""
        level = self.level(name)
        return Part(
            name=CORE if name == self.core else name,
            material=self.material(name),
            bottom=level.zmin * UM,
            height=level.thickness * UM,
            sidewall_angle=math.radians(90 - (level.sidewall_angle or 0.0)),
            heated=name == self.core or "heater" in name.lower(),
            **place,
        )

    def lean(self, name: str) -> float:
        """What is added to each side of a drawn width, in m, to get that at half of the height."""
        level = self.level(name)
        slope = math.tan(math.radians(level.sidewall_angle or 0.0))
        return float(slope * (level.width_to_z - 0.5) * level.thickness * UM)


def _cross_section(gf: Any, key: str, settings: Mapping[str, Any]) -> Any:
    """The cross-section that a setting of the component names; gdsfactory keeps a name in place of an object."""
    try:
        return gf.get_cross_section(settings[key])
    except Exception:  # gdsfactory's error is a page of names
        raise checks.InputError(
            f"{key} of the component = {checks.shown(settings[key])} is no name that the active PDK knows, as where it "
            "was given as an object or a partial",
            'register it first, get_active_pdk().register_cross_sections(narrow=...), and give cross_section="narrow"',
        ) from None


def _loop(component: Any, guide: Any) -> float:
    """Length in um of the only closed waveguide: circumference of its hole plus pi times its width."""
    lengths = []
    for polygon in component.get_region(guide.layer, merge=True).each():
        for k in range(polygon.holes()):
            length = sum(edge.length() for edge in polygon.each_edge(k + 1))
            lengths.append(length)
    if len(lengths) != 1:
        raise checks.InputError(
            f"component has {len(lengths)} closed waveguides on layer {guide.layer}; one is needed",
            RING,
        )
    inner = lengths[0] * component.kcl.dbu
    return float(inner + math.pi * guide.width)


def _library() -> Any:
    try:
        import gdsfactory
    except ImportError:
        raise checks.MissingLibraryError(
            'gdsfactory is needed to import its components; install it with pip install "thermofem[gdsfactory]"'
        ) from None
    return gdsfactory


def _equivalent_radius(gf: Any, settings: Mapping[str, Any]) -> float:
    """Radius in m of the circle as long as the ring: L/(2 pi), with the length L of four bends and the straights."""
    radius = settings.get("radius")
    if radius is None:
        radius = _cross_section(gf, "cross_section", settings).radius
    checks.positive("radius of the component", radius, unit="um")
    if "bend" not in settings:
        return float(radius) * UM
    bend = gf.get_component(settings["bend"], radius=radius, cross_section=settings["cross_section"])
    straights = (settings.get("length_x") or 0.0) + (settings.get("length_y") or 0.0)
    length = 4 * float(bend.info["length"]) + 2 * straights
    return length / (2 * math.pi) * UM


class Drawing(NamedTuple):
    """What a file or component draws of a layout.

    source: for messages.
    section: a straight one.
    polygons: in um, of each part.
    labels, instances: texts with their places, and names of cells with their extents, in um.
    """

    source: str
    section: CrossSection
    polygons: dict[str, list[shapely.Polygon]]
    labels: list[tuple[str, shapely.Point]]
    instances: list[tuple[str, shapely.Polygon]]


def drawn_component(
    component: Any, layers: Mapping[str, Any] | None = None, section: CrossSection | None = None
) -> Drawing:
    """What a gdsfactory component draws on the layers of parts; by default on those of the active PDK's stack.

    Raises InputError: no component, a level that is missing, nothing drawn on a layer.
    """
    gf = _library()
    checks.instance("path", component, gf.Component, hint="a GDS file, a layout file, or a gdsfactory component")
    source = f"component {component.name}"
    widened: dict[str, float] = {}
    if layers is None or section is None:
        stack = _Stack(gf.get_active_pdk().layer_stack.layers)
        layer_of = {name: stack.drawn(name).layer for name in stack.levels}
        filled = {name for name, layer in layer_of.items() if _areas(component, layer)}
        names = [CORE, *(name for name in layer_of if "heater" in name.lower() and name in filled)]
        layers = {name: layer_of[name] for name in names}
        widened = {name: stack.lean(name) / UM for name in names}
        section = _straight_section(source, stack, names)
        taken = {*BACKGROUND, *(name for name, layer in layer_of.items() if layer in layers.values())}
        left_out = [name for name in layer_of if name in filled - taken]
        if left_out:
            log.warning(
                "%s also draws %s, which are left out: a layout has cores and heaters; give a section whose "
                "parts they are, with layers",
                source,
                ", ".join(left_out),
            )
    polygons = {}
    for part, layer in layers.items():
        areas = _areas(component, layer)
        if not areas:
            raise checks.InputError(f"{source} has no polygon on layer {layer}, that of {part!r}")
        polygons[part] = [area.buffer(widened.get(part, 0.0), join_style="mitre") for area in areas]
    labels = []
    for layer in component.layers:
        labels += [(label.string, shapely.Point(label.x, label.y)) for label in component.get_labels(layer)]
    instances = []
    for instance in component.insts:
        extent = instance.dbbox()
        name = instance.name if instance.is_named() else instance.cell.function_name or instance.cell.name
        instances.append((name, shapely.box(extent.left, extent.bottom, extent.right, extent.top)))
    return Drawing(source, section, polygons, labels, instances)


def _straight_section(name: str, stack: _Stack, drawn: Iterable[str]) -> CrossSection:
    """Layers of the background, with a part for each of the ``drawn`` levels; a shape brings its own width."""
    return CrossSection(
        name,
        layers=stack.background(BACKGROUND),
        parts=tuple(stack.part(level, x=0.0, width=SECTION_WIDTH) for level in drawn),
        kind="straight",
        length=SECTION_LENGTH,
        half_width=SECTION_LENGTH / 2,
    ).opened()


def _areas(component: Any, layer: Any) -> list[shapely.Polygon]:
    """Merged polygons of a layer, in um."""
    unit = component.kcl.dbu
    areas = []
    for polygon in component.get_region(layer, merge=True).each():
        hull = _um(polygon.each_point_hull(), unit)
        holes = [_um(polygon.each_point_hole(k), unit) for k in range(polygon.holes())]
        areas.append(shapely.Polygon(hull, holes))
    return areas


def _um(points: Any, unit: float) -> list[tuple[float, float]]:
    """Corners of a polygon in um."""
    return [(point.x * unit, point.y * unit) for point in points]
