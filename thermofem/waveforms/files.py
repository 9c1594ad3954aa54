"""Waveforms as JSON text, as stored with every dataset."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import numpy as np

from .. import checks
from ..data import files
from .contract import KINDS, Waveform
from .piecewise_cubic import PiecewiseCubic

FIT = 1e-7  # of a function by the cubics that a file keeps: a hundredth of what data are good for


def storable(wave: Waveform, duration: float) -> Waveform:
    """The waveform itself, or its piecewise cubic over [0, duration] where a file cannot describe it.

    A `Function` becomes what the models saw of it, within `FIT` of its largest value; the code of f is not kept.
    """
    if type(wave).__name__ in KINDS:
        return wave
    return PiecewiseCubic.of(wave, 0.0, duration, tolerance=FIT)


def to_json(wave: Waveform) -> str:
    """The waveform as JSON text: its kind and its fields.

    Raises InputError: a `Function` or another kind that no file can describe.
    """
    if type(wave).__name__ not in KINDS:
        raise checks.InputError(
            f"a {type(wave).__name__} cannot be written to a file; write its piecewise cubic over the run instead, "
            "th.PiecewiseCubic.of(wave, 0, duration)"
        )
    fields = {k: np.asarray(v).tolist() for k, v in asdict(wave).items()}  # type: ignore[call-overload]
    return json.dumps({"kind": type(wave).__name__, **fields})


def from_json(text: str) -> Any:
    """Rebuild a waveform from `to_json`; InputError when the text is not one."""
    try:
        fields = files.from_json(text)
        kind = KINDS[checks.choice("waveform kind", fields.pop("kind"), KINDS)]
        return kind(**fields)
    except (checks.InputError, KeyError, TypeError, AttributeError) as error:
        raise checks.InputError(f"waveform {checks.shown(text)} cannot be read: {error}") from None
