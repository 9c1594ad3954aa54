"""Several lasers on one ring: pump and probe, or a pair on neighbouring resonances.

The equations are those of `kernels.several`: every resonance has a field of its own, all share carriers and heat, and
two-photon absorption and the Kerr effect of another resonance count twice. Lasers on one resonance beat.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from thermofem import checks
from thermofem.arrays import Array, NDArray
from thermofem.data.display import shown

from ..arguments import detuning_in_time, power_in_time
from ..inputs import Input, add, joint, pieces
from ..kernel.tableaus import Method, tableau
from ..resonator import RingResonator
from ..states import State
from ..thermal import Compact
from .driven import Spans, beats, spans
from .window import LONG, MANY, MAX_STEPS, check_end, floor_of, units

if TYPE_CHECKING:
    import xarray as xr

BEAT = 0.1  # of a beat, that a step may last
QUIET = 0.1  # of the carriers' lifetime


@shown
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
    from ..kernels import equations as eq
    from ..kernels import several
    from ..kernels.interrupts import new_watch, uninterrupted, watched

    resonances = [ring]
    for one in lasers:
        if one.resonance is not None and one.resonance not in resonances:
            resonances.append(one.resonance)
    light, beat = _light(ring, resonances, lasers, duration, offset)
    rates, fcd = eq.internal_rates(ring)
    modes = np.array([_mode(one, ring) for one in resonances])
    thermal, n = eq.internal_thermal(model), np.size(state.thermal)
    unit = np.concatenate([units(n), np.full(2 * len(resonances) - 2, eq.FJ**0.5)])
    extra = np.ravel([fields.get(one.frequency, (0.0, 0.0)) for one in resonances[1:]])
    floor = floor_of(rates, math.sqrt(several.brightest(light)), model.thermal_resistance * eq.UW)
    longest = min(QUIET * rates.tau0, BEAT * 2 * math.pi / beat if beat else math.inf)
    call = uninterrupted
    if duration > LONG or duration / eq.NS > MANY * longest:
        call = partial(watched, progress=(lambda t: progress(t * eq.NS)) if progress else None)
    rows, y, reached, counts = call(
        several.integrate, np.concatenate([state.as_array(), extra]) / unit, n, light, modes, rates, fcd, thermal,
        tableau(method), rtol, floor, np.asarray(times) / eq.NS, longest, MAX_STEPS, new_watch(),
    )  # fmt: skip
    check_end(counts, reached, duration, rtol)
    if progress:
        progress(float(reached * eq.NS))
    t, N, dT = rows[:, 0], rows[:, 3], rows[:, 4]
    columns = [1, *range(5, rows.shape[1], 2)]
    a = (rows[:, columns] + 1j * rows[:, [c + 1 for c in columns]]).T
    U = np.abs(a) ** 2
    W = 2 * U.sum(axis=0) - U
    own = modes[:, [several.ABSORBED]] + modes[:, [several.FCA]] * N + modes[:, [several.TPA]] * W
    rate = np.sqrt([[2 * one.bus_rate * eq.NS] for one in resonances])
    rise = offset if isinstance(offset, float) else pieces("offset", offset, 0.0, duration)(t * eq.NS)
    final = y * unit
    found = Traces(
        t * eq.NS, a * eq.FJ**0.5, N * eq.DENSITY, dT + rise, 2 * (own * U).sum(axis=0) * eq.UW,
        _incoming(light, t, len(resonances)) / rate * eq.UW**0.5, State.from_array(final[: 3 + n]), final[3 + n :],
        reached * eq.NS, counts[:2],
    )  # fmt: skip
    return found, resonances


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


def _mode(one: RingResonator, ring: RingResonator) -> list[float]:
    """The rates of one resonance, in the order of `kernels.several`."""
    from ..kernels import equations as eq

    r = eq.internal_rates(one)[0]
    return [r.loss, r.absorbed, r.fca, r.tpa, r.g, r.thermal_shift, one.index_rate / ring.index_rate, r.kerr]


def _light(
    ring: RingResonator, resonances: list[RingResonator], lasers: Sequence[Laser], duration: float, offset: Any
) -> tuple[Any, float]:
    """The lasers as the compiled integration takes them, and the fastest beat on one resonance in rad/ns."""
    from ..kernels import equations as eq
    from ..kernels.several import Lasers

    at = [0 if one.resonance is None else resonances.index(one.resonance) for one in lasers]
    powers = [pieces("power", power_in_time(one.power, duration), 0.0, duration) for one in lasers]
    turns = [pieces("detuning", detuning_in_time(one.detuning, duration), 0.0, duration) for one in lasers]
    dT = pieces("offset", offset, 0.0, duration)
    edges = joint(*powers, *turns, dT)
    scale = eq.NS ** np.arange(4)
    squared, detuning = [], []
    for f, power, turn in zip(at, powers, turns, strict=True):
        one = resonances[f]
        squared.append(power.on(edges).coefficients * (2 * one.bus_rate * eq.NS / eq.UW) * scale)
        parts = [turn.times(2 * np.pi * eq.NS), dT.times(one.thermal_shift * eq.NS)]
        detuning.append(add(parts).on(edges).coefficients * scale)
    first = np.array([at.index(f) for f in range(len(resonances))])
    d, h = np.array(detuning), np.diff(edges) / eq.NS
    apart = d - d[first[at]]
    gained = (apart * h[:, None] ** np.arange(1, 5) / np.arange(1, 5)).sum(axis=2)
    phase = np.cumsum(gained, axis=1) - gained + np.array([[one.phase] for one in lasers])
    phase -= phase[first[at], :1]
    return Lasers(edges / eq.NS, np.array(squared), d, phase, np.array(at), first), float(np.abs(apart[:, :, 0]).max())


def _incoming(light: Any, t: Array, resonances: int) -> NDArray[np.complex128]:
    """sqrt(2 gamma_e P) exp(i theta) on every resonance, shape (resonances, times), internal units."""
    piece = np.clip(np.searchsorted(light.edges, t, side="right") - 1, 0, light.edges.size - 2)
    u = (t - light.edges[piece])[:, None] ** np.arange(5)
    total = np.zeros((resonances, t.size), dtype=complex)
    for k, f in enumerate(light.field):
        power = (light.power[k, piece] * u[:, :4]).sum(axis=1)
        apart = light.detuning[k, piece] - light.detuning[light.first[f], piece]
        turn = light.phase[k, piece] + (apart * u[:, 1:] / np.arange(1, 5)).sum(axis=1)
        total[f] += np.sqrt(np.maximum(power, 0)) * np.exp(1j * turn)
    return total


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
