"""A chain of heat capacities whose conductances depend on temperature, and training data of it."""

from __future__ import annotations

import numpy as np

import thermofem as th

N, POWER = 4, 20e-3
NAMES = ("core", "near", "middle", "far")
TIMES = np.arange(8000) * 2e-9
WAVES = [th.Telegraph(POWER, 3e-7, 1.6e-5, seed=1), th.Telegraph(POWER / 2, 3e-7, 1.6e-5, seed=2)]


def chain() -> th.Quadratic:
    """Four heat capacities in a row to the ground; conductances grow by 5e-4 /K, the core's capacity too."""
    g, c = np.array([5e-4, 3e-4, 2e-4, 2e-4]), np.array([1e-11, 5e-11, 1e-10, 4e-10])
    K = np.diag(g + np.append(0, g[:-1])) - np.diag(g[:-1], 1) - np.diag(g[:-1], -1)
    A, H, G = -K / c[:, None], np.zeros((N, N, N)), np.zeros((N, N))
    for j in range(N):
        H[:, j, j] = 2.5e-4 * A[:, j]
    G[0, 0] = -5e-4 / c[0]
    return th.Quadratic(A, H, G, np.eye(N)[0] / c[0], np.eye(N)[0])


CHAIN = chain()


def dataset(wave, states=None):
    return th.dataset.build(TIMES, CHAIN.states(wave, TIMES) if states is None else states, wave, read=NAMES)


def known():
    return {
        "static": -np.linalg.solve(CHAIN.A, CHAIN.B),
        "power": POWER,
        "steady": CHAIN.steady_state(POWER),
    }
