"""Temperature dependence of a material property: dimensionless laws f(T), which multiply the property's value.

Each law is 1 where the value holds. Besides f a law gives its integral from one temperature to another: the Kirchhoff
variable of a conductivity, the enthalpy of a specific heat.
"""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.polynomial.polynomial import polyval
from scipy.interpolate import PchipInterpolator, PPoly

from .. import checks
from ..arrays import Array, ArrayLike

COLDEST, HOTTEST = 1.0, 1e4  # K; no law is asked beyond


class Law(Protocol):
    """Interface of a temperature law; T in K."""

    def factor(self, T: ArrayLike) -> Array:
        """f(T)."""

    def integral(self, start: float, rise: ArrayLike) -> Array:
        """Integral of f from ``start`` to ``start + rise``, in K."""


@dataclass(frozen=True)
class PowerLaw:
    """f(T) = (T/reference)^exponent; the exponent 0 is a constant property.

    >>> round(float(PowerLaw(-1.3).factor(400.0)), 3)
    0.688
    """

    exponent: float = 0.0
    reference: float = 300.0

    def __post_init__(self) -> None:
        checks.plain(self)
        checks.between("exponent", self.exponent, -5, 5, hint="f(T) = (T/reference)^exponent")
        checks.between("reference", self.reference, 1, 3000, unit="K")

    def factor(self, T: ArrayLike) -> Array:
        """f(T)."""
        return np.asarray((np.maximum(_kelvins("T", T), COLDEST) / self.reference) ** self.exponent)

    def integral(self, start: float, rise: ArrayLike) -> Array:
        """start f(start) ((1 + rise/start)^(n + 1) - 1)/(n + 1), which does not cancel at a small rise.

        f is constant below 1 K.
        """
        start, rise = _start(start), _kelvins("rise", rise)
        above = np.maximum(rise, COLDEST - start)
        log = np.log1p(above / start)
        n, scale = self.exponent + 1, (start / self.reference) ** self.exponent * start
        below = (rise - above) * (COLDEST / self.reference) ** self.exponent
        return np.asarray((scale / n * np.expm1(n * log) if n else scale * log) + below)


@dataclass(frozen=True)
class Polynomial:
    """f(T) = 1 + a_1 (T - reference) + a_2 (T - reference)^2 + ...

    Parameters
    ----------
    coefficients : tuple of float; 1/K, 1/K^2, ...
        at most 20.
    reference : float, K
    """

    coefficients: tuple[float, ...]
    reference: float = 300.0

    def __post_init__(self) -> None:
        checks.plain(self)
        hint = "a table of temperature and values takes more"
        coefficients = checks.array("polynomial", self.coefficients, hint=hint)
        checks.between(
            # 10.0: 1/K, 1/K^2, ...: of a coefficient; T^3 about 1 K has 3, and far more keeps steps from converging
            "polynomial: largest coefficient",
            np.abs(coefficients).max(),
            0,
            10.0,
            unit="1/K, 1/K^2, ...",
        )
        object.__setattr__(self, "coefficients", tuple(map(float, coefficients)))
        checks.between("reference", self.reference, 1, 3000, unit="K")

    def factor(self, T: ArrayLike) -> Array:
        """f(T)."""
        return _polynomial(_kelvins("T", T) - self.reference, (1.0, *self.coefficients))

    def integral(self, start: float, rise: ArrayLike) -> Array:
        """Closed form, expanded about ``start`` so that nothing cancels at a small rise."""
        return _polynomial(_kelvins("rise", rise), _primitive(self, _start(start)))


@lru_cache(maxsize=64)
def _primitive(law: Polynomial, start: float) -> tuple[float, ...]:
    """Coefficients of the integral from ``start`` in powers of the rise: an integration asks at every stage."""
    x, f = start - law.reference, np.polynomial.Polynomial((1.0, *law.coefficients))
    about = (float(f.deriv(k)(x)) / math.factorial(k + 1) for k in range(len(law.coefficients) + 1))
    return (0.0, *about)


@np.errstate(over="ignore", invalid="ignore")  # an iteration that diverges ends itself
def _polynomial(x: Array, coefficients: tuple[float, ...]) -> Array:
    """Sum of c_k x^k."""
    return np.asarray(polyval(x, coefficients))


@dataclass(frozen=True)
class Table:
    """f(T) = v(T)/v(reference), v the monotone cubic through a table, held constant beyond its ends.

    Parameters
    ----------
    temperatures : tuple of float, K
        increasing, 2 to 10,000.
    values : tuple of float
        positive; in the unit of the property.
    reference : float, K

    Source: F. N. Fritsch, R. E. Carlson, SIAM J. Numer. Anal. 17, 238 (1980).
    """

    temperatures: tuple[float, ...]
    values: tuple[float, ...]
    reference: float = 300.0

    def __post_init__(self) -> None:
        checks.plain(self)
        T = checks.array("temperature", self.temperatures)
        values = checks.array("values", self.values)
        checks.shape("values", values, T.shape)
        if T.size < 2 or np.any(np.diff(T) <= 0) or T[0] < COLDEST or np.any(values <= 0):
            raise checks.InputError("a table needs two or more increasing temperatures above 1 K, and positive values")
        object.__setattr__(self, "temperatures", tuple(map(float, T)))
        object.__setattr__(self, "values", tuple(map(float, values)))
        checks.between("reference", self.reference, 1, 3000, unit="K")

    @cached_property
    def _curve(self) -> Any:
        return PchipInterpolator(self.temperatures, self.values)

    def value(self, T: ArrayLike) -> Array:
        """v(T)."""
        return np.asarray(self._curve(np.clip(_kelvins("T", T), self.temperatures[0], self.temperatures[-1])))

    def factor(self, T: ArrayLike) -> Array:
        """f(T)."""
        return np.asarray(_pieces(self, 0.0, integrated=False)(_kelvins("T", T)))

    def integral(self, start: float, rise: ArrayLike) -> Array:
        """From the cubics' antiderivative, with straight continuations."""
        return np.asarray(_pieces(self, _start(start), integrated=True)(_kelvins("rise", rise)))


@lru_cache(maxsize=64)
def _pieces(table: Table, start: float, *, integrated: bool) -> PPoly:
    """f, or its integral from ``start``, over the rise above ``start``; with a knot at 0, so that no digits cancel."""
    T = table.temperatures
    knots = np.unique([*T, start, 0.0, HOTTEST])
    left = knots[:-1]
    inside = (left >= T[0]) & (left < T[-1])
    slopes = [np.where(inside, table._curve(left, k), 0.0) / math.factorial(k) for k in (3, 2, 1)]
    curve = PPoly(np.stack([*slopes, table.value(left)]), knots - start)
    if integrated:
        curve = curve.antiderivative()
        curve.c[-1] -= curve(0.0)
    curve.c /= float(table.value(table.reference))
    return curve


def _start(value: float) -> float:
    """Where an integral begins, K."""
    return checks.between("start", value, COLDEST, HOTTEST, unit="K")


def _kelvins(name: str, value: ArrayLike) -> Array:
    """Temperatures or rises as floats, or InputError; an array of floats is taken as it is, and its nan gives nan.

    An integration asks at every stage, and an iteration that diverges asks for anything.
    """
    if type(value) is np.ndarray and value.dtype == float:
        return value
    return checks.numbers(name, value)


CONSTANT = PowerLaw()


def check_positive(law: Law, T: ArrayLike, factor: Array) -> None:
    """Raise InputError where f(T) is not positive; it names the law and the temperature."""
    if (lowest := factor.min(initial=np.inf)) <= 0:
        at = float(np.ravel(T)[np.argmin(factor)])
        raise checks.InputError(
            f"the law {law} is {lowest:.3g} at {at:.5g} K; no material property is zero or negative",
            "take a law that is positive at every temperature reached, or less power",
        )


def is_constant(law: Law) -> bool:
    """Whether the property does not depend on temperature at all."""
    return isinstance(law, PowerLaw) and law.exponent == 0
