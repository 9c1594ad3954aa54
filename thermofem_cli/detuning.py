"""The laser's detuning as a person writes it: a frequency, or a wavelength as laboratories read it off."""

from __future__ import annotations

from typing import TYPE_CHECKING

from scipy.constants import c

from thermofem.checks import InputError
from thermofem.data import quantity

if TYPE_CHECKING:
    from coupled import RingResonator

HELP = "Laser minus cold resonance, as a frequency ('-10 GHz') or a wavelength ('80 pm', to the red)."


def detuning_of(text: str, ring: RingResonator, name: str = "--detuning") -> float:
    """Laser minus cold resonance in Hz.

        nu = c/(c/f + d) - f

    with the ring's resonance f and the distance d in wavelength: a longer wavelength is a negative detuning.

    text: "-10 GHz", or "80 pm".
    name: what the error message begins with.
    Raises InputError: neither a frequency nor a length, or a wavelength that is not positive.
    """
    try:
        distance = quantity.parse(text, "m", name=name)
    except InputError:
        return quantity.parse(text, "Hz", name=name)
    wavelength = c / ring.frequency
    if not abs(distance) < 0.1 * wavelength:
        raise InputError(
            f"{name} = {text!r} must be a distance from the resonance at {wavelength * 1e9:.6g} nm, not a wavelength",
            'e.g. "80 pm"',
        )
    return float(c / (wavelength + distance) - ring.frequency)
