"""Named materials, each value with its source, and how the geometry file writes a property.

Values hold near 300 K; the materials whose name ends in (T) carry laws of temperature too. Thin films differ from bulk
and from run to run: ``source`` says what the number is and what range the literature gives; where it matters, override
it with a measured value in the geometry file, a plain one or a table with a law of temperature:

    conductivity = "130 W/m/K"
    conductivity = { value = "130 W/m/K", exponent = -1.3, reference = "300 K" }
    conductivity = { value = "1.38 W/m/K", polynomial = [1.3e-3, -1e-6], reference = "300 K" }
    conductivity = { temperature = ["300 K", "400 K"], values = ["148 W/m/K", "98.9 W/m/K"] }
    conductivity = { r = "60 W/m/K", z = "30 W/m/K" }
    specific_heat = { value = "700 J/kg/K", exponent = 0.5 }

``value`` holds along and across the layers; ``r`` and ``z``, given together, along and across them. The polynomial
begins with its coefficient in 1/K. A table has the value of its curve at ``reference``; a value beside it must be that.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from .. import checks
from ..checks import InputError
from ..data import quantity
from .material_laws import CONSTANT, INDEX_LAWS, IndexLaw, Law, Polynomial, PowerLaw, Table, check_positive, is_constant

VOID = "void"  # the name of what is not there: never meshed, its walls insulated


@dataclass(frozen=True)
class Material:
    """A material that conducts and stores heat.

        k(T) = conductivity * f_k(T),    rho c_p(T) = density * specific_heat * f_c(T)

    with laws f that are 1 at their reference temperature, and a flux k_r dT/dr, k_z dT/dz where the two differ.

    Parameters
    ----------
    name : str
    conductivity : float, W/m/K
        along r (and z, unless ``conductivity_z`` says otherwise).
    density : float, kg/m^3
    specific_heat : float, J/kg/K
    source : str
        where the values come from and how far they can be trusted.
    conductivity_law, specific_heat_law : PowerLaw, Polynomial or Table
        see `material_laws`; constant by default, ``PowerLaw(-1.3)`` for the conductivity of bulk silicon.
    conductivity_z : float, W/m/K
        along z; None where it is the same. The law holds for both directions.
    index : Sellmeier or IndexTable
        refractive index over wavelength (`thermofem.materials.material_laws`); None where light must not go.
    thermo_optic : float, 1/K
        dn/dT; None where it is not known.
    two_photon, kerr : float, m/W and m^2/W
        coefficient of two-photon absorption, and n_2.
    resistivity : float, ohm m
        of a heater; None for what carries no current.

    Raises
    ------
    InputError
        a value that is not positive or far outside what any solid or gas has.
    """

    name: str
    conductivity: float
    density: float
    specific_heat: float
    source: str = ""
    conductivity_law: Law = CONSTANT
    specific_heat_law: Law = CONSTANT
    conductivity_z: float | None = None
    index: IndexLaw | None = None
    thermo_optic: float | None = None
    two_photon: float = 0.0
    kerr: float = 0.0
    resistivity: float | None = None

    def __post_init__(self) -> None:
        checks.plain(self)
        of = f"material {checks.text('name', self.name)!r}: "
        if self.name == VOID:
            if (self.conductivity, self.density, self.specific_heat) != (0, 0, 0):
                raise InputError(f"{of}void is not a material, it cannot have properties; take another name")
            return
        checks.between(f"{of}conductivity", self.conductivity, 1e-4, 1e4, unit="W/m/K", hint="silicon has 130 W/m/K")
        checks.between(f"{of}density", self.density, 1e-2, 3e4, unit="kg/m^3", hint="silicon has 2330 kg/m^3")
        checks.between(f"{of}specific_heat", self.specific_heat, 10, 2e4, unit="J/kg/K", hint="silicon has 700 J/kg/K")
        if self.conductivity_z is not None:
            checks.between(f"{of}conductivity_z", self.conductivity_z, 1e-4, 1e4, unit="W/m/K")
        if self.thermo_optic is not None:
            checks.between(f"{of}thermo_optic", self.thermo_optic, -1e-2, 1e-2, unit="1/K", hint="silicon has 1.86e-4")
        checks.between(f"{of}two_photon", self.two_photon, 0, 1e-9, unit="m/W", hint="0.8 cm/GW is 8e-12 m/W")
        if self.resistivity is not None:
            hint = "titanium nitride has 4e-7 to 4e-6 ohm m"
            checks.between(f"{of}resistivity", self.resistivity, 1e-9, 1e3, unit="ohm*m", hint=hint)
        checks.between(f"{of}kerr", self.kerr, -1e-15, 1e-15, unit="m^2/W", hint="silicon has 4.5e-18 m^2/W")

    @property
    def varies(self) -> bool:
        """Whether conductivity or specific heat depend on temperature."""
        return not (is_constant(self.conductivity_law) and is_constant(self.specific_heat_law))

    @property
    def heat_capacity(self) -> float:
        """Volumetric heat capacity rho c_p in J/m^3/K."""
        return self.density * self.specific_heat

    def at(self, T: float) -> tuple[float, float, float]:
        """k along the layers and across them in W/(m K), and rho c_p in J/(m^3 K), at a temperature in K."""
        factors = []
        for law in (self.conductivity_law, self.specific_heat_law):
            factor = law.factor(T)
            check_positive(law, T, factor)
            factors.append(float(factor))
        of_k, of_c = factors
        across = self.conductivity if self.conductivity_z is None else self.conductivity_z
        return self.conductivity * of_k, across * of_k, self.heat_capacity * of_c

    @property
    def diffusivity(self) -> float:
        """k/(rho c_p) in m^2/s."""
        return self.conductivity / self.heat_capacity


_INCROPERA = "Incropera, DeWitt, Bergman and Lavine, Fundamentals of Heat and Mass Transfer (Wiley), table A.1"


_SILICON_LIGHT: dict[str, Any] = {
    "index": INDEX_LAWS["Si, Salzberg 1957"],
    "thermo_optic": 1.86e-4,  # 1/K; Borghi et al., Opt. Express 29, 4363 (2021), from Johnson et al. 2006
    "two_photon": 7.9e-12,  # m/W at 1.54 um; Dinu, Quochi and Garcia, Appl. Phys. Lett. 82, 2954 (2003)
    "kerr": 4.5e-18,  # m^2/W, the same
}
_SILICA_LIGHT: dict[str, Any] = {
    "index": INDEX_LAWS["SiO2, Malitson 1965"],
    "thermo_optic": 0.95e-5,  # 1/K near 1.55 um; Leviton and Frey, Proc. SPIE 6273, 62732K (2006)
    "kerr": 2.6e-20,  # m^2/W; Agrawal, Nonlinear Fiber Optics (Academic), a typical value
}


def silicon_film(thickness: float) -> Material:
    """Crystalline silicon of a thickness near the mean free path of its phonons, which the surfaces cut short.

        k = 148 W/m/K / (1 + x),  x = 3 L/(8 thickness),  L = 300 nm,    k(T) ~ T^(-1.3/(1 + x))

    The estimate of kinetic theory for surfaces that scatter diffusely, in the form that joins thick to thin films, with
    L a typical value (100 to 300 nm are in use). It gives 70 W/m/K at 100 nm and 22 at 20 nm; for measured films see Ju
    and Goodson, Appl. Phys. Lett. 74, 3005 (1999), and Liu and Asheghi, Appl. Phys. Lett. 84, 3819 (2004). Doping and
    etched sidewalls reduce it further: good to some 20 %.

    Parameters
    ----------
    thickness : float, m
        5 nm to 1 mm.

    Returns
    -------
    Material
        density and specific heat are those of bulk silicon.

    Raises
    ------
    InputError
        a thickness outside this range.

    >>> round(silicon_film(220e-9).conductivity)
    98
    """
    x = 3 * 300e-9 / (8 * checks.between("thickness", thickness, 5e-9, 1e-3, unit="m"))
    return Material(
        f"Si {thickness * 1e9:.3g} nm",
        conductivity=148.0 / (1 + x),
        density=2330.0,
        specific_heat=712.0,
        source=f"148 W/m/K of bulk silicon ({_INCROPERA}) reduced by surface scattering, k/(1 + 3 L/(8 d)), with L = "
        "300 nm, a typical mean free path (100..300 nm); an estimate, good to some 20 %",
        conductivity_law=PowerLaw(-1.3 / (1 + x)),
        **_SILICON_LIGHT,
    )


LIBRARY: dict[str, Material] = {
    material.name: material
    for material in (
        Material(
            "Si",
            conductivity=130.0,
            density=2330.0,
            specific_heat=700.0,
            source="crystalline silicon: 700 J/kg/K is that of Borghi et al., Opt. Express 29, 4363 (2021), appendix"
            " A; 130 W/m/K is a typical value, range 130..148; bulk at 300 K has 148 W/m/K, 2330 kg/m^3, 712 "
            f"J/kg/K ({_INCROPERA}); films conduct less, see silicon_film",
            **_SILICON_LIGHT,
        ),
        Material(
            "SiO2",
            conductivity=1.38,
            density=2203.0,
            specific_heat=703.0,
            source='fused silica: the values of "Silica glass" in the material library of COMSOL Multiphysics, the'
            " solver of Borghi et al., Opt. Express 29, 4363 (2021); deposited oxides conduct less, typical "
            "range 1.0..1.4 W/m/K",
            **_SILICA_LIGHT,
        ),
        Material(
            "air",
            conductivity=0.0263,
            density=1.1614,
            specific_heat=1007.0,
            source="dry air at 300 K and 1 atm: typical values, range 0.0257..0.0264 W/m/K, 1.16..1.18 kg/m^3, "
            "1004..1007 J/kg/K",
            index=INDEX_LAWS["air"],
            thermo_optic=0.0,  # 1/K; -9e-7 at constant pressure
        ),
        Material(VOID, conductivity=0.0, density=0.0, specific_heat=0.0, source="not meshed; its walls are insulated"),
        Material(
            "TiN",
            conductivity=19.2,
            density=5400.0,
            specific_heat=545.0,
            source="typical values: 11.9 W/m/K and 545 J/kg/K in models of thin electrodes to 29 W/m/K of the bulk "
            "at 323 K and 600 J/kg/K; 5210 kg/m^3 (CRC Handbook of Chemistry and Physics, 97th ed.) to 5440; "
            "measure your film",
        ),
        Material(
            "Si(T)",
            conductivity=148.0,
            density=2330.0,
            specific_heat=712.0,
            source=f"bulk crystal from 200 to 800 K: {_INCROPERA}",
            conductivity_law=Table((200, 300, 400, 600, 800), (264, 148, 98.9, 61.9, 42.2)),
            specific_heat_law=Table((200, 300, 400, 600, 800), (556, 712, 790, 867, 913)),
            **_SILICON_LIGHT,
        ),
        Material(
            "SiO2(T)",
            conductivity=1.38,
            density=2220.0,
            specific_heat=745.0,
            source="fused silica, typical values from 200 to 800 K as heat-transfer textbooks give them; at 300 K "
            "the CRC Handbook of Chemistry and Physics has 1.4 W/m/K and 2196 kg/m^3; c_p below 300 K held at"
            " 745",
            conductivity_law=Table((200, 300, 400, 600, 800), (1.14, 1.38, 1.51, 1.75, 2.17)),
            specific_heat_law=Table((300, 400, 600, 800), (745, 905, 1040, 1105)),
            **_SILICA_LIGHT,
        ),
        silicon_film(220e-9),
        Material(
            "Al",
            conductivity=237.0,
            density=2702.0,
            specific_heat=903.0,
            source=f"pure bulk metal at 300 K: {_INCROPERA}; films conduct less: 94 W/m/K at 140 nm (Stojanovic et "
            "al., J. Microelectromech. Syst. 16, 1269 (2007))",
        ),
        Material(
            "Si3N4",
            conductivity=2.1,
            density=3100.0,
            specific_heat=700.0,
            source="2.1 W/m/K: film of 180 nm, Stojanovic et al., J. Microelectromech. Syst. 16, 1269 (2007); "
            "density and heat capacity: material library of COMSOL Multiphysics; across an amorphous LPCVD "
            "film 1.6 W/m/K, dense ceramic 20",
            index=INDEX_LAWS["Si3N4, Luke 2015"],
            thermo_optic=2.45e-5,  # 1/K; Arbabi and Goddard, Opt. Lett. 38, 3878 (2013)
            kerr=2.4e-19,  # m^2/W; Ikeda et al., Opt. Express 16, 12987 (2008)
        ),
    )
}


def find(name: str, overrides: Iterable[Material] = (), *, what: str = "material") -> Material:
    """The material called ``name``: from ``overrides`` first, then from `LIBRARY`.

    Raises InputError: no such material; the nearest name is suggested and ``what`` says where it was asked for.

    >>> find("Si").conductivity
    130.0
    """
    known = LIBRARY | {material.name: material for material in overrides}
    return known[checks.choice(what, name, known, hint="add it in a [material.NAME] table")]


SAME_VALUE = 1e-9  # relative; a value beside a table is that of its curve within round-off
PROPERTIES = ("conductivity", "density", "specific_heat")
_COMMON = {"exponent": "", "reference": "K", "polynomial": "anything", "temperature": "anything", "values": "anything"}
LAW_KEYS = {
    "conductivity": {"value": "W/m/K", "r": "W/m/K", "z": "W/m/K", **_COMMON},
    "specific_heat": {"value": "J/kg/K", **_COMMON},
}


def read_property(key: str, given: Any, unit: str, where: str) -> dict[str, Any]:
    """Fields of a Material from one property: text with a unit, or a table whose plain values are in SI already.

    Raises InputError: a value is missing, or given twice with different numbers; two laws at once.
    """
    of = f"{where} {key}"
    if not isinstance(given, dict):
        given = {"value": quantity.parse(given, unit, name=of)}
    value = given.get("value", given.get("r"))
    name = "r" if "z" in given else "value"
    with checks.prefixed(of):
        law = _law(given, unit, of)
        for broken, rule in (
            ({"value", "r"} <= given.keys(), "value and r are the same; give one of them"),
            ("r" in given and "z" not in given, "z is missing; r is along the layers alone: add z, or call r value"),
            (value is None and not isinstance(law, Table), f'{name} is missing; add {name} = "..."'),
        ):
            if broken:
                raise InputError(rule)
    if isinstance(law, Table):
        value = _of_table(law, value, unit, f"{of}: {'r' if 'r' in given else 'value'}")
    values = {key: value, f"{key}_law": law}
    return values | {"conductivity_z": given.get("z")} if key == "conductivity" else values


def _of_table(law: Table, value: float | None, unit: str, name: str) -> float:
    """Value of a property that a table gives; InputError where ``value`` is given beside it and differs."""
    of_table = float(law.value(law.reference))
    if value is None:
        return of_table
    if math.isclose(value, of_table, rel_tol=SAME_VALUE):
        return value
    beside = quantity.write(value, unit)
    there = quantity.rounded(of_table, unit, 6)
    raise InputError(f"{name} = {beside}, but the table has {there} at {law.reference:g} K; leave it out")


def with_value(key: str, given: dict[str, Any], text: str) -> dict[str, Any]:
    """Table of a property as texts, with another value; its law is kept, so that a table of temperatures is scaled."""
    rest = {name: one for name, one in given.items() if name not in ("value", "r")}
    if "values" not in rest:
        return {**rest, "value": text}
    unit = LAW_KEYS[key]["value"]
    reference = {"reference": quantity.parse(rest["reference"], "K", name=key)} if "reference" in rest else {}
    law = _law({**rest, **reference}, unit, key)
    return {**rest, "value": text, "values": _written(law, quantity.parse(text, unit, name=key), unit)}


def _written(law: Any, value: float, unit: str) -> list[str]:
    """Values of a temperature table as text, scaled so that the property has ``value`` at the reference temperature."""
    own = float(law.value(law.reference))
    scale = 1.0 if math.isclose(value, own, rel_tol=SAME_VALUE) else value / own
    return [quantity.write(v * scale, unit) for v in law.values]


def _law(given: dict[str, Any], unit: str, of: str) -> Law:
    kinds = {"exponent", "polynomial", "temperature", "values"} & given.keys()
    reference = {"reference": given["reference"]} if "reference" in given else {}
    if kinds == {"temperature", "values"}:
        T = _list(given["temperature"], "K", f"{of}: temperature")
        return Table(T, _list(given["values"], unit, f"{of}: values"), **reference)
    if kinds == {"polynomial"}:
        return Polynomial(_list(given["polynomial"], None, f"{of}: polynomial"), **reference)
    if kinds <= {"exponent"}:
        law = PowerLaw(given.get("exponent", 0.0), **reference)
        return law if kinds else CONSTANT
    raise InputError(
        f"{of}: give exponent, or polynomial, or temperature with values (given: {', '.join(sorted(kinds))})"
    )


def _list(given: Any, unit: str | None, name: str) -> tuple[float, ...]:
    checks.instance(name, given, list, hint="a list is needed")
    if unit is None:
        return tuple(checks.finite(name, item) for item in given)
    return tuple(quantity.parse(item, unit, name=name) for item in given)


def write_property(material: Material, key: str, unit: str) -> str | dict[str, Any]:
    """One property as the file's text or table; reading it back gives exactly the same property.

    A `Table` with values in proportion to those of the property is written with the property's own values.
    """
    value = getattr(material, key)
    law = getattr(material, f"{key}_law")
    items: dict[str, Any] = {"value": quantity.write(value, unit)}
    if key == "conductivity" and material.conductivity_z is not None:
        items["z"] = quantity.write(material.conductivity_z, unit)
    if isinstance(law, PowerLaw) and law != CONSTANT:
        items["exponent"] = law.exponent
    elif isinstance(law, Polynomial):
        items["polynomial"] = list(law.coefficients)
    elif isinstance(law, Table):
        items["temperature"] = [quantity.write(T, "K") for T in law.temperatures]
        items["values"] = _written(law, value, unit)
    return items["value"] if len(items) == 1 else {**items, "reference": quantity.write(law.reference, "K")}
