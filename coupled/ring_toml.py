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

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Container, Mapping
from dataclasses import replace
from typing import Any, TypeVar

from scipy.constants import c, e, k, pi

from thermofem import checks
from thermofem.checks import InputError
from thermofem.data import files, quantity
from thermofem.data.files import ANY, TABLE, TABLES, TEXT, read_table
from thermofem.errors import one_line

from .carriers.lifetime import ConstantLifetime
from .carriers.shockley_read_hall import ShockleyReadHall

SILICON = (3.0, 4.0)  # refractive index near 1.55 um: a smaller one is that of a mode or of another material
log = logging.getLogger("thermofem")
Ring = TypeVar("Ring", bound=Any)  # a RingResonator, which imports this module

_FIELDS = {
    "frequency": "Hz",
    "bus_rate": "1/s",
    "loss_rate": "1/s",
    "drop_rate": "1/s",
    "scattering_rate": "1/s",
    "refractive_index": "",
    "group_index": "",
    "thermo_optic": "1/K",
    "fca_cross_section": "m^2",
    "tpa_coefficient": "m/W",
    "kerr_coefficient": "m^2/W",
    "tpa_confinement": "",
    "tpa_volume": "m^3",
    "fca_confinement": "",
    "fca_volume": "m^3",
    "lumped_fcd": "m^3",
    "index_confinement": "",
}
_MEASURED = {
    "wavelength": "m",
    "loaded_q": "",
    "intrinsic_q": "",
    "buses": "",
    "absorbed_fraction": "",
    "perimeter": "m",
    "mode_area": "m^2",
    "resonance_shift": ANY,
}
_OTHERS = {"name": TEXT, "base": TEXT, "dispersion": TABLES, "carriers": TABLE, "rates": TABLE}
_DISPERSION = {"coefficient": "", "exponent": ""}
_SRH = {
    "tau_n": "s",
    "tau_p": "s",
    "intrinsic_density": "1/m^3",
    "hole_density": "1/m^3",
    "trap_energy": "eV",
    "temperature": "K",
}
_CARRIERS = {"lifetime": "s"} | _SRH
_RATES = {
    "eta_fca": "m^3/s",
    "eta_tpa": "1/s/J",
    "g_tpa": "1/m^3/s/J^2",
    "thermal_shift": "rad/s/K",
    "kerr_shift": "rad/s/J",
}
UNITS = {**_FIELDS, **_SRH, "thermal_energy": "eV", "tau": "s", "tau0": "s"}  # of every number of a ring that may vary
_NEEDED = (
    "frequency", "bus_rate", "loss_rate", "refractive_index", "group_index", "thermo_optic", "fcd",
    "fca_cross_section", "tpa_coefficient", "tpa_confinement", "tpa_volume", "fca_confinement", "fca_volume",
    "carriers",
)  # fmt: skip


def read_text(text: str, ring: type[Ring], published: Mapping[str, Callable[[], Ring]]) -> Ring:
    """Read the text of a ring file.

    ring [type]: `RingResonator`.
    published: the rings that "base" may name.
    """
    table = files.from_toml(text)
    if table.keys() & {"layer", "part", "outer_radius"}:
        raise InputError(
            "this describes a cross-section; a ring file holds the optics: Q factors, perimeter, mode area"
        )
    found = read_table(table, _FIELDS | _MEASURED | _OTHERS, "the ring file")
    base = published[checks.choice("base", found["base"], published)]() if "base" in found else None
    fields = {key: value for key, value in found.items() if key not in _OTHERS}
    _resolve(fields, None if base is None else base.frequency)
    fields["name"] = found.get("name", base.name if base else "ring")
    if "dispersion" in found:
        terms = [read_table(t, _DISPERSION, f"[[dispersion]] {n}", required=tuple(_DISPERSION))
                 for n, t in enumerate(found["dispersion"], 1)]  # fmt: skip
        fields["fcd"] = tuple((term["coefficient"], term["exponent"]) for term in terms)
    if "carriers" in found:
        fields["carriers"] = _carriers(found["carriers"])
    rates = read_table(found.get("rates", {}), _RATES, "[rates]")
    if "resonance_shift" in found:
        if "thermal_shift" in rates:
            raise InputError("resonance_shift and thermal_shift are both given; one determines the other")
        rates["thermal_shift"] = _shift(
            fields.pop("resonance_shift"), fields.get("frequency") or (base and base.frequency)
        )
    if rates:
        fields["rates"] = tuple(sorted(rates.items()))
    if base:
        _check_base(found["base"], base, fields)
        return replace(base, **fields)
    missing = [key for key in _NEEDED if key not in fields]
    if missing:
        names = ", ".join("[[dispersion]]" if key == "fcd" else key for key in missing)
        raise InputError(f'{names} missing; give them, or base = "borghi2021" to take them from there')
    return ring(**fields)


def _resolve(values: dict[str, Any], frequency: float | None) -> None:
    """Replace wavelength, quality factors and perimeter by the fields that they determine.

    ``frequency`` is that of the base ring.
    """
    if "wavelength" in values:
        if "frequency" in values:
            raise InputError("wavelength and frequency are both given; one determines the other")
        values["frequency"] = c / checks.between(
            "wavelength", values.pop("wavelength"), 1e-7, 1e-4, unit="m", hint="1550 nm is 1.55e-6"
        )
    _together(values, "loaded_q", "intrinsic_q", ("bus_rate", "drop_rate", "loss_rate", "scattering_rate"))
    _together(values, "perimeter", "mode_area", ("tpa_volume", "fca_volume"))
    buses, share = values.pop("buses", 2), values.pop("absorbed_fraction", None)
    if buses not in (1, 2):
        raise InputError(f"buses = {buses:g} must be 1 or 2")
    if "loaded_q" in values:
        frequency = values.get("frequency", frequency)
        if frequency is None:
            raise InputError("frequency or wavelength is missing; quality factors need it")
        values |= rates_of(
            frequency, values.pop("loaded_q"), values.pop("intrinsic_q"), int(buses), 1.0 if share is None else share
        )
    elif share is not None:
        raise InputError("absorbed_fraction goes with loaded_q and intrinsic_q; else give scattering_rate")
    elif buses == 1 and values.setdefault("drop_rate", 0.0):
        raise InputError("buses = 1 and a drop_rate are both given; a ring on one bus has none")
    if "perimeter" in values:
        volume = values.pop("perimeter") * values.pop("mode_area")
        values["tpa_volume"] = values["fca_volume"] = volume


def rates_of(
    frequency: float, loaded_q: float, intrinsic_q: float, buses: int, absorbed_fraction: float
) -> dict[str, float]:
    """The frequency and the amplitude rates of a ring with these quality factors, by field."""
    frequency = checks.between("frequency", frequency, 1e13, 1e16, unit="Hz", hint="did you mean 192.88e12?")
    loaded_q = checks.between("loaded_q", loaded_q, 10, 1e10)
    intrinsic_q = checks.between("intrinsic_q", intrinsic_q, 10, 1e10)
    absorbed_fraction = checks.between("absorbed_fraction", absorbed_fraction, 0, 1)
    buses = checks.integer("buses", buses, 1, 2)
    if loaded_q >= intrinsic_q:
        raise InputError(
            f"loaded_q = {loaded_q:g} must be smaller than intrinsic_q = {intrinsic_q:g}: coupling to the bus adds loss"
        )
    whole, own = pi * frequency / loaded_q, pi * frequency / intrinsic_q
    bus = (whole - own) / buses
    return {
        "frequency": frequency,
        "bus_rate": bus,
        "drop_rate": bus if buses == 2 else 0.0,
        "loss_rate": absorbed_fraction * own,
        "scattering_rate": (1 - absorbed_fraction) * own,
    }


def _shift(given: Any, frequency: float | None) -> float:
    """rad/s/K of a measured shift of the resonance, as a length or a frequency per kelvin."""
    if frequency is None:
        raise InputError("frequency or wavelength is missing; resonance_shift needs it")
    try:
        return 2 * pi * quantity.parse(given, "Hz/K", name="resonance_shift")
    except InputError:
        moved = quantity.parse(given, "m/K", name="resonance_shift")
        return 2 * pi * frequency**2 / c * checks.between("resonance_shift", moved, -1e-8, 1e-8, unit="m/K")


def _check_base(name: str, base: Any, fields: dict[str, Any]) -> None:
    """Log what a file takes from its base; InputError for an effective index in place of silicon's."""
    index = fields.get("refractive_index")
    if index is not None and index < SILICON[0]:
        raise InputError(
            f"refractive_index = {index:g} is below that of silicon, the core of {name}",
            "give that of the material, 3.48, not the effective index of the mode; a core of another material needs "
            "its own numbers and no base",
        )
    tell_base(name, base, fields)


def tell_base(name: str, base: Any, own: Container[str]) -> None:
    """Log what a ring takes from a base: all fields but its own."""
    taken = [key for key in (*_FIELDS, "fcd", "carriers") if key not in own and getattr(base, key) is not None]
    log.warning("ring: taken from base %s: %s", name, ", ".join(taken))


def write_text(ring: Any, comments: Mapping[str, str]) -> str:
    """The text of a ring file, each number with its comment; reading it back gives the ring."""

    def line(key: str, value: Any, of: str) -> str:
        comment = one_line(comments.get(of, ""))
        text = f"{key} = {value}"
        return f"{text:<40}  # {comment}\n" if comment else f"{text}\n"

    text = f"name = {json.dumps(ring.name)}\n"
    for key, unit in _FIELDS.items():
        value = getattr(ring, key)
        if value is not None:
            text += line(key, json.dumps(quantity.write(value, unit)) if unit else repr(float(value)), key)
    for coefficient, exponent in ring.fcd:
        text += f"\n[[dispersion]]\n{line('coefficient', repr(coefficient), 'fcd')}exponent = {exponent!r}\n"
    text += "\n[carriers]\n"
    if isinstance(ring.carriers, ConstantLifetime):
        text += line("lifetime", json.dumps(quantity.write(ring.carriers.tau, "s")), "carriers")
    else:
        srh = {**vars(ring.carriers), "temperature": ring.carriers.thermal_energy * e / k}
        for key, unit in _SRH.items():
            text += line(key, json.dumps(quantity.write(srh[key], unit)), "carriers")
    if ring.rates:
        text += "\n[rates]\n" + "".join(
            line(key, json.dumps(quantity.write(value, _RATES[key])), "rates") for key, value in ring.rates
        )
    return text


def _together(values: dict[str, Any], first: str, second: str, instead_of: tuple[str, ...]) -> None:
    """Raise InputError where one key of a pair is missing, or a key is given that the pair determines."""
    if (first in values) != (second in values):
        raise InputError(f"{first} and {second} belong together; give both or none")
    twice = [key for key in instead_of if key in values]
    if first in values and twice:
        raise InputError(f"{first} and {twice[0]} are both given; {first} and {second} determine {twice[0]}")


def _carriers(item: Any) -> ShockleyReadHall | ConstantLifetime:
    given = read_table(item, _CARRIERS, "[carriers]")
    if "lifetime" in given:
        if len(given) > 1:
            raise InputError(f"[carriers]: lifetime and {sorted(given.keys() - {'lifetime'})[0]} exclude each other")
        return ConstantLifetime(given["lifetime"])
    for key in _SRH:
        if key not in given:
            raise InputError(f"[carriers]: {key} is missing; or give a constant lifetime")
    return ShockleyReadHall(thermal_energy=k * given.pop("temperature") / e, **given)
