"""The dynamical system of a ring under a constant laser, and the stable cycle to which its transient converges.

The transient is integrated in parts until three pulses occur or a stable fixed point is reached. Newton's method then
looks for a periodic orbit of one pulse, and of as many pulses as bring the trajectory back near its start. An orbit
with a multiplier below -1 has undergone period doubling, and twice as many pulses are tried. A stable orbit is accepted
if the trajectory approaches it further, and, where a stable fixed point exists, if its amplitude is that of the pulses.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, islice
from typing import Any, NamedTuple

import numpy as np

from thermofem import Foster, InputError, Quadratic, checks
from thermofem.arrays import Array

from ..equilibria.balance import InternalRing, absorbable, internal_ring
from ..equilibria.steady_states import survey
from ..heaters import turned_by
from ..inputs import check_power
from ..kernel.integrator import CARRIERS, ENERGY, Problem
from ..kernel.tableaus import Method
from ..kernel.units import NS, internal_detuning, internal_pump, single_ring
from ..resonator import RingResonator
from ..ring_toml import UNITS
from ..thermal import Compact, compact, provenance
from ..unknowns import FROM_ZERO, number_of, optical_names, varied
from .return_map import FLAT, REACH, Flow, Orbit

FIRST_PART, LONGEST_PART, LONGEST_SEEN = 4e3, 1e5, 1e6  # ns; the last without three pulses in it
REST = 5e-3  # relative distance from a stable fixed point, and range of the carriers, from which a ring goes to rest
MOST_PULSES = 8
BACK, REPEATS = 0.02, 1e-4  # of the largest heat, within which a trace is back, and repeats itself
DIFFER = 20  # pulses after which those of a doubled cycle differ clearly
PATIENT = 30  # turns at most by which a trace must have come nearer to its cycle
SLOW = ", such as that of a model without its slowest pole"
LONGEST_TRANSIENT = 2e6  # ns
SLOWEST, MOST_TRANSIENT = 30, 1e8  # of the slowest time constant, where that is longer; ns, at most
LASER = ("power", "detuning")


class RestError(InputError):
    """The transient converges to a stable fixed point."""


class UnsettledError(InputError):
    """The transient converges neither to a fixed point nor to a periodic orbit."""


class Part(NamedTuple):
    """Measures of the section's quantity (carriers or energy) in the second half of a part of a transient."""

    low: float  # in the second half
    high: float
    third: float  # range in the third quarter
    fourth: float
    rises: int  # through the middle, after the first quarter
    longest: float  # ns between two of them
    moved: float  # relative range in the whole part

    def pulses(self, points: Callable[[], Array]) -> bool:
        """Whether it pulses; a decreasing amplitude counts as pulsing only if there are no stable fixed points."""
        moves = self.rises >= 3 and self.high - self.low > FLAT * self.high
        # an oscillation that keeps less of its amplitude from one quarter to the next dies away
        return moves and (self.fourth >= 0.95 * self.third or not len(points()))

    @property
    def rests(self) -> bool:
        """Whether the relative range is below `REST` and not growing, as near a fixed point."""
        return self.high - self.low <= REST * self.high and self.fourth <= self.third + FLAT * self.high

    def following(self, duration: float, longest: float) -> float:
        """Duration in ns of the next part, after one of ``duration`` ns: longer for slow changes without pulses."""
        changes_slowly = self.rises < 3 and self.moved > REST
        if not changes_slowly:
            return min(2 * duration, LONGEST_PART)
        return min(2 * duration, max(LONGEST_PART, min(LONGEST_SEEN, longest)))


def measured(t: Array, q: Array, duration: float) -> Part:
    """Measure a part of a transient: times t and section's quantity q, shape (rows,); its duration in ns."""
    parts = [0, *np.searchsorted(t, [duration / 2, 0.75 * duration])]  # the first half and two quarters
    lows = np.minimum.reduceat(q, parts).tolist()
    highs = np.maximum.reduceat(q, parts).tolist()
    low = min(lows[1:])
    high = max(highs[1:])
    above = q > 0.5 * (low + high)
    ups = t[1 + np.flatnonzero(above[1:] & ~above[:-1])]
    ups = ups[ups >= duration / 4]
    third = highs[1] - lows[1]
    fourth = highs[2] - lows[2]
    gap = float(np.diff(ups).max(initial=0.0))
    top = max(highs)
    moved = (top - min(lows)) / max(top, 1e-300)
    return Part(low, high, third, fourth, ups.size, gap, moved)


def settled(
    system: Any, y: Array, points: Callable[[], Array], longest: float, *, begin: str = "a cold ring",
    where: str = "", slow: bool = False, look: Callable[[], None] = lambda: None,
) -> Any:  # fmt: skip
    """Return the stable cycle to which the transient from the state ``y`` converges.

    system: a `Flow`, or what has its ``heat``, ``part``, ``turn``, ``cycle``, ``confirmed`` and ``swing``, and orbits
        with start, T, pulses, size and leading.
    points: returns the stable fixed points, rows (U, N, dT); called only where they are needed.
    longest [ns]: largest duration of the transient; ``slow`` says that this is short for the thermal time constants.
    begin, where: name of the initial state, and power and detuning, for error messages.
    look: called between the parts of the transient; it may raise.

    Raises RestError at a stable fixed point, UnsettledError if no cycle is found within ``longest``.
    """
    passed = 0.0
    reason = "no pulse"
    wary = False
    duration = FIRST_PART
    step = 0.0
    while passed < longest:
        look()
        # a longer first step than 100 ns would rest on an unstable fixed point
        y, step, rows, q = system.part(y, duration, min(step, 100.0))
        passed = passed + duration
        part = measured(rows[:, 0], q, duration)
        fixed = resting(rows[-1], points()) if part.rests else None
        if part.pulses(points):
            orbit, reason, unstable = pulse_train(system, y, part, wary, passed >= longest)
            wary = wary or unstable
            if orbit is not None:
                amplitude = part.high - part.low
                change = abs(system.swing(orbit) - amplitude)
                # amplitudes that differ by less than a fifth are taken for the same
                if change <= 0.2 * amplitude or not len(points()):
                    return orbit
                reason = "the pulses still change"
        if fixed is not None:
            U, _, dT = fixed
            raise RestError(
                f"no limit cycle{where}: within {passed / 1e3:.3g} us {begin} comes to rest at a stable fixed point, "
                f"{U:.4g} fJ and {dT:.4g} K; give guess= a cycle nearby where one may lie beside it"
            )
        duration = part.following(duration, longest)
    hint = SLOW if slow else ""
    raise UnsettledError(
        f"no settled cycle{where}: {passed / 1e3:.4g} us from {begin} do not lead to one ({reason}); "
        f"give guess= a cycle nearby{hint}"
    )


def resting(row: Array, points: Array) -> Array | None:
    """The stable fixed point (U, N, dT) within a relative distance `REST` of a row (t, Re a, Im a, N, dT), or None."""
    _, re, im, N, dT = row
    here = np.array([re**2 + im**2, N, dT])
    for point in points:
        if np.all(np.abs(here - point) <= REST * np.abs(point)):
            return point
    return None


def pulse_train(system: Any, y: Array, part: Part, wary: bool, last: bool) -> tuple[Any, str, bool]:
    """The stable cycle near a pulsing trajectory, or None and the reason; and whether an unstable cycle was found.

    wary: an unstable cycle is known, so only a trajectory that repeats itself is tried.
    last: the transient ends here, so the orbit is also tried at full accuracy.
    """
    wait = part.longest
    reason = "the pulses do not repeat"
    unstable = wary
    start = system.turn(y, 4 * wait, (part.low + part.high) / 2)
    if start is None:
        return None, "the pulses end", False
    for pulses, precisely in _tries(system, start, wait, wary, last):
        orbit, why = _stable(system, start, wait, pulses, precisely)
        if orbit is not None:
            shortest = once(system, orbit, wait)
            if comes_nearer(system, start, shortest, wait):
                confirmed = system.confirmed(shortest, wait)
                if confirmed is not None:
                    return confirmed, "", False
        reason = why or reason
        unstable = unstable or bool(why)
    return None, reason, unstable


def _tries(system: Any, y: Array, wait: float, wary: bool, last: bool) -> Iterator[tuple[int, bool]]:
    """Pairs (pulses, whether at full accuracy) to try: one pulse, then the fewest after which the state recurs."""
    if not wary:
        yield 1, False
    off = _distances(system, y, wait, MOST_PULSES)
    least = min(off.values(), default=np.inf)
    back = next((pulses for pulses in off if off[pulses] <= min(2 * least, BACK)), 0)
    if back > 1 or (back and wary):
        yield back, False
    if least <= REPEATS or (last and back):
        yield back, True


def _pulses(system: Any, y: Array, wait: float) -> Iterator[Array]:
    """The state at each pulse that follows after the state ``y``."""
    while (after := system.turn(y, REACH * wait)) is not None:
        yield (y := after)


def _distances(system: Any, y: Array, wait: float, most: int) -> dict[int, float]:
    """Relative distance of the thermal state from its start after 1, 2, ... pulses: a dict from pulses to distance."""
    off: dict[int, float] = {}
    for pulses, state in enumerate(islice(_pulses(system, y, wait), most), start=1):
        off[pulses] = distance(system, state, y)
        if off[pulses] <= REPEATS:
            break
    return off


def _stable(system: Any, y: Array, wait: float, pulses: int, precisely: bool) -> tuple[Any, str]:
    """The stable cycle of ``pulses`` pulses, or of 2, 4, ... times as many after doubling; or None and the reason."""
    reason = ""
    while pulses <= MOST_PULSES:
        orbit = system.cycle(y, pulses, wait, precisely)
        if orbit is None:
            return None, reason
        if orbit.size < 1:
            return orbit, ""
        if orbit.leading.real > -1 or orbit.leading.imag != 0:
            return None, "the cycle there is unstable"
        reason = f"a cycle of {pulses} has doubled, with a multiplier of {orbit.leading.real:.3g}"
        later = [*islice(_pulses(system, y, wait), DIFFER)]
        if len(later) < DIFFER:
            return None, reason
        y = later[-1]
        pulses = 2 * pulses
    return None, reason


def once(system: Any, orbit: Any, wait: float) -> Any:
    """The shorter stable cycle of which ``orbit`` is a repetition, so that its period is minimal; else ``orbit``."""
    for pulses, off in _distances(system, orbit.start, wait, orbit.pulses // 2).items():
        if orbit.pulses % pulses == 0 and off <= BACK:
            shorter = system.cycle(orbit.start, pulses, wait, False)
            if shorter is None:
                continue
            share = pulses / orbit.pulses
            repeats = abs(shorter.T - share * orbit.T) <= 1e-3 * orbit.T
            if repeats and shorter.size < 1:
                return shorter
    return orbit


def comes_nearer(system: Any, y: Array, orbit: Any, wait: float) -> bool:
    """Whether the trajectory from ``y`` approaches the orbit, over as many periods as halve a small perturbation."""
    halving = np.log(0.5) / np.log(max(orbit.size, 1e-3))
    turns = int(np.clip(np.ceil(halving), 2, PATIENT))
    states = chain([y], _pulses(system, y, wait))
    off = (distance(system, state, orbit.start) for state in states)
    first = min(islice(off, orbit.pulses))
    if first < REPEATS:
        return True
    last = [*islice(off, (turns - 1) * orbit.pulses, turns * orbit.pulses)]
    nearer = (1 + orbit.size**turns) / 2 * first
    return len(last) == orbit.pulses and min(last) < max(nearer, REPEATS)


def distance(system: Any, y: Array, other: Array) -> float:
    """Largest modulus of the difference of two states' thermal parts, relative to the largest modulus in ``other``."""
    heat = y[system.heat :]
    reference = other[system.heat :]
    scale = max(np.abs(reference).max(), 1e-300)
    return float(np.abs(heat - reference).max() / scale)


@dataclass(frozen=True, eq=False)
class CycleProblem:
    """A ring with its thermal model under constant power and detuning, of which cycles are computed.

    model: as `thermal.compact` returns it.
    power [W], detuning [Hz]
    rise [K]: constant temperature rise by heaters.
    """

    ring: RingResonator
    model: Compact
    power: float
    detuning: float
    rise: float = 0.0

    @property
    def total_detuning(self) -> float:
        """Detuning in Hz plus the resonance shift by the heaters: that of the equivalent ring without heaters."""
        return self.detuning + turned_by(self.rise, self.ring)

    def kernel(self, method: Method) -> Problem:
        """The equations for the C++ kernel, in internal units, to be integrated with a Rosenbrock method."""
        return single_ring(self.ring, self.model, self.power, self.total_detuning, 1.0, method)

    @cached_property
    def flow(self) -> Flow:
        """The flow of the system, with a Poincare section in the carriers; in the energy if there are none."""
        quantity = CARRIERS if self.ring.g_tpa > 0 else ENERGY
        return Flow(self.kernel(Method.RODAS4), self.kernel(Method.RODAS5P), quantity)

    @cached_property
    def internal(self) -> InternalRing:
        """The ring and its steady thermal response in internal units; InputError if the model has no steady state."""
        return internal_ring(self.ring, self.model, absorbable(self.ring, self.power))

    @property
    def laser(self) -> tuple[float, float]:
        """Pump amplitude in sqrt(fJ)/ns and detuning in rad/ns, heaters included."""
        return internal_pump(self.ring, self.power), internal_detuning(self.total_detuning)

    @property
    def poles(self) -> Foster | None:
        """The Foster network of the thermal model, or that below its output map; None for a quadratic model."""
        return None if isinstance(self.model, Quadratic) else self.model.linear

    @cached_property
    def stable_points(self) -> Array:
        """Stable fixed points, rows (U, N, dT) in internal units; empty if the model has no steady state."""
        try:
            at = self.internal
        except InputError:
            return np.empty((0, 3))
        return survey(*self.laser, at)[0].stable

    @property
    def longest(self) -> float:
        """Longest transient in ns that is integrated before a cycle must have been found."""
        slowest = 1 / (NS * self.model.slowest_rate)
        return max(LONGEST_TRANSIENT, min(SLOWEST * slowest, MOST_TRANSIENT))

    def provenance(self, kind: str) -> dict[str, Any]:
        """Attributes of a Dataset: its kind, the ring, the poles, power (W) and detuning (Hz)."""
        return provenance(kind, self.ring, self.model) | {"input_power": self.power, "detuning": self.detuning}

    @property
    def where(self) -> str:
        """Power and detuning as text for error messages."""
        return f" at power = {self.power:g} W, detuning = {self.detuning:g} Hz"

    def settled(self, y: Array, begin: str = "a cold ring") -> Orbit:
        """The stable cycle to which the transient from the state ``y`` converges; errors as of `settled`."""
        orbit: Orbit = settled(
            self.flow, y, lambda: self.stable_points, self.longest, begin=begin, where=self.where,
            slow=self.longest >= MOST_TRANSIENT,
        )  # fmt: skip
        return orbit


def numbers_of(p: CycleProblem) -> dict[str, tuple[float, str]]:
    """Value and unit (SI) of every parameter that `changed` accepts, by name; "R1", "tau1": the fastest pole."""
    numbers = {"power": (p.power, "W"), "detuning": (p.detuning, "Hz")}
    for name in sorted(optical_names(p.ring)):
        numbers[name] = (number_of(p.ring, name), UNITS[name])
    for k, (coefficient, exponent) in enumerate(p.ring.fcd):
        numbers[f"fcd{k + 1}"] = (coefficient, f"m^{3 * exponent:g}")
    if p.poles:
        for name, unit in (("R", "K/W"), ("tau", "s")):
            for k, value in enumerate(getattr(p.poles, name)):
                numbers[f"{name}{k + 1}"] = (float(value), unit)
    return numbers


def value_of(p: CycleProblem, name: str) -> float:
    """Return the value of a parameter of a problem by its name, in SI."""
    numbers = numbers_of(p)
    return numbers[checks.choice("a parameter", name, numbers)][0]


def changed(p: CycleProblem, name: str, value: float) -> CycleProblem:
    """Return a copy of the problem in which the parameter ``name`` has another value (SI)."""
    if name in optical_names(p.ring):
        return replace(p, ring=varied(p.ring, {name: value}))
    if name == "power":
        return replace(p, power=check_power(value))
    if name == "detuning":
        return replace(p, detuning=value)
    kind = name.rstrip("0123456789")
    number = int(name.removeprefix(kind)) - 1
    if kind == "fcd":
        terms = [(value, term[1]) if k == number else term for k, term in enumerate(p.ring.fcd)]
        return replace(p, ring=replace(p.ring, fcd=tuple(terms)))
    assert p.poles is not None  # a quadratic model has no such parameter
    numbers: dict[str, Any] = {key: np.array(getattr(p.poles, key), dtype=float) for key in ("R", "tau")}
    numbers[kind][number] = value
    network = replace(p.poles, **numbers)  # checks them and sorts them
    checks.keep(network, **numbers)  # states and names keep their poles where one time constant passes another
    return replace(p, model=compact(replace(p.model, linear=network)))  # type: ignore[arg-type]


def differences(p: CycleProblem, name: str) -> list[tuple[float, CycleProblem]]:
    """Pairs (weight, problem) of a difference formula: sum of weight f(y; problem) is df/d(parameter), per SI unit."""
    value = value_of(p, name)
    size = p.ring.linear_rate / (2 * np.pi) if name == "detuning" else abs(value)
    # the truncation is the fourth power of the relative step, the round-off 1e-16 over it
    h = 1e-4 * size or FROM_ZERO.get(name, 0.0)
    if h == 0:
        raise checks.InputError(f"{name} is 0 and has no step for differences; give it a small value")
    stencil = [(1, 8), (-1, -8), (2, -1), (-2, 1)]  # steps from the value, weights over 12: of order 4
    if value == 0 and name != "detuning":
        stencil = [(1, 24), (2, -6), (0, -18)]  # to one side, of order 2
    return [(weight / (12 * h), changed(p, name, value + steps * h)) for steps, weight in stencil]
