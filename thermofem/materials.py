"""Named materials: thermal conductivity, density and specific heat, each value with its source.

Values hold near 300 K. Thin films differ from bulk and from run to run: ``source`` says what the number is and what
range the literature gives; where it matters, override it with a measured value in the geometry file.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from . import checks

VOID = "void"  # the name of what is not there: never meshed, its walls insulated


@dataclass(frozen=True)
class Material:
    """A material that conducts and stores heat.

        k(T) = conductivity * (T/reference)^exponent,    rho c_p = density * specific_heat

    Parameters
    ----------
    name : str
    conductivity : float, W/m/K
    density : float, kg/m^3
    specific_heat : float, J/kg/K
    source : str
        where the values come from and how far they can be trusted.
    exponent : float
        0 for a constant conductivity, about -1.3 for silicon.
    reference : float, K
        temperature at which ``conductivity`` holds.

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
    exponent: float = 0.0
    reference: float = 300.0

    def __post_init__(self) -> None:
        of = f"material {self.name!r}: "
        if self.name == VOID:
            if (self.conductivity, self.density, self.specific_heat) != (0, 0, 0):
                raise checks.InputError(f"{of}void is not a material, it cannot have properties; take another name")
            return
        checks.between(f"{of}conductivity", self.conductivity, 1e-4, 1e4, unit="W/m/K", hint="silicon has 130 W/m/K")
        checks.between(f"{of}density", self.density, 1e-2, 3e4, unit="kg/m^3", hint="silicon has 2330 kg/m^3")
        checks.between(f"{of}specific_heat", self.specific_heat, 10, 2e4, unit="J/kg/K", hint="silicon has 700 J/kg/K")
        checks.between(f"{of}exponent", self.exponent, -5, 5, hint="k(T) = k (T/reference)^exponent")
        checks.between(f"{of}reference", self.reference, 1, 3000, unit="K")

    @property
    def heat_capacity(self) -> float:
        """Volumetric heat capacity rho c_p in J/m^3/K."""
        return self.density * self.specific_heat

    @property
    def diffusivity(self) -> float:
        """k/(rho c_p) in m^2/s."""
        return self.conductivity / self.heat_capacity


_INCROPERA = "Incropera and DeWitt, Fundamentals of Heat and Mass Transfer, 4th ed. (Wiley, 1996), appendix A, 300 K"

LIBRARY: dict[str, Material] = {
    material.name: material
    for material in (
        Material(
            "Si",
            conductivity=130.0,
            density=2330.0,
            specific_heat=700.0,
            source="crystalline silicon, values of the stack of Borghi et al., Opt. Express 29, 4363 (2021); bulk at "
            "300 K has 148 W/m/K and 712 J/kg/K (Incropera and DeWitt), films near 100 nm conduct about half as well "
            "(Ju and Goodson, Appl. Phys. Lett. 74, 3005 (1999))",
        ),
        Material(
            "SiO2",
            conductivity=1.38,
            density=2203.0,
            specific_heat=703.0,
            source="fused silica, values of the stack of Borghi et al., Opt. Express 29, 4363 (2021); Incropera and "
            "DeWitt give 1.38 W/m/K, 2220 kg/m^3, 745 J/kg/K; deposited oxides conduct less, down to about 1 W/m/K",
        ),
        Material("air", conductivity=0.0263, density=1.1614, specific_heat=1007.0, source=f"{_INCROPERA}, 1 atm"),
        Material(VOID, conductivity=0.0, density=0.0, specific_heat=0.0, source="not meshed; its walls are insulated"),
        Material(
            "TiN",
            conductivity=19.2,
            density=5400.0,
            specific_heat=545.0,
            source="Pierson, Handbook of Refractory Carbides and Nitrides (Noyes, 1996): 19.2 W/m/K, 5.40 g/cm^3, "
            "33.74 J/mol/K; bulk values up to 29 W/m/K are published, sputtered films often conduct less than 19",
        ),
        Material(
            "Al",
            conductivity=237.0,
            density=2702.0,
            specific_heat=903.0,
            source=f"{_INCROPERA}, pure bulk metal; sputtered and alloyed films conduct less",
        ),
        Material(
            "Si3N4",
            conductivity=3.2,
            density=3000.0,
            specific_heat=700.0,
            source="silicon-rich LPCVD film: Mastrangelo, Tai and Muller, Sensors and Actuators A 23, 856 (1990); "
            "films range from about 1.5 to 3.5 W/m/K, dense bulk ceramic has 10 W/m/K and more",
        ),
    )
}


def find(name: str, overrides: Iterable[Material] = (), *, what: str = "material") -> Material:
    """The material called ``name``: from ``overrides`` first, then from `LIBRARY`.

    Raises
    ------
    InputError
        no such material; the nearest name is suggested and ``what`` says where it was asked for.

    >>> find("Si").conductivity
    130.0
    """
    known = LIBRARY | {material.name: material for material in overrides}
    return known[checks.choice(what, name, known, hint="add it in a [material.NAME] table")]
