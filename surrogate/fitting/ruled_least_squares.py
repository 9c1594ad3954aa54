"""Least squares under linear rules, min |X c - y| with rules c = 0, as an estimator that pysindy takes."""

import numpy as np
from scipy.linalg import null_space
from sklearn.base import BaseEstimator, RegressorMixin

from thermofem.arrays import Array


class RuledLeastSquares(RegressorMixin, BaseEstimator):
    """Coefficients c [shape (n,)] of one equation; ``rules`` [shape (rules, n)] times c is zero."""

    def __init__(self, rules: Array) -> None:
        self.rules = rules

    def fit(self, X: Array, y: Array) -> "RuledLeastSquares":
        """Solve in a basis of the null space of the rules; X [shape (m, n)], y [shape (m,)]."""
        basis = null_space(self.rules)
        shares, *_ = np.linalg.lstsq(X @ basis, y, rcond=None)
        self.coef_ = basis @ shares
        return self

    def predict(self, X: Array) -> Array:
        """X c, shape (m,)."""
        return X @ self.coef_
