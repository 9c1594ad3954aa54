"""Calls of the compiled kernel: `Problem.integrate`, `Problem.follow` and `Problem.slopes`.

Everything is in the kernel's units (`units`). The state is y = [Re a, Im a (of every field), N] of every ring, then the
thermal states of every ring:

    problem = Problem(rings, heat, drive, Method.RODAS4)
    run = problem.integrate(problem.zero(), rtol=1e-6)              # run.rows: t, then fields, N, dT of every ring
    orbit = problem.integrate(y, rtol=1e-6, event=Crossing(CARRIERS, y[2], stop=True), keep_steps=True)
    end, dy_end = problem.follow(y, orbit.steps, np.eye(problem.size))    # d(flow)/dy of exactly these steps
    rate, J = problem.slopes(end)                                   # dy/dt and its derivative with respect to y

The kernel returns to Python about ten times a second, so that Ctrl-C acts within a second. ctypes releases the
interpreter's lock meanwhile; two threads must not use the same `Problem`.
"""

from __future__ import annotations

import ctypes as c
import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from thermofem.arrays import Array, NDArray
from thermofem.checks import InputError

from . import library as structures
from .library import library
from .problem_parts import Drive, Network, PoleHeat, Polynomials, QuadraticHeat, Rings
from .tableaus import Method, tableau

ENERGY, CARRIERS, RISE = 1, 2, 3  # what an event watches: U of the first field, N, dT
MAX_STEPS = 20_000_000  # ten seconds of work of one ring
MOST_NUMBERS = 100_000_000  # that rows may hold: 800 MB
RETURN = 0.1  # s of work until the kernel returns for Ctrl-C and progress
CAP = 0.25  # step times the rate of what grows, where the state rests
LARGEST_SPECTRUM = 100  # states; in a larger circuit every ring is rest_step at alone
EVALUATIONS = 10.0  # of the eigenvalues of a circuit, at most in a row
ROOM, PAST_ROOM = 4096, 1024  # rows and steps, past steps, that there is room for at first
DONE, STEPS, FULL, EVENT, RESTING, TOO_SMALL = range(6)  # why the kernel returns, as in loop.hpp

_D, _I, _L, _P = c.c_double, c.c_int, c.c_int64, c.c_void_p


# arrays of `library.Problem` that hold complex numbers, and integers; all others hold floats
COMPLEX = {"own", "entry", "between", "taken", "sent", "late", "seen_ring", "seen_laser", "seen_late"}
WHOLE = {"sequence", "jumps", "varies"}


class Crossing(NamedTuple):
    """Event: a quantity of the ring number ``ring`` rises through ``level``.

    quantity: ENERGY (U of the first field, fJ), CARRIERS (N, 1e23/m^3) or RISE (dT, K).
    stop: whether the integration ends there.
    above: whether the integration starts on the level, so that the quantity must first fall below it.
    """

    quantity: int
    level: float
    stop: bool = True
    ring: int = 0
    above: bool = False


class Run(NamedTuple):
    """Result of `Problem.integrate`: rows, final state ``y`` at the time ``t`` (ns), and times of the events (ns)."""

    rows: Array
    """One row per output time or accepted step: t, then Re and Im of the fields, N and dT of each ring, then waves."""
    y: Array
    t: float
    step: float
    """Length of the step that would follow, ns."""
    crossings: Array
    accepted: int
    rejected: int
    steps: Array
    """Lengths of the accepted steps, ns; empty unless ``keep_steps``."""


class Problem:
    """Initial-value problem of a ring or a circuit under given light, as arrays that the compiled kernel reads."""

    def __init__(
        self,
        rings: Rings,
        heat: PoleHeat | QuadraticHeat,
        drive: Drive,
        method: Method,
        network: Network | None = None,
    ) -> None:
        """Store pointers to all arrays; an array is copied only where its type or memory order differs."""
        self.heat = heat
        self.edges = np.ascontiguousarray(drive.edges, dtype=float)
        self._kept: list[Any] = []
        self._c = structures.Problem()
        m = tableau(method)
        R, F = rings.modes.shape[:2]
        if F > 4:
            raise InputError(f"lasers are on {F} resonances; at most 4 are possible")
        if rings.dispersion.shape[1] > 8:
            raise InputError(f"fcd has {rings.dispersion.shape[1]} terms; at most 8 are possible")
        self._c.method = structures.Method(
            len(m.a), m.order, m.gamma, *map(self._at, (m.a, m.c, m.dense, m.at, m.slope))
        )
        self._set(**rings._asdict() | {"bend": np.full(R, rings.bend), "own": np.zeros(R)})
        if isinstance(heat, QuadraticHeat):
            self.order = len(heat.C)
            self._set(**heat._asdict(), heat=1, read=heat.C)
        else:
            self.order = heat.gain.shape[1]
            read = np.ones_like(heat.gain) if heat.read is None else heat.read
            self._set(**heat._replace(read=read)._asdict(), weight=np.abs(read))
        L = drive.entry.shape[1]
        pieces = len(drive.edges) - 1
        self.waves = 0
        self.delays = 0
        self.longest_delay = 0.0  # ns
        jumps = np.full(pieces, network is not None and network.delay.size > 0)  # light that comes back may
        varies = np.zeros_like(jumps)
        for name, size, least in (
            ("power", lambda P: np.sqrt(np.maximum(P, 0)), 1e-6 * np.sqrt(drive.brightest)),
            ("phase", np.zeros_like, 0.0),  # it does not jump
            ("detuning", np.asarray, 1e-6 * rings.modes[:, 0, 0].max()),
        ):
            functions: Polynomials = getattr(drive, name)
            place, jumped, changing = functions.over(self.edges, size, least)
            jumps = jumps | jumped
            varies = varies | changing
            _, columns, terms = functions.coefficients.shape
            table = structures.Table(columns, terms, self._at(place, np.int32), *map(self._at, functions))
            setattr(self._c, name, table)
        self._detunings = self._kept[-1]
        self._set(edges=self.edges, jumps=jumps, varies=varies, entry=drive.entry, brightest=drive.brightest)
        self._set(rings=R, fields=F, order=self.order, terms=rings.dispersion.shape[1], lasers=L, pieces=pieces)
        if network is not None:
            self._set(**network._asdict(), delays=network.delay.size, waves=len(network.seen_ring))
            self.delays = network.delay.size
            self.longest_delay = float(network.delay.max(initial=0.0)) + network.time_tolerance  # ns
            self.waves = len(network.seen_ring) * (2 + network.energies + (network.corner is not None))
        self.rings = R
        self.block = 2 * F + 1
        self.size = R * (self.block + self.order)
        self.width = 1 + R * (self.block + 1) + self.waves
        self._memory: dict[str, Any] = {}

    def _at(self, values: Any, kind: Any = float) -> int:
        """Return the memory address of an array, to which a reference is kept."""
        self._kept.append(np.ascontiguousarray(values, dtype=kind))
        return int(self._kept[-1].ctypes.data)

    def _set(self, **values: Any) -> None:
        """Store numbers and addresses of arrays in the C structure, under their names; None is no array."""
        for name, value in values.items():
            if isinstance(value, np.ndarray):
                value = self._at(value, _kind(name))
            setattr(self._c, name, value)

    def _call(self, name: str, *arguments: Any) -> int:
        """Call a function of `kernel.hpp`; its first call returns the size of the work memory, which is kept."""
        function = getattr(library(), name)
        function.restype = _L
        if name not in self._memory:
            size = function(c.byref(self._c), *arguments, None)
            self._memory[name] = np.empty(size + 64, np.uint8)
        memory = self._memory[name].ctypes.data
        return int(function(c.byref(self._c), *arguments, _P(memory + -memory % 64)))

    def set_detuning(self, detuning: float) -> None:
        """Set the detuning in rad/ns of a problem of one ring under constant light."""
        self._detunings[0, 0, 0] = detuning

    @property
    def address(self) -> int:
        """Memory address of the C structure of the problem."""
        return c.addressof(self._c)

    def zero(self) -> Array:
        """Return the state without light, carriers and temperature rise, shape (size,)."""
        return np.zeros(self.size)

    def integrate(
        self,
        y: Array,
        *,
        rtol: float,
        times: Array | None = None,
        per_step: int = 1,
        first_step: float = 0.0,
        longest: float = np.inf,
        event: Crossing | None = None,
        keep_steps: bool = False,
        progress: Callable[[float], None] | None = None,
    ) -> Run:
        """Integrate the state ``y`` over the whole drive; a step ends at every breakpoint of the drive.

        times [ns]: output times; by default each accepted step has ``per_step`` rows at equal distances.
        first_step, longest [ns]: first trial step (0 for a cautious one), and upper bound of all steps.
        progress: called with the time reached in ns, some ten times a second.
        Raises InputError: too many steps or rows, or every step is rejected, however small.
        """
        y = np.array(y, dtype=float)
        loop = structures.Loop(
            t=self.edges[0], h=first_step, rtol=rtol, longest=longest, seen=np.inf, per_step=per_step
        )
        if event is not None:
            loop.quantity = event.quantity
            loop.level = event.level
            loop.ring = event.ring
            loop.stop = int(event.stop)
            loop.seen = 0.0 if event.above else np.inf
        room = _Room(self, loop, times, keep_steps)
        if event is None or not event.stop:
            room.check(longest)
        crossings: list[float] = []
        budget = 1000
        began = time.perf_counter()
        evaluations = EVALUATIONS
        while True:
            loop.budget = min(budget, MAX_STEPS + 1 - loop.accepted - loop.rejected)
            status = self._call("ring_integrate", c.byref(loop), _pointer(y), *room.pointers)
            if status == STEPS:
                elapsed = time.perf_counter() - began
                began = time.perf_counter()
                budget = _next_budget(budget, elapsed)
                if progress:
                    progress(loop.t)
                if loop.accepted + loop.rejected > MAX_STEPS:
                    raise InputError(
                        f"duration: the run takes more than {MAX_STEPS} steps at rtol = {rtol:g} (they reach "
                        f"{loop.t * 1e-9:g} s); shorten it or loosen rtol"
                    )
            elif status == FULL:
                room.grow()
            elif status == RESTING:
                evaluations = self._bound_step(y, loop, evaluations)
            elif status == TOO_SMALL:
                raise no_step(loop.t)
            elif status == EVENT:
                crossings.append(loop.crossing)
            if status == DONE or (status == EVENT and loop.stop):
                break
        if progress:
            progress(loop.t)
        rows = room.rows[: loop.filled]
        steps = room.steps[: loop.accepted]
        return Run(rows, y, loop.t, loop.h, np.array(crossings), loop.accepted, loop.rejected, steps)

    def _bound_step(self, y: Array, loop: Any, evaluations: float) -> float:
        """Bound the step by the fastest growing eigenvalue, at a state that hardly changes.

            step <= CAP/max |lambda|   over the eigenvalues of the Jacobian with Re(lambda) > 0

        A long step of an L-stable method damps growing modes, too, and would stay on an unstable fixed point.
        Eigenvalues of a circuit cost as much as hundreds of steps: ten evaluations are allowed at first, and one more
        every 4000 steps. ``evaluations`` is the number left; returns the number left after this call.
        """
        if self.rings > 1:
            since = loop.accepted - max(loop.rest_again - 20, 0)
            evaluations = min(evaluations + since / 4000, EVALUATIONS)
            if evaluations < 1:
                loop.h = min(loop.h, max(4 * loop.rest_step, 1.0))
                return evaluations
            evaluations -= 1
        _, J = self.slopes(y, loop.piece, loop.t)
        spectra = [np.linalg.eigvals(J[np.ix_(part, part)]) for part in self._parts()]
        eigenvalues = np.concatenate(spectra)
        growing = np.abs(eigenvalues[eigenvalues.real > 0])
        loop.cap = CAP / growing.max() if growing.size else np.inf
        loop.rest_step = loop.h
        loop.rest_again = loop.accepted + 20
        loop.h = min(loop.h, loop.cap)
        return evaluations

    def _parts(self) -> list[NDArray[np.int_]]:
        """Indices of the states whose eigenvalues are taken together: all, or those of each ring of a large circuit."""
        if self.size <= LARGEST_SPECTRUM or self.rings == 1:
            return [np.arange(self.size)]
        light = np.arange(self.rings * self.block).reshape(self.rings, self.block)
        heat = np.arange(self.rings * self.block, self.size).reshape(self.rings, self.order)
        return [*np.hstack([light, heat])]

    def follow(self, y: Array, steps: Array, V: Array) -> tuple[Array, Array]:
        """Repeat given steps under the constant light of the first piece; return the end and its derivative.

        y [shape (n,)]: initial state. steps [shape (m,), ns]: from a run with ``keep_steps``.
        V [shape (n, directions)]: directions at the start; ``np.eye(n)`` for the whole derivative, no columns for the
            end alone (fixed steps make the end a smooth function of every parameter).
        Returns the final state, shape (n,), and d(end)/d(y) V, shape (n, directions). Only for one field per ring.
        """
        y = np.ascontiguousarray(y, dtype=float)
        steps = np.ascontiguousarray(steps, dtype=float)
        V = np.array(V, dtype=float, order="C")
        end = np.empty(self.size)
        self._call(
            "ring_follow", _pointer(y), _pointer(steps), _L(len(steps)), _pointer(end), _pointer(V), _I(V.shape[1])
        )
        return end, V

    def slopes(self, y: Array, piece: int = 0, t: float | None = None) -> tuple[Array, Array]:
        """Return dy/dt, shape (n,), and its derivative with respect to y, (n, n), at t (ns) in a piece of the drive."""
        y = np.ascontiguousarray(y, dtype=float)
        rate = np.empty(self.size)
        J = np.eye(self.size)
        at = _D(self.edges[piece] if t is None else t)
        self._call("ring_slopes", _pointer(y), _I(piece), at, _pointer(rate), _pointer(J), _I(self.size))
        return rate, J


class _Room:
    """The arrays that a run fills: output rows, lengths of steps, and past steps for delayed light; they grow."""

    def __init__(self, problem: Problem, loop: Any, times: Array | None, keep_steps: bool) -> None:
        self.problem = problem
        self.loop = loop
        self.times = None if times is None else np.ascontiguousarray(times, dtype=float)
        self.keep_steps = keep_steps
        self.rows = np.empty((self.count or ROOM, problem.width))
        self.steps = np.empty(ROOM if keep_steps else 0)
        self.has_delays = problem.delays > 0
        self._remember(np.empty((PAST_ROOM, 3 + 8 * problem.delays)), 0)

    @property
    def count(self) -> int:
        """Number of output times, 0 where every step has rows."""
        return 0 if self.times is None else len(self.times)

    @property
    def pointers(self) -> tuple[Any, ...]:
        """Arguments of `ring_integrate`: rows and their number, output times and their number, steps."""
        self.loop.room = len(self.steps)
        steps = _pointer(self.steps) if self.keep_steps else None
        return _pointer(self.rows), _L(len(self.rows)), _pointer(self.times), _L(self.count), steps

    def check(self, longest: float) -> None:
        """Raise InputError before a run whose shortest possible sequence of steps is too long, or fills the memory.

        longest [ns]: upper bound of a step; steps end at the breakpoints of the drive, too.
        """
        edges = self.problem.edges
        least = max(len(edges) - 1, math.ceil((edges[-1] - edges[0]) / longest))
        reason = f"{least:.3g} steps at least, as none is longer than {longest:.3g} ns or passes a breakpoint"
        if least > MAX_STEPS:
            raise InputError(f"duration: the run takes {reason}; at most {MAX_STEPS} are possible")
        doublings = max(int(math.log2(MOST_NUMBERS / self.rows.size)), 0)
        if not self.count and least * self.loop.per_step > len(self.rows) << doublings:
            raise InputError(f"times: the run takes {reason}, whose rows do not fit into the memory; give times")

    def _remember(self, past: Array, filled: int) -> None:
        self.past = past
        self.loop.past = past.ctypes.data
        self.loop.past_filled = filled
        self.loop.past_room = len(past) if self.has_delays else 0

    def grow(self) -> None:
        """Double what is full; forget past steps whose light has arrived."""
        loop = self.loop
        if 2 * self.rows.size > MOST_NUMBERS:
            raise InputError(f"times: the accepted steps up to {loop.t * 1e-9:g} s fill the memory; give times")
        if not self.count and loop.filled + loop.per_step > len(self.rows):
            self.rows = np.concatenate([self.rows, np.empty_like(self.rows)])
        if self.keep_steps and loop.accepted == len(self.steps):
            self.steps = np.concatenate([self.steps, np.empty_like(self.steps)])
        if self.has_delays and loop.past_filled == loop.past_room:
            ends = self.past[:, 0] + self.past[:, 1]
            needed = self.past[ends > loop.t - self.problem.longest_delay]
            more = np.empty((PAST_ROOM + len(needed), self.past.shape[1]))
            self._remember(np.concatenate([needed, more]), len(needed))


def _kind(name: str) -> Any:
    """Type of the numbers in an array of `library.Problem`."""
    if name in COMPLEX:
        return complex
    return np.int32 if name in WHOLE else float


def _next_budget(budget: int, elapsed: float) -> int:
    """Steps until the kernel returns again, after as many as ``budget`` took ``elapsed`` seconds."""
    factor = RETURN / max(elapsed, 1e-6)
    return int(budget * min(max(factor, 0.5), 8.0)) + 1


def no_step(t: float) -> InputError:
    """Return the InputError of a run that stops at t in ns because every step is rejected, however small."""
    return InputError(
        f"model or power: found no step small enough at t = {t * 1e-9:g} s: light and heat run away, or the rise is at "
        "the top of an output map; look at the model's largest numbers"
    )


def _pointer(values: NDArray[Any] | None) -> Any:
    return None if values is None else _P(values.ctypes.data)
