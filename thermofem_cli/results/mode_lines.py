"""Guided modes as ``modes`` prints them."""

import math
from typing import Any

import thermofem as th


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
