"""Units at the boundary: text such as "450 nm" or "8 dBm" becomes a plain number in SI, and back.

Inside the package every number is SI; text with units exists only where a person reads or writes (TOML, command line,
plots). `VARIABLES` gives the unit and the long name of every field of a dataset.
"""

from __future__ import annotations

import math
import re
from functools import cache, lru_cache
from typing import Any, NamedTuple

from ..checks import SMALLEST, InputError, shown
from . import units

# digits of ASCII only, none grouped by "_": Python's float() takes more
_DIGITS = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_NUMBER = re.compile(rf"\s*({_DIGITS})\s*(.*?)\s*$", re.DOTALL)
_BARE = re.compile(_DIGITS)
LONGEST = 400  # characters of a number or a quantity: 309 digits are the largest float

# unit in SI: what it measures, an example a person would write, the prefixed forms used for writing
_KINDS: dict[str, tuple[str, str, tuple[tuple[float, str], ...]]] = {
    "m": ("a length", "450 nm", ((1e-9, "nm"), (1e-6, "um"), (1e-3, "mm"))),
    "s": ("a time", "20 us", ((1e-9, "ns"), (1e-6, "us"), (1e-3, "ms"))),
    "W": ("a power", "8 dBm", ((1e-6, "uW"), (1e-3, "mW"))),
    "Hz": ("a frequency", "-10 GHz", ((1e3, "kHz"), (1e6, "MHz"), (1e9, "GHz"), (1e12, "THz"))),
    "K": ("a temperature", "293.15 K", ()),
    "J": ("an energy", "20 fJ", ((1e-15, "fJ"), (1e-12, "pJ"))),
    "rad": ("an angle", "90 deg", ((math.pi / 180, "deg"),)),
    "1/m^3": ("a carrier density", "1e23 1/m^3", ()),
    "1/s": ("a rate", "43e9 1/s", ()),
    "m^2": ("an area", "0.1 um^2", ()),
    "m^3": ("a volume", "5 um^3", ()),
    "m/W": ("a two-photon absorption coefficient", "0.81 cm/GW", ()),
    "m^2/W": ("a Kerr coefficient", "4.5e-18 m^2/W", ()),
    "1/K": ("a thermo-optic coefficient", "1.86e-4 1/K", ()),
    "eV": ("an energy", "0.1 eV", ()),
    "V": ("a voltage", "20 mV", ((1e-3, "mV"),)),
    "V/K": ("a sensitivity", "10 mV/K", ((1e-6, "uV/K"), (1e-3, "mV/K"))),
    "rad/s/K": ("a shift of the resonance", "6.5e10 rad/s/K", ()),
    "rad/s/J": ("a shift of the resonance", "1e21 rad/s/J", ()),
    "m^3/s": ("an absorption rate", "1e-13 m^3/s", ()),
    "1/s/J": ("an absorption rate", "5.6e21 1/s/J", ()),
    "1/m^3/s/J^2": ("a generation rate", "9.9e57 1/m^3/s/J^2", ()),
    "K/W": ("a thermal resistance", "9 K/mW", ((1e3, "K/mW"),)),
    "W/m/K": ("a thermal conductivity", "130 W/m/K", ()),
    "kg/m^3": ("a density", "2330 kg/m^3", ()),
    "J/kg/K": ("a specific heat", "700 J/kg/K", ()),
    "W/m^2/K": ("a heat transfer coefficient", "1e4 W/m^2/K", ()),
    "m^2*K/W": ("a thermal boundary resistance", "1e-8 m^2*K/W", ()),
    "": ("a plain number", "0.33", ()),
}


SI = frozenset(_KINDS)  # the units that values are read in


class Variable(NamedTuple):
    """Unit and long name of one field of a dataset."""

    unit: str
    long_name: str


VARIABLES: dict[str, Variable] = {
    "time": Variable("s", "time"),
    "power": Variable("W", "absorbed power"),
    "delta_T": Variable("K", "mean temperature rise"),
    "final_rise": Variable("K", "temperature rise of the field at the end"),
    "temperature": Variable("K", "temperature"),
    "energy": Variable("J", "energy stored in the resonator"),
    "carriers": Variable("1/m^3", "free-carrier density"),
    "drop": Variable("W", "power at the drop port"),
    "through": Variable("W", "power at the through port"),
    "absorbed": Variable("W", "power absorbed in the resonator"),
    "scattered": Variable("W", "power scattered out of the resonator"),
    "input_power": Variable("W", "power in the bus waveguide"),
    "detuning": Variable("Hz", "laser frequency minus cold resonance"),
    "frequency": Variable("Hz", "frequency"),
    "period": Variable("s", "period"),
    "period_model": Variable("s", "period for which the model has the same swing"),
    "error": Variable("s", "period error"),
    "relative_error": Variable("1", "relative period error"),
    "duty": Variable("1", "duty cycle"),
    "swing": Variable("K", "peak-to-peak temperature rise"),
    "growth_rate": Variable("1/s", "largest real part of the eigenvalues"),
    "regime": Variable("1", "dynamic regime"),
    "impedance": Variable("K/W", "thermal impedance"),
    "heat_in": Variable("J", "heat put in"),
    "heat_stored": Variable("J", "heat stored"),
    "heat_out": Variable("J", "heat carried off through the boundary"),
    "field": Variable("K", "temperature rise"),
    "field_time": Variable("s", "time of the field"),
    "swing_model": Variable("K", "swing of the model's temperature rise"),
    "shortest": Variable("s", "shortest period within 10 %"),
    "longest": Variable("s", "longest period within 10 %"),
    "lifetime": Variable("s", "carrier lifetime"),
    "weight": Variable("s", "weight of an integral over the period"),
    "window": Variable("s", "start of the window"),
    "discrepancy": Variable("K", "largest discrepancy of the temperature"),
    "highest_rise": Variable("K", "highest temperature rise"),
    "tau_th": Variable("s", "thermal lifetime"),
    "r": Variable("m", "distance from the axis of the ring"),
    "z": Variable("m", "height above the datum"),
}


def parse(text: Any, unit: str, *, name: str = "value") -> float:
    """Turn text with a unit into a number in SI.

    A prefix leaves no round-off: with at most 15 digits the result is the float one would have typed,
    ``parse("450 nm", "m") == 450e-9``. Angles are no pure numbers here: "5 rad/s" is not a frequency in Hz.

    text: a number and a unit, such as "8 dBm"; the unit may be left out only where ``unit`` is "".
    unit: the SI unit of the result; it sets the expected dimension ("m", "W", "m^2*K/W", ...).
    name: what the value is called in the error message.
    Raises InputError: no text, no number, missing or unknown unit, wrong dimension, a number that is not finite.

    >>> parse("450 nm", "m"), round(parse("8 dBm", "W"), 7), parse("-10 GHz", "Hz")
    (4.5e-07, 0.0063096, -10000000000.0)
    """
    if isinstance(text, bool) or not isinstance(text, str | int | float):
        raise InputError(f"{name} = {shown(text)} is not a quantity", _wanted(unit))
    what = f"{name} = {shown(text)}"
    try:
        written = str(text)
    except ValueError:  # an integer of thousands of digits
        raise InputError(f"{what} is not finite", _wanted(unit)) from None
    if len(written) > LONGEST:
        raise InputError(f"{what} has {len(written)} characters, more than {LONGEST}", _wanted(unit))
    match = _NUMBER.match(written)
    if match is None:
        raise InputError(f"{what} does not begin with a number", _wanted(unit))
    number, given = match[1], match[2]
    if re.match(r",[0-9]", given):
        raise InputError(f"{what} has a comma in its number; decimals follow a point", _wanted(unit))
    if not given and unit:
        raise InputError(f"{what} has no unit", _wanted(unit))
    value = _convert(number, given, unit, what) if math.isfinite(float(number)) else math.inf
    if not math.isfinite(value):
        raise InputError(f"{what} is not finite", _wanted(unit))
    return value


def positive(text: Any, unit: str, *, name: str = "value") -> float:
    """`parse`, and InputError unless the quantity is larger than zero."""
    value = parse(text, unit, name=name)
    if value < SMALLEST:
        raise InputError(f"{name} = {shown(text)} must be larger than zero", _wanted(unit))
    return value


def positive_rise(text: Any, *, name: str = "value") -> float:
    """`positive` of a difference of temperatures in K; InputError for degrees Celsius, whose 1 degC is 274.15 K."""
    value = positive(text, "K", name=name)
    if str(text).rstrip().endswith(("degC", "°C")):
        raise InputError(f"{name} = {shown(text)} is a difference of temperatures; write it in K")
    return value


def not_negative(text: Any, unit: str, *, name: str = "value") -> float:
    """`parse`, and InputError where the quantity is below zero."""
    value = parse(text, unit, name=name)
    if value < 0:
        raise InputError(f"{name} = {shown(text)} must not be negative", _wanted(unit))
    return value


def number(text: str) -> float:
    """A plain number written in ASCII digits, or nan for "nan"; ValueError for anything else.

    Python's ``float`` also takes "1_0" and the digits of other scripts, which no table of numbers holds.

    >>> number("-1.5e3")
    -1500.0
    """
    if len(text) <= LONGEST and _BARE.fullmatch(text):
        return float(text)
    if text.strip("+-").lower() in ("nan", "inf", "infinity"):
        return math.nan
    raise ValueError(shown(text))


def line(unit: str, si: str, *, name: str) -> tuple[float, float]:
    """Offset and factor that turn numbers in ``unit`` into SI; InputError where the scale is not straight (dBm).

    >>> line("us", "s", name="time")
    (0.0, 1e-06)
    """
    at = [parse(f"{k} {unit}", si, name=name) for k in (0, 1, 2)]
    if abs(at[2] - 2 * at[1] + at[0]) > 1e-9 * abs(at[1]):
        raise InputError(f"{name}: the unit {shown(unit)} is no straight scale; write the numbers in {si}")
    return at[0], at[1] - at[0]


def write(value: float, unit: str) -> str:
    """Text for a number in SI, with the prefix that reads best; `parse` gives back exactly the same number.

    >>> write(450e-9, "m"), write(130.0, "W/m/K")
    ('450 nm', '130 W/m/K')
    """
    choices = [(f"{value / factor:.12g}", prefixed) for factor, prefixed in _KINDS[unit][2]]
    choices = [(number, prefixed) for number, prefixed in choices if parse(f"{number} {prefixed}", unit) == value]
    choices.append((f"{value:.12g}" if float(f"{value:.12g}") == value else repr(float(value)), unit))
    number, prefixed = min(choices, key=lambda choice: (not 1 <= abs(float(choice[0])) < 1000, len(choice[0])))
    return f"{number} {prefixed}".strip()


def rounded(value: float, unit: str, digits: int = 3) -> str:
    """The text of `write` for the number rounded to so many significant digits, for messages.

    >>> rounded(4.1966e-5, "s"), rounded(float("inf"), "s")
    ('42 us', 'inf s')
    """
    number = float(f"{value:.{digits}g}")
    return write(number, unit) if math.isfinite(number) else f"{number} {unit}"


def _convert(digits: str, given: str, unit: str, what: str) -> float:
    """The number ``digits`` of unit ``given`` in ``unit``; the digits are kept where the unit is a power of ten."""
    try:
        if given in ("dBm", "degC", "°C") and units.scale(unit) == units.scale("W" if given == "dBm" else "K"):
            return _shifted(float(digits), given)
        here, there = units.scale(given), units.scale(unit)
    except units.UnitError as error:
        raise InputError(f"{what}: {shown(given)} is not a unit ({error})", _wanted(unit)) from None
    if here is None or there is None:
        return _by_pint(float(digits), units.plain(given), unit, what)
    if here.dimensions != there.dimensions:
        raise InputError(f"{what} has the wrong dimension", _wanted(unit))
    mantissa, _, exponent = digits.lower().partition("e")
    shift = int(exponent or 0) + here.exponent - there.exponent
    return float(f"{mantissa}e{shift}") * (1.0 if here.factor == there.factor else here.factor / there.factor)


def _shifted(value: float, given: str) -> float:
    """Watts of dBm, or kelvin of degrees Celsius."""
    if given != "dBm":
        return value + 273.15
    try:
        return float(1e-3 * 10 ** (value / 10))
    except OverflowError:
        return math.inf


@lru_cache(maxsize=4096)
def _by_pint(number: float, given: str, unit: str, what: str) -> float:
    """Convert a number whose unit is not in `units.SYMBOLS`, by pint."""
    import numpy as np
    import pint

    registry = units.registry()
    try:
        quantity = registry.Quantity(number, registry.parse_units(given))
        fits = _dimensions(given) == _dimensions(unit)
    except pint.errors.UndefinedUnitError as error:
        unknown = error.unit_names if isinstance(error.unit_names, str) else ", ".join(error.unit_names)
        near = units.nearest(unknown, [*(prefixed for _, prefixed in _KINDS[unit][2]), unit, *_MORE.get(unit, ())])
        guess = f", did you mean {near!r}?" if near else ""
        raise InputError(f"{what}: the unit {unknown!r} is unknown{guess}", _wanted(unit)) from None
    except Exception:  # pint's parser raises whatever its tokeniser meets, AssertionError included
        raise InputError(f"{what}: {shown(given)} is not a unit", _wanted(unit)) from None
    if not fits:
        raise InputError(f"{what} has the wrong dimension", _wanted(unit))
    with np.errstate(over="ignore"):
        value = float(quantity.to(registry.parse_units(unit)).magnitude)
    ratio = abs(value / number) if number else 0.0
    decades = math.log10(ratio) if 0 < ratio < math.inf else 0.0
    if round(decades) and abs(decades - round(decades)) < 1e-12:  # a decimal prefix costs one rounding: undo it
        return float(f"{value:.15g}")
    return value


_MORE = {"W": ("dBm", "nW"), "m": ("cm",), "s": ("ps", "fs"), "K": ("mK", "degC"), "rad": ("mrad",), "J": ("nJ",)}


@cache
def _dimensions(unit: str) -> Any:
    """The unit in base units, angles kept: rad/s is not Hz."""
    registry = units.registry()
    return registry.Quantity(1, registry.parse_units(unit)).to_root_units().units


def _wanted(unit: str) -> str:
    measures, example, _ = _KINDS[unit]
    return f'{measures} is needed, e.g. "{example}"'
