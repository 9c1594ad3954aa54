"""Parameters, channels and rings of a family, from the options of the commands that take one."""

from dataclasses import replace
from typing import Any

from scipy import stats

from coupled import RingResonator
from coupled.ring_family import MovingRing, SettledPeriod, ring_at
from coupled.thermal import as_read, check_geometry, geometry_of, mode_of
from surrogate.family import Family
from surrogate.family.family import ChannelNames
from thermofem import checks
from thermofem.data import quantity
from thermofem.ring_temperature import check_read, detuning_output

from .. import options
from ..console import note, written
from .command_files import check_channel, note_ring, ring_of
from .drive_texts import assigned, reading
from .ring_drives import detuning_of


def units_of(family: Family) -> dict[str, str]:
    """Return the SI unit of every parameter by its name."""
    return dict(zip(family.names, family.box.units, strict=True))


def fixed_of(family: Family, given: list[str] | None) -> dict[str, float]:
    """Return the parameters of --fix 'radius=7 um' by name, in SI."""
    texts = _of_parameters(family, "--fix", given, "radius=7 um")
    return {name: quantity.parse(text, unit, name=f"--fix {name}") for name, (unit, text) in texts.items()}


def spreads_of(family: Family, given: list[str]) -> dict[str, Any]:
    """Return the normal distributions of --spread 'width=450 nm,5 nm' by parameter, in SI."""
    spreads = {}
    for name, (unit, text) in _of_parameters(family, "--spread", given, "width=450 nm,5 nm").items():
        with reading(f"--spread '{name}={text}'", "PARAMETER=MEAN, STANDARD DEVIATION, such as 'width=450 nm,5 nm'"):
            mean, width = text.split(",")
        centre = quantity.parse(mean.strip(), unit, name=f"--spread {name}")
        spreads[name] = stats.norm(centre, quantity.positive(width.strip(), unit, name=f"--spread {name}"))
    return spreads


def channel_of(family: Family, heated: str | None, read: str | None) -> ChannelNames:
    """The channel of --heated and --read; the error has the options' names."""
    check_channel(family, heated, read)
    return family.channel(heated, read)


def ring_for(family: Family, channel: ChannelNames, given: str, read: str | None) -> tuple[RingResonator, ChannelNames]:
    """Return the ring of --ring, and the channel that drives it: the output that it reads where --read names none.

    Default is the ring of the family's geometry, if this has [light] and [[bus]].
    """
    optics = family.optics
    if given == options.REFERENCE_RING and optics is not None and {"loss", "kappa 0"} <= {*optics.names}:
        ring = ring_at(family, family.box.nominal)
        note(f"the ring is computed from the geometry: {ring.name}; carriers of {given}")
    else:
        ring = ring_of(given)
        note_ring(ring, given)
        check_geometry(ring, family)
    output = read or detuning_output(ring.read, channel.heated, family.outputs)
    channel = replace(channel, read=output)
    mode = mode_of(family)
    check_read(ring, geometry_of(family), channel.heated, output, mode=mode, chosen=read is not None)
    middle = family.of_channel(channel, family.box.named(family.box.middle))
    return as_read(ring, middle), channel


def optics_of(family: Family, ring: RingResonator) -> MovingRing | None:
    """Return how the ring's optical numbers depend on the geometry; None where the family has no optics."""
    if family.optics is None:
        note(
            "the optics stand still, this is the thermal part alone; [light] and [[bus]] in the geometry of the "
            "family move them"
        )
        return None
    moving = MovingRing(family, ring)
    at = ", ".join(f"{name} = {written(value, units_of(family)[name])}" for name, value in moving.at.items())
    buses = "" if "kappa 0" in family.optics.names else "; no [[bus]]: kappa^2 stands still"
    note(f"the optics move with the geometry, from the ring as it is at {at}{buses}")
    return moving


def _of_parameters(family: Family, option: str, given: list[str] | None, example: str) -> dict[str, tuple[str, str]]:
    """Return unit and text of every parameter in a repeatable option 'PARAMETER=VALUE', by name."""
    units = units_of(family)
    texts = assigned(option, given or [], example)
    return {checks.choice(f"{option}: parameter", name, units): (units[name], text) for name, text in texts.items()}


def settled_of(ring: RingResonator, power: str, detuning: str) -> SettledPeriod:
    """Return the settled period as a function of the member."""
    watts = quantity.parse(power, "W", name="--power")
    return SettledPeriod(ring, watts, detuning_of(detuning, ring))
