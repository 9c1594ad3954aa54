"""Refractive index over wavelength: Sellmeier sums, constants and tables, by name with their sources.

n(lambda),    group index n - lambda dn/dlambda
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from scipy.interpolate import CubicSpline

from .. import checks
from ..checks import InputError
from ..data import quantity

MOST = 20.0  # of an index; no transparent material has more than 6


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
        """n.

        Raises InputError: a wavelength out of range, or where n^2 is no square of a transparent material's index.
        """
        _check_range(wavelength, *self.range)
        square = self.constant + sum(B * wavelength**2 / (wavelength**2 - C**2) for B, C in self.terms)
        return math.sqrt(checks.between(f"n^2 at {wavelength:g} m", square, 1.0, MOST**2))

    def group_index(self, wavelength: float) -> float:
        """n - lambda dn/dlambda = (n^2 - (lambda/2) d(n^2)/dlambda)/n."""
        L = wavelength
        slope = sum(-2 * B * C**2 * L / (L**2 - C**2) ** 2 for B, C in self.terms)
        n = self.index(L)
        return n - L / 2 * slope / n


@dataclass(frozen=True)
class IndexTable:
    """n by the cubic spline through a table; wavelengths in m, increasing, at least four."""

    wavelengths: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        L, n = checks.array("wavelength", self.wavelengths), checks.array("values", self.values)
        if L.size != n.size or L.size < 4 or np.any(np.diff(L) <= 0) or n.min() < 1 or n.max() > MOST:
            raise InputError("an index table needs four or more increasing wavelengths, and an index >= 1 for each")

    @cached_property
    def _curve(self) -> Any:
        return CubicSpline(self.wavelengths, self.values)

    def index(self, wavelength: float) -> float:
        """n; InputError for a wavelength outside the table."""
        _check_range(wavelength, self.wavelengths[0], self.wavelengths[-1])
        return float(self._curve(wavelength))

    def group_index(self, wavelength: float) -> float:
        """n - lambda dn/dlambda."""
        return self.index(wavelength) - wavelength * float(self._curve(wavelength, 1))


def constant_index(n: float) -> Sellmeier:
    """The law of a material without dispersion."""
    return Sellmeier(constant=checks.between("index", n, 1, MOST) ** 2)


def constant(law: Any) -> float | None:
    """The index of a law without dispersion, else None."""
    return math.sqrt(law.constant) if isinstance(law, Sellmeier) and not law.terms else None


def _check_range(wavelength: float, low: float, high: float) -> None:
    hint = "" if 1e-7 < wavelength < 1e-4 else "wavelengths are in m (did you mean 1.55e-6?)"
    checks.between("wavelength", wavelength, low, high, unit="m, where the index law holds", hint=hint)


UM = 1e-6  # m
INDEX_LAWS: dict[str, IndexLaw] = {
    # J. Opt. Soc. Am. 47, 244 (1957), at 26 C
    "Si, Salzberg 1957": Sellmeier(
        ((10.6684293, 0.301516485 * UM), (0.0030434748, 1.13475115 * UM), (1.54133408, 1104.0 * UM)),
        range=(1.36 * UM, 11 * UM),
    ),
    # J. Opt. Soc. Am. 55, 1205 (1965), at 20 C
    "SiO2, Malitson 1965": Sellmeier(
        ((0.6961663, 0.0684043 * UM), (0.4079426, 0.1162414 * UM), (0.8974794, 9.896161 * UM)),
        range=(0.21 * UM, 3.71 * UM),
    ),
    # Opt. Lett. 40, 4823 (2015), LPCVD films
    "Si3N4, Luke 2015": Sellmeier(((3.0249, 0.1353406 * UM), (40314.0, 1239.842 * UM)), range=(0.31 * UM, 5.504 * UM)),
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
    if isinstance(given, dict) and set(given) <= {"sellmeier", "constant"} and isinstance(given.get("sellmeier"), list):
        pairs = [pair if isinstance(pair, list) and len(pair) == 2 else [None, None] for pair in given["sellmeier"]]
        terms = tuple((checks.finite(f"{where}: B", B), quantity.parse(C, "m", name=f"{where}: C")) for B, C in pairs)
        return Sellmeier(terms, checks.finite(f"{where}: constant", given.get("constant", 1.0)))
    if isinstance(given, dict) and set(given) == {"wavelength", "values"}:
        at = tuple(quantity.parse(one, "m", name=f"{where}: wavelength") for one in given["wavelength"])
        return IndexTable(at, tuple(checks.finite(f"{where}: values", n) for n in given["values"]))
    if isinstance(given, dict):
        raise InputError(f"{where}: index needs sellmeier (and constant), or wavelength and values")
    return constant_index(checks.finite(f"{where}: index", given))


def write_index(law: Any) -> Any:
    """The law as a geometry file has it; reading it back gives an equal law."""
    for name, known in INDEX_LAWS.items():
        if law == known:
            return name
    if isinstance(law, IndexTable):
        return {"wavelength": [quantity.write(L, "m") for L in law.wavelengths], "values": list(law.values)}
    return {"sellmeier": [[B, quantity.write(C, "m")] for B, C in law.terms], "constant": law.constant}
