"""What the caller keeps: no object changes with an array that was given, and matrices are those of heat flow."""

from __future__ import annotations

import numpy as np
import pytest

import thermofem as th

E, K = np.diag([1e-11, 2e-10]), np.array([[3e-4, -1e-4], [-1e-4, 2e-4]])
B = np.array([[1.0], [0.0]])


@pytest.mark.parametrize("name", ["Sampled", "PiecewiseCubic", "Cauer", "StateSpace", "Quadratic"])
def test_what_is_kept_shares_no_memory_with_what_was_given(name):
    """Sampled, PiecewiseCubic, Cauer and StateSpace kept the array itself, and changed with it."""
    one = np.ones(1)
    given = {
        "Sampled": (th.Sampled, np.array([0.0, 1e-6]), np.array([0.0, 1e-3])),
        "PiecewiseCubic": (th.waveforms.PiecewiseCubic, np.array([0.0, 1e-6]), np.zeros((1, 4)) + 1e-3),
        "Cauer": (th.models.cauer.Cauer, np.ones(2), np.ones(2) * 1e-9),
        "StateSpace": (th.StateSpace, E.copy(), -K, B.copy(), B.T.copy()),
        "Quadratic": (th.Quadratic, -np.eye(1), np.zeros((1, 1, 1)), np.zeros((1, 1)), one, one.copy()),
    }[name]
    kept = [value for value in vars(given[0](*given[1:])).values() if isinstance(value, np.ndarray)]
    assert kept
    assert not any(np.shares_memory(a, b) for a in kept for b in given[1:])


@pytest.mark.parametrize(
    ("E", "A", "B", "words"),
    [
        (E, -K + np.array([[0, 5e-5], [0, 0]]), B, "A is not symmetric"),  # was 5333 K/W; -C A^-1 B is 4444 K/W
        (E, K, B, "-A is not positive definite"),  # was -4000 K/W, and grew without end
        (np.diag([1e-11, 0.0]), -K, B, "E is not positive definite"),
        (E, np.array([[-1e-4, 1e-4], [1e-4, -1e-4]]), B, "singular"),
        # the imaginary part was dropped
        (np.array([[1, np.nan], [np.nan, 1]]), -K, B, "E = nan is not finite"),
        (E, -K, np.array([[np.inf], [-np.inf]]), "B = inf"),
    ],
)
@pytest.mark.parametrize(
    "use",
    [
        lambda system: system.thermal_resistance,
        lambda system: system.periodic_response(th.SquareWave(1e-3, 1e-6, 0.3), 5),
    ],
    ids=["gain", "periodic"],
)
def test_matrices_that_are_not_those_of_heat_flow_are_refused(E, A, B, words, use):
    with pytest.raises(th.InputError, match=words):
        use(th.StateSpace(E, A, B, B.T))


def test_a_stiff_system_in_mixed_coordinates_is_still_one_of_heat_flow():
    """Twelve decades of time constants: the check of definiteness allows for round-off."""
    tau, mix = np.geomspace(1e-12, 1.0, 6), np.random.default_rng(1).normal(size=(6, 6))
    system = th.StateSpace(mix.T @ np.diag(tau) @ mix, -mix.T @ mix, mix.T @ np.ones((6, 1)), np.ones((1, 6)) @ mix)
    assert system.thermal_resistance == pytest.approx(6.0, rel=1e-9)
    assert system.step_response(100.0) == pytest.approx(6.0, rel=1e-5)
