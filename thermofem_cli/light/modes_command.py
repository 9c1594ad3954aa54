"""``thermofem modes``: geometry in, guided modes out."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Any

import typer

import thermofem as th
from thermofem.data import quantity

from .. import options
from ..command_files import check_outputs, section_of
from ..console import say, working, wrote


def modes(
    geometry: options.Geometry = None,
    wavelength: options.Wavelength = None,
    part: Annotated[str | None, typer.Option(help="Part that guides; default: that of [light], or core.")] = None,
    accuracy: options.Accuracy = 1e-3,
    figure: options.Figure = None,
) -> dict[str, Any]:
    """Compute the guided modes of one geometry on the mesh of its heat problem.

    The figure shows the first one.
    """
    section = section_of(geometry)
    check_outputs([figure], images=[figure], inputs=[geometry])
    with working("solving"):
        light = th.light(
            th.assemble(replace(section, light=None), accuracy),
            wavelength=wavelength_of(section, wavelength),
            part=part or (section.light.part if section.light else None),
        )
        found = light.modes
        first = light.mode(found[0].name)
    numbers = [_numbers(mode) for mode in found]
    if not math.isinf(light.radius):
        where = "the edge" if light.at_edge else "the centre of the core"
        say(f"n_eff belongs to R = {light.radius * 1e6:.6g} um, {where}")
    for mode in found:
        say(_words(mode))
    say(f"{first.name}: n_eff within {first.error:.0e} of finer elements")
    if figure:
        from thermofem import plot

        plot.save_figure(plot.plot_mode(first), figure)
        wrote(figure)
    return {
        "modes": numbers,
        "radius": None if math.isinf(light.radius) else light.radius,
        "n_eff_error": first.error,
        "wrote": [figure] if figure else [],
    }


def wavelength_of(section: th.CrossSection, given: str | None) -> float:
    """Wavelength in m of --wavelength, or of [light]."""
    if given is None and section.light is not None:
        return section.light.wavelength
    return quantity.positive(given or "1550 nm", "m", name="--wavelength")


def _numbers(mode: th.optics.Mode) -> dict[str, Any]:
    """Numbers of a mode in SI."""
    ring = not math.isinf(mode.radius)
    quality = mode.q_radiation if ring else math.inf
    return {
        "name": mode.name,
        "n_eff": mode.n_eff,
        "n_g": mode.n_g,
        "te_fraction": mode.te_fraction,
        "thermo_optic": mode.thermo_optic,
        "confinement": mode.confinement,
        "volume_2": mode.volume(2),
        "volume_3": mode.volume(3),
        "core_fraction_2": mode.core_fraction(2),
        "core_fraction_3": mode.core_fraction(3),
        "q_radiation": None if math.isinf(quality) else quality,
    }


def _words(mode: th.optics.Mode) -> str:
    """One line about a mode."""
    quality = mode.q_radiation
    told = "" if math.isinf(mode.radius) else f", Q_rad {'> 1e11' if math.isinf(quality) else f'{quality:.3g}'}"
    shift = mode.thermo_optic * mode.wavelength / 1e-12
    return (
        f"{mode.name}: n_eff {mode.n_eff:.5f}, n_g {mode.n_g:.5f}, TE {mode.te_fraction:.0%}, dn_eff/dn "
        f"{mode.confinement[mode.core]:.4f} in {mode.core}, {shift:.3g} pm/K, V_2 {mode.volume(2) * 1e18:.4g} um^3, "
        f"V_3 {mode.volume(3) * 1e18:.4g} um^3{told}"
    )
