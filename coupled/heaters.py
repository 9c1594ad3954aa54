"""Heaters near a ring: thermal models with several inputs, one of which is the power absorbed by the ring.

    dT(t) = dT_model(t) + sum_h dT_h(t),       dT_h = sum_i x_i,     dx_i/dt = (R_ih P_h - x_i)/tau_i

By linearity the temperature rises by the heaters add to that by the light. They do not depend on the light, so they are
computed before a run. The residues R_ih of a transfer function from a heater can have either sign. The temperature T_a
of the ambient is one more such input, in K; a model without that input has the ring follow it at once, dT += T_a.
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from thermofem import Foster, checks
from thermofem.algebra.pole_responses import cubic_pole_responses
from thermofem.arrays import Array
from thermofem.geometry.section_parts import AMBIENT
from thermofem.models import ThermalModel, bare, has_ports
from thermofem.piecewise import hermite
from thermofem.ring_temperature import CORE, detuning_output

from .inputs import Pieces, add, check_ring, last_change
from .resistive_heaters import Rest, at_rest, drive_in_time
from .resonator import RingResonator
from .thermal import Compact, check_model, check_resistance, compact

SHARE = 0.01  # of rtol, for the cubics through the rise by a heater
TOGETHER = 50_000  # pieces of a heater's power that are cut at once: some 100 MB
AT_ONCE = "added to the temperature of every ring at once: the thermal model has no input 'ambient'"


class Poles(NamedTuple):
    """Poles of one heater, dx/dt = P - rate x with states x in J; gain x is the temperature rise of each of N rings."""

    rate: Array
    """(n,), 1/s"""
    gain: Array
    """(N, n), K/J"""


class Channels(NamedTuple):
    """The thermal model from absorbed light to the ring, and the transfer functions from the heaters to it."""

    model: Compact
    transfers: dict[str, Foster]
    """From every heater to the part that is read, with the poles of ``model``."""

    @property
    def poles(self) -> dict[str, Poles]:
        """The transfer functions as `Poles` by heater, for `heating`."""
        return {name: Poles(1 / np.asarray(each.tau), each.gain[None]) for name, each in self.transfers.items()}


def channels(
    model: ThermalModel,
    wanted: str = CORE,
    heaters: Mapping[str, Any] | None = None,
    heated: str | None = None,
    read: str | None = None,
) -> Channels:
    """Select the transfer functions of a thermal model from the absorbed light and from the heaters.

    model: a StateSpace (or a reduction that holds one) may have several inputs and outputs, any other model has one.
    wanted: the temperature that the ring reads, "core" or "light".
    heaters [mapping of an input's name to its power]: with "ambient" where the model is to have that input.
    heated, read: input that the light heats, and output whose rise detunes it; by default the first input that is not
        a heater, where heaters are given, and the wanted output.
    Raises InputError: several inputs or outputs and no choice, an unknown name, heaters of a model with one input.
    """
    names = checks.mapping("heaters", heaters, hint="e.g. {'heater': 5e-3}")
    system = bare(model)
    single = None if has_ports(system) else compact(model)
    inputs = system.inputs
    outputs = system.outputs
    parts = getattr(system, "heated", inputs)
    if len(parts) > 1 and heated is None and not names:
        raise checks.InputError(
            f"model has the inputs {', '.join(inputs)} and the outputs {', '.join(outputs)}: say which one the light "
            f"heats with heated={inputs[0]!r}, and the power of others with heaters={{{parts[-1]!r}: 5e-3}}, or pick "
            "one channel with model.channel(heated, read)"
        )
    hint = "an input for each heater is needed, such as surrogate.reduce(heat.channels(('core', 'heater'), 'core')) has"
    for name in names.keys() - {AMBIENT}:
        checks.choice("heaters", name, inputs, hint=hint)
    own = checks.choice("heated", heated, inputs, default=next((n for n in parts if n not in names), inputs[0]))
    check_unlit(names, own)
    hint = "it is the output that detunes the light"
    out = checks.choice("read", read, outputs, default=detuning_output(wanted, own, tuple(outputs)), hint=hint)
    if single is not None:
        return Channels(single, {})
    transfers = {name: system.channel(name, out).dynamics for name in names if name in inputs}
    for transfer in transfers.values():
        check_resistance(float(np.abs(transfer.R).sum()))
    return Channels(compact(system.channel(own, out)), transfers)


def with_ambient(heaters: Mapping[str, Any] | None, ambient: Any) -> dict[str, Any]:
    """The powers of heaters, with the temperature of the ambient (K) under its name; None: it does not move."""
    names = checks.mapping("heaters", heaters, hint="e.g. {'heater': 5e-3}")
    if AMBIENT in names:
        raise checks.InputError("heaters holds 'ambient', which has no power", "give its temperature as ambient=")
    return {**names} if ambient is None else {**names, AMBIENT: ambient}


def check_unlit(heaters: Mapping[str, Any], lit: str) -> None:
    """Raise InputError if ``lit``, the part that the light heats, is among the heaters."""
    if lit in heaters:
        raise checks.InputError(f"heaters holds {lit!r}, which the light heats; give the power of other parts")


class Heating(NamedTuple):
    """Powers of the heaters in a run and the temperature rises that they cause."""

    powers: dict[str, Pieces]
    """Of those that are given, W; the ambient in K."""
    rises: list[Pieces]
    """Of every ring, K."""
    poles: Mapping[str, Poles]
    begin: list[Array]
    """The states of every heater at t = 0, J."""

    @property
    def driven_until(self) -> float:
        """Time in s of the last change of a heater power; 0 for constant powers."""
        return max(map(last_change, self.powers.values()), default=0.0)

    @property
    def attributes(self) -> dict[str, str]:
        """What a run says where the thermal model has no input for the ambient."""
        return {AMBIENT: AT_ONCE} if AMBIENT in self.powers and AMBIENT not in self.poles else {}

    def states(self, time: float) -> list[Array]:
        """States of the poles of every heater (J) at a time in s, one array of shape (n,) per heater."""
        powers = [self.powers.get(name, Pieces.constant(0.0, time, 0.0)) for name in self.poles]
        every = zip(self.poles.values(), powers, self.begin, strict=True)
        return [states_of(poles.rate, power, np.array([time]), begin)[0] for poles, power, begin in every]


def heating(
    poles: Mapping[str, Poles], heaters: Mapping[str, Any] | None, duration: float, rtol: float,
    before: Array | None, rings: int = 1,
) -> Heating:  # fmt: skip
    """Compute the temperature rises that heaters cause in every ring, to a tolerance of ``rtol``/100.

    heaters [mapping of name to number, waveform, or list of them, which add; W]
    before [J]: states of all heaters at t = 0, concatenated; heaters that are not given cool down from there. None: a
        number, or the first of `LongOn`, is a power that was constant for all t < 0, any other input is 0 for t < 0.
    """
    given = checks.mapping("heaters", heaters, hint="give powers by the inputs' names, {'heater 1': 1e-3}")
    for name in given.keys() - {AMBIENT}:
        hint = "" if poles else "the thermal model has no heaters among its inputs"
        checks.choice("a name in heaters", name, poles, hint=hint)
    powers = {name: drive_in_time(name, power, duration) for name, power in given.items()}
    dark = Pieces.constant(0.0, duration, 0.0)
    begin = [_long_on(given.get(name, 0.0)) / each.rate for name, each in poles.items()]
    if before is not None:
        stops = np.cumsum([0, *(each.rate.size for each in poles.values())])
        checks.shape("initial.attrs['heater_states'] for the heaters of this model", before, (stops[-1],))
        begin = [before[i:j] for i, j in pairwise(stops)]
    every = [[dark] * rings]
    for (name, (rate, gain)), x in zip(poles.items(), begin, strict=True):
        power = powers.get(name, dark)
        if power.steady and np.allclose(x, power(0.0) / rate, rtol=1e-12, atol=0):
            every.append([Pieces.constant(0.0, duration, rise) for rise in gain @ x])
        else:
            every.append(rises(rate, gain, power, rtol, x))
    if AMBIENT in powers and AMBIENT not in poles:
        every.append([powers[AMBIENT]] * rings)
    return Heating(powers, [add([*parts]) for parts in zip(*every, strict=True)], poles, begin)


class LongOn(list[Any]):
    """A list of inputs, which add; its first one, a number, was there before t = 0."""


def _long_on(value: Any) -> float:
    """The part of an input that was there before t = 0 where nothing else is known: a number."""
    constant = value[0] if isinstance(value, LongOn) else value
    return float(constant) if hasattr(constant, "__float__") else 0.0


def states_of(rate: Array, power: Pieces, times: Array, begin: Array | None = None) -> Array:
    """States of the poles dx/dt = P - rate x at ``times``, J, shape (times, n), from ``begin`` (default 0)."""
    x = cubic_pole_responses(rate, power, times)
    return x if begin is None else x + begin * np.exp(np.multiply.outer(times - power.edges[0], -rate))


def rises(rate: Array, gain: Array, power: Pieces, rtol: float, begin: Array | None = None) -> list[Pieces]:
    """Temperature rises (K) of m parts by one heater, as cubic Hermite pieces on common edges, to rtol/100.

    Between edges of the power a rise is a cubic plus sum_i a_i exp(-u rate_i), with u the time from the edge. The error
    of a piece of length h is at most h^4/384 sum_i |a_i| rate_i^4 exp(-u rate_i), u at its left end.

    rate [shape (n,), 1/s]
    gain [shape (m, n), K/J]: of the poles, in each part.
    begin [shape (n,), J]: initial states, as in `states_of`.
    """
    edges = power.edges
    x = states_of(rate, power, edges, begin)
    # errors of a rise below 0.1 K are relative to that
    allowed = 384 * SHARE * rtol * np.maximum(np.abs(x @ gain.T).max(axis=0), 0.1)
    derivative = x[:-1]
    for k, factorial in enumerate((1.0, 1.0, 2.0, 6.0)):  # of x, from the first to the fourth
        derivative = factorial * power.coefficients[:, [k]] - rate * derivative
    fourth = np.abs(derivative)
    weight = np.abs(gain) / allowed[:, None]
    lengths = np.diff(edges)
    nodes = []
    for k in range(0, lengths.size, TOGETHER):
        part = slice(k, k + TOGETHER)
        nodes.append(_nodes(edges[:-1][part], lengths[part], fourth[part, None] * weight, rate))
    t = np.append(np.concatenate(nodes), edges[-1])
    x = states_of(rate, power, t, begin)
    driven = power.on(t)
    values = x @ gain.T
    decays = x @ (gain * rate).T
    total = gain.sum(axis=1)
    first_slopes = np.multiply.outer(driven.coefficients[:, 0], total) - decays[:-1]
    last_slopes = np.multiply.outer(driven.ends, total) - decays[1:]
    parts = zip(values.T, first_slopes.T, last_slopes.T, strict=True)
    return [hermite(t, *part) for part in parts]


def _nodes(starts: Array, lengths: Array, bend: Array, rate: Array) -> Array:
    """Left ends (s) of the Hermite pieces between the edges of the power, increasing, shape (k,).

    starts, lengths [shape (p,), s]: of the pieces of the power.
    bend [shape (p, m, n), 1/s^4]: coefficients of exp(-u rate) in the fourth derivatives, over the allowed value.
    """
    u = np.zeros(starts.size)
    active = np.flatnonzero(lengths > 0)
    nodes = []
    while active.size:
        nodes.append(starts[active] + u[active])
        decay = np.exp(-np.multiply.outer(u[active], rate))
        fourth = np.einsum("pmn,pn->pm", bend[active], decay).max(axis=1)
        steps = lengths[active]
        curved = fourth > 0
        steps[curved] = fourth[curved] ** -0.25
        u[active] += steps
        active = active[u[active] < lengths[active] * (1 - 1e-9)]
    return np.sort(np.concatenate(nodes))


def turned_by(rise: float, ring: RingResonator) -> float:
    """Shift of the resonance frequency by a temperature rise in K, as an equivalent detuning in Hz."""
    return float(ring.thermal_shift * rise / (2 * np.pi))


class ConstantHeating(NamedTuple):
    """A thermal model under constant heaters: the response to the light, and the rise by the heaters in K."""

    model: Compact
    rise: float
    rest: Rest
    """The same with all inputs and outputs, and the powers."""
    doubts: dict[str, Any]
    """What `check_model` says about the model."""

    def turned(self, ring: RingResonator) -> float:
        """Shift of the resonance frequency by the heaters, as an equivalent detuning in Hz."""
        return turned_by(self.rise, ring)

    @property
    def of_heaters(self) -> dict[str, Any]:
        """Powers of the heaters (W), the ambient (K) and the temperature rise by both as attributes of a Dataset."""
        return self.rest.attributes | {"heater_rise": self.rise} if self.rest.powers else {}

    @property
    def attributes(self) -> dict[str, Any]:
        """Attributes of a Dataset: those of the heaters, and the doubts about the model."""
        return {**self.of_heaters, **self.doubts}


def constant(
    model: ThermalModel,
    wanted: str,
    heaters: Mapping[str, Any] | None,
    heated: str | None = None,
    read: str | None = None,
) -> ConstantHeating:
    """Select the light's channel of a model and compute the steady temperature rise under constant heaters (W).

        dT = dT_model + sum_h R_h P_h + T_a

    Under a voltage or a current the model is the one around the heaters' own state, see `resistive_heaters`.
    Raises InputError: as `channels`, and a power that is no number or out of range.
    """
    rest = at_rest(model, heaters)
    selected = channels(rest.model, wanted, rest.sources, heated, read)
    gains = {AMBIENT: 1.0}
    for name, transfer in selected.transfers.items():
        gains[name] = transfer.thermal_resistance
    rise = sum(gains[name] * power for name, power in rest.sources.items())
    return ConstantHeating(selected.model, float(rise), rest, doubts={})


def warmed(
    ring: RingResonator,
    model: ThermalModel,
    heaters: Mapping[str, Any] | None = None,
    heated: str | None = None,
    read: str | None = None,
) -> ConstantHeating:
    """`constant` for the temperature that a ring reads, with the doubts about the model.

    Raises InputError: as `constant`, and an argument that is no ring.
    """
    check_ring(ring)
    warm = constant(model, ring.read, heaters, heated, read)
    return warm._replace(doubts=check_model(ring, model, warm.model, read))


def heater_powers(powers: Mapping[str, Any], time: Array) -> dict[str, Any]:
    """The variables heater_power (W) over heater and time, and ambient (K); ``powers`` are functions of time."""
    watts = {name: wave(time) for name, wave in powers.items() if name != AMBIENT}
    found: dict[str, Any] = {}
    if watts:
        about = {"units": "W", "long_name": "power of a heater"}
        found["heater_power"] = (("heater", "time"), np.array([*watts.values()]), about)
        found["heater"] = ("heater", np.array([*watts]), {})
    if AMBIENT in powers:
        about = {"units": "K", "long_name": "temperature of the ambient above that of the geometry"}
        found[AMBIENT] = ("time", powers[AMBIENT](time), about)
    return found
