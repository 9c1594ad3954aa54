"""Several lasers on one ring: pump and probe, or a pair on neighbouring resonances.

Every resonance has a field of its own, all share carriers and heat, and
two-photon absorption and the Kerr effect of another resonance count twice. Lasers on one resonance beat.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thermofem import checks
from thermofem.arrays import Array, NDArray

from ..arguments import detuning_in_time, power_in_time
from ..inputs import Input, Spans, add, beats, integral, joint, largest, pieces, spans, table, values
from ..kernel import units as eq
from ..kernel.integrator import Drive, Problem
from ..kernel.tableaus import Method
from ..resonator import RingResonator
from ..states import State
from ..thermal import Compact

if TYPE_CHECKING:
    import xarray as xr

BEAT = 0.1  # of a beat, that a step may last


@dataclass(frozen=True)
class Laser:
    """A further laser on a ring.

    Parameters
    ----------
    power : float, Waveform, or a list of both; W
        in the bus waveguide.
    detuning : float, Waveform, or a list of both; Hz
        laser minus the cold resonance that it is near.
    resonance : RingResonator, optional
        the ring as light at that resonance sees it, such as ``replace(ring, frequency=194.4e12)``. By default the
        resonance of the first laser, with whose field this one beats.
    phase : float, rad
        at t = 0, relative to the first laser of its resonance.

    >>> Laser(power=1e-6, detuning=-2e9).phase
    0.0
    """

    power: Input
    detuning: Input = 0.0
    resonance: RingResonator | None = None
    phase: float = 0.0

    def __post_init__(self) -> None:
        checks.plain(self)
        checks.finite("phase", self.phase, unit="rad")
        for name in ("power", "detuning"):
            value = getattr(self, name)
            if isinstance(value, type) or not (isinstance(value, list | tuple) or hasattr(value, "breakpoints")):
                checks.finite(name, value)
        if self.resonance is not None:
            hint = "give a ring, such as replace(ring, frequency=194e12)"
            checks.instance("resonance", self.resonance, RingResonator, hint=hint)


class Traces(NamedTuple):
    """One run; rows are the accepted steps or the wanted times."""

    time: Array
    fields: NDArray[np.complex128]
    """sqrt(J), shape (resonances, times)."""
    carriers: Array
    delta_T: Array
    absorbed: Array
    incoming: NDArray[np.complex128]
    """Amplitudes in sqrt(W) on every resonance, shape (resonances, times)."""
    final: State
    final_fields: Array
    reached: float
    counts: NDArray[np.int64]


def check_lasers(lasers: Any) -> list[Laser]:
    """One laser or several as a list; InputError for anything else."""
    given = list(lasers) if isinstance(lasers, list | tuple) else [lasers]
    for one in given:
        if not isinstance(one, Laser):
            raise checks.InputError(f"lasers holds a {type(one).__name__}; give coupled.Laser(power, detuning)")
    return given


def run_several(
    ring: RingResonator,
    model: Compact,
    state: State,
    fields: Mapping[float, Array],
    lasers: Sequence[Laser],
    duration: float,
    *,
    offset: Any,
    rtol: float,
    method: Method,
    times: Array,
    progress: Callable[[float], None] | None = None,
) -> tuple[Traces, list[RingResonator]]:
    """Integrate a ring under ``lasers``, the first of them on its own resonance, from a state with further ``fields``.

    Returns the traces and the ring at every resonance.
    """
    resonances = [ring]
    for one in lasers:
        if one.resonance is not None and one.resonance not in resonances:
            resonances.append(one.resonance)
    drive, beat = _drive(resonances, lasers, duration, offset)
    heat, bend = eq.internal_heat(model)
    rings = eq.internal_rings(resonances, math.sqrt(drive.brightest.max()), model.thermal_resistance * eq.UW)
    problem = Problem(rings._replace(bend=bend), heat, drive, method)
    own = state.as_array() / eq.units(problem.order)
    extra = np.ravel([fields.get(one.frequency, (0.0, 0.0)) for one in resonances[1:]]) / eq.FJ**0.5
    found = problem.integrate(
        np.concatenate([own[:2], extra, own[2:]]), rtol=rtol, times=times / eq.NS if times.size else None,
        longest=BEAT * 2 * math.pi / beat if beat else math.inf,
        progress=(lambda t: progress(t * eq.NS)) if progress else None,
    )  # fmt: skip
    F, t = len(resonances), found.rows[:, 0] * eq.NS
    a, N, dT = (found.rows[:, 1 : 2 * F : 2] + 1j * found.rows[:, 2 : 2 * F + 1 : 2]).T, *found.rows[:, -2:].T
    U = np.abs(a) ** 2
    W = 2 * U.sum(axis=0) - U
    absorbed, fca, tpa = rings.modes[0, :, 1:4].T[:, :, None]
    lost = absorbed + fca * N + tpa * W
    rate = np.sqrt([[2 * one.bus_rate * eq.NS] for one in resonances])
    rise = offset if isinstance(offset, float) else pieces("offset", offset, 0.0, duration)(t)
    lit = np.sqrt(np.maximum(values(drive.power, t), 0)) * np.exp(1j * values(drive.phase, t))
    y = np.concatenate([found.y[:2], found.y[2 * F :]]) * eq.units(problem.order)
    run = Traces(
        t, a * eq.FJ**0.5, N * eq.DENSITY, dT + rise, 2 * (lost * U).sum(axis=0) * eq.UW,
        drive.entry @ lit / rate * eq.UW**0.5, State.from_array(y), found.y[2 : 2 * F] * eq.FJ**0.5,
        found.t * eq.NS, np.array([found.accepted, found.rejected]),
    )  # fmt: skip
    return run, resonances


def varying(ring: RingResonator, lasers: Sequence[Laser], duration: float) -> dict[str, Spans]:
    """When the lasers but the first vary, and when several of different frequencies are on at one resonance."""
    places: list[RingResonator] = [ring]
    at: list[int] = []
    for one in lasers:
        place = one.resonance or ring
        if place not in places:
            places.append(place)
        at.append(places.index(place))
    powers = [pieces("power", power_in_time(one.power, duration), 0.0, duration) for one in lasers]
    turns = [pieces("detuning", detuning_in_time(one.detuning, duration), 0.0, duration) for one in lasers]
    found = spans({f"the power of laser {k + 1}": wave for k, wave in enumerate(powers) if k}, duration)
    found |= spans({f"the detuning of laser {k + 1}": wave for k, wave in enumerate(turns) if k}, duration)
    for number in range(len(places)):
        which = [k for k, own in enumerate(at) if own == number]
        if beating := beats([powers[k] for k in which], [turns[k] for k in which]):
            found["the light" if number == 0 else f"the light of resonance {number + 1}"] = beating
    return found


def _drive(
    resonances: list[RingResonator], lasers: Sequence[Laser], duration: float, offset: Any
) -> tuple[Drive, float]:
    """The lasers as the kernel takes them, and the fastest beat on one resonance in rad/ns."""
    at = [0 if one.resonance is None else resonances.index(one.resonance) for one in lasers]
    first = [at.index(f) for f in range(len(resonances))]
    dT = pieces("offset", offset, 0.0, duration)
    powers, turns = [], []
    for f, laser in zip(at, lasers, strict=True):
        power = pieces("power", power_in_time(laser.power, duration), 0.0, duration)
        turn = pieces("detuning", detuning_in_time(laser.detuning, duration), 0.0, duration)
        powers.append(power.times(2 * resonances[f].bus_rate * eq.NS / eq.UW))
        turns.append(add([turn.times(2 * np.pi * eq.NS), dT.times(resonances[f].thermal_shift * eq.NS)]))
    apart = table([add([turn, turns[first[f]].times(-1.0)]) for f, turn in zip(at, turns, strict=True)])
    phase = integral(apart)
    phase.coefficients[:, :, 0] += [one.phase - lasers[first[f]].phase for f, one in zip(at, lasers, strict=True)]
    drive = Drive(
        edges=joint(*powers, *turns) / eq.NS,
        power=table(powers),
        phase=phase,
        detuning=table([turns[k] for k in first]),
        entry=(np.array(at) == np.arange(len(resonances))[:, None]).astype(complex),
        brightest=np.array([largest(power) for power in powers]),
    )
    return drive, float(np.abs(apart.coefficients[:, :, 0]).max())


def variables_of(found: Traces, resonances: list[RingResonator], light: dict[str, Any]) -> dict[str, tuple[Any, ...]]:
    """Variables of the Dataset: those of `simulate` on the first resonance, probe_* over the others."""
    from thermofem.data import dataset

    U = np.abs(found.fields) ** 2
    bus = np.sqrt([[2 * one.bus_rate] for one in resonances])
    ports = {
        "energy": U,
        "drop": U * [[2 * one.drop_bus_rate] for one in resonances],
        "through": np.abs(found.incoming + 1j * bus * found.fields) ** 2,
        "input_power": np.abs(found.incoming) ** 2,
    }
    shared = {"carriers": found.carriers, "delta_T": found.delta_T, "absorbed": found.absorbed}
    varying = {name: value for name, value in light.items() if not isinstance(value, float) and name != "input_power"}
    stop = float(found.time[-1])
    shared |= {name: pieces(name, value, 0.0, stop)(found.time) for name, value in varying.items()}
    if ring_scatters(resonances):
        ports["scattered"] = U * [[2 * one.scattering_rate] for one in resonances]
    out: dict[str, tuple[Any, ...]] = {}
    for name, rows in ports.items():
        if name != "input_power" or np.ptp(rows[0]) > 0:
            out[name] = ("time", rows[0], dataset.describe(name))
        if len(resonances) > 1:
            about = dataset.describe(name)
            out[f"probe_{name}"] = (
                ("probe", "time"), rows[1:], about | {"long_name": f"{about['long_name']}, other resonances"},
            )  # fmt: skip
    out |= {name: ("time", values, dataset.describe(name)) for name, values in shared.items()}
    if len(resonances) > 1:
        where = {"units": "Hz", "long_name": "cold resonance"}
        out["resonance"] = ("probe", np.array([one.frequency for one in resonances[1:]]), where)
    return out


def ring_scatters(resonances: list[RingResonator]) -> bool:
    """Whether any resonance has a loss by scattering."""
    return any(one.scattering_rate > 0 for one in resonances)


def further_fields(initial: State | xr.Dataset | None) -> dict[float, Array]:
    """Re and Im in sqrt(J) of the light where a run ended, by the frequency of each other resonance in Hz.

    A resonance that no laser is on any more loses it within some lifetimes of its light, and is left out.
    """
    attrs = getattr(initial, "attrs", {})
    if np.size(attrs.get("final_fields", ())) == 0:
        return {}
    fields = checks.array("initial.attrs['final_fields']", attrs["final_fields"])
    places = checks.array("initial.attrs['final_resonances']", attrs.get("final_resonances", ()))
    if fields.size != 2 * places.size:
        raise checks.InputError(
            f"initial has {fields.size} numbers of light on {places.size} other resonances; two of each are needed"
        )
    return dict(zip(places.tolist(), fields.reshape(-1, 2), strict=True))
