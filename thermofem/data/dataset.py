"""Training data as xarray Datasets: one schema, netCDF in and out.

Dimensions and variables
    time (s); delta_T (K) over time, and over probe where several parts are read; power (W) over time, continuous from
    the right at jumps. Where the temperature field was kept: field (K) over field_time and vertex, with the coordinates
    r, z (m) of the vertices and triangles over (triangle, corner).
Attributes
    schema, thermofem_version, kind ("transient", from rest, or "periodic"), waveform (JSON), heated, read, and what
    made the data: geometry (TOML), temperature_dependent (1 where k or c_p follows T), mesh_hash, materials, solver
    settings, energy balance.

Data measured or simulated elsewhere trains like our own once it has time, power and delta_T.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from .. import __version__, checks, waveforms
from ..arrays import Array, ArrayLike, Indices, Mask
from ..checks import InputError
from .data_doubts import clipping, contradictions
from .netcdf import SCHEMA, load, save
from .variables import contents, describe, unit_of, variables

__all__ = ["Response", "at_probe", "build", "describe", "load", "response_of", "responses_of", "save", "variables"]

log = logging.getLogger("thermofem")

TRAINING = "a Dataset of time, delta_T, and power or the waveform that heated"
FEWEST = 8  # samples that a training takes
POSSIBLE = 1e-30, 1e12  # s or K: any time and rise, with squares and sums that floats hold
START, REST, NOISE = "start_within", "rest_rows", "rest_noise"  # attributes of a measured trace, see `Response`
LIGHT_UNIT = "light_unit"  # of a trace of light: "W", "V", or "" of an arbitrary unit
START_FROM = "start_from"  # the same: "given", or found by the "rise" of the part that is heated or by "light"
_NAMES = "the data were read in {}: one model follows them only where these are names of one part"
_OTHER = "the data are of two geometries or more, which one model cannot follow: fit each on its own"


@dataclass(frozen=True, eq=False)
class Response:
    """A drive and the temperature rise under it, as the fits take them.

    times, rise [s and K]
    periodic: one period of the periodic state, not a transient from rest.
    name: the drive in words.
    thermal_resistance [K/W]: that the Dataset states.
    doubts: what makes the data doubtful, see `data_doubts`.
    start_within [s]: how far from t = 0 the heating may begin, of a measured trace; 0 where the start is known. Of
        light the heating begins so much later at most, and not before.
    rest_rows: rows at rest whose mean was subtracted as the baseline, of a measured trace; infinite where it is known.
    rest_noise [K]: standard deviation of the rows at rest, nan where there are none.
    """

    wave: waveforms.Waveform
    times: Array
    rise: Array
    periodic: bool
    name: str
    thermal_resistance: float | None = None
    doubts: tuple[str, ...] = ()
    start_within: float = 0.0
    rest_rows: float = float("inf")
    rest_noise: float = float("nan")

    @property
    def swing(self) -> float:
        """Largest minus smallest rise in K."""
        return float(np.ptp(self.rise))


def build(
    times: ArrayLike,
    delta_T: ArrayLike,
    wave: waveforms.Waveform,
    *,
    periodic: bool = False,
    read: tuple[str, ...] = ("core",),
    attributes: Mapping[str, Any] | None = None,
) -> xr.Dataset:
    """Make a Dataset in the schema of this module.

    times [shape (n,), s]
    delta_T [shape (n,) or (n, probes), K]
    read: names of the probes.
    attributes: provenance.
    Raises InputError: times that do not increase, numbers that are not finite, a rise of another length, no waveform;
        more than one period where ``periodic``.
    """
    read = checks.instances("read", read, str)
    times = checks.array("times", times, increasing=True)
    rise = checks.numbers("delta_T", delta_T)
    if rise.shape not in ((times.size,), (times.size, len(read))):
        raise InputError(
            f"delta_T has shape {rise.shape}; a value for each of {times.size} times is needed, or for each of "
            f"{len(read)} probes at each time"
        )
    if checks.flag("periodic", periodic):
        _check_one_period("times", times, wave)
    several = rise.ndim == 2
    dimensions = ("time", "probe") if several else "time"
    variables = {
        "delta_T": (dimensions, rise, describe("delta_T")),
        "power": ("time", wave(times), describe("power")),
    }
    coordinates: dict[str, Any] = {"time": ("time", times, describe("time"))}
    if several:
        coordinates["probe"] = ("probe", list(read), {"long_name": "part whose mean is read"})
    attrs = stamp("periodic" if periodic else "transient")
    attrs["waveform"] = waveforms.to_json(wave, float(times[-1]))
    attrs["read"] = ", ".join(read)
    attrs |= checks.mapping("attributes", attributes)
    return xr.Dataset(variables, coordinates, attrs)


def stamp(kind: str) -> dict[str, Any]:
    """Attributes of every Dataset: schema, version of the code, and kind."""
    return {"schema": SCHEMA, "thermofem_version": __version__, "kind": kind}


def at_probe(data: xr.Dataset, read: str | None = None) -> xr.Dataset:
    """One probe of a Dataset, whose attributes ``read`` and ``thermal_resistance`` become those of that probe.

    read: name of the probe; default the one that ``data.sel(probe=...)`` has picked, if any.
    Raises InputError: a name that is none of the probes', thermal resistances that are no numbers.
    """
    if read is not None:
        several = "probe" in getattr(data, "dims", ())
        probes = data["probe"].values if several else [data.attrs.get("read", read)]
        checks.choice("read", read, [str(probe) for probe in probes])
        data = data.sel(probe=read) if several else data
    if "probe" not in getattr(data, "coords", {}) or data["probe"].ndim:
        return data
    name = str(data["probe"].values)
    stated = str(data.attrs.get("read", ""))
    names = [part.strip() for part in stated.split(",")]
    if name not in names or len(names) == 1:
        return data
    gains = np.ravel(data.attrs.get("thermal_resistances", ()))
    attrs = {key: value for key, value in data.attrs.items() if not key.startswith("thermal_resistance")}
    if gains.size == len(names):
        gain = gains[names.index(name)].item()
        attrs["thermal_resistance"] = checks.finite("data.attrs['thermal_resistances']", gain)
    picked = data.copy()
    picked.attrs = {**attrs, "read": name}
    return picked


def response_of(data: xr.Dataset) -> Response:
    """Read the drive and the response from a Dataset.

    Raises InputError: not a Dataset with time, power and delta_T; several probes; numbers that are not finite; no
        heating at all; a time that stands twice with two temperatures; a temperature that contradicts the
        ``thermal_resistance``.
    """
    drive = () if "waveform" in getattr(data, "attrs", ()) else ("power",)
    data = at_probe(contents("data", data, ("time", "delta_T", *drive), what=TRAINING))
    times = checks.array("data.time", data["time"].values, increasing=True)
    if more := [str(dim) for dim in data["delta_T"].dims if dim != "time"]:
        pick = "data.sel(probe='core'), or --read core" if more == ["probe"] else f"data.isel({more[0]}=0)"
        raise InputError(f"data.delta_T has a dimension {more[0]!r} beside time", f"pick one with {pick}")
    rise = checks.array("data.delta_T", data["delta_T"].values)
    checks.enough("data", times.size, FEWEST)
    checks.between("the span of data.time", np.ptp(times), *POSSIBLE, unit="s", hint="is time in another unit?")
    checks.between("the largest of data.delta_T", np.max(np.abs(rise)), *POSSIBLE, unit="K")
    checks.between("the swing of data.delta_T", np.ptp(rise), *POSSIBLE, unit="K")
    if "waveform" in data.attrs:
        wave = waveforms.from_json(data.attrs["waveform"])
        times = _on_edges(times, wave)
        _check_power(data, wave, times)
    else:
        wave = waveforms.Sampled(times, data["power"].values)
    _check_times(wave, times, rise)
    kind = checks.choice("data.attrs['kind']", data.attrs.get("kind"), ("transient", "periodic"), default="transient")
    periodic = kind == "periodic"
    if periodic:
        _check_one_period("data.time", times, wave)
    gain = data.attrs.get("thermal_resistance")
    if gain is not None:
        gain = checks.positive("data.attrs['thermal_resistance']", gain, unit="K/W")
    doubts = contradictions(data, gain, wave, times, rise, periodic=periodic)
    if clipped := clipping(rise, unit_of(data.attrs.get("assumed", ""))):
        doubts.append(clipped)
    words = f"{wave.words}, {'periodic state' if periodic else 'from rest'}"
    # 100.0 of the span of a trace: how far its start may be off, where most of its rows were left out
    within = _estimated(data, START, 0.0, 100.0 * float(np.ptp(times)))
    rest = _estimated(data, REST, np.inf, POSSIBLE[1])
    noise = _estimated(data, NOISE, np.nan, POSSIBLE[1])
    within = min(within, float(times[-1]) / FEWEST)
    return Response(wave, times, rise, periodic, words, gain, tuple(doubts), within, rest, noise)


def _check_one_period(name: str, times: Array, wave: waveforms.Waveform) -> None:
    """Raise InputError where the times of a periodic state extend beyond one period."""
    if wave.period is not None and times[-1] > wave.period * (1 + 1e-9):
        held = f"a periodic state is one period of {wave.period:g} s"
        raise InputError(f"{name} runs to {times[-1]:g} s; {held}", "leave the later periods out")


def _estimated(data: xr.Dataset, name: str, known: float, most: float) -> float:
    """Uncertainty of start or baseline that a measured trace states, 0 to ``most``; ``known`` where it states none."""
    value = data.attrs.get(name)
    name = f"data.attrs[{name!r}]"
    return known if value is None else checks.between(name, value, 0, most)


def responses_of(data: xr.Dataset | Sequence[xr.Dataset]) -> list[Response]:
    """`response_of` of one Dataset, or of every one of a list.

    Raises
    ------
    InputError
        an empty list; traces of two channels.
    """
    datasets: Any = data if isinstance(data, list | tuple) else [data]
    responses: list[Response] = []
    for k, trace in enumerate(datasets):
        with checks.prefixed(f"data[{k}]" if len(datasets) > 1 else ""):
            responses.append(response_of(trace))
    checks.enough("data", len(responses), 1, "Datasets")
    doubts = check_together([at_probe(trace) for trace in datasets])
    return [replace(response, doubts=(*response.doubts, *doubts)) for response in responses]


def warn_of(responses: Sequence[Response]) -> None:
    """Log the doubts about the data as warnings, each sentence once."""
    for doubt in dict.fromkeys(doubt for response in responses for doubt in response.doubts):
        log.warning("%s", doubt)


def repeats(times: Array, rise: Array, tolerance: float) -> tuple[Indices, Mask]:
    """Rows whose time the next one repeats, and which of these differ by more than ``tolerance`` of the swing.

    The second of two repetitions counts as such, too: a time may stand twice, not three times.
    """
    same = np.flatnonzero(np.diff(times) == 0)
    apart = np.abs(np.diff(rise)[same]) > tolerance * np.ptp(rise)
    return same, apart | np.isin(same - 1, same)


def _check_times(wave: waveforms.Waveform, times: Array, rise: Array) -> None:
    """Raise InputError where a time occurs twice, except at a jump of the power with one temperature on both sides."""
    same, differ = repeats(times, rise, 1e-3)
    t = times[same]
    wrong = same[differ | (wave(t) == wave.before(t))]
    if wrong.size:
        k = wrong[0]
        raise InputError(
            f"data.time has {times[k]:g} s twice, with delta_T = {rise[k]:g} and {rise[k + 1]:g} K; a time may "
            "stand twice only where the power jumps; take one out, or average them"
        )


def _on_edges(times: Array, wave: waveforms.Waveform) -> Array:
    """Times of which those within round-off of a breakpoint of the power are set to it exactly."""
    largest = float(np.abs(times[[0, -1]]).max())
    # 1e-14: times that were written in other units miss an edge of the power by that much
    slack = 1e-14 * largest
    end = times[-1] + 1e-3 * float(np.ptp(times))
    edges = np.append(wave.breakpoints(times[0], end), np.inf)
    edge = edges[np.searchsorted(edges, times - slack)]  # the first that is not before
    return np.where(np.abs(edge - times) <= slack, edge, times)


def _check_power(data: xr.Dataset, wave: waveforms.Waveform, times: Array) -> None:
    """Raise InputError where the power variable contradicts the waveform; at a jump either side's value is right."""
    if "power" not in data:
        return
    power = checks.array("data.power", data["power"].values)
    right = wave(times)
    left = wave.before(times)
    checks.shape("data.power", power, times.shape)
    highest = float(np.max(np.abs(right)))
    scale = max(highest, np.finfo(float).tiny)
    misfit = np.minimum(np.abs(power - right), np.abs(power - left))
    wrong = misfit > 1e-6 * scale
    if wrong.any():
        k = int(np.argmax(wrong))
        raise InputError(
            f"data.power[{k}] = {power[k]:g} W contradicts the waveform attribute ({right[k]:g} W); drop one of them"
        )


def check_together(datasets: Sequence[Any]) -> tuple[str, ...]:
    """Sentences on what differs between Datasets that train one model; an attribute that one lacks counts as equal.

    A measured table states no heated part, and its read part is the name of its column, which need not be a part.

    Raises InputError: another heated part, or another part that is read.
    """
    attrs = [data.attrs for data in datasets]
    solved = [(k, stated) for k, stated in enumerate(attrs) if stated.get("heated")]
    for what in ("heated", "read"):
        parts = [(k, str(stated[what])) for k, stated in solved if stated.get(what)]
        for k, part in parts[1:]:
            first, other = parts[0]
            if part != other:
                here = f"data[{k}] was {what} in {checks.shown(part)}"
                there = f"data[{first}] in {checks.shown(other)}"
                raise InputError(f"{here} and {there}: two channels; fit each on its own")
    doubts = []
    for what, words in (("read", _NAMES), ("geometry", _OTHER)):
        values = dict.fromkeys(str(stated[what]) for stated in attrs if stated.get(what))
        if len(values) > 1:
            listed = " and ".join(map(checks.shown, values))
            doubts.append(words.format(listed))
    return tuple(doubts)
