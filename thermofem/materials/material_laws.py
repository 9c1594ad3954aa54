"""Laws of materials: how conductivity and specific heat follow temperature, and the refractive index wavelength.

A law of temperature is a dimensionless f(T), which multiplies the property's value and is 1 where the value holds. It
gives its integral from one temperature to another, too: the Kirchhoff variable of a conductivity, the enthalpy of a
specific heat. An index law gives n(lambda) and the group index n - lambda dn/dlambda.
"""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.polynomial.polynomial import polyval
from scipy.constants import micro
from scipy.interpolate import CubicSpline, PchipInterpolator, PPoly

from .. import checks
from ..arrays import Array, ArrayLike
from ..checks import InputError
from ..data import quantity

TABLE_MARGIN = 20.0  # K beyond its ends, for which a table is taken to hold
COLDEST, HOTTEST = 1.0, 1e4  # K; laws are evaluated between them


class Law(Protocol):
    """Interface of a temperature law; T in K."""

    def factor(self, T: ArrayLike) -> Array:
        """Factor f(T) of the property, dimensionless, shape of ``T``."""

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
        """Factor f(T) of the property, dimensionless, shape of ``T``."""
        return (np.maximum(_kelvins("T", T), COLDEST) / self.reference) ** self.exponent

    def integral(self, start: float, rise: ArrayLike) -> Array:
        """Integral of f from ``start`` (K) over ``rise`` (K), in a form that does not cancel at a small rise.

            start f(start) ((1 + rise/start)^(n + 1) - 1)/(n + 1)

        f is constant below 1 K.
        """
        start = _start(start)
        rise = _kelvins("rise", rise)
        above = np.maximum(rise, COLDEST - start)
        log = np.log1p(above / start)
        n = self.exponent + 1
        scale = (start / self.reference) ** self.exponent * start
        below = (rise - above) * (COLDEST / self.reference) ** self.exponent
        integral = scale / n * np.expm1(n * log) if n else scale * log
        return integral + below


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
        largest = np.abs(coefficients).max()
        # T^3 about 1 K has 3, and far more than 10 keeps steps from converging
        checks.between("polynomial: largest coefficient", largest, 0, 10, unit="1/K, 1/K^2, ...")
        object.__setattr__(self, "coefficients", tuple(map(float, coefficients)))
        checks.between("reference", self.reference, 1, 3000, unit="K")

    def factor(self, T: ArrayLike) -> Array:
        """Factor f(T) of the property, dimensionless, shape of ``T``."""
        return _polynomial(_kelvins("T", T) - self.reference, (1.0, *self.coefficients))

    def integral(self, start: float, rise: ArrayLike) -> Array:
        """Integral of f from ``start`` over ``rise`` in K, expanded about ``start``: a small rise does not cancel."""
        return _polynomial(_kelvins("rise", rise), _primitive(self, _start(start)))


@lru_cache(maxsize=64)
def _primitive(law: Polynomial, start: float) -> tuple[float, ...]:
    """Coefficients of the integral of f from ``start`` as a polynomial in the rise; cached."""
    f = np.polynomial.Polynomial((1.0, *law.coefficients))
    of_rise = f(np.polynomial.Polynomial((start - law.reference, 1.0)))
    return tuple(of_rise.integ().coef)


@np.errstate(over="ignore", invalid="ignore")  # an iteration that diverges ends itself
def _polynomial(x: Array, coefficients: tuple[float, ...]) -> Array:
    """Value of the polynomial sum_k c_k x^k."""
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
        increasing = T.size > 1 and T[0] >= COLDEST and (np.diff(T) > 0).all()
        if not increasing or (values <= 0).any():
            raise InputError("a table needs two or more increasing temperatures above 1 K, and positive values")
        object.__setattr__(self, "temperatures", tuple(map(float, T)))
        object.__setattr__(self, "values", tuple(map(float, values)))
        checks.between("reference", self.reference, 1, 3000, unit="K")

    @cached_property
    def _curve(self) -> Any:
        return PchipInterpolator(self.temperatures, self.values)

    def value(self, T: ArrayLike) -> Array:
        """The property at T in K, monotone cubic between the rows, constant beyond them; in the unit of ``values``."""
        within = np.clip(_kelvins("T", T), self.temperatures[0], self.temperatures[-1])
        return self._curve(within)

    def factor(self, T: ArrayLike) -> Array:
        """Factor f(T) of the property, dimensionless, shape of ``T``."""
        return self.value(T) / self.value(self.reference)

    def integral(self, start: float, rise: ArrayLike) -> Array:
        """Integral of f from ``start`` over ``rise`` in K, exact for the cubic pieces and the constant ends."""
        return _integral(self, _start(start))(_kelvins("rise", rise))


@lru_cache(maxsize=64)
def _integral(table: Table, start: float) -> PPoly:
    """Integral of f from ``start`` as a piecewise polynomial in the rise; a knot at 0 avoids cancellation."""
    T = table.temperatures
    knots = np.unique([*T, start, 0.0, HOTTEST])
    left = knots[:-1]
    inside = (left >= T[0]) & (left < T[-1])
    coefficients = []
    for k in (3, 2, 1):
        derivative = np.where(inside, table._curve(left, k), 0.0)
        coefficients.append(derivative / math.factorial(k))
    coefficients.append(table.value(left))
    curve = PPoly(np.stack(coefficients), knots - start).antiderivative()
    curve.c[-1] -= curve(0.0)
    curve.c /= float(table.value(table.reference))
    return curve


def _start(value: float) -> float:
    """Return the lower limit of an integral in K, or raise InputError."""
    return checks.between("start", value, COLDEST, HOTTEST, unit="K")


def _kelvins(name: str, value: ArrayLike) -> Array:
    """Return temperatures or rises in K as floats, or raise InputError; arrays of floats are not checked.

    An integration calls this at every stage, and an iteration that diverges passes nan.
    """
    if type(value) is np.ndarray and value.dtype == float:
        return value
    return checks.numbers(name, value)


CONSTANT = PowerLaw()


def check_positive(law: Law, T: ArrayLike, factor: Array) -> None:
    """Raise InputError where f(T) is not positive; it names the law and the temperature."""
    if (lowest := factor.min(initial=np.inf)) <= 0:
        at = float(np.ravel(T)[np.argmin(factor)])
        raise InputError(
            f"the law {law} is {lowest:.3g} at {at:.5g} K; no material property is zero or negative",
            "take a law that is positive at every temperature reached, or less power",
        )


def beyond_table(law: Law, lowest: float, highest: float) -> tuple[float, float] | None:
    """Range in K of a table that two temperatures in K leave, beyond which it is held constant; None where it holds."""
    if not isinstance(law, Table):
        return None
    first = law.temperatures[0]
    last = law.temperatures[-1]
    return (first, last) if lowest < first - TABLE_MARGIN or highest > last + TABLE_MARGIN else None


def is_constant(law: Law) -> bool:
    """Whether the property does not depend on temperature at all."""
    return isinstance(law, PowerLaw) and law.exponent == 0


LARGEST_INDEX = 20.0  # no transparent material has more than 6


class IndexLaw(Protocol):
    """Interface of an index law; wavelengths in m."""

    def index(self, wavelength: float) -> float:
        """Refractive index n."""

    def group_index(self, wavelength: float) -> float:
        """Group index n - lambda dn/dlambda."""


@dataclass(frozen=True)
class Sellmeier:
    """n^2 = constant + sum_k B_k lambda^2/(lambda^2 - C_k^2); without terms a constant index.

    terms [tuple of (B, C in m)]
    range [m]: wavelengths between which it holds.
    """

    terms: tuple[tuple[float, float], ...] = ()
    constant: float = 1.0
    range: tuple[float, float] = (1e-7, 1e-3)

    def index(self, wavelength: float) -> float:
        """Refractive index n at a wavelength in m.

        Raises InputError: a wavelength out of range, or one at which n^2 cannot be that of a transparent material.
        """
        _check_range(wavelength, *self.range)
        square = self.constant + sum(B * wavelength**2 / (wavelength**2 - C**2) for B, C in self.terms)
        return math.sqrt(checks.between(f"n^2 at {wavelength:g} m", square, 1.0, LARGEST_INDEX**2))

    def group_index(self, wavelength: float) -> float:
        """Group index n - lambda dn/dlambda = (n^2 - (lambda/2) d(n^2)/dlambda)/n."""
        L = wavelength
        slope = sum(-2 * B * C**2 * L / (L**2 - C**2) ** 2 for B, C in self.terms)
        n = self.index(L)
        return n - L / 2 * slope / n


@dataclass(frozen=True)
class IndexTable:
    """Refractive index n by the cubic spline through a table; wavelengths in m, increasing, at least four."""

    wavelengths: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        L = checks.array("wavelength", self.wavelengths)
        n = checks.array("values", self.values)
        increasing = L.size >= 4 and (np.diff(L) > 0).all()
        possible = n.size == L.size and n.min() >= 1 and n.max() <= LARGEST_INDEX
        if not increasing or not possible:
            raise InputError("an index table needs four or more increasing wavelengths, and an index >= 1 for each")

    @cached_property
    def _curve(self) -> Any:
        return CubicSpline(self.wavelengths, self.values)

    def index(self, wavelength: float) -> float:
        """Refractive index n at a wavelength in m; InputError outside the table."""
        _check_range(wavelength, self.wavelengths[0], self.wavelengths[-1])
        return float(self._curve(wavelength))

    def group_index(self, wavelength: float) -> float:
        """Group index n - lambda dn/dlambda."""
        return self.index(wavelength) - wavelength * float(self._curve(wavelength, 1))


def constant_index(n: float) -> Sellmeier:
    """The law of a material without dispersion."""
    return Sellmeier(constant=checks.between("index", n, 1, LARGEST_INDEX) ** 2)


def fixed_index(law: Any) -> float | None:
    """Refractive index of a law without dispersion; None for any other law."""
    return math.sqrt(law.constant) if isinstance(law, Sellmeier) and not law.terms else None


def _check_range(wavelength: float, low: float, high: float) -> None:
    hint = "wavelengths are in m (did you mean 1.55e-6?)"
    if 1e-7 < wavelength < 1e-4:
        hint = "give a table for this band: index = { wavelength = [...], values = [...] }, four or more of each"
    checks.between("wavelength", wavelength, low, high, unit="m, where the index law holds", hint=hint)


INDEX_LAWS: dict[str, IndexLaw] = {
    # J. Opt. Soc. Am. 47, 244 (1957), at 26 C
    "Si, Salzberg 1957": Sellmeier(
        ((10.6684293, 0.301516485 * micro), (0.0030434748, 1.13475115 * micro), (1.54133408, 1104.0 * micro)),
        range=(1.36 * micro, 11 * micro),
    ),
    # J. Opt. Soc. Am. 55, 1205 (1965), at 20 C
    "SiO2, Malitson 1965": Sellmeier(
        ((0.6961663, 0.0684043 * micro), (0.4079426, 0.1162414 * micro), (0.8974794, 9.896161 * micro)),
        range=(0.21 * micro, 3.71 * micro),
    ),
    # Opt. Lett. 40, 4823 (2015), LPCVD films
    "Si3N4, Luke 2015": Sellmeier(
        ((3.0249, 0.1353406 * micro), (40314.0, 1239.842 * micro)),
        range=(0.31 * micro, 5.504 * micro),
    ),
    "air": Sellmeier(),
}


def read_index(given: Any, where: str) -> IndexLaw:
    """An index law of a geometry file.

        index = 1.444
        index = "Si, Salzberg 1957"
        index = { sellmeier = [[0.696, "0.0684 um"]], constant = 1 }
        index = { wavelength = ["1.5 um", "1.55 um", "1.6 um", "1.65 um"], values = [1.445, 1.444, 1.443, 1.442] }

    Raises InputError: none of these forms.
    """
    if isinstance(given, str):
        return INDEX_LAWS[checks.choice(f"{where}: index", given, INDEX_LAWS)]
    if not isinstance(given, dict):
        return constant_index(checks.finite(f"{where}: index", given))
    if given.keys() <= {"sellmeier", "constant"} and isinstance(given.get("sellmeier"), list):
        terms = tuple(_term(pair, where) for pair in given["sellmeier"])
        return Sellmeier(terms, checks.finite(f"{where}: constant", given.get("constant", 1.0)))
    if given.keys() == {"wavelength", "values"}:
        wavelengths = tuple(quantity.parse(L, "m", name=f"{where}: wavelength") for L in given["wavelength"])
        values = tuple(checks.finite(f"{where}: values", n) for n in given["values"])
        return IndexTable(wavelengths, values)
    raise InputError(f"{where}: index needs sellmeier (and constant), or wavelength and values")


def _term(pair: Any, where: str) -> tuple[float, float]:
    """B and C (m) of a term of a Sellmeier sum."""
    B, C = pair if isinstance(pair, list) and len(pair) == 2 else (None, None)
    number = checks.finite(f"{where}: B", B)
    return number, quantity.parse(C, "m", name=f"{where}: C")


def write_index(law: Any) -> Any:
    """The law as a geometry file has it; reading it back gives an equal law."""
    for name, known in INDEX_LAWS.items():
        if law == known:
            return name
    if isinstance(law, IndexTable):
        return {"wavelength": [quantity.write(L, "m") for L in law.wavelengths], "values": list(law.values)}
    return {"sellmeier": [[B, quantity.write(C, "m")] for B, C in law.terms], "constant": law.constant}
