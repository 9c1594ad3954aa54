"""Windowed waveform relaxation: a small model predicts, a `Corrector` corrects, the difference is fed back.

In a window the temperature of the ring is dT = dT_predictor + delta(t). Pass k integrates light and carriers with
delta_k, gives the absorbed power to the corrector, and compares the two temperatures:

    delta_{k+1}(t) = delta_k(t) + [dT_corrector(t) - dT_k(t)]

until the bracket is below the largest discrepancy allowed, everywhere. The iteration converges faster with a better
predictor and with a shorter window. Windows are halved when it converges slowly and doubled when a few passes suffice.

Source: E. Lelarasmee, A. E. Ruehli, A. L. Sangiovanni-Vincentelli, IEEE Trans. CAD 1, 131 (1982) (waveform relaxation).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from time import process_time
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from thermofem import InputError, checks
from thermofem.arrays import Array
from thermofem.waveforms import PiecewiseCubic, Waveform

from ..resonator import RingResonator
from ..runs.window import Window, advance
from ..states import State
from ..thermal import Compact
from .corrector import FEM, Corrector

MOST_PASSES = 16
FEW, MANY = 4, 8  # passes up to which windows double, and above which they halve: least work (measured)
KNOTS = 0.02  # share of the largest discrepancy that thinning the discrepancy may cost


class Passed(NamedTuple):
    """Result of one accepted window."""

    run: Window
    delta_T: Array
    """Temperature rise from the corrector, K, at the times of ``run``."""
    passes: int
    discrepancy: float
    """Largest difference between the temperature used for the light and the corrector's, K."""
    moved: float
    """Largest change of the temperature that one more pass would cause, K; estimated with the predictor."""
    rest: float
    """The corrector's temperature minus the predictor's at the end, K."""


@dataclass
class Relaxation:
    """The state of a running co-simulation.

    Attributes
    ----------
    ring, model, corrector
    power, detuning : as `window.advance` takes them
    duration : float, s
    level : int
        windows are ``duration``/2^``level`` long.
    max_discrepancy : float, K
        largest difference accepted between the temperature used for the light and the corrector's.
    rtol : float
    state : coupled State
        of light, carriers and predictor at the accepted time.
    background : callable
        known part of the discrepancy, the rise by heaters: K as a function of an array of times in s.
    """

    ring: RingResonator
    model: Compact
    corrector: Corrector
    power: Any
    detuning: Any
    duration: float
    level: int
    max_discrepancy: float
    rtol: float
    state: State
    background: Callable[[Array], Array] | None = None
    index: int = 0
    accepted: float = 0.0  # the corrector's temperature at the accepted time, K
    rest: float = 0.0  # discrepancy at the accepted time, less the background
    first_step: float = 0.0
    passes: int = 0
    abandoned: int = 0
    seconds: dict[str, float] = field(default_factory=lambda: {"optics": 0.0, "corrector": 0.0})

    @property
    def time(self) -> float:
        """Accepted time, where the next window starts, s."""
        return self.duration * self.index / 2**self.level

    def advance(self) -> Passed:
        """Advance by one window, halved until its relaxation converges."""
        while True:
            start = self.time
            stop = self.duration * (self.index + 1) / 2**self.level
            found, reason = self._window(start, stop)
            if found is not None:
                self._accept(found)
                return found
            self.abandoned += 1
            # a window below 1 ps is given up
            if (stop - start) / 2 < 1e-12:
                raise InputError(
                    f"the co-simulation stops at t = {start:g} s: {reason} even in a window of {stop - start:g} s; "
                    "does the corrector return the same result for the same power?"
                )
            self.index = 2 * self.index
            self.level = self.level + 1

    def _window(self, start: float, stop: float) -> tuple[Passed | None, str]:
        """Iterate one window from ``start`` to ``stop`` in s; return None and the reason if it does not converge."""
        offset: Any = self._guess(start, stop)
        run = self._light(start, stop, offset)
        last = np.inf
        for passes in range(1, MOST_PASSES + 1):
            rise = self._asked(self.corrector.advance, run)
            self.passes += 1
            checks.shape("the answer of corrector.advance", rise, run.time.shape)
            self._check_start(start, float(rise[0]))
            change = float(np.abs(rise - run.delta_T).max())
            if not np.isfinite(change):
                return None, f"the corrector's temperature is not finite (pass {passes})"
            # no solid is at 1e5 K
            if np.abs(rise).max() > 1e5:
                return (
                    None,
                    f"the corrector says {rise[np.abs(rise).argmax()]:.3g} K (a rise in K is needed; pass {passes})",
                )
            late = change > self.max_discrepancy and passes > 1
            if late and not _hopeful(change, last, self.max_discrepancy, MOST_PASSES - passes):
                return None, f"the discrepancy goes from {last:.2g} to {change:.2g} K in pass {passes}"
            last = change
            found, offset, run = self._settled(run, rise, passes, offset, (start, stop))
            if found is not None:
                return found, ""
        return None, f"{MOST_PASSES} passes leave {last:.2g} K"

    def _settled(
        self, run: Window, rise: Array, passes: int, offset: Any, span: tuple[float, float]
    ) -> tuple[Passed | None, Any, Window]:
        """Feed the discrepancy of a pass back into the light, and test whether the window has converged.

        A discrepancy shifts the pulses, whose steep edges amplify it up to a hundredfold. So the light is integrated
        again with the discrepancy included. The FEM's temperature under the changed power follows without another pass
        (`FEM.revise`), except for the part of the rise outside the Krylov basis (`FEM.remainder`). Returns the accepted
        window, or None if another pass is needed; then offset (K) and light of that next pass.
        """
        revise = getattr(self.corrector, "revise", None)
        moved = np.inf
        # later windows magnify a change of the FEM's temperature that is left, so only 5 % are allowed
        close = 0.05 * self.max_discrepancy if revise else self.max_discrepancy
        if isinstance(self.corrector, FEM) and self.model is self.corrector.predictor:
            missed = self.corrector.remainder
        else:
            missed = float(np.abs(rise - run.delta_T).max())
        missed /= max(float(np.abs(rise).max()), 1e-300)
        while True:
            discrepancy = float(np.abs(rise - run.delta_T).max())
            after = self._fed_back(run, offset, rise - run.delta_T)
            again = self._light(*span, after)
            last = moved
            moved = float(np.abs(CubicSpline(run.time, rise)(again.time) - again.delta_T).max())
            enough = moved <= close or not moved < last / 2
            if discrepancy <= self.max_discrepancy and (enough or revise is None):
                last_offset = float(offset(span[1])) if callable(offset) else float(offset)
                remaining = last_offset + float(rise[-1] - run.delta_T[-1])
                return Passed(run, rise, passes, discrepancy, moved, remaining), after, again
            if revise is None or enough or missed * moved > KNOTS * self.max_discrepancy:
                return None, after, again
            run = again
            offset = after
            rise = self._asked(revise, run)

    def _light(self, start: float, stop: float, offset: Any) -> Window:
        """Integrate light, carriers and predictor over one window with the discrepancy ``offset`` in K."""
        clock = process_time()
        run = advance(
            self.ring, self.model, self.state, start, stop, power=self.power, detuning=self.detuning,
            offset=offset, rtol=self.rtol, first_step=self.first_step, slopes=True,
        )  # fmt: skip
        self.seconds["optics"] += process_time() - clock
        return run

    def _asked(self, way: Callable[[Array, Waveform], Any], run: Window) -> Array:
        """Return the corrector's rise in K at the times of ``run`` under its absorbed power, by the method ``way``."""
        clock = process_time()
        power = PiecewiseCubic.of_spline(CubicHermiteSpline(run.time, run.absorbed, run.absorbed_slope))
        rise = np.array(way(run.time.copy(), power), dtype=float)
        self.seconds["corrector"] += process_time() - clock
        return rise

    def _check_start(self, start: float, first: float) -> None:
        """Raise InputError if the corrector's first value is more than 10 max_discrepancy off its last accepted one."""
        if not abs(first - self.accepted) > 10.0 * self.max_discrepancy:  # nan has its own error
            return
        raise InputError(
            f"corrector.advance returned {first:.6g} K at t = {start:g} s, where the accepted state has "
            f"{self.accepted:.6g} K",
            "it must return the rise over ambient, 0 K at first, and start from what accept() kept last",
        )

    def _guess(self, start: float, stop: float) -> Any:
        """Return the first discrepancy of a window in K: a constant, plus the rise by heaters as a spline."""
        if self.background is None:
            return self.rest
        times = np.linspace(start, stop, 33)
        return _spline(times, self.background(times) + self.rest, KNOTS * self.max_discrepancy)

    def _fed_back(self, run: Window, offset: Any, change: Array) -> Any:
        """Return the discrepancy after a pass in K, ``offset`` plus ``change`` at the times of ``run``, as a spline."""
        old = offset(run.time) if callable(offset) else offset
        return _spline(run.time, old + change, KNOTS * self.max_discrepancy)

    def _accept(self, found: Passed) -> None:
        self.corrector.accept()
        self.state = found.run.final
        self.first_step = found.run.step
        self.index += 1
        self.rest = found.rest
        self.accepted = float(found.delta_T[-1])
        if self.background is not None:
            self.rest -= float(self.background(np.array([self.time]))[0])
        if found.passes > MANY:
            self.index = 2 * self.index
            self.level = self.level + 1
        # of more than 1000 steps of the light a window does not double
        elif found.passes <= FEW and found.run.time.size <= 1000 and self.index % 2 == 0 and self.level > 0:
            self.index = self.index // 2
            self.level = self.level - 1


def _hopeful(change: float, last: float, tolerance: float, left: int) -> bool:
    """Whether ``left`` passes reach the tolerance if each reduces the discrepancy by the factor change/last."""
    return change < last and np.log(tolerance / change) / np.log(change / last) <= left


def _spline(times: Array, values: Array, allowed: float) -> Any:
    """Return a cubic Hermite spline through some of the samples, with an error below ``allowed`` at all others."""
    slope = np.gradient(values, times, edge_order=2 if times.size > 2 else 1)
    knots = np.array([0, times.size - 1])
    while True:
        spline = CubicHermiteSpline(times[knots], values[knots], slope[knots])
        missed = np.flatnonzero(np.abs(spline(times) - values) > allowed)
        if not missed.size:
            return spline
        last = np.unique(np.searchsorted(knots, missed))  # ends of the pieces with those samples, which are halved
        knots = np.union1d(knots, (knots[last - 1] + knots[last]) // 2)
