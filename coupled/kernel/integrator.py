"""Calls of the compiled kernel: `Problem.integrate`, `Problem.follow` and `Problem.slopes`.

Everything is in the kernel's units (`units`). The state is y = [Re a, Im a (of every field), N] of every ring, then the
states of heat of every ring:

    problem = Problem(rings, heat, drive, Method.RODAS4)
    run = problem.integrate(problem.zero(), rtol=1e-6)              # run.rows: t, then fields, N, dT of every ring
    turn = problem.integrate(y, rtol=1e-6, event=Crossing(CARRIERS, y[2], stop=True), keep_steps=True)
    end, dy_end = problem.follow(y, turn.steps, np.eye(problem.size))     # d(flow)/dy of exactly these steps
    rate, J = problem.slopes(end)                                   # dy/dt and d(dy/dt)/dy

The kernel returns after some ten thousand steps, so Ctrl-C acts within a second. ctypes lets other threads run
meanwhile; a `Problem` serves one thread.
"""

from __future__ import annotations

import ctypes as c
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from thermofem.arrays import Array, NDArray
from thermofem.checks import InputError

from .library import library
from .tableaus import Method, tableau

ENERGY, CARRIERS, RISE = 1, 2, 3  # what an event watches: U of the first field, N, dT
MAX_STEPS = 20_000_000  # ten seconds of work of one ring
MOST_NUMBERS = 100_000_000  # that rows may hold: 800 MB
RETURN = 0.1  # s of work until the kernel returns for Ctrl-C and progress
CAP = 0.25  # step times the rate of what grows, where the state rests
LARGEST_SPECTRUM = 100  # states; in a larger circuit every ring is looked at alone
DONE, STEPS, FULL, EVENT, RESTING, TOO_SMALL = range(6)  # why the kernel returns, as in loop.hpp
SINGLE, BUS, LOOPS = range(3)  # how light passes the rings, as in equations.hpp

_D, _I, _L, _P = c.c_double, c.c_int, c.c_int64, c.c_void_p


def _structure(name: str, *fields: tuple[str, Any]) -> Any:
    parts = [(each, kind) for names, kind in fields for each in names.split()]
    return type(name, (c.Structure,), {"_fields_": parts})


_Table = _structure("_Table", ("pieces columns terms", _I), ("edges c", _P))
_Method = _structure("_Method", ("stages order", _I), ("gamma", _D), ("a c dense at slope", _P))
_Problem = _structure(
    "_Problem",
    ("rings fields order terms lasers pieces heat light delays waves", _I),
    ("method", _Method),
    ("modes carriers dispersion bend own floor gain rate read cross A H G B C weight edges", _P),
    ("power phase detuning", _Table),
    ("entry brightest sequence between taken sent delay late seen_ring seen_laser seen_late corner", _P),
    ("energies", _I),
    ("hair", _D),
)
_Loop = _structure(
    "_Loop",
    ("t h h_before size_before growth rtol longest restart cap looked level seen crossing", _D),
    ("accepted rejected look_again filled room budget", _L),
    ("begun piece entered fresh per_step quantity ring stop", _I),
    ("past", _P),
    ("past_filled past_room", _L),
)


class Rings(NamedTuple):
    """R rings with F fields each."""

    modes: Array
    """(R, F, 8), by the last axis `units.Mode`."""
    carriers: Array
    """(R, 3): tau0, a, b."""
    dispersion: Array
    """(R, terms, 2): c_k and p_k; a term that a ring lacks is (0, 1)."""
    floor: Array
    """(R, 3), `units.floor_of`."""
    bend: float = 0.0
    """Curvature of the output map in 1/K."""


class PoleHeat(NamedTuple):
    """dx_k/dt = gain_k P - rate_k x_k for every ring; z = sum_k read_k x_k, which is sum_k x_k for a ring alone."""

    gain: Array
    """(R, K), as ``rate`` and ``read``."""
    rate: Array
    read: Array | None = None
    cross: Array | None = None
    """(R, R, K): what x_jk adds to the temperature of another ring i."""


class QuadraticHeat(NamedTuple):
    """dx/dt = A x + H[x, x] + (G x + B) P, z = C x, of one ring; ``weight``: K of error a unit of error of x."""

    A: Array
    H: Array
    G: Array
    B: Array
    C: Array
    weight: Array


class Polynomials(NamedTuple):
    """Functions of time, polynomials in t - edges[k] between edges[k] and edges[k + 1]."""

    edges: Array
    coefficients: Array
    """(pieces, functions, terms), constant term first."""


class Drive(NamedTuple):
    """L lasers and the detunings of all fields."""

    edges: Array
    """ns; a step ends at each."""
    power: Polynomials
    """(pieces, L, 4)"""
    phase: Polynomials
    """(pieces, L, terms), rad"""
    detuning: Polynomials
    """(pieces, R F, 4), rad/ns"""
    entry: NDArray[np.complex128]
    """(R F, L): amplitude in a field for each square root of a power."""
    brightest: Array
    """(L,), largest power; above 0."""

    @classmethod
    def constant(cls, power: float, detuning: float, duration: float) -> Drive:
        """One ring under constant light: ``power`` = 2 gamma_e P, fJ/ns^2, and detuning in rad/ns."""
        edges = np.array([0.0, duration])
        P, none, turn = (Polynomials(edges, np.array([[[value, 0.0, 0.0, 0.0]]])) for value in (power, 0.0, detuning))
        return cls(edges, P, none, turn, np.ones((1, 1), dtype=complex), np.array([max(power, 1e-300)]))


class Network(NamedTuple):
    """Light between the R rings of a circuit, its D delays and the Q waves that are observed; from L lasers.

    Equations: `network.hpp`.

    light: BUS where light passes the rings in an order and M_ij = taken_i sent_j [(R,) each], LOOPS elsewhere.
    own [shape (R,), 1/ns]: M_ii, light that a ring sends back to itself.
    sequence [shape (R,)]: the rings in the order in which light passes them.
    between [(R, R), 1/ns]: M_ij from ring j to i.
    delay [shape (D,), ns]
    late [shape (R, D)]: what comes into a ring from the end of a delay.
    seen_ring, seen_laser, seen_late [shapes (Q, R), (Q, L), (Q, D)]; the first D waves start the delays.
    corner [shape (Q,), 1/ns]: 2 pi times the bandwidth of the detector of a wave, 0 for none; None where all have none.
    energies: whether the energy of every wave since the start is kept.
    hair [ns]: by which the time of a front may be off by round-off. Of delayed light that has a front so near to an end
        of a step, the side that lies within the step is taken.
    """

    light: int
    own: NDArray[np.complex128]
    sequence: NDArray[np.int32]
    between: NDArray[np.complex128]
    taken: NDArray[np.complex128] | None
    sent: NDArray[np.complex128] | None
    delay: Array
    late: NDArray[np.complex128]
    seen_ring: NDArray[np.complex128]
    seen_laser: NDArray[np.complex128]
    seen_late: NDArray[np.complex128]
    corner: Array | None
    energies: bool
    hair: float


class Crossing(NamedTuple):
    """An event: a quantity (ENERGY, CARRIERS, RISE) of a ring rises through a level; ``stop`` ends the run there.

    above: whether the run begins at the level, and has to fall below it before it can rise through it.
    """

    quantity: int
    level: float
    stop: bool = True
    ring: int = 0
    above: bool = False


class Run(NamedTuple):
    """What `Problem.integrate` returns."""

    rows: Array
    """t, then fields, N and dT of every ring (then observed waves): at the wanted times or the accepted steps."""
    y: Array
    t: float
    step: float
    """The step it would take next, ns."""
    crossings: Array
    accepted: int
    rejected: int
    steps: Array
    """Lengths of the accepted steps, where they are kept."""


class Problem:
    """A ring or a circuit under its light, as the kernel takes it."""

    def __init__(
        self,
        rings: Rings,
        heat: PoleHeat | QuadraticHeat,
        drive: Drive,
        method: Method,
        network: Network | None = None,
    ) -> None:
        """Point to all arrays; those given are copied where their type or order differs."""
        self.heat, self.edges = heat, np.ascontiguousarray(drive.edges, dtype=float)
        self._kept: list[Any] = [self.edges]
        self._c, m = _Problem(), tableau(method)
        R, F = rings.modes.shape[:2]
        if F > 4:
            raise InputError(f"lasers are on {F} resonances; at most 4 are possible")
        if rings.dispersion.shape[1] > 8:
            raise InputError(f"fcd has {rings.dispersion.shape[1]} terms; at most 8 are possible")
        kernel = self._c
        kernel.rings, kernel.fields, kernel.terms = R, F, rings.dispersion.shape[1]
        kernel.method = _Method(len(m.a), m.order, m.gamma, *(self._at(x) for x in (m.a, m.c, m.dense, m.at, m.slope)))
        for name in ("modes", "carriers", "dispersion", "floor"):
            setattr(kernel, name, self._at(getattr(rings, name)))
        kernel.bend = self._at(np.full(R, rings.bend))
        quadratic = isinstance(heat, QuadraticHeat)
        kernel.heat, self.order = int(quadratic), len(heat.C) if isinstance(heat, QuadraticHeat) else heat.gain.shape[1]
        kernel.order = self.order
        for name, values in heat._asdict().items():
            setattr(kernel, name, self._at(values))
        kernel.lasers, kernel.pieces = drive.entry.shape[1], len(drive.edges) - 1
        kernel.edges, kernel.brightest = self.edges.ctypes.data, self._at(drive.brightest)
        for name in ("power", "phase", "detuning"):
            edges, table = getattr(drive, name)
            setattr(kernel, name, _Table(*table.shape, self._at(edges), self._at(table)))
        self._detunings = self._kept[-1]
        kernel.entry = self._at(drive.entry, complex)
        kernel.own = self._at(np.zeros(R) if network is None else network.own, complex)
        self.waves = self.energies = 0
        if network is not None:
            kernel.light, kernel.delays, kernel.hair = network.light, network.delay.size, network.hair
            self._oldest = float(network.delay.max(initial=0.0)) + network.hair  # ns, light that is still asked for
            kernel.waves, kernel.energies = len(network.seen_ring), int(network.energies)
            kernel.sequence = self._at(network.sequence, np.int32)
            kernel.delay, kernel.corner = self._at(network.delay), self._at(network.corner)
            for name in ("between", "taken", "sent", "late", "seen_ring", "seen_laser", "seen_late"):
                setattr(kernel, name, self._at(getattr(network, name), complex))
            gathered = int(network.energies) + int(network.corner is not None)
            self.waves = kernel.waves * (2 + gathered)
        self.rings, self.fields, self.block = R, F, 2 * F + 1
        self.size = R * (self.block + self.order)
        self.width = 1 + R * (self.block + 1) + self.waves
        self._memory: dict[str, Any] = {}

    def _at(self, values: Any, kind: Any = float) -> int | None:
        """Address of an array, which is kept."""
        if values is None:
            return None
        self._kept.append(np.ascontiguousarray(values, dtype=kind))
        return int(self._kept[-1].ctypes.data)

    def _call(self, name: str, *arguments: Any) -> int:
        """Call a function of `kernel.hpp`; the first time with no memory, when it returns how many bytes it needs."""
        function = getattr(library(), name)
        function.restype = _L
        if name not in self._memory:
            size = function(c.byref(self._c), *arguments, None)
            self._memory[name] = np.empty(size + 64, np.uint8)
        memory = self._memory[name].ctypes.data
        return int(function(c.byref(self._c), *arguments, _P(memory + -memory % 64)))

    def set_detuning(self, detuning: float) -> None:
        """Change the detuning in rad/ns of one ring under constant light."""
        self._detunings[0, 0, 0] = detuning

    @property
    def address(self) -> int:
        """Where the kernel finds it."""
        return c.addressof(self._c)

    def zero(self) -> Array:
        """A cold, empty state."""
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
        """Integrate from ``y`` through the whole drive, on whose edges steps end.

        times [ns]: wanted times; by default rows are the accepted steps, ``per_step`` rows each at equal distances.
        first_step, longest [ns]: the first step tried, 0 for a cautious one; bound of all.
        progress: called with the time reached in ns, some ten times a second.
        Raises InputError: too many steps or rows, or no step small enough.
        """
        y = np.array(y, dtype=float)
        wanted = 0 if times is None else len(times)
        at = None if times is None else np.ascontiguousarray(times, dtype=float)
        rows, steps = np.empty((wanted or 4096, self.width)), np.empty(4096 if keep_steps else 0)
        loop = _Loop(t=self.edges[0], h=first_step, rtol=rtol, longest=longest, seen=np.inf, per_step=per_step)
        if event is not None:
            loop.quantity, loop.level, loop.ring, loop.stop = event.quantity, event.level, event.ring, int(event.stop)
            loop.seen = 0.0 if event.above else np.inf
        past = np.empty((1024, 3 + 8 * self._c.delays))
        loop.past, loop.past_room = past.ctypes.data, len(past) if self._c.delays else 0
        crossings: list[float] = []
        budget, began, looks = 1000, time.perf_counter(), 10.0
        while True:
            loop.budget, loop.room = min(budget, MAX_STEPS + 1 - loop.accepted - loop.rejected), len(steps)
            status = self._call(
                "ring_integrate", c.byref(loop), _pointer(y), _pointer(rows), _L(len(rows)), _pointer(at), _L(wanted),
                _pointer(steps) if keep_steps else None,
            )  # fmt: skip
            if status == STEPS:
                elapsed, began = time.perf_counter() - began, time.perf_counter()
                budget = int(budget * min(max(RETURN / max(elapsed, 1e-6), 0.5), 8.0)) + 1
                if progress:
                    progress(loop.t)
                if loop.accepted + loop.rejected > MAX_STEPS:
                    raise InputError(
                        f"duration: the run takes more than {MAX_STEPS} steps at rtol = {rtol:g} (they reach "
                        f"{loop.t * 1e-9:g} s); shorten it or loosen rtol"
                    )
            elif status == FULL:
                if 2 * rows.size > MOST_NUMBERS:
                    raise InputError(f"times: the accepted steps up to {loop.t * 1e-9:g} s fill the memory; give times")
                if not wanted and loop.filled + per_step > len(rows):
                    rows = np.concatenate([rows, np.empty_like(rows)])
                if keep_steps and loop.accepted == len(steps):
                    steps = np.concatenate([steps, np.empty_like(steps)])
                if self._c.delays and loop.past_filled == loop.past_room:
                    needed = past[past[:, 0] + past[:, 1] > loop.t - self._oldest]
                    past = np.concatenate([needed, np.empty((1024 + len(needed), past.shape[1]))])
                    loop.past_filled = len(needed)
                    loop.past, loop.past_room = past.ctypes.data, len(past)
            elif status == RESTING:
                looks = self._look(y, loop, looks)
            elif status == TOO_SMALL:
                raise no_step(loop.t)
            elif status == EVENT:
                crossings.append(loop.crossing)
            if status == DONE or (status == EVENT and loop.stop):
                break
        if progress:
            progress(loop.t)
        return Run(
            rows[: loop.filled], y, loop.t, loop.h, np.array(crossings), loop.accepted, loop.rejected,
            steps[: loop.accepted],
        )  # fmt: skip

    def _look(self, y: Array, loop: Any, looks: float) -> float:
        """Where the state rests: bound the step by the fastest eigenvalue that grows there.

            step <= CAP/max |lambda|   over the eigenvalues of the Jacobian with Re(lambda) > 0

        A long step of an L-stable method damps what grows by the equations: it would stay on an unstable fixed point.
        Eigenvalues of a circuit cost as much as hundreds of steps: it begins with ten such looks, and gains one every
        4000 steps. ``looks`` are those left before; returns how many are left now.
        """
        if self.rings > 1:
            left = min(looks + (loop.accepted - max(loop.look_again - 20, 0)) / 4000, 10.0)
            if left < 1:
                loop.h = min(loop.h, max(4 * loop.looked, 1.0))
                return left
            looks = left - 1
        _, J = self.slopes(y, loop.piece, loop.t)
        parts = [np.arange(self.size)]
        if self.size > LARGEST_SPECTRUM and self.rings > 1:
            B, K, R = self.block, self.order, self.rings
            parts = [np.r_[i * B : (i + 1) * B, R * B + i * K : R * B + (i + 1) * K] for i in range(R)]
        found = np.concatenate([np.linalg.eigvals(J[np.ix_(part, part)]) for part in parts])
        growing = np.abs(found[found.real > 0])
        loop.cap = CAP / growing.max() if growing.size else np.inf
        loop.looked, loop.look_again, loop.h = loop.h, loop.accepted + 20, min(loop.h, loop.cap)
        return looks

    def follow(self, y: Array, steps: Array, V: Array) -> tuple[Array, Array]:
        """The same steps again under the constant light of the first piece: the end, and the derivative of the flow.

        y [shape (n,)], steps [shape (m,), ns] of a run with ``keep_steps``.
        V [shape (n, directions)]: directions at the start; ``np.eye(n)`` for the whole derivative, no columns for the
            end alone (steps that are kept make the end a smooth function of every parameter).
        Returns the state at the end and d(end)/d(y) V. One field only.
        """
        y, steps = np.ascontiguousarray(y, dtype=float), np.ascontiguousarray(steps, dtype=float)
        V, end = np.array(V, dtype=float, order="C"), np.empty(self.size)
        self._call(
            "ring_follow", _pointer(y), _pointer(steps), _L(len(steps)), _pointer(end), _pointer(V), _I(V.shape[1])
        )
        return end, V

    def slopes(self, y: Array, piece: int = 0, t: float | None = None) -> tuple[Array, Array]:
        """dy/dt and its derivative by y, shape (n, n), in a piece of the drive at a time in ns."""
        y, rate, J = np.ascontiguousarray(y, dtype=float), np.empty(self.size), np.empty((self.size, self.size))
        at = _D(self.edges[piece] if t is None else t)
        self._call("ring_slopes", _pointer(y), _I(piece), at, _pointer(rate), _pointer(J))
        return rate, J


def no_step(t: float) -> InputError:
    """The error of a run that ends at t in ns because no step is small enough."""
    return InputError(
        f"model or power: found no step small enough at t = {t * 1e-9:g} s: light and heat run away, or the rise is at "
        "the top of an output map; look at the model's largest numbers"
    )


def _pointer(values: NDArray[Any] | None) -> Any:
    return None if values is None else _P(values.ctypes.data)
