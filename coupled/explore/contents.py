"""Content of the page: rings, thermal models, presets, as JSON of plain numbers in SI."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from thermofem import checks
from thermofem.models import Foster, OutputMap, Quadratic, StateSpace, ThermalModel
from thermofem.models.contract import bare

from .. import parameters
from ..cycles.cycle_folds import cycle_fold_curves
from ..equilibria.bifurcation_curves import subcritical
from ..heaters import LARGEST_POWER, Channels, channels
from ..resonator import RingResonator
from .bundle import text_of
from .rings import OF_MAPS, Window, place_of

LARGEST = 60  # poles; a trace of 20 us with that many takes a browser some 30 ms
HEATERS = 3
TRAINED_LAW = "second order, experiment (Borghi 2021)"
NEWTON_LAW = "Newton's law, 275 ns (Borghi 2021)"
SMALL_LAW = "Newton's law, 65 ns (Van Vaerenbergh 2012)"
# folds of cycles of the preset (Newton's law of Borghi et al.); `stored` says how they were made, a test compares them
STORED = "cycle_folds.json"
POINTS = 80  # of a curve
SERIES = 6  # models that a figure can tell apart by colour


class Parts(NamedTuple):
    """Parts of a model that the light heats and that are read; by default its first input, and the same part."""

    heated: str | None = None
    read: str | None = None


FIRST = Parts()


def channels_of(model: ThermalModel, parts: Parts) -> Channels:
    """Return the channel of the light, and those of all other inputs, which are heaters."""
    system = bare(model)
    if not isinstance(system, StateSpace) or (len(system.inputs), len(system.outputs)) == (1, 1):
        return channels(model)
    heated = parts.heated or system.inputs[0]
    others = {name: 0.0 for name in system.inputs if name != heated}
    return channels(model, others, heated, parts.read)


def model_of(name: str, model: ThermalModel, parts: Parts = FIRST) -> dict[str, Any]:
    """Return a thermal model as the page takes it; with heaters, residues R_i (K/W) for each of them.

    Raises InputError: a model of a kind that the page cannot run, too large, or not passive.
    """
    hint = "the page runs Foster networks, small linear models and OutputMap over one"
    small, transfers = channels_of(model, parts)
    if isinstance(small, Quadratic):
        raise checks.InputError(
            f"model {name!r} is quadratic; {hint}: give a linear reduction (surrogate.reduce) or surrogate.output_map"
        )
    linear = small.linear if isinstance(small, OutputMap) else small
    if linear.order > LARGEST:
        raise checks.InputError(
            f"model {name!r} has {linear.order} poles, at most {LARGEST} run in the page; "
            "reduce it first (surrogate.reduce)"
        )
    if len(transfers) > HEATERS:
        raise checks.InputError(f"model {name!r} has {len(transfers)} heaters, at most {HEATERS} fit in the page; reduce fewer inputs")  # fmt: skip  # noqa: E501
    heaters = {
        "heated": small.inputs[0],
        "read": small.outputs[0],
        "heaters": {key: np.asarray(transfer.R, dtype=float).tolist() for key, transfer in transfers.items()},
    }
    return (heaters if transfers else {}) | {
        "name": name,
        "R": np.asarray(linear.R, dtype=float).tolist(),
        "tau": np.asarray(linear.tau, dtype=float).tolist(),
        "coefficient": small.coefficient if isinstance(small, OutputMap) else 0.0,
    }


def models_of(models: ThermalModel | Mapping[str, ThermalModel], parts: Parts = FIRST) -> list[dict[str, Any]]:
    """Return the models that were given, each with its name."""
    if not isinstance(models, Mapping):
        order = getattr(models, "order", None)
        models = {f"{type(models).__name__}{f', {order} poles' if order else ''}": models}
    if not 1 <= len(models) <= SERIES:
        raise checks.InputError(f"models has {len(models)} entries; give 1 to {SERIES}, by name")
    for word, given, ports in zip(Parts._fields, parts, ("inputs", "outputs"), strict=True):
        known = {str(one) for model in models.values() for one in getattr(bare(model), ports, ("core",))}
        if given is not None:
            checks.choice(word, given, known)
    return [model_of(str(name), model, parts) for name, model in models.items()]


def heaters_of(models: list[dict[str, Any]], ring: dict[str, Any], shift: float) -> list[dict[str, Any]]:
    """Return the heaters of all models, each with what its slider spans in mW: twice the window of detunings.

    ``shift`` is d(omega)/d(dT) of the ring in rad/s/K.
    """
    found: dict[str, float] = {}
    for model in models:
        for name, R in model.get("heaters", {}).items():
            found[name] = max(found.get(name, 0.0), abs(sum(R)))
    if len(found) > HEATERS:
        raise checks.InputError(f"the models have the heaters {', '.join(found)}; at most {HEATERS} fit in the page")
    low, high = ring["window"]["detuning"]
    wanted = {name: 2 * (high - low) * 1e9 * 2 * math.pi / max(shift * R, 1.0) for name, R in found.items()}  # W
    return [{"name": name, "span": float(f"{1e3 * min(P, LARGEST_POWER):.1g}")} for name, P in wanted.items()]


def paper_models() -> list[dict[str, Any]]:
    """Return the thermal laws of the papers, which belong to the presets."""
    laws = {
        "second order, FEM-trained (Borghi 2021)": _second_order(parameters.SECOND_ORDER_FEM),
        TRAINED_LAW: _second_order(parameters.SECOND_ORDER_EXPERIMENT),
        NEWTON_LAW: newton(parameters.NEWTON_MAPS),
        SMALL_LAW: newton(parameters.VAN_VAERENBERGH),
    }
    return [model_of(name, law) | {"hidden": True} for name, law in laws.items()]


def place_of_law(name: str, models: list[dict[str, Any]]) -> int:
    """Return the place of a law of the papers among the models; a model that was given may have the same name."""
    return next(k for k, model in enumerate(models) if model.get("hidden") and model["name"] == name)


def newton(law: parameters.NewtonParameters) -> Foster:
    """Return the pole of Newton's law."""
    return Foster(R=[law.tau_th / law.heat_capacity], tau=[law.tau_th])


def _second_order(law: parameters.SecondOrderParameters) -> Foster:
    """Two poles of Eq. 3: c_f = (eta/tau_f - kappa)/(1/tau_f - 1/tau_s), c_s = (kappa - eta/tau_s)/(same)."""
    fast, slow = 1 / law.tau_f, 1 / law.tau_s
    c_f = (law.eta * fast - law.kappa) / (fast - slow)
    c_s = (law.kappa - law.eta * slow) / (fast - slow)
    return Foster(R=[c_f * law.tau_f / law.heat_capacity, c_s * law.tau_s / law.heat_capacity], tau=[law.tau_f, law.tau_s])  # fmt: skip  # noqa: E501


def presets(rings: list[dict[str, Any]], models: list[dict[str, Any]], start: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the points worth seeing first: of the given ring, and of two papers."""

    def at(ring: RingResonator, law: str) -> dict[str, int]:
        return {"ring": place_of(ring, rings), "model": place_of_law(law, models)}

    own = {"ring": 0, "model": start["model"]}
    paper = at(parameters.borghi2021(), TRAINED_LAW)
    lumped = at(parameters.borghi2021().with_lumped_fcd(), NEWTON_LAW)
    small = at(parameters.vanvaerenbergh2012(), SMALL_LAW)
    cold = {"view": "cold"}
    rows: Iterable[tuple[str, dict[str, Any], str]] = [
        ("This ring, as the file was written", own | start, ""),
        ("Borghi 2021: self-pulsing at 8 dBm, 0 GHz", paper | {"power": 8.0, "detuning": 0.0},
         "Second-order heat as trained on measured traces: a fast and a slow time constant."),
        ("Borghi 2021: short pulses at 10 dBm, 20 GHz", paper | {"power": 10.0, "detuning": 20.0},
         "On the blue side the pulses are rare and short."),
        ("Borghi 2021: bistable at 7 dBm, -28 GHz", paper | {"power": 7.0, "detuning": -28.0} | cold,
         "Three fixed points: one stable, a saddle, an unstable focus. From cold the ring stays on the first."),
        ("Borghi 2021: Newton's law at 7 dBm, -10 GHz", lumped | {"power": 7.0, "detuning": -10.0},
         "One time constant: the swing is three times that of the second-order law, and the duty far too small."),
        ("Van Vaerenbergh 2012: pulsing all-pass ring", small | {"power": -2.2185, "detuning": -7.0},
         "Critically coupled, Q = 62 000, lifetime 5.3 ns: pulses of 79 ns. The paper's Fig. 3 is at -7.7 GHz."),
    ]  # fmt: skip
    return [{"name": name, "state": start | state, "text": text} for name, state, text in rows]


def borders(
    rings: list[dict[str, Any]], models: list[dict[str, Any]], ring: RingResonator, model: ThermalModel | None
) -> list[dict[str, Any]]:
    """Return the folds of cycles of the first view and of a preset, which the page does not follow itself.

    With the places of ring and model among those of the page; points (W, Hz).
    """
    place = {"ring": place_of(preset_ring(), rings), "model": place_of_law(NEWTON_LAW, models)}
    out = [place | {"curves": json.loads(text_of(STORED))}]
    if model is not None:
        out.append({"ring": 0, "model": 0, "curves": curves_of(ring, model, rings[0]["window"])})
    return [entry for entry in out if entry["curves"]]


def curves_of(ring: RingResonator, model: ThermalModel, window: Window) -> list[list[list[float]]]:
    """Return the folds of cycles in a window (dBm, GHz), where a Hopf curve in or near it is subcritical."""
    axes = 1e-3 * 10 ** (np.array(window["power"]) / 10), np.array(window["detuning"]) * 1e9
    try:
        if not subcritical(ring, model, *axes):
            return []
        found = cycle_fold_curves(ring, model, *axes)
    except checks.InputError:  # a window that the steady states of this ring do not reach
        return []
    return [_thinned(curve["power"].values, curve["detuning"].values) for curve in found]


def _thinned(power: np.ndarray, detuning: np.ndarray) -> list[list[float]]:
    """At most `POINTS` points of a curve, with the digits that a figure needs."""
    k = np.unique(np.linspace(0, power.size - 1, POINTS).astype(int))
    return [[float(f"{P:.7g}"), float(f"{nu:.7g}")] for P, nu in zip(power[k], detuning[k], strict=True)]


def preset_ring() -> RingResonator:
    """Return the ring of the stored curves."""
    return parameters.borghi2021().with_lumped_fcd()


def stored() -> str:
    """Return the text of the file of the preset's curves, computed anew."""
    return json.dumps(curves_of(preset_ring(), newton(parameters.NEWTON_MAPS), OF_MAPS)) + "\n"
