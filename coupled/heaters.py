"""Heaters beside a ring: thermal models of several inputs, one of which the light heats.

    dT(t) = dT_model(t) + sum_h dT_h(t),       dT_h = sum_i x_i,     dx_i/dt = (R_ih P_h - x_i)/tau_i

A linear model adds the rises by the heaters to the rise by the light, so the light sees one channel of the model and a
temperature that is known beforehand. The residues R_ih of a transfer channel have either sign.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from thermofem import Foster, StateSpace, checks
from thermofem.algebra.pole_responses import cubic_pole_responses
from thermofem.arrays import Array
from thermofem.models import ThermalModel, bare
from thermofem.piecewise import hermite

from .arguments import power_in_time
from .inputs import Pieces, add
from .resonator import RingResonator
from .thermal import Compact, check_resistance, compact

SHARE = 0.01  # of rtol, for the cubics through the rise by a heater
LARGEST_POWER = 10.0  # W


class Channels(NamedTuple):
    """The model of the light's channel, and the transfers from the heaters to it."""

    model: Compact
    transfers: dict[str, Foster]
    """From every heater to the part that is read, with the poles of ``model``."""


def channels(
    model: ThermalModel, heaters: Mapping[str, Any] | None = None, heated: str | None = None, read: str | None = None
) -> Channels:
    """Pick the channel of the light and those of the heaters.

    model: a StateSpace (or a reduction that holds one) may have several inputs and outputs, any other model has one.
    heaters [mapping of an input's name to its power]
    heated, read: the input of the light and the output that detunes it; by default the first input that is no heater,
        where heaters are given, and the output of the same name.
    Raises InputError: several inputs or outputs and no choice, an unknown name, heaters of a model with one input.
    """
    names, system = checks.mapping("heaters", heaters, hint="e.g. {'heater': 5e-3}"), bare(model)
    several = isinstance(system, StateSpace) and (len(system.inputs), len(system.outputs)) != (1, 1)
    single = None if several else compact(model)
    inputs, outputs = system.inputs, system.outputs
    if several and heated is None and not names:
        raise checks.InputError(
            f"model has the inputs {', '.join(inputs)} and the outputs {', '.join(outputs)}: say which one the light "
            f"heats with heated={inputs[0]!r}, and the power of others with heaters={{{inputs[-1]!r}: 5e-3}}, or pick "
            "one channel with model.channel(heated, read)"
        )
    hint = "an input for each heater is needed, such as surrogate.reduce(heat.channels(('core', 'heater'), 'core')) has"
    for name in names:
        checks.choice("heaters", name, inputs, hint=hint)
    own = checks.choice("heated", heated, inputs, default=next((n for n in inputs if n not in names), inputs[0]))
    check_unlit(names, own)
    hint = "it is the output that detunes the light"
    out = checks.choice("read", read, outputs, default=own if several else outputs[0], hint=hint)
    if single is not None:
        return Channels(single, {})
    transfers = {name: system.channel(name, out).dynamics for name in names}
    for transfer in transfers.values():
        check_resistance(float(np.abs(transfer.R).sum()))
    return Channels(compact(system.channel(own, out)), transfers)


def check_unlit(heaters: Mapping[str, Any], lit: str) -> None:
    """InputError where the part that the light heats is among the heaters."""
    if lit in heaters:
        raise checks.InputError(f"heaters holds {lit!r}, which the light heats; give the power of other parts")


class Heating(NamedTuple):
    """Effect of the heaters in a run."""

    powers: dict[str, Pieces]
    transfers: dict[str, Foster]
    rise: Pieces | float
    """K, at the part that is read."""

    def states(self, time: float) -> Array | float:
        """Contribution of the heaters to the states of the light's model at a time in s, K."""
        added: Array | float = 0.0
        for name, power in self.powers.items():
            transfer = self.transfers[name]
            added = added + transfer.gain * states_of(1 / np.asarray(transfer.tau), power, np.array([time]))[0]
        return added

    def static(self, time: float) -> float:
        """The rise, K, at which the powers at a time in s would end."""
        ends = (self.transfers[name].thermal_resistance * power(time) for name, power in self.powers.items())
        return float(sum(ends))


def heating(found: Channels, heaters: Mapping[str, Any] | None, duration: float, rtol: float) -> Heating:
    """The rise that heaters cause from rest at t = 0, as cubics to a hundredth of ``rtol``.

    ``heaters`` maps names to numbers, waveforms, or lists of them, which add; W.
    """
    powers = {name: power_of(name, value, duration) for name, value in checks.mapping("heaters", heaters).items()}
    if not powers:
        return Heating({}, {}, 0.0)
    every = []
    for name, power in powers.items():
        transfer = found.transfers[name]
        every += rises(1 / np.asarray(transfer.tau), transfer.gain[None], power, rtol)
    return Heating(powers, found.transfers, add(every))


def power_of(name: str, value: Any, duration: float) -> Pieces:
    """The power of a heater in W; InputError where it is negative or too large."""
    hint = "powers are in W (did you mean 5e-3 for 5 mW?)"
    found = power_in_time(value, duration, f"heaters[{name!r}]", LARGEST_POWER, hint)
    return Pieces.constant(0.0, float(duration), found) if isinstance(found, float) else found


def states_of(rate: Array, power: Pieces, times: Array, begin: Array | None = None) -> Array:
    """States of poles dx/dt = P - rate x, J, shape (times, n), that begin with ``begin``, by default at rest."""
    x = cubic_pole_responses(rate, *power, times)
    return x if begin is None else x + begin * np.exp(np.multiply.outer(times - power.edges[0], -rate))


def rises(rate: Array, gain: Array, power: Pieces, rtol: float, begin: Array | None = None) -> list[Pieces]:
    """The rises of m parts by one heater as cubic Hermite pieces on the same edges, to a hundredth of ``rtol``.

    Between edges of the power a rise is a cubic and sum_i a_i exp(-u rate_i); a piece of length h is off by at most
    h^4/384 sum_i |a_i| rate_i^4 exp(-u rate_i), u at its left end.

    rate [shape (n,), 1/s]
    gain [shape (m, n), K/J]: of the poles, in each part.
    begin [shape (n,), J]: as of `states_of`.
    """
    edges = power.edges
    x = states_of(rate, power, edges, begin)
    # errors of a rise below 0.1 K are relative to that
    allowed = 384 * SHARE * rtol * np.maximum(np.abs(x @ gain.T).max(axis=0), 0.1)
    slope = x[:-1]
    for k, factor in enumerate((1.0, 1.0, 2.0, 6.0)):  # the derivatives, up to the fourth
        slope = factor * power.coefficients[:, [k]] - rate * slope
    weight = np.abs(gain) / allowed[:, None]
    starts = zip(edges[:-1], np.diff(edges), np.abs(slope), strict=True)
    nodes = [_nodes(start, length, weight * bend, rate) for start, length, bend in starts]
    t = np.append(np.concatenate(nodes), edges[-1])
    x, on = states_of(rate, power, t, begin), power.on(t)
    falling, total = x @ (gain * rate).T, gain.sum(axis=1)
    first = np.multiply.outer(on.coefficients[:, 0], total) - falling[:-1]
    last = np.multiply.outer(on.ends, total) - falling[1:]
    return [hermite(t, *columns) for columns in zip((x @ gain.T).T, first.T, last.T, strict=True)]


def _nodes(start: float, length: float, bend: Array, rate: Array) -> Array:
    """Left ends of the pieces between two edges of the power.

    bend [shape (m, n), 1/s^4]: sizes of the exponentials in the fourth derivatives, relative to what is allowed.
    """
    u, out = 0.0, []
    while u < length * (1 - 1e-9):
        out.append(start + u)
        fourth = float(np.max(bend @ np.exp(-rate * u)))
        u += fourth**-0.25 if fourth > 0 else length
    return np.array(out)


def turned_by(rise: float, ring: RingResonator) -> float:
    """Shift of the resonance by a rise in K, as a detuning in Hz."""
    return float(ring.thermal_shift * rise / (2 * np.pi))


class ConstantHeating(NamedTuple):
    """A model under constant heaters: the light's channel, and the rise by the heaters in K."""

    model: Compact
    rise: float
    powers: dict[str, float]

    def turned(self, ring: RingResonator) -> float:
        """Shift of the resonance by the rise, as a detuning in Hz."""
        return turned_by(self.rise, ring)

    @property
    def attributes(self) -> dict[str, float]:
        """Powers of the heaters, and their rise, for a Dataset."""
        if not self.powers:
            return {}
        return {f"power_in_{name}": power for name, power in self.powers.items()} | {"heater_rise": self.rise}


def constant(
    model: ThermalModel, heaters: Mapping[str, Any] | None, heated: str | None = None, read: str | None = None
) -> ConstantHeating:
    """The model and the steady rise under heaters of constant power in W.

        dT = dT_model + sum_h R_h P_h

    Raises InputError: as `channels`, and a power that is no number or out of range.
    """
    found = channels(model, heaters, heated, read)
    powers = {name: heater_power(name, value) for name, value in checks.mapping("heaters", heaters).items()}
    rise = sum(found.transfers[name].thermal_resistance * power for name, power in powers.items())
    return ConstantHeating(found.model, float(rise), powers)


def heater_power(name: str, value: Any) -> float:
    """A constant power of a heater in W; InputError where it is no number or out of range."""
    hint = "a constant power in W, such as 5e-3; coupled.simulate takes waveforms"
    return checks.between(f"heaters[{name!r}]", value, 0, LARGEST_POWER, unit="W", hint=hint)


def heater_powers(powers: Mapping[str, Any], time: Array) -> dict[str, Any]:
    """The variable heater_power over heater and time, and its coordinate; ``powers`` are functions of time."""
    if not powers:
        return {}
    about = {"units": "W", "long_name": "power of a heater"}
    rows = np.array([wave(time) for wave in powers.values()])
    return {"heater_power": (("heater", "time"), rows, about), "heater": ("heater", np.array(list(powers)), {})}
