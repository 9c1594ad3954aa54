"""Return map and periodic orbits of one ring under constant light on a Poincare section of constant N: `ReturnMap`.

Everything is in the kernel's units. `shooting.cpp` has the equations.
"""

import ctypes as c
from typing import NamedTuple

import numpy as np

from thermofem.arrays import Array, NDArray
from thermofem.checks import InputError

from . import library as structures
from .integrator import DONE, EVENT, FULL, TOO_SMALL, Problem, no_step
from .library import library
from .problem_parts import PoleHeat

ROOM, MOST_ROOM = 8192, 2_000_000  # rows of a trace; a second of work
MOST_SLOW = 8  # states of heat that Newton's method solves for
ROUGH, FINE = 1e-5, 3e-7  # rtol of traces
SURE = 50.0  # relative error of the period over that of a trace (`_growth`), above which the trace is made more precise
FINEST_SHARE = 0.03  # of FINE, the smallest tolerance then
OUTLASTS = 40.0  # time constants of a state of heat in a period, with which nothing is left of where it began


_P, _D = c.c_void_p, c.c_double


class Arc(NamedTuple):
    """End of an integration: state y, time T and next step in ns, and whether N rose through the level (``met``)."""

    y: Array
    T: float
    step: float
    met: bool


class PeriodicOrbit(NamedTuple):
    """A periodic orbit and its return map on the Poincare section N = N(start), which N crosses upwards.

        y(T) = start + M dx,     return time T + dT dx,     dx: deviation of the n slow thermal states at the start

    start [shape (m,)]: state on the section, with the indices ``slow`` [shape (n,)] of the slow thermal states.
    M, dT [shapes (m, n), (n,)]: derivatives of the returned state and of the return time in ns with respect to them.
    leading: multiplier of largest modulus, the trivial one excluded.
    pulses: upward crossings of the section in a period T.
    rows [shape (k, 5)]: t, Re a, Im a, N and dT (temperature) along the orbit.
    """

    start: Array
    T: float
    slow: NDArray[np.int32]
    M: Array
    dT: Array
    leading: complex
    pulses: int
    rows: Array

    @property
    def size(self) -> float:
        """Modulus of the largest multiplier: the factor by which a small deviation grows in a period."""
        return abs(self.leading)


class ReturnMap:
    """Traces, return map and periodic orbits of one ring under constant light."""

    def __init__(self, problem: Problem) -> None:
        """Allocate the work memory for ``problem``, whose drive must consist of one piece."""
        heat = problem.heat
        self.problem = problem
        self._fixed = np.empty((0, 4))
        self._rates = heat.rate[0] if isinstance(heat, PoleHeat) else np.zeros(problem.order)
        self._most_slow = min(MOST_SLOW, problem.order) if isinstance(heat, PoleHeat) else problem.order
        self._c = structures.ReturnMap(p=problem.address, edges=problem.edges.ctypes.data, n=self._most_slow)
        library().ring_close.restype = c.c_int64
        size = library().ring_close(c.byref(self._c), None, None, 1, 0, _D(), _D())
        self._memory = np.empty(size + 64, np.uint8)
        self._c.memory = self._memory.ctypes.data + -self._memory.ctypes.data % 64
        self._make_room(ROOM)

    def _make_room(self, room: int) -> None:
        if room > MOST_ROOM:
            raise InputError(f"a trace of {MOST_ROOM} steps does not end; the model's largest numbers may tell why")
        self._rows = np.empty((room, 5))
        self._steps = np.empty(room)
        self._c.rows = self._rows.ctypes.data
        self._c.steps = self._steps.ctypes.data
        self._c.room = room

    def set_fixed_points(self, fixed: Array) -> None:
        """Set the fixed points, shape (k, 4): rows U, N, dT, and the longest step in ns allowed near each."""
        self._fixed = np.ascontiguousarray(fixed)
        self._c.fixed = self._fixed.ctypes.data
        self._c.fixed_count = len(fixed)

    @property
    def rows(self) -> Array:
        """Rows of the last trace, shape (k, 5): t, Re a, Im a, N, dT; the next trace overwrites them."""
        return self._rows[: self._c.filled]

    def run(
        self, y: Array, duration: float, *, level: float = np.inf, above: bool = False, rtol: float = ROUGH,
        first_step: float = 0.0,
    ) -> Arc:  # fmt: skip
        """Integrate ``y`` for ``duration`` ns, or until N rises through ``level``; ``above``: N starts on the level."""
        end = np.append(y, 0.0)
        h = c.c_double(first_step)
        self._c.filled = self._c.count = 0
        status = library().ring_turn(
            c.byref(self._c), _P(end.ctypes.data), _D(duration), _D(level), int(above), _D(rtol), c.byref(h)
        )
        if status == FULL:
            self._make_room(2 * len(self._rows))
            return self.run(y, duration, level=level, above=above, rtol=rtol, first_step=first_step)
        if status == TOO_SMALL:
            raise no_step(end[-1])
        return Arc(end[:-1], float(end[-1]), h.value, status == EVENT)

    def close(self, y: Array, T: float, pulses: int = 1, beside: PeriodicOrbit | None = None) -> PeriodicOrbit | None:
        """Solve for the periodic orbit near ``y`` with a period of about ``T`` ns; None where there is none.

        The Poincare section is N = N(y), crossed upwards.
        pulses: upward crossings of the section in a period.
        beside: a neighbouring orbit, whose M and dT are the first estimates of those of this one.
        """
        slow = self._slow_states(T)
        neighbour = beside if beside is not None and np.array_equal(beside.slow, slow) else None
        orbit = self._close(y, T, pulses, slow, neighbour, ROUGH, FINE)
        if orbit is None or orbit.size >= 1:
            return orbit
        growth = self._growth(orbit)
        if growth <= SURE:
            return orbit
        return self.refined(orbit, FINE * max(SURE / growth, FINEST_SHARE))

    def _slow_states(self, T: float) -> NDArray[np.int32]:
        """Indices of the states of heat that last from one return to the next, T ns later."""
        lasting = int(np.clip((self._rates * T < OUTLASTS).sum(), 1, self._most_slow))
        by_rate = np.argsort(self._rates, kind="stable")
        return 3 + np.sort(by_rate[:lasting]).astype(np.int32)

    def refined(self, orbit: PeriodicOrbit, rtol: float) -> PeriodicOrbit | None:
        """Solve again for an orbit with the relative tolerance ``rtol``; None where this does not converge."""
        return self._close(orbit.start, orbit.T, orbit.pulses, orbit.slow, orbit, rtol, rtol)

    @staticmethod
    def _growth(orbit: PeriodicOrbit) -> float:
        """Return the relative error of the period per relative error of a trace, computed from dT (1 - M)^-1."""
        _, _, _, N, dT = orbit.rows.T
        A = np.eye(orbit.slow.size) - orbit.M[orbit.slow]
        by_heat = np.linalg.solve(A.T, orbit.dT)
        by_temperature = np.abs(by_heat).max() * np.abs(dT).max() / orbit.T
        section_range = max(np.ptp(N), 1e-300) / N.max()
        return float(by_temperature / section_range)

    def _close(
        self,
        y: Array,
        T: float,
        pulses: int,
        slow: NDArray[np.int32],
        neighbour: PeriodicOrbit | None,
        rough: float,
        fine: float,
    ) -> PeriodicOrbit | None:
        self._c.slow = slow.ctypes.data
        self._c.n = slow.size
        state = np.append(y, T)
        known = neighbour is not None
        M = np.vstack([neighbour.M, neighbour.dT]) if neighbour else np.empty((state.size, slow.size))
        status = library().ring_close(
            c.byref(self._c), _P(state.ctypes.data), _P(M.ctypes.data), pulses, int(known), _D(rough), _D(fine)
        )
        if status == FULL:
            self._make_room(2 * len(self._rows))
            return self._close(y, T, pulses, slow, neighbour, rough, fine)
        if status != DONE:
            return None
        multipliers = np.linalg.eigvals(M[slow])
        leading = complex(multipliers[np.abs(multipliers).argmax()])
        return PeriodicOrbit(state[:-1], float(state[-1]), slow, M[:-1], M[-1], leading, pulses, self.rows.copy())
