"""Curves of folds of cycles for the page, which does not follow them itself: those of its first view and of a preset.

Those of the preset (Newton's law of Borghi et al.) are kept in ``cycle_folds.json``; `stored` says how they were made,
and a test compares them.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from thermofem.checks import InputError
from thermofem.models import ThermalModel

from ..parameters.borghi2021 import NEWTON_MAPS, borghi2021
from ..resonator import RingResonator
from . import bundle
from .contents import NEWTON_LAW, newton, place_of_law
from .rings import OF_MAPS, Window, place_of

STORED = "cycle_folds.json"
POINTS = 80  # of a curve


def borders(
    rings: list[dict[str, Any]], models: list[dict[str, Any]], ring: RingResonator, model: ThermalModel | None
) -> list[dict[str, Any]]:
    """Return the curves with the places of ring and model among those of the page: points (W, Hz)."""
    place = {"ring": place_of(preset_ring(), rings), "model": place_of_law(NEWTON_LAW, models)}
    out = [place | {"curves": json.loads(bundle.text_of(STORED))}]
    if model is not None:
        out.append({"ring": 0, "model": 0, "curves": curves_of(ring, model, rings[0]["window"])})
    return [entry for entry in out if entry["curves"]]


def curves_of(ring: RingResonator, model: ThermalModel, window: Window) -> list[list[list[float]]]:
    """Return the folds of cycles in a window (dBm, GHz), where a Hopf curve in or near it is subcritical."""
    from ..equilibria.bifurcation_curves import subcritical

    axes = 1e-3 * 10 ** (np.array(window["power"]) / 10), np.array(window["detuning"]) * 1e9
    try:
        if not subcritical(ring, model, *axes):
            return []
        from ..cycles.cycle_folds import cycle_fold_curves  # half a second of imports

        found = cycle_fold_curves(ring, model, *axes)
    except InputError:  # a window that the steady states of this ring do not reach
        return []
    return [_thinned(curve["power"].values, curve["detuning"].values) for curve in found]


def _thinned(power: np.ndarray, detuning: np.ndarray) -> list[list[float]]:
    """At most `POINTS` points of a curve, with the digits that a figure needs."""
    k = np.unique(np.linspace(0, power.size - 1, POINTS).astype(int))
    return [[float(f"{P:.7g}"), float(f"{nu:.7g}")] for P, nu in zip(power[k], detuning[k], strict=True)]


def preset_ring() -> RingResonator:
    """Return the ring of the stored curves."""
    return borghi2021().with_lumped_fcd()


def stored() -> str:
    """Return the text of the file of the preset's curves, computed anew."""
    return json.dumps(curves_of(preset_ring(), newton(NEWTON_MAPS), OF_MAPS)) + "\n"
