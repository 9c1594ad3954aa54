"""``thermofem modes`` and ``ring``: geometry in, guided modes or a ring file out."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .. import options
from ..console import note, say, working

if TYPE_CHECKING:
    import thermofem as th


def modes(
    geometry: options.Geometry = None,
    wavelength: str | None = None,
    accuracy: float = 1e-3,
    figure: Path | None = None,
) -> dict[str, Any]:
    """Compute the guided modes of one geometry on the mesh of its heat problem.

    The figure shows the first one.
    """
    import thermofem as th

    from ..inputs.command_files import section_of
    from ..inputs.drive_texts import wavelength_of

    section = section_of(geometry)
    with working("solving"):
        plain = replace(section, light=None)
        bends = th.light(
            th.assemble(replace(plain, straight=0.0), accuracy),
            wavelength=wavelength_of(section, wavelength),
            part=section.light.part if section.light else None,
        )
        light = replace(bends, geometry=plain)
        found = light.modes
        first = light.mode(found[0].name if found else None)  # without any, the error says why
    numbers = [mode_numbers(mode) for mode in found]
    if not math.isinf(light.radius):
        where = "the edge" if light.at_edge else "the centre of the core"
        say(f"n_eff belongs to R = {light.radius * 1e6:.6g} um, {where}")
    for mode in found:
        say(mode_words(mode))
    if lost := set(light.names) - {mode.name for mode in found}:
        say(f"{', '.join(sorted(lost))}: held by the straight guide, but not in this bend")
    say(f"{first.name}: n_eff within {first.error:.0e} of finer elements")
    if figure:
        from thermofem import plot

        plot.save_figure(plot.plot_mode(first), figure)
    return {
        "modes": numbers,
        "radius": None if math.isinf(light.radius) else light.radius,
        "n_eff_error": first.error,
        "wrote": [figure] if figure else [],
    }


def mode_numbers(mode: th.optics.Mode) -> dict[str, Any]:
    """Return the numbers of a mode by name, in SI but for the leak in dB/cm."""
    ring = not math.isinf(mode.radius)
    quality = mode.q_radiation if ring else math.inf
    return {
        "name": mode.name,
        "n_eff": mode.n_eff,
        "n_g": mode.n_g,
        "te_fraction": mode.te_fraction,
        "thermo_optic": None if mode.lacking_in_core else mode.thermo_optic,
        "confinement": mode.confinement,
        "volume_2": mode.volume(2),
        "volume_3": mode.volume(3),
        "core_fraction_2": mode.core_fraction(2),
        "core_fraction_3": mode.core_fraction(3),
        "q_radiation": None if math.isinf(quality) else quality,
        "leak": mode.substrate_loss,
        "leaky": mode.leaky,
        "hybrid": mode.hybrid,
    }


def mode_words(mode: th.optics.Mode) -> str:
    """Return a line of text with the numbers of a mode."""
    kind = f"TE {mode.te_fraction:.0%}, hybrid" if mode.hybrid else f"TE {mode.te_fraction:.0%}"
    return (
        f"{mode.name}: n_eff {mode.n_eff:.5f}, n_g {mode.n_g:.5f}, {kind}, dn_eff/dn "
        f"{mode.confinement[mode.core]:.4f} in {mode.core}, {_shift(mode)}, V_2 {mode.volume(2) * 1e18:.4g} um^3, "
        f"V_3 {mode.volume(3) * 1e18:.4g} um^3{_radiation(mode)}{_leak(mode)}"
    )


def _shift(mode: th.optics.Mode) -> str:
    """Return the shift per kelvin in pm/K, or what is missing for it."""
    if mode.lacking_in_core:
        return f"pm/K unknown (thermo_optic of {' and '.join(mode.lacking_in_core)} is missing)"
    shift = mode.thermo_optic * mode.wavelength / 1e-12
    return f"{shift:.3g} pm/K"


def _radiation(mode: th.optics.Mode) -> str:
    """Return the quality factor of the bend in words; "" of a straight guide."""
    if math.isinf(mode.radius):
        return ""
    quality = mode.q_radiation
    return ", Q_rad > 1e11" if math.isinf(quality) else f", Q_rad {quality:.3g}"


def _leak(mode: th.optics.Mode) -> str:
    """Return the leak of a mode in dB/cm and what it leaks into; "" where it does not leak."""
    if not mode.substrate_loss:
        return ""
    return f", leaks {mode.substrate_loss:.3g} dB/cm into {' and '.join(mode.drains)}"


def ring(
    geometry: options.Geometry = None,
    wavelength: str | None = None,
    loss: options.Quantity = None,
    gap: options.Quantity = None,
    coupling: float | None = None,
    straight: options.Quantity = "0 um",
    buses: Annotated[
        int | None, typer.Option(min=1, max=2, help="Number of buses; default: 2, or that of [[bus]] tables.")
    ] = None,
    mode: str | None = None,
    output: options.Output = Path("ring.toml"),
) -> dict[str, Any]:
    """Compute the ring of one geometry, and write its file with the origin beside every number.

    ``thermofem simulate --ring`` takes it.

    Options
    -------
    loss: [1/m] Power loss of the guide, which heats; default: that of [light], or 2 dB/cm.
    gap: [m] Gap to each bus, e.g. '250 nm'; default: the [[bus]] tables of the geometry.
    coupling: Power that a bus takes in one pass, instead of --gap.
    straight: [m] Length of each of two straight sections.
    mode: Guided mode, such as TM0; default: that of [light], or TE0.
    """
    from scipy.constants import c

    import coupled
    import thermofem as th
    from surrogate.reduction.racetrack_reduction import racetrack_sheets
    from thermofem.data import files, quantity

    from ..inputs.command_files import section_of
    from ..inputs.drive_texts import wavelength_of
    from ..results.heat_lines import say_each, say_sheets

    section = section_of(geometry)
    if loss is None and (section.light is None or section.light.loss is None):
        loss = 20 * math.log(10)  # 2 dB/cm
    with working("solving"):
        computed = coupled.ring_from(
            section,
            wavelength=wavelength_of(section, wavelength),
            loss=loss,
            gap=gap,
            coupling=coupling,
            straight=straight,
            buses=buses,
            mode=mode,
        )
    files.write_whole(output, lambda path: path.write_text(computed.to_toml(), encoding="utf-8"))
    resonator = computed.ring
    names = [guided.name for guided in computed.mode.light.modes]
    if len(names) > 1:
        note(f"the guide holds {', '.join(names)}; {computed.mode.name} is taken, --mode picks another")
    say(
        f"{resonator.name}: {quantity.rounded(c / resonator.frequency, 'm', 6)}, Q {resonator.loaded_q:.4g}, "
        f"intrinsic Q {resonator.intrinsic_q:.4g}, n_g {resonator.group_index:.5g}, "
        f"V_2 {resonator.tpa_volume * 1e18:.4g} um^3, {resonator.shift_per_kelvin / 1e-12:.4g} pm/K"
    )
    say(f"bus: {computed.origins['bus_rate']}")
    sheets: dict[str, Any] = {}
    if section.straight:
        with working("solving the heat"):
            of_heaters = racetrack_sheets(section, computed.mode)
        sheets = say_each(section, of_heaters)
    elif len(section.heated) > 1:
        with working("solving the heat"):
            heat = th.assemble(replace(section, light=None)).with_light(computed.mode)
        sheets = say_sheets(heat)
    origins = {name: {"value": o.value, "origin": o.origin, "error": o.error} for name, o in computed.origins.items()}
    return {
        "loaded_q": resonator.loaded_q,
        "intrinsic_q": resonator.intrinsic_q,
        "origins": origins,
        **sheets,
        "wrote": [output],
    }
