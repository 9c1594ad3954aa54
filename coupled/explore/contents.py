"""Content of the page: rings, thermal models, families of geometries, presets, as JSON of plain numbers in SI."""

import math
from collections.abc import Mapping
from dataclasses import asdict
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from scipy.optimize import nnls

from thermofem import InputError, checks
from thermofem.arrays import Array
from thermofem.models import Quadratic, ThermalModel, bare, has_ports, newton, second_order
from thermofem.ring_temperature import CORE

from .. import parameters
from ..cycles.cycle_folds import cycle_fold_curves
from ..equilibria.bifurcation_curves import hopf_curves
from ..heaters import Channels, channels
from ..inputs import check_ring
from ..kernel.units import internal_rates
from ..maps.hopf_plane import threshold_plane
from ..resistive_heaters import LARGEST_POWER
from ..resonator import RingResonator
from ..thermal import Compact, as_read, without_origin

POINTS = {1: 33, 2: 13, 3: 8}  # of the grid along each parameter
TAU = np.geomspace(1e-9, 1e-4, 31)  # s; six a decade
TIMES = np.geomspace(2e-10, 1e-3, 90)  # s, at which steps are fitted


def family_of(family: Any, read: str | None = None) -> dict[str, Any]:
    """Return Foster networks of a `surrogate.family.Family` on a grid of its parameters, and the interpolation error.

    read: the output of the family that detunes the ring; default its first.

    All members have the same time constants; R_i >= 0 is fitted to each member's step response by nonnegative least
    squares, with its R_th. Between grid points R_i is interpolated linearly, so the model stays passive. ``error``: the
    largest deviation of the step responses of 24 random members, relative to R_th; ``scale`` converts SI to the shown
    unit. Only the first three parameters vary; the others are fixed at the middle of their range.
    """
    checks.has("family", family, "names", "box", "model", hint="surrogate.train_family or load_family makes one")
    low = np.asarray(family.box.low, dtype=float)
    high = np.asarray(family.box.high, dtype=float)
    names = list(family.names)
    units = list(family.box.units)
    moved = min(len(names), 3)
    points = POINTS[moved]
    middle = dict(zip(names, (low + high) / 2, strict=True))
    read = read or getattr(family, "outputs", (None,))[0]
    logs = [bool(log) for log in getattr(family.box, "logarithmic", [False] * len(names))]
    spaced = [np.geomspace if log else np.linspace for log in logs]
    axes = [spaced[k](low[k], high[k], points) for k in range(moved)]
    shares = []
    for values in product(*axes):
        parameters = middle | dict(zip(names, values, strict=False))
        shares.append(_shares(family.model(read=read, **parameters)))
    rows = np.array(shares)
    grid = [np.linspace(0, 1, points)] * moved
    between = RegularGridInterpolator(grid, rows.reshape(*(points,) * moved, TAU.size))
    draw = np.random.default_rng(1)
    error = 0.0
    for _ in range(24):
        share = draw.uniform(0, 1, moved)
        member = {names[k]: _at(share[k], low[k], high[k], logs[k]) for k in range(moved)}
        exact = family.model(read=read, **(middle | member))
        step = -np.expm1(-TIMES[:, None] / TAU) @ between(share)[0]
        largest = np.abs(step - exact.step_response(TIMES)).max()
        error = max(error, float(largest / exact.thermal_resistance))
    sliders = [
        {
            "name": names[k], "low": low[k], "high": high[k], "moved": k < moved, "log": logs[k],
            "unit": "µm" if units[k] == "m" else units[k], "scale": 1e6 if units[k] == "m" else 1.0,
        }
        for k in range(len(names))
    ]  # fmt: skip
    return {
        "parameters": sliders,
        "points": points,
        "tau": TAU.tolist(),
        "R": [[float(f"{x:.7g}") for x in row] for row in rows],
        "error": error,
    }


def _at(share: float, low: float, high: float, log: bool) -> float:
    """Return the value at the fraction ``share`` of the range from low to high, linear or logarithmic."""
    if log:
        return float(low * (high / low) ** share)
    return float(low + share * (high - low))


def _shares(model: Any) -> Array:
    """Return R_i >= 0 in K/W, shape (31,), on the time constants TAU, fitted to a member's step response; sum R_th."""
    total = model.thermal_resistance
    A = np.vstack([-np.expm1(-TIMES[:, None] / TAU), 100 * np.ones(TAU.size)])
    b = np.append(model.step_response(TIMES), 100 * total) / total
    shares, _ = nnls(A, b)
    return shares * total / shares.sum()


Window = dict[str, tuple[float, float]]  # of powers in dBm and of detunings in GHz

OF_MAPS: Window = {"power": (3.0, 10.0), "detuning": (-30.0, 30.0)}  # the maps of Borghi et al.
OF_SMALL: Window = {"power": (-10.0, 6.0), "detuning": (-35.0, 10.0)}
RESISTANCE = 8e3  # K/W of the strips of the papers
LABELS = ("name", "window", "python", "internal", "index_rate")  # of a ring on the page; all else is its own numbers
MOST_PAGE_POLES = 60  # poles; a trace of 20 us with that many takes a browser some 30 ms
MOST_HEATERS = 3
TRAINED_LAW = "second order, experiment (Borghi 2021)"
NEWTON_LAW = "Newton's law, 275 ns (Borghi 2021)"
SMALL_LAW = "Newton's law, 65 ns (Van Vaerenbergh 2012)"
BORGHI = parameters.borghi2021()
LUMPED = BORGHI.with_lumped_fcd()
# name, ring, thermal law, what the page shows first, and text of a preset
PRESETS: list[tuple[str, RingResonator, str, dict[str, Any], str]] = [
    ("Borghi 2021: self-pulsing at 8 dBm, 0 GHz", BORGHI, TRAINED_LAW, {"power": 8.0, "detuning": 0.0},
     "Second-order heat as trained on measured traces: a fast and a slow time constant."),
    ("Borghi 2021: short pulses at 10 dBm, 20 GHz", BORGHI, TRAINED_LAW, {"power": 10.0, "detuning": 20.0},
     "On the blue side the pulses are rare and short."),
    ("Borghi 2021: bistable at 7 dBm, -28 GHz", BORGHI, TRAINED_LAW, {"power": 7.0, "detuning": -28.0, "view": "cold"},
     "Three fixed points: one stable, a saddle, an unstable focus. From cold the ring stays on the first."),
    ("Borghi 2021: Newton's law at 7 dBm, -10 GHz", LUMPED, NEWTON_LAW, {"power": 7.0, "detuning": -10.0},
     "One time constant: the swing is three times that of the second-order law, and the duty far too small."),
    ("Van Vaerenbergh 2012: pulsing all-pass ring", parameters.vanvaerenbergh2012(), SMALL_LAW,
     {"power": -2.2185, "detuning": -7.0},
     "Critically coupled, Q = 62 000, lifetime 5.3 ns: pulses of 79 ns. The paper's Fig. 3 is at -7.7 GHz."),
]  # fmt: skip
# windows of planes that the papers show; another published ring gets that of `window_of`
SHOWN = {"borghi2021": OF_MAPS, "borghi2021-lumped": OF_MAPS, "vanvaerenbergh2012": OF_SMALL}
MOST_MODELS = 6  # models that a figure can tell apart by colour


class Parts(NamedTuple):
    """Input of a model that the light heats (None: its first), and output that detunes the ring (None: as it reads).

    wanted: the temperature that the ring reads, "core" or "light".
    """

    heated: str | None = None
    read: str | None = None
    wanted: str = CORE


FIRST = Parts()


def channels_of(model: ThermalModel, parts: Parts) -> Channels:
    """Return the model from the light's input to the read output, and those from all other inputs (heaters) to it."""
    system = getattr(bare(model), "without_ambient", model)
    if not has_ports(system):
        return channels(system, parts.wanted)
    heated = parts.heated or system.inputs[0]
    others = {name: 0.0 for name in system.inputs if name != heated}
    return channels(system, parts.wanted, others, heated, parts.read)


def model_of(name: str, model: ThermalModel, parts: Parts = FIRST) -> dict[str, Any]:
    """Return a thermal model as JSON data of the page; with heaters, also the residues R_i (K/W) of each of them.

    Raises InputError: a model of a kind that the page cannot run, too large, or not passive.
    """
    small, transfers = channels_of(model, parts)
    if isinstance(small, Quadratic):
        raise InputError(
            f"model {name!r} is quadratic; the page runs Foster networks, small linear models and OutputMap over one: "
            "give a linear reduction (surrogate.reduce) or surrogate.output_map"
        )
    linear = small.linear
    if linear.order > MOST_PAGE_POLES:
        raise InputError(
            f"model {name!r} has {linear.order} poles, at most {MOST_PAGE_POLES} run in the page; "
            "reduce it first (surrogate.reduce)"
        )
    data: dict[str, Any] = {}
    if transfers:
        residues = {key: np.asarray(transfer.R, dtype=float).tolist() for key, transfer in transfers.items()}
        data |= {"heated": small.inputs[0], "read": small.outputs[0], "heaters": residues}
    data["name"] = name
    data["R"] = np.asarray(linear.R, dtype=float).tolist()
    data["tau"] = np.asarray(linear.tau, dtype=float).tolist()
    data["coefficient"] = small.coefficient
    return data


def models_of(models: Mapping[str, ThermalModel], parts: Parts = FIRST) -> list[dict[str, Any]]:
    """Return the given thermal models, 1 to 6, as JSON data of the page, each with its name."""
    if not 1 <= len(models) <= MOST_MODELS:
        raise InputError(f"models has {len(models)} entries; give 1 to {MOST_MODELS}, by name")
    for word, given, ports in (("heated", parts.heated, "inputs"), ("read", parts.read, "outputs")):
        known = {str(one) for model in models.values() for one in getattr(bare(model), ports, ("core",))}
        if given is not None:
            checks.choice(word, given, known)
    return [model_of(str(name), model, parts) for name, model in models.items()]


def heaters_of(models: list[dict[str, Any]], ring: dict[str, Any], shift: float) -> list[dict[str, Any]]:
    """Return the heaters of all models, each with the largest power of its slider in mW.

    That power shifts the resonance by twice the width of the detuning window. ``shift`` is d(omega)/d(dT) in rad/s/K.
    """
    resistances: dict[str, float] = {}
    for model in models:
        for name, R in model.get("heaters", {}).items():
            resistances[name] = max(resistances.get(name, 0.0), abs(sum(R)))
    if len(resistances) > MOST_HEATERS:
        rule = f"at most {MOST_HEATERS} fit in the page; reduce fewer inputs"
        raise InputError(f"the models have the heaters {', '.join(resistances)}; {rule}")
    low, high = ring["window"]["detuning"]
    twice = 2 * (high - low) * 1e9 * 2 * math.pi  # rad/s
    sliders = []
    for name, resistance in resistances.items():
        power = min(twice / max(shift * resistance, 1.0), LARGEST_POWER)
        sliders.append({"name": name, "span": float(f"{1e3 * power:.1g}")})
    return sliders


def paper_models() -> list[dict[str, Any]]:
    """Return the published thermal models, which the presets use, as JSON data of the page."""
    laws = {
        "second order, FEM-trained (Borghi 2021)": second_order(**asdict(parameters.SECOND_ORDER_FEM)),
        TRAINED_LAW: second_order(**asdict(parameters.SECOND_ORDER_EXPERIMENT)),
        NEWTON_LAW: newton(**asdict(parameters.NEWTON_MAPS)),
        SMALL_LAW: newton(**asdict(parameters.VAN_VAERENBERGH)),
    }
    return [model_of(name, law) | {"hidden": True} for name, law in laws.items()]


def place_of_law(name: str, models: list[dict[str, Any]]) -> int:
    """Return the index of a published thermal model among ``models``; given models of the same name are skipped."""
    return next(k for k, model in enumerate(models) if model.get("hidden") and model["name"] == name)


def presets(rings: list[dict[str, Any]], models: list[dict[str, Any]], start: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the presets of the page, each with name, state and text: the given ring, and points of two papers."""

    own = {"name": "This ring, as the file was written", "state": start, "text": ""}
    shown = [own]
    for name, ring, law, state, text in PRESETS:
        where = {"ring": place_of(ring, rings), "model": place_of_law(law, models)}
        shown.append({"name": name, "state": start | where | state, "text": text})
    return shown


def curves_of(ring: RingResonator, model: Compact, window: Window) -> list[list[list[float]]]:
    """Return the fold curves of cycles in a window of power (dBm) and detuning (GHz), if a Hopf curve is subcritical.

    Each is a list of at most 80 points [power in W, detuning in Hz].
    """
    ring = as_read(ring, model)
    model = without_origin(model)
    axes = 1e-3 * 10 ** (np.array(window["power"]) / 10), np.array(window["detuning"]) * 1e9
    try:
        if not any(np.any(c["leading"] & (c["lyapunov"] > 0)) for c in hopf_curves(ring, model, *axes)):
            return []
        found = cycle_fold_curves(ring, model, *axes)
    except InputError:  # a window that the steady states of this ring do not reach
        return []
    out = []
    for curve in found:  # at most 80 points, with the digits that a figure needs
        kept = curve.isel(point=np.unique(np.linspace(0, curve.sizes["point"] - 1, 80).astype(int)))
        pairs = np.column_stack([kept["power"].values, kept["detuning"].values])
        out.append([[float(f"{x:.7g}") for x in pair] for pair in pairs])
    return out


def rings_of(ring: RingResonator, resistance: float, model: Compact | None = None) -> list[dict[str, Any]]:
    """Return the rings of the page, fields in SI: the given one first, then the published ones that differ from it.

    A ring that has the name of a published one but other numbers is called "(changed)". model: the one that is shown
    first; its Hopf curve sets the window of the given ring. resistance [K/W]: that of the model; within a factor of 3
    of 8e3 K/W, a published ring gets the window of its paper.
    """
    check_ring(ring)

    def described(one: RingResonator, window: Window) -> dict[str, Any]:
        return ring_data(one) | {"python": repr(one), "window": window}

    given = described(ring, window_about(ring, resistance, model))
    known = [described(*each) for each in published()]
    usual = 0.3 < resistance / RESISTANCE < 3
    others = [other for other in known if not same_numbers(given, other)]
    if usual:
        given["window"] = next((other["window"] for other in known if other not in others), given["window"])
    if ring.name in {other["name"] for other in others}:
        given["name"] = f"{ring.name} (changed)"
    return [given, *others]


def ring_data(ring: RingResonator) -> dict[str, Any]:
    """Return the fields of a ring in SI, its index rate, and under "internal" its rates in the kernel's units."""
    rates, dispersion = internal_rates(ring)
    internal = rates._asdict() | {"fcd": dispersion.ravel().tolist()}
    return asdict(ring) | {"index_rate": ring.index_rate, "internal": internal}


def published() -> list[tuple[RingResonator, Window]]:
    """Return the published rings, each with its window of powers (dBm) and detunings (GHz)."""
    rings = parameters.published_rings()
    return [(ring, SHOWN.get(name) or window_of(ring, RESISTANCE)) for name, ring in rings.items()]


def place_of(ring: RingResonator, rings: list[dict[str, Any]]) -> int:
    """Return the index of ``ring`` in the list of rings of the page."""
    return next(k for k, other in enumerate(rings) if same_numbers(asdict(ring), other))


def same_numbers(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether two rings have equal numbers; name, window and Python text are not compared."""
    first = {key: value for key, value in one.items() if key not in LABELS}
    second = {key: value for key, value in other.items() if key not in LABELS}
    return _same(first, second)


def _same(a: Any, b: Any) -> bool:
    """Whether two nested values are equal, floats to a relative 1e-12: a ring file may change the last digit of kT."""
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(_same(a[key], b[key]) for key in a)
    if isinstance(a, tuple | list) and isinstance(b, tuple | list):
        return len(a) == len(b) and all(map(_same, a, b))
    if isinstance(a, int | float) and isinstance(b, int | float):
        return math.isclose(a, b, rel_tol=1e-12)
    return bool(a == b)


def window_about(ring: RingResonator, resistance: float, model: Compact | None) -> Window:
    """Return the window of `window_of`, moved and widened so that it shows the Hopf curve of a model, if it has one.

    Powers: as `threshold_plane`, whose lower end lies 3 dB below the threshold. Detunings: up to the end of the curve.
    """
    window = window_of(ring, resistance)
    if model is None:
        return window
    threshold = threshold_plane(as_read(ring, model), without_origin(model))
    if threshold is None:
        return window
    dbm = 10 * np.log10(threshold.window.powers) + 30
    least = float(dbm[0])
    highest = float(dbm[1])
    width = ring.linear_rate / math.pi
    first, last = window["detuning"]
    before = (threshold.lowest.detuning - width) / 1e9
    end = threshold.window.detunings[1] / 1e9
    detunings = (min(first, float(f"{before:.2g}")), max(last, float(f"{end:.2g}")))
    return {"power": (float(math.floor(least)), float(math.ceil(highest))), "detuning": detunings}


def window_of(ring: RingResonator, resistance: float) -> Window:
    """Return a window of powers (dBm) and detunings (GHz) that is likely to contain the nonlinear regime of a ring.

    Powers: from P1, at which the heat shifts the resonance by half its width, to 20 P1.
    Detunings: from two and a half widths below the cold resonance to one above.
    """
    width = ring.linear_rate / math.pi
    share = 4 * ring.bus_rate * max(ring.loss_rate, 1e-3 * ring.linear_rate) / ring.linear_rate**2
    moved = max(abs(ring.thermal_shift), 1.0) * resistance * share  # rad/s per W
    first = 10 * math.log10(ring.linear_rate / moved / 1e-3)
    first = min(max(round(first), -38), 8)
    span = max(float(f"{width / 1e9:.2g}"), 0.1)
    return {"power": (first, first + 13.0), "detuning": (-2.5 * span, span)}
