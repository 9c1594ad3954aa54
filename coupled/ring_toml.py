"""Read a ring file, TOML with units, into a `RingResonator`.

```toml
name = "rib ring 3"
base = "borghi2021"              # or "vanvaerenbergh2012": gives what is not named here; without it every key is needed
wavelength = "1551.2 nm"         # or frequency = "193.27 THz"
loaded_q = 12000                 # with intrinsic_q, or the amplitude rates bus_rate, loss_rate ("43e9 1/s")
intrinsic_q = 110000
buses = 2                        # 1: all-pass
absorbed_fraction = 0.4          # of the intrinsic loss; the rest scatters
perimeter = "50 um"              # with mode_area, or tpa_volume and fca_volume ("5.35 um^3")
mode_area = "0.1 um^2"
refractive_index = 3.485         # group_index, thermo_optic ("1.86e-4 1/K"), fca_cross_section ("1.5e-21 m^2"),
tpa_coefficient = "0.81 cm/GW"   # tpa_confinement, fca_confinement, kerr_coefficient ("4.5e-18 m^2/W"), lumped_fcd,
read = "light"                   # the temperature that goes with thermo_optic: "core" (default), or "light", where it
                                 # is dn_eff/dT of a whole section
mode = "TE0"                     # the mode whose temperature "light" is, with its wavelength
mode_wavelength = "1550 nm"
drop_rate = "40e9 1/s"           # scattering_rate, index_confinement: as the fields of RingResonator
resonance_shift = "75 pm/K"      # or "9.3 GHz/K": measured; instead of what refractive_index and thermo_optic give

[[dispersion]]                   # index change: sum of coefficient N^exponent, N in 1/m^3
coefficient = -1.07e-27
exponent = 1

[carriers]                       # a constant lifetime, or all of Shockley, Read and Hall's
lifetime = "10 ns"               # tau_n, tau_p, intrinsic_density, hole_density ("1e21 1/m^3"), trap_energy ("0.1 eV"),
                                 # temperature ("293.15 K")
[rates]                          # derived rates that are known better than they follow from the above
eta_fca = "1e-13 m^3/s"          # eta_tpa ("1/s/J"), g_tpa ("1/m^3/s/J^2"), thermal_shift ("rad/s/K"), kerr_shift
```
"""

import dataclasses
import json
import logging
import math
from collections.abc import Callable, Container, Mapping
from dataclasses import MISSING, replace
from typing import Any, NamedTuple, TypeVar

from scipy.constants import c, e, k, pi

from thermofem import InputError, checks
from thermofem.data import files, quantity
from thermofem.data.files import ANY, TABLE, TABLES, TEXT, read_table
from thermofem.errors import one_line
from thermofem.ring_temperature import CORE, GuidedMode

from . import carriers

SILICON = (3.0, 4.0)  # refractive index near 1.55 um: a smaller one is that of a mode or of another material
log = logging.getLogger("thermofem")
Ring = TypeVar("Ring", bound=Any)  # a RingResonator, which imports this module

_RATE = "amplitude rates are in 1/s (did you mean 43e9?)"
_VOLUME = "volumes are in m^3 (1 um^3 is 1e-18)"


class Number(NamedTuple):
    """A ring parameter: its unit, its allowed range (which excludes unit errors), and whether it may also be 0."""

    unit: str
    low: float
    high: float
    hint: str = ""
    zero: bool = False


FIELDS = {
    "frequency": Number("Hz", 1e13, 1e16, "did you mean 192.88e12?"),
    "bus_rate": Number("1/s", 1e6, 1e13, _RATE),
    "loss_rate": Number("1/s", 1e5, 1e13, _RATE, zero=True),
    "drop_rate": Number("1/s", 1e5, 1e13, _RATE, zero=True),
    "scattering_rate": Number("1/s", 1e5, 1e13, _RATE, zero=True),
    "refractive_index": Number("", 1, 10),
    "group_index": Number("", 1, 10),
    "thermo_optic": Number("1/K", -1e-2, 1e-2, "silicon has 1.86e-4"),
    "fca_cross_section": Number("m^2", 0, 1e-18, "cross-sections are in m^2 (1.5e-17 cm^2 is 1.5e-21)"),
    "tpa_coefficient": Number("m/W", 0, 1e-9, "0.81 cm/GW is 8.1e-12 m/W"),
    "kerr_coefficient": Number("m^2/W", -1e-15, 1e-15, "silicon has 4.5e-18 m^2/W"),
    "tpa_confinement": Number("", 0, 2),
    "tpa_volume": Number("m^3", 1e-22, 1e-12, _VOLUME),
    "fca_confinement": Number("", 0, 2),
    "fca_volume": Number("m^3", 1e-22, 1e-12, _VOLUME),
    "lumped_fcd": Number("m^3", -5e-25, 0, "it must be negative; -9.5e-21 cm^3 is -9.5e-27"),
    "index_confinement": Number("", 0.01, 3, "it is dn_eff/dn of the mode, 1.07 for a silicon strip"),
}
RATES = {
    "eta_fca": "m^3/s", "eta_tpa": "1/s/J", "g_tpa": "1/m^3/s/J^2", "thermal_shift": "rad/s/K", "kerr_shift": "rad/s/J",
}  # fmt: skip
UNITS = {  # of every number of a ring that may vary, and of every field of its carriers
    **{name: known.unit for name, known in FIELDS.items()}, **carriers.UNITS, "tau0": "s",
}  # fmt: skip
# fields of the carriers that a file writes as another quantity: its key, its unit, and the field for one of it
_OTHERWISE = {"tau": ("lifetime", "s", 1.0), "thermal_energy": ("temperature", "K", k / e)}
_KEYS = {
    **{name: known.unit for name, known in FIELDS.items()},
    "wavelength": "m", "loaded_q": "", "intrinsic_q": "", "buses": "", "absorbed_fraction": "", "perimeter": "m",
    "mode_area": "m^2", "resonance_shift": ANY, "name": TEXT, "base": TEXT, "read": TEXT, "mode": TEXT,
    "mode_wavelength": "m", "dispersion": TABLES, "carriers": TABLE, "rates": TABLE,
}  # fmt: skip
_NEEDED = (
    "frequency", "bus_rate", "loss_rate", "refractive_index", "group_index", "thermo_optic", "fcd",
    "fca_cross_section", "tpa_coefficient", "tpa_confinement", "tpa_volume", "fca_confinement", "fca_volume",
    "carriers",
)  # fmt: skip


def checked(name: str, value: Any) -> float:
    """Check a field of a ring: return it as a float, or raise InputError if it is out of its range."""
    known = FIELDS[name]
    if known.zero and value == 0:
        return float(value)
    return checks.between(name, value, known.low, known.high, unit=known.unit, hint=known.hint)


def read_text(text: str, ring: type[Ring], published: Mapping[str, Callable[[], Ring]]) -> Ring:
    """Parse the text of a ring file and return the ring.

    ring [type]: `RingResonator`.
    published: functions returning the rings that "base" may name.
    """
    table = files.from_toml(text)
    found = read_table(table, _KEYS, "the ring file")
    name = found.pop("name", None)
    terms = found.pop("dispersion", None)
    law = found.pop("carriers", None)
    rates = read_table(found.pop("rates", {}), RATES, "[rates]")
    source = found.pop("base", None)
    base = None if source is None else published[checks.choice("base", source, published)]()
    _resolve(found, rates, None if base is None else base.frequency)
    fields: dict[str, Any] = found | {"name": name or (base.name if base else "ring")}
    if terms is not None:
        keys = {"coefficient": "", "exponent": ""}
        every = [read_table(t, keys, f"[[dispersion]] {n}", required=tuple(keys)) for n, t in enumerate(terms, 1)]
        fields["fcd"] = tuple((term["coefficient"], term["exponent"]) for term in every)
    check_determined(fields, ("mode", "mode_wavelength"), ())
    if "mode" in fields:
        fields["mode"] = GuidedMode(fields["mode"], fields.pop("mode_wavelength"))
    if law is not None:
        fields["carriers"] = _carriers(law)
    if rates:
        fields["rates"] = tuple(sorted(rates.items()))
    if base:
        index = fields.get("refractive_index", SILICON[0])
        if index < SILICON[0]:
            raise InputError(
                f"refractive_index = {index:g} is below that of silicon, the core of {source}",
                "give that of the material, 3.48, not the effective index of the mode; a core of another material "
                "needs its own numbers and no base",
            )
        tell_base(str(source), base, fields)
        return replace(base, **fields)
    missing = ", ".join("[[dispersion]]" if key == "fcd" else key for key in _NEEDED if key not in fields)
    if missing:
        raise InputError(f'{missing} missing; give them, or base = "borghi2021" to take them from there')
    return ring(**fields)


def _resolve(values: dict[str, Any], rates: dict[str, float], frequency: float | None) -> None:
    """Replace wavelength, quality factors, perimeter and measured shift, in place, by the fields that they determine.

    ``frequency`` is that of the base ring in Hz.
    """
    check_determined(values, ("wavelength",), ("frequency",))
    check_determined(values, ("loaded_q", "intrinsic_q"), ("bus_rate", "drop_rate", "loss_rate", "scattering_rate"))
    check_determined(values, ("perimeter", "mode_area"), ("tpa_volume", "fca_volume"))
    check_determined(values | rates, ("resonance_shift",), ("thermal_shift",))
    if "wavelength" in values:
        hint = "1550 nm is 1.55e-6"
        values["frequency"] = c / checks.between(
            "wavelength", values.pop("wavelength"), 1e-7, 1e-4, unit="m", hint=hint
        )
    measured = values.keys() & {"loaded_q", "resonance_shift"}
    nu = checked("frequency", values.get("frequency", frequency)) if measured else math.nan
    buses = values.pop("buses", 2)
    share = values.pop("absorbed_fraction", None)
    checks.choice("buses", f"{buses:g}", ("1", "2"))
    if "loaded_q" in values:
        q = values.pop("loaded_q"), values.pop("intrinsic_q")
        values |= rates_of(nu, *q, int(buses), 1.0 if share is None else share)
    elif share is not None:
        raise InputError("absorbed_fraction goes with loaded_q and intrinsic_q; else give scattering_rate")
    elif buses == 1 and values.setdefault("drop_rate", 0.0):
        raise InputError("buses = 1 and a drop_rate are both given; a ring on one bus has none")
    if "perimeter" in values:
        values["tpa_volume"] = values["fca_volume"] = values.pop("perimeter") * values.pop("mode_area")
    if "resonance_shift" in values:
        rates["thermal_shift"] = _shift(values.pop("resonance_shift"), nu)


def check_determined(values: Container[str], given: tuple[str, ...], fields: tuple[str, ...]) -> None:
    """Raise InputError if some but not all keys ``given`` are in ``values``, or if one of the ``fields`` is too."""
    there = [key for key in given if key in values]
    if there and len(there) < len(given):
        raise InputError(f"{' and '.join(given)} belong together; give both or none")
    twice = [key for key in fields if key in values]
    if there and twice:
        raise InputError(f"{there[0]} and {twice[0]} are both given; {' and '.join(given)} determine {twice[0]}")


def rates_of(
    frequency: float, loaded_q: float, intrinsic_q: float, buses: int, absorbed_fraction: float
) -> dict[str, float]:
    """Frequency (Hz) and amplitude decay rates (1/s) of a ring from its quality factors, by field."""
    frequency = checked("frequency", frequency)
    intrinsic_q = checks.between("intrinsic_q", intrinsic_q, 10, 1e10)
    hint = "it is below intrinsic_q: coupling to the bus adds loss"
    loaded_q = checks.between("loaded_q", loaded_q, 10, intrinsic_q * (1 - 1e-9), hint=hint)
    absorbed_fraction = checks.between("absorbed_fraction", absorbed_fraction, 0, 1)
    buses = checks.integer("buses", buses, 1, 2)
    whole = pi * frequency / loaded_q
    own = pi * frequency / intrinsic_q
    bus = (whole - own) / buses
    return {
        "frequency": frequency,
        "bus_rate": bus,
        "drop_rate": bus if buses == 2 else 0.0,
        "loss_rate": absorbed_fraction * own,
        "scattering_rate": (1 - absorbed_fraction) * own,
    }


def _shift(given: Any, frequency: float) -> float:
    """Convert a measured resonance shift, text with unit m/K or Hz/K, to a thermal shift in rad/s/K."""
    try:
        return 2 * pi * quantity.parse(given, "Hz/K", name="resonance_shift")
    except InputError:
        moved = quantity.parse(given, "m/K", name="resonance_shift")
        return 2 * pi * frequency**2 / c * checks.between("resonance_shift", moved, -1e-8, 1e-8, unit="m/K")


def tell_base(name: str, base: Any, own: Container[str]) -> None:
    """Log the names of the fields that a ring takes from its base, all but ``own``."""
    taken = [key for key in (*FIELDS, "fcd", "carriers") if key not in own and getattr(base, key) is not None]
    log.warning("ring: taken from base %s: %s", name, ", ".join(taken))


def write_text(ring: Any, comments: Mapping[str, str]) -> str:
    """The text of a ring file, with a comment on each field; reading the text returns the ring."""

    def line(key: str, value: Any, of: str) -> str:
        comment = one_line(comments.get(of, ""))
        text = f"{key} = {value}"
        return f"{text:<40}  # {comment}\n" if comment else f"{text}\n"

    text = f"name = {json.dumps(ring.name)}\n"
    if ring.read != CORE:
        text += line("read", json.dumps(ring.read), "read")
    if ring.mode is not None:
        text += f"mode = {json.dumps(ring.mode.name)}\n"
        text += f"mode_wavelength = {json.dumps(quantity.write(ring.mode.wavelength, 'm'))}\n"
    for key, (unit, *_) in FIELDS.items():
        value = getattr(ring, key)
        if value is not None:
            text += line(key, json.dumps(quantity.write(value, unit)) if unit else repr(float(value)), key)
    for coefficient, exponent in ring.fcd:
        text += f"\n[[dispersion]]\n{line('coefficient', repr(coefficient), 'fcd')}exponent = {exponent!r}\n"
    text += "\n[carriers]\n"
    for name in [one.name for one in dataclasses.fields(ring.carriers)]:
        key, unit, one = _key(name)
        text += line(key, json.dumps(quantity.write(getattr(ring.carriers, name) / one, unit)), "carriers")
    if ring.rates:
        text += "\n[rates]\n" + "".join(
            line(key, json.dumps(quantity.write(value, RATES[key])), "rates") for key, value in ring.rates
        )
    return text


def _key(name: str) -> tuple[str, str, float]:
    """Of a field of a carrier law: its key in [carriers], the unit of the key, and the field's value for one unit."""
    return _OTHERWISE.get(name, (name, carriers.UNITS[name], 1.0))


def _carriers(item: dict[str, Any]) -> carriers.CarrierLaw:
    field_of = {_key(name)[0]: name for name in carriers.UNITS}
    law = carriers.law_with([field_of.get(key, "") for key in item])
    keys = {one.name: _key(one.name) for one in dataclasses.fields(law)}
    needed = [keys[one.name][0] for one in dataclasses.fields(law) if one.default is MISSING]
    units = {key: unit for key, unit, _ in keys.values()}
    given = read_table(item, units, f"[carriers] of {law.__name__}", required=needed)
    made: carriers.CarrierLaw = law(**{name: given[key] * one for name, (key, _, one) in keys.items() if key in given})
    return made
