"""A corrector in closed form, and what the tests of the co-simulation share."""

from __future__ import annotations

import numpy as np

import coupled
import thermofem as th
from thermofem.algebra.pole_responses import pole_responses

RING = coupled.borghi2021()
MW = 6.31e-3  # 8 dBm
NETWORK = th.Foster(R=[1998.1, 5786.2], tau=[55.8e-9, 1.2e-6])


def traces_apart(run, other):
    """Largest difference of delta_T in units of its largest value, on the times of ``run``."""
    times, values = run.time.values, run.delta_T.values
    return np.abs(np.interp(times, other.time, other.delta_T) - values).max() / values.max()


class Exact:
    """A Foster network in closed form behind the contract, as anybody would write a corrector."""

    def __repr__(self):
        return "Exact()"  # in the name of a test: the same in every process

    def __init__(self, network):
        self.rate, self.gain = 1 / network.tau, network.R / network.tau
        self.state, self.tried, self.accepted, self.said = np.zeros(network.order), None, 0, []

    def advance(self, times, power):
        fine = np.unique(
            np.concatenate([times, power.breakpoints(times[0], times[-1]), np.linspace(times[0], times[-1], 500)])
        )
        wave = th.Sampled(fine - fine[0], np.maximum(power(fine), 0))
        poles = pole_responses(self.rate, wave, np.minimum(times - times[0], fine[-1] - fine[0]))
        states = poles * self.gain + np.exp(-self.rate * (times - times[0])[:, None]) * self.state
        self.tried, self.last = states[-1], states.sum(axis=1)
        return self.last

    def accept(self):
        self.state, self.accepted = self.tried, self.accepted + 1
        self.said.append(self.last)
