"""Initial guesses of a cycle: another cycle, the end of a run, or a state."""

from __future__ import annotations

from typing import Any

from thermofem import checks
from thermofem.checks import InputError

from ..states import State, starting_point
from .closing import Settled
from .hopf_start import is_hopf_point, near_hopf
from .orbit import CycleProblem, settle, shoot
from .start import settled

MOST_PULSES = 1000  # in a period


def from_guess(p: CycleProblem, guess: Any) -> Settled:
    """Return the cycle near a guess; InputError where there is none."""
    if isinstance(guess, State):
        return settled(p, starting_point(guess, p.units.size - 3).as_array() / p.units, "the guess")
    if is_hopf_point(guess):
        orbit = settle(p, near_hopf(p, guess))
        if orbit is None:
            raise InputError("the cycle beside the Hopf point given as guess is not resolved by Newton's method")
        return Settled(orbit, 1)
    attrs = getattr(guess, "attrs", {})
    if "final_state" in attrs:
        y = starting_point(guess, p.units.size - 3).as_array() / p.units
        if "pulses" not in attrs:
            return settled(p, y, "the run given as guess")
        pulses = checks.integer("guess.attrs['pulses']", attrs["pulses"], 1, MOST_PULSES)
        found = shoot(p, y, checks.positive("guess.attrs['period']", attrs.get("period"), unit="s") * 1e9, pulses)
        if found is None:
            raise InputError(
                f"no cycle at power = {p.power:g} W, detuning = {p.detuning:g} Hz near the one given as guess, of "
                f"{attrs['period']:g} s: Newton's method leads to none; take a smaller step, or no guess"
            )
        return Settled(found, pulses)
    raise InputError(
        f"guess is a {type(guess).__name__}; it must be a cycle of coupled.limit_cycle, a run of coupled.simulate, a "
        "coupled.State or a point of coupled.hopf_curves"
    )
