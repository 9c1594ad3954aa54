"""Quantities as text: "450 nm" or "8 dBm" becomes a plain number in SI, and back.

Inside the package every number is SI; text with units exists only where a person reads or writes (TOML, command line,
plots). pint knows the units. Decibels are handled here: dBm is a power, dB per length an attenuation of power.
"""

import difflib
import math
import re
from functools import cache, lru_cache
from typing import Any

from ..checks import SMALLEST, InputError, shown

LONGEST_UNIT = 80  # characters
# digits of ASCII only, none grouped by "_": Python's float() takes more
_DIGITS = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
_NUMBER = re.compile(rf"\s*({_DIGITS})\s*(.*?)\s*$", re.DOTALL)
# names, products, quotients and brackets, powers of one digit: pint computes larger powers, of any size
_UNIT = re.compile(r"(?:[^\W\d_]|(?<=\w)_(?=\w)|[\s*/()%°]|1(?!\d)|(?<![\s)^*])\^[+-]?[1-9](?![\d^]))*")
_SUPERSCRIPTS = str.maketrans({"²": "^2", "³": "^3", "⁻": "^-", "¹": "1", "·": "*", "⋅": "*"})

# unit in SI: what it measures, an example a person would write, the prefixed forms used for writing
_KINDS: dict[str, tuple[str, str, tuple[tuple[float, str], ...]]] = {
    "m": ("a length", "450 nm", ((1e-9, "nm"), (1e-6, "um"), (1e-3, "mm"))),
    "s": ("a time", "20 us", ((1e-9, "ns"), (1e-6, "us"), (1e-3, "ms"))),
    "W": ("a power", "8 dBm", ((1e-6, "uW"), (1e-3, "mW"))),
    "Hz": ("a frequency", "-10 GHz", ((1, "Hz"), (1e3, "kHz"), (1e6, "MHz"), (1e9, "GHz"), (1e12, "THz"))),
    "K": ("a temperature", "293.15 K", ((1e-6, "uK"), (1e-3, "mK"))),
    "J": ("an energy", "20 fJ", ((1e-15, "fJ"), (1e-12, "pJ"))),
    "rad": ("an angle", "90 deg", ((math.pi / 180, "deg"),)),
    "1/m^3": ("a carrier density", "1e23 1/m^3", ()),
    "1/s": ("a rate", "43e9 1/s", ()),
    "m^2": ("an area", "0.1 um^2", ()),
    "m^3": ("a volume", "5 um^3", ()),
    "m/W": ("a two-photon absorption coefficient", "0.81 cm/GW", ()),
    "m^2/W": ("a Kerr coefficient", "4.5e-18 m^2/W", ()),
    "1/m": ("an attenuation of power", "7 dB/cm", ()),
    "Hz/K": ("a thermal shift of a frequency", "9.3 GHz/K", ()),
    "m/K": ("a thermal shift of a wavelength", "75 pm/K", ()),
    "1/K": ("a coefficient per kelvin", "1.86e-4 1/K", ()),
    "eV": ("an energy", "0.1 eV", ()),
    "V": ("a voltage", "20 mV", ((1e-3, "mV"),)),
    "A": ("a current", "5 mA", ((1e-6, "uA"), (1e-3, "mA"))),
    "ohm": ("a resistance", "120 ohm", ((1e3, "kohm"),)),
    "ohm*m": ("a resistivity", "4.3e-7 ohm*m", ()),
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
    # 400: the largest float has 309 digits
    is_number = not isinstance(text, bool) and len(str(text)) <= 400
    match = _NUMBER.match(str(text)) if is_number else None
    value, fault = _convert(match[1], match[2], unit) if match else (math.nan, "does not begin with a number")
    if not math.isfinite(value):
        raise InputError(f"{name} = {shown(text)} {fault or 'is not finite'}", _wanted(unit))
    return value


def positive(text: Any, unit: str, *, name: str = "value") -> float:
    """`parse`, and InputError unless the quantity is larger than zero."""
    return _from(SMALLEST, "must be larger than zero", text, unit, name)


def not_negative(text: Any, unit: str, *, name: str) -> float:
    """`parse`, and InputError where the quantity is below zero."""
    return _from(0.0, "must not be negative", text, unit, name)


def _from(least: float, rule: str, text: Any, unit: str, name: str) -> float:
    value = parse(text, unit, name=name)
    if value < least:
        raise InputError(f"{name} = {shown(text)} {rule}", _wanted(unit))
    return value


def positive_rise(text: Any, *, name: str) -> float:
    """`positive` of a difference of temperatures in K; InputError for degrees Celsius, whose 1 degC is 274.15 K."""
    value = positive(text, "K", name=name)
    if str(text).rstrip().endswith(("degC", "°C")):
        raise InputError(f"{name} = {shown(text)} is a difference of temperatures; write it in K")
    return value


def write(value: float, unit: str) -> str:
    """Text for a number in SI, with the prefix that reads best; `parse` gives back exactly the same number.

    >>> write(450e-9, "m"), write(130.0, "W/m/K")
    ('450 nm', '130 W/m/K')
    """
    choices = []
    for factor, prefixed in _KINDS[unit][2]:
        number = f"{value / factor:.12g}"
        if parse(f"{number} {prefixed}", unit) == value:
            choices.append((number, prefixed))
    plain = f"{value:.12g}"
    if float(plain) != value:
        plain = repr(float(value))
    choices.append((plain, unit))

    def awkward(choice: tuple[str, str]) -> tuple[bool, int]:
        size = abs(float(choice[0]))
        return not 1 <= size < 1000, len(choice[0])

    number, prefixed = min(choices, key=awkward)
    return f"{number} {prefixed}".strip()


def rounded(value: float, unit: str, digits: int = 3) -> str:
    """The text of `write` for the number rounded to so many significant digits, for messages.

    >>> rounded(4.1966e-5, "s"), rounded(float("inf"), "s")
    ('42 us', 'inf s')
    """
    number = float(f"{value:.{digits}g}")
    return write(number, unit) if math.isfinite(number) else f"{number} {unit}"


def gain(value: float, unit: str, per: str) -> str:
    """Text of a gain in ``unit`` per ``per`` (both SI), for reading.

    >>> gain(2.684e-14, "W", "Hz")
    '26.8 uW per GHz'
    """
    factor, name = {"Hz": (1e9, "GHz"), "W": (1e-3, "mW")}.get(per, (1.0, per))
    return f"{rounded(value * factor, unit)} per {name}"


def _convert(digits: str, given: str, unit: str) -> tuple[float, str]:
    """Convert the number ``digits`` from unit ``given`` to ``unit``; also a text on what is wrong, "" if nothing.

    The decimal digits are kept exactly where the factor between the units is a power of ten.
    """
    if given == "dBm" and unit == "W":
        decibels = float(digits)
        return 1e-3 * 10 ** (decibels / 10) if decibels < 3000 else math.inf, ""
    if given in ("degC", "°C") and unit == "K":
        return float(digits) + 273.15, ""
    factor, fault = _factor(given, unit)
    decades = round(math.log10(factor)) if factor > 0 else 0
    if fault or abs(factor / 10.0**decades - 1) > 1e-12:
        return float(digits) * factor, fault
    mantissa, _, exponent = digits.lower().partition("e")
    return float(f"{mantissa}e{int(exponent or 0) + decades}"), ""


@lru_cache(maxsize=1024)
def _factor(given: str, unit: str) -> tuple[float, str]:
    """One ``given`` in ``unit``, and ""; or nan and why: no unit, an unknown one, or another dimension."""
    text = given.translate(_SUPERSCRIPTS).replace("**", "^")
    factor, fault = _factor_of(text, given, unit)
    if not fault:
        return factor, ""
    factor, spelled_fault = _factor_of(_with_powers(text), given, unit)
    return (factor, "") if not spelled_fault else (math.nan, fault)


def _with_powers(text: str) -> str:
    """A unit as data sheets write it, with its signs: kg/m3 as kg/m^3, cm-3 as cm^-3, W/m2K as W/m^2/K, W/m-K as W/m/K.

    All symbols behind the first slash divide, and mK there is m K, as a millikelvin has failed before.
    """
    powers = re.sub(r"(?<=[A-Za-z])(-?[1-9])", r"^\1", text)
    products = re.sub(r"(?<=\d)(?=[A-Za-z])", "*", powers)
    above, slash, below = products.partition("/")
    divisors = re.sub(r"(?<=[mg])(?=K)", "/", below)
    return above + slash + re.sub(r"(?<!\^)[-*\s]+", "/", divisors)


def _factor_of(text: str, given: str, unit: str) -> tuple[float, str]:
    """`_factor` of a unit ``text`` with "^" before every power; ``given``: the same as it was written."""
    if unit == "1/m" and text.startswith("dB/"):
        # math.log(10) / 10: natural attenuation of power for 1 dB
        factor, fault = _factor(f"1{text[2:]}", unit)
        return (math.log(10) / 10) * factor, fault
    if unit and not given:
        return math.nan, "has no unit"
    comma = "has a comma in its number; decimals follow a point"
    fault = comma if given.startswith(",") else f"has no known unit: {shown(given)} is not a unit"
    if len(text) <= LONGEST_UNIT and _UNIT.fullmatch(text):
        import pint

        units = registry()  # kept: threads that call this at once may each make their own
        try:
            written = units.Quantity(1.0, units.parse_units(text))
            target = units.Quantity(1.0, units.parse_units(unit))
            # in root units angles are kept: rad/s is not Hz
            if written.to_root_units().units == target.to_root_units().units:
                ratio = (written / target).to_base_units()
                return float(ratio.magnitude), ""
            fault = "has the wrong dimension"
        except pint.errors.UndefinedUnitError as error:
            names = error.unit_names
            fault = _unknown(names if isinstance(names, str) else ", ".join(names), unit)
        except Exception:
            pass
    return math.nan, fault


def _unknown(name: str, unit: str) -> str:
    """Words on a unit that pint does not know, with the known one that it resembles; ``unit`` is that of SI."""
    prefixed = [text for _, text in _KINDS[unit][2]]
    nearest = _nearest(name, [*prefixed, unit, *_MORE.get(unit, ())])
    fault = f"has no known unit: {name!r} is unknown"
    return f"{fault}, did you mean {nearest!r}?" if nearest else fault


_MORE = {"W": ("dBm", "nW"), "m": ("cm",), "s": ("ps", "fs"), "K": ("mK", "degC"), "rad": ("mrad",), "J": ("nJ",)}


def _nearest(name: str, known: list[str]) -> str | None:
    """Known unit that an unknown name resembles: equal but for case ("mw"), or spelled alike; None without one."""
    same = [unit for unit in known if unit.casefold() == name.casefold()]
    alike = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    return next(iter(same + alike), None)


@cache
def registry() -> Any:
    """The units that pint knows."""
    import pint

    return pint.UnitRegistry(cache_folder=None)


def _wanted(unit: str) -> str:
    measures, example, _ = _KINDS[unit]
    return f'{measures} is needed, e.g. "{example}"'
