"""Variables of Datasets: their units and long names, conversion to SI, and what a Dataset must hold.

Users select, join, rename and rescale Datasets. What a function needs is checked before it computes, so that the error
names the variable and not a line of NumPy's.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..checks import InputError, shown
from . import quantity

if TYPE_CHECKING:
    import xarray as xr

VOLTS = "1 V counts as 1 K"  # in the words on the assumptions of a measured trace
PER = "per unit"  # in the units of derivatives with respect to parameters
PREFIXES = ("time_", "power_", "delta_T_")  # of a campaign: the name of a drive follows


class Variable(NamedTuple):
    """Unit and long name of one variable of a Dataset."""

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
    "input": Variable("W", "power of the lasers"),
    "output": Variable("W", "power at the ports"),
    "detected": Variable("W", "power that the detectors show"),
    "mean_output": Variable("W", "power that the detectors show, averaged since the time before"),
    "phase": Variable("rad", "phase of the light at the ports, against the first laser's"),
    "lost": Variable("W", "power lost in waveguides and on the way from lasers"),
    "detuning": Variable("Hz", "laser frequency minus cold resonance"),
    "frequency": Variable("Hz", "frequency"),
    "period": Variable("s", "period"),
    "period_model": Variable("s", "period for which the model has the same swing"),
    "error": Variable("s", "period error"),
    "relative_error": Variable("1", "relative period error"),
    "duty": Variable("1", "duty cycle"),
    "swing": Variable("K", "peak-to-peak temperature rise"),
    "growth_rate": Variable("1/s", "largest real part of the eigenvalues"),
    "growing": Variable("1", "number of growing modes"),
    "regime": Variable("1", "dynamic regime"),
    "reason": Variable("1", "why, in words"),
    "S_T": Variable("K^2/Hz", "thermal noise of the temperature"),
    "S_nu": Variable("Hz^2/Hz", "thermal noise of the resonance"),
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
    "heat_capacity": Variable("J/K", "heat capacity m c_p"),
    "misfit": Variable("1", "root of the sum of squared residuals"),
    "shape_error": Variable("1", "rms difference of the cycles over the swing"),
    "leading": Variable("1", "no other mode grows"),
    "lyapunov": Variable("1/s", "first Lyapunov coefficient"),
    "jumped": Variable("1", "left its branch"),
    "extinction": Variable("dB", "extinction"),
    "drop_low": Variable("W", "lowest drop power"),
    "drop_high": Variable("W", "highest drop power"),
    "stability": Variable("1", "kind of the cycle"),
    "special": Variable("1", "where the stability changes"),
    "multipliers": Variable("1", "Floquet multipliers"),
    "fixed_points": Variable("1", "number of fixed points"),
    "stable_points": Variable("1", "number of stable fixed points"),
    "r": Variable("m", "distance from the axis of the ring"),
    "z": Variable("m", "height above the datum"),
}


def describe(name: str) -> dict[str, str]:
    """Attributes of one variable, as xarray's plots read them."""
    return {"units": VARIABLES[name].unit, "long_name": VARIABLES[name].long_name}


def variables(over: Any, columns: Mapping[str, Any], **of: str) -> dict[str, Any]:
    """Variables of a Dataset over a dimension, or several; ``of``: the names of `VARIABLES` that describe some."""
    return {name: (over, values, describe(of.get(name, name))) for name, values in columns.items()}


def known(name: str) -> Variable | None:
    """Unit and long name of a variable; None for a name that is not in `VARIABLES`."""
    if name in VARIABLES:
        return VARIABLES[name]
    for prefix in PREFIXES:
        if name.startswith(prefix) and name != prefix:
            return VARIABLES[prefix.removesuffix("_")]
    return None


def label(values: Any, name: str) -> str:
    """Axis label: name of a variable and its unit, where the Dataset has kept them."""
    unit = values.attrs.get("units")
    words = str(values.attrs.get("long_name", name))
    return f"{words} ({unit})" if unit else words


def unit_of(assumed: object) -> str:
    """Unit of the temperatures of a trace: "V" where its assumptions say that volts count as kelvin, else "K"."""
    return "V" if VOLTS in str(assumed) else "K"


def in_si(name: str, data: xr.Dataset) -> xr.Dataset:
    """The Dataset with every known variable in the unit of `VARIABLES`; no unit counts as that unit.

    name: what the Dataset is called in the error.
    Raises InputError: a unit that is no text, unknown, or of another dimension.
    """
    what = f"{name}: variable"
    changed = {}
    for key, variable in data.variables.items():
        field = known(str(key))
        if field is None or _is_derivative(str(key), variable, field.unit):
            continue
        given = variable.attrs.get("units", field.unit)
        pure = str(given) in ("", "1") and field.unit in ("", "1")
        if given is None or pure or str(given) == field.unit:
            continue
        if variable.dtype.kind not in "fiu":
            continue
        offset, factor = _line(given, field, f"{what} {key!r}: unit")
        numbers = np.asarray(variable.values, dtype=float)
        attributes = {**variable.attrs, "units": field.unit}
        changed[key] = (variable.dims, offset + factor * numbers, attributes)
    return data.assign(changed) if changed else data


def _is_derivative(name: str, variable: Any, unit: str) -> bool:
    """Whether a variable is a derivative with respect to parameters, or an energy for 1 W in a linear spectrum."""
    given = str(variable.attrs.get("units"))
    if name == "energy" and given == "J/W":
        return True
    return given.startswith(f"{unit} {PER}") and "parameter" in variable.dims


def _line(given: Any, field: Variable, name: str) -> tuple[float, float]:
    """Offset and factor that convert a unit to SI (offset 0 for a rise); InputError for a unit such as dBm."""
    unit = "" if field.unit == "1" else field.unit
    zero = quantity.parse(f"0 {given}", unit, name=name)
    one = quantity.parse(f"1 {given}", unit, name=name)
    if str(given).strip() == "dBm":
        raise InputError(f"{name} = {shown(given)} is no straight scale; write the numbers in {unit}")
    offset = 0.0 if "rise" in field.long_name else zero
    return offset, one - zero


def contents(name: str, data: Any, needed: Iterable[str], *, what: str) -> Any:
    """A Dataset in SI; InputError where it lacks one of the needed variables.

    name: of the argument; what: the Dataset that is taken, for the message.

    >>> contents("data", 3, ("time",), what="a Dataset of th.solve")
    Traceback (most recent call last):
    thermofem.errors.InputError: data has no 'time'; a Dataset of th.solve is needed
    """
    for variable in needed:
        if variable not in getattr(data, "variables", ()):
            raise InputError(f"{name} has no {variable!r}; {what} is needed")
    return in_si(name, data)
