"""The small cycles beside a Hopf point: their plane and their amplitude.

    x = x_0 + r Re(q exp(i w t)),     J q = i w q,     dr/dt = growth r + g r^3

r is the relative amplitude of the carriers and g the first Lyapunov coefficient (`equilibria.onset`).

Source: Kuznetsov, Elements of Applied Bifurcation Theory (2004), Section 10.2.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from thermofem import checks
from thermofem.arrays import Array, NDArray
from thermofem.checks import InputError
from thermofem.data.variables import contents

from ..arguments import check_detuning, check_power
from ..heaters import turned_by
from .branch import follow, follow_along, outwards, relative_range
from .hopf_end import at_rest
from .orbit import FEWEST, CycleProblem, Orbit
from .parameters import LASER, under_laser, value_of
from .path import FreeParameters, Place, corrected, first_place, weights
from .scheme import scheme

SMALL, FAINT = 0.02, 1e-3  # relative amplitude of the first cycle; of one still nearer to the Hopf point
KIND = "Hopf curve"
MOST = 400  # cycles of a branch


class HopfPoint(NamedTuple):
    """A fixed point with a pair of eigenvalues +- i w."""

    state: Array  # internal units
    vector: NDArray[np.complex128]  # with carriers of the fixed point as its third entry
    omega: float  # rad/ns


def is_hopf_point(guess: Any) -> bool:
    """Whether a guess is one point of a Hopf curve."""
    kind = getattr(guess, "attrs", {}).get("kind")
    return isinstance(kind, str) and kind == KIND


def laser_of(guess: Any, turn: float = 0.0) -> tuple[float, float]:
    """Power in W and detuning in Hz of a point of a Hopf curve; heaters turn the resonance by ``turn`` in Hz."""
    if np.ndim(guess["power"] if "power" in getattr(guess, "variables", {}) else 0.0) != 0:
        raise InputError("guess is a whole Hopf curve; give one point of it, such as curve.isel(point=0)")
    what = "one point of a Dataset of coupled.hopf_curves, such as curve.isel(point=0)"
    contents("guess", guess, ("power", "detuning", "energy", "frequency"), what=what)
    for name, unit in (("energy", "J"), ("frequency", "Hz")):
        checks.positive(f"guess[{name!r}]", guess[name].item(), unit=unit, hint=what)
    power = check_power(guess["power"].item(), "guess['power']")
    return power, check_detuning(guess["detuning"].item(), "guess['detuning']") - turn


def hopf_point(p: CycleProblem, guess: Any) -> HopfPoint:
    """The Hopf point of a problem that a point of a Hopf curve names by its energy and frequency."""
    from ..equilibria.balance import absorbable, balance, internal_ring
    from ..kernels import equations as eq

    at = internal_ring(p.ring, p.model, absorbable(p.ring, p.power))
    U, frequency = float(guess["energy"]) / eq.FJ, float(guess["frequency"])
    shift = float(balance(U, at).shift)
    y, J = at_rest(p, at, U, shift - p.at.detuning)
    values, vectors = np.linalg.eig(J)
    omega = 2 * np.pi * eq.NS * frequency
    k = int(np.argmin(np.abs(values - 1j * omega)))
    if not abs(values[k] - 1j * omega) < 1e-3 * omega:
        raise InputError("guess is a Hopf point of another ring or model: no pair of eigenvalues is at its frequency")
    return HopfPoint(y, vectors[:, k] * y[2] / vectors[2, k], omega)


def small_cycle(p: CycleProblem, point: HopfPoint, r: float) -> Orbit:
    """Trial orbit near a Hopf point: the ellipse x + r Re(v exp(i w t)) with relative amplitude ``r``."""
    from ..kernels import orbit_mesh

    tau, c = np.linspace(0, 1, FEWEST + 1), scheme().c
    at = np.concatenate([[0.0], orbit_mesh.stages(tau, c)])
    wave = (np.exp(2j * np.pi * at)[:, None] * point.vector).real
    states = point.state + r * wave
    Y = np.ascontiguousarray(states[1:].reshape(FEWEST, c.size, -1))
    return Orbit(states[0].copy(), Y, tau, 2 * np.pi / point.omega, np.empty((0, 0)), np.inf)


def born(family: FreeParameters, guess: Any, size: float = SMALL) -> tuple[Place, Array]:
    """A small cycle of a family beside a Hopf point, and the tangent of its branch away from it.

    size: relative amplitude of its carriers.
    """
    p = family.base
    own = laser_of(guess, turned_by(p.rise, p.ring))
    point = hopf_point(p if (p.power, p.detuning) == own else under_laser(p, *own), guess)
    for r in (size, size / 4):
        trial = small_cycle(family.base, point, r)
        unit = weights(family, trial)
        outward = np.concatenate([point.vector.real, np.zeros(2)])
        row = outward * unit
        values = np.array([value_of(family.base, name) for name in family.names])
        found = corrected(family, trial, values, (row / np.linalg.norm(row))[None], unit)
        if found is not None and relative_range(found[0]) > r / 4:
            return found[0], outwards(family, found[0], outward)
    raise InputError("no small cycle was found at the Hopf point given as guess: Newton's method finds none")


def near_hopf(p: CycleProblem, guess: Any) -> Orbit:
    """The cycle of a problem, by continuation from a Hopf point at another power or detuning."""
    own = dict(zip(LASER, laser_of(guess, turned_by(p.rise, p.ring)), strict=True))
    wanted = {"power": p.power, "detuning": p.detuning}
    names = [name for name in LASER if wanted[name] != own[name]]
    if not names:
        raise InputError("the Hopf point given as guess is at this power and detuning: its cycle has no size there")
    base, place = under_laser(p, **own), None
    for name in names:
        ends = sorted((own[name], wanted[name]))
        span = ends[1] - ends[0]
        family = FreeParameters(base, (name,), np.array([span]))
        low, high = (ends[0], ends[1] + span) if wanted[name] < own[name] else (ends[0] - span, ends[1])
        if place is None:
            start, tangent = born(family, guess)
            if (float(start.values[0]) - wanted[name]) * (wanted[name] - own[name]) > 0:  # beyond it already
                start, tangent = born(family, guess, FAINT)
            found, why = follow_along(family, start, tangent, low, high, MOST)
        else:
            start = first_place(family, place.orbit) or place
            found, why = follow(family, start, wanted[name] - own[name], low, high, MOST)
        place = found[-1].place
        if abs(float(place.values[0]) - wanted[name]) > 1e-6 * span:
            raise InputError(
                f"no cycle at {name} = {wanted[name]:g} on the branch from the Hopf point given as guess: the branch "
                f"ends with {why}; continue_cycle shows where it goes"
            )
        base = under_laser(base, **(own | {name: wanted[name]}))
        own[name] = wanted[name]
    return place.orbit  # type: ignore[union-attr]
