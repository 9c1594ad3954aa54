"""Residuals of the samples of a slow sweep: distances from the curve of all fixed points, after the best baseline.

At fixed power all fixed points lie on one smooth curve (detuning, output), the tilted resonance, which includes its two
folds; at fixed detuning likewise. A slow sweep follows this curve and jumps at a fold. The residual of a sample (x, y)
is its signed distance from the nearest point (x(s), y(s)) of the curve,

    r = +-min_s hypot((x - x(s))/s_x, (y - y(s) - sum_k a_k B_k(s))/s_y),

with s_x half a step of the sweep, s_y the noise, and B_k the terms of the baseline (`slow_sweeps`). No branch has to be
assigned to a sample, the direction of the sweep does not matter, and the residuals at a jump depend continuously on
where the fold lies. The coefficients a_k are linear unknowns of each sweep, with a deviation of 1 assumed:

    a = argmin_a  sum_i w_i r_i(a)^2 + |a|^2,       dr_i/da_k = -n_y B_k/s_y

by Gauss and Newton, n_y the component of the curve's normal along y: variable projection, after Golub and Pereyra, SIAM
J. Numer. Anal. 10, 413 (1973).
"""

from typing import NamedTuple

import numpy as np

from thermofem.arrays import Array

from .slow_sweeps import Sweep

PASSES = 8  # of Gauss and Newton for a baseline, at most
SETTLED = 1e-4  # change of a coefficient in its assumed deviations, below which they end


class Nearest(NamedTuple):
    """Nearest points of a curve for the samples of a sweep.

    distance [shape (n,)]: signed, in units of s_x and s_y.
    slope [shape (terms, n)]: derivative of the distance with respect to the coefficients of the baseline.
    """

    distance: Array
    slope: Array


def nearest_points(sweep: Sweep, x: Array, y: Array, terms: Array) -> Nearest:
    """Nearest points of the polyline (x, y), whose points have the ``terms`` of a baseline, for all samples."""
    X = x / sweep.step
    Y = y / sweep.noise
    along_x = np.diff(X)[:, None]
    along_y = np.diff(Y)[:, None]
    length = np.sqrt(np.maximum(along_x**2 + along_y**2, 1e-300))
    to_x = sweep.x / sweep.step - X[:-1, None]
    to_y = sweep.y / sweep.noise - Y[:-1, None]
    share = np.clip((to_x * along_x + to_y * along_y) / length**2, 0, 1)
    off_x = to_x - share * along_x
    off_y = to_y - share * along_y
    square = off_x**2 + off_y**2
    segment = square.argmin(axis=0)
    here = segment, np.arange(sweep.x.size)
    normal = along_x[segment, 0] / length[segment, 0]
    side = along_x[segment, 0] * off_y[here] - along_y[segment, 0] * off_x[here]
    distance = np.sqrt(square[here]) * np.where(side < 0, -1.0, 1.0)
    part = share[here]
    values = terms[:, segment] * (1 - part) + terms[:, segment + 1] * part
    return Nearest(distance, -normal * values / sweep.noise)


def sweep_residuals(sweep: Sweep, x: Array, output: Array, *, robust: bool = False) -> tuple[Array, Array]:
    """Residuals of a sweep from the curve (x, output), shape (samples,), and the coefficients of its baseline.

    robust: weights 1/sqrt(1 + r^2), those of the soft L1 loss, as samples beyond a fold are far away at first.
    """
    terms = sweep.baseline_terms(x, output)
    a = np.zeros(len(terms))
    near = nearest_points(sweep, x, output, terms)
    for _ in range(PASSES if a.size else 0):
        weight = 1 / np.sqrt(1 + near.distance**2) if robust else np.ones(sweep.x.size)
        weighted = near.slope * weight
        normal_matrix = weighted @ near.slope.T + np.eye(a.size)
        change = np.linalg.solve(normal_matrix, -weighted @ near.distance - a)
        a = a + change
        near = nearest_points(sweep, x, output + a @ terms, terms)
        if np.abs(change).max() < SETTLED:
            break
    return near.distance, a
