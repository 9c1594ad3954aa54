"""Zeros in brackets."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from coupled.equilibria.roots import HALVINGS, crossings, roots

FUNCTIONS = (
    lambda t: t - 0.3,
    lambda t: 0.7 - t,
    lambda t: (t - 0.6) ** 3,
    lambda t: np.exp(20 * t) - 2,
    lambda t: np.cos(t) - t,
    lambda t: np.where(t < 0.125, -1e-9, 1.0),  # a jump, where a straight line finds nothing
)


def test_zeros_are_those_of_brent_and_no_function_needs_more_steps_than_bisection_and_one():
    calls = []

    def f(t, which):
        calls.append(len(which))
        return np.array([FUNCTIONS[k](one) for one, k in zip(t, which, strict=True)], dtype=float)

    found = roots(f, len(FUNCTIONS))
    exact = [brentq(function, 0, 1, xtol=1e-16, rtol=1e-15, maxiter=1000) for function in FUNCTIONS]
    # The bracket is 2^-48 wide at the end; near the zero of third order f is lost in the round-off of t - 0.6.
    assert found == pytest.approx(exact, abs=2.0 ** (1 - HALVINGS))
    assert len(calls) <= HALVINGS + 3  # the two ends, and one step more than bisection


def test_a_smooth_function_needs_a_quarter_of_the_steps_of_bisection():
    calls = []

    def f(t, which):
        calls.append(len(which))
        return t**2 - np.linspace(0.1, 0.9, 50)[which]

    assert roots(f, 50) == pytest.approx(np.sqrt(np.linspace(0.1, 0.9, 50)), abs=2.0 ** (1 - HALVINGS))
    assert len(calls) <= 2 + HALVINGS // 4


@pytest.mark.parametrize("gap", [1.0, 1e-2, 1e-6])
def test_pairs_of_zeros_between_two_points_of_a_grid_are_found(gap):
    zeros = np.array([0.123, 0.123 + gap, 3.3])
    found = crossings(lambda x: np.prod(x[..., None] - zeros, axis=-1), np.linspace(0, 5, 11))
    # 2^-48 of a step of the grid, and the round-off of x - 0.123 beside a slope of the gap
    assert found == pytest.approx(np.sort(zeros), abs=1e-14)
