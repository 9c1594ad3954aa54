"""Initial guesses of a cycle: another cycle, the end of a run, or a state."""

from __future__ import annotations

from typing import Any

import numpy as np

from thermofem import checks
from thermofem.arrays import Array
from thermofem.checks import InputError
from thermofem.data.variables import contents

from ..states import State, starting_point
from .closing import Settled
from .hopf_start import is_hopf_point, near_hopf
from .orbit import FIRST, CycleProblem, Orbit, closer, settle, shoot
from .scheme import scheme
from .start import settled

MOST_PULSES = 1000  # in a period
STEPS_NEARBY = 4  # of Newton's method on the mesh of a guess; more show that the pulses are elsewhere


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
        return settled(p, starting_point(guess, p.units.size - 3).as_array() / p.units, "the run given as guess")
    if "mesh" in attrs and "states" in getattr(guess, "variables", {}):
        trial = trial_of(p, guess)
        pulses = checks.integer("guess.attrs['pulses']", attrs.get("pulses", 1), 1, MOST_PULSES)
        found = near(p, trial, pulses)
        if found is None:
            raise InputError(
                f"no cycle at power = {p.power:g} W, detuning = {p.detuning:g} Hz near the one given as guess, of "
                f"{attrs['period']:g} s: Newton's method leads to none; take a smaller step, or no guess"
            )
        return found
    raise InputError(
        f"guess is a {type(guess).__name__}; it must be a cycle of coupled.limit_cycle, a run of coupled.simulate, a "
        "coupled.State or a point of coupled.hopf_curves"
    )


def near(p: CycleProblem, trial: Orbit, pulses: int) -> Settled | None:
    """The cycle near a trial orbit: by a few steps of Newton's method on its mesh, else along traces from its start."""
    close = closer(p, trial, FIRST[1], STEPS_NEARBY)
    found = settle(p, close) if close.move < np.inf else None
    found = found or shoot(p, trial.start, trial.T, pulses) or settle(p, trial)
    if found is None or np.ptp(found.Y[:, :, 2]) <= 1e-5 * found.Y[:, :, 2].max():
        return None
    return Settled(found, pulses)


def check_whole(name: str, cycle: Any) -> Array:
    """The states of a cycle of `limit_cycle`, shape (rows, states); InputError where rows were left out."""
    states = checks.numbers(f"{name}['states']", cycle["states"].values)
    tau = checks.array(f"{name}.attrs['mesh']", cycle.attrs["mesh"], increasing=True)
    rows = (tau.size - 1) * scheme().c.size + 1
    if states.shape[0] != rows or states.shape[1] < 4:
        raise InputError(f"{name}['states'] has the shape {states.shape}; a whole cycle has {rows} rows of 4 or more")
    return states


def trial_of(p: CycleProblem, cycle: Any) -> Orbit:
    """Another cycle as a trial orbit; heat of another model is at its own periodic state under the power absorbed."""
    cycle = contents("guess", cycle, {"states": "time state"}, what="a cycle of coupled.limit_cycle", attrs=("period",))
    states, tau = check_whole("guess", cycle), np.asarray(cycle.attrs["mesh"], dtype=float)
    own, m = states.shape[1], p.units.size
    values = np.zeros((states.shape[0], m))
    values[:, : min(own, m)] = states[:, : min(own, m)] / p.units[: min(own, m)]
    s, T = scheme().c.size, checks.positive("guess.attrs['period']", cycle.attrs["period"], unit="s") * 1e9
    start, Y = values[0].copy(), np.ascontiguousarray(values[1:].reshape(tau.size - 1, s, m))
    if own != m:
        from ..kernels import orbit_heat

        orbit_heat.relax(start, Y, tau, T, p.at, scheme())
    return Orbit(start, Y, tau, T, np.empty((0, 0)), np.inf)
