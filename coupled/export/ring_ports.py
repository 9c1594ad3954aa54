"""A ring in the kernel's units, its ports with fields in sqrt(W), the part that light heats, and the run of an export.

    da/dt = ... + i (pump s_in + add s_add)
    s_through = s_in + i through a,    s_drop = s_add + i drop a
    P_abs in W = 1e-6 (absorbed power of `kernel.rates` in uW)

The equations of light and carriers, and the units ns, fJ and 1e23 carriers per m^3, are those of `kernel.rates`.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from thermofem import InputError, StateSpace, checks
from thermofem.export.poles import RCNetwork, rc_network
from thermofem.ring_temperature import detuning_output

from ..kernel.units import FJ, NS, Rates, internal_pump, internal_rates
from ..resonator import RingResonator

STEPS_A_PERIOD = 400  # ngspice is within 3e-4 of the period with it, within 1e-3 with half as many
STEPS_A_LIFETIME = 20  # where the period is not known; a pulse lasts some carrier lifetimes


@dataclass(frozen=True)
class RingPorts:
    """Rates of a ring in the kernel's units, and how its field is joined to those at its ports.

    dispersion: the pairs (c_k, p_k) of S(N), c_k in rad/ns.
    pump, add [sqrt(fJ)/ns for each sqrt(W)]: what the fields into the bus and the add port drive.
    through, drop [sqrt(W) for each sqrt(fJ)]: what the ring's field adds at the ports.
    """

    rates: Rates
    dispersion: tuple[tuple[float, float], ...]
    pump: float
    add: float
    through: float
    drop: float

    @property
    def output_port(self) -> str:
        """The port that a demonstration reads: drop, or through for a ring on one bus."""
        return "drop" if self.drop else "through"


def ring_ports(ring: RingResonator) -> RingPorts:
    """`RingPorts` of a ring: pump = sqrt(2 gamma_bus), through = sqrt(2 gamma_bus), and those of the drop bus."""
    rates, fcd = internal_rates(ring)
    to_drop = math.sqrt(2 * ring.drop_bus_rate)
    return RingPorts(
        rates=rates,
        dispersion=tuple((float(c), float(p)) for c, p in fcd),
        pump=internal_pump(ring, 1.0),
        add=to_drop * NS / math.sqrt(FJ),
        through=math.sqrt(2 * ring.bus_rate * FJ),
        drop=to_drop * math.sqrt(FJ),
    )


@dataclass(frozen=True)
class Demonstration:
    """Laser of a demonstration run from cold, which is written beside an export.

    power [W], detuning [Hz]: of the laser, on from t = 0.
    period [s]: of the settled pulsation, or None where it is not known or the ring does not pulse.
    rests: whether the ring is known to come to rest; then no step need be shorter than a row of the table. Measured
        at .2 and 1 mW: within 3e-4 of the largest value, from two rows on.
    """

    power: float
    detuning: float
    period: float | None
    rests: bool = False

    def largest_step(self, rates: Rates) -> float:
        """Largest step in s that the simulator may take."""
        if self.period:
            return self.period / STEPS_A_PERIOD
        return self.row() if self.rests else rates.tau0 * NS / STEPS_A_LIFETIME

    def row(self) -> float:
        """Interval of the rows of the output table in s: a 100th of the period in whole ns, 1 to 4; else 4 ns."""
        return min(4.0, max(1.0, self.period / 100 // NS)) * NS if self.period else 4 * NS

    def reason(self) -> str:
        """Text that says how the largest step was chosen."""
        if self.period:
            return f"settled period {self.period:.9g} s / {STEPS_A_PERIOD}"
        if self.rests:
            return "a row of the table; the ring comes to rest"
        return f"carrier lifetime / {STEPS_A_LIFETIME}; the period is not known"


def demonstration(power: Any, detuning: float, period: float | None) -> Demonstration:
    """Check the laser power (W, or a mapping from the laser's name), detuning (Hz) and period (s) of a run.

    Raises InputError: a power or detuning out of range, or powers of several lasers.
    """
    if isinstance(power, Mapping):
        checks.integer("number of lasers", len(power), 1, 1)
        (power,) = power.values()
    power = checks.power("power", power, zero=True)
    detuning = checks.between("detuning", detuning, -5e12, 5e12, unit="Hz", hint="did you mean 10e9?")
    if period is not None:
        period = checks.between("period", period, 1e-12, 1, unit="s")
    return Demonstration(power, detuning, period)


def ring_network(model: Any, wanted: str, *, taken: Iterable[str]) -> tuple[RCNetwork, str]:
    """RC network with a pin "heat" at the part that light heats, and the pin of the output that detunes it.

    wanted: the temperature that the ring reads, "core" or "light".
    """
    net = rc_network(model, taken=(*taken, "heat"))
    channel = lit_part(model, wanted)
    net.pins[net.parts.index(channel.heated)] = "heat"
    return net, net.pins[net.parts.index(channel.read)]


def lit_channel(model: Any, wanted: str) -> Any:
    """The channel of a StateSpace from the light of a ring to what detunes it; any other model unchanged."""
    return model.channel(*lit_part(model, wanted)) if isinstance(model, StateSpace) else model


class LitPart(NamedTuple):
    """The input that the light of a ring heats, and the output that detunes it."""

    heated: str
    read: str


def lit_part(model: Any, wanted: str) -> LitPart:
    """The first input of a model, and the output that detunes a ring which reads ``wanted``, "core" or "light".

    Raises InputError: the model does not read that input, and reads several others.
    """
    heated = getattr(model, "heated", model.inputs)[0]
    read = detuning_output(wanted, heated, tuple(model.outputs))
    if read in model.outputs:
        return LitPart(heated, read)
    raise InputError(f"model heats {heated!r} and reads {', '.join(model.outputs)}: one must be {heated!r}, too")
