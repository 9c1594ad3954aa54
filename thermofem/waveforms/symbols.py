"""A stream of symbols: bits or values at a rate, with a mask of virtual nodes and noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..data.display import shown
from .contract import TIME_HINT, Array, inside, stored
from .steps import Steps

MOST = 20_000_000  # symbols times nodes


@stored
@shown
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
    power : float, W
        of a symbol 1.
    bias : float, W
    mask : array, shape (nodes,)
        factors m_j of the virtual nodes, not negative; one node without a mask.
    noise : float
        standard deviation, relative to ``power``, drawn anew for every node.
    seed : int
        the same seed gives the same noise.
    start : float, s
        of the first symbol.

    Raises
    ------
    InputError
        values or mask that are negative, or numbers out of range.

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
        checks.plain(self)
        values, mask = checks.array("values", self.values), checks.array("mask", self.mask)
        for name, numbers in (("values", values), ("mask", mask)):
            if numbers.min() < 0:
                at = int(numbers.argmin())
                raise checks.InputError(
                    f"{name}[{at}] = {numbers[at]:g} is negative; use bias for symbols of either sign"
                )
        if values.size * mask.size > MOST:
            raise checks.InputError(
                f"values and mask make {values.size * mask.size} nodes; at most {MOST:g} fit into memory"
            )
        checks.between("rate", self.rate, 1e-3, 1e14, unit="Hz", hint="1e9 is a symbol every nanosecond")
        checks.power("power", self.power, zero=True)
        checks.power("bias", self.bias, zero=True)
        checks.between("noise", self.noise, 0, 10, hint="it is relative to power")
        checks.between("start", self.start, 0, 1e3, unit="s", hint=TIME_HINT)
        checks.seed(self.seed)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "mask", mask)

    @property
    def stop(self) -> float:
        """End of the last symbol in s."""
        return self.start + np.size(self.values) / self.rate

    @cached_property
    def edges(self) -> Array:  # type: ignore[override]
        """Ends of all nodes in s, shape (n nodes + 1,)."""
        nodes = np.size(self.mask)
        return self.start + np.arange(np.size(self.values) * nodes + 1) / (self.rate * nodes)

    @cached_property
    def levels(self) -> Array:  # type: ignore[override]
        """Power of every node in W, the bias before and after them."""
        nodes = np.outer(np.asarray(self.values), np.asarray(self.mask)).ravel()
        if self.noise:
            nodes = nodes + self.noise * np.random.default_rng(self.seed).normal(size=nodes.size)
        return np.concatenate([[self.bias], np.maximum(self.bias + self.power * nodes, 0.0), [self.bias]])

    def samples(self, per_node: int = 1) -> Array:
        """Times in s at the ends of equal parts of every node: where a readout samples, shape (n nodes per_node,)."""
        per_node = checks.integer("per_node", per_node, 1, 1_000_000)
        return self.start + np.arange(1, (self.edges.size - 1) * per_node + 1) / (
            self.rate * np.size(self.mask) * per_node
        )

    def breakpoints(self, start: float, stop: float) -> Array:
        """Ends of nodes inside, where the power changes."""
        return inside(self.edges[self.levels[1:] != self.levels[:-1]], start, stop)

    @classmethod
    def example(cls) -> Symbols:
        """A short stream for the tests of every model."""
        return cls([0.2, 1.0, 0.0, 0.7], rate=1e6, power=2e-3, bias=1e-4, mask=(0.5, 1.0), noise=0.05, seed=1)
