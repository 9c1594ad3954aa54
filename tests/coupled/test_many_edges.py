"""A heater with very many edges: the cubics of its rise, against the closed form of a periodic square wave."""

import time

import numpy as np
import pytest

from coupled.heaters import rises
from coupled.inputs import Pieces

TAU = 1e-6  # s
PERIOD = 1e-8  # s
POWER = 1e-3  # W
RESISTANCE = 2e3  # K/W


def square(cycles):
    edges = np.arange(2 * cycles + 1) * PERIOD / 2
    coefficients = np.zeros((2 * cycles, 4))
    coefficients[::2, 0] = POWER
    return Pieces(edges, coefficients)


def test_the_rise_is_that_of_a_square_wave():
    """After many time constants it swings by R P tanh(T/4 tau)/2 on both sides of R P/2."""
    (rise,) = rises(np.array([1 / TAU]), np.array([[RESISTANCE / TAU]]), square(2000), 1e-6)
    ends = rise(np.array([1998.5, 1999.0]) * PERIOD)
    half = RESISTANCE * POWER / 2
    swing = half * np.tanh(PERIOD / (4 * TAU))
    # 1e-8 of the largest rise, or of 0.1 K, is the tolerance of the cubics; exp(-20) of the start is left
    assert ends == pytest.approx([half + swing, half - swing], abs=1e-7)


@pytest.mark.slow
def test_two_million_edges_take_seconds():
    """Pieces are prepared as arrays; a loop over them takes more than a minute."""
    begin = time.process_time()
    rises(np.array([1 / TAU, 10 / TAU]), np.array([[1e9, 1e9]]), square(1_000_000), 1e-6)
    assert time.process_time() - begin < 30
