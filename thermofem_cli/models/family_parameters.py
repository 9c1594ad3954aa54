"""Options that name parameters of a family: --fix, --spread and --optics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from thermofem import checks
from thermofem.data import quantity
from thermofem.errors import InputError

from ..command_files import ring_of
from ..drive_texts import assigned

if TYPE_CHECKING:
    from surrogate import Optics
    from surrogate.family import Family


def units_of(family: Family) -> dict[str, str]:
    """SI unit of every parameter."""
    return dict(zip(family.names, family.box.units, strict=True))


def fixed_of(family: Family, given: list[str] | None) -> dict[str, float]:
    """Parameters of --fix 'radius=7 um', in SI."""
    texts = _of_parameters(family, "--fix", given, "radius=7 um")
    return {name: quantity.parse(text, unit, name=f"--fix {name}") for name, (unit, text) in texts.items()}


def spreads_of(family: Family, given: list[str]) -> dict[str, Any]:
    """Normal distributions of --spread 'width=450 nm,5 nm'."""
    from scipy import stats

    spreads = {}
    for name, (unit, text) in _of_parameters(family, "--spread", given, "width=450 nm,5 nm").items():
        mean, _, width = (part.strip() for part in text.partition(","))
        if not width:
            raise InputError(f"--spread '{name}={text}' needs a mean and a standard deviation: 'width=450 nm,5 nm'")
        centre = quantity.parse(mean, unit, name=f"--spread {name}")
        spreads[name] = stats.norm(centre, quantity.positive(width, unit, name=f"--spread {name}"))
    return spreads


def optics_of(family: Family, given: Sequence[str] | None, ring: str) -> Optics | None:
    """Slopes d(optical number)/d(parameter) in SI of --optics 'bus_rate/width=-1e17'; 'detuning' is a number, too."""
    import surrogate
    from coupled.unknowns import optical_names

    if not given:
        return None
    slopes: dict[str, dict[str, float]] = {}
    known = {*optical_names(ring_of(ring)), "detuning"}
    for left, value in assigned("--optics", given, "bus_rate/width=-1e17").items():
        number, stroke, parameter = left.partition("/")
        if not stroke:
            raise InputError(f"--optics '{left}={value}' is not of the form NUMBER/PARAMETER=SLOPE")
        slope = quantity.parse(value, "", name=f"--optics {left}")
        slopes.setdefault(checks.choice("--optics: number", number, known), {})[parameter] = slope
    found = surrogate.Optics(slopes)
    found.check(family)
    return found


def _of_parameters(family: Family, option: str, given: list[str] | None, example: str) -> dict[str, tuple[str, str]]:
    """Unit and text of every parameter of a repeatable option 'PARAMETER=VALUE'."""
    units = units_of(family)
    texts = assigned(option, given or [], example)
    return {checks.choice(f"{option}: parameter", name, units): (units[name], text) for name, text in texts.items()}
