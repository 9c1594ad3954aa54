"""Trains of pulses: a random telegraph, a chirp, a stream of symbols."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from . import checks
from .arrays import Array, ArrayLike
from .piecewise import inside
from .waveforms import TIME_HINT, Steps, check_time


def _on_off(power: float, times: Array, duration: float) -> tuple[Array, Array]:
    """Steps of a power that is on at first, changes at ``times``, and is off from ``duration`` on."""
    edges = np.append(times, duration) if times.size % 2 == 0 else times
    on = np.arange(edges.size + 1) % 2 == 0
    return edges, power * on


@dataclass(frozen=True)
class Telegraph(Steps):
    """Random telegraph: on and off for exponentially distributed times; a drive that no training saw.

    Parameters
    ----------
    power : float, W
    dwell : float, s
        mean time between changes.
    duration : float, s
        off for good afterwards.
    seed : int
        the same seed gives the same waveform.
    """

    power: float
    dwell: float
    duration: float
    seed: int = 0

    def __post_init__(self) -> None:
        checks.power("power", self.power, zero=True)
        check_time("dwell", self.dwell)
        check_time("duration", self.duration, 1e6 * self.dwell)

    @property
    def words(self) -> str:
        """Text with the kind, the power and the times of the waveform."""
        return f"telegraph {self.power * 1e3:g} mW, {self.dwell * 1e6:.3g} us"

    @property
    def steps(self) -> tuple[Array, Array]:
        """Times of change in s and power in W before, between and after them."""
        draw = np.random.default_rng(self.seed)
        count = int(2 * self.duration / self.dwell) + 20
        times = np.cumsum(draw.exponential(self.dwell, count))
        return _on_off(self.power, times[times < self.duration], self.duration)


@dataclass(frozen=True)
class Chirp(Steps):
    """Square wave whose period goes from one value to another, each cycle by nearly the same factor.

    The frequency is f(t) = f_0 (f_1/f_0)^(t/duration), and the power is on while the fraction of the phase
    int f dt is below ``duty``.

    Parameters
    ----------
    power : float, W
    first, last : float, s
        period at the start and at the end; different.
    duration : float, s
        off for good afterwards.
    duty : float, 0 < duty < 1
    """

    power: float
    first: float
    last: float
    duration: float
    duty: float = 1 / 3

    def __post_init__(self) -> None:
        checks.power("power", self.power, zero=True)
        check_time("first", self.first)
        check_time("last", self.last)
        check_time("duration", self.duration, 1e6 * min(self.first, self.last))
        checks.between("duty", self.duty, 1e-3, 0.999, hint="the duty cycle is the fraction of the period that is on")
        checks.unique("first and last", (self.first, self.last), hint="a SquareWave has one period")

    @property
    def words(self) -> str:
        """Text with the kind, the power and the times of the waveform."""
        return f"chirp {self.power * 1e3:g} mW, {self.first * 1e6:.3g} to {self.last * 1e6:.3g} us"

    @property
    def steps(self) -> tuple[Array, Array]:
        """Times of change in s and power in W before, between and after them."""
        rate = np.log(self.first / self.last) / self.duration
        cycles = np.expm1(rate * self.duration) / (rate * self.first)
        starts = np.arange(np.ceil(cycles))
        changes = (starts[:, None] + [0.0, self.duty]).ravel()[1:]
        phase = changes[changes < cycles]
        times = np.log1p(phase * rate * self.first) / rate
        return _on_off(self.power, times, self.duration)


@dataclass(frozen=True, eq=False)
class Symbols(Steps):
    """A stream of symbols, each held for 1/rate; a mask divides every symbol into virtual nodes.

        P(t) = max(0, bias + power (u_k m_j + noise n_kj)),    symbol k, node j of the mask,    n normal

    Before the first symbol and after the last one P = bias.

    Parameters
    ----------
    values : array, shape (n,)
        symbols u_k, not negative; bits are 0 and 1.
    rate : float, Hz
        symbols a second.
    power, bias : float, W
        power of a symbol 1, and what is added to it.
    mask : array, shape (nodes,)
        factors m_j of the virtual nodes, not negative; one node without a mask.
    noise : float
        standard deviation, relative to ``power``, drawn anew for every node.
    seed : int
        the same seed gives the same noise.
    start : float, s
        of the first symbol.

    >>> Symbols([0, 1, 1], rate=1e9, power=1e-3)([0.5e-9, 1.5e-9]).tolist()
    [0.0, 0.001]
    """

    values: ArrayLike
    rate: float
    power: float
    bias: float = 0.0
    mask: ArrayLike = (1.0,)
    noise: float = 0.0
    seed: int = 0
    start: float = 0.0

    def __post_init__(self) -> None:
        for name in ("values", "mask"):
            numbers = checks.array(name, getattr(self, name))
            checks.between(name, numbers.min(), 0, np.inf, hint="use bias for either sign")
            object.__setattr__(self, name, numbers)
        checks.between("rate", self.rate, 1e-3, 1e14, unit="Hz", hint="1e9 is a symbol every nanosecond")
        checks.power("power", self.power, zero=True)
        checks.power("bias", self.bias, zero=True)
        checks.between("noise", self.noise, 0, 10, hint="it is relative to power")
        checks.between("start", self.start, 0, 1e3, unit="s", hint=TIME_HINT)

    @property
    def stop(self) -> float:
        """End of the last symbol in s."""
        return self.start + np.size(self.values) / self.rate

    @cached_property
    def steps(self) -> tuple[Array, Array]:
        """Start and ends of all n mask nodes in s, (n + 1,), and power in W before, in and after them, (n + 2,)."""
        count = np.size(self.mask)
        nodes = np.outer(np.asarray(self.values), np.asarray(self.mask)).ravel()
        edges = self.start + np.arange(nodes.size + 1) / (self.rate * count)
        if self.noise:
            draw = np.random.default_rng(self.seed)
            nodes = nodes + self.noise * draw.normal(size=nodes.size)
        power = np.maximum(self.bias + self.power * nodes, 0.0)
        return edges, np.concatenate([[self.bias], power, [self.bias]])

    def samples(self, per_node: int = 1) -> Array:
        """Sample times in s at the ends of ``per_node`` equal parts of every mask node, one after the other."""
        a_symbol = np.size(self.mask) * per_node
        count = np.size(self.values) * a_symbol
        return self.start + np.arange(1, count + 1) / (self.rate * a_symbol)

    def breakpoints(self, start: float, stop: float) -> Array:
        """Ends of mask nodes in s inside (start, stop), where the power changes."""
        edges, levels = self.steps
        changes = levels[1:] != levels[:-1]
        return inside(edges[changes], start, stop)
