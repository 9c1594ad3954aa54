"""Eigenvalues without LAPACK against LAPACK's."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from coupled.kernels import spectrum
from coupled.kernels.spectrum import LARGEST

eigenvalues = njit(spectrum.eigenvalues)

RANDOM = np.random.default_rng(7).normal(size=(LARGEST + 1, LARGEST + 1))


@pytest.mark.parametrize(
    "matrix",
    [
        np.array([[2.5]]),
        np.array([[0.0, 1.0], [-1.0, 0.0]]),
        np.roll(np.eye(6), 1, axis=0),  # unshifted iterations stand still on it
        np.diag([3.0, -1.0, 2.0, 2.0]) + np.eye(4, k=1),
        np.zeros((3, 3)),
        RANDOM[:17, :17],
        RANDOM[:17, :17] * np.geomspace(1e-3, 1e3, 17)[:, None],
        RANDOM,  # LAPACK's own
    ],
    ids=["one", "turning", "cycle", "double", "zero", "17 poles", "scaled", "large"],
)
@pytest.mark.slow
def test_eigenvalues_are_those_of_lapack(matrix):
    found, want = eigenvalues(matrix + 0j), np.linalg.eigvals(matrix)
    gaps = abs(found[:, None] - want)
    # each is an eigenvalue of a matrix that round-off moved; a double one moves by the root of that
    allowed = 1e-7 if matrix.shape[0] == 4 else 1e-12
    assert max(gaps.min(axis=0).max(), gaps.min(axis=1).max()) <= allowed * max(np.linalg.norm(matrix), 1.0)
    assert found.sum() == pytest.approx(np.trace(matrix), abs=1e-12 * max(np.linalg.norm(matrix), 1.0))


def test_a_state_that_is_not_finite_has_no_growing_mode():
    assert not np.any(eigenvalues(np.full((3, 3), np.nan) + 0j).real > 0)
