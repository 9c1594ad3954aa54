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
drop_rate = "40e9 1/s"           # scattering_rate: as the fields of RingResonator

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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

from thermofem import checks, quantity, toml_file
from thermofem.checks import InputError
from thermofem.constants import c, e, k

from .carriers import ShockleyReadHall
from .lifetime import ConstantLifetime

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
}
_MEASURED = {
    "wavelength": "m",
    "loaded_q": "",
    "intrinsic_q": "",
    "buses": "",
    "absorbed_fraction": "",
    "perimeter": "m",
    "mode_area": "m^2",
}
_TEXT = {"name": "text", "base": "text", "dispersion": "tables", "carriers": "table", "rates": "table"}
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
    table = toml_file.parse(text)
    if table.keys() & {"layer", "part", "outer_radius"}:
        raise InputError(
            "this describes a cross-section; a ring file holds the optics: Q factors, perimeter, mode area"
        )
    for key in table:
        checks.choice("the ring file: key", key, _FIELDS | _MEASURED | _TEXT)
    for key in ("name", "base"):
        if not isinstance(table.get(key, ""), str):
            raise InputError(f"{key} = {table[key]!r} must be text")
    values = _quantities(table, _FIELDS | _MEASURED, "the ring file", skip=tuple(_TEXT))
    base = published[checks.choice("base", table["base"], published)]() if "base" in table else None
    _resolve(values, base or next(iter(published.values()))(), None if base is None else base.frequency)
    values["name"] = table.get("name", base.name if base else "ring")
    if "dispersion" in table:
        values["fcd"] = _dispersion(table["dispersion"])
    if "carriers" in table:
        values["carriers"] = _carriers(table["carriers"])
    if "rates" in table:
        given = _quantities(_table(table["rates"], "[rates]"), _RATES, "[rates]")
        values["rates"] = tuple(sorted(given.items()))
    if base:
        return replace(base, **values)
    missing = [key for key in _NEEDED if key not in values]
    if missing:
        names = ", ".join("[[dispersion]]" if key == "fcd" else key for key in missing)
        raise InputError(f'{names} missing; give them, or base = "borghi2021" to take them from there')
    return ring(**values)


def _resolve(values: dict[str, Any], template: Any, frequency: float | None) -> None:
    """Replace wavelength, quality factors and perimeter by the fields that they determine.

    ``template`` is any ring; only its method `from_quality_factors` is used. ``frequency`` is that of the base ring.
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
    if "loaded_q" in values:
        frequency = values.get("frequency", frequency)
        if frequency is None:
            raise InputError("frequency or wavelength is missing; quality factors need it")
        rates = type(template).from_quality_factors(
            template, name="", frequency=frequency, loaded_q=values.pop("loaded_q"),
            intrinsic_q=values.pop("intrinsic_q"), buses=buses, absorbed_fraction=1.0 if share is None else share,
        )  # fmt: skip
        for key in ("frequency", "bus_rate", "drop_rate", "loss_rate", "scattering_rate"):
            values[key] = getattr(rates, key)
    elif buses not in (1, 2):
        raise InputError(f"buses = {buses!r} must be 1 or 2")
    elif share is not None:
        raise InputError("absorbed_fraction goes with loaded_q and intrinsic_q; else give scattering_rate")
    elif buses == 1 and values.setdefault("drop_rate", 0.0):
        raise InputError("buses = 1 and a drop_rate are both given; a ring on one bus has none")
    if "perimeter" in values:
        volume = values.pop("perimeter") * values.pop("mode_area")
        values["tpa_volume"] = values["fca_volume"] = volume


def _together(values: dict[str, Any], first: str, second: str, instead_of: tuple[str, ...]) -> None:
    """Raise InputError where one key of a pair is missing, or a key is given that the pair determines."""
    if (first in values) != (second in values):
        raise InputError(f"{first} and {second} belong together; give both or none")
    twice = [key for key in instead_of if key in values]
    if first in values and twice:
        raise InputError(f"{first} and {twice[0]} are both given; {first} and {second} determine {twice[0]}")


def _dispersion(items: Any) -> tuple[tuple[float, float], ...]:
    if not isinstance(items, list):
        raise InputError("dispersion must be tables, each opened by a line [[dispersion]]")
    terms = []
    for count, item in enumerate(items, 1):
        where = f"[[dispersion]] {count}"
        values = _quantities(_table(item, where), _DISPERSION, where, required=("coefficient", "exponent"))
        terms.append((values["coefficient"], values["exponent"]))
    return tuple(terms)


def _carriers(item: Any) -> ShockleyReadHall | ConstantLifetime:
    values = _quantities(_table(item, "[carriers]"), _CARRIERS, "[carriers]")
    if "lifetime" in values:
        if len(values) > 1:
            raise InputError(f"[carriers]: lifetime and {sorted(values.keys() - {'lifetime'})[0]} exclude each other")
        return ConstantLifetime(values["lifetime"])
    for key in _SRH:
        if key not in values:
            raise InputError(f"[carriers]: {key} is missing; or give a constant lifetime")
    return ShockleyReadHall(thermal_energy=k * values.pop("temperature") / e, **values)


def _table(item: Any, where: str) -> dict[str, Any]:
    if not isinstance(item, dict):
        raise InputError(f"{where} = {item!r} must be a table")
    return item


def _quantities(
    table: dict[str, Any], units: dict[str, str], where: str, required: Sequence[str] = (), skip: Sequence[str] = ()
) -> dict[str, Any]:
    """The values of one table in SI."""
    for key in table:
        if key not in skip:
            checks.choice(f"{where}: key", key, units)
    for key in required:
        if key not in table:
            raise InputError(f"{where}: {key} is missing")
    return {
        key: quantity.parse(value, units[key], name=f"{where}: {key}") for key, value in table.items() if key in units
    }
