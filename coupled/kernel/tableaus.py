"""Coefficients of the Rosenbrock methods, read from tableaus.json, which names their sources."""

import json
from functools import cache
from importlib.resources import files
from typing import NamedTuple

import numpy as np

from thermofem.arrays import Array
from thermofem.checks import Words


class Method(Words):
    """Rosenbrock methods of the integration; both are L-stable, with error estimate and dense output."""

    RODAS4 = "rodas4"
    """Order 4, 6 stages, dense output of order 3; the default for rtol >= 1e-6, where it is the faster one."""
    RODAS5P = "rodas5p"
    """Order 5, 8 stages, dense output of order 4; keeps its order on stiff problems; the default for rtol < 1e-6."""


class Tableau(NamedTuple):
    """Coefficients of one Rosenbrock method.

    With dy/dt = f(t, y), J = df/dy, the step h and s stages k_1 .. k_s,

        (1/(gamma h) - J) k_i = f(t + at_i h, y + sum_j a_ij k_j) + sum_j (c_ij/h) k_j + slope_i h df/dt,     j < i
        y(t + h) = y + sum_j a_sj k_j + k_s,    error estimate k_s
        y(t + x h) = (1 - x) y(t) + x [y(t + h) + (1 - x) (d_1 + x (d_2 + x d_3))],    d_m = sum_j dense_mj k_j
    """

    order: int
    gamma: float
    a: Array
    c: Array
    dense: Array
    at: Array
    slope: Array


@cache
def tableau(method: Method) -> Tableau:
    """Return the coefficients of ``method``: a and c of shape (s, s), dense (3, s), at (s,) and slope (s,).

    With Gamma = (1/gamma - c)^-1, ``at`` is the row sums of a Gamma and ``slope`` those of Gamma (Hairer and Wanner,
    Section IV.7, Eq. 7.25).
    """
    table = json.loads(files(__package__).joinpath("tableaus.json").read_text())[method.value]
    a = np.array(table["a"])
    c = np.array(table["c"])
    dense = np.array(table["dense"])
    inverse = np.linalg.inv(np.eye(len(c)) / table["gamma"] - c)
    at = (a @ inverse).sum(axis=1)
    slope = inverse.sum(axis=1)
    return Tableau(table["order"], table["gamma"], a, c, dense, at, np.where(np.abs(slope) < 1e-9, 0.0, slope))
