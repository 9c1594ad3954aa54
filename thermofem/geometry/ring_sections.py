"""Common sections: strip, rib, disc, a strip under a metal heater, and a straight guide.

All lengths in m; ``radius``, ``width``, ``height``, ``box`` and ``cladding`` are those of `strip_ring` where they are
not described; an InputError names a length that is impossible.
"""

import math
from dataclasses import replace

from .. import checks
from .cross_section import CrossSection
from .section_parts import Layer, Part, length, ring, slip


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
    outer_radius = length("outer_radius", outer_radius, typical=60e-6)  # floats: what is float32 would be added as such
    box = length("box", box, typical=2e-06)
    cladding = length("cladding", cladding, typical=2e-06)
    substrate = length("substrate", substrate, typical=3e-05)
    height = length("height", height, typical=220e-9)
    checks.between("radius", radius, 0, outer_radius, unit="m", hint=slip(radius, 8e-6, outer_radius))
    inner, outer = ring(radius, width)
    layers = (
        Layer("substrate", "Si", substrate),
        Layer("box", "SiO2", box, datum=True),
        Layer("cladding", "SiO2", cladding + height),
    )
    core = Part("core", "Si", inner, outer, bottom=0.0, height=height, heated=True)
    return CrossSection("strip ring", outer_radius, layers, (core,))


def rib_ring(
    radius: float = 7.955e-6,
    width: float = 500e-9,
    height: float = 220e-9,
    slab: float = 90e-9,
    slab_width: float = 4e-6,
    box: float = 2e-6,
    cladding: float = 2e-6,
) -> CrossSection:
    """A silicon rib: a core of full height on a thin slab of silicon, which spreads its heat.

    Parameters
    ----------
    radius : float, m
        to the centre of the core.
    width, height : float, m
        of the core, its height from the bottom of the slab.
    box, cladding : float, m
        thickness of the buried oxide, and of the oxide above the top of the core.
    slab, slab_width : float, m
        thickness and width of the slab left by the etch, centred on the core. The core stands on it.

    Raises
    ------
    InputError
        a length that is not positive or in another unit, a slab that is not thinner and wider than the core.

    >>> rib_ring().region_names
    ('substrate', 'box', 'cladding', 'slab', 'core')
    """
    base = strip_ring(radius, width, height, box, cladding)
    slab, height = length("slab", slab, typical=90e-9), base.parts[0].height
    slab_width = length("slab_width", slab_width, typical=2e-6)
    checks.between("slab", slab, 0, height, unit="m", hint="it is thinner than height")
    checks.between("slab_width", slab_width, width, math.inf, unit="m", hint="it is wider than width")
    inner, outer = ring(radius, slab_width, of="slab: ")
    under = Part("slab", "Si", inner, outer, bottom=0.0, height=slab)
    core = replace(base.parts[0], bottom=slab, height=height - slab)
    return replace(base, name="rib ring", parts=(under, core))


def disc(
    radius: float = 5e-6,
    height: float = 220e-9,
    rim: float = 1e-6,
    box: float = 2e-6,
    cladding: float = 2e-6,
) -> CrossSection:
    """A silicon microdisc whose whispering-gallery mode heats its rim: part "core" at the rim, part "disc" inside it.

    Parameters
    ----------
    radius, height : float, m
        of the disc, to its edge.
    rim : float, m
        width of the ring at the edge that the mode fills.
    box, cladding : float, m
        thickness of the buried oxide, and of the oxide above the top of the disc.

    Raises
    ------
    InputError
        a length that is not positive or in another unit, or a rim that is not narrower than the disc.

    >>> disc().heated
    ('core',)
    """
    rim = length("rim", rim, typical=1e-6)
    radius = length("radius", radius, typical=5e-6)
    checks.between("rim", rim, 0, radius, unit="m", hint="it is narrower than radius")
    base = strip_ring(radius - rim / 2, rim, height, box, cladding)
    inside = Part("disc", "Si", 0.0, radius - rim, bottom=0.0, height=height)
    return replace(base, name="disc", parts=(inside, *base.parts))


def heated_ring(
    radius: float = 7.955e-6,
    width: float = 450e-9,
    height: float = 220e-9,
    box: float = 2e-6,
    cladding: float = 2e-6,
    heater_width: float = 2e-6,
    heater_height: float = 100e-9,
) -> CrossSection:
    """A strip ring with a titanium-nitride heater above it, on the top of the stack; both can be heated and read.

    Parameters
    ----------
    radius : float, m
        to the centre of the core and of the heater.
    width, height : float, m
        of the core.
    box, cladding : float, m
        thickness of the buried oxide, and of the oxide between the top of the core and the heater.
    heater_width, heater_height : float, m
        of the heater.

    Raises
    ------
    InputError
        a length that is not positive or in another unit, or a width beyond the axis.

    >>> heated_ring().heated
    ('core', 'heater')
    """
    base = strip_ring(radius, width, height, box, cladding)
    heater_height = length("heater_height", heater_height, typical=100e-9)
    inner, outer = ring(radius, heater_width, of="heater: ")
    heater = Part("heater", "TiN", inner, outer, bottom=base.top_z, height=heater_height, heated=True)
    return replace(base, name="heated ring", parts=(*base.parts, heater))


def straight_guide(
    length: float = 300e-6,
    width: float = 450e-9,
    height: float = 220e-9,
    box: float = 2e-6,
    cladding: float = 2e-6,
    substrate: float = 30e-6,
    half_width: float = 60e-6,
) -> CrossSection:
    """A straight silicon strip on buried oxide under oxide, on silicon; the substrate's bottom is held at ambient.

    Heat does not flow along it: its ends are neglected, which leaves an error of about the diffusion length over
    ``length`` (`HeatProblem.errors` estimates it).

    Parameters
    ----------
    length : float, m
        of the heated guide; it may be a fraction of the length along which light is guided.
    width, height : float, m
        of the core.
    box, cladding, substrate : float, m
        thickness of the buried oxide, of the oxide above the top of the core, and of the substrate.
    half_width : float, m
        from the core to either end of the domain.

    >>> guide = straight_guide(length=320e-6)
    >>> guide.mirrored, guide.depth  # one half is solved
    (True, 0.00064)
    """
    ring = strip_ring(width, width, height, box, cladding, substrate)
    core = Part("core", "Si", bottom=0.0, height=ring.parts[0].height, heated=True, x=0.0, width=width)
    return CrossSection(
        "straight guide", layers=ring.layers, parts=(core,), kind="straight", length=length, half_width=half_width
    )
